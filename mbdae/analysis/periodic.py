"""Periodic motions by shooting: Newton's method for the state, and of autonomous scenes the period, to which a motion returns.

One period in steps of Radau IIA, equal ones or those of an adaptive run, maps the departures from a state that the constraints
allow to those after the period; its exact derivative (`shooting`) is the matrix whose eigenvalues are the multipliers. The steps
are halved until the motion no longer changes by more than is asked: what it changed by, over GAIN, is its error.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.analysis.linearization import start_at
from mbdae.analysis.multipliers import GAIN, ROUND, Floquet, multipliers_of, prepared_from
from mbdae.analysis.orbit import FEWEST, MOST, acting_states, changed, halved, later, shares_of, timed_item
from mbdae.analysis.reduced import refuse_rolling
from mbdae.analysis.returns import DRIVEN, LOST, OTHER, REST, RESTS, UNFOLLOWED, at_rest, last_return, repeats
from mbdae.analysis.shooting import NOT_FOUND, SHRINKS, SINGULAR, STALLED, Shooting, Shot
from mbdae.errors import OptionError, SolverError, SteadyError, naming_arguments, warn
from mbdae.formulations import shared_system
from mbdae.inputs.sensed import numbers_in, with_values
from mbdae.results.clearance import OtherRun, sampled, some_of
from mbdae.results.result import Result
from mbdae.results.stored_parts import Wanted, told, wanted_of
from mbdae.run.checkpoint import give_back, taken
from mbdae.run.estimate import measure_of
from mbdae.scene.scene import SceneData
from mbdae.scene.sensed import refuse_sampled
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem
from mbdae.threads import single_threaded
from mbdae.values import number, option, optional

SHARE = 0.2  #: part of the accuracy that the error of the shooting may be; the rest is that of the run over the period
PERIOD = 1e-8  #: largest relative error of a period that is found
#: changes of the start that change the end by less than SURE of them lead to other periodic motions, and so do those by less than
#: ALIKE, or 100 times the error of the motion, of which half as many steps show FALLS times as much; one of which the share TUNES
#: is of the period leads to other periods; each of them has a multiplier that is not farther from 1 than ONE
ALIKE, SURE, TUNES, FALLS, ONE = 1e-7, 1e-9, 1e-4, 4.0, 0.1
NEAR = 0.01  #: largest change of the start, over the size, and of the period of a motion that repeats within the one found
ROUNDING = 1e-15  #: rounding error of the state after a period
FINE, TIGHTER = 1e-8, 1e-2  #: smallest accuracy of multipliers, and theirs over that asked of the motion
WAITS = (2, 8, 32)  #: numbers of periods that a motion is followed where no correction helps
#: spans, in characteristic times, over which a return is sought, in turn, the later ones where those before took few steps (SLOW)
SPANS, SLOW = (20.0, 80.0, 320.0, 1280.0, 5120.0, 20480.0), 4000
OWN = 1e-5  #: largest error of the start that is found, of the size of the motion
#: number of times that a growing motion is made larger, at most, by which part of its size; residual of one that returns
GROWINGS, GROWS, FOUND_AT = 60, 0.3, 1e-7
#: what is told of a motion beside which others are
FAMILY = ("one of a family of periodic motions, as of a scene without losses or with a free turn: others{} lie beside it, and "
          "the one nearest to the start is given; another start= gives another")


class Periodic(Result):
    """One period of a periodic motion, a Result with its `period` (s), `multipliers` (those of `s.floquet`, all), `stable`,
    and `floquet`, which has their modes and errors. `accuracy.estimated` is the error of the periodic motion, `period_error` that
    of a period that was found, s (0.0 for that of drives). autonomous: whether nothing depends on the time; family: whether
    other periodic motions lie beside this one, so that the start chose it."""

    period: float
    period_error: float
    autonomous: bool
    family: bool
    stated: Any  #: the period that was stated, None where it was found
    shares: Array  #: of the period at which the steps of the shooting end

    @cached_property
    def floquet(self) -> Floquet:
        """The multipliers with their modes and errors."""
        off, fine = self.accuracy.estimated or 0.0, max(FINE, TIGHTER * (self.accuracy.asked or 0.0))
        return multipliers_of(self.prepared.model.scene, self.period, (self, float(self.t[0])), None, fine, off)

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
        along = int(np.argmin(np.abs(self.multipliers - 1)))  # a motion shifted along itself comes back as it is
        found = self.floquet._judged(np.arange(len(self.multipliers)) != along)
        return self.floquet.stable if found is None else found

    def __call__(self, t: Any) -> Result:
        """The same run at other times t (s) of the period."""
        return super().__call__(t)


@naming_arguments
@single_threaded
def periodic(scene: SceneData, period: Any = None, accuracy: float = 1e-6, start: Any = None, of: Any = None) -> Periodic:
    """A motion that returns to its start after `period` (s), whole turns counting as a return, as a Result over one period.

    period: that of the loads and drives, a number or an expression of `mb.number`, "2*pi/w"; None: found, for scenes without any.
    start: a Result (its end), (Result, t) or an equilibrium near the motion; by default the start of the scene. accuracy: of the
    motion, and of the quantities `of`, as in `simulate`.
    Raises SteadyError where no such motion is found, where it does not repeat, or where it has contacts that no step follows."""
    stated = float(with_values(period)) if numbers_in(period) else period
    length = optional("period", stated, number, "give the time in s after which loads and drives repeat, or None for a scene "
                      "without any, whose period is found", above=0)
    accuracy = option("accuracy", accuracy, number, "give the error of the motion, a number from 1e-9 to 0.01", least=1e-9,
                      most=1e-2)
    refuse_sampled(scene, "periodic")
    begin = start_at(scene, start, "start")
    by_start = ("periodic", length) if begin is None else None
    prepared, key = taken(scene, by_start, lambda made: prepared_from(made, begin, length or 0.0))
    refuse_rolling(prepared.mechanics, "periodic", "simulate until transients have died out")
    wanted = wanted_of(of, prepared)
    found = _Search(prepared, accuracy, length, wanted).run()
    made = _result(scene, found, accuracy, wanted)
    made.stated = period
    give_back(prepared, key)
    return made


@dataclass(frozen=True)
class Found:
    """A periodic motion: the shot, that in steps twice as long, one that begins farther off than corrections left it, the error
    relative as accuracies are, that of the period (s), whether nothing depends on the time, and whether others lie beside it."""

    prepared: Prepared
    shot: Shot
    coarse: Shot
    beginning: Shot | None
    error: float
    period_error: float
    autonomous: bool
    family: bool


class _Search(Shooting):
    """Newton's method from the start of a prepared scene. period: s, None where it is found too."""

    begun: tuple[SceneSystem, float, Array]  #: the last motion from which corrections began

    def __init__(self, prepared: Prepared, accuracy: float, period: float | None, wanted: Wanted) -> None:
        if period is None and (name := timed_item(prepared)) is not None:
            raise OptionError(DRIVEN.format(name))
        super().__init__(prepared, shared_system(prepared, highest_index=3), timed_item(prepared) is None)
        self.accuracy, self.given, self.rests = accuracy, period, False
        self.measure = measure_of(self.system, prepared, wanted, accuracy)

    def run(self) -> Found:
        """The motion of the given period; of a scene without drives the period is found, unless a family has one of each."""
        try:
            found, tunes = self._found(self._returning())
        except SteadyError as error:
            if not self.shrinks:
                raise
            found, tunes = self._found(self._grown(error))
        if found.family and tunes and self.autonomous and self.given is not None:
            self.free = False
            found = self._found(self._returning())[0]
        elif self.autonomous and self.given is not None and abs(found.shot.period - self.given) > self.accuracy * self.given:
            warn(OTHER.format(found.shot.period, self.given))
        if found.family:
            warn(FAMILY.format(", of other periods," if tunes and self.autonomous else ""))
        return found

    def _found(self, shot: Shot) -> tuple[Found, bool]:
        """The motion, in steps that are halved until it has the accuracy; whether the period changes along its family."""
        error = np.inf
        while True:
            coarse, shot = shot, self.corrected(self.shot(shot.system, shot.period, halved(shot.shares)))
            last, error = error, self._apart(coarse, shot) / GAIN
            of_period = abs(shot.period - coarse.period) / GAIN
            done = (max(error, shot.off * shot.size) <= min(SHARE * self.accuracy, OWN * shot.size)
                    and of_period <= min(SHARE * self.accuracy, PERIOD) * shot.period)
            if done or 2 * len(shot.shares) > MOST or ROUND * shot.size > error > last / 2:
                if shot.off * shot.size > self.accuracy or shot.off > STALLED:
                    raise SteadyError(NOT_FOUND.format(shot.period, shot.off))
                if self.given is None and (once := self._once(shot)) is not shot:
                    return self._found(once)
                self._refuse_rest(shot)
                self._refuse_changing(shot)
                matrix, right = self.matrix(shot)
                beside = self._beside(coarse, shot, matrix, error / shot.size)
                left = self._left(matrix, right, beside)
                off, beginning = shot.size * float(np.linalg.norm(left)), None
                if off > error / 10:
                    start = shot.directions.closed(shot.system, shot.system.y0 + shot.directions.start @ left)
                    beginning = self.shot(self.begun_at(shot.system.t0, start), shot.period, shot.shares)
                found = Found(self.prepared, shot, coarse, beginning, error + off, of_period if self.free else 0.0,
                              self.autonomous, len(beside) > 0)
                return found, bool(np.any(np.abs(beside[:, -1]) > TUNES)) if self.free else True

    def _left(self, matrix: Array, right: Array, beside: Array) -> Array:
        """How far corrections may have left the start off (departures), but for changes that lead to motions `beside`: near a
        resonance the rounding of a period is amplified."""
        k, last = len(right) - self.free, len(right) - 1 - len(beside)
        if last < 0 or not k:
            return np.zeros(k)
        _, sizes, rows = np.linalg.svd(matrix)
        x = np.linalg.lstsq(matrix, right, rcond=SINGULAR)[0]
        return np.asarray((np.linalg.norm(x - beside.T @ (beside @ x)) + ROUNDING / max(sizes[last], SURE)) * rows[last, :k])

    def _refuse_rest(self, shot: Shot) -> None:
        """Raise SteadyError where nothing moves although no load or drive holds it."""
        if self.autonomous and shot.extent < RESTS:
            self.shrinks = True
            raise SteadyError(REST)

    def _grown(self, error: SteadyError) -> Shot:
        """The motion to which one grows that corrections lead to rest: the change in one period, but for that along the motion,
        is taken many times at once, as long as the motion grows, until corrections lead to a larger one."""
        shot = self.shot(*self.begun)
        for _ in range(GROWINGS):
            d, y = shot.directions, shot.orbit.y[:, -1]
            size = float(np.max(np.linalg.norm(d.read((y - np.mean(y, axis=0)).T), axis=0)))
            along = d.read(shot.orbit.yp[-1, -1][:, None])[:, 0]
            drift = shot.residual - along * (along @ shot.residual) / max(float(along @ along), 1e-300)
            times = max(1.0, GROWS * size / max(float(np.linalg.norm(drift)), 1e-300))
            start = d.closed(shot.system, shot.system.y0 + d.start @ (times * drift))
            try:
                larger = self.shot(self.begun_at(shot.system.t0, start), shot.period, shot.shares)
                if larger.extent <= shot.extent:
                    break
                shot, found = larger, self.corrected(larger)
            except (SteadyError, SolverError, OptionError):
                continue
            if found.off <= FOUND_AT and found.extent > larger.extent * SHRINKS:
                return found
        raise SteadyError(REST) from error

    def _beside(self, coarse: Shot, fine: Shot, matrix: Array, error: float) -> Array:
        """Changes (k, departures and share of the period) of the start that lead to other periodic motions: their size in the
        matrix is that of rounding, or falls with the steps like their errors, where that of a motion alone stays."""
        k = len(fine.residual)
        if not k:  # all is prescribed
            return np.zeros((0, 1))
        _, sizes, rows = np.linalg.svd(matrix)
        most = int(np.sum(np.abs(np.linalg.eigvals(matrix[:k, :k])) <= ONE)) - self.free
        sizes = sizes / max(sizes[0], 1.0)  # all are small where everything repeats, or is near a resonance
        near = (sizes <= max(ALIKE, 100 * error)) & (np.arange(len(sizes)) >= len(sizes) - most)
        if np.all(sizes[near] <= SURE):
            return np.asarray(rows[near])
        changes = rows[near].T.copy()
        changes[:k] = coarse.directions.Q.T @ fine.directions.Q @ changes[:k]
        falls = np.linalg.norm(self.matrix(coarse)[0] @ changes, axis=0) > FALLS * np.linalg.norm(matrix @ rows[near].T, axis=0)
        return np.asarray(rows[near][falls | (sizes[near] <= SURE)])

    def _refuse_changing(self, shot: Shot) -> None:
        """Raise SteadyError where the equations are others a period later."""
        ends = later(self.prepared, shot.system, np.stack([shot.system.y0, shot.end]), self.acting)
        if text := changed(self.prepared, shot.system, shot.orbit.run, shot.period, ends):
            given = "give a period after which loads and prescribed motions repeat"
            raise SteadyError(f"the equations do not repeat after period = {shot.period:.9g} s: {text}; {given}")

    # -- a beginning

    def _returning(self) -> Shot:
        """A shot that returns, from the first beginning from which one is found."""
        failure: Exception | None = None
        for system, period in self._beginnings():
            try:
                run = self.followed_from(system, period)
                self.acting = acting_states(system, run)
                self.begun = system, period, shares_of(run, self.autonomous)
                shot = self.corrected(self.shot(*self.begun))
                self._refuse_rest(shot)
                return shot if self.given is not None else self._once(shot)
            except (SteadyError, SolverError) as error:
                failure = error
        if isinstance(failure, SolverError) and not isinstance(failure, SteadyError):
            raise SteadyError(UNFOLLOWED.format(failure)) from failure
        raise failure or SteadyError(REST if self.rests else LOST)

    def _once(self, shot: Shot) -> Shot:
        """The motion over its smallest period, where it repeats within the one that was found."""
        for k in repeats(self.prepared, shot.orbit.run):
            shares = k * shot.shares[k * shot.shares < 1 - 1e-9]
            shares = np.append(shares, 1.0) if len(shares) >= FEWEST else np.linspace(0, 1, FEWEST + 1)
            try:
                one = self.corrected(self.shot(shot.system, shot.period / k, shares))
            except (SteadyError, SolverError, OptionError):
                continue
            moved = shot.directions.read((one.system.y0 - shot.system.y0)[:, None])
            if max(float(np.linalg.norm(moved)), abs(k * one.period / shot.period - 1)) < NEAR:
                return one
        return shot

    def _beginnings(self) -> Iterator[tuple[SceneSystem, float]]:
        """Systems at their start with a period: that given, now and some periods later; else where a run has come near to its
        state a period before, after ever longer spans."""
        if self.given is not None:
            system = self.system
            for wait in (0, *WAITS):
                if wait:
                    run = self.followed_from(system, wait * self.given)
                    sign, turns = later(self.prepared, system, np.stack([system.y0, run.y[-1]]), self.acting)
                    system = self.begun_at(system.t0, sign * (run.y[-1] - turns))
                yield system, self.given
            return
        for i, span in enumerate(SPANS):
            run = self.followed_from(self.system, span * self.prepared.time)
            self.rests = at_rest(self.prepared, run)
            if not self.rests and (period := last_return(self.prepared, run)) is not None:
                yield self.begun_at(run.t[-1], run.y[-1]), period
            if i >= 2 and run.stats.steps > SLOW:
                return

    def _apart(self, coarse: Shot, fine: Shot) -> float:
        """Largest distance of two motions, at the same shares of the period."""
        a, b = ((one.orbit.t[:, -1] - one.system.t0) / one.period for one in (coarse, fine))
        near = np.clip(np.searchsorted(b, a - 1e-9), 0, len(b) - 1)
        same = np.flatnonzero(np.abs(b[near] - a) < 1e-8)
        t, ends = fine.orbit.t[near[same], -1], (coarse.orbit.y[same, -1], fine.orbit.y[near[same], -1])
        return float(np.max(self.measure(t, *ends)))


def _result(scene: SceneData, found: Found, accuracy: float, wanted: Wanted) -> Periodic:
    """The run over the period, with the error of the periodic motion."""
    shot = found.shot
    (q,), (u,), (s,) = found.prepared.states(np.array([shot.system.t0]), shot.system.y0[None])
    prepared = found.prepared.begun(replace(found.prepared.start, t=shot.system.t0, q=q, u=u, s=s))
    end = shot.system.t0 + shot.period
    run = scene._continued(prepared, end, max(accuracy * (1 - SHARE), 1e-9), wanted)  # type: ignore[attr-defined]
    known = run.accuracy
    estimate = None if known.estimated is None else known.estimated + found.error
    known = replace(known, asked=accuracy, estimated=estimate)
    if (errors := known.errors) is not None:
        others = (*errors.others, *_other_starts(found, run))
        errors = replace(errors, asked=accuracy, others=others, reactions=None, _known={})
        known = told(run, replace(known, found_reactions=errors), wanted)[0]
    made = Periodic(run.prepared, run.solution, replace(run.info, accuracy=known), run.t)
    made.period, made.period_error = shot.period, found.period_error
    made.shares = shot.shares
    made.autonomous, made.family = found.autonomous, found.family
    if estimate is not None and estimate > accuracy >= estimate - found.error:
        warn(f"scene '{scene.name}': the periodic motion is off by about {estimate:.1e}, where {accuracy:g} was asked")
    return made


def _other_starts(found: Found, run: Result) -> Iterator[OtherRun]:
    """What the start that was found is off: as the motion in steps twice as long, over GAIN, and as corrections left it."""
    for shot, share in ((found.coarse, 1 / GAIN), (found.beginning, 1.0)):
        if shot is not None:
            motion = shot.orbit.run
            times = some_of(motion.t[motion.t <= run.solution.t[-1]], motion.y.shape[1], False)
            yield OtherRun(sampled(motion, times), times, share, kind="start")
