"""Vibration and free flight of beams: closed-form frequencies, energy and momentum."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import cho_factor, cho_solve, eigh

from mbdae.integrators.radau import RadauIIA
from mbdae.laws.line_mesh import curved, polyline
from mbdae.scene.shapes import Section
from mbdae.system.dae import DAE

CANTILEVER = [1.8751040687119611, 4.694091132974175, 7.854757438237613]  #: roots beta L of Euler-Bernoulli beams
FREE = [4.730040744862704, 7.853204624095838, 10.995607838001671]
SLENDER = Section(1e7, 1e7, 1e7, 1e2, 1.0, 1.0, 1.0, (1e-3, 1e-7, 1e-7)).numbers
FLYING = Section(4e3, 3e3, 3e3, 120.0, 100.0, 150.0, 1.0, (0.2, 0.1, 0.1)).numbers  #: length 4: first bending about 1 s


def squared_frequencies(S, free):
    """omega^2 (rad/s)^2 of small vibrations about the reference, stresses eliminated by their rows."""
    K, n = S.tangent(S.q0, np.zeros((S.m, S.nz))), S.nodes * S.nu
    K = K[:n, :n] - K[:n, n:] @ np.linalg.solve(K[n:, n:], K[n:, :n])
    keep = slice(0 if free else S.nu, None)
    K, M = K[keep, keep], S.M[keep, keep]
    shift = 1.0 if free else 0.0  # rigid motions have no stiffness
    return np.sort(1 / eigh(M, K + shift * M, eigvals_only=True) - shift)


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("free", [False, True])
def test_euler_bernoulli_frequencies(structure, planar, free):
    S = structure(polyline([(0, 0), (1, 0)], 10, 3), SLENDER, planar)
    found = squared_frequencies(S, free)
    rigid = (3 if planar else 6) if free else 0
    assert found[:rigid] == pytest.approx(0, abs=1e-5)
    copies = 1 if planar else 2  # bending about both axes
    for i, root in enumerate(FREE if free else CANTILEVER):
        pair = found[rigid + copies * i : rigid + copies * (i + 1)]
        assert np.sqrt(pair) == pytest.approx(root**2, rel=1e-4)


def test_frequencies_of_torsion_and_extension(structure):
    """Clamped rod: omega = pi / 2 sqrt(GJ / J1) and pi / 2 sqrt(EA / mass), far below bending here."""
    numbers = Section(1.0, 1e8, 1e8, 0.5, 1e8, 1e8, 1.0, (2.0, 1e-3, 1e-3)).numbers
    found = squared_frequencies(structure(polyline([(0, 0), (1, 0)], 4, 3), numbers), free=False)
    assert np.sqrt(found[:2]) == pytest.approx([np.pi / 2 * 0.5, np.pi / 2], rel=1e-7)


# ---- free flight -------------------------------------------------------------------------------------------------------


def flight(structure, numbers, planar=False, mixed=False, corner=False):
    """A beam thrown so that it turns, bends and stretches at once."""
    points = [(0, 0), (2, 0), (3, 1.5)] if corner else [(0, 0), (4, 0)]
    S = structure(polyline(points, 4, 2), numbers, planar, mixed)
    x = S.mesh.stations / S.mesh.length
    wave = np.cos(2 * np.pi * x)
    columns = [0.6 * x, 2 * x + wave, 0.4 * wave] if planar else [0.6 * x, 2 * x + wave, 1 - 2 * x + wave, 1 + x, -x, 0.4 * wave]
    return S, np.column_stack(columns)


def rotations(q):
    w, x, y, z = (q[:, 3:] / np.linalg.norm(q[:, 3:], axis=1, keepdims=True)).T
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]).transpose(2, 0, 1)


def invariants(S, q, u):
    """Kinetic and elastic energy; momentum (3,), angular momentum about the origin (3,)."""
    p = (S.M @ u.ravel()).reshape(u.shape)
    x = S.inputs(q, np.zeros((S.m, S.nz)), u)
    elastic = S.kernel.at_points(x, [S.kernel.derived.energy]).sum()
    move = np.pad(p[:, :2], ((0, 0), (0, 1))) if S.planar else p[:, :3]
    place = np.pad(q[:, :2], ((0, 0), (0, 1))) if S.planar else q[:, :3]
    spin = np.pad(p[:, 2:], ((0, 0), (2, 0))) if S.planar else np.einsum("nij,nj->ni", rotations(q), p[:, 3:])
    return 0.5 * u.ravel() @ p.ravel(), elastic, move.sum(axis=0), (np.cross(place, move) + spin).sum(axis=0)


def motion(S, u0, t_end, rtol=1e-9):
    """States (nt, nq) and (nt, nu) of the equations with the stresses eliminated: an ordinary differential equation."""
    M = cho_factor(S.M)
    nq = S.q0.size

    def rate(t, y):
        q, u = y[:nq].reshape(S.q0.shape), y[nq:].reshape(u0.shape)
        forces, _ = S.internal(q, np.zeros((S.m, 0)), u)
        return np.r_[S.kernel_nodes.rates(q[None], u[None]).ravel(), -cho_solve(M, forces.ravel())]

    start, times = np.r_[S.q0.ravel(), u0.ravel()], np.linspace(0, t_end, 21)
    run = solve_ivp(rate, (0, t_end), start, "DOP853", rtol=rtol, atol=rtol, t_eval=times)
    return [(y[:nq].reshape(S.q0.shape), y[nq:].reshape(u0.shape)) for y in run.y.T]


@pytest.mark.parametrize(("planar", "corner"), [
    (True, False), (False, True), *(pytest.param(both, both, marks=pytest.mark.slow) for both in (True, False))])
def test_free_flight_keeps_energy_and_momenta(structure, planar, corner):
    S, u0 = flight(structure, FLYING, planar, corner=corner)
    kinetic, elastic, momentum, spin = zip(*(invariants(S, q, u) for q, u in motion(S, u0, 2.0)), strict=True)
    energy, scale = np.add(kinetic, elastic), np.linalg.norm(spin[0])
    assert np.ptp(elastic) > 0.2 * energy[0]  # it does deform
    assert np.ptp(energy) < 1e-8 * energy[0]
    assert np.ptp(momentum, axis=0).max() < 1e-9 * np.linalg.norm(momentum[0])
    assert np.ptp(spin, axis=0).max() < 1e-10 * scale


def test_damping_takes_energy_and_leaves_the_momenta(structure):
    S, u0 = flight(structure, {**FLYING, "damping": 0.01})
    kinetic, elastic, momentum, spin = zip(*(invariants(S, q, u) for q, u in motion(S, u0, 2.0, 1e-8)), strict=True)
    energy = np.add(kinetic, elastic)
    assert np.all(np.diff(energy) < 0)
    assert energy[-1] < 0.9 * energy[0]
    assert np.ptp(momentum, axis=0).max() < 1e-8 * np.linalg.norm(momentum[0])
    assert np.ptp(spin, axis=0).max() < 3e-7 * np.linalg.norm(spin[0])


def test_curved_beam_in_steady_rigid_rotation(structure):
    """A stiff ring segment turned about the normal through its centre of mass keeps turning: forces balance by inertia."""
    S = structure(curved(lambda s: (np.cos(3 * s), np.sin(3 * s)), 4, 2), FLYING)
    z = np.zeros((S.m, S.nz))
    u = np.zeros((S.nodes, 6))
    u[:, 5] = 1.5
    forces, _ = S.internal(S.q0, z, u)
    assert np.abs(forces).max() < 1e-14  # no gyroscopic moment about a principal axis, no stress as drawn


def solved_with_stresses(S, u0, t_end, rtol=1e-7):
    """q, u and stresses at t_end, the stresses being algebraic unknowns; those of rigid strains are multipliers."""
    nq, nu = S.q0.size, u0.size

    def parts(y):
        return y[:nq].reshape(S.q0.shape), y[nq : nq + nu].reshape(u0.shape), y[nq + nu :].reshape(S.m, S.nz)

    def residual(t, y, yp, out):
        q, u, z = parts(y)
        forces, rows = S.internal(q, z, u)
        kinematics = yp[:nq] - S.kernel_nodes.rates(q[None], u[None]).ravel()
        out[:] = np.r_[kinematics, S.M @ yp[nq : nq + nu] + forces.ravel(), rows.ravel()]

    y0 = np.r_[S.q0.ravel(), u0.ravel(), np.zeros(S.m * S.nz)]
    yp0 = np.zeros_like(y0)
    yp0[:nq] = S.kernel_nodes.rates(S.q0[None], u0[None]).ravel()
    yp0[nq : nq + nu] = np.linalg.solve(S.M, -S.internal(S.q0, parts(y0)[2], u0)[0].ravel())
    numbers, names = S.kernel.numbers, S.kernel.parameters
    rigid = np.concatenate([numbers[..., [names.index(f"compliance_{n}")]] == 0 for n in S.kernel.derived.stresses], axis=-1)
    index = np.r_[np.ones(nq), np.full(nu, 2 if rigid.any() else 1), np.where(rigid, 3, 1).ravel()].astype(int)
    scale = np.r_[np.ones(nq + nu), np.full(S.m * S.nz, 1e4)]  # keeps the stresses out of the error test
    run = RadauIIA(3, rtol=rtol).solve(DAE(residual, y0, yp0, index=index, scale=scale), t_end)
    return parts(run.y[-1])


def test_mixed_form_in_radau(structure):
    """Stresses as unknowns: the motion of the eliminated form, with its invariants."""
    S, u0 = flight(structure, FLYING, mixed=True)
    plain, _ = flight(structure, FLYING)
    q, u, _ = solved_with_stresses(S, u0, 0.5)
    before, after = invariants(S, S.q0, u0), invariants(S, q, u)
    assert sum(after[:2]) == pytest.approx(sum(before[:2]), rel=1e-6)
    assert after[3] == pytest.approx(before[3], rel=1e-6)
    assert q[:, :3] == pytest.approx(motion(plain, u0, 0.5)[-1][0][:, :3], abs=1e-5)


@pytest.mark.parametrize("planar", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_zero_compliance_in_motion(structure, planar):
    """Rigid in shear and extension is the limit of stiff; the start v = s^2, omega = 2 s strains neither."""
    tips = []
    for stiffness in (1e8, np.inf):
        section = Section(*[stiffness] * 3, 1.0, 1.0, 1.0, 1.0, (1e-2, 5e-3, 5e-3))
        S = structure(polyline([(0, 0), (1, 0)], 4, 2), section.numbers, planar)
        u0 = np.zeros((S.nodes, S.nu))
        u0[:, 1], u0[:, -1] = S.mesh.stations**2, 2 * S.mesh.stations
        q, u, _ = solved_with_stresses(S, u0, 0.5, 1e-5 if np.isfinite(stiffness) else 5e-8)
        before, after = invariants(S, S.q0, u0), invariants(S, q, u)
        assert sum(after[:2]) == pytest.approx(sum(before[:2]), rel=2e-6)
        tips.append(q[-1, :2])
    assert tips[0] == pytest.approx(tips[1], abs=1e-5)
