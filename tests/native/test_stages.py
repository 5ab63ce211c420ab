"""Newton's iteration on the stages in C against the same in Python."""

from __future__ import annotations

from math import inf, isfinite, sqrt
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.integrators import collocation_table, radau_table
from mbdae.integrators.matrices import IterationMatrix
from mbdae.native.collocation import STAGNATION, Stages
from mbdae.native.equations import called

GAUSS = collocation_table((0.5 - sqrt(3) / 6, 0.5 + sqrt(3) / 6), 4)
TABLES = [*(radau_table(s) for s in range(1, 6)), GAUSS]


def vibration(y0: Any = (1.0, 0.0, 1.0), fail: Any = None) -> mb.DAE:
    """A stiff spring, cubic, and an algebraic unknown; fail: called with the time of every residual."""

    def residual(t: float, y: Any, yp: Any, out: Any) -> None:
        if fail is not None:
            fail(t)
        out[:] = yp[0] - y[1], yp[1] + 50 * y[0] ** 3 + 0.1 * y[1] - np.cos(t), y[2] - y[0] * y[0]

    def jacobian(t: float, y: Any, yp: Any, cj: float, out: Any) -> None:
        out[:] = [[cj, -1, 0], [150 * y[0] ** 2, cj + 0.1, 0], [-2 * y[0], 0, 1]]

    y = np.array(y0, dtype=float)
    return mb.DAE(residual, y, [y[1], 1 - 50 * y[0] ** 3 - 0.1 * y[1], 2 * y[0] * y[1]], jacobian)


def made(system: Any, table: Any, h: float) -> Stages:
    real = table.real if len(table.real) else np.array([1 / table.gamma0])
    matrix = IterationMatrix(system, real, table.pairs)
    matrix.refresh(system.t0, system.y0, system.yp0)
    matrix.factor(h)
    return Stages(called(system), table, matrix)


def reference(system: Any, table: Any, matrix: Any, Z: Any, h: float, weights: Any, target: float, limit: int, rate: Any) -> Any:
    """Converged, iterations, theta, norm and rate; Z changes."""
    previous, theta, smooth, norm = inf, 0.0, 0.0, inf
    factor, r, R = max(rate, 1e-10) ** 0.8 if isfinite(rate) else inf, len(table.real), np.empty_like(Z)
    for k in range(1, limit + 1):
        Y, Yp = system.y0 + Z, table.A_inv @ Z / h
        system.residual_stages(system.t0 + table.c * h, Y, Yp, R)
        D = table.T_inv @ (R * matrix.row)
        for j in range(r):
            D[j] = matrix.factors[j].solve(D[j])
        for j in range(len(table.pairs)):
            a = r + 2 * j
            x = matrix.factors[len(matrix.real) + j].solve(D[a] + 1j * D[a + 1])
            D[a], D[a + 1] = x.real, x.imag
        correction = -(table.T @ D) * matrix.column
        Z += correction
        norm = sqrt(np.mean((correction * weights) ** 2))
        if not isfinite(norm):
            return False, k, inf, inf, rate
        if k > 1:
            theta = norm / previous if previous else 0.0
            smooth = theta if k == 2 else sqrt(theta * smooth)
            factor = smooth / (1 - smooth) if smooth < 1 else inf
        if norm == 0.0 or factor * norm <= (target if k > 1 else min(target, 0.1)):
            return True, k, smooth, norm, factor
        slow = theta >= 0.99 or smooth >= 0.99 or smooth ** (limit - k) / (1 - smooth) * norm > max(target, STAGNATION)
        if k > 1 and norm > STAGNATION and slow:
            noise = 30 * sqrt(np.mean((matrix.noise(Y[-1], Yp[-1]) * weights) ** 2))
            return theta > 0.3 and norm <= noise, k, smooth, norm, rate
        if theta > 0.9 and norm <= STAGNATION:
            return True, k, smooth, norm, rate
        previous = norm
    return norm <= STAGNATION, limit, smooth, norm, rate


@pytest.mark.parametrize("table", TABLES, ids=lambda table: f"{len(table.c)} stages of order {table.order}")
def test_the_iteration_is_that_of_python(table: Any) -> None:
    """Short and long steps, loose tolerances and some below round-off, few iterations and many, contraction known or not."""
    system, seen = vibration(), set()
    for h in (1e-3, 0.05, 0.3, 2.0):
        for rtol in (1e-3, 1e-9, 1e-17):
            for limit in (2, 12):
                for target in (1e-3, 0.1):
                    stages = made(system, table, h)
                    weights = 1 / (rtol * (np.abs(system.y0) + 1))
                    rate = inf
                    for _ in range(2):
                        stages.predict(system.yp0, h, 0.0, None)
                        Z = stages.Z.copy()
                        assert pytest.approx(np.outer(table.c * h, system.yp0)) == Z
                        with np.errstate(all="ignore"):
                            *outcome, rate = reference(system, table, stages.matrix, Z, h, weights, target, limit, rate)
                        converged, found = stages.solve(system.t0, system.y0, h, weights, target, limit), stages.table
                        assert converged == outcome[0]
                        if found.norm > 1e-11 / rtol:  # below it corrections are round-off
                            assert found.iterations == outcome[1]
                            assert (found.theta, found.norm, found.rate) == pytest.approx((*outcome[2:], rate), rel=1e-3)
                        seen.add((converged, found.iterations > 1))
                        if converged:
                            assert pytest.approx(Z, rel=1e-9, abs=1e-12) == stages.Z
                            assert stages.Yp == pytest.approx(table.A_inv @ Z / h, rel=1e-9, abs=1e-10 / h)
    assert len(seen) >= 3


@pytest.mark.parametrize("table", TABLES, ids=lambda table: f"{len(table.c)} stages of order {table.order}")
def test_predictions_and_errors_are_those_of_the_table(table: Any) -> None:
    system, h, rng = vibration(), 0.02, np.random.default_rng(0)
    stages = made(system, table, h)
    last = rng.normal(size=stages.Z.shape)
    stages.predict(system.yp0, h, 0.015, last)
    assert pytest.approx((table.values(1 + h / 0.015 * table.c) - table.end) @ last, rel=1e-10) == stages.Z
    weights = np.array([10.0, 20.0, 30.0])
    mass = stages.matrix.entries.matrix(stages.matrix.fyp)
    rhs = mass @ (table.gamma0 * h * system.yp0 + table.e @ stages.Z) / (h * table.gamma0)
    shifted = np.empty(3)
    for careful in (False, True):
        found = stages.estimate(0.0, system.y0, system.yp0, h, weights, careful)
        error = stages.matrix.factors[0].solve(rhs * stages.matrix.row) * stages.matrix.column
        if stages.table.residuals:
            system.residual(0.0, system.y0 + error, system.yp0, shifted)
            error = stages.matrix.factors[0].solve((rhs - shifted) * stages.matrix.row) * stages.matrix.column
        assert stages.error == pytest.approx(error, rel=1e-10)
        assert stages.scaled == pytest.approx(error * weights, rel=1e-10)
        assert found == pytest.approx(sqrt(np.mean((error * weights) ** 2)), rel=1e-10)
        assert stages.table.residuals == careful


def test_what_a_residual_raises_is_raised() -> None:
    armed: list[bool] = []

    def fail(t: float) -> None:
        if armed and t > 0.005:
            raise KeyboardInterrupt("stop")

    stages = made(vibration(fail=fail), radau_table(3), 0.01)
    armed.append(True)
    with pytest.raises(KeyboardInterrupt, match="stop"):
        stages.solve(0.0, np.ones(3), 0.01, np.ones(3), 1e-3, 5)
    armed.clear()
    assert stages.equations.caught.error is None
    assert stages.solve(0.0, np.ones(3), 0.01, np.ones(3), 1e-3, 5)


def test_nothing_is_iterated_without_factors() -> None:
    system, table = vibration(), radau_table(3)
    stages = Stages(called(system), table, IterationMatrix(system, table.real, table.pairs))
    assert not stages.solve(0.0, system.y0, 0.01, np.ones(3), 1e-3, 5)
    assert stages.table.iterations == 0
    assert stages.noise(np.ones(3)) == 0


def test_tables_of_other_sizes_are_refused() -> None:
    system, two, three, five = vibration(), *map(radau_table, (2, 3, 5))
    matrix = IterationMatrix(system, three.real, three.pairs)
    other = IterationMatrix(mb.DAE(lambda t, y, yp, out: yp - y, np.ones(2), np.ones(2)), three.real, three.pairs)
    for table, given in ((two, matrix), (five, matrix), (three, other)):
        with pytest.raises(ValueError, match=r"eigenvalues|unknowns"):
            Stages(called(system), table, given)
    stages = Stages(called(system), GAUSS, IterationMatrix(system, np.empty(0), GAUSS.pairs))
    with pytest.raises(ValueError, match="needs a real eigenvalue"):
        stages.estimate(0.0, system.y0, system.yp0, 0.01, np.ones(3), False)


def test_a_time_beside_which_no_step_has_width_is_told() -> None:
    """An oscillator that starts at 1e17 s, where neighbouring numbers are 16 s apart."""
    system = mb.DAE(lambda t, y, yp, out: np.subtract(yp, [y[1], -y[0]], out=out), [1.0, 0.0], [0.0, -1.0], t0=1e17)
    with pytest.raises(mb.SolverError, match="the step became smaller than the round-off of the time t"):
        mb.RadauIIA(3, rtol=1e-6).solve(system, 1e17 + 1000)
