"""A second method, Radau IIA, by which runs of a user's own method are checked: a comparison of such runs with each other cannot
show that the method converges to a wrong solution, or has another order than it states.

Constant steps from an accuracy: two runs with different steps estimate the error, the order of the method gives the next step.

An estimate made inside a single step was measured not to follow the tolerance; two runs compared over their whole length do.

Methods with constant steps: given, or found from an accuracy by runs with two different steps.
"""

from __future__ import annotations

import time
import warnings
from contextlib import nullcontext
from copy import copy
from dataclasses import dataclass, replace
from math import ceil, floor, inf, isfinite, log, log10
from typing import Any, ClassVar, Self

import numpy as np

from mbdae.errors import AccuracyWarning, LawError, OptionError, SolverError, WallClockError, keeping
from mbdae.integrators.base import ACCURACY, DEFAULT_ACCURACY, Asked, Solver
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.solution import Beside, Measure, Solution, check_times, scaled_distance
from mbdae.system.base import Array, System
from mbdae.values import number, option, set_option, text

TIGHTER = 10.0  #: ratio of the accuracy asked for to that for which the first run of Radau IIA is made
AGAIN = 30.0  #: ratio of the tolerance of a run of Radau IIA to that of the next run
#: two runs of Radau IIA confirm each other where the accuracy asked for is at least this many times their distance
AGREE = 3.0
MOST = 4  #: largest number of runs of Radau IIA
#: a warning says that the estimate is wrong where the distance from Radau IIA is above this many times the estimate, and above
#: the accuracy asked for
CLEARLY = 2.0


class SecondMethod:
    """A run of Radau IIA, made when it is first needed, and the distance of other runs from it. runs, cpu_s: number of runs that
    were made for it, and their CPU time (s)."""

    def __init__(self, solver: Solver, system: System, asked: Asked, accuracy: float, measure: Measure) -> None:
        self._solver, self._system, self._measure = solver, system, measure
        self._asked = replace(asked, times=None, progress=None, h0=None, share=None)
        method = RadauIIA(3)
        self._rtol = min(method.factor(system.label) * accuracy / TIGHTER, 0.1)
        self._tightest = method.tightest.get(system.label, method.tightest[""])
        self._method, self._apart = method, accuracy / AGREE
        self._run: Solution | None = None
        self.runs, self.cpu_s, self._why_not = 0, 0.0, ""

    def distance(self, run: Solution, estimate: float) -> float:
        """Largest distance of a run from the run of the second method; `estimate`, the estimated error of the run by its own
        method, where that is larger or the second method fails."""
        if not self.runs:
            self._solve()
        if self._run is None:
            return estimate
        return max(Beside(run, check_times(run), self._measure).distance(self._run), estimate)

    def tell(self, estimate: float, distance: float, accuracy: float) -> None:
        """Warn where the `distance` of a run from the second method contradicts its `estimate`, and where the second method
        failed."""
        name = self._solver.label
        if self._why_not:
            warnings.warn(f"{name}: its runs agree with each other, but no second method could confirm them ({self._why_not}), "
                          f"so the estimated error stands on {name} alone: compare with a run of another solver yourself",
                          AccuracyWarning, stacklevel=2)
        elif distance > max(CLEARLY * estimate, accuracy):
            warnings.warn(f"{name} differs by {distance:.1e} from {self._method.label}, while its own runs with shorter steps or "
                          f"tolerances differ by {estimate:.1e}: measure its order by mb.measure_order, and check its "
                          f"coefficients", AccuracyWarning, stacklevel=2)

    def _solve(self) -> None:
        """Make runs of Radau IIA with smaller and smaller tolerances until two of them agree."""
        known, apart, rtol = None, inf, self._rtol
        while self.runs < MOST and apart > self._apart and (known is None or rtol >= self._tightest):
            self.runs += 1
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", AccuracyWarning)
                    found = replace(self._method, rtol=max(rtol, self._tightest)).run(self._system, self._asked)
            except WallClockError:
                raise
            except (SolverError, OptionError) as error:
                self._why_not = str(error)
                return
            self.cpu_s += found.stats.cpu_s
            apart = Beside(found, check_times(found), self._measure).distance(known) if known is not None else inf
            known, rtol = found, rtol / AGAIN
        if apart <= self._apart:
            self._run = known
        else:
            self._why_not = f"runs of {self._method.label} at two tolerances differ by {apart:.1e}"


def second_method(solver: Solver, system: System, asked: Asked, accuracy: float, measure: Measure) -> SecondMethod | None:
    """The second method for a user-defined method; None for methods that mbdae ships, whose orders are measured."""
    return None if solver.shipped else SecondMethod(solver, system, asked, accuracy, measure)


#: largest order that an estimate assumes because the method states it; a higher order has to show in the differences of three
#: runs: where a kink reduces the order to 2, an estimate with order 8 is 85 times too small
BELIEVED = 2
SAFETY = 0.5  #: the step of the next run is chosen for this fraction of the accuracy
MOST_STEPS = 300_000
#: number of complete runs after which the search for a step ends, and of failed runs after which the error of the last one is
#: raised
RUNS, FAILURES = 7, 7
#: the search ends where a shorter step leaves more than this fraction of the distance from the second method
FALLS = 0.9
#: estimated relative error from which on a run counts as diverged: no step is predicted from such a run, and the next one has a
#: quarter of its step
DIVERGED = 100.0
#: smallest ratio of the next step to the present one that an estimate may ask for; a kink or peak may ask for a smaller one
SHORTEST = 0.01
#: largest first step: as a fraction of the run (LONGEST) and of the time in which an unknown would change, at its rate at the
#: start, by its scale plus its magnitude (FIRST)
LONGEST, FIRST = 1 / 20, 0.1
#: longest step of the first run, as a fraction of the time scale on which an input varies; reduced in proportion to the step
SHARE = 0.5
#: smallest ratio of the finer to the coarser step of two runs whose difference is taken as the final estimate; where the ratio is
#: smaller, the finer run is compared with a further run that has steps twice as long as its own
NEARBY = 0.24
COARSER = "the run attached (attribute `solution`, step = {:g} s) is complete, its error is not known"
#: kinds of unknowns whose rates do not bound the first step, and whose errors do not count in a direct call of `solve`
ALGEBRAIC = ("lambda", "mu", "z")


@dataclass(frozen=True)
class Halved:
    """The finest run, its solver with the step, the estimate of its error, the number of runs and their CPU seconds. coarser: the
    run that it was compared with, whose margin is the assumed ratio of the finest run's error to their difference."""

    solution: Solution
    solver: Any
    estimate: float
    runs: int
    cpu_s: float
    coarser: Beside | None = None
    own: float = inf  #: the estimate by runs of this method alone, without a second method
    told: tuple[tuple[float, float], ...] = ()  #: step (s), and estimate without a second method, of each run after the first


def halved(solver: Any, system: System, asked: Asked, accuracy: float, measure: Measure,
           second: SecondMethod | None = None) -> Halved:
    """Run with ever shorter steps until the estimate is below `accuracy`, or RUNS runs are made. second: the second method, which
    has to confirm the estimates of a method that mbdae does not ship.

    Raises SolverError, with the last run attached, where more than MOST_STEPS steps would be needed."""
    found = _halved(solver, system, asked, accuracy, measure, second)
    if second is None:
        return found
    distance = second.distance(found.solution, found.estimate)
    second.tell(found.own, distance, accuracy)
    return replace(found, estimate=distance, runs=found.runs + second.runs, cpu_s=found.cpu_s + second.cpu_s)


def _halved(solver: Any, system: System, asked: Asked, accuracy: float, measure: Measure,
            second: SecondMethod | None) -> Halved:
    """The runs of `halved`. No further run is made where shorter steps do not reduce the distance from the second method."""
    t_end, asked = asked.t_end, replace(asked, begin=time.perf_counter() if asked.begin is None else asked.begin)
    h, coarse, spent, runs = _first_step(system, t_end), None, 0.0, 0
    first, span = h, t_end - float(system.t0)
    best: Halved | None = None
    failures, confirmed = 0, inf
    most = 1 if system.guard_jumps else solver.order  # where contact forces jump, steps across the jump are of order 1
    order, earlier = float(min(most, BELIEVED)), (inf, inf)
    while runs - failures < RUNS:
        now = solver.with_step(h := _dividing(h, span))
        runs += 1
        try:
            with keeping(best.solution, COARSER.format(best.solver.step)) if best is not None else nullcontext():
                fine = now.run(system, replace(asked, share=SHARE * h / first))
        except WallClockError:
            raise
        except (SolverError, LawError) as error:  # a law may raise an error at the states of a run that diverges
            failures += 1
            partial = getattr(error, "solution", None)
            spent += partial.stats.cpu_s if partial is not None else 0.0
            if failures >= FAILURES or (best is not None and best.estimate < DIVERGED and not best.solution.stats.unresolved):
                raise
            h /= 4
            continue
        spent += fine.stats.cpu_s
        if coarse is None:
            coarse, best = (fine, h), Halved(fine, now, float("inf"), runs, spent)
            h = min(h / 2, resolving if (resolving := fine.stats.resolving_step) > span / MOST_STEPS else h)
            continue
        coarser = Beside(coarse[0], check_times(coarse[0]), measure)
        gap = coarser.distance(fine)
        order, earlier = _order(order, most, earlier, (gap, coarse[1])), (gap, coarse[1])
        coarser = replace(coarser, margin=_share(h / coarse[1], order))
        estimate = inf if fine.stats.unresolved else gap * coarser.margin
        if estimate <= accuracy and h < NEARBY * coarse[1]:  # a far longer step may alias a vibration: compare with step 2 h
            with keeping(fine, COARSER.format(h)):
                near = solver.with_step(2 * h).run(system, replace(asked, share=2 * SHARE * h / first))
            runs, spent = runs + 1, spent + near.stats.cpu_s
            coarser = Beside(near, check_times(near), measure, _share(0.5, order))
            estimate = coarser.error(fine)
        own, stalled = estimate, False
        if estimate <= accuracy and second is not None:
            estimate = second.distance(fine, estimate)
            stalled, confirmed = estimate > FALLS * confirmed, estimate  # stalled: both methods converge, to different solutions
        best = Halved(fine, now, estimate, runs, spent, coarser, own, (*best.told, (h, own)) if best is not None else ())
        if estimate <= accuracy or stalled:
            return best
        coarse = fine, h
        wanted = max((SAFETY * accuracy / estimate) ** (1 / solver.order) if estimate < DIVERGED else 0.25, SHORTEST)
        if fine.stats.unresolved:  # the step must resolve a kink or peak of a law, whose error the estimate does not include
            wanted = fine.stats.resolving_step / h
        if span / (h * wanted) > MOST_STEPS:
            if own <= accuracy:
                return best
            raise _too_dear(best, h * wanted, span, accuracy)
        h *= float(min(wanted, 0.5))
    assert best is not None
    return best


def _first_step(system: System, t_end: float) -> float:
    slow = np.array([kind not in ALGEBRAIC for kind in system.kinds])
    rate = float(np.max((np.abs(system.yp0) / (np.asarray(system.scale) + np.abs(system.y0)))[slow], initial=0.0))
    span = t_end - float(system.t0)
    return min(LONGEST * span, FIRST / rate if rate > 0 else span)


def _dividing(h: float, span: float) -> float:
    """The largest step up to h (s) that divides a run of `span` (s) into an even number: a last step that is cut has multipliers
    that are far off (measured with index 3: by 4e-3, where the others were off by 7e-6)."""
    return span / (2 * ceil(span / (2 * h) * (1 - 1e-12)))


def _share(ratio: float, order: float) -> float:
    """Ratio of the error of the finer of two runs to their distance, for a method of this order; ratio: finer / coarser step."""
    fallen = float(ratio**order)
    return fallen / (1 - fallen)


def _order(believed: float, stated: float, earlier: tuple[float, float], now: tuple[float, float]) -> float:
    """The order of a method, observed from two pairs of neighbouring runs: at least `believed`, the order assumed so far, at most
    `stated`, that of the method. earlier, now: distance of a pair, and the step of its coarser run."""
    (gap0, h0), (gap1, h1) = earlier, now
    shown = log(gap0 / gap1) / log(h0 / h1) if 0 < gap1 < gap0 < inf else 0.0
    return min(stated, max(believed, shown))


def _too_dear(best: Halved, h: float, span: float, accuracy: float) -> SolverError:
    solution, steps = best.solution, span / h
    cpu = solution.stats.cpu_s * steps / max(solution.stats.steps, 1)
    reached = best.estimate * (solution.stats.steps / MOST_STEPS) **best.solver.order
    advice = (f"has an estimated error of {best.estimate:.1e}. Ask for an accuracy of {_up(reached / SAFETY)} or more, or use "
              f"mb.RadauIIA(3)" if isfinite(reached) else
              f"passes over what the law of '{next(iter(solution.stats.unresolved), '')}' does within a step. Use mb.RadauIIA(3)")
    text = (f"{best.solver.label}: accuracy {accuracy:g} needs about {steps:.1e} steps of {h:.1e} s and {cpu:.0f} s of CPU, more "
            f"than the {MOST_STEPS:.0e} steps allowed; the finest run made, attribute `solution` of this error, {advice}")
    return SolverError(text, float(solution.t[-1]), "", solution)


def _up(value: float) -> str:
    """A positive number rounded up to one significant digit, as text."""
    power = 10.0 ** floor(log10(value))
    return f"{ceil(value / power * (1 - 1e-12)) * power:.0e}"


class Stepped(Solver):
    """Base of methods with the options `step` and `accuracy`, of which one may be given. order: the errors of positions and
    velocities fall with step**order."""

    step: float | None
    accuracy: float | None
    order: ClassVar[int]

    @property
    def fixed(self) -> bool:
        """Whether a step is given."""
        return self.step is not None

    @property
    def by_steps(self) -> bool:
        """True: these methods reach an accuracy by shorter constant steps."""
        return True

    def _set_step(self) -> None:
        set_option(self, "step", number, "give a positive number of seconds, or None", above=0)
        set_option(self, "accuracy", number, f"{ACCURACY}, or None", above=0, most=1)
        if self.step is not None and self.accuracy is not None:
            raise OptionError(f"step = {self.step:g} and accuracy = {self.accuracy:g}: give one of the two")

    def at_accuracy(self, accuracy: float, form_label: str) -> Self:
        """This method with steps shortened until its error is below `accuracy`; unchanged where the step is given."""
        if self.fixed:
            return self
        option("form_label", form_label, text, "give the label of a form, such as 'GGL'")
        return self._with(accuracy=option("accuracy", accuracy, number, ACCURACY, above=0, most=1))

    def with_step(self, step: float) -> Self:
        """This method with a constant step, s."""
        return self._with(step=step, accuracy=None)

    def _with(self, **options: Any) -> Self:
        """A copy with other values of some options. The constructor is not called again, so that attributes that a user's own
        constructor has set are kept."""
        made = copy(self)
        for name, value in options.items():
            object.__setattr__(made, name, value)
        return made

    def run(self, system: System, asked: Asked) -> Solution:
        """Integrate with the given step, or with steps shortened until the error of all unknowns but multipliers, over their
        scale, is below `accuracy` (1e-6 where none is given)."""
        if self.fixed:
            return super().run(system, asked)
        goal = self.accuracy if self.accuracy is not None else DEFAULT_ACCURACY

        def measure(t: Array, a: Array, b: Array) -> Array:
            return scaled_distance(system, a, b, ALGEBRAIC)

        return halved(self, system, asked, goal, measure, second_method(self, system, asked, goal, measure)).solution
