"""What is to be said of the run that is kept, and whether it is a result at all."""

from __future__ import annotations

import math

import numpy as np

from mbdae.integrators.base import Solver
from mbdae.results.accuracy import Accuracy
from mbdae.results.result import Result
from mbdae.run.balance import drift_of_energy
from mbdae.run.checks import doubts
from mbdae.run.control import Controlled
from mbdae.run.drift import drifted
from mbdae.run.norms import unequal_norms
from mbdae.run.passages import passages
from mbdae.run.reliability import Judgement, doubts_of_steps, judged
from mbdae.system.model.inputs import expressions_of
from mbdae.system.prepare import Prepared
from mbdae.ties import largest

LOOKED_AT = 2000  #: steps at which constraint rows are looked at
JUDGED = 1000  #: outputs, or steps where an input depends on time, at which energies are judged


def judgement_of(found: Result, run: Controlled, drifts: bool) -> Judgement:
    """Every warning of a run; drifts: joints are held on the level of accelerations alone."""
    known, timed = found.info.accuracy, bool(expressions_of(found.prepared.model))
    times = run.solution.t if timed else found.t  # a short input lies between outputs
    judgement = judged(found if times is found.t and len(times) <= JUDGED else found(times[:: len(times) // JUDGED + 1]), run)
    singular = passages(found, known.asked)
    off, broken = _broken_rows(found.prepared, run, known.asked)
    notes = [*_warnings(found.prepared, run, known, drifts, broken), *doubts_of_steps(run), *judgement.notes, *singular,
             *unequal_norms(found), *drift_of_energy(found, run, known.asked)]  # fmt: skip
    return Judgement(tuple(notes), judgement.reliable, bool(singular), off)


def _warnings(prepared: Prepared, run: Controlled, known: Accuracy, drifts: bool, broken: list[str]) -> list[str]:
    notes = _missed(known, run.solver)
    if known.met is False or run.solver.fixed or known.asked is None:
        notes += run.notes
    notes += (drifted(prepared, run, known.asked) if drifts else []) or broken
    return notes + doubts(prepared)


def _missed(known: Accuracy, solver: Solver) -> list[str]:
    """Errors of the motion, in time and of the mesh, that are above the accuracy asked."""
    asked, notes = known.asked, []
    if asked is None:
        return []
    if known.motion is not None and not known.motion <= asked:
        found = f"about {known.motion:.1e}" if math.isfinite(known.motion) else "not known: every tighter run failed"
        other = "" if solver.label == "RadauIIA(3)" else " and solver=mb.RadauIIA(3)"
        notes.append(f"accuracy {asked:g} was asked, the error is {found}: accuracy={asked / 10:g}{other} may come nearer; where "
                     f"the motion is chaotic, only a shorter run does")  # fmt: skip
    if known.mesh is not None and not known.mesh <= asked:
        notes.append(f"accuracy {asked:g} was asked, the mesh of the beams is off by about {known.mesh:.1e}: give them more "
                     f"elements or a higher order")  # fmt: skip
    return notes


def _broken_rows(prepared: Prepared, run: Controlled, asked: float | None) -> tuple[float, list[str]]:
    """How far constraint rows, the redundant ones included, are from kept (over the scene's length, or rad), where that is more
    than the accuracy allows; and what is to be said of it."""
    m, t = prepared.with_all_rows, run.solution.t
    if not m.m:
        return 0.0, []
    t = t[:: len(t) // LOOKED_AT + 1]
    off = np.max(np.abs(m.position_residual(t, prepared.states(t, run.solution(t))[0])), axis=0) / max(prepared.length, 1.0)
    off[[row.name in {r.name for r, _ in prepared.rank.doubtful} for row in m.rows]] = 0.0  # told by `doubts`
    worst = largest(off)
    if off[worst] <= 10 * (asked if asked is not None else 1e-6):
        return 0.0, []
    driven = any(c.prescribed is not None for c in prepared.model.scene.joints)
    why = "prescribed motions may contradict each other later on" if driven else "the loops do not stay closed"
    return float(off[worst]), [f"constraint {m.rows[worst].name} is violated by {off[worst]:.1e}: {why}"]
