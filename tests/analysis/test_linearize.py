"""Modes of small departures from steady motions, against closed forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from scenes import ground_resonance

import mbdae as mb
from mbdae.analysis.frame import motion_in_words
from mbdae.system.prepare import prepare

G = 9.81
LOOSE = {"rel": 1e-9, "abs": 1e-9}


def pendulum(space: str = "auto", model: Any = None, **options: Any) -> mb.Scene:
    s = mb.Scene("pendulum", gravity=(0, -G, 0), space=space)
    rod = s.link("rod", (0, 0), (0, -1), mass=2.0)
    s.revolute("A", s.ground, rod, at=(0, 0), model=model, **options)
    return s


@pytest.mark.parametrize("space", ["auto", "spatial"])
@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical(), mb.Kinematic(scaling=40.0, penalty=3.0)])
def test_physical_pendulum(space: str, model: Any) -> None:
    modes = pendulum(space, model).linearize()
    assert modes.angular_frequencies == pytest.approx([np.sqrt(1.5 * G)], **LOOSE)
    assert modes.frequencies == pytest.approx(modes.angular_frequencies / (2 * np.pi))
    assert modes.damping == pytest.approx([0], abs=1e-12)
    assert modes.stable


def test_inverted_pendulum_grows() -> None:
    s = mb.Scene("inverted", gravity=(0, -G, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (0, 1), mass=2.0), at=(0, 0))
    modes = s.linearize()
    assert sorted(modes.growth) == pytest.approx([-np.sqrt(1.5 * G), np.sqrt(1.5 * G)], **LOOSE)
    assert not modes.stable


@pytest.mark.parametrize("space", ["auto", "spatial"])
def test_double_pendulum(space: str) -> None:
    """Two point masses of 1 kg on rods of 1 m: w^2 = g (2 -+ sqrt 2); the mode shapes are 1 : +-sqrt 2 in the angles."""
    s = mb.Scene("double pendulum", gravity=(0, -G, 0), space=space)
    upper = s.rigid_body("upper", 1.0, (0, 0, 0), at=(0, -1))
    lower = s.rigid_body("lower", 1.0, (0, 0, 0), at=(0, -2))
    s.revolute("A", s.ground, upper, at=(0, 0))
    s.revolute("B", upper, lower, at=(0, -1))
    modes = s.linearize()
    assert modes.angular_frequencies == pytest.approx(np.sqrt(G * (2 + np.array([-1, 1]) * np.sqrt(2))), **LOOSE)
    for mode, ratio in zip(modes, (np.sqrt(2), -np.sqrt(2)), strict=True):
        assert mode["lower"].rotation[2] / mode["upper"].rotation[2] == pytest.approx(ratio, rel=1e-9)
        assert mode["upper"].displacement[0] == pytest.approx(mode["upper"].rotation[2], rel=1e-9)
        assert mode["ground"].displacement == pytest.approx(np.zeros(3))
        assert sum(mode.participation.values()) == pytest.approx(1)


@pytest.mark.parametrize("space", ["auto", "spatial"])
def test_chain_of_bushings_has_the_damping_of_its_matrices(space: str) -> None:
    """Two masses between ground and each other: x'' + c x' + k x with proportional damping."""
    s = mb.Scene("chain", space=space)
    stiff, damp = (100.0, 400.0, 900.0), (1.0, 4.0, 9.0)
    kinds: dict[str, Any] = {"stiffness": stiff, "damping": damp}
    a, b = s.point_mass("a", 1.0, at=(1, 0)), s.point_mass("b", 1.0, at=(2, 0))
    s.bushing("first", s.ground, a, at=(1, 0), **kinds)
    frame = s.bushing("second", s.ground, b, at=(2, 0), **kinds)
    assert frame.name == "second"
    s.distance("rod", a, b, (1, 0), (2, 0))
    modes = s.linearize()
    axes = (0, 1, 1) if space == "auto" else (0, 1, 1, 2, 2)  # along the rod both masses move as one
    w = np.sqrt([stiff[i] for i in axes])
    zeta = np.array([damp[i] for i in axes]) / (2 * w)
    assert np.abs(modes.eigenvalues) == pytest.approx(w, **LOOSE)
    assert modes.damping == pytest.approx(zeta, **LOOSE)
    assert modes.growth == pytest.approx(-zeta * w, **LOOSE)
    assert modes.angular_frequencies == pytest.approx(w * np.sqrt(1 - zeta**2), **LOOSE)


def test_overdamped_motion_has_two_real_eigenvalues() -> None:
    s = mb.Scene("slow")
    s.prismatic("P", s.ground, s.rigid_body("cart", 1.0, 1.0), at=(0, 0), axis=(1, 0, 0), spring=4.0, damper=5.0)
    modes = s.linearize()
    assert sorted(modes.growth) == pytest.approx([-4, -1], **LOOSE)
    assert list(modes.frequencies) == [0, 0]
    assert list(modes.damping) == [1, 1]


def test_followed_angle_of_a_spring_adds_no_mode() -> None:
    s = pendulum("spatial", spring=3.0, damper=0.2)
    modes = s.linearize()
    assert len(modes) == 1
    assert abs(modes.eigenvalues[0]) == pytest.approx(np.sqrt(1.5 * G + 3 / (2 / 3)), rel=1e-9)
    assert modes.growth[0] == pytest.approx(-0.2 / (2 / 3) / 2, rel=1e-9)


# ---- spinning bodies -------------------------------------------------------------------------------------------------

MASS, ARM, J1, J3 = 2.0, 0.3, 0.05, 0.08  # J1 about the centre of mass


def top(spin: float) -> mb.Scene:
    s = mb.Scene("top", gravity=(0, 0, -G))
    body = s.rigid_body("top", MASS, (J1, J1, J3), at=(0, 0, ARM), angular_velocity=(0, 0, spin))
    s.spherical("O", s.ground, body, at=(0, 0, 0))
    return s


def ordered(values: Any) -> np.ndarray:
    return np.array(sorted(values, key=lambda z: (round(z.imag, 6), round(z.real, 6))))


@pytest.mark.parametrize("share", [0.5, 0.98, 1.02, 3.0])
def test_sleeping_top(share: float) -> None:
    """A z'' - i C n z' - m g l z = 0 for the tilt z = x + i y in inertial axes: stable where (C n)^2 > 4 A m g l."""
    A = J1 + MASS * ARM**2
    critical = 2 * np.sqrt(A * MASS * G * ARM) / J3
    modes = top(share * critical).linearize()
    assert modes.stable == (share > 1)
    roots = np.roots([A, -1j * J3 * share * critical, -MASS * G * ARM])
    expected = [*(r if r.imag > 0 else np.conj(r) for r in roots), 0, 0]
    assert ordered(modes.eigenvalues) == pytest.approx(ordered(expected), abs=1e-6)


def test_top_resolved_in_its_own_axes() -> None:
    """Seen from the spinning body the same roots turn by -n."""
    spin = 90.0
    A = J1 + MASS * ARM**2
    roots = np.roots([A, -1j * J3 * spin, -MASS * G * ARM]) - 1j * spin
    modes = top(spin).linearize(frame="top")
    assert np.sort(modes.angular_frequencies)[2:] == pytest.approx(np.sort(np.abs(roots.imag)), rel=1e-9)


STIFF = (3e5, 2e5, 1e6, 4e3, 6e3, 5e3)


def rotor(unbalance: float = 0.0, inertia: tuple[float, float, float] = (0.4, 0.4, 0.7), angle: Any = 80 * mb.t) -> mb.Scene:
    """A disc driven on a housing in anisotropic elastic support."""
    s = mb.Scene("rotor", space="spatial")
    housing = s.rigid_body("housing", 5.0, (0.1, 0.1, 0.1))
    s.bushing("support", s.ground, housing, at=(0, 0), stiffness=STIFF)
    s.revolute("bearing", housing, s.rigid_body("disc", 20.0, inertia, at=(unbalance, 0)), at=(0, 0), angle=angle)
    return s


def test_shaft_in_anisotropic_bearings() -> None:
    """Translations sqrt(k/m); tilts couple by the gyroscopic moment: det [kx - J w^2, i w H; -i w H, ky - J w^2] = 0."""
    s = rotor()
    e = s.equilibrium()
    assert e["disc"].angular_velocity[0] == pytest.approx([0, 0, 80])
    assert e["housing"].angular_velocity[0] == pytest.approx([0, 0, 0], abs=1e-9)
    modes = s.linearize(at=e)
    J, H, (kx, ky) = 0.5, 0.7 * 80, STIFF[3:5]
    tilts = np.sqrt(np.roots([J * J, -(J * (kx + ky) + H * H), kx * ky]))
    turn = np.sqrt(STIFF[5] / 0.8)  # the drive keeps the disc's speed relative to the housing
    expected = np.sort([*np.sqrt(np.array(STIFF[:3]) / 25), *tilts, turn])
    assert np.sort(modes.angular_frequencies) == pytest.approx(expected, rel=1e-9)
    assert np.abs(modes.growth).max() < 1e-9
    assert s.linearize().angular_frequencies == pytest.approx(modes.angular_frequencies)


@pytest.mark.parametrize(
    ("scene", "frame", "reason"),
    [
        (rotor, "disc", "periodic, use s.floquet"),
        (lambda: rotor(inertia=(0.3, 0.5, 0.7)), None, "the inertia against 'housing' turning .*periodic, use s.floquet"),
        (lambda: rotor(unbalance=1e-3), None, "'housing' accelerates|'disc' accelerates"),
        (lambda: rotor(angle=80 * mb.t**2), None, "accelerates"),
    ],
)
def test_equations_that_depend_on_time_are_refused(scene: Callable[[], mb.Scene], frame: Any, reason: str) -> None:
    with pytest.raises(mb.SteadyError, match=reason) as caught:
        scene().linearize(frame=frame)
    assert "frame=" in str(caught.value)
    assert len(caught.value.frozen) > 0


def test_bodies_that_move_alike_are_named_in_the_order_of_the_scene() -> None:
    """Disc and housing tilt together, equal up to rounding: the message names the housing, whichever rounds to the larger."""
    m = prepare(rotor()).mechanics
    nodes = {n.name: n for n in m.model.nodes}
    motion = np.zeros(m.nu)
    for name in ("housing", "disc"):
        motion[nodes[name].u + 3 : nodes[name].u + 6] = (0.6, -0.8, 0)
    for rounding in (1 - 1e-9, 1.0, 1 + 1e-9):
        tilting = motion.copy()
        tilting[nodes["disc"].u : nodes["disc"].u + 6] *= rounding
        assert motion_in_words(m.model, tilting, m.velocity_units) == "'housing' turning about (-0.6, 0.8, 0)"
    motion[nodes["disc"].u :][:6] *= 1.01
    assert motion_in_words(m.model, motion, m.velocity_units).startswith("'disc' turning")


def hub_and_bob(w: float, arm: float) -> mb.Scene:
    s = mb.Scene("conical pendulum", gravity=(0, 0, -G))
    hub = s.rigid_body("hub", 1.0, (1, 1, 1))
    s.revolute("shaft", s.ground, hub, at=(0, 0), angle=w * mb.t)
    c = G / (w * w * arm)
    p = arm * np.array([np.sqrt(1 - c * c), 0, -c])
    bob = s.point_mass("bob", 1.0, at=p, velocity=np.cross([0, 0, w], p))
    s.distance("rod", s.ground, bob, (0, 0, 0), p)
    return s


def test_spherical_pendulum_in_the_rotating_frame() -> None:
    """Departures from the conical motion: w sqrt(1 + 3 cos^2 a), and a shift along the circle that meets no stiffness."""
    w, arm = 6.0, 0.5
    c = G / (w * w * arm)
    modes = hub_and_bob(w, arm).linearize(frame="hub")
    assert modes.angular_frequencies == pytest.approx([0, 0, w * np.sqrt(1 + 3 * c * c)], rel=1e-8, abs=1e-4)
    with pytest.raises(mb.SteadyError, match="'bob' accelerates"):
        hub_and_bob(w, arm).linearize()


@pytest.mark.parametrize("free", [False, True])
def test_ground_resonance_growth(free: bool) -> None:
    """The real parts do not depend on the frame: those of the roots in fixed axes, from minimal coordinates."""
    growth = [-0.888749914059102, -0.9819371784257798, 2.6378694477749547, -3.1914247795324906]
    s = ground_resonance(2, free=free)
    modes = s.linearize(at=s.equilibrium(frame="hub"), frame="hub")
    assert modes.growth.max() == pytest.approx(max(growth), rel=1e-9)
    assert np.sort(modes.growth[np.abs(modes.growth) > 1e-6]) == pytest.approx(np.sort(growth), rel=1e-8)


def damped_rotor(space: str, damper: float) -> mb.Scene:
    s = mb.Scene("rotor on a support", space=space)
    block = s.rigid_body("block", 30.0, (1, 1, 1))
    s.fixed_orientation("level", s.ground, block)
    s.bushing("support", s.ground, block, (0, 0), (12e3, 12e3, 1e5), (150, 150, 0))
    hub = s.rigid_body("hub", 0.0, (0, 0, 0))
    s.revolute("rotor", block, hub, at=(0, 0), angle=20.01 * mb.t)
    for i in range(4):
        d = np.round([np.cos(i * np.pi / 2), np.sin(i * np.pi / 2)])
        s.revolute(f"lag{i}", hub, s.link(f"blade{i}", 0.25 * d, 4.5 * d, mass=12.75), at=0.25 * d, damper=damper)
    return s


@pytest.mark.parametrize("space", ["auto", "spatial"])
@pytest.mark.parametrize(("damper", "growth"), [(10, 2.6081493302637018), (200, 2.096268951713334), (1600, 0.34272639319740694)])
def test_lag_dampers_lower_the_growth(space: str, damper: float, growth: float) -> None:
    """Growth rates from minimal coordinates; the start is steady by itself."""
    assert damped_rotor(space, damper).linearize(frame="hub").growth.max() == pytest.approx(growth, rel=1e-9)


@pytest.mark.parametrize("frame", ["hub", "ground"])
def test_ground_resonance_on_one_axis_is_periodic(frame: str) -> None:
    s = ground_resonance(1)
    with pytest.raises(mb.SteadyError, match=r"periodic, use s\.floquet"):
        s.linearize(at=s.equilibrium(frame="hub"), frame=frame)


# ---- where it is taken -----------------------------------------------------------------------------------------------


def test_states_of_a_run() -> None:
    s = pendulum(damper=2.0, angle0=0.3)
    r = s.simulate(20.0, accuracy=1e-5)
    late = s.linearize(at=r)
    assert late.t == 20
    assert late.eigenvalues == pytest.approx(pendulum(damper=2.0).linearize().eigenvalues, rel=1e-6)
    with pytest.raises(mb.SteadyError, match=r"'rod' accelerates there at .* rad/s\^2") as caught:
        s.linearize(at=(r, 0.5))
    assert caught.value.frozen.t == 0.5


def test_stiffness_is_symmetric_about_a_conservative_equilibrium() -> None:
    s = mb.Scene("chain", gravity=(0, 0, -G), space="spatial")
    a = s.rigid_body("a", 1.0, (0.1, 0.2, 0.25), at=(0.5, 0, 0))
    b = s.rigid_body("b", 2.0, (0.3, 0.2, 0.25), at=(1.5, 0.2, 0))
    s.spherical("A", s.ground, a, at=(0, 0, 0))
    s.revolute("B", a, b, at=(1, 0, 0), axis=(0, 1, 0), spring=5.0)
    s.bushing("tie", s.ground, b, at=(2, 0, 0), stiffness=(30, 40, 50, 2, 3, 4))
    s.spring("stay", s.ground, a, (0, 1, 1), (1, 0, 0), stiffness=20.0)
    modes = s.linearize(at=s.equilibrium())
    assert np.abs(modes.K - modes.K.T).max() < 1e-9 * np.abs(modes.K).max()
    assert np.abs(modes.M - modes.M.T).max() < 1e-12 * np.abs(modes.M).max()
    assert np.abs(modes.C).max() < 1e-9


def test_table_names_frequency_damping_growth_and_bodies() -> None:
    text = str(pendulum(damper=0.2).linearize())
    assert text.splitlines()[1].split() == ["mode", "Hz", "rad/s", "damping", "growth", "1/s", "error", "bodies"]
    assert "rod 100%" in text


def test_lowest_modes(monkeypatch: pytest.MonkeyPatch) -> None:
    s = mb.Scene("chain", gravity=(0, -G, 0))
    before = s.ground
    for i in range(5):
        rod = s.link(f"rod{i}", (0, -i), (0, -i - 1), mass=1.0)
        s.revolute(f"J{i}", before, rod, at=(0, -i))
        before = rod
    expected = s.linearize().frequencies[:2]
    assert s.linearize(count=2).frequencies == pytest.approx(expected)
    monkeypatch.setattr("mbdae.analysis.spectrum.LARGEST", 4)
    assert s.linearize(count=2).frequencies == pytest.approx(expected)
    with pytest.raises(mb.OptionError, match=r"10 states, and all modes are computed up to 4 .* such as s.linearize\(count=20"):
        s.linearize()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"at": 3.0}, r"at = 3.0 is no state: give a Result \(its end\), \(Result, t\), an equilibrium, or None"),
        ({"frame": "nothing"}, "frame = 'nothing' is no body of scene 'pendulum'"),
        ({"count": 0}, "count = 0 is not 1 or more: give the number of lowest modes"),
        ({"at": top(1.0).simulate(0.01)}, "at is a state of scene 'top', which has other items than 'pendulum'"),
        ({"frame": 4}, "frame = 4 is no body of scene 'pendulum': give s.ground or one of 'ground', 'rod'"),
    ],
)
def test_bad_options(options: dict[str, Any], message: str) -> None:
    with pytest.raises(mb.MbdaeError, match=message):
        pendulum().linearize(**options)


# ---- against differences of the equations of motion ------------------------------------------------------------------


def tangled() -> mb.Scene:
    """A spatial loop with every kind of force, at rest."""
    s = mb.Scene("tangled", gravity=(1, -2, -G), space="spatial")
    a = s.rigid_body("a", 1.0, (0.1, 0.2, 0.25), at=(0.5, 0, 0))
    b = s.rigid_body("b", 2.0, (0.3, 0.2, 0.25), at=(1.5, 0.2, 0), rotation=[[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    s.spherical("A", s.ground, a, at=(0, 0, 0))
    s.revolute("B", a, b, at=(1, 0, 0), axis=(0, 1, 1), spring=5.0, damper=0.7, model=mb.Classical(), torque=0.8)
    s.bushing("tie", s.ground, b, (2, 0, 0), (30, 40, 50, 2, 3, 4), (0.3, 0.4, 0.5, 0.2, 0.3, 0.4))
    s.spring("stay", s.ground, a, (0, 1, 1), (1, 0, 0), stiffness=20.0, damping=0.3)
    s.force("follower", b, (3, 1, 2), at=(1.8, 0.3, 0.1), frame="body")
    s.torque("twist", a, (0.3, 0.2, 0.1))
    return s


def test_matrices_are_the_differences_of_the_accelerations() -> None:
    from mbdae.analysis.frame import RotatingFrame
    from mbdae.analysis.pencil import basis
    from mbdae.formulations import Index3
    from mbdae.system.assembled.assembly import Assembly
    from mbdae.system.start import Starter

    s = tangled()
    modes = s.linearize(at=s.equilibrium())
    m, start = modes.prepared.mechanics, modes.prepared.start
    system = Assembly(m.model, m.rows, Index3().spec())
    C = basis(system, m, RotatingFrame("ground", np.eye(3), np.zeros(3)), start.q, start.u).C.toarray()
    N, closer, t = C @ modes.basis, Starter(m, holding=False, changes=[]), np.zeros(1)

    def acceleration(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        q = closer.close(m.integrate_positions(start.q, N @ x))
        return np.linalg.lstsq(N, m.accelerations(t, q[None], (N @ v)[None], start.s[None])[0][0], rcond=None)[0]

    zero, h = np.zeros(N.shape[1]), 1e-5
    unit = np.eye(len(zero)) * h
    by_x = np.array([acceleration(e, zero) - acceleration(-e, zero) for e in unit]).T / (2 * h)
    by_v = np.array([acceleration(zero, e) - acceleration(zero, -e) for e in unit]).T / (2 * h)
    K, C2 = np.linalg.solve(modes.M, modes.K), np.linalg.solve(modes.M, modes.C)
    assert np.abs(by_x + K).max() < 1e-6 * np.abs(K).max()
    assert np.abs(by_v + C2).max() < 1e-6 * np.abs(C2).max()


@pytest.mark.parametrize(("compliance", "rate"), [(0.02, 0.0), (0.02, 0.1), (0.0, 0.0)])
def test_algebraic_stress_is_eliminated(compliance: float, rate: float) -> None:
    """m1 x1'' + z = 0, m2 x2'' - z = 0, compliance z = x1 - x2 + rate (x1' - x2'): the root of the relative motion."""
    import scipy.sparse as sp

    from mbdae.analysis.pencil import Pencil
    from mbdae.analysis.reduced import free_basis, reduced
    from mbdae.analysis.spectrum import spectrum

    d, mass = np.array([[1.0, -1.0]]), np.diag([2.0, 3.0])
    one, zero = np.eye(2), np.zeros((2, 2))
    E = sp.csr_matrix(np.block([[one, zero, np.zeros((2, 1))], [zero, mass, np.zeros((2, 1))], [np.zeros((1, 5))]]))
    A = sp.csr_matrix(np.block([[zero, -one, np.zeros((2, 1))], [zero, zero, d.T], [-d, -rate * d, np.full((1, 1), compliance)]]))
    rigid = compliance == 0
    none, z = np.zeros(0, dtype=int), np.array([4])
    places = {"p": np.arange(2), "w": np.arange(2, 4), "s": none, "z": none if rigid else z, "c": z if rigid else none}
    p = Pencil(E, A, places, sp.identity(2))
    equations = reduced(p, free_basis(p.constraints, np.ones(2)))
    exact = replace(equations, **{f.name: 0 * getattr(equations, f.name) for f in fields(equations)})
    relative = [v for v in spectrum(equations, exact, None).values if abs(v) > 1e-6]
    if rigid:
        assert relative == []
    else:
        k, mu = 1 / compliance, 6 / 5
        assert relative == pytest.approx([v for v in np.roots([mu, rate * k, k]) if v.imag > 0])


def test_a_mode_moves_every_place_of_a_rigid_body() -> None:
    """A rod about its end: displacements grow with the distance from the hinge, and are normal to the rod."""
    s = mb.Scene("swing", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (0, -1), mass=1.0)
    s.revolute("hinge", s.ground, rod, at=(0, 0))
    mode = s.linearize().modes[0]
    turn = mode[rod].rotation[2]
    for y in (0.0, -0.5, -1.0):
        np.testing.assert_allclose(mode[rod.at((0, y))].displacement, [-y * turn, 0, 0], atol=1e-12)


def test_balls_as_recursive_joints_have_the_roots_of_constrained_ones() -> None:
    """Two bodies that hang on balls, one below the other; the upper ball alone has quaternions in common with its body."""

    def roots(model: Any) -> Any:
        s = mb.Scene("balls", gravity=(0, 0, -9.81))
        a = s.rigid_body("a", 1.0, (0.12, 0.13, 0.15), at=(0, 0, -0.5))
        b = s.rigid_body("b", 2.0, (0.2, 0.23, 0.25), at=(0, 0, -1.5))
        s.spherical("upper", s.ground, a, at=(0, 0, 0), model=model)
        s.spherical("lower", a, b, at=(0, 0, -1), model=model)
        found = s.linearize()
        assert found.stable is True
        return np.sort(np.abs(found.eigenvalues))

    constrained, recursive = roots(mb.Kinematic()), roots(mb.Recursive())
    assert len(recursive) == len(constrained) == 8
    assert recursive == pytest.approx(constrained, abs=1e-9)
