"""Mechanisms over their input where branches of a loop meet, in any plane, with springs on their joints; what the sheet says."""

from __future__ import annotations

import re

import numpy as np
import pytest
import symengine as se

import mbdae as mb
from mbdae.documents.blocks import Equation, Picture, Section, Table, every, numbered
from mbdae.reports.mechanisms import InPlane
from mbdae.reports.mechanisms.legs import mechanism
from mbdae.reports.page import Check
from mbdae.reports.scene_sheet import Sheet
from mbdae.system.prepare import prepare

UPRIGHT = np.eye(3)[:2]  # axes of the drawing in space


def four_bar(at, angle=2 * mb.t, gravity=(0, -9.81), axes=UPRIGHT, layers=(0, 0, 0), **further):
    """axes: directions of x and y of the drawing; layers: places of the bodies along its normal."""
    at, n = [np.array(p) @ axes for p in at], np.cross(*axes)
    s = mb.Scene("four-bar", gravity=np.array(gravity[:2]) @ axes + (gravity[2] * n if gravity[2:] else 0))
    bodies = [s.rigid_body(name, m, (0.02, 0.03, 0.04), at=(a + b) / 2 + z * n)
              for name, m, a, b, z in zip(("crank", "coupler", "rocker"), (0.3, 0.6, 0.5), at, at[1:], layers, strict=False)]
    for i, name in enumerate("ABCD"):
        own = {"angle": angle} if name == "A" else further if name == "C" else {}
        s.revolute(name, *[s.ground, *bodies, s.ground][i : i + 2], at=at[i], axis=n, **own)
    return s


def parallelogram(**further):
    return four_bar([(0, 0), (0, 1), (2, 1), (2, 0)], **further)


def ends_meet(longer=0.0):
    """Crank and ground together are as long as coupler and rocker, but for what these are longer."""
    a, d, b, c = 1.0, 3.0, 2.5 + longer, 1.5
    B = np.array([np.cos(1.0), np.sin(1.0)])
    u = (np.array([d, 0]) - B) / (size := np.linalg.norm(np.array([d, 0]) - B))
    x = (b**2 - c**2 + size**2) / (2 * size)
    return four_bar([(0, 0), a * B, B + x * u + np.sqrt(b**2 - x**2) * np.array([-u[1], u[0]]), (d, 0)])


def slider_crank(crank=1.0, rod=1.0, start=0.4, angle=mb.t, **further):
    s = mb.Scene("slider-crank", gravity=(0, -9.81, 0))
    pin = crank * np.array([np.cos(start), np.sin(start)])
    end = (pin[0] + np.sqrt(rod**2 - pin[1] ** 2), 0)
    links = s.link("crank", (0, 0), pin, mass=2.0), s.link("rod", pin, end, mass=1.0)
    block = s.rigid_body("block", 3.0, (0.1, 0.1, 0.1), at=end)
    s.revolute("A", s.ground, links[0], at=(0, 0), angle=angle)
    s.revolute("B", *links, at=pin)
    s.revolute("C", links[1], block, at=end)
    s.prismatic("P", s.ground, block, at=end, axis=(1, 0, 0), **further)
    return s


def pages(prepared):
    page = mechanism(prepared)
    return page, numbered([page.motion(), *page.blocks()])


def told(page):
    return [(float(x), what) for table in every(Table, page.dead_centres()) for x, what in table.rows]


def failed(checks):
    return [check for check in checks if not check.holds]


def test_loops_go_through_their_change_points():
    """Over three turns the rocker of a parallelogram turns with its crank, and a rod as long as its crank takes the block
    along."""
    at = np.linspace(0, 6 * np.pi, 400)
    page, _ = pages(prepare(parallelogram()))
    found, off = page.along(at), page.off_change_points(at)
    for name, wanted in (("crank", at), ("rocker", at), ("coupler", 0 * at)):
        angle = found[f"x{next(n for n in page.prepared.model.nodes if n.name == name).u + 2}"][off]
        np.testing.assert_allclose(np.angle(np.exp(1j * (angle - wanted[off]))), 0, atol=1e-7)
    page, _ = pages(prepare(slider_crank()))
    block = page.along(at)[f"x{next(n for n in page.prepared.model.nodes if n.name == 'block').u}"]
    off = page.off_change_points(at)
    np.testing.assert_allclose(block[off], 2 * np.cos(0.4 + at[off]), atol=1e-7)


def test_a_stroke_through_a_change_point():
    """The block is driven over the centre of the crank, where rod and crank lie upon each other: the crank goes on with half its
    angle to the line of centres, arccos of half the distance."""
    s = slider_crank(position=-1.5 * mb.t, angle=None)
    page, blocks = pages(prepare(s))
    (branch,) = page.branches.values()
    start = 2 * np.cos(0.4)
    np.testing.assert_allclose(branch.changes, [-start], atol=1e-6)
    dead = "dead centre: A, B and C lie on one line"
    assert [what.split(";")[0] for _, what in told(page)] == [dead, "change point: A and C coincide", dead]
    at = np.linspace(-start - 1.5, -start + 1.5, 50)
    crank = page.along(at)[f"x{next(n for n in page.prepared.model.nodes if n.name == 'crank').u + 2}"]
    np.testing.assert_allclose(0.4 + crank, np.arccos((start + at) / 2), atol=1e-9)
    r = s.simulate(2.0, accuracy=1e-7)
    assert not page.beside(r, blocks)[1]


def test_change_points_are_named():
    places = [(x, what) for x, what in told(pages(prepare(parallelogram()))[0])]
    np.testing.assert_allclose([x for x, _ in places], [np.pi / 2, 3 * np.pi / 2], atol=1e-6)
    assert all("change point: B, C and D lie on one line; both branches" in what for _, what in places)
    page = pages(prepare(slider_crank()))[0]
    changes = [x for x, what in told(page) if "change point" in what]
    np.testing.assert_allclose(changes, np.pi * np.array([0.5, 1.5]) - 0.4, atol=1e-6)
    np.testing.assert_allclose([x for x, what in told(page) if "turns back" in what], np.pi * np.array([1, 2]) - 0.4, atol=1e-6)
    page = pages(prepare(ends_meet()))[0]
    assert "two turns, after which it is on its first branch again" in page.dead_centres()[0].text
    np.testing.assert_allclose([x for x, what in told(page) if "change point" in what], np.pi * np.array([1, 3]) - 1, atol=1e-6)
    assert not mechanism(prepare(slider_crank(rod=1.2))).branches
    found = told(pages(prepare(closed_chain((1.0, 1.0, 1.0, 1.0), 0.8, angle=mb.t)))[0])  # a rhombus, which folds in two ways
    assert [what.split(";")[0] for _, what in found] == ["change point: B, C and D lie on one line",
                                                         "change point: B and D coincide"]


def test_a_gap_narrower_than_the_places_looked_at_is_found():
    page = pages(prepare(ends_meet(longer=-1e-6)))[0]
    ends = [x for x, what in told(page) if "dead centre" in what]
    assert "do not close" in page.dead_centres()[0].text
    assert len(ends) == 2
    assert 0 < ends[0] + 2 * np.pi - ends[1] < 0.01
    np.testing.assert_allclose(ends, [-np.pi - 1, np.pi - 1], atol=0.01)


@pytest.mark.parametrize("scene", [parallelogram, slider_crank, ends_meet])
def test_a_run_through_a_change_point(scene):
    """Its branch is that of the printed formulas; on the other one they are not those of the run, and the page says so."""
    r = scene().simulate(2.0, accuracy=1e-7)
    page, blocks = pages(r.prepared)
    section, wrong = page.beside(r, blocks)
    assert not wrong
    assert "goes through a change point just before t = " in section.blocks[0].text
    assert "No difference is larger" in section.blocks[0].text
    page.branches_of = lambda q, u: {name: np.ones(len(q)) for name in page.branches}
    section, wrong = page.beside(r, blocks)
    named = {"force of A", "force of B", "force of C", f"force of {r.prepared.model.scene.joints[-1].name}", "torque of A"}
    assert {re.search(r" s the (.*) over the input", check.what)[1] for check in wrong} == named
    assert len(wrong) == 5  # beyond the change point alone
    assert "NOT EQUAL" in section.blocks[0].text
    page = mechanism(r.prepared)
    page.on_l["F", "A", 1] *= se.RealDouble(1.001)  # the run's error at the change point may be a thousand times its forces
    wrong = page.beside(r, numbered([page.motion(), *page.blocks()]))[1]
    assert ["force of A" in check.what for check in wrong] == [True, True]
    if scene is parallelogram:
        assert "comparisons hold" in (text := mb.report(r).to_markdown())
        assert "the run's own error bounds it" not in text
        assert not re.search(r"\d\.\d+e-(1[5-9]|[2-9]\d) \|", text)  # round-off of the start
        assert "mass: mass" not in text


def test_another_branch_of_a_run_is_told():
    r = parallelogram().simulate(2.0, accuracy=1e-6)
    page, blocks = pages(r.prepared)
    page.branches = {name: b._replace(changes=[b.changes[1]]) for name, b in page.branches.items()}
    assert r"s on it is on the branch $\sigma^{(1)} = -1$" in page.beside(r, blocks)[0].blocks[0].text


def test_a_difference_beyond_the_error_of_the_run_is_told():
    r = slider_crank(rod=2.5).simulate(0.3, accuracy=1e-7)
    page = mechanism(r.prepared)
    n = next(i for i, (name, _) in enumerate(page.formulas) if name.startswith("S"))
    page.formulas[n] = (page.formulas[n][0], page.formulas[n][1] * se.RealDouble(1.001))
    wrong = page.beside(r, numbered([page.motion(), *page.blocks()]))[1]
    assert wrong
    assert all(isinstance(check, Check) and not check.holds for check in wrong)


@pytest.mark.parametrize("backwards", [False, True])
def test_printed_forces_contain_those_of_the_joint(backwards):
    """Force and moment are those of the sensors: reactions, and springs and dampers of the joint on its body l, also where this
    is the ground."""
    s = mb.Scene("inverted", gravity=(0, -9.81, 0))
    crank = s.link("crank", (0, 0), (0.2, 0.5), mass=0.7)
    block, rod = (s.rigid_body(name, m, (0.1, 0.1, 0.1), at=at) for name, m, at in
                  (("block", 0.5, (0.25, 0.5)), ("rod", 1.5, (0.1, -0.1))))
    s.revolute("A", s.ground, crank, at=(0, 0), angle=3 * mb.t, damper=0.2)
    s.revolute("B", crank, block, at=(0.2, 0.5))
    s.revolute("D", *((rod, s.ground) if backwards else (s.ground, rod)), at=(-0.3, -0.9), spring=30.0, damper=0.4)
    s.prismatic("P", *((block, rod) if backwards else (rod, block)), at=(0, 0.1), axis=(1, 0.4, 0), spring=200.0, damper=3.0)
    r = s.simulate(0.5, accuracy=1e-6)
    page, blocks = pages(r.prepared)
    section, wrong = page.beside(r, blocks)
    assert not wrong
    assert {row[0] for row in next(every(Table, [section])).rows} >= {"force of P", "torque of P", "torque of D", "torque of A"}
    text = mb.report(r).to_markdown()
    assert "comparisons hold" in text
    assert r"T^{\text{own}}_{\text{D},z}" in text
    assert r"F^{\text{own}}_{\text{P},x}" in text
    known = page.values
    page.values = lambda *at: tuple({latex: 0.999 * v if "own" in latex else v for latex, v in part.items()}
                                    if isinstance(part, dict) else part for part in known(*at))
    assert page.beside(r, blocks)[1]


INCLINED = np.array([[2, 1, 2], [-2, 2, 1]]) / 3


@pytest.mark.parametrize(("axes", "layers", "g"), [
    (np.array([[1, 0, 0], [0, 0, 1]]), (0, 0, 0), (0, -9.81)), (INCLINED, (0.1, -0.2, 0.3), (3.0, -9.0, 4.0)),
    (UPRIGHT, (0.1, 0.2, 0.1), (0, 0, -9.81)), (UPRIGHT, (0, 0, 0), (0, 0, -9.81))])
def test_mechanisms_in_any_plane(axes, layers, g):
    """Closed forms in axes of the plane, whose joint forces there are those of a run in space."""
    s = four_bar([(0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)], gravity=g, axes=axes, layers=layers, damper=0.3,
                 angle=7 * mb.t)
    r = s.simulate(1.2, accuracy=1e-6)
    assert not r.prepared.model.planar
    document = mb.report(r)
    text = document.to_markdown()
    assert "so this is the motion in a plane" in text
    assert "comparisons hold" in text
    assert "No difference is larger" in text
    beside = next(b for b in document.blocks if isinstance(b, Section) and b.title.startswith("Joint forces over"))
    flat = InPlane(r.prepared)
    run = flat.run(r)
    assert float(next(every(Table, [beside])).rows[0][2]) == pytest.approx(np.linalg.norm(run["A"].force, axis=1).max(), rel=1e-5)
    flat.axes[0] *= -1  # of a mirrored plane the run is another
    page, blocks = pages(flat.prepared)
    assert page.beside(flat.run(r), blocks)[1]


def test_where_there_is_no_motion_over_the_input_the_sheet_says_why():
    """And with friction in a joint what its joint forces lack: its motion is printed and checked."""
    sheet = Sheet(slider_crank(rod=2.5, friction=mb.Coulomb(0.3, 1e-3)))
    motion, _, forces, checks = sheet.closed()
    assert forces.blocks[0].text.startswith("They have no closed form: friction follows from the reactions.")
    assert len(checks.blocks[1].rows) == 26
    assert "comparisons hold" in checks.blocks[0].text
    assert all(r"\lambda" not in e.latex for e in every(Equation, [motion]))
    held = sheet.prepared.mechanics.accelerations
    sheet.prepared.mechanics.accelerations = lambda *a: (held(*a)[0] * (1 + 1e-9), held(*a)[1])
    assert "NOT EQUAL" in sheet.closed()[3].blocks[0].text
    s = mb.Scene("stacked")
    one, two = (s.rigid_body(name, 1.0, (0.1, 0.1, 0.1), at=at) for name, at in (("one", (1, 0, 0)), ("two", (2, 0, 0.5))))
    s.revolute("A", s.ground, one, at=(0, 0, 0), angle=mb.t)
    s.revolute("B", one, two, at=(1.5, 0, 0), axis=(0, 1, 0.2))
    assert "Nor is there one as a motion in a plane: B lets its bodies leave the plane of A." in mb.report(s).to_markdown()


def test_the_range_that_was_looked_at_is_said():
    s = slider_crank(rod=2.5)
    page = mechanism(prepare(s))
    assert r"$\varphi_{\text{A}}$ from 0 to 6.28319 rad" in page.dead_centres()[0].text
    s = mb.Scene("stroke")
    block = s.rigid_body("block", 1.0, (0.1, 0.1, 0.1), at=(1, 0))
    s.prismatic("P", s.ground, block, at=(3, 0), axis=(1, 0, 0), position=0.2 * mb.t)
    assert r"$u_{\text{P}}$ from -6 to 6 m" in mechanism(prepare(s)).dead_centres()[0].text


def closed_chain(lengths, start, **first):
    """Crank, coupler and rocker of given lengths on a ground of the last one, whose first joint has the input."""
    a, b, c, d = lengths
    pin = a * np.array([np.cos(start), np.sin(start)])
    line = np.array([d, 0]) - pin
    size = np.linalg.norm(line)
    x = (b**2 - c**2 + size**2) / (2 * size)
    end = pin + x * line / size + np.sqrt(b**2 - x**2) * np.array([-line[1], line[0]]) / size
    return four_bar([(0, 0), pin, end, (d, 0)], angle=first.pop("angle", None), **first)


def block_as_input(rod=0.3):
    """The block is the input, which the spinning crank takes through its dead centres."""
    s = mb.Scene("pump", gravity=(0, -9.81, 0))
    pin = 0.1 * np.array([np.cos(1.0), np.sin(1.0)])
    end = (pin[0] + np.sqrt(rod**2 - pin[1] ** 2), 0)
    block = s.rigid_body("block", 1.0, (0.1, 0.1, 0.1), at=end)
    links = s.link("crank", (0, 0), pin, mass=0.3), s.link("rod", pin, end, mass=0.5)
    s.prismatic("P", s.ground, block, at=end, axis=(1, 0, 0))
    s.revolute("C", links[1], block, at=end)
    s.revolute("B", *links, at=pin)
    s.revolute("A", s.ground, links[0], at=(0, 0), rate0=20.0)
    return s


@pytest.mark.parametrize(("scene", "duration", "times"), [
    (block_as_input, 0.3, 2), (lambda: closed_chain((0.5, 0.2, 0.5, 0.6), 0.9), 1.0, 1)])
def test_a_run_beyond_a_dead_centre_is_compared_on_the_first_branch(scene, duration, times):
    r = scene().simulate(duration, accuracy=1e-7)
    page, blocks = pages(r.prepared)
    section, wrong = page.beside(r, blocks)
    text = section.blocks[0].text
    assert not wrong
    found = re.search(r"passes a dead centre just before t = ([\d., e-]+) s, where .* lie on one line", text)
    assert len(found[1].split(",")) == times
    assert "change point" not in text
    n = next(i for i, (name, _) in enumerate(page.formulas) if name.startswith("S"))
    page.formulas[n] = (page.formulas[n][0], page.formulas[n][1] * se.RealDouble(1.001))
    assert page.beside(r, numbered([page.motion(), *page.blocks()]))[1]


@pytest.mark.parametrize(("scene", "duration", "within"), [
    (lambda: closed_chain((0.2, 0.6, 0.5, 0.6), 1.0, angle=3 * mb.t + mb.t**2), 3.0, ", within one turn"),
    (ends_meet, 7.0, ", within two turns"), (lambda: closed_chain((0.5, 0.2, 0.5, 0.6), 0.9), 0.2, "")])
def test_curves_are_drawn_in_order_of_time(scene, duration, within):
    """One line, which ends only where the input begins another turn or where a time is left out."""
    r = scene().simulate(duration, accuracy=1e-6)
    page, blocks = pages(r.prepared)
    for picture in every(Picture, page.beside(r, blocks)[0].blocks):
        lines = [np.array(mark[1]) for mark in picture.content.marks if mark[0] == "line" and mark[2] == "#0072b2"]
        words = [mark[3] for mark in picture.content.marks if mark[0] == "text"]
        assert f"angle{within} [rad]" in words
        assert within in picture.caption
        assert sum(map(len, lines)) <= len(r.t)
        assert all((np.diff(line[:, 0]) > 0).all() for line in lines) or not within
        bends = [np.sum(np.diff(line[1:, 1]) * np.diff(line[:-1, 1]) < 0) for line in lines]
        assert sum(bends) < len(r.t) / 10


@pytest.mark.parametrize(("size", "start"), [(0.2, 0.9), (0.2, 1.0), (0.2, 1.1), (0.2, 1.55), (1.0, 1.57)])
def test_round_off_beside_a_change_point_is_no_difference(size, start):
    """The places at which the sheet compares, or the start, lie next to the change point; a formula that is wrong is told there
    too, and multipliers that are others."""
    page, blocks = pages(prepare(slider_crank(size, size, start, 3 * mb.t)))
    assert not failed(page.printed(blocks))
    states = page.on_input()
    n = next(i for i, (name, _) in enumerate(page.formulas) if name.startswith("S"))
    page.formulas[n] = (page.formulas[n][0], page.formulas[n][1] * se.RealDouble(1.001))
    assert failed(page.read_at(numbered([page.motion(), *page.blocks()]), *states)[0])
    known, multipliers = page.values(*page.states())
    assert not failed(page.read(blocks[1:], known, multipliers))
    assert failed(page.read(blocks[1:], known, multipliers * (1 + 1e-7)))


def test_a_divisor_is_next_to_zero_by_its_terms():
    """All positions of a parallelogram drawn flat have small determinants: differences of products of which the largest
    determinant is a hundredth."""
    flat = four_bar([(0, 0), (0.3, 0), (0.9, 0), (0.6, 0)], angle=3 * mb.t)
    assert "comparisons hold" in mb.report(flat).to_markdown()


@pytest.mark.parametrize(("lengths", "start"), [((0.5, 0.2, 0.5, 0.6), 0.9), ((0.4, 0.3, 0.5, 0.9), 0.6),
                                                ((0.4, 0.3, 0.5, 0.9), -0.2)])
def test_only_what_is_reached_from_the_start_is_listed(lengths, start):
    """A crank between dead centres, where coupler and rocker are in line: the mirrored assembly is beyond them. One that
    lies between one and its mirror image passes the line of the ground, where nothing ends."""
    a, b, c, d = lengths
    at = sorted(sign * np.arccos((a**2 + d**2 - r**2) / (2 * a * d)) - start
                for r in (b + c, abs(b - c)) for sign in (1, -1) if abs(a**2 + d**2 - r**2) < 2 * a * d)
    wanted = max(x for x in at if x < 0), min(x for x in at if x > 0)
    page = pages(prepare(closed_chain(lengths, start, angle=mb.t)))[0]
    np.testing.assert_allclose([x for x, what in told(page) if "dead centre" in what], wanted, atol=1e-6)
    assert all(wanted[0] - 2e-6 <= x <= wanted[1] + 2e-6 for x, _ in told(page))
    range_ = re.search(r"Reachable from the start: .* from (\S+) to (\S+) rad", page.dead_centres()[0].text)
    np.testing.assert_allclose([float(x) for x in range_.groups()], wanted, atol=1e-5)
