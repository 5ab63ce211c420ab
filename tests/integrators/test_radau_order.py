"""Radau IIA: its tables and the Newton iteration at extreme steps; its orders are measured in validation/integrator_orders."""

import numpy as np
import pytest
from dae_problems import pendulum, pendulum_exact

from mbdae.errors import AccuracyWarning
from mbdae.integrators import radau_table
from mbdae.integrators.matrices import IterationMatrix
from mbdae.integrators.radau import RadauIIA


@pytest.mark.parametrize("form", ["index3", "ggl", "ggl_rates"])
@pytest.mark.parametrize("stages", [2, 3])
def test_newton_at_a_step_of_a_nanosecond(form, stages):
    solution = RadauIIA(stages, step=1e-9).solve(pendulum(form), 5e-9)
    assert solution.stats.steps == 5
    assert solution.stats.newton_iterations <= 2 * solution.stats.steps
    assert solution.stats.newton_failures == 0
    assert np.abs(solution.y[-1, :2] - [1, 0]).max() < 1e-15


@pytest.mark.parametrize("form", ["index3", "ggl"])
@pytest.mark.parametrize("steps", [8, 20])
@pytest.mark.parametrize("sparse", [False, True])
def test_coarse_constant_steps_from_rest(form, steps, sparse):
    """Simplified Newton diverges in the first step here."""
    system = pendulum(form, sparsity=np.ones((5, 5) if form == "index3" else (6, 6))) if sparse else pendulum(form)
    period = 2 * np.pi / np.sqrt(9.81)
    solution = RadauIIA(3, step=period / steps).solve(system, period)
    assert solution.stats.steps == steps
    assert np.hypot(*solution.y[-1, :2]) == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("s", [1, 2, 3, 4, 5])
def test_tables_hold_their_order_conditions(s):
    table = radau_table(s)
    powers = np.arange(2 * s - 1)
    assert table.A[-1] @ table.c[:, None] ** powers == pytest.approx(1 / (powers + 1))
    assert table.A.sum(axis=1) == pytest.approx(table.c)
    if s > 1:
        assert table.A[-1] @ table.A @ table.c == pytest.approx(1 / 6)
    values = np.linalg.eigvals(table.A_inv)
    assert len(table.real) + 2 * len(table.pairs) == s == len(values)


def test_tables_with_three_stages_are_the_published_ones():
    table = radau_table(3)
    root = np.sqrt(6)
    assert table.c == pytest.approx([(4 - root) / 10, (4 + root) / 10, 1])
    assert table.A[-1] == pytest.approx([(16 - root) / 36, (16 + root) / 36, 1 / 9])
    assert table.e == pytest.approx(table.gamma0 / 3 * np.array([-13 - 7 * root, -13 + 7 * root, -1]))


def test_starting_values_from_shorter_steps():
    """Five steps per period: neither simplified nor full Newton finds the stages from the start itself."""
    period = 2 * np.pi / np.sqrt(9.81)
    solution = RadauIIA(3, step=period / 5).solve(pendulum("ggl"), period)
    assert solution.stats.steps == 5
    assert solution.stats.newton_failures > 0
    assert np.hypot(*solution.y[-1, :2]) == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("form", ["index3", "ggl"])
def test_scaled_iteration_matrix_is_well_conditioned_at_a_nanosecond(form):
    system = pendulum(form)
    matrix = IterationMatrix(system, radau_table(3).real, radau_table(3).pairs)
    matrix.refresh(0.0, system.y0, system.yp0)
    matrix.factor(1e-9)
    fy, fyp = system.jacobian_parts(0.0, system.y0, system.yp0)
    plain = fy + radau_table(3).real[0] / 1e-9 * fyp
    assert np.linalg.cond(plain) > 1e15
    assert np.linalg.cond(matrix.row[:, None] * plain * matrix.column) < 100
    x = np.arange(1.0, system.n + 1)
    assert matrix.column * matrix.factors[0].solve(matrix.row * (plain @ (x * matrix.column))) == pytest.approx(
        x * matrix.column, rel=1e-12
    )


@pytest.mark.parametrize("form", ["index3", "ggl"])
def test_newton_stops_at_round_off_far_from_the_origin(form):
    """A rod of 1 cm, 10 km from the origin: the constraint is known to 1e-12 m only."""
    for step in (1e-3, 1e-6, 1e-9):
        solution = RadauIIA(3, step=step).solve(pendulum(form, length=1e-2, pivot=1e4), 20 * step)
        assert solution.stats.steps == 20
        assert solution.stats.newton_failures == 0


@pytest.mark.parametrize("form", ["index3", "ggl"])
def test_tolerance_below_round_off_warns_instead_of_crawling(form):
    with pytest.warns(AccuracyWarning, match="round-off exceeds the tolerance at t = .* loosen rtol to"):
        solution = RadauIIA(3, rtol=1e-11).solve(pendulum(form, pivot=1e4), 0.2, max_wall=5)
    assert solution.complete
    assert solution.stats.steps < 1000
    fall = pendulum_exact(np.array([0.2]), 3.0)[0]
    assert solution.y[-1, 1] == pytest.approx(fall[1], abs=1e-7)


def test_last_step_is_cut_to_the_end():
    solution = RadauIIA(2, step=0.3).solve(pendulum("ggl"), 1.0)
    assert solution.t == pytest.approx([0, 0.3, 0.6, 0.9, 1.0])
    assert RadauIIA(2, step=0.1).solve(pendulum("ggl"), 1.0).stats.steps == 10
