"""Periodic motions by shooting: Newton's method for the state, and of autonomous scenes the period, to which a motion returns.

One period in equal steps of Radau IIA maps the departures from a state that the constraints allow to those after the period; its
exact derivative (`orbit`) is the matrix whose eigenvalues are the multipliers. The steps are halved until the motion no longer
changes by more than is asked: what it changed by, over GAIN, is its error.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.analysis.linearization import start_at
from mbdae.analysis.multipliers import FEWEST, GAIN, MOST, ROUND, Floquet, floquet, prepared_from
from mbdae.analysis.orbit import (
    SOLVER,
    Departures,
    Orbit,
    Return,
    acting_states,
    angles,
    changed,
    departures,
    followed,
    later,
    propagated,
)
from mbdae.analysis.reduced import refuse_rolling
from mbdae.errors import OptionError, SolverError, SteadyError, naming_arguments, warn
from mbdae.formulations import system_for
from mbdae.inputs.sensed import numbers_in, with_values
from mbdae.integrators.solution import Solution
from mbdae.results.result import Result
from mbdae.results.stored_parts import Wanted, started, wanted_of
from mbdae.run.estimate import measure_of
from mbdae.scene.scene import SceneData
from mbdae.scene.sensed import refuse_sampled
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem
from mbdae.threads import single_threaded
from mbdae.values import number, option, optional

LOOSE = 1e-6  #: rtol of the runs that show the number of steps, and that go on where Newton's method finds no way
ITERATIONS, HALVINGS = 25, 5  #: largest number of corrections with one number of steps, and of halvings of one
#: a correction that is this part of the state's scale is the last; a residual below FOUND counts as none; one below STALLED is
#: taken, because few steps damp a motion without losses, which then returns with more steps alone
LAST, FOUND, STALLED = 1e-6, 1e-12, 1e-3
NOT_FOUND = ("no periodic motion was found from this start: after {:.6g} s the motion is {:.2g} of its size off where it began, "
             "and no change of the start brings it nearer; give a start nearer to it, start=(result, t)")
SHARE = 0.2  #: part of the accuracy that the error of the shooting may be; the rest is that of the run over the period
PERIOD = 1e-8  #: largest relative error of a period that is found
#: singular values of the corrections' matrix below this, over the largest, count as 0: of families of periodic motions the next
#: one is taken
SINGULAR = 1e-8
WAITS = (2, 8, 32)  #: numbers of periods that a motion is followed where no correction helps
#: spans, in characteristic times, over which the return of an autonomous motion is sought, in turn; it has returned where it is
#: nearer to its last state than this part of its size
SPANS, NEAR = (20.0, 80.0, 320.0), 0.1
SAMPLES = 4000  #: number of times at which such a return is sought


class Periodic(Result):
    """One period of a periodic motion, a Result with its `period` (s), `multipliers` (those of `s.floquet`, all), `stable`,
    and `floquet`, which has their modes and errors. `accuracy.estimated` is the error of the periodic motion, `period_error` that
    of a period that was found, s (0.0 for a given one)."""

    period: float
    period_error: float
    autonomous: bool

    @cached_property
    def floquet(self) -> Floquet:
        """The multipliers with their modes and errors."""
        return floquet(self.prepared.model.scene, self.period, (self, float(self.t[0])))

    @property
    def multipliers(self) -> Any:
        """Floquet multipliers (k,), by falling size."""
        return self.floquet.multipliers

    @property
    def stable(self) -> bool | None:
        """Whether small departures die out or stay small; of an autonomous motion but for those along it. None where the errors
        leave it open."""
        if not self.autonomous:
            return self.floquet.stable
        growth, off = self.floquet.exponents.real, self.floquet.errors
        along = int(np.argmin(np.abs(self.multipliers - 1)))  # a motion shifted along itself comes back as it is
        others = np.arange(len(growth)) != along
        if np.any((growth > off)[others]):
            return False
        return True if np.all((growth + off <= 0)[others]) else self.floquet.stable

    def __call__(self, t: Any) -> Result:
        """The same run at other times t (s) of the period."""
        return super().__call__(t)


@dataclass(frozen=True)
class Shot:
    """A motion over `period` (s) from the start of `system`, with its departures: residual (k,), where it ends off its start;
    later: sign and whole turns of unknowns after the period."""

    system: SceneSystem
    period: float
    orbit: Orbit
    directions: Departures
    residual: Array

    @property
    def off(self) -> float:
        """The length of the residual."""
        return float(np.linalg.norm(self.residual))

    @property
    def end(self) -> Array:
        """Unknowns (n,) after the period."""
        return np.asarray(self.orbit.y[-1, -1])


@naming_arguments
@single_threaded
def periodic(scene: SceneData, period: Any = None, accuracy: float = 1e-6, start: Any = None, of: Any = None) -> Periodic:
    """A motion that returns to its start after `period` (s), whole turns counting as a return, as a Result over one period.

    period: that of the loads and drives, a number or an expression of `mb.number`, "2*pi/w"; None: found, for scenes without any.
    start: a Result (its end), (Result, t) or an equilibrium near the motion; by default the start of the scene. accuracy: of the
    motion, and of the quantities `of`, as in `simulate`.
    Raises SteadyError where no such motion is found, where it does not repeat, or where it has contacts that no step follows."""
    length = optional("period", _number(period), number, "give the time in s after which loads and drives repeat, or None for "
                      "a scene without any, whose period is found", above=0)
    accuracy = option("accuracy", accuracy, number, "give the error of the motion, a number from 1e-9 to 0.01", least=1e-9,
                      most=1e-2)
    refuse_sampled(scene, "periodic")
    begin = start_at(scene, start, "start")
    prepared = prepared_from(scene, begin, length or 0.0)
    refuse_rolling(prepared.mechanics, "periodic", "simulate until transients have died out")
    found = _Search(prepared, accuracy, length, wanted_of(of, prepared)).run()
    return _result(scene, found, accuracy, of)


def _number(period: Any) -> Any:
    """An expression of named numbers as a number."""
    return float(with_values(period)) if numbers_in(period) else period


@dataclass(frozen=True)
class Found:
    """A periodic motion: the shot, its error relative as accuracies are, that of the period (s), and whether that was found."""

    prepared: Prepared
    shot: Shot
    error: float
    period_error: float
    autonomous: bool


class _Search:
    """Newton's method from the start of a prepared scene. period: s, None where it is found too."""

    def __init__(self, prepared: Prepared, accuracy: float, period: float | None, wanted: Wanted) -> None:
        self.prepared, self.accuracy, self.given = prepared, accuracy, period
        self.system = system_for(prepared, highest_index=3)
        self.measure = measure_of(self.system, prepared, wanted)

    def run(self) -> Found:
        """The motion, followed in steps that are halved until it has the accuracy."""
        system, period = self._begun()
        run = self._run(system, period)
        self.acting, steps = acting_states(system, run), max(FEWEST, run.stats.steps // 2)
        shot, error = self._returning(self._shot(system, period, steps), steps), np.inf
        while True:
            steps *= 2
            coarse, shot = shot, self._corrected(self._shot(shot.system, shot.period, steps))
            last, error = error, self._apart(coarse, shot) / GAIN
            of_period = abs(shot.period - coarse.period) / GAIN
            done = max(error, shot.off) <= SHARE * self.accuracy and of_period <= min(SHARE * self.accuracy, PERIOD) * shot.period
            if done or 2 * steps > MOST or ROUND > error > last / 2:
                if shot.off > self.accuracy:
                    raise SteadyError(NOT_FOUND.format(shot.period, shot.off))
                self._refuse_changing(shot)
                return Found(self.prepared, shot, error, of_period, self.given is None)

    def _refuse_changing(self, shot: Shot) -> None:
        """Raise SteadyError where the equations are others a period later."""
        run = self._run(shot.system, shot.period)
        ends = later(self.prepared, shot.system, np.stack([shot.system.y0, shot.end]), self.acting)
        if text := changed(self.prepared, shot.system, run, shot.period, ends):
            given = "give a period after which loads and prescribed motions repeat"
            raise SteadyError(f"the equations do not repeat after period = {shot.period:.9g} s: {text}; {given}")

    # -- a beginning

    def _begun(self) -> tuple[SceneSystem, float]:
        """The system at its start with the period given; else where the motion has come near to its state a period before."""
        if self.given is not None:
            return self.system, self.given
        for span in SPANS:
            run = self._run(self.system, span * self.prepared.time)
            period = self._return(run)
            if period is not None:
                return self._from(run.t[-1], run.y[-1]), period
        raise SteadyError("the motion does not come near to a state in which it was before: give the period, or a start near a "
                          "periodic motion, start=(result, t)")

    def _return(self, run: Solution) -> float | None:
        """The time (s) since a run was last near its end, going the same way; None where it was not."""
        t = np.linspace(run.t[0] + (run.t[-1] - run.t[0]) / 3, run.t[-1], SAMPLES)
        q, u, _ = self.prepared.states(t, run(t))
        m = self.prepared.mechanics
        speed = np.maximum(np.max(np.abs(u), axis=0), 1e-12 * m.velocity_units / self.prepared.time)
        turning = angles(self.prepared)
        straight = np.delete(q, turning, axis=1)
        size = np.max(np.ptp(straight, axis=0), initial=self.prepared.length if turning else 0.0)
        x = np.hstack([straight, size * np.sin(q[:, turning]), size * np.cos(q[:, turning]), size * u / speed])
        off = x - x[-1]
        size = np.max(np.linalg.norm(off, axis=1))
        going = off @ (x[-1] - x[-2])
        crossed = np.flatnonzero((going[:-1] < 0) & (going[1:] >= 0) & (np.linalg.norm(off[1:], axis=1) < NEAR * size))
        crossed = crossed[crossed < len(t) - 3]
        if not size > 0 or not len(crossed):
            return None
        k = int(crossed[-1])
        share = -going[k] / (going[k + 1] - going[k])
        return float(t[-1] - (t[k] + share * (t[k + 1] - t[k])))

    def _run(self, system: SceneSystem, span: float) -> Solution:
        return replace(SOLVER, rtol=LOOSE).solve(system, system.t0 + span)

    def _from(self, t: float, y: Array) -> SceneSystem:
        """The system started with unknowns y at the time of its start; with a found period any time is the same."""
        begin = self.system.t0 if self.given is None else t
        return self.system.starting(begin, *self.system.restarted(begin, y))

    # -- Newton's method

    def _shot(self, system: SceneSystem, period: float, steps: int) -> Shot:
        orbit = followed(system, period, steps)
        end = orbit.y[-1, -1]
        sign, turns = later(self.prepared, system, np.stack([system.y0, end]), self.acting)
        returned = Return(0.0, self.acting, steps, sign, [])
        directions = departures(self.prepared, system, returned, period)
        off = end - sign * system.y0 - turns
        return Shot(system, period, orbit, directions, directions.read(off[:, None])[:, 0])

    def _returning(self, shot: Shot, steps: int) -> Shot:
        """The shot corrected until it returns; where no correction helps, from where the motion is some periods later."""
        failure: SteadyError | None = None
        for wait in (0, *WAITS):
            try:
                if wait:
                    shot = self._later(shot, wait, steps)
                return self._corrected(shot)
            except SteadyError as error:
                failure = error
        assert failure is not None
        raise failure

    def _later(self, shot: Shot, periods: int, steps: int) -> Shot:
        """The shot from where the motion is some periods later."""
        run = self._run(shot.system, periods * shot.period)
        sign, turns = later(self.prepared, shot.system, np.stack([shot.system.y0, run.y[-1]]), self.acting)
        return self._shot(self._from(shot.system.t0, sign * (run.y[-1] - turns)), shot.period, steps)

    def _corrected(self, shot: Shot) -> Shot:
        """The shot that returns to its start, by Newton's method with corrections that are halved where they do not help."""
        steps = len(shot.orbit.h) if self.system.timeline is None else max(len(shot.orbit.h), FEWEST)
        for _ in range(ITERATIONS):
            if shot.off <= FOUND:
                return shot
            x, period = self._correction(shot)
            last = float(np.linalg.norm(x)) <= LAST
            for tried in self._tried(shot, x, period, steps):
                if tried.off < shot.off * (1 if last else 0.9):
                    shot = tried
                    break
            else:
                if last or shot.off < STALLED:
                    return shot
                raise SteadyError(NOT_FOUND.format(shot.period, shot.off))
            if last:
                return shot
        raise SteadyError(NOT_FOUND.format(shot.period, shot.off))

    def _correction(self, shot: Shot) -> tuple[Array, float]:
        """The change of the start, in the directions, and of the period (s), after which the motion returns."""
        d, k = shot.directions, len(shot.residual)
        M = d.read(propagated(shot.system, shot.orbit, d.start)) - np.eye(k)
        right = -shot.residual
        if self.given is None:
            along = d.read((shot.orbit.yp[-1, -1])[:, None])[:, 0] * shot.period
            way = along / max(float(np.linalg.norm(along)), 1e-300)
            M, right = np.block([[M, along[:, None]], [way[None], np.zeros((1, 1))]]), np.append(right, 0.0)
        x = np.linalg.lstsq(M, right, rcond=SINGULAR)[0]
        return np.asarray(x[:k]), float(x[k] * shot.period) if self.given is None else 0.0

    def _tried(self, shot: Shot, x: Array, period: float, steps: int) -> Iterator[Shot]:
        """Shots with the whole correction, with half of it and so on, those that can be followed."""
        for i in range(HALVINGS):
            share = 0.5**i
            length = shot.period + share * period
            if length <= 0.2 * shot.period:
                continue
            try:
                y = shot.directions.closed(shot.system, shot.system.y0 + shot.directions.start @ (share * x))
                system = self._from(shot.system.t0, y)
                yield self._shot(system, length, steps)
            except (SolverError, OptionError):
                continue

    def _apart(self, coarse: Shot, fine: Shot) -> float:
        """Largest distance of two motions, at the same shares of the period."""
        a, b = ((one.orbit.t[:, -1] - one.system.t0) / one.period for one in (coarse, fine))
        near = np.clip(np.searchsorted(b, a - 1e-9), 0, len(b) - 1)
        same = np.flatnonzero(np.abs(b[near] - a) < 1e-8)
        t, ends = fine.orbit.t[near[same], -1], (coarse.orbit.y[same, -1], fine.orbit.y[near[same], -1])
        return float(np.max(self.measure(t, *ends)))


def _result(scene: SceneData, found: Found, accuracy: float, of: Any) -> Periodic:
    """The run over the period, with the error of the periodic motion."""
    shot = found.shot
    (q,), (u,), (s,) = found.prepared.states(np.array([shot.system.t0]), shot.system.y0[None])
    begin = replace(found.prepared.start, q=q, u=u, s=s)
    prepared = replace(found.prepared, start=begin)
    run = scene.simulate(shot.system.t0 + shot.period, accuracy, start=started(prepared), of=of)  # type: ignore[attr-defined]
    known = run.accuracy
    estimate = None if known.estimated is None else known.estimated + found.error
    made = Periodic(run.prepared, run.solution, replace(run.info, accuracy=replace(known, estimated=estimate, of={
        key: None if error is None else error + found.error for key, error in known.of.items()})), run.t)
    made.period, made.period_error, made.autonomous = shot.period, found.period_error, found.autonomous
    if estimate is not None and known.estimated is not None and estimate > accuracy >= known.estimated:
        warn(f"scene '{scene.name}': the periodic motion is off by about {estimate:.1e}, where {accuracy:g} was asked")
    return made
