"""The System interface: consistent start, exact Jacobian, right-hand side and parts of the equations."""

from __future__ import annotations

import numpy as np
import pytest

import mbdae as mb


def free_bodies() -> mb.Scene:
    """Unconstrained, with a spring in space that follows its turns through an internal state."""
    s = mb.Scene("free", gravity=(0, 0, -9.81))
    a = s.rigid_body("a", 2.0, (1.0, 2.0, 2.5), at=(0, 0, 0), angular_velocity=(0.3, 1.0, -0.2))
    b = s.point_mass("b", 0.5, at=(1, 0, 1), velocity=(0, 0.2, 0))
    s.spring("S", a, b, (0.3, 0, 0), (1, 0, 1), stiffness=40.0, damping=0.5)
    s.bushing("B", s.ground, a, (0, 0, 0), (100.0, 90.0, 80.0, 5.0, 6.0, 7.0), (1.0, 1.0, 1.0, 0.1, 0.1, 0.1))
    s.force("F", a, (mb.t, 0, 1.0), at=(0, 0.2, 0))
    return s


def chain(n: int) -> mb.Scene:
    s, before = mb.Scene(f"chain of {n}", gravity=(0, 0, -9.81)), None
    for i in range(n):
        body = s.rigid_body(f"b{i}", 1.0, (0.1, 0.09, 0.05), at=(i + 0.5, 0, 0))
        axis = (0, 1, 0) if i % 2 else (0, 1, 1)
        s.revolute(f"J{i}", before or s.ground, body, at=(i, 0, 0), axis=axis, spring=2.0, damper=0.1)
        before = body
    return s


def test_rhs_solves_the_residual() -> None:
    system = free_bodies().system(mb.ODE())
    rng = np.random.default_rng(3)
    for _ in range(5):
        y, yp, left = system.y0 + 0.1 * rng.normal(size=system.n), np.empty(system.n), np.empty(system.n)
        system.rhs(0.3, y, yp)
        system.residual(0.3, y, yp, left)
        assert np.abs(left).max() <= 1e-12 * np.abs(yp).max()


def test_parts_satisfy_the_equations_of_motion() -> None:
    scene = chain(3)
    r = scene.simulate(0.05, form=mb.GGL())
    M, f, g, G = scene.system().partition
    q, u = r.q[0], r.u[0]
    s = r.solution(0.0)[len(q) + len(u) :][:3]
    balance = M(0.0, q) @ r.acceleration[0] + G(0.0, q).T @ r.multipliers[0] - f(0.0, q, u, s)
    assert np.abs(balance).max() <= 1e-10
    assert np.abs(g(0.0, q)).max() <= 1e-12
    assert scene.system().rhs is None


@pytest.mark.parametrize("form", [mb.GGL(), mb.GGL(algebraic=True), mb.Index3()])
@pytest.mark.parametrize("n", [2, 8])
def test_start_is_consistent_and_jacobian_exact(form, n) -> None:
    """Dense and sparse: the residual vanishes at the start, the Jacobian agrees with central differences."""
    system = chain(n).system(form)
    assert (system.sparsity is None) == (n == 2)
    left = np.empty(system.n)
    system.residual(0.0, system.y0, system.yp0, left)
    assert np.abs(left).max() <= 1e-10
    rng, cj = np.random.default_rng(5), 3.0
    y, yp = system.y0 + 0.1 * rng.normal(size=system.n), system.yp0 + rng.normal(size=system.n)
    pattern = np.ones((system.n, system.n)) if system.sparsity is None else system.sparsity.toarray()
    data = np.empty((system.n, system.n)) if system.sparsity is None else np.empty(system.sparsity.nnz)
    system.jacobian(0.1, y, yp, cj, data)
    J = data
    if system.sparsity is not None:
        matrix = system.sparsity.copy()
        matrix.data = data
        J = matrix.toarray()
    for column in rng.choice(system.n, 25, replace=False):
        d, low, high = np.zeros(system.n), np.empty(system.n), np.empty(system.n)
        d[column] = 1e-6
        system.residual(0.1, y + d, yp + cj * d, high)
        system.residual(0.1, y - d, yp - cj * d, low)
        slope = (high - low) / 2e-6
        assert np.abs(J[:, column] - slope).max() <= 1e-6 * max(1.0, np.abs(slope).max())
        assert not np.any(slope[pattern[:, column] == 0])


def test_stages_are_evaluated_like_single_points() -> None:
    system = chain(3).system()
    rng = np.random.default_rng(7)
    t, y, yp = rng.uniform(size=3), system.y0 + 0.1 * rng.normal(size=(3, system.n)), rng.normal(size=(3, system.n))
    together, alone = np.empty((3, system.n)), np.empty((3, system.n))
    system.residual_stages(t, y, yp, together)
    for i in range(3):
        system.residual(t[i], y[i], yp[i], alone[i])
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-12)
