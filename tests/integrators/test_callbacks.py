"""Functions of the user inside a run: their exceptions come out, what they return wrongly is refused with the time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.integrators.base import Solver

SOLVERS = [mb.IDA(rtol=1e-6), mb.RadauIIA(2, rtol=1e-6), mb.RadauIIA(3, step=0.01), mb.CVODE(rtol=1e-6),
           mb.CVODE(1e-6, method="BDF")]
FAIL_AT = 0.3  #: s


class OwnError(Exception):
    """Not one of mbdae's."""


def fail(value: Any) -> Any:
    """Raises for a text, else returns the value."""
    if isinstance(value, str):
        raise OwnError(value)
    return value


def decay(late: Any) -> mb.DAE:
    """y' = -y, whose residual and right-hand side give `late` after FAIL_AT."""

    def rhs(t: float, y: Any, out: Any) -> None:
        out[:] = fail(late) if t > FAIL_AT else -y

    return mb.DAE(lambda t, y, yp, out: fail(late) if t > FAIL_AT else yp + y, [1.0], [-1.0],
                  lambda t, y, yp, cj, out: [[1 + cj]], rhs=rhs)


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.label)
def test_an_exception_of_the_equations_comes_out(solver: Solver) -> None:
    with pytest.raises(OwnError, match="mine"):
        solver.solve(decay("mine"), 1.0)


@pytest.mark.parametrize("solver", SOLVERS[:3], ids=lambda s: s.label)
@pytest.mark.parametrize("late", [np.zeros(2), np.array([1j]), [["a"]], 0.0], ids=["shape", "complex", "text", "scalar"])
def test_what_equations_return_wrongly_is_refused_with_the_time(solver: Solver, late: Any) -> None:
    with pytest.raises(mb.OptionError, match=r"^residual returns .* at t = 0\.\d+ s: return real numbers of shape \(1,\)"):
        solver.solve(decay(late), 1.0)


@pytest.mark.parametrize("solver", SOLVERS[:3], ids=lambda s: s.label)
def test_equations_that_are_not_finite_stop_the_run_before(solver: Solver) -> None:
    with pytest.raises(mb.SolverError) as stopped:
        solver.solve(decay(np.array([np.nan])), 1.0)
    assert stopped.value.time <= FAIL_AT


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.label)
def test_an_exception_of_progress_comes_out(solver: Solver) -> None:
    with pytest.raises(OwnError, match="enough"):
        solver.solve(decay(0.0), 0.2, progress=lambda t, end, stats: fail("enough"))


def test_exceptions_of_progress_come_out_of_everything_that_takes_it() -> None:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), damper=0.5)

    def stop(*_: Any) -> None:
        raise OwnError("enough")

    runs = [lambda: s.simulate(0.1, progress=stop), lambda: s.equilibrium(progress=stop),
            lambda: mb.compare(s, 0.1, ["ida"], 1e-3, progress=stop),
            lambda: mb.extremes(s, 0.1, {"rod.mass": [1.0]}, ["ida"], progress=stop)]
    for run in runs:
        with pytest.raises(OwnError, match="enough"):
            run()


def test_solver_and_form_by_name_give_the_same_run() -> None:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    best = s.simulate(0.2, solver=mb.IDA(), form=mb.GGL(), outputs=3)
    for solver, form in (("ida", "ggl"), (mb.IDA, mb.GGL), ("IDA", mb.GGL())):
        found = s.simulate(np.float32(0.2).item(), np.float64(1e-6), solver, form, outputs=np.int64(3), verify=np.False_)
        assert found["hinge"].angle[-1] == pytest.approx(best["hinge"].angle[-1], abs=1e-7)  # float32 of the end time
        assert (found.info.solver, found.info.form) == (best.info.solver, best.info.form)
    assert s.system("index3").label == s.system(mb.Index3).label == "Index3"


def test_a_right_hand_side_is_held_against_the_residual() -> None:
    """y' = -y: filled in or returned, it is what CVODE integrates; y' = y is another equation."""
    def made(rhs: Any) -> mb.DAE:
        return mb.DAE(lambda t, y, yp, out: yp + y, [1.0], [-1.0], rhs=rhs)

    for right in (lambda t, y, out: -y, lambda t, y, out: out.__setitem__(slice(None), -y)):
        assert mb.CVODE(rtol=1e-8).solve(made(right), 1.0).y[-1, 0] == pytest.approx(np.exp(-1), rel=1e-6)
    with pytest.raises(mb.OptionError, match=r"rhs contradicts the residual: F\[0\] = 2\.0.*: correct one of the two functions"):
        made(lambda t, y, out: y)
    with pytest.raises(mb.OptionError, match=r"rhs: y'\[0\] = nan at the start t = 0 s: fill every entry of out"):
        made(lambda t, y, out: None)
    with pytest.raises(mb.OptionError, match=r"rhs returns .* of shape \(2,\)"):
        made(lambda t, y, out: np.zeros(2))
