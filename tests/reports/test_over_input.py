"""Mechanisms over their input: what is printed, from the input alone, is the motion and the joint forces of a run."""

from __future__ import annotations

import numpy as np
import pytest
import symengine as se
import sympy

import mbdae as mb
from mbdae.documents.blocks import Equation, Picture, Section, Table, every, numbered
from mbdae.reports.mechanisms.legs import mechanism
from mbdae.reports.states import POINTS
from mbdae.system.prepare import prepare

ACCURACY = 1e-7


def four_bar():
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    at = [(0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)]
    links = [s.link(name, a, b, mass=0.5) for name, a, b in zip(("crank", "coupler", "rocker"), at, at[1:], strict=False)]
    for i, name in enumerate("ABCD"):
        k, l = [s.ground, *links, s.ground][i : i + 2]
        s.revolute(name, k, l, at=at[i], **({"angle": 12.56 * mb.t} if name == "A" else {"damper": 0.01}))
    return s


def slider_crank(pin=(0.1, 0), angle=12.0 * mb.t):
    """Drawn with the crank's pin at a place, by default along x: at the dead centre of the piston."""
    s = mb.Scene("slider-crank", gravity=(0, -9.81, 0))
    crank, rod = s.link("crank", (0, 0), pin, mass=0.4), s.link("rod", pin, (0.5, 0), mass=0.7)
    piston = s.rigid_body("piston", 0.3, (0.01, 0.01, 0.01), at=(0.5, 0))
    s.revolute("A", s.ground, crank, at=(0, 0), angle=angle)
    s.revolute("B", crank, rod, at=pin)
    s.revolute("C", rod, piston, at=(0.5, 0))
    s.prismatic("D", s.ground, piston, at=(0.55, 0), axis=(1, 0, 0))
    return s


def six_bar():
    """Watt's: a four-bar, and a dyad between its coupler and the ground."""
    s = mb.Scene("six-bar", gravity=(0, -9.81, 0))
    at = {"A": (0, 0), "B": (0.05, 0.1), "C": (0.4, 0.3), "D": (0.5, 0), "E": (0.3, 0.45), "F": (0.8, 0.4), "G": (0.9, 0.0)}
    bodies = {name: s.link(name, at[a], at[b], mass=0.5) for name, a, b in (("crank", "A", "B"), ("rocker", "C", "D"),
                                                                           ("link", "E", "F"), ("lever", "F", "G"))}
    bodies |= {"coupler": s.rigid_body("coupler", 0.8, (0.02, 0.02, 0.02), at=(0.25, 0.3)), "ground": s.ground}
    ends = {"A": ("ground", "crank"), "B": ("crank", "coupler"), "C": ("coupler", "rocker"), "D": ("ground", "rocker"),
            "E": ("coupler", "link"), "F": ("link", "lever"), "G": ("lever", "ground")}
    for name, (k, l) in ends.items():
        s.revolute(name, bodies[k], bodies[l], at=at[name], **({"angle": 12.56 * mb.t} if name == "A" else {}))
    return s


def planetary():
    """Sun driven, ring fixed: two gears on the angles of sun, carrier and planet, solved together."""
    s = mb.Scene("planetary", gravity=(0, -9.81, 0))
    carrier = s.rigid_body("carrier", 1.0, (0.1, 0.1, 0.1), at=(0.05, 0))
    sun, planet = (s.rigid_body(n, 1.0, (0.1, 0.1, 0.1), at=at) for n, at in (("sun", (0, 0)), ("planet", (0.3, 0.01))))
    s.revolute("S", s.ground, sun, at=(0, 0), angle=10 * mb.t + 5 * mb.t**2)
    s.revolute("H", s.ground, carrier, at=(0, 0), damper=0.3)
    s.revolute("P", carrier, planet, at=(0.3, 0))
    s.gear("ring", "H", "P", ratio=-4.0)
    s.couple("mesh", {"S": 1.0, "H": -1.0, "P": 0.5})
    return s


def dyad(kinds, turned, backwards):
    """A crank that moves a dyad of two bodies between B on the crank and D on the ground; R turns, P slides."""
    s = mb.Scene(kinds, gravity=(0.5, -9.81, 0))
    crank = s.link("crank", (0, 0), (0.05, 0.1), mass=0.3)
    one, two = (s.rigid_body(n, 0.7, (0.02, 0.02, 0.02), at=at) for n, at in (("one", (0.25, 0.3)), ("two", (0.55, 0.2))))
    s.revolute("A", s.ground, crank, at=(0, 0), angle=0.3 * sympy.sin(6 * mb.t))
    ends = [(crank, one, (0.05, 0.1), (0.3, 1, 0)), (one, two, (0.45, 0.35), (1, 0.2, 0)),
            (two, s.ground, (0.7, -0.1), (1, 0.3, 0))]
    for kind, name, (k, l, at, axis) in zip(kinds, "BCD", ends, strict=True):
        k, l = (l, k) if backwards else (k, l)
        if kind == "R":
            s.revolute(name, k, l, at=at, axis=(0, 0, -1 if turned else 1))
        else:
            s.prismatic(name, k, l, at=at, axis=axis)
    return s


AXIS, CROSS, BALL = np.array([0.1, 0.2, 1.0]), np.array([0.7, 0.2, -0.6]), np.array([0.45, 0.1, 0.35])


def stewart(**driven):
    """A platform on a hinge, with a leg of a Stewart platform: cross, slide and ball. The hinge or the slide is driven."""
    s = mb.Scene("Stewart leg", gravity=(0.3, -0.2, -9.81), space="spatial")
    along = (BALL - CROSS) / np.linalg.norm(BALL - CROSS)
    platform = s.rigid_body("platform", 2.0, (0.05, 0.04, 0.08), at=(0.2, 0.0, 0.4))
    lower = s.rigid_body("lower", 0.6, (0.01, 0.01, 0.001), at=CROSS + 0.2 * along)
    upper = s.rigid_body("upper", 0.4, (0.008, 0.008, 0.0006), at=BALL - 0.2 * along)
    s.revolute("H", s.ground, platform, at=(0, 0, 0.3), axis=AXIS, **({} if "position" in driven else driven))
    s.universal("U", s.ground, lower, at=CROSS, axis=along)
    s.prismatic("P", lower, upper, at=CROSS + 0.4 * along, axis=along, **(driven if "position" in driven else {}))
    s.spherical("S", upper, platform, at=BALL)
    return s


def driven_hinge():
    return stewart(angle=12.0 * mb.t)


def driven_leg():
    return stewart(position=0.25 * (1 - sympy.cos(12 * mb.t)))


def spatial_four_bar(flipped):
    """A coupler with a ball and a cross between a crank and a rocker; the crank holds the ball, or the cross."""
    s, at = mb.Scene("spatial four-bar", gravity=(0.3, -0.2, -9.81), space="spatial"), ((0.1, 0, 0), (0.5, 0.4, 0.3))
    crank, coupler, rocker = (s.rigid_body(name, 1.0, (0.01, 0.02, 0.015), at=place) for name, place in
                              (("crank", (0.05, 0, 0)), ("coupler", (0.3, 0.2, 0.15)), ("rocker", (0.5, 0.4, 0.1))))
    s.revolute("A", s.ground, crank, at=(0, 0, 0), axis=(0, 0.1, 1), angle=5 * mb.t)
    if flipped:
        s.universal("U", coupler, crank, at=at[0], axis=(0.4, 0.4, 0.3))
        s.spherical("S", rocker, coupler, at=at[1])
        s.revolute("R", rocker, s.ground, at=(0.5, 0.4, -0.2), axis=(0, 1, 0.2))
    else:
        s.universal("U", rocker, coupler, at=at[1], axis=(0.4, 0.4, 0.3))
        s.spherical("S", coupler, crank, at=at[0])
        s.revolute("R", s.ground, rocker, at=(0.5, 0.4, -0.2), axis=(0, 1, 0.2))
    return s


def spatial_slider_crank(flipped):
    s, at = mb.Scene("spatial slider-crank", gravity=(0.3, -0.2, -9.81), space="spatial"), (0.1, 0.1, 0.6)
    crank, rod, piston = (s.rigid_body(name, 1.0, (0.01, 0.02, 0.015), at=place) for name, place in
                          (("crank", (0.05, 0, 0)), ("rod", (0.1, 0.05, 0.3)), ("piston", at)))
    s.revolute("A", s.ground, crank, at=(0, 0, 0), axis=(0, 1, 0.1), angle=5 * mb.t)
    s.spherical("S", crank, rod, at=(0.1, 0, 0))
    s.universal("U", rod, piston, at=at, axis=(0, -0.1, -0.6))
    s.prismatic("P", *((piston, s.ground) if flipped else (s.ground, piston)), at=at, axis=(0, 0.1, 1))
    return s


def geared_arm(flipped):
    """A tree in space: a base that turns, an arm that a bevel gear lifts, a hand that a rack pushes out."""
    s = mb.Scene("arm", gravity=(0.3, -0.2, -9.81), space="spatial")
    base, arm, hand = (s.rigid_body(name, 1.0, (0.01, 0.02, 0.03), at=at) for name, at in
                       (("base", (0.05, 0, 0.2)), ("arm", (0.3, 0, 0.4)), ("hand", (0.6, 0, 0.5))))
    s.revolute("turn", s.ground, base, at=(0, 0, 0), axis=(0, 0, 1), angle=2 * mb.t + mb.t**2)
    s.revolute("lift", *((arm, base) if flipped else (base, arm)), at=(0, 0, 0.4), axis=(0, 1, 0))
    s.prismatic("out", *((hand, arm) if flipped else (arm, hand)), at=(0.4, 0, 0.4), axis=(1, 0, 0.1))
    s.gear("bevel", "turn", "lift", ratio=-2.0)
    s.couple("rack", {"lift": 0.1, "out": 1.0})
    return s


def pages(prepared):
    page = mechanism(prepared)
    return page, numbered([page.motion(), *page.blocks()])


def failed(checks):
    return [check for check in checks if not check.holds]


def turning_back(page):
    table = next(iter(every(Table, page.dead_centres())))
    return {(float(x), what) for x, what in table.rows}


@pytest.mark.parametrize("scene", [four_bar, slider_crank, six_bar, planetary, driven_hinge, driven_leg])
def test_one_turn_is_that_of_a_run(scene):
    """360 places over one turn and more: joint forces from the input alone, within the accuracy asked of the run."""
    r = scene().simulate(0.55, accuracy=ACCURACY, outputs=np.linspace(0, 0.55, 361)[1:])
    page, blocks = pages(r.prepared)
    checks, printed = page.read_at(blocks, r.t, *r._states)
    assert len(r.t) == 360
    assert printed.stated.sum() >= 358  # next to a condition's zero, if anywhere
    assert max(check.residual for check in checks) < ACCURACY
    section, wrong = page.beside(r, blocks)
    assert not wrong
    rows = next(every(Table, [section])).rows
    for _, _, largest, difference, _ in rows:
        assert float(difference) <= 10 * ACCURACY * max(float(largest), 1.0)
    assert len([*every(Picture, [section])]) == sum(row[0].startswith("force") for row in rows) >= 3


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("kinds", ["RRR", "RRP", "PRR", "RPR", "RPP", "PRP", "PPR"])
def test_every_dyad(kinds, turned, backwards):
    """The rows of the scene vanish where the print puts the bodies, and its motion and forces are those of the scene."""
    page, blocks = pages(prepare(dyad(kinds, turned, backwards)))
    assert not failed(page.printed(blocks))


def test_dead_centres_are_those_of_the_geometry():
    """The piston turns back with crank and rod in line, the rocker where crank and coupler are; a rod across a slide ends the
    turn."""
    for scene, wanted in ((slider_crank, (0, np.pi)), (slider_crank_off, (3 * np.pi / 4, 7 * np.pi / 4))):
        found = sorted({round(x % (2 * np.pi - 1e-5), 5) for x, _ in turning_back(pages(prepare(scene()))[0])})
        np.testing.assert_allclose(found, wanted, atol=3e-5)
    a, b, c, d = 0.3, np.hypot(0.5, 0.3), np.hypot(0.1, 0.6), 0.6
    angles = [np.arccos((d**2 + (b + sign * a) ** 2 - c**2) / (2 * d * (b + sign * a))) for sign in (1, -1)]
    wanted = sorted(((angles[0] - np.pi / 2) % (2 * np.pi), (angles[1] + np.pi - np.pi / 2) % (2 * np.pi)))
    found = sorted(x for x, what in turning_back(pages(prepare(four_bar()))[0]) if "D" in what)
    np.testing.assert_allclose(found, wanted, atol=2e-6)
    page, blocks = pages(prepare(dyad("PRR", False, False)))
    ends = [what for _, what in turning_back(page) if "dead centre" in what]
    assert len(ends) == 2
    assert all("normal to the slide B" in what for what in ends)
    assert r"\Delta" in " ".join(e.latex for e in every(Equation, blocks) if r"\ne 0" in e.latex)


@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize("scene", [spatial_four_bar, spatial_slider_crank, geared_arm])
def test_mechanisms_in_space(scene, flipped):
    """The rows of the scene vanish where the print puts the bodies, and its motion and forces are those of the scene."""
    page, blocks = pages(prepare(scene(flipped)))
    assert not failed(page.printed(blocks))


def test_dead_centres_of_a_leg_are_those_of_the_geometry():
    """The stroke turns back where the line of the leg meets the axis of the hinge; a driven leg goes no further there."""
    h, at = AXIS / np.linalg.norm(AXIS), np.array([0, 0, 0.3])

    def ball(x):
        r = BALL - at
        return at + r * np.cos(x) + np.cross(h, r) * np.sin(x) + h * (h @ r) * (1 - np.cos(x))

    x = np.linspace(0, 2 * np.pi, 3601)
    arm = np.array([h @ np.cross(ball(v) - at, ball(v) - CROSS) for v in x])
    places = [x[i] - arm[i] * (x[i + 1] - x[i]) / (arm[i + 1] - arm[i]) for i in np.flatnonzero(arm[1:] * arm[:-1] < 0)]
    found = sorted(v for v, what in turning_back(pages(prepare(driven_hinge()))[0]) if "of P turns back" in what)
    np.testing.assert_allclose(found, places, atol=2e-6)
    strokes = sorted(np.linalg.norm(ball(v) - CROSS) - np.linalg.norm(BALL - CROSS) for v in places)
    ends = sorted((v, what) for v, what in turning_back(pages(prepare(driven_leg()))[0]) if "dead centre" in what)
    np.testing.assert_allclose([v for v, _ in ends], strokes, atol=2e-6)
    assert all("from U to S meets the axis of H" in what for _, what in ends)


@pytest.mark.parametrize(("scene", "step"), [("slider_crank_off", 4), pytest.param("driven_leg", 23, marks=pytest.mark.slow)])
def test_a_wrong_formula_is_seen(scene, step):
    """Every fourth formula of positions, rates and closures, or fewer, one after the other off by 0.001, is told by a check."""
    missed, scene = [], globals()[scene]
    for n in range(0, len(mechanism(prepare(scene())).formulas), step):
        page = mechanism(prepare(scene()))
        page.limits.clear()
        name, e = page.formulas[n]
        if e == 0 or name[0] == "c" or name not in {kept for _, kept, _ in page.kept()}:  # c: axes, some of them times 0
            continue
        if name == "Y2" and "X2" not in dict(page.formulas):  # of both arguments of an atan2 a factor: its sign alone counts
            continue
        states = page.on_input()
        page.formulas[n] = (name, e * se.RealDouble(1.001) + se.RealDouble(1.7e-3))
        blocks = numbered([page.motion(), *page.blocks()])
        if not failed(page.read_at(blocks, *states)[0]):
            missed.append(name)
    assert missed == []


def slider_crank_off():
    """Drawn off its dead centres."""
    return slider_crank((0.1, 0.1), 2.0 * mb.t + mb.t**2)


def test_what_has_no_such_form_says_why():
    tree = mb.Scene("tree", gravity=(0, -9.81, 0))
    rods = [tree.link(f"rod {i}", (i, 0), (i + 1, 0), mass=1.0) for i in range(2)]
    tree.revolute("A", tree.ground, rods[0], at=(0, 0))
    tree.revolute("B", rods[0], rods[1], at=(1, 0))
    with pytest.raises(ValueError, match="its input, rod 1"):
        mechanism(prepare(tree))
    assert "There is no closed form of it: with A as its input" in mb.report(tree).to_markdown()


def test_the_report_of_a_result_shows_formulas_beside_its_run():
    document = mb.report(four_bar().simulate(0.1, accuracy=1e-5))
    titles = [b.title for b in document.blocks if isinstance(b, Section)]
    assert "Motion over the input" in titles
    assert "Joint forces over the input, beside a run" in titles
    assert "comparisons hold" in document.to_markdown()
    with pytest.raises(mb.OptionError, match="takes no options"):
        mb.report(four_bar().simulate(0.1, accuracy=1e-5), friction=None)


@pytest.mark.parametrize("angle", [-2 * mb.t, -0.35 * sympy.sin(9 * mb.t)])
def test_places_beyond_a_dead_centre_are_left_out(angle):
    """An input that would be driven through the dead centre of coupler and rocker: the formulas are compared up to it."""
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    at = [(0, 0), (0, 1), (0, 2.5), (1, 0)]
    links = [s.link(name, a, b, mass=0.5) for name, a, b in zip(("crank", "coupler", "rocker"), at, at[1:], strict=False)]
    for i, name in enumerate("ABCD"):
        s.revolute(name, *[s.ground, *links, s.ground][i : i + 2], at=at[i], **({"angle": angle} if name == "A" else {}))
    page, blocks = pages(prepare(s))
    q, u = page.on_input()[1:3]
    assert np.isfinite(q).all()
    assert np.isfinite(u).all()
    assert 0 < len(q) < POINTS
    assert not failed(page.printed(blocks))
    assert "comparisons hold" in mb.report(s.simulate(0.02, accuracy=1e-5)).to_markdown()
