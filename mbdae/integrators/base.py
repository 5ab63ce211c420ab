"""The base class of solvers, and the options of a run."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf
from typing import Any, ClassVar, Self

import numpy as np

from mbdae.errors import OptionError, warn
from mbdae.inputs.resolution import Bound, divided, with_edges
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.record import RunRecord
from mbdae.integrators.solution import Interpolant, Solution, Stats, said
from mbdae.integrators.stored_runs import active
from mbdae.system.base import Array, System
from mbdae.threads import came, limited
from mbdae.values import array, function, number, of_class, option, optional, sequence, set_option, several, shown, text, whole

DEFAULT_ACCURACY = 1e-6
ACCURACY = "give a positive number up to 1, such as 1e-6"
MOST_OUTPUTS = 10_000_000  #: largest number of output times that may be asked for by a number
#: longest of constant steps that the user gave, as a fraction of the time scale of inputs of time (`inputs.resolution`)
SHARE = 0.04


class Solver(ABC):
    """A method with its options; `solve` runs it on any System.

    Whoever adds one derives a frozen dataclass of its options from this class; nothing else knows it. Its duties:

    1. `rtol` is a field, None where it follows from the accuracy; `__post_init__` checks all options (`set_tolerances`).
    2. `highest_index` says which unknowns it solves for; `check` refuses a System that it cannot integrate.
    3. `integrate` steps from `loop.t` and `loop.state` to `loop.t_end`, calls `loop.accept` after every accepted step, and stops
       where that returns False. No step is longer than `system.longest_step(t)`, where that is stated.
    4. It counts `residuals`, `jacobians` and `rejected` in `loop.stats`, calls `loop.guard` in a rejected step, and raises
       `loop.failure(why, unknown)` where no step succeeds.
    5. `dense` gives y and y' inside the steps.
    6. Measured: `factors`, and `tightest`, `error_fall`, `companion` where the defaults do not fit; `orders` of constant steps.
    7. `restarts` is False where `integrate` calls `loop.goes_on(self)` before its first step and `loop.keep(self)` between steps.
    8. `label` and `variants` where options change the name; `mapped` for maps; `word`, `counterparts` for names.
    """

    #: ratio rtol / accuracy that was measured, by label of the solver and of the form
    factors: ClassVar[dict[str, dict[str, float]]] = {}
    #: smallest rtol that still improves the result in double precision, by label of the form ("": all other forms)
    tightest: ClassVar[dict[str, float]] = {"": 1e-12}
    #: a tolerance r times as large (r < 1) makes the error at most r**error_fall times as large; measured, scatter included
    error_fall: ClassVar[float] = 0.6
    #: smallest ratio of the tolerance of the companion, whose distance from a run estimates its error, to that of the run
    companion: ClassVar[float] = 10.0
    #: factor on the longest step during an impact in runs whose error is estimated (CLOSER_IMPACTS of `run.control` reduces it)
    impacts: ClassVar[float] = 1.0
    #: largest ratio of position tolerance to the penetration of a contact with which that is accurate to some %
    penetration_share: ClassVar[float] = 0.01
    #: order of positions, velocities and multipliers with constant steps, by label of the solver and of the form
    orders: ClassVar[dict[str, dict[str, tuple[int, int, int]]]] = {}
    highest_index: ClassVar[int] = 1  #: of an unknown that this method can solve for; 0: ordinary differential equations only
    #: short name of the method on the command line; "": the name of the class in small letters
    word: ClassVar[str] = ""
    #: whether the method begins at order 1, and chooses its order by the error test
    starts_low: ClassVar[bool] = False
    #: whether a run stored on disk restarts the method at its checkpoints
    restarts: ClassVar[bool] = True
    rtol: float | None  #: relative tolerance; None: it is chosen from the accuracy asked for (in a direct call of `solve`, 1e-6)

    @classmethod
    def variants(cls) -> list[Self]:
        """Instances of the method with default options, one for every label that its options lead to."""
        return [cls()]

    @classmethod
    def mapped(cls) -> list[Self]:
        """Those of its variants, from low order to high, that maps of extremes run where no runs are named."""
        return [cls()]

    @property
    def tolerance(self) -> float:
        """rtol where it is a number; OptionError where it is None."""
        if self.rtol is None:
            raise OptionError(f"{self.label} has no rtol yet: give rtol, or take its method at_accuracy(accuracy, form_label)")
        return self.rtol

    @property
    def fixed(self) -> bool:
        """Whether the step is constant, so that no tolerance controls it."""
        return False

    @property
    def bdf_order(self) -> int:
        """Highest order of its backward differentiation formulas, which add energy to undamped motion above order 2; else 0."""
        return 0

    @property
    def shipped(self) -> bool:
        """Whether mbdae ships the method and has measured its orders; runs of other methods are compared with a second method."""
        return type(self).__module__.partition(".")[0] == __name__.partition(".")[0]

    @property
    def by_steps(self) -> bool:
        """Whether an accuracy is reached by shorter constant steps instead of a tolerance."""
        return False

    @property
    def label(self) -> str:
        """Short name for tables and messages."""
        return type(self).__name__

    @abstractmethod
    def check(self, system: System) -> None:
        """Raise OptionError for a system that this method cannot solve."""

    @abstractmethod
    def integrate(self, system: System, loop: StepLoop, h0: float | None) -> None:
        """Step from system.t0, which is loop.t, to loop.t_end: duties 3 and 4 of the class. h0: first step (s), None: its own."""

    @abstractmethod
    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """Interpolant over the accepted steps t (m+1,), y and yp (m+1, n), with one piece per step: what `integrate` gave to
        `loop.accept`."""

    def factor(self, form_label: str) -> float:
        """rtol over accuracy in a form; where that was not measured, the smallest ratio measured."""
        measured = self.factors.get(self.label) or {k: v for table in self.factors.values() for k, v in table.items()}
        if not measured:
            raise OptionError(f"{self.label} is given an accuracy, but its class states no `factors` (rtol over accuracy, by "
                              "form), so the rtol for it is not known: give rtol, or state `factors` in the class")
        return measured.get(form_label, min(measured.values()))

    def aimed(self, form_label: str) -> float | None:
        """The accuracy that the solver's rtol delivers in a form, by the measured `factors`; None where the step is constant."""
        if self.fixed:
            return None
        return self.tolerance / (self.factor(form_label) if self.factors else 1.0)

    @property
    def at_best(self) -> float | None:
        """The smallest accuracy that rtol delivers in any form measured; None without an rtol or measurements."""
        return self.rtol / max(self.factors[self.label].values()) if self.rtol and self.label in self.factors else None

    def at_accuracy(self, accuracy: float, form_label: str) -> Self:
        """This solver with the rtol that delivers `accuracy` in the given form; itself where the step is fixed."""
        if self.fixed:
            return self
        accuracy = option("accuracy", accuracy, number, ACCURACY, above=0, most=1)
        form_label = option("form_label", form_label, text, "give the label of a form, such as 'GGL'")
        rtol = accuracy * (factor := self.factor(form_label))
        tightest = self.tightest.get(form_label, self.tightest[""])
        if rtol < tightest * (1 - 1e-9):
            raise OptionError(f"accuracy = {accuracy:g} needs rtol = {rtol:.1e} in {self.label} with form {form_label}, where "
                              f"the least that round-off allows is {tightest:g}: ask for an accuracy of {tightest / factor:.1e} "
                              "or more")
        return replace(self, rtol=min(rtol, 0.1))  # type: ignore[type-var]

    def solve(self, system: System, t_end: float, outputs: int | Sequence[float] | Array | None = None, *,
              max_wall: float | None = None, progress: Callable[[float, float, Stats], None] | None = None,
              h0: float | None = None, max_residuals: float | None = None, begin: float | None = None,
              share: float | None = None) -> Solution:
        """Integrate from system.t0 to t_end.

        outputs: number of equally spaced times, or the times; max_wall: s of wall time before a SolverError;
        progress(t, t_end, stats): called at most 10 times per second; h0: first step in s;
        max_residuals: evaluations before a SolverError; begin: time.perf_counter() from which max_wall counts, the start
        of this run by default; share: longest step, as a fraction of the time scale on which an input of time varies
        (for a narrow pulse about its width); 1 by default, less for constant steps.
        At a break of an input of time a step ends, and the method restarts there. OptionError where another thread runs this
        System. Ctrl-C raises KeyboardInterrupt, whose attribute `solution` is the Solution so far.
        """
        asked = Asked.of(system, t_end, outputs, max_wall=max_wall, progress=progress, h0=h0, max_residuals=max_residuals,
                         begin=begin, share=share)
        if doubt := system.doubt(asked.t_end - float(system.t0)):
            warn(doubt)
        with limited(asked.max_wall if begin is None else None):
            return said(self.run(system, asked))

    def run(self, system: System, asked: Asked) -> Solution:
        """`solve` with options that have been read."""
        with system.owner.running():
            start = np.empty(system.n)
            system.residual(system.t0, system.y0, system.yp0, start)
            if not np.isfinite(start).all():
                row = int(np.flatnonzero(~np.isfinite(start))[0])
                raise OptionError(f"equation {system.equations[row]} is {start[row]} at the start t = {system.t0:g} s: check its "
                                  "parameters and the start values it uses")
            solver = self if self.fixed or self.rtol is not None else self.at_accuracy(DEFAULT_ACCURACY, system.label)
            solver.check(system)
            what = f"{solver!r} of {system.label} to {asked.t_end!r} s"
            record = RunRecord(keeper, solver.restarts, what) if (keeper := active()) else None
            with StepLoop(system, solver, asked.t_end, asked.times, asked.max_wall, asked.progress, asked.max_residuals,
                          asked.begin, asked.stop, record, asked.impacts, asked.meets) as loop, (
                              nullcontext() if record is None else record.guarding(loop)):
                solver.between_breaks(loop, asked)
                came(solution := loop.solution())
            return solution

    def between_breaks(self, loop: StepLoop, asked: Asked) -> None:
        """Integrate from one break of the inputs of time to the next, with consistent values at the beginning of each part."""
        system, h0, share, further = loop.system, asked.h0, asked.share, asked.edges
        line = None
        if system.timeline is not None:
            line = system.timeline(system.t0, loop.run_end, self.aimed(system.label))
        sampler = system.sampled(system.t0) if system.sampled is not None else None
        if line is None and sampler is None and further is None and not asked.bounds:
            self._part(loop, h0)
            return
        longest = None if line is None else line.longest_step(SHARE if share is None and self.fixed else share or 1.0)
        # a run and its companion must differ in their steps, also where only the instants of controllers bound the steps
        if sampler is not None and share is not None and share < 1:
            longest = with_edges(longest, sampler.instants(loop.run_end), share)
        if further is not None:
            inner = further[(further > system.t0) & (further < loop.run_end)]
            longest = with_edges(longest, np.concatenate([[system.t0], inner, [loop.run_end]]))
        edges = [system.t0, loop.run_end] if line is None else line.edges.tolist()
        if asked.bounds:
            own = share if share is not None and longest is None else 1.0  # else `longest` has the share already
            begins, error = edges[:-1] if self.starts_low else (), self.aimed(system.label) or 1.0
            longest = with_edges(longest, divided(asked.bounds, system.t0, loop.run_end, own, begins, error))
            longest = longest._replace(unseen=max((bound.end for bound in asked.bounds if bound.unseen), default=-inf))
        try:
            for a, b in pairwise(edges):
                if line is not None:
                    loop.system.read_at((a + b) / 2)
                for begin, end in [(a, b)] if sampler is None else sampler.parts(a, b):
                    if loop.stopped:
                        return
                    self._begin(loop, end, longest, sampler, begin == a != system.t0)
                    self._part(loop, h0 if begin == system.t0 else None)
        finally:
            system.read_at(None)

    def _begin(self, loop: StepLoop, end: float, longest: Any, sampler: Any, anew: bool) -> None:
        """Begin a part of the run, up to the time `end` (s). Consistent values are computed after a break (`anew`), and where
        outputs of controllers have changed. longest: bound of the steps."""
        t, (y, yp) = loop.t, loop.state
        held = y if sampler is None else sampler.at(t, y)
        if anew or held is not y:
            y, yp = loop.consistent(held)
        loop.t_end = end
        loop.system = loop.system.starting(t, y, yp, longest)
        loop.restart(y, yp)

    def _part(self, loop: StepLoop, h0: float | None) -> None:
        """Integrate to the end of a part of the run; before it ends the system may be replaced (`System.renewed`)."""
        loop.renew()
        self._stretch(loop, h0)
        while loop.renew() and loop.t < loop.t_end:
            self._stretch(loop, None)

    def _stretch(self, loop: StepLoop, h0: float | None) -> None:
        """Call `integrate` once, unless the steps of this call were made by an earlier process and stored on disk."""
        if not loop.made_before():
            self.integrate(loop.system, loop, h0)
            loop.ended()


@dataclass(frozen=True)
class Asked:
    """Arguments of `Solver.solve` after they have been read and checked. stop: function of the Solution so far, called now and
    then, that returns whether the run may end; edges: times (s): no step may be longer than the interval between two of them in
    which it begins; bounds: longest steps in parts of the run, times `share`; impacts: factor on the longest step during an
    impact; meets: how near to the beginning and the end of a step, over its length, a touch is there, None: as usual; wanted:
    what, by name, has an error that counts beside that of the motion; motion_alone: whether runs are not repeated for these."""

    t_end: float
    times: Array | None = None
    max_wall: float | None = None
    progress: Callable[[float, float, Stats], None] | None = None
    h0: float | None = None
    max_residuals: float = inf
    begin: float | None = None
    share: float | None = None
    stop: Callable[[Solution], bool] | None = None
    impacts: float = 1.0
    meets: tuple[float, float] | None = None
    edges: Array | None = None
    bounds: tuple[Bound, ...] = ()
    wanted: Any = None
    motion_alone: bool = False

    @classmethod
    def of(cls, system: System, t_end: Any, outputs: Any = None, *, max_wall: Any = None, progress: Any = None, h0: Any = None,
           max_residuals: Any = None, begin: Any = None, share: Any = None) -> Self:
        """Read and check all arguments before the run begins."""
        option("system", system, of_class, "give a mb.DAE, or the equations of a scene, scene.system()", base=System)
        end = end_after(system.t0, t_end)
        seconds = "give a positive number of seconds, or None"
        budget = optional("max_residuals", max_residuals, number, "give a positive number, or None", above=0)
        return cls(
            end, None if outputs is None else output_times(system.t0, end, outputs),
            optional("max_wall", max_wall, number, seconds, above=0),
            optional("progress", progress, function, "give a function progress(t, t_end, stats), or None",
                     takes="t, t_end, stats"),
            optional("h0", h0, number, seconds, above=0), inf if budget is None else budget,
            optional("begin", begin, number, "give a value of time.perf_counter(), or None"),
            optional("share", share, number, "give a part of the width of an input, or None", above=0, most=1),
        )


def end_after(t0: float, t_end: Any) -> float:
    """t_end (s), which has to be after the start."""
    end: float = option("t_end", t_end, number, f"give a time in s after the start t = {t0:g} s", above=t0)
    return end


def output_times(t0: float, t_end: float, outputs: Any) -> Array:
    """Output times (k,); a whole number stands for that many equally spaced times, both ends included."""
    remedy = (f"give a number of times, 2 or more (start and end are among them), or increasing times in s from {t0:g} to "
              f"{t_end:g}")
    if not several(outputs):
        count: int = option("outputs", outputs, whole, remedy, least=2, most=MOST_OUTPUTS)
        return np.linspace(t0, t_end, count)
    times: Array = option("outputs", outputs, array, remedy)
    if times.ndim != 1 or len(times) == 0:
        raise OptionError(f"outputs = {shown(outputs)} has shape {times.shape}: {remedy}")
    if times[0] < t0 or times[-1] > t_end:
        raise OptionError(f"outputs = {shown(outputs)} run from {times[0]:g} to {times[-1]:g} s: {remedy}")
    falling = np.flatnonzero(np.diff(times) <= 0)
    if len(falling):
        k = int(falling[0])
        raise OptionError(f"outputs = {shown(outputs)}: outputs[{k + 1}] = {times[k + 1]:g} s is not after outputs[{k}] = "
                          f"{times[k]:g} s: {remedy}")
    return times


def set_tolerances(solver: Any) -> None:
    """Read and check rtol (None, or 1e-15 to 0.1) and atol (None, positive, or n positive numbers) of a solver."""
    set_option(solver, "rtol", number, "give a relative tolerance from 1e-15 to 0.1, or None to have it follow from the accuracy",
               least=1e-15, most=1e-1)
    set_option(solver, "atol", _magnitudes, "give a positive number, one per unknown, or None for rtol times the scale of each")


def _magnitudes(value: Any) -> float | tuple[float, ...]:
    """Read atol: one positive number, or a sequence of them as a tuple."""
    return number(value, above=0) if not several(value) else tuple(sequence(value, number, above=0)) or number(value)


def absolute_tolerance(system: System, rtol: float, atol: Any) -> Array:
    """atol (n,); by default rtol times the scale of each unknown."""
    if atol is None:
        return rtol * np.asarray(system.scale, dtype=float)
    values = np.asarray(atol, dtype=float)
    if values.shape not in ((), (system.n,)):
        raise OptionError(f"atol has shape {values.shape}: give one number or {system.n}, one per unknown")
    return np.broadcast_to(values, (system.n,)).copy()

