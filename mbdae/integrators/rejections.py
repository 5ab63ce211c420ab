"""Runs that reject most of their steps say so."""

from __future__ import annotations

from mbdae.errors import warn
from mbdae.integrators.solution import Solution

#: a run is said to reject too many steps where these are at least MANY times those accepted, and where FEW steps or more were
#: accepted. Measured: at most 0.51 times in the examples, with each of the default solver, IDA and Radau IIA, contacts included;
#: 0.87 times, at 20 times the cost, where IDA stays at short steps (transistor amplifier)
MANY, FEW = 0.75, 200


def rejecting(run: Solution) -> str:
    """The warning about a run that rejects most of its steps; "" where it does not. Steps that were repeated because of a contact
    or a kink do not count: that is how these are found."""
    stats = run.stats
    rejected = stats.rejected - stats.dips - stats.retaken
    if stats.steps < FEW or rejected < MANY * stats.steps:
        return ""
    return (f"{run.solver.label} rejected {rejected} attempts of steps and accepted {stats.steps}: it makes far shorter steps "
            "than the solution needs; see whether the Jacobian, the index and the scales of the unknowns are right, or take "
            "another solver")


def said(run: Solution) -> Solution:
    """The run itself, after the warning where it rejects most of its steps."""
    if text := rejecting(run):
        warn(text)
    return run
