"""A zero of a continuous function by Brent's method, without SciPy, whose import takes longer (0.15 s) than many runs.

The arguments of functions that switch or vary within a narrow range, over one step of a solver.

The scale PHI(u) measures an argument u in widths of its function: where the function varies, PHI changes by one while u changes
by about one width; where the function is constant, PHI is. For a power u^n it is proportional to ln|u|. Arguments are evaluated
on the polynomial of the step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from mbdae.errors import internal
from mbdae.symbolic.rebuild import limited, scales
from mbdae.system.base import Array, Switches

ITERATIONS = 100


def zero_between(f: Callable[[float], float], within: float) -> float:
    """A zero of f in [0, 1], with an error of at most `within`; f(0) and f(1) differ in sign, or one of them is 0 (else
    ValueError).

    b: the best point so far; a: the one before it; c: a point with the other sign, so that the zero lies between b and c. The
    next point is the zero of the parabola or straight line through these points, or, where that shortens the interval too slowly,
    the middle between b and c."""
    a, b = 0.0, 1.0
    at_a, at_b = f(a), f(b)
    if at_a == 0 or at_b == 0:
        return a if at_a == 0 else b
    if (at_a < 0) == (at_b < 0):
        raise internal(f"a zero was searched between two times at which the watched value is {at_a:g} and {at_b:g}: it needs "
                       "values of opposite sign")
    c, at_c, step, before = a, at_a, b - a, b - a
    for _ in range(ITERATIONS):
        if abs(at_c) < abs(at_b):
            a, b, c, at_a, at_b, at_c = b, c, b, at_b, at_c, at_b
        half = (c - b) / 2
        if at_b == 0 or abs(half) < within:
            break
        before, step = _next(before, step, half, (a - b, at_a / at_b), (c - b, at_c / at_b), within)
        a, at_a = b, at_b
        b += step if abs(step) > within else within if half > 0 else -within
        at_b = f(b)
        if (at_b < 0) == (at_c < 0):
            c, at_c, step, before = a, at_a, b - a, b - a
    return b


def _next(before: float, step: float, half: float, a: tuple[float, float], c: tuple[float, float],
          within: float) -> tuple[float, float]:
    """The last and the next step from the best point b. before: the step before the last; half: half of the way to c; a, c:
    distance of these points from b, and ratio of their values to that at b."""
    (to_a, ratio_a), (to_c, ratio_c) = a, c
    if abs(before) <= within or abs(ratio_a) <= 1:
        return half, half
    if to_a == to_c:  # a and c are the same point: the straight line through b and c
        found = to_c / (1 - ratio_c)
    else:  # the parabola through a, b and c, position as a function of the value
        found = to_a * ratio_c / ((1 - ratio_a) * (ratio_c - ratio_a)) - to_c * ratio_a / ((1 - ratio_c) * (ratio_c - ratio_a))
    inside = found / half > 0 and 2 * abs(found) < min(abs(before), 3 * abs(half) - within)
    return (step, found) if inside else (half, half)


#: arguments beyond which a function counts as constant: -FLAT where it decays (exp(-25) = 1e-11), STEEP for sinh and exp,
#: SATURATED for tanh (tanh 9 = 1 - 3e-8)
FLAT, STEEP, SATURATED = 25.0, 40.0, 9.0
#: of a power u^n, PHI is ln|u|, limited to this range
LOGARITHMS = (-90.0, 40.0)
#: an extremum between points may exceed the value at the nearest point by this fraction of the difference to the point beside it
BEYOND = 0.5
#: an extremum is located where the scaled argument PHI may differ by more than this between it and the nearest point
MATTERS = 0.25
#: an extremum whose value is below this fraction of the argument's range in the step may cross the kink, at argument 0: it is
#: located until its neighbouring points differ from it by at most this fraction of its value
MARGIN = 1e-2
#: longest step during an impact, as a fraction of the duration of the impact; with 0.1 Radau IIA needs up to twice the steps for
#: the same error
IMPACT = 0.2
#: shortest step, relative to the time t; shorter ones would be round-off of t
ROUND = 1e3 * float(np.finfo(float).eps)
#: a search in an interval evaluates SECTIONS points per round and goes on in a quarter (for an extremum) or an eighth of it; most
#: rounds for an extremum (ROUNDS), and for the place where an argument passes a value (PLACES)
SECTIONS, ROUNDS, PLACES = 9, 20, 9
#: a place in the step is located to this fraction of its distance from the start of the step, and so far that PHI changes by less
#: than MATTERS, in at most PLACES rounds
EXACT = 1e-3
SMALL = 1e-3  #: the rate of a scaled argument PHI is its difference quotient over twice this fraction of the step
#: change of an argument, relative to its largest magnitude in the step, up to which the change may be round-off
ROUND_OFF = 1e-10
TINIEST = 1e-300  #: added to a magnitude before its logarithm is taken, so that it is finite


_between_logarithms = limited(*LOGARITHMS)
#: kind of argument -> its scale PHI; that of a kink is constant, because only the sign of its argument matters
STRETCHES: dict[str, Callable[[Any], Any]] = {
    **scales(SATURATED, STEEP), "kink": lambda u: 0.0 * u, "decaying": limited(-FLAT, STEEP),
    "power": lambda u: _between_logarithms(np.log(np.abs(u) + TINIEST)),
}

#: largest number of values of unknowns that are evaluated together (except for a single step with more): they stay in the cache
#: of the processor
TOGETHER = 2**17
Inside = Callable[[Array], Array]  #: fractions (k,) of a step -> y (k, n) there, on the polynomial of the step


def _interpolation(nodes: Array, at: Array) -> Array:
    """Matrix (k, nodes) that turns values at `nodes` into those of their interpolating polynomial at the points `at` (k,)."""
    V, degree = np.polynomial.chebyshev.chebvander, len(nodes) - 1
    return np.asarray(np.linalg.solve(V(2 * nodes - 1, degree).T, V(2 * at - 1, degree).T).T)


NODES = 0.5 * (1 - np.cos(np.pi * np.arange(8) / 7))  #: Chebyshev's points of [0, 1], both ends included
FINE = np.linspace(0.0, 1.0, 33)
TO_FINE = _interpolation(NODES, FINE)
#: matrices that turn the values at `NODES` into (TO_SLOPES) the slopes at start and end, and (TO_RISES) the slope at the start,
#: the differences between neighbouring points of FINE, and the slope at the end
TO_SLOPES = np.diff(_interpolation(NODES, np.array([0.0, 1e-6, 1.0 - 1e-6, 1.0])), axis=0)[::2] * 1e6
TO_RISES = np.vstack([TO_SLOPES[:1], np.diff(TO_FINE, axis=0), TO_SLOPES[1:]])
#: matrix that turns the values at `NODES` into those at start and end, and just after and before the end on the tangent there
TO_ENDS = np.vstack([np.eye(8)[[0, -1]], np.eye(8)[-1] + SMALL * TO_SLOPES[1], np.eye(8)[-1] - SMALL * TO_SLOPES[1]])


def cubic_weights(part: Array) -> Array:
    """Weights (k, 4) of y and h y' at the start and at the end of a step in their cubic polynomial, at fractions (k,) of the
    step."""
    s, r = part, 1 - part
    return np.stack([r * r * (1 + 2 * s), s * r * r, s * s * (3 - 2 * s), -s * s * r], axis=1)


AT_NODES = cubic_weights(NODES)
#: matrix that turns the values at `NODES` into the last two Chebyshev coefficients of their polynomial, which estimate its error
TO_TAIL = np.linalg.inv(np.polynomial.chebyshev.chebvander(2 * NODES - 1, 7))[-2:]
#: ratio of the polynomial's error to the argument's change in the step, above which arguments are evaluated at all points of FINE
POOR = 1e-3


def cubic_of_step(h: float, start: tuple[Array, Array], end: tuple[Array, Array]) -> Inside:
    """The cubic through y and y' (n,) at both ends of a step of h (s)."""
    ends = np.array([start[0], h * start[1], end[0], h * end[1]])
    return lambda part: np.asarray((AT_NODES if part is NODES else cubic_weights(part)) @ ends)


class Course(NamedTuple):
    """One argument over a step: its values u (m,) at fractions s (m,) of the step, between which it is monotone."""

    s: Array
    u: Array

    def changes(self) -> Any:
        """Indices of the intervals, between neighbouring points, in which the argument changes its sign."""
        return np.flatnonzero((self.u[1:] < 0) != (self.u[:-1] < 0))


class StepArguments:
    """The na arguments of a system's switches over the last step.

    at_nodes (8, na): their values at `NODES`; kinks (na,) bool: which of them switch a law where they vanish.
    """

    def __init__(self, switches: Switches) -> None:
        self.switches, kinds = switches, np.array(switches.kinds)
        columns = {kind: np.flatnonzero(kinds == kind) for kind in dict.fromkeys(kinds.tolist())}
        self._by_kind = [(STRETCHES[kind], _slice(where)) for kind, where in columns.items()]
        self._weights = np.asarray(switches.weights, dtype=float)
        self.kinks, self._signed = kinds == "kink", np.isin(kinds, ("kink", "power"))

    def look(self, t: float, h: float, inside: Inside) -> None:
        """Evaluate the arguments over a step of h from t."""
        self.t, self.h, self.inside = t, h, inside
        self.at_nodes = self.at(NODES)
        self._rise = TO_RISES @ self.at_nodes
        tail, size = np.abs(TO_TAIL @ self.at_nodes).sum(axis=0), np.abs(self.at_nodes).max(axis=0)
        self._fine: Array | None = None
        # where the polynomial of some argument is too inaccurate, all are evaluated at the fine points
        if np.any(tail > POOR * np.ptp(self.at_nodes, axis=0) + ROUND_OFF * size):
            self._fine = self.at(FINE)
            self._rise[1:-1] = np.diff(self._fine, axis=0)
        self._ends = self.stretched(TO_ENDS @ self.at_nodes)

    def quiet(self, t: Array, y: Callable[[Array, slice], Array], n: int, limit: float) -> tuple[Any, Array]:
        """For m steps between times t (m+1,): whether (m,) no argument has an extremum that matters, a change of sign or a
        variation of PHI above `limit`, and the largest rate (m,) of a PHI at the end of each step, 1/s. y(parts, steps): n
        unknowns at fractions (8,) of a slice of the steps."""
        h, few = np.diff(t), max(TOGETHER // (len(NODES) * n), 1)
        times = t[:-1, None] + NODES * h[:, None]
        U = np.concatenate([self.switches.arguments(times[some].ravel(), y(NODES, some).reshape(-1, n))
                            for some in (slice(first, first + few) for first in range(0, len(h), few))])
        U = U.reshape(len(h), len(NODES), -1)
        rise, size = TO_RISES @ U, np.abs(U).max(axis=1)
        tail, ends = np.abs(TO_TAIL @ U).sum(axis=1), TO_ENDS @ U
        stretched = self.stretched(ends.reshape(4 * len(h), -1)).reshape(ends.shape)
        turns = (rise[:, :-1] * rise[:, 1:] <= 0) & (np.maximum(np.abs(rise[:, :-1]), np.abs(rise[:, 1:]))
                                                     > ROUND_OFF * size[:, None])
        turned = turns.any(axis=1)
        if turned.any():
            turned &= ~self._mild(U, rise, limit)
        loud = turned | (tail > POOR * np.ptp(U, axis=1) + ROUND_OFF * size)
        loud |= (np.abs(stretched[:, 1] - stretched[:, 0]) > limit) | ((U[:, 0] < 0) != (U[:, -1] < 0))
        return ~loud.any(axis=1), np.abs(stretched[:, 2] - stretched[:, 3]).max(axis=1) / (2 * SMALL * h)

    def _mild(self, U: Array, rise: Array, limit: float) -> Any:
        """(m, na) whether arguments vary so little in steps that their extrema there do not matter. U, rise (m, ..., na): values
        at NODES, and what TO_RISES makes of them."""
        F, beyond = TO_FINE @ U, BEYOND * np.abs(rise[:, 1:-1]).max(axis=1)
        low, high = F.min(axis=1) - beyond, F.max(axis=1) + beyond
        most = np.abs(self.stretched(high) - self.stretched(low))
        return (most <= min(MATTERS, limit / len(FINE))) & ~self.kinks & (~self._signed | ((low < 0) == (high < 0)))

    @property
    def fine(self) -> Array:
        """Arguments (33, na) at the points FINE."""
        if self._fine is None:
            self._fine = TO_FINE @ self.at_nodes
        return self._fine

    def at(self, parts: Array) -> Array:
        """Arguments (k, na) at fractions (k,) of the step."""
        return self.switches.arguments(self.t + parts * self.h, self.inside(parts))

    def stretched(self, U: Array) -> Array:
        """Arguments U (k, na) on their scales PHI, in widths of their functions."""
        out = np.empty_like(U)
        for stretch, columns in self._by_kind:
            out[:, columns] = stretch(U[:, columns])
        return np.asarray(out * self._weights)

    def stretch(self, i: int, u: Any) -> Any:
        """Values u of argument i on its scale PHI, in widths of its function."""
        return STRETCHES[self.switches.kinds[i]](u) * self._weights[i]

    def rate(self) -> float:
        """Largest rate of a scaled argument PHI at the end of the step, in widths per second."""
        return float(np.max(np.abs(self._ends[2] - self._ends[3]))) / (2 * SMALL * self.h)

    def suspects(self, limit: float) -> Any:
        """(na,) whether the PHI of an argument varies by more than `limit`, or the argument crosses a kink or has an extremum at
        which it may do either."""
        turns = self._turns()
        if turns is not None:
            return self._turning(turns, limit)
        over = np.abs(self._ends[1] - self._ends[0]) > limit
        return over | (self.kinks & ((self.at_nodes[0] < 0) != (self.at_nodes[-1] < 0)))

    def _turns(self) -> Any:
        """(33, na) bool: points of FINE at which arguments have an extremum larger than round-off; None where there is none."""
        rise = self._rise
        turns = rise[:-1] * rise[1:] <= 0
        if turns.any():
            size = np.abs(rise)
            turns &= np.maximum(size[:-1], size[1:]) > ROUND_OFF * np.abs(self.at_nodes).max(axis=0)
        return turns if turns.any() else None

    def _turning(self, turns: Any, limit: float) -> Any:
        """`suspects` for a step with extrema; turns (33, na) bool: points of FINE at which arguments have them."""
        F, rise = self.fine, self._rise
        steps, negative, stretched = np.abs(rise[1:-1]), F < 0, self.stretched(F)
        height = np.maximum(np.vstack([steps[:1], steps]), np.vstack([steps, steps[-1:]]))
        farther = F + BEYOND * height * np.where((rise[:-1] > 0) | (rise[1:] < 0), 1.0, -1.0)
        matters = np.abs(self.stretched(farther) - stretched) > MATTERS
        matters |= self._signed & ((farther < 0) != negative)
        matters |= self.kinks & (np.abs(F) < MARGIN * np.ptp(F, axis=0))
        crosses = self.kinks & np.any(negative[1:] != negative[:-1], axis=0)
        over = np.abs(np.diff(stretched, axis=0)).sum(axis=0) > limit
        return over | crosses | np.any(turns & matters, axis=0)

    def course(self, i: int) -> Course:
        """Argument i at the points FINE of the step and at its extrema between them."""
        s, u, rise, last = FINE.tolist(), self.fine[:, i].tolist(), self._rise[:, i], len(FINE) - 1
        turns = self._turns()
        for j in reversed(np.flatnonzero(turns[:, i])) if turns is not None else ():
            sign = 1.0 if rise[j] > 0 or rise[j + 1] < 0 else -1.0
            part, value = self._extremum(i, FINE[max(j - 1, 0)], FINE[min(j + 1, last)], sign)
            if part == FINE[j]:
                u[j] = value
            elif 0 < part < 1:
                at = j if part < FINE[j] else j + 1
                s.insert(at, part)
                u.insert(at, value)
        return Course(np.array(s), np.array(u))

    def _extremum(self, i: int, a: float, b: float, sign: float) -> tuple[float, float]:
        """Fraction of the step and value of the largest (sign 1) or smallest (sign -1) argument i between fractions a and b."""
        part, value = 0.5 * (a + b), 0.0
        for _ in range(ROUNDS):
            s = np.linspace(a, b, SECTIONS)
            u = self.at(s)[:, i]
            best = int(np.argmax(sign * u))
            part, value = float(s[best]), float(u[best])
            # the interval was found on a polynomial through few points: the extremum may lie beyond its end
            if (best == 0 and a > 0) or (best == SECTIONS - 1 and b < 1):
                a, b = max(part - (b - a), 0.0), min(part + (b - a), 1.0)
                continue
            low, high = max(best - 1, 0), min(best + 1, SECTIONS - 1)
            a, b = float(s[low]), float(s[high])
            if self._settled(i, value, sign * float(np.ptp(u[low : high + 1]))):
                break
        return part, value

    def _settled(self, i: int, value: float, change: float) -> bool:
        """Whether an extremum of argument i near `value` is located well enough; change: difference to its neighbouring
        points."""
        farther = value + BEYOND * change
        if self._signed[i] and (farther < 0) != (value < 0):
            return False
        if self.kinks[i]:
            return abs(change) <= MARGIN * abs(value)
        return bool(abs(self.stretch(i, farther) - self.stretch(i, value)) < MATTERS)

    def zero(self, i: int, course: Course, k: int) -> float:
        """Fraction of the step just before argument i changes its sign in interval k of its course."""
        first = course.u[k] < 0
        return self.place(i, course, k, lambda v: (v < 0) != first)[0]

    def place(self, i: int, course: Course, k: int, beyond: Callable[[Any], Any]) -> tuple[float, float]:
        """Two fractions of the step between which argument i begins to satisfy the condition `beyond` in interval k of its
        course."""
        a, b = float(course.s[k]), float(course.s[k + 1])
        for _ in range(PLACES):
            s = np.linspace(a, b, SECTIONS)
            u = self.at(s)[:, i]
            over = np.flatnonzero(beyond(u))
            first = int(over[0]) if len(over) else SECTIONS - 1
            before = max(first - 1, 0)
            a, b = float(s[before]), float(s[first])
            if b - a < EXACT * b and abs(self.stretch(i, u[first]) - self.stretch(i, u[before])) < MATTERS:
                break
        return a, b

    def noise(self, i: int, tolerance: Callable[[Array], Array]) -> tuple[float, float]:
        """Change of argument i, and of its PHI, at the end of the step where all unknowns change by their tolerance (n,), with
        random signs."""
        y = self.inside(np.ones(1))[0]
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (4, len(y)))
        u = self.switches.arguments(np.full(5, self.t + self.h), np.vstack([y, y + signs * tolerance(y)]))[:, i]
        return float(np.ptp(u)), float(np.ptp(self.stretch(i, u)))


def _slice(where: Any) -> Any:
    """Indices as a slice where they are consecutive."""
    first, last = int(where[0]), int(where[-1])
    return slice(first, last + 1) if last - first == len(where) - 1 else where
