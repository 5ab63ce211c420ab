"""Scenes written as MJCF: starts, motions beside MuJoCo, names, and what is told or refused."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mbdae as mb

mujoco = pytest.importorskip("mujoco", reason="the extra `robots` is not installed: MuJoCo compiles MJCF")

SPACE = (0.3, 0.2, -9.81)
FULL = ((0.02, 0.003, 0.001), (0.003, 0.03, 0.002), (0.001, 0.002, 0.025))


def two() -> tuple[mb.Scene, Any, Any]:
    """A scene with two bodies."""
    s = mb.Scene("two", gravity=SPACE)
    return s, s.rigid_body("a", 1.0, FULL, at=(0.2, 0.1, 0.3)), s.rigid_body("b", 2.0, FULL, at=(0.5, 0.1, 0.3))


def hinge_and_slide(**of_a: Any) -> mb.Scene:
    s, a, b = two()
    s.revolute("A", s.ground, a, at=(0, 0, 0), axis=(0, 1, 0), **of_a)
    s.prismatic("P", s.ground, b, at=(0.3, 0.1, 0.2), axis=(1, 0, 0))
    return s


def coupled() -> mb.Scene:
    s = hinge_and_slide(angle0=0.5)
    s.couple("tie", of={"A": 1.0, "P": 3.0})
    return s


def of_a_rack() -> mb.Scene:
    s = hinge_and_slide(rate0=2.0)
    s.rack("rack", "A", "P", radius=-0.1)
    return s


def with_a_value() -> mb.Scene:
    s = hinge_and_slide(rate0=0.4)
    s.couple("tie", of={"P": 1.0, "A": 3.0}, value=0.2)
    return s


def geared() -> mb.Scene:
    s, a, b = two()
    s.revolute("A", s.ground, a, at=(0, 0, 0), axis=(0, 1, 0), angle0=0.5, rate0=1.0)
    s.revolute("B", a, b, at=(0.3, 0, 0), axis=(0, 1, 0))
    s.gear("gear", "A", "B", ratio=-0.5)
    return s


def follower_stated() -> mb.Scene:
    """The start is that of the second of three hinges, which two couplings join."""
    s, a, b = two()
    c = s.rigid_body("c", 1.0, FULL, at=(0.8, 0, 0.2))
    s.revolute("A", s.ground, a, at=(0, 0, 0), axis=(0, 1, 0))
    s.revolute("B", a, b, at=(0.3, 0, 0), axis=(1, 1, 0), angle0=0.3, rate0=-1.0)
    s.revolute("C", b, c, at=(0.6, 0, 0), axis=(0, 1, 0))
    s.couple("one", of={"A": 1.0, "B": -2.0}, value=0.1)
    s.couple("other", of={"C": 1.0, "A": 1.0})
    return s


def closed(held: str) -> mb.Scene:
    """A four-bar in space, with balls at the coupler, whose crank or rocker is held at the start."""
    s = mb.Scene("bars", gravity=SPACE)
    ends = [(0, 0, 0), (0, 0.2, 0.5), (1, 0.1, 0.8), (1, 0, 0)]
    bodies = [s.rigid_body(f"b{i}", 1.0, FULL, at=tuple((np.array(p) + q) / 2)) for i, (p, q) in enumerate(
        pairwise(ends))]
    starts = {"A": {"angle0": 0.2, "rate0": 0.7}, "D": {"angle0": -0.1, "rate0": 0.4}}
    for name, body, at, axis in (("A", 0, ends[0], (0, 1, 0)), ("D", 2, ends[3], (0, 1, 0.2))):
        s.revolute(name, s.ground, bodies[body], at=at, axis=axis, model=mb.Recursive(), **starts[name] if held == name else {})
    s.spherical("B", bodies[0], bodies[1], at=ends[1], model=mb.Recursive())
    s.spherical("C", bodies[1], bodies[2], at=ends[2])
    return s


def free_by_a_joint() -> mb.Scene:
    s, a, b = two()
    s.joint(mb.Free, "F", s.ground, a, at=(0.2, 0.1, 0.3), axis=(0, 0, 1), axis_x=(1, 0, 0),
            start={"x": 0.2, "z": -0.3}, start_rate={"y": 0.4})
    s.revolute("A", a, b, at=(0.3, 0, 0), axis=(0, 0, 1), angle0=0.6, rate0=1.1)
    return s


def free_between_bodies() -> mb.Scene:
    """A free joint of l on k, with axes and a point of its own, a spring and dampers along and about its axes."""
    s, a, b = two()
    s.revolute("A", s.ground, a, at=(0, 0, 0), axis=(0, 0, 1), angle0=0.6, rate0=1.1)
    s.joint(mb.Free, "F", a, b, at=(0.3, 0, 0), axis=(1, 2, 2), start={"x": 0.2, "z": -0.3}, start_rate={"y": 0.4},
            spring={"y": 30.0}, damper={"z": 2.0})
    s.bushing("all alike", a, b, at=(0.3, 0, 0), stiffness=(0,) * 6, damping=(0.7,) * 6)
    return s


def on_a_line() -> mb.Scene:
    s, a, b = two()
    s.revolute("A", s.ground, a, at=(0, 0, 0), axis=(0, 0, 1), rate0=1.1)
    s.point_on_line("L", a, b, at=(0.3, 0, 0), axis=(1, 2, 2), start={"displacement": 0.1}, spring=20.0, damper=0.5)
    s.bushing("turning", a, b, at=(0, 0, 0), stiffness=(0,) * 6, damping=(0, 0, 0, 0.2, 0.2, 0.2))
    return s


def on_a_plane() -> mb.Scene:
    s, a, b = two()
    s.point_on_plane("E", s.ground, a, at=(0.3, 0, 0), axis=(1, 2, 2), start={"x": 0.1}, start_rate={"y": 0.4}, rotor={"x": 0.3})
    s.revolute("A", a, b, at=(0.3, 0.1, 0), axis=(0, 0, 1), rate0=1.1)
    return s


def without_mass_between() -> mb.Scene:
    """A slide, a hinge that is coupled with another one, and a ball, with bodies without mass between them."""
    s, a, b = two()
    one, other = (s.rigid_body(name, 0.0, np.zeros((3, 3)), at=(0.1, 0, 0)) for name in ("one", "other"))
    s.prismatic("slide", s.ground, one, at=(0, 0, 0), axis=(1, 2, 3), spring=5.0, model=mb.Recursive(), position0=0.2)
    s.revolute("hinge", one, other, at=(0.1, 0, 0), axis=(0, 1, 0), model=mb.Recursive(), damper=0.3, rate0=0.4)
    s.spherical("ball", other, a, at=(0.2, 0, 0), model=mb.Recursive())
    s.bushing("turning", other, a, at=(0, 0, 0), stiffness=(0,) * 6, damping=(0, 0, 0, 0.2, 0.2, 0.2))
    s.revolute("B", a, b, at=(0.3, 0.1, 0), axis=(0, 0, 1), model=mb.Recursive())
    return s


def thrown() -> mb.Scene:
    s = mb.Scene("thrown", gravity=SPACE)
    R = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]) @ np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]])
    a = s.rigid_body("a", 1.0, FULL, at=(0.2, 0.1, 0.3), rotation=R, velocity=(1, 2, 3), angular_velocity=(3, 1, -2))
    b = s.rigid_body("b", 1.0, FULL, at=(0.5, 0.3, 0.1))
    s.universal("U", a, b, at=(0.3, 0.2, 0.1), axis=(1, 2, 3))
    return s


def thrown_on_joints() -> mb.Scene:
    """Velocities of bodies that a ball and a hinge carry."""
    s = mb.Scene("mixed", gravity=SPACE)
    w, v = np.array([1.0, 0.5, 0.2]), np.array([0.0, 0.0, 2.0])
    one = s.rigid_body("one", 2.0, FULL, at=(0, 0, -0.5), angular_velocity=w, velocity=np.cross(w, (0, 0, -0.5)))
    s.spherical("ball", s.ground, one, at=(0, 0, 0))
    two = s.rigid_body("two", 1.0, FULL, at=(3.5, 0, 0), angular_velocity=v, velocity=np.cross(v, (0.5, 0, 0)))
    s.revolute("hinge", s.ground, two, at=(3, 0, 0), axis=(0, 0, 1))
    return s


STARTS: dict[str, Callable[[], mb.Scene]] = {
    "couple": coupled, "rack": of_a_rack, "couple with a value": with_a_value, "gear": geared,
    "chain of couplings": follower_stated, "loop, crank": lambda: closed("A"), "loop, rocker": lambda: closed("D"), 
    "loop as drawn": lambda: closed(""), "free joint": free_by_a_joint, "free joint between bodies": free_between_bodies,
    "point on a line": on_a_line, "point on a plane": on_a_plane, "bodies without mass": without_mass_between,
    "thrown": thrown, "thrown on joints": thrown_on_joints}


def in_mujoco(s: mb.Scene, folder: Path) -> tuple[Any, Any, tuple[str, ...]]:
    """The model that a scene is written as, its data at the start, and what the file says otherwise."""
    told = s.write_mjcf(folder / "out.xml")
    model = mujoco.MjModel.from_xml_path(str(folder / "out.xml"))
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data, told


def motion(model: Any, data: Any, body: int) -> Any:
    """Place of the centre, velocity and angular velocity of a body, inertial axes."""
    turning = np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, turning, 0)
    w, x = turning[:3], data.xipos[body]
    return np.concatenate([x, turning[3:] + np.cross(w, x - data.xpos[body]), w])


def beside(r: Any, model: Any, data: Any, at: int) -> float:
    """Largest difference between the bodies of a result at one of its times and those of MuJoCo, m, m/s, rad/s."""
    off = []
    for i in range(1, model.nbody):
        b = r[model.body(i).name]
        off.append(motion(model, data, i) - np.concatenate([x[at] for x in (b.position, b.velocity, b.angular_velocity)]))
    return float(np.max(np.abs(off)))


def run_beside(s: mb.Scene, folder: Path, t_end: float = 0.2, step: float = 1e-3) -> float:
    """Largest difference between the end of a run and that of MuJoCo by RK4, from the key frame."""
    model, data, _ = in_mujoco(s, folder)
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, step
    mujoco.mj_step(model, data, nstep=round(t_end / step))
    mujoco.mj_fwdPosition(model, data)
    return beside(s.simulate(t_end, accuracy=1e-8), model, data, -1)


@pytest.mark.parametrize("scene", STARTS)
def test_the_key_frame_is_the_start_of_the_run(tmp_path: Path, scene: str) -> None:
    s = STARTS[scene]()
    model, data, told = in_mujoco(s, tmp_path)
    r = s.simulate(1e-3, outputs=[0.0, 1e-3])
    assert beside(r, model, data, 0) < 1e-9
    assert np.max(np.abs(data.efc_pos), initial=0.0) < 1e-9
    assert np.max(np.abs(data.efc_vel), initial=0.0) < 1e-9
    assert ("the start is the key frame 'start'" in told) is bool(model.nkey) is (scene != "loop as drawn")


@pytest.mark.parametrize("scene", [
    "free joint", "free joint between bodies", "point on a line", "point on a plane", "bodies without mass", "thrown",
    "thrown on joints"])
def test_trees_move_in_mujoco_as_in_the_scene(tmp_path: Path, scene: str) -> None:
    assert run_beside(STARTS[scene](), tmp_path) < 1e-6


def test_a_hinge_behind_a_ball_needs_a_body_between_them(tmp_path: Path) -> None:
    s, a, _ = two()
    empty = s.rigid_body("empty", 0.0, np.zeros((3, 3)), at=(0.1, 0, 0))
    s.spherical("ball", s.ground, empty, at=(0, 0, 0), model=mb.Recursive())
    s.revolute("hinge", empty, a, at=(0.1, 0, 0), axis=(0, 1, 0), model=mb.Recursive())
    with pytest.raises(mb.SceneError, match=r"'hinge'.* 'empty' mass and inertia"):
        s.write_mjcf(tmp_path / "out.xml")


def test_names_that_are_taken_are_made_new_and_told(tmp_path: Path) -> None:
    """A joint, a body, a frame and a joint of a loop have the names that coordinates and parts of other joints would get."""
    s, a, b = two()
    s.universal("u", s.ground, a, at=(0, 0, 0), axis=(1, 0, 0))
    s.revolute("u angle_k", a, b, at=(0.3, 0, 0), axis=(0, 1, 0))
    c = s.rigid_body("u angle_l", 1.0, FULL, at=(1, 1, 1))
    s.cylindrical("d", b, c, at=(0.5, 1, 0), axis=(1, 0, 0))
    s.frame("d angle", c)
    _, _, told = in_mujoco(s, tmp_path)
    assert sum("something else is called" in text for text in told) == 3
    assert mb.read_mjcf(tmp_path / "out.xml").tree().nv == s.tree().nv
    assert run_beside(s, tmp_path) < 1e-6


def test_a_coupling_of_one_coordinate_is_written(tmp_path: Path) -> None:
    s = hinge_and_slide(rate0=1.0)
    s.couple("held", of={"P": -2.0}, value=0.3)
    model, data, _ = in_mujoco(s, tmp_path)
    assert (model.neq, data.qpos[1]) == (1, pytest.approx(-0.15))
    assert beside(s.simulate(1e-3, outputs=[0.0, 1e-3]), model, data, 0) < 1e-9
    assert np.max(np.abs(data.efc_pos)) < 1e-9
    again = mb.read_mjcf(tmp_path / "out.xml", key="start").simulate(0.1)
    assert again["P"].displacement == pytest.approx(-0.15, abs=1e-6)


@pytest.mark.parametrize(("more", "said"), [
    ({"spring": 2.0, "damper": 0.1}, "a spring, a damper"), ({"prescribed": {"angle": 0.1 * mb.t}}, "a prescribed motion"),
    ({"rotor": 0.3}, "a rotor"), ({"limits": (-1, 1), "stop": mb.Stop(1e3)}, "limits")])
def test_a_hinge_with_more_does_not_close_a_loop_and_why_is_said(tmp_path: Path, more: dict[str, Any], said: str) -> None:
    s = mb.Scene("bars", gravity=SPACE)
    points = [(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0)]
    bars = [s.rigid_body(f"b{i}", 1.0, FULL, at=tuple((np.array(p) + q) / 2)) for i, (p, q) in enumerate(pairwise(points))]
    for name, k, l, at in zip("ABC", (s.ground, *bars), bars, points, strict=False):
        s.revolute(name, k, l, at=at, axis=(0, 1, 0), model=mb.Recursive())
    s.joint(mb.Revolute, "D", s.ground, bars[2], at=points[3], axis=(0, 1, 0), **more)
    with pytest.raises(mb.SceneError, match=rf"'D'.* without {said}"):
        s.write_mjcf(tmp_path / "out.xml")


def four_bar() -> mb.Scene:
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    points = [(0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)]
    links = [s.link(f"link{i}", points[i], points[i + 1], mass=0.5) for i in range(3)]
    for i, (name, k, l) in enumerate(zip("ABCD", (s.ground, *links), (*links, s.ground), strict=True)):
        s.revolute(name, k, l, at=points[i], **({"rate0": 1.0} if name == "A" else {}))
    return s


def planar_pair() -> mb.Scene:
    """A rod on a hinge and a body that floats in the plane, both with one moment of inertia."""
    s = mb.Scene("pair", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), rate0=1.0)
    s.rigid_body("free", 1.0, 0.02, at=(2, 0, 0), velocity=(1, 2, 0), angular_velocity=(0, 0, 3))
    return s


def test_planar_scenes_of_rods_move_in_mujoco_as_in_the_scene(tmp_path: Path) -> None:
    assert run_beside(planar_pair(), tmp_path) < 1e-6
    assert any("inertia that MuJoCo asks for" in text for text in planar_pair().write_mjcf(tmp_path / "out.xml"))
    s = four_bar()
    model, data, _ = in_mujoco(s, tmp_path)
    assert beside(s.simulate(1e-3, outputs=[0.0, 1e-3]), model, data, 0) < 1e-9


def test_thin_rods_in_space_are_written(tmp_path: Path) -> None:
    s = mb.Scene("rods", gravity=SPACE)
    rod = s.link("rod", (0, 0, 0), (0.5, 0, 0.2), mass=1.0)
    s.universal("U", s.ground, rod, at=(0, 0, 0), axis=(0, 1, 0))
    s.revolute("H", rod, s.rigid_body("b", 1.0, FULL, at=(0.7, 0, 0)), at=(0.5, 0, 0.2), axis=(0, 1, 0))
    assert run_beside(s, tmp_path) < 1e-6
