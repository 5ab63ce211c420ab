"""Symbols of joints follow from the motion they leave, whatever their class is called; plots name coordinates and their units."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.results.stored_parts import started
from mbdae.show.drawing import LOOKS
from mbdae.show.shapes import geometry
from mbdae.system.prepare import prepare

sys.path.insert(0, str(Path(__file__).parent))
from joint_scenes import MODELS, every_joint


def seen(s: mb.Scene) -> Any:
    return geometry(started(prepare(s)))


def kinds(shapes: Any, item: str) -> dict[str, int]:
    """Shapes of an item by kind; without the ground, which is drawn once where several are close."""
    return Counter(shape.kind for shape in shapes.shapes if shape.item == item and shape.kind != "ground")


#: by joint of `every_joint` its symbol: a pin with ring and axis, a guide with a box, both, a thread, forks, a plane with a pin
SYMBOLS = {
    "R": {"pin": 1, "line": 2, "thin": 1}, "P": {"guide": 1, "box": 1},
    "C": {"guide": 1, "box": 1, "line": 1, "thin": 2}, "H": {"guide": 1, "box": 1, "line": 1, "thin": 1},
    "U": {"line": 2, "dot": 1}, "E": {"guide": 1, "pin": 1, "line": 2, "arrow": 1},
    "S": {"guide": 1, "pin": 1, "line": 2, "thin": 1}, "A": {"pin": 1, "line": 2},
}


@pytest.mark.parametrize("model", MODELS, ids=lambda m: type(m).__name__)
def test_symbols_show_the_motion_in_every_model(model: mb.JointModel) -> None:
    shapes = seen(every_joint(model))
    assert {name: kinds(shapes, name) for name in SYMBOLS} == SYMBOLS
    assert {shape.kind for shape in shapes.shapes} <= set(LOOKS)


def test_balls_planes_and_locks() -> None:
    s, size = mb.Scene("balls", space="spatial"), (0.02, 0.05, 0.04)
    b = [s.rigid_body(f"b{i}", 1.0, size, at=(i, 0, 0)) for i in range(5)]
    s.spherical("ball", s.ground, b[0], at=(0, 0, 0))
    s.point_on_line("line", s.ground, b[1], at=(1, 0, 0), axis=(0, 0, 1))
    s.point_on_plane("plane", s.ground, b[2], at=(2, 0, 0), axis=(0, 0, 1))
    s.fixed_orientation("lock", s.ground, b[3])
    s.weld("glue", b[3], b[4], at=(3.5, 0, 0))
    shapes = seen(s)
    assert {n: kinds(shapes, n) for n in ("ball", "line", "plane", "lock", "glue")} == {
        "ball": {"ball": 1}, "line": {"guide": 1, "ball": 1}, "plane": {"guide": 1, "ball": 1}, "lock": {"lock": 1},
        "glue": {"weld": 1}}


@pytest.mark.parametrize("lead", [0.2, -0.2])
def test_a_thread_has_the_hand_of_its_screw(lead: float) -> None:
    s = mb.Scene("screw")
    s.screw("H", s.ground, s.rigid_body("b", 1.0, (0.1, 0.1, 0.1), at=(0, 0, 0)), at=(0, 0, 0), axis=(0, 0, 1), lead=lead)
    (thread,) = [shape.points[0] for shape in seen(s).shapes if shape.item == "H" and shape.kind == "thin"]
    turning = np.cross(thread[:-1], thread[1:])[:, 2] * np.diff(thread[:, 2])
    assert np.all(np.sign(turning) == np.sign(lead))


def test_forks_of_a_universal_joint_hold_pins_at_right_angles() -> None:
    s = mb.Scene("shafts", space="spatial")
    a, b = (s.rigid_body(name, 1.0, (0.1, 0.2, 0.3), at=at) for name, at in (("a", (0.5, 0, 0)), ("b", (1.5, 0, 0.15))))
    s.revolute("R", s.ground, a, at=(0, 0, 0), axis=(1, 0, 0))
    s.universal("U", a, b, at=(1, 0, 0), axis=(1, 0, 0), axis_l=(1, 0, 0.3))
    shapes = seen(s)
    forks = {shape.body: shapes.polyline(shape)[0] for shape in shapes.shapes if shape.item == "U" and shape.kind == "line"}
    pins = {body: fork[0] - fork[1] for body, fork in forks.items()}
    assert pins.keys() == {"a", "b"}
    assert abs(pins["a"] @ pins["b"]) < 1e-12
    assert abs(pins["a"] @ (1, 0, 0)) < 1e-12
    assert abs(pins["b"] @ (1, 0, 0.3)) < 1e-12
    assert forks["a"][4, 0] < 1 < forks["b"][4, 0]  # each base lies on the side of its own body


def test_couplings_are_drawn_between_their_joints() -> None:
    s = mb.Scene("gears")
    a, b = s.rigid_body("a", 1.0, 0.1, at=(0, 0)), s.rigid_body("b", 1.0, 0.1, at=(1, 0))
    s.revolute("A", s.ground, a, at=(0, 0))
    s.revolute("B", s.ground, b, at=(1, 0))
    s.gear("mesh", "A", "B", ratio=-1.0)
    (line,) = [shape.points[0] for shape in seen(s).shapes if shape.item == "mesh"]
    np.testing.assert_allclose(line, [[0, 0, 0], [1, 0, 0]], atol=1e-12)
    assert "mesh" in {name for label in seen(s).labels for name in label.text.split(", ")}


def test_plots_name_coordinates_and_their_units() -> None:
    r = every_joint().simulate(0.05, accuracy=1e-3)
    figure = r.plot("H.angle", "C.angle", "C.displacement", "C.displacement_rate", "U.angle_k", "E.x", "E.angle_rate", "H.rate",
                    "P.rate")
    assert [axis.get_ylabel() for axis in figure.axes] == [
        "angle [rad]", "displacement [m]", "displacement rate [m/s]", "angle k [rad]", "x [m]", "angle rate [rad/s]",
        "rate [rad/s]", "speed [m/s]"]
    (axis,) = r.phase("S.travel", "S.travel_rate").axes
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("S.travel [m]", "S.travel_rate [m/s]")
    words = r"no sensor 'C\.rate': did you mean 'C\.angle_rate'\? 'C' has angle, angle_rate, displacement, displacement_rate"
    with pytest.raises(mb.SceneError, match=words):
        r.plot("C.rate")
