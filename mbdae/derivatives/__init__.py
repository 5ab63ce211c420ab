"""Derivatives of what a result shows by numbers of its scene: `Result.gradient` and `Result.sensitivity`.

The derivative of a run is that of its steps (`steps.Tangent`); that of a sensor follows by differences of what the sensor reads
along the derivative of the states, in the scene with the number changed too, so that every sensor and expression has one. Its
error is estimated by a run at a tenth of the tolerance, whose derivative is returned; the tolerance falls until the accuracy of
the run holds for its derivatives too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.derivatives.chart import DISTANCE, Chart, Equations, chart_of, differenced, refuse_run, refused
from mbdae.derivatives.chart import refuse_scene as refuse_scene
from mbdae.derivatives.objectives import Objective
from mbdae.derivatives.objectives import at_end as at_end
from mbdae.derivatives.objectives import integral as integral
from mbdae.derivatives.objectives import largest as largest
from mbdae.derivatives.steps import Derived
from mbdae.errors import DerivativeError, OptionError, warn
from mbdae.formulations import form_of, system_for
from mbdae.integrators.base import Asked
from mbdae.integrators.collocation_tables import radau_table
from mbdae.integrators.dense import interval
from mbdae.integrators.dop853 import DOP853
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.solution import Solution
from mbdae.results.quantities import Quantity
from mbdae.results.result import Result
from mbdae.run.choice import choose
from mbdae.system.base import Array
from mbdae.system.scene_system import SceneSystem
from mbdae.values import option, sequence, shown, text

FINER, LEVELS = 10.0, 4  #: ratio of the tolerances of two runs, and the largest number of runs made for derivatives
TOLD = 10.0  #: the error of a derivative, over the accuracy times its largest value, above which a warning is issued
#: y' is compared on both sides of an instant, this share of the run away from it; a difference of more than JUMP times the
#: largest y' of the run counts as a jump
BESIDE, JUMP = 1e-9, 1e-5
BISECTIONS = 60
#: share of a derivative to which the differences along the run have to agree, else they are taken closer, CLOSER times at most
AGREED, CLOSER, ATTEMPTS = 1e-7, 8.0, 4
SIDES = (1, -1, 2, -2, 3, -3)  #: nodes of the differences of what is read along one unknown, which is cheap and smooth


@dataclass(frozen=True, eq=False)
class Derivative:
    """value: of a gradient a number, of a sensitivity (outputs,) or (outputs, components), in units of the quantity over those of
    the number; error: estimated largest error of the values, in the same unit."""

    value: Any
    error: float

    def __repr__(self) -> str:
        shape = np.shape(self.value)
        said = f"{self.value:.9g}" if not shape else f"{' x '.join(map(str, shape))} values"
        return f"<Derivative: {said}, error {self.error:.1e}>"


class Derivatives(dict[Any, Derivative]):
    """Derivatives by the names of the numbers, as they were given; of sensitivities by (quantity, name)."""

    def __missing__(self, key: Any) -> Derivative:
        raise OptionError(f"there is no derivative {shown(key)} among those asked for: {', '.join(map(str, self))}")


# -- one run with its tangent


@dataclass(frozen=True, eq=False)
class _Moved:
    """Interpolant of a run displaced by `by` times its derivative by number k of P."""

    of: Any
    tangent: Any
    k: int
    count: int
    by: float

    def value(self, t: Array) -> Array:
        """Unknowns (k, n) at times (k,)."""
        change = self.tangent.value(t).reshape(len(t), -1, self.count)[:, :, self.k]
        return np.asarray(self.of.value(t) + self.by * change)

    def derivative(self, t: Array) -> Array:
        """Rates (k, n) of the unknowns at times (k,)."""
        change = self.tangent.derivative(t).reshape(len(t), -1, self.count)[:, :, self.k]
        return np.asarray(self.of.derivative(t) + self.by * change)


class Along:
    """A run and its derivatives by numbers of the scene."""

    def __init__(self, result: Result, run: Solution, charts: Sequence[Chart], scale: Array) -> None:
        self.result = Result(result.prepared, run, None, result.t)  # type: ignore[arg-type]
        self.charts, self.run = charts, run
        self.derived = Derived(run, charts, scale)
        refuse_jumps(self.derived)
        self._sums: dict[int, list[tuple[Array, Array]]] = {}

    @cached_property
    def tangent(self) -> Any:
        """The derivatives of the run's unknowns, as a function of time."""
        return self.derived.tangent()

    def of(self, k: int, read: Callable[[Result], Array]) -> tuple[Array, Array]:
        """Derivative of what is read of a result by number k, and its estimated error by rounding and differences."""
        run, count = self.run, len(self.charts)
        own = self.tangent.y.reshape(len(run.t), -1, count)[:, :, k]

        def moved(one: Equations, by: float) -> Result:
            return self._result(one, _Moved(run.interpolant, self.tangent, k, count, by), run.y + by * own)

        return self._explicit(k, moved, read)

    def _explicit(self, k: int, moved: Callable[[Equations, float], Result],
                  read: Callable[[Result], Array]) -> tuple[Array, Array]:
        varied = self.charts[k].varied
        for _ in range(ATTEMPTS):
            found, doubt = varied.sum_of(lambda one, node, at=varied.distance: read(moved(one, node * at)))  # type: ignore[misc]
            if not doubt.size or doubt.max() <= AGREED * np.abs(found).max() or not np.isfinite(doubt).all():
                break
            varied = varied.closer(CLOSER)
        if not np.isfinite(found).all():
            refused(varied.name, "what is read has no finite derivative by it")
        return found, doubt

    def _result(self, at: Equations, interpolant: Any, y: Array) -> Result:
        run = replace(self.run, y=y, interpolant=interpolant, outputs=None, systems=())
        return Result(at.prepared, run, None, self.result.t)  # type: ignore[arg-type]

    def sums(self, of: Objective) -> list[tuple[Array, Array]]:
        """Derivatives of an objective by all numbers, each with its error by differences: the adjoint."""
        if id(of) not in self._sums:
            self._sums[id(of)] = self._summed(of)
        return self._sums[id(of)]

    def _summed(self, of: Objective) -> list[tuple[Array, Array]]:
        base, run, (times, weights) = self.charts[0].varied.base, self.run, of.points(self.result)

        def read(one: Result) -> Array:
            return of.read(one, times)

        ends, inner = np.zeros_like(run.y), np.zeros((len(run.t) - 1, self.derived.steps.stages - 1, run.y.shape[1]))
        ask, table, doubt = _Asked(run.interpolant), radau_table(self.derived.steps.stages), 0.0
        read(self._result(base, ask, run.y))
        step = interval(run.t, times)
        h = run.t[step + 1] - run.t[step]
        theta = (times - run.t[step]) / h
        size = np.maximum(np.abs(run.y).max(axis=0), self.derived.scale)
        for part, used in (("value", True), ("derivative", ask.asked)):
            if not used:
                continue
            basis = table.values(theta) if part == "value" else table.slopes(theta) / h[:, None]
            for j in range(run.y.shape[1]):
                by = DISTANCE * size[j] / (1.0 if part == "value" else run.t[-1] - run.t[0])

                def moved(node: int, j: int = j, by: float = by, part: str = part) -> Array:
                    return read(self._result(base, _Shifted(run.interpolant, j, node * by, part), run.y))

                found, off = differenced(moved, SIDES, by)
                given, doubt = weights * found, doubt + float(np.abs(weights) @ off) * size[j]
                np.add.at(inner[:, :, j], step, given[:, None] * basis[:, :-1])
                np.add.at(ends[:, j], step + 1, given * basis[:, -1])
                np.add.at(ends[:, j], step, given * (float(part == "value") - basis[:, -1]))
        total = self.derived.adjoint(ends, inner)
        parts = [self._explicit(k, lambda one, _: self._result(one, run.interpolant, run.y), read)
                 for k in range(len(self.charts))]
        worst = np.abs(total).max(initial=0.0) or 1.0
        return [(np.asarray(own + weights @ found), np.asarray(np.abs(weights) @ off + doubt * abs(own) / worst))
                for own, (found, off) in zip(total, parts, strict=True)]


@dataclass
class _Asked:
    """Interpolant of a run that knows whether derivatives over time were asked for."""

    of: Any
    asked: bool = False

    def value(self, t: Array) -> Array:
        """Unknowns (k, n) at times (k,)."""
        return np.asarray(self.of.value(t))

    def derivative(self, t: Array) -> Array:
        """Rates (k, n) of the unknowns at times (k,)."""
        self.asked = True
        return np.asarray(self.of.derivative(t))


@dataclass(frozen=True, eq=False)
class _Shifted:
    """Interpolant of a run with unknown j, or its rate (part: "value", "derivative"), larger by `by`."""

    of: Any
    j: int
    by: float
    part: str

    def value(self, t: Array) -> Array:
        """Unknowns (k, n) at times (k,)."""
        return self._shifted(self.of.value(t), "value")

    def derivative(self, t: Array) -> Array:
        """Rates (k, n) of the unknowns at times (k,)."""
        return self._shifted(self.of.derivative(t), "derivative")

    def _shifted(self, found: Array, part: str) -> Array:
        found = np.array(found)
        if part == self.part:
            found[:, self.j] += self.by
        return found


def refuse_jumps(of: Derived) -> None:
    """Raise DerivativeError where y' jumps at an instant that depends on the motion, at which the derivative would jump too."""
    run = of.run
    system = run.systems[0][1] if run.systems else None
    switches: Any = None if system is None else system.switches
    if switches is None or not len(run.t) > 1:
        return
    kinks = np.array([kind == "kink" for kind in switches.kinds], dtype=bool)
    if not kinks.any():
        return
    values = switches.arguments(run.t, run.y)[:, kinks]
    names = [name for name, kink in zip(switches.names, kinks, strict=True) if kink]
    for i, a in np.argwhere(values[1:] * values[:-1] < 0):
        low, high = run.t[i], run.t[i + 1]
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            at = switches.arguments(np.array([middle]), run(np.array([middle])))[0, kinks][a]
            low, high = (middle, high) if at * values[i, a] > 0 else (low, middle)
        span = BESIDE * (run.t[-1] - run.t[0])
        sides = [max(low - span, run.t[0]), min(high + span, run.t[-1])]
        with of.within((run.t[i] + run.t[i + 1]) / 2):
            jump = of.jump(np.array(sides))
        if np.any(jump > JUMP):
            raise DerivativeError(f"there are no derivatives of this run: '{names[a]}' makes accelerations jump at t = "
                                  f"{high:.6g} s, at an instant that depends on the motion, and derivatives do not pass such "
                                  "jumps yet; state it by a function without jumps, such as tanh")


Read = Callable[[Along, int], tuple[Array, Array]]  #: (run, number of a name) -> derivative and its error by differences

# -- runs at falling tolerances


class Refined:
    """The run of a result and runs of the same equations with smaller tolerances."""

    def __init__(self, result: Result, names: Sequence[str]) -> None:
        refuse_run(result)
        self.result, self.prepared, run = result, result.prepared, result.solution
        self._first: Solution | None = run
        self.solver, self.system = result.info.solver, self._system_of(run)
        if not isinstance(self.solver, DOP853 | RadauIIA):
            self._with_other_method()
        base = Equations.of(self.prepared, self.system.stated, isinstance(self.solver, DOP853))
        self.charts = [chart_of(name, base, float(run.t[-1])) for name in names]
        for chart in self.charts:
            chart.refuse_moving_breaks(float(run.t[0]))

    def _system_of(self, run: Solution) -> SceneSystem:
        """The equations of the run; made again where it was stored."""
        if run.systems and isinstance(run.systems[0][1], SceneSystem):
            system = run.systems[0][1]
            if not system.numbering.stresses or system.stated.waves:
                return system
        form = form_of(self.result.info.form)
        # derivatives follow all vibrations of beams, which steps may leave out of a run: velocities and forces contain them
        if self.prepared.model.lines and hasattr(form, "waves"):
            form, self._first = replace(form, waves=True), None  # type: ignore[type-var]
        return system_for(self.prepared, form, self.result.info.solver.highest_index)

    def _with_other_method(self) -> None:
        """Methods without derivatives: the run is repeated by one that has them."""
        accuracy = self.result.accuracy.asked or 1e-6
        choice = choose(self.prepared, self.prepared.model.scene, accuracy)
        solver, form = choice.solver, choice.form
        if not isinstance(solver, DOP853 | RadauIIA):
            solver, form = RadauIIA(3), form
        self.system = system_for(self.prepared, form, solver.highest_index)
        self.solver, self._first = solver.at_accuracy(accuracy, self.system.label), None

    def level(self, k: int) -> Along:
        """The run at the tolerance of the result divided by FINER^k, with its derivatives."""
        run, solver = self._first, self.solver
        if k or run is None:
            if solver.fixed:
                solver = replace(solver, step=solver.step / FINER ** (k / 2))
            else:
                limit = solver.tightest.get(self.system.label, solver.tightest.get("", 1e-13))
                solver = replace(solver, rtol=max(solver.tolerance / FINER**k, limit))
            run = solver.run(self.system, Asked(float(self.result.solution.t[-1])))
        return Along(self.result, run, self.charts, self.system.scale)

    def derivatives(self, reads: Mapping[Any, Read]) -> Derivatives:
        """The derivatives of what `reads` make of a run, by their keys and the names of the numbers."""
        accuracy = self.result.accuracy.asked
        before = self._read(0, reads)
        for level in range(1, LEVELS - bool(self.prepared.model.lines)):  # beams take thousands of steps a run
            now, found = self._read(level, reads), Derivatives()
            for key, (value, doubt) in now.items():
                found[key] = Derivative(value, _largest(value - before[key][0]) + _largest(doubt))
            wrong = {key: one.error / (_largest(one.value) or 1.0) for key, one in found.items()}
            if accuracy is None or max(wrong.values()) <= accuracy:
                break
            before = now
        for (what, name), share in wrong.items():
            if accuracy is not None and share > TOLD * accuracy:
                warn(f"the derivative of {shown(what)} by '{name}' has an estimated error of {found[what, name].error:.1e}, "
                     f"{share:.1e} of its largest value; accuracy {accuracy:g} was asked")
        return found

    def _read(self, level: int, reads: Mapping[Any, Read]) -> dict[Any, tuple[Array, Array]]:
        along = self.level(level)
        return {(key, chart.name): read(along, k) for key, read in reads.items() for k, chart in enumerate(self.charts)}


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values), initial=0.0))


def gradient(result: Result, of: Any, to: Any) -> Derivatives:
    """`Result.gradient`."""
    names = names_of(to)
    if not isinstance(of, Objective):
        raise OptionError(f"of = {shown(of)}: give an objective, mb.integral(...), mb.at_end(...) or mb.largest(...) of a "
                          "quantity; derivatives over time are r.sensitivity(...)")
    of.read(result, result.t[:1])  # raises the error of a quantity that is none

    def read(along: Along, k: int) -> tuple[Array, Array]:
        if len(names) > along.run.y.shape[1]:
            return along.sums(of)[k]
        times, weights = of.points(along.result)
        found, doubt = along.of(k, lambda one: of.read(one, times))
        return np.asarray(weights @ found), np.asarray(np.abs(weights) @ doubt)

    found = Refined(result, names).derivatives({of.quantity: read})
    return Derivatives((name, Derivative(float(one.value), one.error)) for (_, name), one in found.items())


def sensitivity(result: Result, of: Sequence[Quantity], to: Any) -> Derivatives:
    """`Result.sensitivity`."""
    names = names_of(to)
    if not of:
        raise OptionError("name one or more quantities, such as 'L8.force', whose derivatives over time are wanted")
    with result._silently():
        for quantity in of:
            result(result.t[:1]).value(quantity)  # raises the error of a quantity that is none

    def reader(quantity: Quantity) -> Read:
        return lambda along, k: along.of(k, lambda one: np.asarray(one.value(quantity)))

    return Refined(result, names).derivatives({quantity: reader(quantity) for quantity in of})


def names_of(to: Any) -> list[str]:
    """Names of numbers, from one text or a list of them."""
    remedy = "give the name of a number, such as 'C.spring', or a list of names"
    names = [to] if isinstance(to, str) else list(option("to", to, sequence, remedy, each=text))
    if not names or len(set(names)) < len(names):
        raise OptionError(f"to = {shown(to)}: give one or more names of numbers, each once")
    return names

