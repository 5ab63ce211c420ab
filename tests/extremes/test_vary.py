"""What a map varies: arguments of statements, of scene(), of the run; what cannot be varied is refused by name."""

from __future__ import annotations

import numpy as np
import pytest
import sympy

import mbdae as mb
from mbdae.compare.problem import new_problem
from mbdae.extremes.cell import reference_at
from mbdae.extremes.ways import asked_values, default_vary, ladder, varied
from mbdae.inputs.timed import expression, values
from mbdae.laws.forces import PointSpring
from mbdae.laws.joints import Planar
from mbdae.laws.on_coordinates import JointSpring
from mbdae.study.statements import changed


def machine(length=1.0):
    """One of each thing that has a number to vary."""
    s = mb.Scene("machine", gravity=(0, -9.81, 0))
    crank = s.link("crank", (0, 0), (0.3, 0), mass_per_length=2.0)
    disc = s.rigid_body("disc", 2.0, (0.1, 0.2, 0.25), at=(1, 0), angular_velocity=(0, 0, 4.0))
    blade = s.beam("blade", (2, 0), (2 + length, 0), section=mb.Section(1e4, 2e3, 3e3, 10.0, 20.0, 30.0, 1.0, 1e-2), elements=2)
    s.revolute("A", s.ground, crank, at=(0, 0), angle=5 * mb.t + 0.5)
    s.revolute("B", s.ground, blade, at=(2, 0), rate0=2.0, spring=7.0)
    s.revolute("C", s.ground, disc, at=(1, 0), model=mb.Clearance(0.021, 0.02, mb.Hertz(1e9, 0.3), mb.Coulomb(0.1, 1e-2)))
    s.bushing("mount", s.ground, disc, at=(1, 0), stiffness=(10.0, 20.0, 30.0))
    s.add(PointSpring("rope", crank, disc, at=(0.3, 0), at_l=(1, 0), stiffness=5.0, length=0.7))
    return s


def test_ladders():
    assert ladder(1e-3, 1e1) == (1e-3, 1e-2, 1e-1, 1.0, 10.0)
    assert ladder(1e-9, 1e9) == tuple(float(f"1e{n}") for n in range(-9, 10, 3))
    assert ladder(1e4, 1e0) == (1e4, 1e3, 1e2, 1e1, 1e0)
    assert ladder(2.0, 5.0) == (2.0, 5.0)


def test_mass_is_density():
    """The inertia goes along, and a link keeps its shape."""
    s, factor = changed(machine(), "disc.mass", 8.0)
    assert factor == 1.0
    np.testing.assert_allclose(s["disc"].inertia, 4 * machine()["disc"].inertia)
    s, _ = changed(machine(), "crank.mass", 6.0)
    np.testing.assert_allclose(s["crank"].inertia, 10 * machine()["crank"].inertia)
    assert s["crank"].mass == 6.0


@pytest.mark.parametrize(("name", "value", "read"), [
    ("B.spring", 9.0, lambda s: s["B"].laws[-1].stiffness), ("B.stiffness", 9.0, lambda s: s["B"].laws[-1].stiffness),
    ("C.stiffness", 1e14, lambda s: s["C"].model.normal.stiffness),
    ("C.model.friction.mu", 0.3, lambda s: s["C"].model.friction.mu),
    ("C.clearance", 1e-8, lambda s: s["C"].model.outer - s["C"].model.inner),
    ("C.model.outer", 0.03, lambda s: s["C"].model.outer), ("B.rate0", 3.0, lambda s: s["B"].hold_rate["angle"]),
    ("rope.stiffness", 6.0, lambda s: s["rope"].joint.stiffness),
    ("blade.section.EI3", 3.0, lambda s: s["blade"].section.EI3), ("blade.elements", 3.0, lambda s: s["blade"].elements),
])
def test_numbers_of_items(name, value, read):
    s, factor = changed(machine(), name, value)
    assert read(s) == pytest.approx(value, abs=1e-15)
    assert factor == 1.0
    assert read(machine()) != pytest.approx(value)


def test_lists_and_sections_keep_their_ratios():
    s, _ = changed(machine(), "mount.stiffness", 300.0)
    assert [getattr(s["mount"].laws[0], key) for key in ("kx", "ky", "kz")] == pytest.approx([100, 200, 300])
    s, _ = changed(machine(), "blade.stiffness", 1e6)
    section = s["blade"].section
    assert (section.EA, section.GA2, section.EI3, section.mass_per_length) == pytest.approx((1e6, 2e5, 3e3, 1.0))


def test_a_faster_drive_turns_as_often():
    s, factor = changed(machine(), "A.speed", 50.0)
    assert factor == pytest.approx(0.1)
    assert float(s["A"].prescribed["angle"].subs({"t": 0.2 * factor})) == pytest.approx(5 * 0.2 + 0.5)
    s, factor = changed(machine(), "B.speed", 8.0)
    assert (s["B"].hold_rate, factor) == ({"angle": 8.0}, 0.25)
    s, factor = changed(machine(), "disc.speed", 1.0)
    assert (s["disc"].drawn.angular_velocity[2], factor) == (1.0, 4.0)


def test_arguments_of_the_scene_and_options_of_the_run():
    length, t_end, accuracy = varied(machine, 2.0, asked_values({"length": [0.5, 2.0], "t_end": [1.0], "accuracy": (1e-3, 1e-5)}))
    assert length.scene(0.5)["blade"].outline[-1, 0] == 2.5
    assert t_end.t_end(1.0) == 1.0
    assert accuracy.values == (1e-3, 1e-4, 1e-5)
    assert length.t_end(0.5) == accuracy.t_end(1e-3) == 2.0


@pytest.mark.parametrize(("vary", "words"), [
    ({}, "give {parameter"),
    ({"width": [1.0]}, "nothing named 'width'; arguments of scene.*length.*accuracy, step, t_end.*'crank'"),
    ({"hub.mass": [1.0]}, "no item 'hub' in scene 'machine'; it has 'crank', 'disc'"),
    ({"disc.colour": [1.0]}, "'disc.colour': there is no number 'colour' stated; there is mass, inertia"),
    ({"A.angle": [1.0]}, "'A.angle' stands for an expression, .* not for a number: vary the speed of a motion \\('A.speed'\\)"),
    ({"A.clearance": [1.0]}, "states no clearance, nor outer and inner"),
    ({"mount.speed": [1.0]}, "'mount.speed': the item has no speed at the start"),
    ({"A.speed": [0.0]}, "multiples of the speed stated, 5; neither may be 0"),
    ({"disc.mass": (0.0, 1.0)}, "both need the same sign"),
    ({"disc.mass": []}, "'disc.mass' = \\[\\] is empty"),
    ({"disc.mass": ["heavy"]}, "give \\(low, high\\)"),
    ({"disc.mass": [float("nan")]}, "nan is not finite"),
])
def test_what_cannot_be_varied_is_refused_by_name(vary, words):
    with pytest.raises(mb.OptionError, match=words):
        varied(machine, 1.0, asked_values(vary))


def test_a_scene_offers_what_it_states():
    offered = default_vary(machine())
    assert set(offered) == {"accuracy", "step", "crank.mass", "disc.mass", "blade.stiffness", "B.stiffness", "C.stiffness",
                            "mount.stiffness", "A.speed", "B.speed", "disc.speed"}
    assert len(offered) == 2 + 2 + 4 + 3  # four of a kind at most: the rope is left out
    assert offered["C.stiffness"] == [1e9, 1e12, 1e15]
    assert offered["A.speed"] == pytest.approx([5.0, 50.0, 500.0])


def kicked(bell=0):
    """A block that rests, and is pushed for 0.1 s from 0.3 s on."""
    x = (mb.t - 0.3) / 0.1
    push = 4 * sympy.exp(-((12 * x - 6) ** 2)) if bell else sympy.Piecewise((1, mb.t < 0.3), (5, x < 1), (1, True))
    s = mb.Scene("kicked")
    block = s.rigid_body("block", 2.0, 1.0, at=(0, 0))
    s.force("kick", block, (push, 2 * push, 0))
    s.force("drag", block, (-1, -2, 0))
    return s


@pytest.mark.parametrize(("number", "value", "expected"), [
    ("width", 1e-6, (0.3, 0.3 + 1e-6, 8.0)), ("begin", 0.7, (0.7, 0.8, 8.0)), ("strength", 2.0, (0.3, 0.4, 2.0)),
    ("value.0.width", 1e-3, (0.3, 0.301, 4.0)),
])
def test_a_pulse_is_varied_by_its_numbers(number, value, expected):
    """The first of two inputs, the smaller by half, jumps from 1 where the pulse says, and back."""
    (p,) = varied(kicked, 1.0, asked_values({f"kick.{number}": [value]}))
    law = p.scene(value)["kick"].laws[0]
    begin, end, strength = expected
    inside, outside = [begin + 1e-9, end - 1e-9], [0.0, begin - 1e-9, end + 1e-9, 1.0]
    size = strength if number.startswith("value") else strength / 2
    np.testing.assert_allclose(values(expression(law.fx), np.array(inside)), 1 + size, rtol=1e-12)
    np.testing.assert_allclose(values(expression(law.fx), np.array(outside)), 1.0, rtol=1e-12)
    assert min(abs(np.array(p.stops(value)) - begin)) < 1e-15
    assert min(abs(np.array(p.stops(value)) - end)) < 1e-15


def test_a_pulse_of_a_scene_with_arguments():
    """A bell is as wide as it departs by 1e-12 of its height: 5.26 of its scale to both sides."""
    (p,) = varied(kicked, 1.0, asked_values({"scene(bell=1).kick.width": [1e-5]}))
    stops = p.stops(1e-5)
    assert stops[-1] - stops[0] == pytest.approx(1e-5)
    top = np.max(values(expression(p.scene(1e-5)["kick"].laws[0].fx), np.linspace(stops[0], stops[-1], 1001)))
    assert top == pytest.approx(4.0, rel=1e-4)
    with pytest.raises(mb.OptionError, match=r"nothing named 'drum'; arguments of scene.*bell"):
        varied(kicked, 1.0, asked_values({"scene(drum=1).kick.width": [1e-5]}))


def test_what_is_no_pulse_is_refused():
    with pytest.raises(mb.OptionError, match=r"'A.width': only a pulse has this number, and what is stated there is none"):
        varied(machine, 1.0, asked_values({"A.width": [1e-3]}))
    with pytest.raises(mb.OptionError, match=r"'drag.width'.*there is no number 'width' stated"):
        varied(kicked, 1.0, asked_values({"drag.width": [1e-3]}))


@pytest.mark.parametrize("width", [1e-6, 1e-2])
def test_a_reference_sees_every_pulse(width, monkeypatch):
    """A block of 2 kg that F pushes for w leaves with F w / m, also where runs do not look at their inputs before; two methods
    that then run on without a stop agree on 0."""
    monkeypatch.setattr("mbdae.system.scene_system.WATCH_INPUTS_AND_SWITCHES", False)
    (p,) = varied(kicked, 1.0, asked_values({"kick.width": [width]}))
    problem = new_problem(p.scene(width), 1.0, "block.velocity", None)
    found = reference_at(problem, 1e-9, p.stops(width))
    assert found.uncertainty < 1e-9 / 3
    np.testing.assert_allclose(found.values[-1, :2], [4 * width / 2, 8 * width / 2], rtol=1e-6)
    if width < 1e-3:
        assert np.max(np.abs(reference_at(problem, 1e-9).values)) < 1e-9


def jack():
    """Joints with options by coordinate."""
    s, size = mb.Scene("jack", gravity=(0, 0, -9.81)), (0.1, 0.2, 0.25)
    bodies = [s.rigid_body(f"b{i}", 1.0, size, at=(i, 0, 0)) for i in range(3)]
    s.screw("H", s.ground, bodies[0], at=(0, 0, 0), axis=(0, 0, 1), lead=0.2, damper=0.1, start_rate=9.0)
    s.cylindrical("C", s.ground, bodies[1], at=(1, 0, 0), axis=(1, 0, 0), spring={"displacement": 50.0, "angle": 2.0},
                  prescribed={"displacement": 0.1 * mb.t})
    pulse = sympy.Piecewise((0, mb.t < 0.3), (2, mb.t < 0.5), (0, True))
    s.joint(Planar, "E", s.ground, bodies[2], at=(2, 0, 0), spring={"x": 5.0}, load={"y": pulse},
            start_rate={"x": 1.0, "angle": 3.0})
    return s


def stiffness(s, joint, coordinate):
    (found,) = [law for law in s[joint].laws if isinstance(law, JointSpring) and law.coordinate == coordinate]
    return found.stiffness


@pytest.mark.parametrize(("name", "value", "read"), [
    ("H.lead", 0.5, lambda s: s["H"].joint.lead), ("H.damper", 3.0, lambda s: s["H"].laws[1].damping),
    ("H.start_rate", 4.0, lambda s: s["H"].hold_rate["angle"]), ("C.spring.angle", 9.0, lambda s: stiffness(s, "C", "angle")),
    ("E.stiffness", 9.0, lambda s: stiffness(s, "E", "x")), ("E.start_rate.x", 4.0, lambda s: s["E"].hold_rate["x"]),
    ("E.load.y.strength", 7.0, lambda s: float(s["E"].laws[-1].load.subs({"t": 0.4}))),
])
def test_options_of_joints_by_coordinate(name, value, read):
    s, factor = changed(jack(), name, value)
    assert (read(s), factor) == (pytest.approx(value), 1.0)
    assert read(jack()) != pytest.approx(value)
    assert not s.problems
    assert s.replace("H", model=mb.Classical())["H"].kept  # the changed statements can be repeated


def test_speeds_of_coordinates():
    assert changed(jack(), "H.speed", 3.0)[1] == pytest.approx(3)
    s, factor = changed(jack(), "C.speed", 1.0)
    assert factor == pytest.approx(0.1)
    assert float(s["C"].prescribed["displacement"].subs({"t": 0.5})) == pytest.approx(0.5)
    s, factor = changed(jack(), "E.speed.angle", 6.0)
    assert (s["E"].hold_rate, factor) == ({"x": 1.0, "angle": 6.0}, 0.5)


@pytest.mark.parametrize(("name", "message"), [
    ("E.speed", "this joint has a speed in several coordinates; name one: 'E.speed.x' or 'E.speed.angle'"),
    ("C.stiffness", "this joint has a spring in several coordinates; name one: 'C.spring.displacement' or 'C.spring.angle'"),
    ("C.spring", "has values by coordinate; say 'C.spring.displacement' or 'C.spring.angle'"),
    ("C.spring.turn", "there is no number 'turn' stated; there is displacement, angle"),
    ("C.speed.angle", "the item has no speed at the start"),
])
def test_a_coordinate_has_to_be_named_where_there_are_several(name, message):
    with pytest.raises(mb.OptionError, match=message):
        changed(jack(), name, 1.0)


def test_defaults_vary_what_one_number_says():
    names = default_vary(jack()).keys()
    assert {"E.stiffness", "H.speed", "C.speed"} <= names
    assert not {"C.stiffness", "E.speed"} & names
