"""States at rest: closed forms, limit points, rotating frames, and what has no state at rest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

import mbdae as mb
from mbdae.analysis.statics import applied_loads
from mbdae.system.prepare import prepare

G = 9.81


@pytest.mark.parametrize("space", ["auto", "spatial"])
def test_hanging_spring_and_its_sensors(space: str) -> None:
    s = mb.Scene("spring", gravity=(0, -G, 0), space=space)
    cart = s.rigid_body("cart", 2.0, (1, 1, 1) if space == "spatial" else 1.0, at=(0, -1))
    s.prismatic("guide", s.ground, cart, at=(0, -1), axis=(0, 1, 0), spring=300.0)
    s.force("push", cart, (7, 0, 0))
    e = s.equilibrium()
    assert e["guide"].displacement == pytest.approx([-2 * G / 300], rel=1e-12)
    assert e["cart"].position[0] == pytest.approx([0, -1 - 2 * G / 300, 0])
    assert e["guide"].force[0] == pytest.approx([-7, 2 * G, 0])
    assert (e.load_factor, e.unstable, e.frame) == (1, 0, "ground")
    assert e.residual < 1e-12
    assert e.energy.kinetic[0] == 0
    assert "Equilibrium of 'spring'" in repr(e)


@pytest.mark.parametrize("space", ["auto", "spatial"])
@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical()])
@pytest.mark.parametrize("angle", [0.3, 1.5, 3.0])
def test_pendulum_falls_to_its_stable_position(space: str, model: Any, angle: float) -> None:
    s = mb.Scene("pendulum", gravity=(0, -G, 0), space=space)
    s.revolute("A", s.ground, s.link("rod", (0, 0), (0, -1), mass=2.0), at=(0, 0), angle0=angle, model=model)
    e = s.equilibrium()
    assert e["rod"].position[0] == pytest.approx([0, -0.5, 0], abs=1e-9)
    assert e["A"].force[0] == pytest.approx([0, 2 * G, 0], abs=1e-7)


@pytest.mark.parametrize("space", ["auto", "spatial"])
def test_preloaded_torsion_spring_holds_a_rod(space: str) -> None:
    """k angle = m g l sin(angle) / 2 with the spring relaxed upright; the run that starts there stays."""
    s = mb.Scene("rod", gravity=(0, -G, 0), space=space)
    s.revolute("A", s.ground, s.link("rod", (0, 0), (0, 1), mass=2.0), at=(0, 0), spring=6.0, angle0=1.0)
    e = s.equilibrium()
    expected = brentq(lambda a: 6 * a - G * np.sin(a), 0.5, 3, xtol=1e-14)
    assert e["A"].angle == pytest.approx([expected], rel=1e-10)
    r = s.simulate(1.0, start=e)
    assert r["A"].angle == pytest.approx(np.full(len(r.t), expected), abs=1e-6)


def test_wound_spring_unwinds_its_turns() -> None:
    s = mb.Scene("rod", space="spatial")
    s.revolute("A", s.ground, s.link("rod", (0, 0), (0, 1), mass=2.0), at=(0, 0), spring=6.0, torque=1.2, angle0=7.0)
    assert s.equilibrium()["A"].angle == pytest.approx([0.2], rel=1e-9)


def test_equilibrium_is_not_stored(tmp_path: Any) -> None:
    with pytest.raises(mb.OptionError, match="save a run that starts from it"):
        four_bar(5.0).equilibrium().save(tmp_path / "e.npz")


def four_bar(k: float) -> mb.Scene:
    s = mb.Scene("four-bar", gravity=(0, -G, 0))
    A, B, C, D = (0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)
    crank, coupler, rocker = s.link("crank", A, B, mass=0.3), s.link("coupler", B, C, mass=0.4), s.link("rocker", C, D, mass=0.5)
    s.revolute("A", s.ground, crank, at=A, spring=k)
    s.revolute("B", crank, coupler, at=B)
    s.revolute("C", coupler, rocker, at=C, spring=k / 2)
    s.revolute("D", rocker, s.ground, at=D)
    return s


def test_four_bar_rests_where_its_potential_energy_is_least() -> None:
    e = four_bar(5.0).equilibrium()
    angle = float(e["A"].angle[0])

    def potential(a: float) -> float:
        s = mb.Scene("driven", gravity=(0, -G, 0))
        for method, args, kwargs in four_bar(5.0).statements:
            extra = {"angle0": a} if args[0] == "A" else {}
            getattr(s, method)(*(v["body"] if isinstance(v, dict) else v for v in args),
                               **{k: v["body"] if isinstance(v, dict) else v for k, v in kwargs.items()}, **extra)
        return float(s.simulate(1e-6, solver=mb.RadauIIA(2, rtol=1e-3), outputs=2).energy.potential[0])

    found = minimize_scalar(potential, bounds=(angle - 0.1, angle + 0.1), method="bounded", options={"xatol": 1e-9})
    assert angle != pytest.approx(0, abs=1e-2)
    assert found.x == pytest.approx(angle, abs=1e-5)
    assert e.energy.potential[0] == pytest.approx(potential(angle), rel=1e-9)
    assert e.unstable == 0


# ---- limit points ----------------------------------------------------------------------------------------------------

HALF, HEIGHT, STIFFNESS = 1.0, 0.3, 1000.0


def truss(force: float) -> mb.Scene:
    """Von Mises: two springs from the supports (-1, 0) and (1, 0) to a loaded node at (0, 0.3)."""
    s = mb.Scene("von Mises truss")
    node = s.point_mass("node", 1.0, at=(0, HEIGHT))
    for i, x in enumerate((-HALF, HALF)):
        s.spring(f"bar{i}", s.ground, node, (x, 0), (0, HEIGHT), stiffness=STIFFNESS)
    s.force("load", node, (0, -force, 0))
    return s


def carried(y: float) -> float:
    length = np.hypot(HALF, HEIGHT)
    return float(2 * STIFFNESS * y * (length / np.hypot(HALF, y) - 1))


LIMIT_HEIGHT = np.sqrt((np.hypot(HALF, HEIGHT) * HALF**2) ** (2 / 3) - HALF**2)
LIMIT = carried(LIMIT_HEIGHT)


def test_truss_below_its_limit_load() -> None:
    steps: list[float] = []
    e = truss(0.95 * LIMIT).equilibrium(progress=lambda factor, iterations: steps.append(factor))
    y = brentq(lambda y: carried(y) - 0.95 * LIMIT, LIMIT_HEIGHT, HEIGHT, xtol=1e-15)
    assert e["node"].position[0] == pytest.approx([0, y, 0], abs=1e-10)
    assert steps == sorted(steps)
    assert steps[-1] == 1


@pytest.mark.parametrize("excess", [1.001, 20.0])
def test_truss_stops_at_its_limit_load(excess: float) -> None:
    with pytest.raises(mb.EquilibriumError, match=r"limit point the stiffness against 'node' .* nearly vanishes") as caught:
        truss(excess * LIMIT).equilibrium()
    error = caught.value
    assert error.load_factor * excess == pytest.approx(1, rel=1e-4)
    assert error.load_factor * excess <= 1
    assert error.equilibrium["node"].position[0, 1] == pytest.approx(LIMIT_HEIGHT, abs=5e-3)
    assert error.equilibrium.load_factor == error.load_factor
    assert np.abs(error.equilibrium.acceleration).max() == 0
    assert f"{error.load_factor:.6g}" in str(error)


def test_column_loses_its_stability_to_a_bent_state() -> None:
    """A rod upright on a torsion spring k under a load P > k / L leans to k a = P L sin a."""
    s = mb.Scene("column")
    rod = s.link("rod", (0, 0), (0, 1), mass=1.0)
    s.revolute("A", s.ground, rod, at=(0, 0), spring=10.0)
    s.force("load", rod, (0.01, -12, 0), at=(0, 1))
    a = brentq(lambda a: 10 * a - 12 * np.sin(a) - 0.01 * np.cos(a), 0.5, 2)
    e = s.equilibrium()
    assert -e["A"].angle[0] == pytest.approx(a, rel=1e-9)
    assert e.unstable == 0


# ---- rotating frames -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("start", [0.02, 0.4])
def test_governor_opens_to_the_closed_form(start: float) -> None:
    """A bob hinged to a driven hub: cos a = g / (w^2 l); departures w sin a."""
    w, arm = 6.0, 0.5
    s = mb.Scene("governor", gravity=(0, 0, -G))
    hub = s.rigid_body("hub", 1.0, (1, 1, 1))
    bob = s.rigid_body("bob", 1.0, (0, 0, 0), at=(arm * np.sin(start), 0, -arm * np.cos(start)))
    s.revolute("shaft", s.ground, hub, at=(0, 0), angle=w * mb.t)
    s.revolute("hinge", hub, bob, at=(0, 0), axis=(0, 1, 0))
    e = s.equilibrium(frame=hub)
    c = G / (w * w * arm)
    assert -e["bob"].position[0, 2] / arm == pytest.approx(c, rel=1e-10)
    assert e["bob"].velocity[0] == pytest.approx(np.cross([0, 0, w], e["bob"].position[0]))
    modes = s.linearize(at=e, frame=hub)
    assert modes.angular_frequencies == pytest.approx([w * np.sqrt(1 - c * c)], rel=1e-9)
    r = s.simulate(0.5, start=e)
    assert r["hinge"].angle == pytest.approx(np.full(len(r.t), r["hinge"].angle[0]), abs=1e-5)


def test_body_that_turns_freely_is_its_own_frame() -> None:
    """Rigid spherical pendulum with Jx = Jz: cos a = g / (w^2 l); its angle about the vertical is held without a torque."""
    w = 6.0
    s = mb.Scene("spherical pendulum", gravity=(0, 0, -G))
    bob = s.rigid_body("bob", 1.0, (1e-3, 5e-4, 1e-3), at=(0.3, 0, -0.4), angular_velocity=(0, 0, w))
    s.spherical("O", s.ground, bob, at=(0, 0))
    e = s.equilibrium(frame=bob)
    assert e["bob"].position[0, 2] == pytest.approx(-G / w**2, rel=1e-3)  # the rod's axis of inertia tilts with it
    assert e["bob"].angular_velocity[0] == pytest.approx([0, 0, w])
    assert e["O"].force[0, 2] == pytest.approx(G)
    s.bushing("drag", s.ground, bob, at=(0, 0), stiffness=(0, 0, 0), damping=(0, 0, 0, 0.1, 0.1, 0.1))
    with pytest.raises(mb.EquilibriumError, match=r"'bob' turns freely, and loads of .* N m about its axis change its rate"):
        s.equilibrium(frame=bob)


# ---- no state at rest ------------------------------------------------------------------------------------------------


def flying() -> mb.Scene:
    s = mb.Scene("flying")
    s.rigid_body("body", 1.0, 1.0)
    return s


def falling() -> mb.Scene:
    s = mb.Scene("falling", gravity=(0, -G, 0))
    s.prismatic("P", s.ground, s.rigid_body("cart", 1.0, 1.0), at=(0, 0), axis=(0, 1, 0))
    return s


def sliding() -> mb.Scene:
    s = mb.Scene("sliding")
    s.prismatic("P", s.ground, s.rigid_body("cart", 1.0, 1.0), at=(0, 0), axis=(1, 0, 0), position=0.1 * mb.t)
    return s


def pulsating() -> mb.Scene:
    s = mb.Scene("pulsating")
    cart = s.rigid_body("cart", 1.0, 1.0)
    s.prismatic("P", s.ground, cart, at=(0, 0), axis=(1, 0, 0), spring=10.0)
    s.force("F", cart, (mb.t, 0, 0))
    return s


def spun_up() -> mb.Scene:
    s = mb.Scene("spun up")
    hub = s.rigid_body("hub", 1.0, 1.0)
    s.revolute("shaft", s.ground, hub, at=(0, 0), angle=3 * mb.t + mb.t**2)
    return s


def thrown() -> mb.Scene:
    s = mb.Scene("thrown")
    s.rigid_body("body", 1.0, (1, 1, 1), velocity=(0, 0, 2), angular_velocity=(0, 0, 3))
    return s


@pytest.mark.parametrize(
    ("scene", "frame", "message"),
    [
        (flying, None, "nothing resists 'body' .*; stop that motion with a joint"),
        (falling, None, r"nothing resists 'cart' moving along \(0, 1\)"),
        (sliding, None, "prescribed motions keep the scene moving there: constraint P.drive by 0.1 m/s .*; give another"),
        (pulsating, None, "no state stays at rest .* 'cart' accelerates there at"),
        (spun_up, "hub", "constraint shaft.drive prescribes a motion that is not steady, with an acceleration of .*rad/s"),
        (thrown, "body", "frame = 'body': it translates along its axis of rotation at 2 m/s"),
        (sliding, "cart", "frame = 'cart': it translates at 0.1 m/s"),
        (lambda: truss(1.0), "node", "frame = 'node': a point mass has no axes"),
    ],
)
def test_refusals_name_item_value_and_remedy(scene: Callable[[], mb.Scene], frame: Any, message: str) -> None:
    with pytest.raises(mb.MbdaeError, match=message):
        scene().equilibrium(frame=frame)


def turntable() -> mb.Scene:
    """Bodies with every kind of force on a table that turns at 3 rad/s, a wheel that spins on it."""
    s = mb.Scene("turntable", gravity=(0, 0, -G), space="spatial")
    table = s.rigid_body("table", 5.0, (1, 1, 2))
    s.revolute("shaft", s.ground, table, at=(0, 0, 0), angle=3 * mb.t)
    a = s.rigid_body("a", 1.0, (0.1, 0.2, 0.25), at=(0.5, 0, 0))
    b = s.rigid_body("b", 2.0, (0.3, 0.2, 0.25), at=(1.5, 0.2, 0), rotation=[[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    s.spherical("A", table, a, at=(0, 0, 0))
    s.revolute("B", a, b, at=(1, 0, 0), axis=(0, 1, 1), spring=25.0, damper=0.7, model=mb.Classical(), torque=0.8)
    s.bushing("tie", table, b, (2, 0, 0), (130, 140, 150, 12, 13, 14), (0.3, 0.4, 0.5, 0.2, 0.3, 0.4))
    s.spring("stay", table, a, (0, 1, 1), (1, 0, 0), stiffness=120.0, length=1.5)
    s.force("follower", b, (3, 1, 2), at=(1.8, 0.3, 0.1), frame="body")
    wheel = s.rigid_body("wheel", 0.5, (0.02, 0.01, 0.01), at=(1.5, 0.2, 0.2))
    s.revolute("spindle", b, wheel, at=(1.5, 0.2, 0.2), axis=(1, 0, 0), angle=40 * mb.t)
    return s


def test_rest_on_a_turntable() -> None:
    """The tangent is the difference of the residual, and the run that starts at rest stays there."""
    from dataclasses import replace

    from mbdae.analysis.statics import Statics
    from mbdae.analysis.steady import Rest

    s = turntable()
    statics = Statics(Rest(prepare(s), s["table"]))
    m, point = statics.mechanics, replace(statics.begin, load_factor=0.6)
    T, h = statics.tangent(point), 1e-6
    for i in range(m.nu):
        x = np.eye(T.K.shape[0])[i] * h
        ends = [statics.residual(statics.moved(point, T.p, sign * x))[m.nq : m.nq + m.nu] for sign in (1, -1)]
        column = T.K[: m.nu, i].toarray().ravel()
        assert T.p.C.T @ (ends[0] - ends[1]) / (2 * h) == pytest.approx(column, abs=1e-6 * (1 + np.abs(column).max()))
    e = s.equilibrium(frame="table")
    assert np.linalg.norm(e["wheel"].angular_velocity[0] - [0, 0, 3]) == pytest.approx(40, rel=1e-9)
    modes = s.linearize(at=e, frame="table")
    assert len(modes) == 4
    r = s.simulate(0.5, start=e)
    assert r["B"].angle == pytest.approx(np.full(len(r.t), e["B"].angle[0]), abs=1e-5)


def test_a_mode_evolves_as_its_eigenvalue_says() -> None:
    """Two nonlinear runs from rest plus and minus a small mode on the turntable differ by exp(lambda t)."""
    from mbdae.analysis.frame import frame_at
    from mbdae.analysis.pencil import complete_system
    from mbdae.analysis.state import pencil_at
    from mbdae.formulations import GGL, Index3, system_for
    from mbdae.system.start import Start, Starter

    s = turntable()
    modes = s.linearize(at=s.equilibrium(frame="table"), frame="table")
    m, start = modes.prepared.mechanics, modes.prepared.start
    axes = frame_at(m.model, "table", start.q, start.u)
    pencil = pencil_at(complete_system(m, Index3().spec()), m, axes, (0.0, start.q, start.u, start.s, np.zeros(0)))
    mode, size, t = modes.modes[2], 1e-4, np.linspace(0, 0.3, 7)
    dq = pencil.C @ mode.vector
    du = pencil.C @ (mode.eigenvalue * mode.vector + pencil.kinematics @ mode.vector)
    runs = []
    for sign in (size, -size):
        q = Starter(m, holding=False, changes=[]).close(m.integrate_positions(start.q, sign * dq.real))
        begin = Start(0.0, q, start.u + sign * du.real, start.s, np.zeros(m.nu), np.zeros(0))
        system = system_for(prepare(s, begin), GGL(), 2)
        runs.append(mb.RadauIIA(3, rtol=1e-8).solve(system, 0.3)(t))
    node = m.model.joint_coordinates[0]
    difference = (runs[0] - runs[1])[:, node.q] / (2 * size)
    assert difference == pytest.approx((mode.vector[node.u] * np.exp(mode.eigenvalue * t)).real, abs=1e-6)


def test_what_the_load_factor_multiplies() -> None:
    """Gravity, applied forces and torques and motors, not springs or dampers."""
    s = mb.Scene("loads", gravity=(0, 0, -9.81))
    a = s.rigid_body("a", 1.0, (1, 1, 1), at=(0, 0, 0))
    s.revolute("A", s.ground, a, at=(0, 0, 0), axis=(0, 1, 0), torque=2.0, spring=5.0, damper=0.1)
    s.force("F", a, (1.0, 0, 0))
    s.torque("T", a, (0, 1.0, 0))
    s.spring("k", s.ground, a, at_k=(0, 0, 1), at_l=(0.5, 0, 0), stiffness=3.0)
    found = {g.derived.law.__class__.__name__: bool(applied_loads(g.derived)) for g in prepare(s).model.groups}
    loaded = {name for name, is_load in found.items() if is_load}
    assert loaded == {"Gravity", "AppliedForce", "AppliedTorque", "JointLoad"}
    assert len(found) > len(loaded) + 2


def test_many_bodies_rest_too() -> None:
    """140 links, whose matrices are sparse, hang straight down: the topmost joint carries all."""
    s = mb.Scene("chain", gravity=(0, -9.81, 0))
    above = s.ground
    for i in range(140):
        link = s.link(f"l{i}", (0, -0.1 * i), (0, -0.1 * (i + 1)), mass=1.0)
        s.revolute(f"J{i}", above, link, at=(0, -0.1 * i))
        above = link
    assert np.linalg.norm(s.equilibrium()["J0"].force) == pytest.approx(140 * 9.81, rel=1e-9)


@pytest.mark.parametrize("read", ["peak", "mean", "rms"])
def test_one_state_has_no_peak_and_no_mean(read: str) -> None:
    s = mb.Scene("hanging", gravity=(0, -9.81, 0))
    s.revolute("pin", s.ground, s.link("rod", (0, 0), (0, -1), mass=2.0), at=(0, 0))
    e = s.equilibrium()
    for quantity, span in (("pin.force", None), (lambda r: r["pin"].force[:, 1], None), ("pin.force", (0, 1))):
        with pytest.raises(mb.OptionError, match=r"an equilibrium has one state.*read its value, e\.value"):
            getattr(e, read)(quantity, span)
    r = s.simulate(0.1)
    if read == "peak":  # at one time it is the value there
        assert r(0.05).peak("pin.force").value == pytest.approx(2 * 9.81)
    else:
        with pytest.raises(mb.OptionError, match="is no interval"):
            getattr(r(0.05), read)("pin.force")
    # from the least time to the largest, in whatever order they were asked for
    back, forth = (getattr(one, read)("rod.position", t).value for one, t in ((r([0.08, 0.02]), None), (r, (0.02, 0.08))))
    np.testing.assert_allclose(back, forth)
