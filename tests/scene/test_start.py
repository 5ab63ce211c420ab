"""Consistent starts: what is held stays, loops close with the least change, everything else starts at relative rest."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
import sympy as sp

import mbdae as mb
from mbdae.system.prepare import Prepared, prepare

A, B, C, D = (0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)


def four_bar(space: str = "auto", **crank: object) -> mb.Scene:
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0), space=space)
    s.link("crank", A, B, mass=0.3)
    s.link("coupler", B, C, mass=0.4)
    s.link("rocker", C, D, mass=0.5)
    s.revolute("A", s.ground, "crank", at=A, **crank)  # type: ignore[arg-type]
    s.revolute("B", "crank", "coupler", at=B)
    s.revolute("C", "coupler", "rocker", at=C)
    s.revolute("D", "rocker", s.ground, at=D)
    return s


def coordinate(p: Prepared, joint: str) -> tuple[float, float]:
    """Value and rate of a joint coordinate at the start."""
    from mbdae.system.start import Starter

    starter = Starter(p.mechanics)
    item = p.model.scene[joint]
    value, rate, _ = starter._coordinates(p.start.q, p.start.u, [(item, item.coordinates[0], 0.0)])
    return float(value[0]), float(rate[0])


def violation(p: Prepared) -> float:
    t, q, u = np.zeros(1), p.start.q[None], p.start.u[None]
    m = p.mechanics
    a = m.constraint_jacobian(t, q)[0] @ p.start.acceleration + m.acceleration_bias(t, q, u)[0]
    g, gd = m.position_residual(t, q)[0], m.velocity_residual(t, q, u)[0]
    return float(np.max(np.abs(np.r_[g, gd, a / (1 + np.max(np.abs(p.start.acceleration)))])))


@pytest.mark.parametrize("space", ["auto", "spatial"])
@pytest.mark.parametrize(
    ("crank", "angle", "rate"),
    [({"angle0": 0.4}, 0.4, 0.0), ({"angle0": 0.4, "rate0": -2.0}, 0.4, -2.0), ({"rate0": 3.0}, 0.0, 3.0),
     ({"angle": 0.2 + 5 * mb.t}, 0.2, 5.0), ({"angle": sp.sin(3 * mb.t)}, 0.0, 3.0)],
)
def test_what_is_held_stays(space: str, crank: dict[str, object], angle: float, rate: float) -> None:
    p = prepare(four_bar(space, **crank))
    assert coordinate(p, "A") == pytest.approx((angle, rate), abs=1e-11)
    assert violation(p) < 1e-10


def test_angle_beyond_pi_keeps_its_turns() -> None:
    s = mb.Scene("rod", gravity=(0, -9.81, 0))
    s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("A", s.ground, "rod", at=(0, 0), angle0=7.0, spring=2.0)
    assert coordinate(prepare(s), "A")[0] == pytest.approx(7.0, abs=1e-12)
    for space in ("auto", "spatial"):
        s.space = space
        r = s.simulate(0.05, accuracy=1e-4, outputs=3)
        assert r["A"].angle[0] == pytest.approx(7.0, abs=1e-9)
        assert r.energy.potential[0] == pytest.approx(2 * 7.0**2 / 2 + 9.81 * 0.5 * np.sin(7.0), rel=1e-9)


def test_spring_of_many_turns_in_space() -> None:
    """phi = a sin(w t) with a = 10 rad: the state that follows the angle picks the right turn."""
    s = mb.Scene("torsion", space="spatial")
    s.rigid_body("rotor", 1.0, (1.0, 1.0, 0.5), at=(0, 0, 0))
    s.revolute("A", s.ground, "rotor", at=(0, 0, 0), spring=2.0, rate0=20.0)
    r = s.simulate(3.0, accuracy=1e-5, outputs=61)
    assert np.max(np.abs(r["A"].angle - 10 * np.sin(2 * r.t))) < 1e-4
    assert np.max(np.abs(r["A"].angle)) > 9.9
    assert np.max(np.abs(r.energy.balance)) < 1e-3 * r.energy.kinetic[0]


def test_what_closes_a_loop_is_told_in_one_line() -> None:
    """The held joint keeps its value, so the other one gives way."""
    s = mb.Scene("open loop")
    s.link("heavy", (0, 0), (1, 0), mass=100.0)
    s.link("light", (1.0, 0), (2, 0.02), mass=0.1)
    s.revolute("A", s.ground, "heavy", at=(0, 0), angle0=0.3)
    s.revolute("B", "heavy", "light", at=(1, 0))
    s.distance("C", "light", s.ground, (2, 0.02), (2, 1.0))
    p = prepare(s)
    assert coordinate(p, "A")[0] == pytest.approx(0.3, abs=1e-11)
    assert violation(p) < 1e-10
    (told,) = p.start.changes
    found = re.fullmatch(r"to close the loops joint 'B' leaves its drawn place by (\S+) rad, body 'light' by (\S+) m", told)
    assert found is not None
    turned, moved = coordinate(p, "B")[0], np.linalg.norm(p.start.q[3:5] - [1.5, 0.01])
    assert [float(x) for x in found.groups()] == pytest.approx([abs(turned), moved], rel=5e-3)


def test_free_loop_moves_light_bodies_more_than_heavy_ones() -> None:
    s = mb.Scene("two rods")
    s.point_mass("heavy", 99.0, (0, 0))
    s.point_mass("light", 1.0, (1, 0))
    joint = s.distance("rod", "heavy", "light", (0, 0), (1, 0))
    joint.laws[0].length = 2.0
    q = prepare(s).start.q
    assert q[[0, 2]] == pytest.approx([-0.01, 1.99], abs=2e-6)  # the metric adds a millionth of the largest mass


def test_relative_rest_elsewhere() -> None:
    s = mb.Scene("arm")
    s.link("upper", (0, 0), (1, 0), mass=1.0)
    s.link("lower", (1, 0), (2, 0), mass=1.0)
    s.revolute("A", s.ground, "upper", at=(0, 0), rate0=2.0)
    s.revolute("B", "upper", "lower", at=(1, 0))
    p = prepare(s)
    assert coordinate(p, "A")[1] == pytest.approx(2.0, abs=1e-12)
    assert coordinate(p, "B")[1] == pytest.approx(0.0, abs=1e-12)
    assert p.start.u == pytest.approx([0, 1, 2, 0, 3, 2], abs=1e-12)


def test_contradicting_velocity_is_projected_and_reported() -> None:
    s = mb.Scene("pendulum")
    s.rigid_body("bob", 1.0, 1.0, at=(1, 0), velocity=(1, 1, 0))
    s.revolute("A", s.ground, "bob", at=(0, 0))
    start = prepare(s).start
    assert start.u == pytest.approx([0, 0.5, 0.5], abs=1e-6)  # nearest in kinetic energy to (1, 1, 0)
    assert start.changes == ["the given velocity of 'bob' contradicts the joints and was changed by 1.118 m/s and 0.5 "
                             "rad/s to fit them"]


def test_consistent_velocity_is_left_alone() -> None:
    s = mb.Scene("pendulum")
    s.rigid_body("bob", 1.0, 1.0, at=(1, 0), velocity=(0, 2, 0), angular_velocity=(0, 0, 2))
    s.revolute("A", s.ground, "bob", at=(0, 0))
    start = prepare(s).start
    assert start.u == pytest.approx([0, 2, 2], abs=1e-12)
    assert start.changes == []


def test_loop_that_cannot_close_says_where_and_by_how_much() -> None:
    s = mb.Scene("too far")
    s.link("a", (0, 0), (1, 0), mass=1)
    s.link("b", (1, 0), (3, 0), mass=1)
    s.revolute("A", s.ground, "a", at=(0, 0), angle0=3.0)
    s.revolute("B", "a", "b", at=(1, 0))
    s.revolute("C", "b", s.ground, at=(3, 0))
    with pytest.raises(mb.StartError, match=r"'C' cannot close: row C\.\w stays off by \d.* m; angle of 'A' starts at 3 rad"):
        s.check()


def test_held_value_out_of_reach() -> None:
    s = mb.Scene("toggle")
    s.link("a", (0, 0), (1, 0), mass=1)
    s.link("b", (1, 0), (2, 0), mass=1)
    s.revolute("A", s.ground, "a", at=(0, 0), angle0=1.5)
    s.revolute("B", "a", "b", at=(1, 0))
    s.revolute("C", "b", s.ground, at=(2, 0))
    with pytest.raises(mb.StartError, match=r"'A'|joint 'C' cannot close"):
        s.check()


def test_spurious_branch_is_refused() -> None:
    """Drawn upside down a revolute's rows hold as well; the start refuses it."""
    from mbdae.system.model.model import build
    from mbdae.system.model.nodes import turned
    from mbdae.system.model.numbering import constraint_rows
    from mbdae.system.motion.mechanics import Mechanics
    from mbdae.system.start import Starter

    s = mb.Scene("flipped", space="spatial")
    s.rigid_body("b", 1.0, (1, 1, 1), at=(0, 0, 0))
    s.revolute("A", s.ground, "b", at=(0, 0, 0))
    model = build(s)
    starter = Starter(Mechanics(model, constraint_rows(model)))
    q = starter.placed()
    q[3:] = turned(q[3:], np.array([np.pi, 0.0, 0.0]))
    assert np.max(np.abs(starter.mechanics.position_residual(np.zeros(1), q[None]))) < 1e-12
    with pytest.raises(mb.StartError, match=r"joint 'A' starts on the wrong branch, .* \(axes in the same sense: -1"):
        starter.check_branches(q)


def test_rows_that_contradict_although_redundant() -> None:
    """A slide that forbids turning and a drive that turns: same gradients, other rates."""
    s = mb.Scene("contradiction")
    s.link("a", (0, 0), (1, 0), mass=1)
    s.revolute("A", s.ground, "a", at=(0, 0), angle=mb.t)
    s.prismatic("P", s.ground, "a", at=(0, 0), axis=(1, 0, 0))
    with pytest.raises(mb.StartError, match=r"not allow the motion prescribed for 'A' .*: row P\.\w+ depends on the other"):
        s.check()


@pytest.mark.parametrize("t0", [0.0, 5.0])
def test_rows_that_contradict_later(t0: float) -> None:
    """t^4 has neither rate nor acceleration at the start; the slide forbids the turn all the same."""
    s = mb.Scene("contradiction")
    s.link("a", (0, 0), (1, 0), mass=1)
    s.revolute("A", s.ground, "a", at=(0, 0), angle=(mb.t - t0) ** 4)
    s.prismatic("P", s.ground, "a", at=(0, 0), axis=(1, 0, 0))
    with pytest.raises(mb.StartError, match=r"prescribed for 'A' .*: row P\.\w+ .* they leave it off by") as told:
        prepare(s, t0=t0, t_end=t0 + 2)
    assert t0 < float(re.search(r"at t = (\S+) s", str(told.value))[1]) < t0 + 2  # type: ignore[index]


@pytest.mark.parametrize(("crank", "named"), [({"rate0": 1.0}, "rate of A"), ({"angle": mb.t}, r"A\.drive")])
def test_rates_of_both_cranks_that_contradict_are_named(crank: dict[str, Any], named: str) -> None:
    """The loop closes with one rate alone, to a millionth of the speeds; what is named is the one that is missed most."""
    def scene(**rocker: float) -> mb.Scene:
        s = mb.Scene("four-bar")
        for name, a, b in (("crank", A, B), ("coupler", B, C), ("rocker", C, D)):
            s.link(name, a, b, mass=0.3)
        s.revolute("A", s.ground, "crank", at=A, **crank)
        s.revolute("D", "rocker", s.ground, at=D, **rocker)
        s.revolute("B", "crank", "coupler", at=B)
        s.revolute("C", "coupler", "rocker", at=C)
        return s

    fits = float(scene().simulate(1e-3)["D"].rate[0])
    assert scene(rate0=fits).check().degrees_of_freedom == (0 if "angle" in crank else 1)
    for wrong in (5.0, fits * (1 + 1e-6)):
        with pytest.raises(mb.StartError, match=f"contradict the joints: ({named}|rate of D) stays off"):
            scene(rate0=wrong).check()


def test_redundant_rows_with_a_drive_that_agrees() -> None:
    s = four_bar("spatial", angle=0.1 * sp.sin(mb.t))
    assert sorted(s.check().redundant) == ["D.tilt_x", "D.tilt_y", "D.z"]


def test_models_of_a_revolute_agree() -> None:
    """Accelerations and reactions of classical and kinematic joints, free and driven, with spring and damper."""
    s = mb.Scene("pair", gravity=(0, 0, -9.81))
    a = s.rigid_body("a", 1.0, (0.02, 0.09, 0.08), at=(0.5, 0, 0))
    b = s.rigid_body("b", 0.7, (0.03, 0.07, 0.06), at=(1.5, 0.1, 0))
    s.revolute("A", s.ground, a, at=(0, 0, 0), axis=(0, 1, 0), angle=0.3 * mb.t + 0.2)
    s.revolute("B", a, b, at=(1, 0, 0), axis=(0, 1, 1), angle0=7.0, rate0=2.0, spring=3.0, damper=0.4)
    kinematic, classical = prepare(s), prepare(s.replace(model=mb.Classical(scaling=50.0, penalty=2.0)))
    bodies = kinematic.mechanics.nu
    assert kinematic.rank.degrees_of_freedom == classical.rank.degrees_of_freedom == 1
    assert classical.mechanics.m == kinematic.mechanics.m + 2  # an unknown and a row more for every joint
    np.testing.assert_allclose(classical.start.acceleration[:bodies], kinematic.start.acceleration, rtol=1e-11, atol=1e-10)
    assert classical.start.q[-1] == pytest.approx(7.0, abs=1e-12)  # turns are counted by the unknown


def test_replace_changes_the_named_joints_only() -> None:
    s = four_bar()
    changed = s.replace("B", model=mb.Classical())
    assert [c.kept for c in changed.joints] == [False, True, False, False]
    s.revolute("E", "rocker", s["crank"], (0, 0), (0, 0, 1), mb.Kinematic(), None, 0.25)  # everything by position
    assert s.replace("E", model=mb.Classical())["E"].hold == {"angle": 0.25}
    with pytest.raises(mb.SceneError, match="names = 'X' is no joint with coordinates"):
        s.replace("X", model=mb.Classical())
    with pytest.raises(mb.SceneError, match="scaling = -1 is negative"):
        s.replace(model=mb.Classical(scaling=-1.0)).check()


def test_a_stated_value_that_the_loop_cannot_reach_is_named() -> None:
    """Of the loop that stays open; a value stated elsewhere is not."""
    s = mb.Scene("four-bar")
    for name, x, stated in (("", 0.0, {"angle0": 2.0}), ("far ", 9.0, {"angle0": 0.1})):
        A, B, C, D = (x, 0), (x, 0.5), (x + 0.4, 0.6), (x + 0.6, 0)
        ends = (("crank", A, B), ("coupler", B, C), ("rocker", C, D))
        crank, coupler, rocker = (s.link(name + n, p, q, mass=1.0) for n, p, q in ends)
        s.revolute(name + "A", s.ground, crank, at=A, **stated)
        s.revolute(name + "B", crank, coupler, at=B)
        s.revolute(name + "C", coupler, rocker, at=C)
        s.revolute(name + "D", s.ground, rocker, at=D)
    with pytest.raises(mb.StartError, match="angle of 'A' starts at 2 rad: the loop may not reach that") as told:
        s.check()
    assert "far" not in str(told.value)


def test_the_motions_that_contradict_are_named() -> None:
    """One that the joints do not allow, by its joint; two that contradict each other, both."""
    s = mb.Scene("wheels")
    for i in range(3):
        s.rigid_body(f"w{i}", 1.0, 0.1, at=(i, 0))
        s.revolute(f"J{i}", s.ground, f"w{i}", at=(i, 0), angle=mb.t if i == 0 else None)
        s.gear(f"g{i}", f"J{i}", f"J{(i + 1) % 3}", ratio=-1) if i == 2 else None
    s.gear("g0", "J0", "J1", ratio=-1)
    s.gear("g1", "J1", "J2", ratio=-1)
    with pytest.raises(mb.StartError, match="do not allow the motion prescribed for 'J0'"):
        s.check()
    two = mb.Scene("two")
    two.link("a", (0, 0), (1, 0), mass=1)
    for name, angle in (("A", mb.t), ("B", 2 * mb.t)):
        two.revolute(name, two.ground, "a", at=(0, 0), angle=angle)
    with pytest.raises(mb.StartError, match="the prescribed motions of 'A', 'B' contradict each other or the joints"):
        two.check()
