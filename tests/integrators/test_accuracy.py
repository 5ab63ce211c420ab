"""What a tolerance delivers: the pendulum, adaptive, at steps and between them."""

import numpy as np
import pytest
from dae_problems import Explicit, decay, pendulum, pendulum_exact

from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.sundials import CVODE, IDA
from mbdae.system.dae import DAE

T = 3.0
#: solver, form, largest error of (x, y) in units of rtol
RUNS = [
    (IDA(), "ggl_rates", 100),
    (RadauIIA(3), "ggl", 3),
    (RadauIIA(3), "ggl_rates", 3),
    (RadauIIA(3), "index3", 40),
    (RadauIIA(2), "ggl", 40),
]
RTOLS = [1e-3, 1e-4, 1e-6, 1e-8, 1e-10]


def between(times):
    """Three times in every step."""
    return np.concatenate([times[:-1] + share * np.diff(times) for share in (0.25, 0.5, 0.75)])


@pytest.mark.parametrize(("solver", "form", "bound"), RUNS, ids=lambda value: getattr(value, "label", str(value)))
def test_pendulum(solver, form, bound):
    system = pendulum(form)
    for rtol in RTOLS if solver.label != "RadauIIA(2)" else RTOLS[:3]:
        solution = type(solver)(**{**vars(solver), "rtol": rtol}).solve(system, T)
        inside = between(solution.t)
        at_steps = np.abs(solution.y[:, :4] - pendulum_exact(solution.t, T)).max(axis=0)
        dense = np.abs(solution(inside)[:, :4] - pendulum_exact(inside, T)).max(axis=0)
        stats = solution.stats
        print(
            f"{solver.label:12s} {form:9s} rtol {rtol:.0e}: q {at_steps[:2].max() / rtol:8.2f} rtol, "
            f"between {dense[:2].max() / rtol:8.2f}, v {at_steps[2:].max() / rtol:8.2f}, "
            f"steps {stats.steps}, residuals {stats.residuals}, jacobians {stats.jacobians}"
        )
        assert at_steps[:2].max() < bound * rtol
        if (solver.label, form) == ("RadauIIA(3)", "ggl") and rtol <= 1e-6:
            assert stats.rejected <= 2
            assert stats.newton_failures == 0
            assert stats.jacobians < stats.steps
        if solver.label == "IDA":
            assert stats.rejected < stats.steps / 20
        assert dense[:2].max() < 1.5 * at_steps[:2].max() + rtol


@pytest.mark.parametrize("solver", [IDA(1e-9), RadauIIA(3, rtol=1e-9), RadauIIA(2, rtol=1e-7), RadauIIA(3, step=0.01)])
def test_derivative_between_steps(solver):
    solution = solver.solve(pendulum("ggl_rates"), 1.0)
    times = np.linspace(0.05, 1, 37)
    assert solution.derivative(times)[:, :2] == pytest.approx(pendulum_exact(times, T)[:, 2:], abs=2e-4)
    assert solution.derivative(0.5).shape == (6,)
    assert solution(times[:, None]).shape == (37, 1, 6)


@pytest.mark.parametrize("solver", [IDA(1e-8), RadauIIA(3, rtol=1e-8), RadauIIA(2, rtol=1e-6), RadauIIA(2, step=0.05)])
def test_sparse_and_dense_agree(solver):
    pattern = np.array(
        [
            [1, 0, 1, 0, 0, 1],
            [0, 1, 0, 1, 0, 1],
            [1, 0, 1, 0, 1, 0],
            [0, 1, 0, 1, 1, 0],
            [1, 1, 0, 0, 0, 0],
            [1, 1, 1, 1, 0, 0],
        ]
    )
    dense = solver.solve(pendulum("ggl_rates"), 1.0)
    sparse = solver.solve(pendulum("ggl_rates", sparsity=pattern), 1.0)
    assert sparse.y[-1, :4] == pytest.approx(dense.y[-1, :4], abs=1e-6 if solver.label == "IDA" else 1e-9)


def test_stiff_transient_is_followed_and_left():
    """y' = -1e6 (y - cos t): the step grows from the transient to the slow solution."""
    k = 1e6
    system = DAE(
        lambda t, y, yp, out: yp + k * (y - np.cos(t)), [2.0], [-k], lambda t, y, yp, cj, out: np.array([[k + cj]])
    )
    solution = RadauIIA(3, rtol=1e-6).solve(system, 10.0)
    assert solution.y[-1, 0] == pytest.approx(np.cos(10 - 1e-6), abs=1e-7)
    assert solution.stats.h_min < 1e-6 < 0.1 < solution.stats.h_max
    assert solution.stats.steps < 100


def test_work_is_counted():
    calls = {"residual": 0}

    class Counted(Explicit):
        def residual(self, *arguments):
            calls["residual"] += 1
            super().residual(*arguments)

    system = decay(Counted)
    for solver in (IDA(1e-6), RadauIIA(3), RadauIIA(2), CVODE(1e-6), CVODE(1e-6, method="BDF")):
        calls["residual"] = 0
        stats = solver.solve(system, 2.0).stats
        assert stats.residuals == calls["residual"] - 1  # one more to check the start
        assert 0 < stats.h_min <= stats.h_max
        assert stats.jacobians > 0
        assert stats.cpu_s >= 0


def test_linear_system_keeps_its_jacobian_and_mostly_its_step():
    A = np.array([[0.0, -1.0], [1.0, 0.0]])
    system = DAE(
        lambda t, y, yp, out: yp + A @ y, [1.0, 0.0], [0.0, -1.0], lambda t, y, yp, cj, out: A + cj * np.eye(2)
    )
    stats = RadauIIA(3, rtol=1e-6).solve(system, 100.0).stats
    assert stats.jacobians == 1
    assert stats.factorisations < stats.steps / 10
