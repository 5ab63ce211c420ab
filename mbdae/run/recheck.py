"""One step of a run, integrated again so closely that what acts in it for a short time is met."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from mbdae.errors import AccuracyWarning, SolverError
from mbdae.formulations import Form, system_for
from mbdae.integrators.base import Solver
from mbdae.integrators.runge_kutta.radau import RadauIIA
from mbdae.integrators.solution import Solution
from mbdae.results.accuracy import Accuracy
from mbdae.run.control import Controlled
from mbdae.run.defect import Defect, Suspect, apart
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem
from mbdae.system.start.start import Start

FINER = 10.0  #: accuracy over that of the closer run
BUDGET = 3000  #: residual evaluations between two points of the step
BETWEEN = 8  #: instants compared between two points
JUDGED = 5  #: suspicious steps of a run that are integrated again
SHORTER = 0.8  #: step that is proposed over the longest one that looks at what acts
TOLD = 3.0  #: difference over what is allowed above which it is told
UNCONTROLLED = 1e-6  #: accuracy below which nothing is said of runs with constant steps


class Closer:
    """Integrates steps of a run again, with Radau IIA to a tenth of what is allowed."""

    def __init__(self, prepared: Prepared, form: Form, run: Solution, accuracy: float) -> None:
        self.prepared, self.form, self.run = prepared, form, run
        method = RadauIIA(3)
        wanted = accuracy / FINER * method.factors[method.label][form.label]
        self.solver = RadauIIA(3, rtol=max(wanted, 10 * method.tightest.get(form.label, method.tightest[""])))

    def difference(self, suspect: Suspect) -> float:
        """Largest distance of the run from a closer one over a step, which starts from the state that the run had at its begin
        and stops at every point where the equations contradict and beside it; the effect of the defect where that run ends
        before its step does."""
        run, i, worst = self.run, suspect.step, 0.0
        system = self._system(float(run.t[i]), run.y[i])
        first = float(np.min(np.diff(np.r_[run.t[i], suspect.times, run.t[i + 1]]))) / 4
        for stop in self._stops(suspect):
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", AccuracyWarning)
                    part = self.solver.solve(system, stop, max_residuals=BUDGET, h0=min(first, stop - system.t0))
            except SolverError:
                return suspect.effect
            times = np.unique(np.r_[np.linspace(system.t0, stop, BETWEEN), part.t])
            worst = max(worst, self._distance(times, part))
            system = system.starting(stop, part.y[-1], part.yp[-1])
        return worst

    def _system(self, t: float, y: Array) -> SceneSystem:
        """The equations with a consistent start at a state of the run."""
        p, at = self.prepared, np.array([t])
        q, u, s = p.states(at, y[None])
        a, multipliers = p.mechanics.accelerations(at, q, u, s)
        start = Start(t, q[0], u[0], s[0], a[0], multipliers[0])
        return system_for(replace(p, start=start), self.form, self.solver.highest_index)

    def _stops(self, suspect: Suspect) -> Array:
        """Times at which the closer run stops: points where the equations contradict, those beside them, the end of the step."""
        felt = suspect.felt | np.append(suspect.felt[1:], False) | np.append(False, suspect.felt[:-1])
        return np.append(suspect.times[felt], self.run.t[suspect.step + 1])

    def _distance(self, times: Array, part: Solution) -> float:
        """Largest distance from the run at some times."""
        motions = [self.prepared.states(times, solution(times))[:2] for solution in (part, self.run)]
        return float(np.max(apart(self.prepared, self.run, motions[0], motions[1])))


@dataclass(frozen=True)
class Contradiction:
    """What acts from about begin to end (s) and was not seen by a step of `step` s: the equation (name of its row) that says so,
    the difference it makes (as `motion_distance`), and the longest step (s) that looks at it."""

    begin: float
    end: float
    step: float
    equation: str
    difference: float
    longest: float

    @classmethod
    def of(cls, run: Solution, suspect: Suspect, difference: float) -> Self:
        """From a suspect and what its closer run showed."""
        felt, step = suspect.times[suspect.felt], float(run.t[suspect.step + 1] - run.t[suspect.step])
        begin, end = float(felt[0]), float(felt[-1])
        return cls(begin, end, step, suspect.equation, difference, (end - begin + step / len(suspect.times)) / 2)


@dataclass(frozen=True)
class Unseen:
    """Where the equations of motion contradict a run, worst first; how many steps were suspected; CPU time spent, s."""

    contradictions: tuple[Contradiction, ...] = ()
    suspects: int = 0
    cpu_s: float = 0.0
    allowed: float = 0.0  #: difference that would not be told

    def within(self, known: Accuracy) -> Accuracy:
        """What is known of the errors with what was found here."""
        if not self.contradictions or known.estimated is None:
            return known
        return replace(known, estimated=max(known.estimated, self.contradictions[0].difference))

    @property
    def notes(self) -> list[str]:
        """The warning, if there is anything to tell: the worst, where the others are, and what to do."""
        if not self.contradictions:
            return []
        c, *others = self.contradictions
        also = "; so it is at t = " + ", ".join(f"{(o.begin + o.end) / 2:.6g}" for o in others) + " s" if others else ""
        if self.suspects > JUDGED:
            also += f" ({self.suspects} steps are suspect, of which {JUDGED} were followed)"
        return [f"from about t = {c.begin:.6g} to {c.end:.6g} s {c.equation} contradicts the run, whose step of {c.step:.3g} s "
                f"did not look there: followed closely, the motion differs by {c.difference:.1e} (allowed {self.allowed:.0e})"
                f"{also}. Something acts there for a short time: take steps below {c.longest:.2g} s, as with mb.RadauIIA(3, "
                f"step={SHORTER * c.longest:.2g}), or end a run at t = {(c.begin + c.end) / 2:.6g} s and continue it with "
                f"start="]  # fmt: skip


def unseen(prepared: Prepared, form: Form, system: SceneSystem, run: Controlled, asked: float | None) -> Unseen:
    """What a run left out between the points its solver looked at; system: the equations as the solver took them."""
    begin, solution, solver = time.process_time(), run.solution, run.solver
    if len(solution.t) < 2:
        return Unseen()
    allowed = asked or _resolved(solver)
    suspects = Defect(prepared, system, solution, rough=solver.fixed).suspects(allowed)
    closer = Closer(prepared, form, solution, allowed)
    found = [Contradiction.of(solution, suspect, difference) for suspect in suspects[:JUDGED]
             if (difference := closer.difference(suspect)) > TOLD * suspect.allowed]  # fmt: skip
    found.sort(key=lambda c: -c.difference)
    return Unseen(tuple(found), len(suspects), time.process_time() - begin, TOLD * allowed)


def _resolved(solver: Solver) -> float:
    """The accuracy that a tolerance lets expect; with constant steps what is hardly ever asked for."""
    if not solver.rtol:
        return UNCONTROLLED
    return max(10.0, 1 / max(solver.factors.get(solver.label, {"": 0.1}).values())) * solver.rtol
