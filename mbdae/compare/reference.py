"""The reference of a comparison: the tightest Radau run, confirmed by a second method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbdae.compare.equations import Equations
from mbdae.compare.problem import Problem
from mbdae.errors import MbdaeError, OptionError
from mbdae.integrators.base import Solver
from mbdae.results.result import Result
from mbdae.system.base import Array
from mbdae.values import array, function, option

TIGHTER = 100.0  #: ratio of the smallest accuracy asked of the runs to that asked of the reference, which is FLOOR at least
#: ratio of the smallest accuracy asked of the runs to that asked of the second method (FLOOR at least); IDA, where it does not
#: confirm the reference, is run again with an accuracy 30 times smaller
CONFIRM = 10.0
FLOOR = 1e-11


@dataclass(frozen=True)
class Reference:
    """The run against which errors are measured. difference: largest difference of the second method's run from it, in the unit
    of the measure; None without a second method."""

    label: str
    accuracy: float | None
    confirmed_by: str | None
    difference: float | None
    steps: int | None = None
    cpu_s: float | None = None
    note: str | None = None

    @property
    def trusted(self) -> bool:
        """Whether the user gave the reference, or a second method differs from it by at most a third of the smallest accuracy."""
        return self.note is None

    def __str__(self) -> str:
        second = f"; {self.confirmed_by} differs by {self.difference:.1e}" if self.difference is not None else ""
        return self.label + second + (f"; {self.note}" if self.note else "")


def refuse_no_reference(given: Any) -> None:
    """OptionError where `given` is neither None, a Result nor a function of the times."""
    if given is not None and not isinstance(given, Result):
        option("reference", given, function, "give a Result, a function of the times (nt,), or None to have one computed",
               takes="times")  # fmt: skip


def given_reference(problem: Problem, given: Any) -> tuple[Reference, Any]:
    """A reference given by the user: a Result of the same scene, or values of the measure as a function of time."""
    if isinstance(given, Result):
        return _given_result(problem, given)
    if problem.measure is None:
        raise OptionError("reference is a function: name the sensor whose values it returns, such as measure='C.angle'")
    values: Array = option("reference(times)", given(problem.times), array, f"return {problem.measure} at the times given")
    shape = problem.values(problem.solve(_radau(problem, 1e-3), None, repeat=False).solution).shape
    if values.shape != shape:
        raise OptionError(f"reference returns an array of shape {values.shape}; {problem.measure} at the times given has shape "
                          f"{shape}")  # fmt: skip
    return Reference("given function", None, None, None), values


def _given_result(problem: Problem, given: Result) -> tuple[Reference, Any]:
    if problem.scene is None:
        raise OptionError("reference is the Result of a scene, but what is compared is a System, not a scene; leave reference "
                          "out")  # fmt: skip
    bodies = [b.name for b in problem.scene.bodies]
    other, end = [b.name for b in given.prepared.model.scene.bodies] != bodies, given.solution.t[-1]
    if other or end < problem.t_end:
        why = "of a scene with other bodies" if other else f"that ends at t = {end:g} s"
        raise OptionError(f"reference is a Result {why}; give one of this scene to t = {problem.t_end:g} s")
    label = f"given result, {given.solution.solver.label} {given.info.form}"
    return Reference(label, given.accuracy.asked, None, None), problem.values(given.solution, Equations(given.prepared))


def computed_reference(problem: Problem, smallest: float) -> tuple[Reference, Any]:
    """The tightest Radau run and its values; its difference from a second method is its uncertainty."""
    system = problem.system(None)
    solver = _radau(problem, max(smallest / TIGHTER, FLOOR))
    run = problem.solve(solver, problem.resolving, repeat=False)
    values = problem.values(run.solution)
    label = f"{solver.label} {system.label}, rtol {solver.tolerance:.1e}{', vibrations resolved' if problem.resolving else ''}"
    found = Reference(label, max(smallest / TIGHTER, FLOOR), None, None, run.solution.stats.steps, run.cpu_s)
    reasons: list[str] = []
    made = [(f"{solver.label} {system.label}, rtol {solver.tolerance:.1e}", found.steps, run.cpu_s, values)]
    for second in _seconds(problem, smallest):
        try:
            other = problem.solve(second, problem.resolving, repeat=False)
        except MbdaeError as error:
            reasons.append(str(error))
            continue
        name = f"{second.label} {system.label}, rtol {second.tolerance:.1e}"
        made.append((name, other.solution.stats.steps, other.cpu_s, problem.values(other.solution)))
        gap = problem.error(made[-1][-1], values)
        if gap <= smallest / 3:
            return replace(found, confirmed_by=name, difference=gap), values
    if len(made) == 1:
        return replace(found, note="not confirmed by a second method: " + "; ".join(reasons)), values
    return _of_the_nearest(problem, found, made)


def _of_the_nearest(problem: Problem, first: Reference, made: Sequence[tuple[str, int | None, float | None, Any]]
                    ) -> tuple[Reference, Any]:  # fmt: skip
    """The reference where no second run confirms the first: of the two runs with the smallest difference the one that was made
    earlier, with that difference as its uncertainty. made: (name, number of steps, CPU time in s, values) of every run."""
    pairs = [(problem.error(made[j][-1], made[i][-1]), i, j) for j in range(len(made)) for i in range(j)]
    gap, i, j = min(pairs)
    name, steps, cpu, values = made[i]
    own = first if i == 0 else Reference(name, None, None, None, steps, cpu)
    return replace(own, confirmed_by=made[j][0], difference=gap, note=f"errors below {gap:.0e} are not known"), values


def _radau(problem: Problem, accuracy: float) -> Solver:
    from mbdae.integrators.runge_kutta.radau import RadauIIA

    return as_tight(RadauIIA(3), accuracy, problem.system(None).label)


def _seconds(problem: Problem, smallest: float) -> list[Solver]:
    """Second methods in the order in which they are tried. IDA is tried again with a smaller tolerance, because the difference
    from the reference may be its own error."""
    from mbdae.integrators.runge_kutta.radau import RadauIIA
    from mbdae.integrators.sundials.ida import IDA

    label = problem.system(None).label
    tries: list[tuple[Solver, float]] = [(IDA(), CONFIRM), (IDA(), 30 * CONFIRM), (RadauIIA(2), CONFIRM)]
    if np.max(problem.system(None).index) > 1 or problem.resolving is not None:
        tries = tries[2:]
    return [as_tight(method, max(smallest / factor, FLOOR), label) for method, factor in tries]


def as_tight(solver: Solver, accuracy: float, form_label: str) -> Solver:
    """The solver with the tolerance for an accuracy, or with its smallest tolerance where round-off does not allow that
    accuracy."""
    try:
        return solver.at_accuracy(accuracy, form_label)
    except OptionError:
        return replace(solver, rtol=solver.tightest.get(form_label, solver.tightest[""]))  # type: ignore[type-var]
