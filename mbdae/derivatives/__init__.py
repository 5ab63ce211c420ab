"""Derivatives of what a result shows by numbers of its scene: `Result.gradient` and `Result.sensitivity`.

The derivative of a run is that of its steps (`steps.Derived`), along them by each number, or back over them once for all numbers
where these are more than the unknowns; that of a sensor follows by differences of what the sensor reads, in the scene with the
number changed too, so that every sensor and expression has one. Its error is estimated by a run at a tenth of the tolerance,
whose derivative is returned; the tolerance falls until the accuracy of the run holds for its derivatives too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbdae.derivatives.chart import AGREED, ATTEMPTS, CLOSER, LINE, ROUNDING, Chart, Equations, Varied, reached, refused, size_of
from mbdae.derivatives.landings import MEETS, shorter, tell_another_sequence, tell_grazing, towards_touches
from mbdae.derivatives.reading import Along
from mbdae.derivatives.reading import Bound as Bound
from mbdae.derivatives.reading import Objective as Objective
from mbdae.derivatives.reading import at_end as at_end
from mbdae.derivatives.reading import integral as integral
from mbdae.derivatives.reading import largest as largest
from mbdae.errors import DerivativeError, OptionError, warn
from mbdae.formulations import form_of, system_for
from mbdae.integrators.base import Asked
from mbdae.integrators.dop853 import DOP853
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.solution import Solution
from mbdae.results.quantities import Quantity
from mbdae.results.result import Result
from mbdae.run.choice import choose, prepared_from
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem
from mbdae.values import option, sequence, shown, text

#: smallest and largest ratio of the tolerances of two runs, and the largest number of runs made for derivatives
FINER, MOST, LEVELS = 10.0, 1e4, 6
#: steps of the second of two runs, over those of the first, are at most the ratio of the tolerances to the power -1/8, the order
#: of DOP853: what a number would set in motion need not move in the run, whose steps then do not become shorter by themselves (a
#: rotor on its axis of symmetry takes 4 steps at 1e-8 and at 1e-9, and both have the same derivative, which is 100 % wrong)
ORDER = 8
#: share of a derivative that rounding leaves open, beside what differences of what a scene makes of a number do (`Chart.open`)
ROUNDED = 1e-12
#: through contacts every run has the steps of the one before halved, at a tenth of its tolerance, which asks for fewer steps:
#: errors of derivatives then fall evenly, with a power of the number of steps between that of forces that begin with the power
#: 1.5 and that of smooth motions. Where the tolerance shortens the steps, errors of two runs may be the same by chance
HALVED, OF_TOUCHES, SMOOTH = float(np.log10(2)), 1.5, 5
SURE = 6.0  #: the error told, over what remains if errors go on falling as they did
SAME = 1e-9  #: largest difference of two starts, relative to the largest unknown, that count as the same
#: arguments of `simulate` and of solvers, which are no numbers of a scene
OF_CALLS = ("accuracy", "t_end", "outputs", "solver", "form", "rtol", "atol", "step", "stages", "every", "max_wall")
NOTHING = 1e-9  #: share of a quantity, over the number, below which its derivative counts as none and needs no digits
TOLD = 10.0  #: the error of a derivative, over the accuracy times its largest value, above which a warning is issued


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


KEPT = 64  #: charts that a scene keeps, each with the scenes of eight other values: 5 MB for ten bodies

Read = Callable[[Along, int], tuple[Array, Array]]  #: (run, number of a name) -> derivative and its error by differences

class Refined:
    """The run of a result and runs of the same equations with smaller tolerances."""

    def __init__(self, result: Result, names: Sequence[str]) -> None:
        refuse_run(result)
        self.result, self.prepared, run = result, result.prepared, result.solution
        self._first: Solution | None = run
        self.solver, self.system = result.info.solver, self._system_of(run)
        if self.prepared.contacts:  # the steps of other runs end near touches, not on them
            self._first = None
        if not isinstance(self.solver, DOP853 | RadauIIA):
            self._with_other_method()
        base = Equations.of(self.prepared, self.system.stated, isinstance(self.solver, DOP853))
        for name in names:
            refuse_number(name, self.prepared.model.scene)
        self.charts = [chart_of(name, base, float(run.t[-1])) for name in names]
        self.by_name = dict(zip(names, self.charts, strict=True))
        for chart in self.charts:
            chart.refuse_moving_breaks(float(run.t[0]))

    def _system_of(self, run: Solution) -> SceneSystem:
        """The equations of the run; made again where it was stored."""
        if run.systems and isinstance(run.systems[0][1], SceneSystem):
            system = run.systems[0][1]
            if not system.assembly.passes:
                return system
        form = form_of(self.result.info.form)
        # derivatives follow all elastic vibrations, which steps may leave out of a run: velocities and forces contain them
        if self.prepared.model.elastic and hasattr(form, "waves"):
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

    def level(self, finer: float = 1.0, before: Along | None = None) -> Along:
        """The run at the tolerance of the result divided by `finer`, with its derivatives; before: the one before, at a larger
        tolerance."""
        run = self._first
        if before is not None or run is None:
            solver, asked = self.asked(finer, before)
            run = solver.run(self.system, asked)
        return Along(self.result, run, self.charts, self.system.scale, finer)

    def asked(self, finer: float = 1.0, before: Along | None = None) -> tuple[DOP853 | RadauIIA, Asked]:
        """The method and the demands on the run of `level`: where its steps end, and how long they may be."""
        solver, last = self.solver, self.result.solution if before is None else before.run
        if solver.fixed:
            solver = replace(solver, step=solver.step / finer**0.5)
        else:
            solver = replace(solver, rtol=self._tolerance(finer))
        parts, shares, contacts = [last.t[[0, -1]]], [1.0], bool(self.prepared.contacts)
        if before is not None:
            parts, shares = [last.t], [(before.finer / finer) ** (HALVED if contacts else 1 / ORDER)]
        if contacts:
            error = (self.result.accuracy.asked or 1e-6) / finer ** (SMOOTH * HALVED)
            parts += towards_touches(last, self.prepared, error)
            shares += [1.0] * (len(parts) - 1)
        return solver, Asked(float(self.result.solution.t[-1]), edges=shorter(parts, shares), impacts=solver.impacts, meets=MEETS)

    @property
    def _tightest(self) -> float:
        return float(self.solver.tightest.get(self.system.label, self.solver.tightest.get("", 1e-13)))

    def _tolerance(self, finer: float) -> float:
        """The tolerance of the run at that of the result divided by `finer`, which falls to the smallest of the method alone."""
        return float(self.solver.tolerance / finer if self.solver.fixed else max(self.solver.tolerance / finer, self._tightest))

    def _at_round_off(self, finer: float) -> bool:
        """Whether the tolerance divided by `finer` falls no further, so that runs would have shorter steps alone."""
        return not self.solver.fixed and self.solver.tolerance / finer <= (1 + ROUNDED) * self._tightest

    def derivatives(self, reads: Mapping[Any, Read]) -> Derivatives:
        """The derivatives of what `reads` make of a run, by their keys and the names of the numbers."""
        along, finer, contacts = self.level(), FINER, bool(self.prepared.contacts)
        asked = np.inf if self.result.accuracy.asked is None else self.result.accuracy.asked
        before, wrong = self._read(along, reads), dict[Any, float]()
        apart, falls = dict[Any, float](), dict[Any, float]()  # by what the runs before differ, and how that fell at least
        for runs in range(1, LEVELS - 3 * bool(self.prepared.model.lines)):  # beams take thousands of steps a run
            coarser, along, found = along, self.level(along.finer * finer, along), Derivatives()
            now, ratio = self._read(along, reads), len(along.run.t) / len(coarser.run.t)
            for key, (value, doubt) in now.items():
                off, last = size_of(value - before[key][0]), apart.get(key, 0.0)
                if runs > 1:
                    falls[key] = min(falls.get(key, np.inf), last / off if off else np.inf)
                left = remaining(off, last, falls.get(key, 0.0), ratio) if contacts else off
                rounded = (ROUNDED + self.by_name[key[1]].open) * size_of(value) + ROUNDING / NOTHING * self._slight(*key)
                found[key], apart[key] = Derivative(value, left + rounded + size_of(doubt)), off
            above, wrong = wrong, {key: self._share(one, *key) for key, one in found.items()}
            worst = max(wrong.values())
            # beyond round-off what is not as exact as asked becomes no more exact
            rounds = runs > 1 and all(wrong[key] <= asked or wrong[key] > above[key] / ratio for key in wrong)
            if (runs > contacts and worst <= asked) or (rounds if contacts else self._at_round_off(coarser.finer)):
                break
            # errors fall with the tolerance: those of the run made last are about 1/finer of what they are estimated
            before, finer = now, FINER if contacts else min(max(FINER * worst / finer / asked, FINER), MOST)
        if contacts:
            tell_grazing(along.run, self.prepared, along.derived.landings)
            tell_another_sequence(along.run, coarser.derived.landings, along.derived.landings)
        for (what, name), share in wrong.items():
            if share > TOLD * asked:
                warn(f"the derivative of {shown(what)} by '{name}' has an estimated error of {found[what, name].error:.1e}, "
                     f"{share:.1e} of its largest value; accuracy {asked:g} was asked")
        return found

    def _slight(self, what: Any, name: str) -> float:
        """A derivative that counts as none: this share of the quantity over the number."""
        varied = self.by_name[name].varied
        with self.result._silently():
            return NOTHING * size_of(np.asarray(self.result.value(what))) * varied.share / varied.distance

    def _share(self, one: Derivative, what: Any, name: str) -> float:
        """The error of a derivative over its largest value; 0 where both count as none."""
        size, slight = size_of(one.value), self._slight(what, name)
        return 0.0 if max(size, one.error) <= slight else one.error / (max(size, slight) or 1.0)

    def _read(self, along: Along, reads: Mapping[Any, Read]) -> dict[Any, tuple[Array, Array]]:
        found = {(key, chart.name): read(along, k) for k, chart in enumerate(self.charts) for key, read in reads.items()}
        along.forget()
        return {(key, chart.name): found[key, chart.name] for key in reads for chart in self.charts}


def remaining(off: float, before: float, fall: float, ratio: float) -> float:
    """Estimated error of a derivative through contacts in the finer one of two runs that differ by `off`; before: by what the
    coarser one differed from one before it; fall: how much smaller such differences became at least, 0: not known; ratio: of the
    numbers of steps. Errors are taken to fall in the mean of that and of what is sure; that two runs agree by chance does not
    count."""
    least, most = ratio**OF_TOUCHES, ratio**SMOOTH
    return float(SURE * max(off / ((least * min(max(fall, least), most)) ** 0.5 - 1), before / most**2))


def chart_of(name: str, base: Equations, t_end: float) -> Chart:
    """The chart of a number by its name, made once for a scene; DerivativeError where it has none."""
    if (name, t_end) not in base.charts:
        made = _chart_of(name, base, t_end)
        if len(base.charts) >= KEPT:
            del base.charts[next(iter(base.charts))]
        base.charts[name, t_end] = made
    return base.charts[name, t_end]


def _chart_of(name: str, base: Equations, t_end: float) -> Chart:
    varied, worst = reached(Varied(name, base, t_end)), np.inf
    for _ in range(1 + ATTEMPTS):
        if not all(varied.at(node).same_as(base) for node in varied.nodes):
            refused(name, "with another value the scene has other equations, not only other numbers in them")
        inputs, start = varied.with_jump(lambda one: one.inputs), varied.with_jump(lambda one: one.start)
        # the start is found by iteration: where it hardly depends on the number, its digits need not fit together
        excess = max(inputs.excess(base.inputs, varied.distance),
                     start.excess(base.start, varied.distance, size_of(base.start) * varied.share / varied.distance))
        if excess <= 1:
            return Chart(varied, inputs.found, start.found, AGREED * excess)
        if excess > worst:  # of what is smooth it falls with the distance to the power 6
            break
        varied, worst = varied.finer, np.inf if varied.nodes == LINE else excess / CLOSER
    refused(name, f"what the scene makes of it is not smooth at its value {varied.value or 0.0:g}; vary it from another value")
    raise AssertionError


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


# -- what is refused


def refuse_scene(prepared: Prepared, continued: Any = None, ends: bool = False) -> None:
    """Raise DerivativeError for a scene whose runs have no derivatives; for runs that begin where another ended or relaxed
    (`continued`), or that end at an event."""
    if continued is not None:
        raise DerivativeError("there are no derivatives of a run that begins where another one ended, or relaxed (start=): what "
                              "that state depends on is not known; run the scene from its own start")
    if ends:
        raise DerivativeError("there are no derivatives of a run that ends at an event (until=), whose time would move with the "
                              "numbers; run to a fixed time, and record= the event")
    scene = prepared.model.scene
    for one in scene.controllers:
        if one.memory is not None:
            raise DerivativeError(f"there are no derivatives of runs with the sampled controller '{one.name}', whose memory may "
                                  "depend on the motion: state what it remembers by expressions (s.state), or compare runs")
        if one.derivative is None:
            raise DerivativeError(f"there are no derivatives of runs with the sampled controller '{one.name}': what its function "
                                  "does is not known; give derivative=, a function of the same arguments that returns the "
                                  "derivatives of the outputs by the values, (outputs, values), or state the control law by "
                                  "expressions (s.state, s.signal)")


def refuse_number(name: str, scene: SceneData) -> None:
    """Raise DerivativeError for what is no number of the equations of a scene."""
    if name in [f"{one.name}.every" for one in scene.controllers]:
        refused(name, "it moves the instants at which the controller is called, and steps do not move with these; compare runs")
    if name.split(".")[1:] == ["section", "E"]:
        refused(name, "it is read for stresses alone: the stiffnesses EA, GA2, GA3, GJ, EI2 and EI3 of the section are numbers "
                      "of their own, and their derivatives, each times its number over E, sum up to that by E")
    if name in OF_CALLS and name not in scene.numbers:
        refused(name, "it is no number of the scene, but of the call of simulate; compare runs")


def refuse_run(result: Result) -> None:
    """Raise DerivativeError for a run without derivatives."""
    prepared, run = result.prepared, result.solution
    refuse_scene(prepared)
    if len(run.t) < 2:
        raise DerivativeError("a state at rest has no derivatives yet; compare states at rest of two values")
    if len(run.systems) > 1:
        raise DerivativeError(f"there are no derivatives of this run: the constraint rows in force change at t = "
                              f"{run.systems[1][0]:.6g} s; leave redundant joints out, or compare runs")
    end = float(run.t[-1])
    ended = [event.name for event in result.events if abs(event.time - end) <= 1e-12 * max(abs(end), 1.0)]
    if ended:
        refuse_scene(prepared, ends=True)
    fresh = prepared_from(prepared.model.scene, None, end).start
    if prepared.start.relaxed is not None:
        refuse_scene(prepared, continued=True)
    for a, b in ((prepared.start.q, fresh.q), (prepared.start.u, fresh.u), (prepared.start.s, fresh.s)):
        if prepared.start.t != fresh.t or np.any(np.abs(a - b) > SAME * np.max(np.abs(b), initial=1.0)):
            refuse_scene(prepared, continued=True)
    if not run.complete:
        raise DerivativeError("there are no derivatives of a run that was stopped before its end: let it end")
