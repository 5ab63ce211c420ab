"""What check says: redundancy by joint and direction, the planar proof, freedoms, pruned rows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mbdae as mb


def four_bar(space: str = "auto", axis: Any = (0, 0, 1)) -> mb.Scene:
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0), space=space)
    s.link("crank", (0, 0), (0, 0.3), mass=0.3)
    s.link("coupler", (0, 0.3), (0.5, 0.6), mass=0.4)
    s.link("rocker", (0.5, 0.6), (0.6, 0), mass=0.5)
    s.revolute("A", s.ground, "crank", at=(0, 0))
    s.revolute("B", "crank", "coupler", at=(0, 0.3), axis=axis)
    s.revolute("C", "coupler", "rocker", at=(0.5, 0.6))
    s.revolute("D", "rocker", s.ground, at=(0.6, 0))
    return s


def test_four_revolutes_in_space_are_redundant_at_the_last_joint() -> None:
    c = four_bar("spatial").check()
    assert not c.planar
    assert c.degrees_of_freedom == 1
    assert sorted(c.redundant) == ["D.tilt_x", "D.tilt_y", "D.z"]
    assert "left out because they follow from the others: D (z, tilt_y, tilt_x)" in str(c)
    assert "reactions not unique: A, B, C, D (z, tilt_y, tilt_x)" in str(c)
    assert c.unknowns["multipliers"] == 17


def test_the_same_loop_in_the_plane_is_not() -> None:
    c = four_bar().check()
    assert c.planar
    assert c.degrees_of_freedom == 1
    assert c.redundant == ()
    assert "D.tilt_x" in c.pruned
    assert "planar: every point, axis, velocity and load lies in the plane z = 0 and no law leaves it" in str(c)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda s: s.point_mass("p", 1.0, (0, 0, 0.1)), "body 'p' has a point at z = 0.1 m"),
        (lambda s: s.rigid_body("p", 1.0, [[1, 0, 0.1], [0, 1, 0], [0.1, 0, 1]]), "body 'p' has products of inertia with z"),
        (lambda s: s.point_mass("p", 1.0, (0, 0), velocity=(0, 0, 1)), "body 'p' starts with a velocity out of the plane"),
        (lambda s: s.rigid_body("p", 1, 1, rotation=[[1, 0, 0], [0, 0, -1], [0, 1, 0]]), "body 'p' is rotated out of the plane"),
        (lambda s: s.spring("S", "crank", "rocker", (0, 0), (0.6, 0, 0.2), stiffness=1.0), "spring 'S' has a point at z = 0.2 m"),
        (lambda s: s.force("F", "crank", (0, 0, 1.0)), "'F': AppliedForce is not planar: its force acts out of the plane"),
        (lambda s: s.torque("T", "crank", (1.0, 0, 0)), "'T': AppliedTorque is not planar: its force acts out of the plane"),
        (lambda s: s.revolute("E", s.ground, "crank", at=(0, 0), axis=(1, 0, 1)), "is neither in the plane nor normal to it"),
        (lambda s: setattr(s, "gravity", np.array([0, 0, 1.0])), "gravity has the z component 1 m/s^2"),
    ],
)
def test_why_a_scene_is_not_planar(change: Any, reason: str) -> None:
    from mbdae.system.model.model import build

    s = four_bar()
    change(s)
    model = build(s)
    assert not model.planar
    assert reason in model.why
    s.space = "planar"
    with pytest.raises(mb.SceneError, match="space='planar' is not possible"):
        build(s)


def test_axis_in_the_plane_makes_a_scene_spatial() -> None:
    from mbdae.system.model.model import build

    model = build(four_bar(axis=(1, 0, 0)))
    assert not model.planar
    assert "B" in model.why


def test_prismatic_joint_stays_planar() -> None:
    s = mb.Scene("slider", gravity=(0, -9.81, 0))
    s.rigid_body("block", 1.0, 0.0, at=(1, 0))
    s.prismatic("P", s.ground, "block", at=(0, 0), axis=(1, 0, 0))
    c = s.check()
    assert c.planar
    assert c.degrees_of_freedom == 1
    assert set(c.pruned) == {"P.offset_x", "P.tilt_y", "P.twist"}


def test_the_naive_formulation_has_every_joint_classical_that_can_be() -> None:
    """A spherical joint has no angles that describe it everywhere and stays as it is, beside a hinge with an angle as unknown."""
    s = mb.Scene("pair", gravity=(0, 0, -9.81))
    a = s.rigid_body("a", 1.0, (0.02, 0.09, 0.08), at=(0.5, 0, 0))
    b = s.rigid_body("b", 0.7, (0.03, 0.07, 0.06), at=(1.5, 0.1, 0))
    s.spherical("A", s.ground, a, at=(0, 0, 0))
    s.revolute("B", a, b, at=(1, 0, 0), axis=(0, 1, 1))
    naive, stated = s.check().reductions[:2]
    assert naive.reason.startswith("all equations in space, with classical joints")
    assert naive.size.multipliers == stated.size.multipliers + 2  # a row more at the hinge, of positions and of velocities


def test_joints_beside_their_links_are_named():
    """A coordinate typed as 0.03 for 0.3 moves no body: the joint holds both links at a point beside them."""

    def loop(at):
        s = mb.Scene("loop")
        a, b = s.link("a", (0, 0), (0.3, 0.4), mass=1.0), s.link("b", (0.3, 0.4), (1, 0.4), mass=1.0)
        s.revolute("A", s.ground, a, at=(0, 0))
        s.revolute("B", a, b, at=at)
        return s.check()

    assert loop((0.3, 0.4)).off_links == loop((0.3, 0.4001)).off_links == {}
    found = loop((0.03, 0.4))
    assert found.off_links == {"B": {"a": pytest.approx(0.216), "b": pytest.approx(0.27)}}
    assert "joint 'B': its point is 0.27 m beside the link 'b'" in str(found)


def test_bodies_that_no_joint_holds_are_named():
    s = mb.Scene("forgotten")
    a, b, c, d = (s.link(name, (i, 0), (i + 1, 0), mass=1.0) for i, name in enumerate("abcd"))
    s.revolute("A", s.ground, a, at=(0, 0))
    s.revolute("B", a, b, at=(1, 0))
    s.revolute("D", c, d, at=(3, 0))
    assert s.check().not_joined == ("c", "d")
    assert "not joined to the ground: c, d" in str(s.check())
    s.revolute("C", b, c, at=(2, 0))
    assert s.check().not_joined == ()


def test_joints_of_the_same_kind_are_listed_together():
    """Up to twelve by name, then their number; one of another kind is told by itself."""
    s = mb.Scene("pendulums", gravity=(0, -9.81, 0))
    for i in range(20):
        rod = s.link(f"rod {i}", (2 * i, 0), (2 * i + 1, 0), mass=1.0)
        play = mb.Clearance(outer=0.011 + 0.001 * (i == 19), inner=0.01, normal=mb.Hertz(1e9, 0.1))
        s.revolute(f"J{i}", s.ground, rod, at=(2 * i, 0), model=play)
    lines = str(s.check()).splitlines()
    (same, other) = (line for line in lines if line.startswith("  contact"))
    assert "'J11', ... (19 in all) with 0.001 m play" in same
    assert other.startswith("  contact: 'J19' with 0.002 m play")
    (left_out,) = (line for line in lines if "left out" in line)
    assert left_out.endswith("J10, J11, ... (20 in all) (axial, tilt_y, tilt_x)")
    assert len(s.check().contacts) == 20
