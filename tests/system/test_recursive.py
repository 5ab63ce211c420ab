"""Recursive joints: the same motion as constraints, the exact Jacobian, the exact reactions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from recursive_scenes import SCENES, random_state, random_states

import mbdae as mb
from mbdae.formulations import GGL, Index3, system_for
from mbdae.system.base import Array
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.prepare import prepare


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("form", [GGL(algebraic=True), GGL(algebraic=False), Index3()])
def test_residual_vanishes_on_the_constrained_motion(scene: Callable[[], mb.Scene], form: object) -> None:
    """Accelerations and multipliers of the full constrained equations satisfy the recursive ones, at any state."""
    prepared = prepare(scene())
    m, e = prepared.mechanics, prepared.all_bodies
    system = system_for(prepared, form)  # type: ignore[arg-type]
    nb, rng = system.numbering, np.random.default_rng(3)
    for _ in range(5):
        t, q, u = random_state(prepared, rng)
        s = np.zeros((1, len(nb.states)))
        all_q, all_u = e.states(t, np.hstack([q, u]))
        a, lam = Mechanics(m.model, m.rows).accelerations(t, all_q, all_u, s)
        y, yp, F = np.zeros(system.n), np.zeros(system.n), np.empty(system.n)
        y[: nb.nq], y[nb.nq : nb.nq + nb.nu] = q[0], u[0]
        yp[: nb.nq] = m.rates(all_q[0], all_u[0])[nb.of_positions]
        yp[nb.nq : nb.nq + nb.nu] = a[0][nb.of_velocities]
        multipliers = lam[0][nb.rows_among(m.rows)]
        (yp if system.spec.derivatives else y)[nb.start["lambda"] : nb.start["lambda"] + nb.m] = multipliers
        system.residual(float(t[0]), y, yp, F)
        dynamics = slice(0, nb.nq + nb.nu)
        assert np.max(np.abs(F[dynamics])) < 1e-11 * (1 + np.max(np.abs(a)) + np.max(np.abs(lam), initial=0.0))


def differenced(f: Callable[[float], Array]) -> Array:
    """f'(0) by central differences of order 8: h^8 and round-off / h are near 1e-13."""
    h, weights = 2e-3, (4 / 5, -1 / 5, 4 / 105, -1 / 280)
    return sum((w * (f((k + 1) * h) - f(-(k + 1) * h)) for k, w in enumerate(weights)), np.zeros(1)) / h


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("sparse", [False, True])
def test_jacobian_is_exact(scene: Callable[[], mb.Scene], sparse: bool) -> None:
    from mbdae.system.scene_system import SceneSystem

    prepared = prepare(scene())
    system = SceneSystem(prepared, GGL(algebraic=True).spec(), sparse)
    rng = np.random.default_rng(4)
    t, q, u = random_state(prepared, rng)
    y, yp = rng.normal(size=system.n), rng.normal(size=system.n)
    y[: q.size + u.size] = np.r_[q[0], u[0]]

    def F(t: float, y: Array, yp: Array) -> Array:
        out = np.empty(system.n)
        system.residual(t, y, yp, out)
        return out

    parts = system.jacobian_parts(float(t[0]), y, yp)
    for which, part in enumerate(parts):
        if sparse:
            pattern = system.sparsity.copy()
            pattern.data = part
            part = pattern.toarray()
        for j, column in enumerate(np.eye(system.n)):
            moved = (lambda h, c=column: F(float(t[0]), y + h * c, yp)) if which == 0 else (
                lambda h, c=column: F(float(t[0]), y, yp + h * c))
            slope = differenced(moved)
            assert np.max(np.abs(part[:, j] - slope)) < 2e-10 * (1 + np.max(np.abs(slope))), system.names[j]


@pytest.mark.parametrize("scene", SCENES)
def test_reactions_are_the_multipliers(scene: Callable[[], mb.Scene]) -> None:
    """Leaf to root against the constrained equations, spatial and planar, prescribed coordinates included."""
    prepared = prepare(scene())
    m = prepared.mechanics
    for t, q, u in random_states(prepared, 50, seed=5):
        s = np.zeros((1, len(m.numbering.states)))
        a, lam = m.accelerations(t, q, u, s)
        a_full, lam_full = Mechanics(m.model, m.rows).accelerations(t, q, u, s)
        assert np.max(np.abs(a - a_full)) < 1e-11 * (1 + np.max(np.abs(a_full)))
        assert np.max(np.abs(lam - lam_full)) < 1e-11 * (1 + np.max(np.abs(lam_full)))
