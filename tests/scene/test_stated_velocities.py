"""Velocities stated of bodies: kept to round-off wherever the joints allow them, told where they do not."""

from __future__ import annotations

import numpy as np
import pytest

import mbdae as mb
from mbdae.system.prepare import Prepared, prepare

MODELS = (mb.Kinematic(), mb.Classical(), mb.Recursive())
ROUND_OFF = 1e-13  #: relative; sums of a dozen terms


def velocity(p: Prepared, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Velocity (3,) of the centre of mass and angular velocity (3,) of a body at the start, bodies drawn along the axes."""
    node = next(n for n, body in p.model.bodies if body.name == name)
    n, u = node.kind.translations, p.start.u[node.u : node.u + node.kind.sizes[1]]
    v, w = np.zeros(3), np.zeros(3)
    v[:n], w[3 - len(u) + n :] = u[:n], u[n:]
    return v, w


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("name", ["revolute", "prismatic"])
@pytest.mark.parametrize("inertia", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("space", ["auto", "spatial"])
@pytest.mark.parametrize("model", MODELS)
def test_one_joint(model: mb.JointModel, space: str, inertia: float, name: str, swapped: bool) -> None:
    """A body that turns or slides as its joint lets it keeps its velocity, and the joint's coordinate has that rate."""
    turns = name == "revolute"
    s = mb.Scene("one joint", space=space)
    given = {"angular_velocity": (0, 0, 5.0), "velocity": (0, 2.5, 0)} if turns else {"velocity": (5.0, 0, 0)}
    b = s.rigid_body("b", inertia, (inertia, inertia, inertia), at=(0.5, 0, 0), **given)  # type: ignore[arg-type]
    ends = (b, s.ground) if swapped else (s.ground, b)
    if turns:
        s.revolute("c", *ends, at=(0, 0, 0), model=model)
    else:
        s.prismatic("c", *ends, at=(0, 0, 0), axis=(1, 0, 0), model=model)
    p = prepare(s)
    v, w = velocity(p, "b")
    np.testing.assert_allclose(v, given["velocity"], atol=5 * ROUND_OFF)
    np.testing.assert_allclose(w, given.get("angular_velocity", (0, 0, 0)), atol=5 * ROUND_OFF)
    assert p.start.changes == []
    if p.model.joint_coordinates:
        assert p.start.u[p.model.joint_coordinates[0].u] == pytest.approx(-5.0 if swapped else 5.0, rel=ROUND_OFF)


def test_default_run_turns_by_rate_times_time() -> None:
    s = mb.Scene("spin")
    b = s.rigid_body("b", 1.0, (1, 1, 1), angular_velocity=(0, 0, 5.0))
    s.revolute("c", s.ground, b, at=(0, 0, 0))
    assert s.simulate(2.0, accuracy=1e-8)["c"].angle[-1] == pytest.approx(10.0, rel=1e-10)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("tip", [1e-8, 1.0, 1e8])
def test_bodies_in_between_follow(model: mb.JointModel, tip: float) -> None:
    """Only the last body of a chain has a stated velocity: the others move as that asks for, heavy or light."""
    s = mb.Scene("chain")
    for i, mass in enumerate((1.0, 2.0, tip)):
        given = {"velocity": (0.3, 1.5, 0), "angular_velocity": (0, 0, -2.0)} if i == 2 else {}
        s.rigid_body(f"b{i}", mass, (mass, mass, mass), at=(i + 0.5, 0, 0), rotation=np.eye(3), **given)  # type: ignore[arg-type]
    s.prismatic("slide", s.ground, "b0", at=(0, 0, 0), axis=(1, 0, 0), model=model)
    s.revolute("A", "b0", "b1", at=(1, 0, 0), model=model)
    s.revolute("B", "b1", "b2", at=(2, 0, 0), model=model)
    p = prepare(s)
    v, w = velocity(p, "b2")
    np.testing.assert_allclose(v, (0.3, 1.5, 0), atol=1e-11)  # masses differ by 1e8
    np.testing.assert_allclose(w, (0, 0, -2.0), atol=1e-11)
    np.testing.assert_allclose(velocity(p, "b1")[1], (0, 0, 2.5), atol=1e-11)  # B moves by 1.5 + 2 / 2 m/s, 1 m from A
    assert p.start.changes == []


@pytest.mark.parametrize("space", ["auto", "spatial"])
@pytest.mark.parametrize("model", MODELS)
def test_loop_moves_by_one_stated_rate(space: str, model: mb.JointModel) -> None:
    """A parallelogram of which one rocker is stated to turn: both rockers turn alike, the coupler does not."""
    s = mb.Scene("parallelogram", space=space)
    s.link("crank", (0, 0), (0, 1), mass=0.01)
    s.link("coupler", (0, 1), (2, 1), mass=50.0)
    s.rigid_body("rocker", 1.0, (0.1, 0.1, 0.1), at=(2, 0.5, 0), angular_velocity=(0, 0, 3.0))
    s.revolute("A", s.ground, "crank", at=(0, 0), model=model)
    s.revolute("B", "crank", "coupler", at=(0, 1), model=model)
    s.revolute("C", "coupler", "rocker", at=(2, 1))
    s.revolute("D", s.ground, "rocker", at=(2, 0))
    p = prepare(s)
    assert p.start.changes == []
    rates = [velocity(p, name)[1][2] for name in ("crank", "coupler", "rocker")]
    np.testing.assert_allclose(rates, (3, 0, 3), atol=1e-12)
    np.testing.assert_allclose(velocity(p, "rocker")[0], (-1.5, 0, 0), atol=1e-12)


def test_beam_and_what_hangs_on_it() -> None:
    """A beam stated to turn about its hinge does so at every node; a body recursive on it turns with it."""
    steel = mb.Section.circular(0.01, E=2e11, nu=0.3, rho=7800)
    s = mb.Scene("beam")
    s.beam("beam", (0, 0), (1, 0), section=steel, elements=3, velocity=(0, 2.0, 0), angular_velocity=(0, 0, 4.0))
    s.rigid_body("tip", 1e-6, (1e-9, 1e-9, 1e-9), at=(1.5, 0, 0), velocity=(0, 5.0, 0), angular_velocity=(0, 0, 2.0))
    s.revolute("A", s.ground, "beam", at=(0, 0))
    s.revolute("B", "beam", "tip", at=(1, 0), model=mb.Classical())
    p = prepare(s)
    assert p.start.changes == []
    for node, body in p.model.bodies:
        wanted = [0, 5.0, 2.0] if body.name == "tip" else [0, 4 * node.position(p.start.q)[0], 4.0]
        np.testing.assert_allclose(p.start.u[node.u : node.u + 3], wanted, atol=1e-11)
    assert p.start.u[p.model.joint_coordinates[0].u] == pytest.approx(-2.0, abs=1e-11)


@pytest.mark.parametrize("speed", [1e-9, 1.0, 1e6])
@pytest.mark.parametrize("model", MODELS)
def test_what_contradicts_is_told_and_the_rest_stays(speed: float, model: mb.JointModel) -> None:
    """One body is stated to move along its pendulum, another one as it may: only the first changes, by all of it."""
    s = mb.Scene("two pendulums")
    s.rigid_body("wrong", 1.0, 1.0, at=(1, 0), velocity=(speed, 0, 0))
    s.rigid_body("right", 1.0, 1.0, at=(3, 0), velocity=(0, speed, 0))
    s.revolute("A", s.ground, "wrong", at=(0, 0), model=model)
    s.revolute("B", s.ground, "right", at=(2, 0), model=model)
    p = prepare(s)
    assert p.start.changes == [f"the given velocity of 'wrong' contradicts the joints and was changed by {speed:.4g} m/s and 0 "
                               f"rad/s to fit them"]
    np.testing.assert_allclose(velocity(p, "right"), ([0, speed, 0], [0, 0, speed]), atol=speed * ROUND_OFF)
    np.testing.assert_allclose(velocity(p, "wrong"), np.zeros((2, 3)), atol=speed * ROUND_OFF)


@pytest.mark.parametrize("model", MODELS)
def test_contradiction_is_settled_alike_in_every_model(model: mb.JointModel) -> None:
    """Nearest in kinetic energy: of (v_y, w) = (1, 0) with v_y = w a body of m = J = 1 keeps half, whatever its joint's model."""
    s = mb.Scene("pendulum")
    s.rigid_body("bob", 1.0, 1.0, at=(1, 0), velocity=(1, 1, 0))
    s.revolute("A", s.ground, "bob", at=(0, 0), model=model)
    assert prepare(s).start.u[:3] == pytest.approx([0, 0.5, 0.5], abs=2e-7)  # a millionth of the mass regularises the metric
