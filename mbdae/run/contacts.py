"""The tolerance that a run with contact or friction needs.

Measured: with a tolerance below a hundredth (IDA) or a tenth (Radau IIA) of the penetration, both relative to the scene's length,
clearance and penetration are accurate to a few per cent. With a tolerance above ten times the penetration the motion is wrong
although solvers report success.

Contacts that close and open again inside single steps of a run.

Solvers look at the gaps of contacts at the ends of their steps and judge what lies between by the cubic polynomial through gaps
and their rates. Where a gap passes its minimum within a small fraction of a step, this polynomial does not show it: a small ball
flies past another one, or the tip of a body that spins freely passes a wall. Here the gaps are evaluated on the dense output of
the run, at random points inside every step first, and then at more and more points wherever they may close.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import pi, sqrt
from random import Random
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mbdae.deferred import Later, distinct, median
from mbdae.errors import OptionError
from mbdae.integrators.base import Solver
from mbdae.integrators.solution import Solution, systems_at
from mbdae.integrators.watched_arguments import zero_between
from mbdae.notation import counted
from mbdae.results.clearance import observed_outputs
from mbdae.results.contacts import contacts_of
from mbdae.system.base import Array, System
from mbdae.system.motion.states import gaps_of
from mbdae.system.prepare import Prepared

if TYPE_CHECKING:
    from mbdae.integrators import contact_steps
    from mbdae.laws.friction import Friction
else:
    contact_steps, Friction = Later("mbdae.integrators.contact_steps"), Later("mbdae.laws.friction", "Friction")

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
    limits = [float("inf")] + [solver.penetration_share * contact.depth / contact.size for contact in prepared.contacts]
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
             for place in zip(*(part.T for part in gaps[contact.place]), strict=True)]
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


SEED = 20240301
POINTS = 5  #: number of points inside every step at which gaps are evaluated first
LEVELS = 20  #: largest number of times that an interval is halved
AT_ONCE = 1000  #: largest number of steps whose gaps are evaluated together
DOUBT = 0.25  #: in either half of an interval a gap may differ from its cubic by this fraction of the difference in the middle
MOST = 20000  #: largest number of intervals that are halved together; where there are more, the others are not examined further
#: contacts are sought down to this fraction of the depth from which on they count: a stiff one that is hardly touched changes
#: speeds by more than its depth tells. Measured on bodies that graze stops: 3 times the accuracy from a tenth of it as depth
GRAZING, DAMPED, TINY = 1e-3, 1.5, 1e-300
FEW = 3  #: a contact counts as stepped over where it is closed at the ends of fewer than this number of steps

Pairs = Callable[[Array], Array]  #: times (k,) -> gap and its rate at every place of contact (k, places, 2)


class Hidden(NamedTuple):
    """A contact that closed inside a step, or at the ends of fewer than FEW steps: it is closed at the time `deepest` (s), and
    from `begin` to `end` (s), which may be wider where it closed inside a step."""

    name: str
    begin: float
    deepest: float
    end: float

    def ends(self) -> Array:
        """Times (s) at which steps end that do not pass over it."""
        return np.append(np.linspace(self.begin, self.end, FEW + 2), self.deepest)


def stepped_over(hidden: Sequence[Hidden]) -> str:
    """A warning of contacts that a run has stepped over."""
    first = hidden[0]
    return (f"{counted(len(hidden), 'contact')} stepped over (closed and opened within a step or two), first '{first.name}' at "
            f"t = {first.deepest:.6g} s: the motion from there on is wrong; take a smaller accuracy or tolerance, or constant "
            f"steps of at most "
            f"{(first.end - first.begin) / 2:.1g} s")


class _Intervals(NamedTuple):
    """k intervals of time inside steps in which a contact is sought: numbers of their steps and of the places of contact, begin
    and end (s), and gap and its rate (k, 2) at both ends."""

    step: Any
    place: Any
    a: Array
    b: Array
    left: Array
    right: Array
    doubt: Array  #: distance (k,) by which the gap in an interval may differ from the cubic through both ends

    def chosen(self, which: Any) -> _Intervals:
        """The intervals that a mask or an array of indices selects."""
        return _Intervals(*(part[which] for part in self))

    def may_close(self, depth: float) -> Any:
        """Whether the gap may fall below -depth."""
        drop = np.maximum(-self.left[:, 1], 0) + np.maximum(self.right[:, 1], 0)
        least = np.minimum(self.left[:, 0], self.right[:, 0]) - contact_steps.SLOPE * (self.b - self.a) * drop
        return least - self.doubt < -depth

    def halves(self, middle: Array, at: Array) -> _Intervals:
        """Both halves of every interval; at: gaps and rates (k, 2) in the middle (k,)."""
        doubt = DOUBT * _off_cubic(at[:, 0], 0.5, self.b - self.a, self.left, self.right)
        ends = np.concatenate([self.a, middle]), np.concatenate([middle, self.b])
        return _Intervals(np.tile(self.step, 2), np.tile(self.place, 2), *ends, np.concatenate([self.left, at]),
                          np.concatenate([at, self.right]), np.tile(doubt, 2))


def _off_cubic(gap: Array, s: Any, h: Array, left: Array, right: Array) -> Array:
    """Distance of gaps, at the fraction s of intervals of length h (s), from the cubics with gap and rate `left` and `right`
    (..., 2) at the ends of the intervals."""
    return np.asarray(np.abs(gap - contact_steps.cubic(s, h, left[..., 0], right[..., 0], left[..., 1], right[..., 1])))


def hidden_contacts(system: System, run: Solution, depth: float) -> list[Hidden]:
    """Contacts that close inside steps at whose ends they are open, or at the ends of fewer than FEW steps, in the order of time,
    by more than `depth` (m or rad), or so that the motion changes by more than that. Where a contact closes several times in one
    step, one of them is returned. They are counted in the statistics of the run."""
    if system.guards is None or len(run.t) < 2:
        return []
    pairs, random = _pairs_of(system, run), Random(SEED)
    every = pairs(run.t)
    found = list(_of_few_steps(run.t, every[:, :, 0]))
    for first in range(0, len(run.t) - 1, AT_ONCE):
        steps = run.t[first : first + AT_ONCE + 1]
        at_ends = every[first : first + AT_ONCE + 1, None]
        found += _in_steps(pairs, steps, at_ends, _drawn(random, len(steps) - 1), GRAZING * depth)
    found = _that_count(system, run, pairs, every, found, depth)
    run.stats.missed_dips = len(found)  # of those that the solver met, too, others do no harm
    hidden = [Hidden(contact_steps.guard_name(system, place), *times) for place, *times in found]
    return sorted(hidden, key=lambda one: one.deepest)


def _of_few_steps(t: Array, gaps: Array) -> Iterator[tuple[int, float, float, float]]:
    """(number of a contact, begin, time at which it is closed, end) for contacts that are closed at the ends of fewer than FEW
    steps: too few to show the force. gaps (n, places): at the ends t (n,) of steps."""
    for place, gap in enumerate(gaps.T):
        turns = np.flatnonzero(np.diff(gap < 0)) + 1
        turns = turns[1:] if gap[0] < 0 else turns
        for first, after in zip(turns[::2].tolist(), turns[1::2].tolist(), strict=False):
            if after - first < FEW:
                yield place, float(t[first - 1]), float(t[first + np.argmin(gap[first:after])]), float(t[after])


def _that_count(system: System, run: Solution, pairs: Pairs, every: Array, found: list[tuple[int, float, float, float]],
                depth: float) -> list[tuple[int, float, float, float]]:
    """Those of the contacts found that are deeper than `depth` or would change the motion by more: by the impulse of a spring
    with the duration of their impacts and a damper of DAMPED times the critical one, at most that of an elastic impact, over the
    largest speed at which the gap changes, times the distance by which it does."""
    kept = []
    for place, a, middle, b in found:
        times = np.array([a, middle, b])
        gap, rate = pairs(times)[:, place].T
        bend = max((rate[2] - rate[0]) / (b - a), TINY)
        deep = rate[1] ** 2 / (2 * bend) - gap[1]
        ends = zip(systems_at(run, times, system), times, run(times), strict=True)
        duration = min(float(np.asarray(one.guards(t, y)[2])[place]) for one, t, y in ends if one.guards is not None)
        w = pi / duration
        kick = min(2 * sqrt(2 * bend * deep), 2 * w * deep * (DAMPED + w * sqrt(8 * deep / bend) / 3))
        moves, fastest = np.ptp(every[:, place, 0]), np.max(np.abs(every[:, place, 1]))
        if max(-gap[1], kick / max(fastest, TINY) * moves) > depth:
            kept.append((place, _closing(pairs, place, a, middle), middle, _closing(pairs, place, b, middle)))
    return kept


def _closing(pairs: Pairs, place: int, outside: float, inside: float) -> float:
    """The time (s) at which a contact closes or opens; `outside` where it is closed too. inside: a time when it is."""

    def gap(part: float) -> float:
        return float(pairs(np.array([outside + part * (inside - outside)]))[0, place, 0])

    return outside + zero_between(gap, 1e-3) * (inside - outside) if gap(0.0) >= 0 > gap(1.0) else outside


def _drawn(random: Random, steps: int) -> Array:
    """Random numbers (steps, POINTS) from 0.1 to 0.9: where the first points are in their intervals of a step."""
    return np.array([random.uniform(0.1, 0.9) for _ in range(steps * POINTS)]).reshape(steps, POINTS)


def _pairs_of(system: System, run: Solution) -> Pairs:
    """The gaps and rates of the contacts on the dense output of a run."""

    def at(times: Array) -> Array:
        y, systems = run(times), systems_at(run, times, system)
        out = np.zeros(0)
        for one in dict.fromkeys(systems):
            chosen = np.array([other is one for other in systems])
            many = getattr(one.guards, "pairs", None)
            values = many(times[chosen], y[chosen]) if many is not None else _one_by_one(one, times[chosen], y[chosen])
            out = out if out.size else np.zeros((len(times), *values.shape[1:]))
            out[chosen] = values
        return out

    return at


def _one_by_one(system: System, times: Array, y: Array) -> Array:
    assert system.guards is not None
    return np.array([np.transpose(system.guards(float(t), state)[:2]) for t, state in zip(times, y, strict=True)])


def _in_steps(pairs: Pairs, t: Array, at_ends: Array, parts: Array, depth: float) -> list[tuple[int, float, float, float]]:
    """(number of a contact, begin, time at which it is closed, end) for contacts that close inside the steps between the times t
    (n+1,). at_ends (n+1, 1, places, 2): gaps and rates there; parts (n, POINTS): every step is divided into POINTS intervals;
    fraction of each interval at which gaps are evaluated first."""
    steps = len(t) - 1
    inner = t[:-1, None] + (np.arange(POINTS) + parts) / POINTS * np.diff(t)[:, None]
    times = np.concatenate([t[:-1, None], inner, t[1:, None]], axis=1)
    inside = pairs(inner.ravel()).reshape(steps, POINTS, -1, 2)
    values = np.concatenate([at_ends[:-1], inside, at_ends[1:]], axis=1)
    is_open = (values[:, 0, :, 0] >= 0) & (values[:, -1, :, 0] >= 0)
    found = dict[tuple[int, int], tuple[int, float, float, float]]()
    for s, i in np.argwhere(is_open & (np.min(values[:, 1:-1, :, 0], axis=1) < -depth)).tolist():
        k = int(np.argmin(values[s, :, i, 0]))
        found[s, i] = i, float(times[s, k - 1]), float(times[s, k]), float(times[s, k + 1])
    left = _first(times, values, is_open)
    for _ in range(LEVELS):
        left = left.chosen(left.may_close(depth))
        left = left.chosen([(s, i) not in found for s, i in zip(left.step.tolist(), left.place.tolist(), strict=True)])
        if not len(left.a):
            break
        left = left.chosen(slice(MOST))
        middle = (left.a + left.b) / 2
        once = distinct(middle)
        at = pairs(once)[np.searchsorted(once, middle), left.place]
        for k in np.flatnonzero(at[:, 0] < -depth).tolist():
            key = int(left.step[k]), int(left.place[k])
            found.setdefault(key, (key[1], float(left.a[k]), float(middle[k]), float(left.b[k])))
        left = left.halves(middle, at)
    return list(found.values())


def _first(times: Array, values: Array, is_open: Any) -> _Intervals:
    """The intervals between the first points of steps, times (n, points), with gaps and rates (n, points, places, 2)."""
    h = times[:, 2:, None] - times[:, :-2, None]
    s = (times[:, 1:-1, None] - times[:, :-2, None]) / h
    off = np.zeros(values.shape[:3])
    off[:, 1:-1] = _off_cubic(values[:, 1:-1, :, 0], s, h, values[:, :-2], values[:, 2:])
    step, part, place = (x.ravel() for x in np.indices((len(times), times.shape[1] - 1, values.shape[2])))
    kept = is_open[step, place]
    step, part, place = step[kept], part[kept], place[kept]
    return _Intervals(step, place, times[step, part], times[step, part + 1], values[step, part, place],
                      values[step, part + 1, place], np.maximum(off[step, part, place], off[step, part + 1, place]))
