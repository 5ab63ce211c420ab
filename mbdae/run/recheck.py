"""One step of a run, integrated again so closely that what acts in it for a short time is met."""

from __future__ import annotations

import time
import warnings
from dataclasses import replace

import numpy as np

from mbdae.errors import AccuracyWarning, SolverError
from mbdae.formulations import Form, system_for
from mbdae.integrators.base import Solver
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.solution import Solution
from mbdae.run.control import Controlled, motion_distance
from mbdae.run.defect import Defect, Suspect
from mbdae.system.assembly import SceneSystem
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared
from mbdae.system.start import Start

FINER = 10.0  #: accuracy over that of the closer run
BUDGET = 3000  #: residual evaluations between two points of the step
BETWEEN = 8  #: instants compared between two points
JUDGED = 5  #: suspicious steps of a run that are integrated again
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
            if not part.complete:
                return suspect.effect
            times = np.unique(np.r_[np.linspace(system.t0, stop, BETWEEN), part.t])
            worst = max(worst, self._distance(times, part))
            system.t0, system.y0, system.yp0 = stop, part.y[-1], part.yp[-1]
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
        """Largest distance at some times, in units of the whole run."""
        p, run = self.prepared, self.run
        sample = run.t[:: len(run.t) // 20 + 1]
        here = p.states(sample, run(sample))
        a, b = p.states(times, part(times)), p.states(times, run(times))
        joined = [tuple(np.concatenate([x, z]) for x, z in zip(side, here, strict=True))[:2] for side in (a, b)]
        return float(np.max(motion_distance(p, *joined)[: len(times)]))


def unseen(prepared: Prepared, form: Form, system: SceneSystem, run: Controlled,
           asked: float | None) -> tuple[list[str], float]:  # fmt: skip
    """A warning where the equations of motion contradict a run between the points its solver looked at; CPU time spent, s."""
    begin, solution, solver = time.process_time(), run.solution, run.solver
    if len(solution.t) < 2:
        return [], 0.0
    allowed = asked or _resolved(solver)
    suspects = Defect(prepared, system, solution, rough=solver.fixed).suspects(allowed)
    closer = Closer(prepared, form, solution, allowed)
    found = [(suspect, size) for suspect in suspects[:JUDGED] if (size := closer.difference(suspect)) > TOLD * suspect.allowed]
    return [_told(solution, found, allowed, len(suspects))] if found else [], time.process_time() - begin


def _resolved(solver: Solver) -> float:
    """The accuracy that a tolerance lets expect; with constant steps what is hardly ever asked for."""
    if not solver.rtol:
        return UNCONTROLLED
    return max(10.0, 1 / max(solver.factors.get(solver.label, {"": 0.1}).values())) * solver.rtol


def _told(run: Solution, found: list[tuple[Suspect, float]], allowed: float, suspects: int) -> str:
    """The worst step found, where the others are, and what to do."""
    found = sorted(found, key=lambda pair: -pair[1])
    suspect, size = found[0]
    i, felt = suspect.step, suspect.times[suspect.felt]
    step, begin, end = run.t[i + 1] - run.t[i], float(felt[0]), float(felt[-1])
    short = (end - begin + step / len(suspect.times)) / 2
    others = ", ".join(f"{run.t[s.step]:.6g} s" for s, _ in found[1:])
    also = f"; so it is in the steps from t = {others}" if others else ""
    if suspects > JUDGED:
        also += f" (of {suspects} suspicious steps, {JUDGED} were looked at)"
    return (f"from about t = {begin:.6g} to {end:.6g} s {suspect.equation} contradicts the run, whose step of {step:.3g} s did not "
            f"look there: followed closely, the motion differs by {size:.1e} (allowed {allowed:.0e}){also}. Something acts there "
            f"for a short time: take steps below {short:.2g} s, as with mb.RadauIIA(3, step={short:.1g}), or end a run at "
            f"t = {(begin + end) / 2:.6g} s and continue it with start=")  # fmt: skip
