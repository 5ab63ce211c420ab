"""Roots of random scenes against their exact equations: within their bounds, and `stable` never wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from known_roots.judge import judged
from runner import Case, Claim, Found, allowed

claim = Claim("known_roots", "every root of a linearisation lies within the bound of its error, `stable` is never wrong, "
              "undecided in at most 5 % and in no conservative scene, and the median bound is at most 1e3 errors or 1e-10 of the "
              "root", 0.0, "scenes", "the same equations by hand, eigenvalues by mpmath in 80 digits")
QUICK, WHOLE = [*range(30), *range(1000, 1006)], [*range(300), *range(1000, 1300)]
UNDECIDED = 0.05


def judge(seeds: Sequence[int]) -> list[Found]:
    """Counts of what is wrong, with the seeds."""
    found = [judged(seed) for seed in seeds]
    outside, wrong = ([str(v.seed) for v in found if bad(v)] for bad in (lambda v: v.outside, lambda v: v.wrong))
    undecided = [v for v in found if v.said is None]
    sure = sum(v.conservative for v in undecided)
    vague = max(len(undecided) - np.ceil(allowed(UNDECIDED, seeds) * len(found)), 0.0) + sure
    tight = np.concatenate([v.tight for v in found])
    return [Found(len(outside), note=f"outside of their bounds: {', '.join(outside) or 'none'}; {len(tight)} roots"),
            Found(len(wrong), note=f"wrong verdicts: {', '.join(wrong) or 'none'}"),
            Found(vague, note=f"undecided: {', '.join(str(v.seed) for v in undecided) or 'none'}; {sure} of them conservative"),
            Found(float(np.median(tight) < 1),
                  note=f"bounds of at most 1e3 errors or 1e-10 of the root: {np.mean(tight):.0%}")]


def cases() -> list[Case]:
    return [Case(f"{len(QUICK)} scenes", "linearize", lambda: judge(QUICK)),
            Case("scenes", "linearize", judge, slow=True, parts=WHOLE)]
