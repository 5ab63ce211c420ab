"""What a solver is.

A new solver is a frozen dataclass of its options that derives from `Solver` and provides:

1. validation of its options in `__post_init__` (OptionError with the value and what to do);
2. `check(system)`: refuse systems it cannot solve;
3. `integrate(system, loop, h0)`: step from `system.t0` to `loop.t_end`, calling `loop.accept` after every
   accepted step (stop when it says so) and `loop.guard` in every rejected one, and counting into `loop.stats`;
4. `dense(t, y, yp, pieces)`: the interpolant between accepted steps;
5. `factors` and `tightest`, measured, which turn an accuracy into its `rtol`; `orders`, where its step may be constant.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from math import inf
from typing import Any, ClassVar, Self

import numpy as np

from mbdae.errors import OptionError
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.solution import Interpolant, Solution, Stats
from mbdae.system.base import Array, System

DEFAULT_ACCURACY = 1e-6
SHARE = 0.04  #: part of the width of an input of time that a constant step may cover


class Solver(ABC):
    """A method with its options; `solve` runs it on any System."""

    #: rtol / accuracy by label of the solver and of the form; measured
    factors: ClassVar[dict[str, dict[str, float]]] = {}
    #: smallest rtol that still improves the result in double precision, by label of the form ("": all others)
    tightest: ClassVar[dict[str, float]] = {}
    #: a tolerance smaller by r makes the error smaller by r**error_fall at least; measured, with its scatter
    error_fall: ClassVar[float] = 0.6
    #: tolerance of the companion run that measures the error, over that of the run
    companion: ClassVar[float] = 10.0
    #: tolerance of positions over the penetration of a contact at which it is resolved to some per cent
    penetration_share: ClassVar[float] = 0.01
    #: order of positions, velocities and multipliers with constant steps, by label of the solver and of the form
    orders: ClassVar[dict[str, dict[str, tuple[int, int, int]]]] = {}
    #: highest index of an unknown this method takes; 0: differential unknowns alone
    highest_index: ClassVar[int] = 1
    #: what to use instead below it
    alternative: ClassVar[str] = ""
    #: relative tolerance; None takes it from an accuracy (1e-6 where `solve` is called directly)
    rtol: float | None

    @classmethod
    def variants(cls) -> list[Self]:
        """The method with its options' defaults, once for every label it may have."""
        return [cls()]

    @property
    def tolerance(self) -> float:
        """rtol of a solver that runs."""
        if self.rtol is None:
            raise OptionError(f"{self.label} has no rtol yet: use at_accuracy, or give rtol")
        return self.rtol

    @property
    def fixed(self) -> bool:
        """Whether the step is constant, so that no tolerance steers it."""
        return False

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
        """Refuse a system this method cannot solve."""

    @abstractmethod
    def integrate(self, system: System, loop: StepLoop, h0: float | None) -> None:
        """Step from system.t0 to loop.t_end."""

    @abstractmethod
    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """Interpolant over the accepted steps t (m+1,), y and yp (m+1, n), with one piece per step."""

    def at_accuracy(self, accuracy: float, form_label: str) -> Self:
        """This solver with the rtol that delivers `accuracy` in the given form; itself where the step is fixed."""
        if self.fixed:
            return self
        if not (np.isfinite(accuracy) and accuracy > 0):
            raise OptionError(f"accuracy = {accuracy}: give a positive number such as 1e-6")
        measured = self.factors[self.label]
        factor = measured.get(form_label, min(measured.values()))
        rtol = accuracy * factor
        tightest = self.tightest.get(form_label, self.tightest[""])
        if rtol < tightest * (1 - 1e-9):
            raise OptionError(
                f"accuracy = {accuracy:g} needs rtol = {rtol:.1e} in {self.label} ({form_label}), where round-off "
                f"allows {tightest:g}: ask for {tightest / factor:.1e} or more{self.alternative}"
            )
        return replace(self, rtol=min(rtol, 0.1))  # type: ignore[type-var]

    def solve(
        self,
        system: System,
        t_end: float,
        outputs: int | Sequence[float] | Array | None = None,
        *,
        max_wall: float | None = None,
        progress: Callable[[float, float, Stats], None] | None = None,
        h0: float | None = None,
        max_residuals: float = inf,
        begin: float | None = None,
        share: float | None = None,
    ) -> Solution:
        """Integrate from system.t0 to t_end.

        outputs: number of equally spaced times, or the times; max_wall: s of wall time before a SolverError;
        progress(t, t_end, stats): called at most 10 times per second; h0: first step in s;
        max_residuals: evaluations before a SolverError; begin: time.perf_counter() from which max_wall counts, the start
        of this run by default; share: part of the width of an input of time that a step may cover; 1 by default,
        less where no error test shortens it.
        At a break of an input of time the run ends a step and begins anew.
        Ctrl-C comes out as KeyboardInterrupt, whose attribute `solution` is the Solution so far.
        """
        if self.rtol is None and not self.fixed:
            chosen = self.at_accuracy(DEFAULT_ACCURACY, system.label)
            return chosen.solve(
                system, t_end, outputs, max_wall=max_wall, progress=progress, h0=h0, max_residuals=max_residuals, begin=begin,
                share=share,
            )
        times = check_run(system, t_end, outputs, max_wall, h0)
        self.check(system)
        with StepLoop(system, self, float(t_end), times, max_wall, progress, max_residuals, begin) as loop:
            self._between_breaks(system, loop, h0, share)
        return loop.solution()

    def _between_breaks(self, system: System, loop: StepLoop, h0: float | None, share: float | None) -> None:
        """Integrate from break to break of the inputs of time, with consistent values at the beginning of each part."""
        line = system.timeline(loop.run_end) if system.timeline is not None else None
        if line is None:
            self.integrate(system, loop, h0)
            return
        start = system.t0, system.y0, system.yp0
        system.longest_step = line.longest_step(SHARE if share is None and self.fixed else share or 1.0)
        try:
            for a, b in pairwise(line.edges.tolist()):
                loop.t_end = b
                system.t0, system.y0, system.yp0 = a, *system.enter(a, loop.state[0], (a + b) / 2)
                loop.restart(system.y0, system.yp0)
                self.integrate(system, loop, h0 if a == start[0] else None)
        finally:
            system.t0, system.y0, system.yp0 = start
            system.longest_step = None
            system.leave()


def check_run(
    system: System,
    t_end: float,
    outputs: int | Sequence[float] | Array | None,
    max_wall: float | None,
    h0: float | None,
) -> Array | None:
    """Validate what `solve` was given and return the output times."""
    if not (np.isfinite(t_end) and t_end > system.t0):
        raise OptionError(f"t_end = {t_end}: give a finite time after the start t0 = {system.t0}")
    for name, value in (("max_wall", max_wall), ("h0", h0)):
        if value is not None and not value > 0:
            raise OptionError(f"{name} = {value}: give a positive number of seconds or None")
    times = output_times(system.t0, float(t_end), outputs)
    start = np.empty(system.n)
    system.residual(system.t0, system.y0, system.yp0, start)
    if not np.isfinite(start).all():
        row = int(np.flatnonzero(~np.isfinite(start))[0])
        raise OptionError(
            f"equation {system.equations[row]} is {start[row]} at the start t = {system.t0}: "
            "check its parameters and the start values it uses"
        )
    return times


def output_times(t0: float, t_end: float, outputs: int | Sequence[float] | Array | None) -> Array | None:
    """Times (k,) asked for; an integer means that many equally spaced ones, both ends included."""
    if outputs is None:
        return None
    if isinstance(outputs, int | np.integer):
        if outputs < 2:
            raise OptionError(f"outputs = {outputs}: give at least 2 (start and end are among them) or the times")
        return np.linspace(t0, t_end, int(outputs))
    times = np.asarray(outputs, dtype=float)
    if times.ndim != 1 or len(times) == 0 or not np.isfinite(times).all():
        raise OptionError(f"outputs has shape {times.shape}: give a number or a list of finite times")
    if times[0] < t0 or times[-1] > t_end:
        raise OptionError(f"outputs run from {times[0]} to {times[-1]}: keep them inside [{t0}, {t_end}]")
    falling = np.flatnonzero(np.diff(times) <= 0)
    if len(falling):
        k = int(falling[0])
        raise OptionError(f"outputs[{k + 1}] = {times[k + 1]} follows {times[k]}: give increasing times")
    return times


def check_tolerances(rtol: float | None, atol: Any) -> None:
    """rtol None or in [1e-15, 1e-1]; atol None, positive, or (n,) positive."""
    if rtol is not None and not 1e-15 <= rtol <= 1e-1:
        raise OptionError(f"rtol = {rtol}: give a value from 1e-15 to 1e-1")
    if atol is not None and not np.all(np.asarray(atol, dtype=float) > 0):
        raise OptionError(f"atol = {atol}: give positive values, or None for rtol times the scale of each unknown")


def absolute_tolerance(system: System, rtol: float, atol: Any) -> Array:
    """atol (n,); by default rtol times the scale of each unknown."""
    if atol is None:
        return rtol * np.asarray(system.scale, dtype=float)
    values = np.asarray(atol, dtype=float)
    if values.shape not in ((), (system.n,)):
        raise OptionError(f"atol has shape {values.shape}: give one number or {system.n}, one per unknown")
    return np.broadcast_to(values, (system.n,)).copy()
