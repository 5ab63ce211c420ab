"""Steps of a run with a large defect, integrated again with steps short enough to resolve what acts for a short time."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from mbdae.deferred import distinct
from mbdae.errors import AccuracyWarning, SolverError, WallClockError
from mbdae.formulations import Form, system_for
from mbdae.integrators.base import Solver
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.solution import Solution
from mbdae.results.accuracy import Accuracy
from mbdae.run.defect import Defect, Suspect, apart
from mbdae.run.estimate import Controlled
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem
from mbdae.system.start import Start

FINER = 10.0  #: ratio of the accuracy of the run to that of the fine run, unless round-off forbids the latter
#: largest number of residual evaluations of the fine run from one point at which it stops to the next; where it needs more, the
#: effect estimated from the defect is taken instead
BUDGET = 3000
#: number of equally spaced times, from one point at which the fine run stops to the next, at which the run and the fine run are
#: compared, besides the steps of the fine run
BETWEEN = 8
MOST = 5  #: largest number of suspect steps of a run that are integrated again
SHORTER = 0.8  #: ratio of the step proposed in the warning to the longest one that would resolve the short event
WARNED = 3.0  #: a warning is given where the motions differ by more than this many times what is allowed in the step
UNCONTROLLED = 1e-6  #: accuracy assumed for runs without a tolerance (constant steps) for which no accuracy was asked


class FineRun:
    """Integrates steps of a run again, with Radau IIA to a tenth of the allowed difference."""

    def __init__(self, prepared: Prepared, form: Form, run: Solution, accuracy: float) -> None:
        self.prepared, self.form, self.run = prepared, form, run
        method = RadauIIA(3)
        wanted = accuracy / FINER * method.factor(form.label)
        self.solver = RadauIIA(3, rtol=max(wanted, 10 * method.tightest.get(form.label, method.tightest[""])))

    def difference(self, suspect: Suspect) -> float:
        """Largest distance between the run and a fine run over one step. The fine run starts from the state at the begin of the
        step and stops at every point with a large defect and at its neighbours. Where it fails, the effect of the defect is
        returned."""
        run, i, worst = self.run, suspect.step, 0.0
        system = self._system(float(run.t[i]), run.y[i])
        first = float(np.min(np.diff(np.r_[run.t[i], suspect.times, run.t[i + 1]]))) / 4
        for stop in self._stops(suspect):
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", AccuracyWarning)
                    part = self.solver.solve(system, stop, max_residuals=BUDGET, h0=min(first, stop - system.t0))
            except WallClockError:
                raise
            except SolverError:
                return suspect.effect
            times = distinct(np.r_[np.linspace(system.t0, stop, BETWEEN), part.t])
            motions = (self.prepared.states(times, solution(times))[:2] for solution in (part, run))
            worst = max(worst, float(np.max(apart(self.prepared, run, *motions))))
            system = system.starting(stop, part.y[-1], part.yp[-1])
        return worst

    def _system(self, t: float, y: Array) -> SceneSystem:
        """The equations that start at the time t (s) with the state y (n,) of the run, and with consistent accelerations and
        multipliers."""
        p, at = self.prepared, np.array([t])
        q, u, s = p.states(at, y[None])
        a, multipliers = p.mechanics.accelerations(at, q, u, s)
        start = Start(t, q[0], u[0], s[0], a[0], multipliers[0])
        system = system_for(replace(p, start=start), self.form, self.solver.highest_index)
        return system.sampling(None)  # without sampling instants, since sampled controllers hold their outputs inside a step

    def _stops(self, suspect: Suspect) -> Array:
        """Times (s) at which the fine run stops: points with a large defect, their neighbours, the end of the step."""
        large = suspect.large | np.append(suspect.large[1:], False) | np.append(False, suspect.large[:-1])
        return np.append(suspect.times[large], self.run.t[suspect.step + 1])



@dataclass(frozen=True)
class Contradiction:
    """A short event that a step missed: it acts from about `begin` to `end` (s) inside the step of length `step` (s). equation:
    name of the equation with the largest defect; difference: of the motion, as `motion_distance`; longest: longest step (s) that
    would resolve the event."""

    begin: float
    end: float
    step: float
    equation: str
    difference: float
    longest: float

    @classmethod
    def of(cls, run: Solution, suspect: Suspect, difference: float) -> Self:
        """The contradiction in a suspect step; difference: that of the motion from the fine run."""
        times, step = suspect.times[suspect.large], float(run.t[suspect.step + 1] - run.t[suspect.step])
        begin, end = float(times[0]), float(times[-1])
        return cls(begin, end, step, suspect.equation, difference, (end - begin + step / len(suspect.times)) / 2)


@dataclass(frozen=True)
class Rechecked:
    """Contradictions between the equations of motion and a run, worst first; suspects: number of suspicious steps; cpu_s: CPU
    time of the check, s."""

    contradictions: tuple[Contradiction, ...] = ()
    suspects: int = 0
    cpu_s: float = 0.0
    allowed: float = 0.0  #: largest difference that causes no warning

    @classmethod
    def again(cls, stored: dict[str, Any]) -> Self:
        """The object made from its stored plain data."""
        return cls(**stored | {"contradictions": tuple(Contradiction(**c) for c in stored["contradictions"])})

    def within(self, known: Accuracy) -> Accuracy:
        """The accuracy with the largest contradiction included in its estimate."""
        if not self.contradictions or known.estimated is None:
            return known
        return replace(known, estimated=max(known.estimated, self.contradictions[0].difference))

    @property
    def notes(self) -> list[str]:
        """The warning, if any: the worst contradiction, the times of the others, and what to do."""
        if not self.contradictions:
            return []
        c, *others = self.contradictions
        also = "; the same holds at t = " + ", ".join(f"{(o.begin + o.end) / 2:.6g}" for o in others) + " s" if others else ""
        if self.suspects > MOST:
            also += f" ({self.suspects} steps are suspect, of which {MOST} were integrated again)"
        return [f"from about t = {c.begin:.6g} to {c.end:.6g} s {c.equation} is not satisfied by the run, whose step of "
                f"{c.step:.3g} s was not evaluated there: with short steps the motion differs by {c.difference:.1e} (allowed "
                f"{self.allowed:.0e}){also}. Something acts there for a short time: take steps below {c.longest:.2g} s, as with "
                f"mb.RadauIIA(3, step={SHORTER * c.longest:.2g}), or end a run at t = {(c.begin + c.end) / 2:.6g} s and continue "
                f"it with start="]


def rechecked(prepared: Prepared, form: Form, system: SceneSystem, run: Controlled, asked: float | None) -> Rechecked:
    """Short events that a run missed because its solver did not evaluate the equations there; system: the equations it solved;
    asked: the accuracy, None where none was asked."""
    begin, solution, solver = time.process_time(), run.solution, run.solver
    if len(solution.t) < 2:
        return Rechecked()
    allowed = asked or _expected(solver)
    suspects = Defect(prepared, system, solution, rough=solver.fixed).suspects(allowed)
    fine = FineRun(prepared, form, solution, allowed)
    found = [Contradiction.of(solution, suspect, difference) for suspect in suspects[:MOST]
             if (difference := fine.difference(suspect)) > WARNED * suspect.allowed]
    found.sort(key=lambda c: -c.difference)
    return Rechecked(tuple(found), len(suspects), time.process_time() - begin, WARNED * allowed)


def _expected(solver: Solver) -> float:
    """The accuracy expected of a tolerance; UNCONTROLLED for constant steps."""
    if not solver.rtol:
        return UNCONTROLLED
    return max(10.0 * solver.rtol, solver.at_best or 0.0)
