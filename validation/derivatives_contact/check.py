"""Derivatives through contacts against those of the same mechanisms by equations of their own, and what an adjoint costs."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from derivatives_contact.judged import ACCURACIES, judge, times_of
from derivatives_contact.scenes import MECHANISMS
from runner import Case, Claim, Found

import mbdae as mb
from mbdae.derivatives import Refined

claim = Claim("derivatives_contact", "derivatives through contacts are right within 1e-4 (balls) and 1e-2 (five impacts of a "
              "slider-crank with clearance) at accuracy 1e-8, `.error` covers them, and an adjoint costs at most 3.5 runs", 0.0,
              "derivatives", "equations of their own in SciPy, whose steps end on touches, with their variational equations")
COST, RUNS = 3.5, 5  #: bar of the adjoint's cost; runs of which the cheapest counts
UNKNOWN = 3  #: number of the unknown whose value at the end is the objective
SEEDS = range(40)


def cost(which: str) -> list[Found]:
    """CPU time of an adjoint over that of the run whose steps end on touches, by both methods."""
    one, worst, notes = MECHANISMS[which], 0.0, []
    p = one.drawn(np.random.default_rng([1, 48]))
    end = float(times_of(one, p)[-1])
    for solver in (mb.RadauIIA(3), mb.DOP853()):
        r = one.build(p).simulate(end, ACCURACIES[-1], solver=solver)
        refined = Refined(r, list(one.names.values()))
        (method, asked), level = refined.asked(), refined.level()
        derived, (m, n) = level.derived, (len(level.run.t) - 1, level.run.y.shape[1])
        ends, inner = np.zeros((m + 1, n)), np.zeros((m, derived.steps.stages - 1, n))
        ends[-1, UNKNOWN] = 1.0
        run, adjoint = (least(work) for work in (lambda of=refined, method=method, asked=asked: method.run(of.system, asked),
                                                 lambda of=derived, ends=ends, inner=inner: of.adjoint(ends, inner)))
        worst = max(worst, adjoint / run)
        notes.append(f"{solver.label}: {m} steps, {len(derived.landings)} touches, run {1e3 * run:.1f} ms, adjoint "
                     f"{1e3 * adjoint:.1f} ms")
    return [Found(worst, COST, "runs", "adjoint", note="; ".join(notes))]


def least(work: Any) -> float:
    """CPU time (s) of the cheapest of some repetitions."""
    work()
    found = []
    for _ in range(RUNS):
        begin = time.process_time()
        work()
        found.append(time.process_time() - begin)
    return min(found)


def cases() -> list[Case]:
    some = [Case("ball", "both", lambda: judge(["ball 1", "ball 8"])),
            Case("slider-crank", "both", lambda: judge(["slider-crank 1"]))]
    every = Case("drawn", "both", judge, slow=True, parts=[f"{which} {seed}" for which in MECHANISMS for seed in SEEDS])
    return [*some, every, *(Case(f"cost, {which}", "both", lambda which=which: cost(which)) for which in MECHANISMS)]
