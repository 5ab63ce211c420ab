"""What every solver does around its steps: outputs, guards, interruption, errors that say what to do."""

import signal
import time
from dataclasses import fields

import numpy as np
import pytest
from dae_problems import Explicit, blow_up, decay, pendulum
from exported_solvers import ALL, READY, solve
from scenes import physical_pendulum

from mbdae.errors import OptionError, SolverError
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.sundials import CVODE, IDA
from mbdae.system.dae import DAE

every_solver = pytest.mark.parametrize("solver", READY, ids=lambda s: s.label + (" fixed" if s.fixed else ""))


def exact(times):
    return np.outer(np.exp(-np.asarray(times)), [1, 2])


@every_solver
def test_outputs_do_not_change_the_steps(solver):
    plain = solve(solver, decay(), 2.0)
    times = [0.0, 0.123, 1.9, 2.0]
    listed = solve(solver, decay(), 2.0, outputs=times)
    spaced = solve(solver, decay(), 2.0, outputs=5)
    assert plain.outputs is None
    assert plain.complete
    assert np.array_equal(listed.t, plain.t)
    assert listed.outputs.y == pytest.approx(exact(times), abs=3e-5)
    assert spaced.outputs.t == pytest.approx([0, 0.5, 1, 1.5, 2])
    assert spaced.outputs.yp == pytest.approx(-exact(spaced.outputs.t), abs=1e-3)
    assert plain.t[-1] == 2.0
    assert plain(plain.t) == pytest.approx(plain.y, abs=3e-15)


@every_solver
def test_every_accepted_step_is_announced_once(solver):
    seen = []

    class ListsAttributes(Explicit):
        def accept(self, t, y):
            seen.append((t, *y))

    solution = solve(solver, decay(ListsAttributes), 1.0)
    assert np.array_equal(np.array(seen), np.column_stack([solution.t, solution.y])[1:])


@every_solver
def test_failure_tells_where_and_keeps_the_solution(solver):
    with pytest.raises(SolverError, match=r"stopped at t = .* of 2") as caught:
        solve(solver, blow_up(), 2.0)
    error = caught.value
    assert error.time == pytest.approx(1, abs=0.025)
    assert error.culprit == "y[0]"
    assert error.solution.t[-1] == error.time
    assert not error.solution.complete
    assert error.solution(0.5) == pytest.approx([2.0], rel=1e-3)


@every_solver
def test_equation_that_turns_into_nan_is_named(solver, capfd):
    def residual(t, y, yp, out):
        out[:] = yp + y
        if t > 0.5:
            out[1] = np.nan

    with pytest.raises(SolverError, match=r"F\[1\] is not finite near t = 0\.5") as caught:
        solve(solver, Explicit(residual, [1.0, 1.0], [-1.0, -1.0]), 1.0)
    assert caught.value.culprit == "F[1]"
    assert caught.value.time > 0.45
    assert capfd.readouterr() == ("", "")


@every_solver
def test_equation_that_is_nan_at_the_start_is_named(solver):
    broken = []

    class Broken(Explicit):
        def residual(self, t, y, yp, out):
            super().residual(t, y, yp, out)
            out[1:] = np.nan if broken else out[1:]

    system = decay(Broken)
    broken.append("after it was made")
    with pytest.raises(OptionError, match=r"equation F\[1\] is nan at the start"):
        solve(solver, system, 1.0)


@every_solver
@pytest.mark.parametrize("where", ["residual", "jacobian"])
def test_exception_of_the_system_comes_through(solver, where):
    if where == "jacobian" and not solve(solver, decay(), 1.0).stats.jacobians:
        pytest.skip("an explicit method")
    made = []

    class Broken(Explicit):
        def residual(self, t, y, yp, out):
            self.divide("residual", t > 0.3)
            super().residual(t, y, yp, out)

        def jacobian(self, t, y, yp, cj, out):
            self.divide("jacobian", bool(made))
            super().jacobian(t, y, yp, cj, out)

        def divide(self, here, now):
            if here == where and now:
                raise ZeroDivisionError("law divided by zero")

    system = decay(Broken)
    made.append(system)
    with pytest.raises(ZeroDivisionError, match="law divided by zero") as caught:
        solve(solver, system, 1.0)
    assert "raised in" in caught.value.__notes__[0]


@every_solver
def test_wall_clock_guard(solver):
    class Slow(Explicit):
        def residual(self, *arguments):
            time.sleep(1e-3)
            super().residual(*arguments)

    with pytest.raises(SolverError, match=r"max_wall = 0\.05 s") as caught:
        solve(solver, decay(Slow), 50.0, max_wall=0.05)
    assert caught.value.solution.stats.wall_s < 0.5
    assert caught.value.solution.t[0] == 0.0


@every_solver
def test_ctrl_c_comes_out_with_the_steps_so_far(solver):
    before, steps = signal.getsignal(signal.SIGINT), []

    class Interrupting(Explicit):
        def accept(self, t, y):
            steps.append(t)
            if len(steps) == 3:
                signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt, match="was interrupted at t = ") as stop:
        solve(solver, decay(Interrupting), 5.0, outputs=[0.0, 5.0])
    solution = stop.value.solution
    assert not solution.complete
    assert len(solution.t) == 4
    assert len(solution.outputs.t) == 1
    assert signal.getsignal(signal.SIGINT) is before


@every_solver
def test_progress_is_reported_sparingly(solver):
    calls = []
    solve(solver, decay(), 2.0, progress=lambda *arguments: calls.append(arguments))
    assert 1 <= len(calls) <= 3
    assert calls[0][1] == 2.0
    assert calls[0][2].steps >= 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"t_end": 0.0}, r"t_end = 0\.0 is not positive: give a time in s after the start"),
        ({"t_end": float("nan")}, "t_end = nan"),
        ({"max_wall": -1.0}, r"max_wall = -1\.0"),
        ({"h0": 0.0}, r"h0 = 0\.0"),
        ({"outputs": 1}, r"outputs = 1 is not between 2 and 1e\+07: give a number of times, 2 or more"),
        ({"outputs": [0.5, 0.4]}, r"outputs\[1\] = 0\.4 s is not after outputs\[0\] = 0\.5 s"),
        ({"outputs": [0.5, 1.4]}, r"increasing times in s from 0 to 1"),
        ({"outputs": [np.nan]}, r"outputs = \[nan\] has a wrong entry, nan is not finite"),
    ],
)
def test_arguments_of_solve(options, message):
    arguments = {"t_end": 1.0, **options}
    with pytest.raises(OptionError, match=message):
        RadauIIA().solve(decay(), **arguments)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RadauIIA(3, newton=1e-8), r"newton = 1e-08 .* without a step: give step= too"),
        (lambda: IDA(rtol=0.0), r"rtol = 0\.0 is not between 1e-15 and 0\.1: give a relative tolerance"),
        (lambda: IDA(rtol=float("nan")), "rtol = nan"),
        (lambda: IDA(max_order=6), "max_order = 6"),
        (lambda: IDA(atol=-1.0), "atol"),
        (lambda: RadauIIA(4), r"stages = 4: Radau IIA is offered with 2 \(order 3\), 3"),
        (lambda: RadauIIA(6), "stages = 6 is not between 2 and 5: Radau IIA is offered with 2"),
        (lambda: CVODE(rtol=2.0), r"rtol = 2\.0 is not between 1e-15 and 0\.1"),
        (lambda: CVODE(method="adams"), "method = 'adams' is not one of 'Adams', 'BDF': give 'Adams'"),
        (lambda: CVODE(max_order=13), "max_order = 13 is not between 1 and 12: Adams has orders 1 to 12"),
        (lambda: CVODE(method="BDF", max_order=6), "max_order = 6 is not between 1 and 5: BDF has orders 1 to 5"),
        (lambda: CVODE(1e-6, atol=[1.0]).solve(decay(), 1.0), r"atol has shape \(1,\): give one number or 2"),
        (lambda: RadauIIA(step=-0.1), "step"),
        (lambda: IDA(1e-6, atol=[1.0]).solve(decay(), 1.0), r"atol has shape \(1,\): give one number or 2"),
    ],
)
def test_options_of_solvers(make, message):
    with pytest.raises(OptionError, match=message):
        make()


@pytest.mark.parametrize("solver", ALL, ids=lambda s: s.label)
def test_every_solver_delivers_what_is_asked_and_not_much_more(solver):
    """The first steps of a method of high order are better than is asked."""
    s = physical_pendulum(60)
    fine = s.simulate(1.0, solver=RadauIIA(3, rtol=1e-11), outputs=41)
    least = 1e-4 if not solver.by_steps or solver.order <= 4 else 0.0
    for asked in (1e-3, 1e-5):
        r = s.simulate(1.0, accuracy=asked, solver=solver, outputs=41)
        error = np.abs(r["A"].angle - fine["A"].angle).max()
        assert least * asked < error < asked
        assert r.accuracy.met


@pytest.mark.parametrize("solver", ALL, ids=lambda s: s.label)
def test_every_solver_states_its_orders_or_measured_factors(solver):
    """What takes multipliers states its orders by form, other methods of constant steps state one."""
    if "step" in {f.name for f in fields(solver)}:
        assert {"GGL", "Index3"} <= set(solver.orders[solver.label]) if solver.highest_index else solver.order > 0
    if not solver.by_steps:
        assert solver.factors[solver.label]
        assert 0 < solver.tightest[""] < 1e-9


def test_looser_stages_of_constant_steps_cost_less_for_the_same_error():
    problem = pendulum("ggl_rates")
    exact = RadauIIA(3, step=0.01).solve(problem, 1.0)
    loose = RadauIIA(3, step=0.01, newton=1e-7).solve(problem, 1.0)
    assert loose.stats.newton_iterations < 0.8 * exact.stats.newton_iterations
    assert np.max(np.abs(loose(1.0) - exact(1.0))[:4]) < 1e-6


def test_accuracy_becomes_rtol():
    chosen = IDA(max_order=2).at_accuracy(1e-6, "GGL")
    assert chosen == IDA(rtol=chosen.rtol, max_order=2)
    for solver in (IDA(), RadauIIA(2), RadauIIA(3), RadauIIA(5), CVODE(), CVODE(method="BDF")):
        for form, factor in solver.factors[solver.label].items():
            assert solver.at_accuracy(1e-6, form).rtol == pytest.approx(1e-6 * factor)
    fixed = RadauIIA(2, step=0.1)
    assert fixed.fixed
    assert fixed.at_accuracy(1e-12, "GGL") is fixed
    with pytest.raises(OptionError, match=r"round-off allows is 1e-13: ask for an accuracy of 5\.0e-11 or more$"):
        IDA().at_accuracy(1e-13, "GGL")


def test_ida_refuses_index_three_and_says_why():
    with pytest.raises(OptionError, match=r"unknown .* has index 3.*silently with a wrong answer; .*form=mb\.GGL\("):
        IDA().solve(pendulum("index3"), 1.0)


def test_solution_refuses_times_outside():
    solution = RadauIIA().solve(decay(), 1.0)
    with pytest.raises(OptionError, match=r"t = .*: the time 1\.5 s is outside the solution from 0 to 1 s"):
        solution([0.5, 1.5])


def test_singular_matrix_names_the_unknown():
    system = DAE(
        lambda t, y, yp, out: np.array([yp[0] + y[0], y[0] - np.exp(-t)]), [1.0, 0.0], [-1.0, 0.0], names=["x", "idle"]
    )
    with pytest.raises(SolverError, match="singular") as caught:
        RadauIIA().solve(system, 1.0)
    assert caught.value.culprit == "idle"
    assert caught.value.time == 0.0
