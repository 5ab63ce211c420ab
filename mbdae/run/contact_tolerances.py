"""The tolerance that a run with contact or friction needs.

Measured: with a tolerance below a hundredth (IDA) or a tenth (Radau IIA) of the penetration, both relative to the scene's length,
clearance and penetration are accurate to a few per cent. With a tolerance above ten times the penetration the motion is wrong
although solvers report success.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from mbdae.deferred import median
from mbdae.errors import OptionError
from mbdae.integrators.base import Solver
from mbdae.integrators.solution import Solution
from mbdae.laws.friction import Friction
from mbdae.results.clearance import observed_outputs
from mbdae.results.contacts import contacts_of
from mbdae.system.motion.states import gaps_of
from mbdae.system.prepare import Prepared

#: sticking is resolved where the tolerance of velocities (rtol times the typical speed) is at most this fraction of the velocity
#: over which friction changes
RESOLVED = 0.01
#: friction need not be resolved in a joint whose sliding stays faster than this many times the velocity over which its friction
#: changes
SLOW = 10.0
#: an rtol is refused where the position tolerance it means is more than this many times the expected penetration: contact would
#: be lost
WRONG = 10.0


def slowest_velocities(prepared: Prepared) -> Iterator[tuple[str, Any, float]]:
    """(item, friction law, velocity in m/s over which its coefficient changes) for every friction law of a scene."""
    for _, _, instance in prepared.model.instances():
        for friction in (part for part in instance.law.parts if isinstance(part, Friction)):
            velocity = friction.smallest_velocity()
            if velocity is not None:
                yield instance.item, friction, velocity


def typical_speed(prepared: Prepared) -> float:
    """Typical velocity of the scene, m/s, to which velocity tolerances are relative."""
    return prepared.length / prepared.time


def largest_tolerance(prepared: Prepared, solver: Solver) -> float:
    """The largest rtol with which a solver resolves contacts and friction of a scene; inf without them."""
    limits = [float("inf")]
    limits += [solver.penetration_share * contact.depth / contact.size for contact in prepared.contacts]
    limits += [RESOLVED * velocity / typical_speed(prepared) for _, _, velocity in slowest_velocities(prepared)]
    return min(limits)


def resolving(prepared: Prepared | None, solver: Solver, run: Solution, ceiling: float) -> float:
    """The largest rtol that resolves the contacts of a run, by the median of the largest penetrations of every contact, and
    friction where sliding reverses; `ceiling` where no contact closed."""
    if prepared is None or not prepared.contacts:
        return ceiling
    q, u, _ = prepared.states(run.t, run.y)
    gaps = gaps_of(prepared.mechanics, run.t, q, u)
    found = [contacts_of(run.t, *place)[2] / contact.size for contact in prepared.contacts
             for place in zip(*(part.T for part in gaps[contact.place]), strict=True)]  # fmt: skip
    peaks = [peak for peak in (float(median(deep)) for deep in found if len(deep)) if peak > 0]
    limits = [RESOLVED * velocity / typical_speed(prepared) for _, velocity in reversing(prepared, run)]
    return min([solver.penetration_share * min(peaks), *limits]) if peaks else ceiling


def reversing(prepared: Prepared, run: Solution) -> Iterator[tuple[str, float]]:
    """(item, velocity in m/s over which its friction changes) of every joint whose sliding becomes that slow while in contact."""
    slowest: dict[str, float] = {}
    for g, p, values in prepared.mechanics.evaluate(observed_outputs, run.t, *prepared.states(run.t, run.y)):
        at = [[o for o, (name, _) in enumerate(p.targets) if name == wanted] for wanted in ("gap", "slip")]
        if not all(at):
            continue
        for i, instance in enumerate(prepared.model.groups[g].instances):
            gap, slip = (values[:, i, places] for places in at)
            slowest[instance.item] = float(np.min(np.abs(slip[gap < 0]), initial=np.inf))
    for item, _, velocity in slowest_velocities(prepared):
        if slowest.get(item, 0.0) < SLOW * velocity:
            yield item, velocity


def refuse_unresolved(prepared: Prepared, solver: Solver) -> None:
    """Raise OptionError where the rtol of a solver is too large to resolve contact or friction, with the largest that does."""
    wanted, rtol = largest_tolerance(prepared, solver), solver.rtol
    tightest = solver.tightest[""]
    for contact in prepared.contacts:
        if rtol is not None and rtol * contact.size > WRONG * contact.depth:
            raise OptionError(
                f"rtol = {rtol:g} in {solver.label} means {rtol * contact.size:.2g} {contact.unit}, '{contact.item}' is expected "
                f"to penetrate by {contact.depth:.2g} {contact.unit}: contact would be lost silently; use rtol = "
                f"{max(wanted, tightest):.1g} or an accuracy"
            )
    for item, friction, velocity in slowest_velocities(prepared):
        limit = RESOLVED * velocity / typical_speed(prepared)
        name = type(friction).__name__
        if (rtol is not None and rtol > 100 * limit) or limit < tightest:
            means = max(rtol or 0.0, tightest) * typical_speed(prepared)
            raise OptionError(
                f"friction of '{item}' ({name}) changes within {velocity:.2g} m/s, {solver.label} resolves {means:.2g} m/s "
                f"with rtol = {max(rtol or 0.0, tightest):.1g}: sticking would be lost, or steps be tiny; raise that "
                f"velocity of the friction law to {means / RESOLVED:.2g} m/s"
                + ("" if limit < tightest else f", or use rtol = {limit:.1g}")
            )
