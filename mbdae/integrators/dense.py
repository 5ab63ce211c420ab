"""Interpolants between accepted steps (dense output), vectorised over the times asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import distinct
from mbdae.integrators import CollocationTable, radau_table
from mbdae.integrators.kept_rows import leave
from mbdae.native import address, declared
from mbdae.native.equations import Pointer, Whole
from mbdae.system.base import Array

MANY = 4096  #: largest number of times that are evaluated together: the pages of a file that they read are given back then
BLOCK = 1000  #: largest number of steps that are interpolated together
#: one polynomial through several neighbouring steps is used where each of them is longer than this fraction of the step in which
#: it is evaluated; else the cubic over that step alone
EVEN = 0.5


#: function that opens the library and states the types of the function for piecewise polynomials, for ctypes
_functions = declared(("interpolated", None, (Whole, Whole, Whole, Pointer, Pointer, Whole, *[Pointer] * 4)))


def interval(t: Array, times: Array) -> NDArray[np.intp]:
    """Index (k,) of the step [t[i], t[i+1]] that holds each time; t (m+1,), times (k,)."""
    return np.clip(np.searchsorted(t, times, side="right") - 1, 0, max(len(t) - 2, 0))


class Collocation:
    """Piecewise collocation polynomial of m steps with s stages: values y (m+1, n) at the ends of steps t (m+1,), and increments
    `inner` (m, s-1, n) of y from the start of each step to its inner nodes.

    ends (m, n): values at the end of every step, where the next step begins with other values (after a break)."""

    def __init__(self, table: CollocationTable, t: Array, y: Array, inner: Array, ends: Array | None = None) -> None:
        self.table, self.t, self.y, self.inner = table, t, y, inner
        self.ends = y[1:] if ends is None else ends

    @classmethod
    def of(cls, stages: int, t: Array, y: Array, pieces: Any) -> Self:
        """The polynomials on the nodes of Radau IIA with this number of stages, from the inner increments of every step."""
        inner = np.asarray(pieces) if len(pieces) else np.empty((0, stages - 1, y.shape[1]))
        return cls(radau_table(stages), t, y, inner)

    def value(self, times: Array) -> Array:
        """y (k, n) at times (k,)."""
        i, theta = self._locate(times)
        found = self._combine(i, self.table.values(theta), start=True)
        last = theta == 1  # at the end of a step the stored value is returned, because a polynomial of high degree adds round-off
        if last.any() and len(self.t) > 1:
            found[last] = self.ends[i[last]]
        return found

    def derivative(self, times: Array) -> Array:
        """dy/dt (k, n) at times (k,)."""
        i, theta = self._locate(times)
        return self._combine(i, self.table.slopes(theta) / self._widths()[i][:, None])

    def _widths(self) -> Array:
        return np.diff(self.t) if len(self.t) > 1 else np.ones(1)

    def _locate(self, times: Array) -> tuple[NDArray[np.intp], Array]:
        i = interval(self.t, times)
        return i, (times - self.t[i]) / self._widths()[i]

    def _combine(self, i: NDArray[np.intp], weights: Array, start: bool = False) -> Array:
        """Weighted sum (k, n) of the increments of steps i (k,), weights (k, s), plus y where they start if `start`."""
        if len(self.t) == 1:
            return self.y[i] if start else np.zeros((len(i), self.y.shape[1]))
        n, s = self.y.shape[1], weights.shape[1]
        data = [np.ascontiguousarray(one, dtype=float) for one in (self.y, self.ends, self.inner)]
        steps, w, total = np.ascontiguousarray(i, dtype=np.int64), np.ascontiguousarray(weights), np.empty((len(i), n))
        for first in range(0, len(i), MANY):
            at = slice(first, first + MANY)
            _functions().interpolated(len(steps[at]), n, s, address(steps[at]), address(w[at]), int(start), *map(address, data),
                                      address(total[at]))
            leave(self.inner, self.y, self.ends)
        return total


def increments_of(states: Array, inner: Array) -> Array:
    """Increments (m, s, n) at all nodes of steps between states (m+1, n), from those at the inner nodes (m, s-1, n)."""
    return np.concatenate([inner, np.diff(states, axis=0)[:, None]], axis=1)


def inside_of(table: CollocationTable, starts: Array, increments: Array) -> Callable[..., Array]:
    """A function that evaluates the polynomials of m steps: fractions (k,) of a step, a slice of the steps (default all) -> y
    (m, k, n). starts (m, n): y at the beginnings of the steps; increments (m, s, n): from there to their nodes."""

    def inside(parts: Array, steps: slice = slice(None)) -> Array:
        found = np.asarray(table.values(parts) @ increments[steps])
        found += starts[steps, None]
        return found

    return inside


def cubic(stages: int, h: float, start: tuple[Array, Array], end: tuple[Array, Array]) -> Array:
    """Increments (stages - 1, n) of y from the start of a step of h (s) to the inner nodes of Radau IIA, on the cubic through y
    and y' at both ends; start, end: (y, y')."""
    c = radau_table(stages).c[:-1, None]
    (y0, rate0), (y1, rate1) = start, end
    return np.asarray(c**2 * (3 - 2 * c) * (y1 - y0) + h * c * (1 - c) * ((1 - c) * rate0 - c * rate1))


class Hermite:
    """Piecewise Hermite interpolation: in every step the polynomial through y and y' at `points` neighbouring ends of steps. Its
    variable is the fraction of the step, so that round-off stays small."""

    def __init__(self, t: Array, y: Array, yp: Array, points: int) -> None:
        self.t, self.y, self.yp = t, y, yp
        self.points = min(points, len(t))

    def value(self, times: Array) -> Array:
        """y (k, n) at times (k,)."""
        return self._combine(times, self._value_weights)

    def derivative(self, times: Array) -> Array:
        """dy/dt (k, n) at times (k,)."""
        return self._combine(times, self._slope_weights)

    def first(self, i: NDArray[np.intp]) -> NDArray[np.intp]:
        """Index (k,) in `t` of the first of the `points` ends of steps that the polynomial of step i (k,) goes through."""
        return np.clip(i - (self.points - 1) // 2, 0, len(self.t) - self.points)

    def _combine(self, times: Array, weights: Callable[..., tuple[Array, Array]]) -> Array:
        i = interval(self.t, times)
        first = self.first(i)
        width = (self.t[i + 1] - self.t[i]) if len(self.t) > 1 else np.ones(len(i))
        nodes = np.array([(self.t[first + j] - self.t[i]) / width for j in range(self.points)])
        x = (times - self.t[i]) / width
        total = np.zeros((len(times), self.y.shape[1]))
        for j in range(self.points):
            on_value, on_slope = weights(x, nodes, j, width)
            total += on_value[:, None] * self.y[first + j] + on_slope[:, None] * self.yp[first + j]
        leave(self.y, self.yp)
        return total

    @staticmethod
    def _lagrange(x: Array, nodes: Array, j: int) -> tuple[Array, Array, Array]:
        """Lagrange polynomial j on nodes (p, k): its value and slope at x (k,), and its slope at node j."""
        value, slope, own = np.ones_like(x), np.zeros_like(x), np.zeros_like(x)
        for i in range(len(nodes)):
            if i != j:
                gap = nodes[j] - nodes[i]
                slope = (slope * (x - nodes[i]) + value) / gap
                value = value * (x - nodes[i]) / gap
                own = own + 1 / gap
        return value, slope, own

    def _value_weights(self, x: Array, nodes: Array, j: int, width: Array) -> tuple[Array, Array]:
        L, _, own = self._lagrange(x, nodes, j)
        d = x - nodes[j]
        return L * L * (1 - 2 * d * own), width * d * L * L

    def _slope_weights(self, x: Array, nodes: Array, j: int, width: Array) -> tuple[Array, Array]:
        L, slope, own = self._lagrange(x, nodes, j)
        d = x - nodes[j]
        on_value = 2 * L * slope * (1 - 2 * d * own) - 2 * own * L * L
        return on_value / width, L * L + 2 * d * L * slope


def cut(interpolant: Any, t: float) -> Any:
    """An interpolant that ends at a time t (s) inside it: the same polynomials, the step that holds t shortened to end there."""
    if isinstance(interpolant, Joined):
        parts = [part for part in interpolant.parts if part.t[0] < t]
        return Joined([*parts[:-1], cut(parts[-1], t)])
    times, last = np.array([t]), int(np.clip(np.searchsorted(interpolant.t, t, side="left") - 1, 0, None))
    steps, y = np.concatenate([interpolant.t[: last + 1], times]), interpolant.y[: last + 1]
    ends = getattr(interpolant, "ends", interpolant.y[1:])[last : last + 1]
    end = interpolant.value(times) if t < interpolant.t[last + 1] else ends
    if isinstance(interpolant, Collocation):
        table, width = interpolant.table, t - steps[-2]
        inner = interpolant.value(steps[-2] + width * table.c[:-1]) - y[-1]
        return Collocation(table, steps, np.concatenate([y, end]), np.concatenate([interpolant.inner[:last], inner[None]]),
                           np.concatenate([interpolant.ends[:last], end]))
    rates = np.concatenate([interpolant.yp[: last + 1], interpolant.derivative(times)])
    return Hermite(steps, np.concatenate([y, end]), rates, 2)


def sampled(polynomials: Hermite, steps: NDArray[np.intp], stages: int) -> Array:
    """Increments (k, stages - 1, n) of y from the start of some steps (k,) to the inner nodes of Radau IIA, on Hermite
    `polynomials`."""
    t, y, c = polynomials.t, polynomials.y, radau_table(stages).c[:-1]
    inner = np.empty((len(steps), stages - 1, y.shape[1]))
    for first in range(0, len(steps), BLOCK):  # in blocks, because all at once take several times the memory of the result
        some = steps[first : first + BLOCK]
        times = t[some, None] + (t[some + 1] - t[some])[:, None] * c
        inner[first : first + BLOCK] = polynomials.value(times.ravel()).reshape(len(some), *inner.shape[1:]) - y[some, None]
    return inner


def hermite(order: int, t: Array, y: Array, yp: Array) -> Collocation | Hermite:
    """Polynomials through y and y' (m+1, n) at the ends of steps t (m+1,), whose error is at most O(h^order), for order up to 8.

    Up to order 4 they are the cubics through both ends of a step, above that polynomials through the ends of several steps. Where
    one of these is far shorter than the step itself, its polynomial would magnify round-off, and the cubic is taken."""
    points = min((max(order, 4) + 1) // 2, 4)
    cubics = Hermite(t, y, yp, 2)
    if points == 2:
        return cubics
    longer, stages, widths = Hermite(t, y, yp, points), 2 * points - 1, np.diff(t)
    steps = np.arange(len(widths))
    first = longer.first(steps)
    shortest = np.min([widths[first + j] for j in range(longer.points - 1)], axis=0) if len(steps) else widths
    inner = np.empty((len(steps), stages - 1, y.shape[1]))
    for polynomials, some in ((longer, steps[shortest > EVEN * widths]), (cubics, steps[shortest <= EVEN * widths])):
        inner[some] = sampled(polynomials, some, stages)
    return Collocation(radau_table(stages), t, y, inner)


class Joined:
    """Interpolants of consecutive parts of a run (between breaks); at the time where two parts meet the later one is used."""

    def __init__(self, parts: list[Hermite]) -> None:
        self.parts = parts
        self._starts = np.array([part.t[0] for part in parts])

    def value(self, times: Array) -> Array:
        """y (k, n) at times (k,)."""
        return self._each(times, Hermite.value)

    def derivative(self, times: Array) -> Array:
        """dy/dt (k, n) at times (k,)."""
        return self._each(times, Hermite.derivative)

    def _each(self, times: Array, function: Callable[[Hermite, Array], Array]) -> Array:
        of = np.clip(np.searchsorted(self._starts, times, side="right") - 1, 0, len(self.parts) - 1)
        out = np.empty((len(times), self.parts[0].y.shape[1]))
        for i in distinct(of):
            out[of == i] = function(self.parts[i], times[of == i])
        return out


def piecewise(dense: Callable[..., Any], breaks: dict[int, tuple[Array, Array]], t: Array, y: Array, yp: Array,
              pieces: Any) -> Any:
    """One interpolant over the m steps of a run, t (m+1,), y and yp (m+1, n), from those of its parts by `Solver.dense`. breaks:
    number of a step -> y and yp before a restart there, with which a part that ends there ends."""
    whole = dense(t, y, yp, pieces)
    if not breaks:
        return whole
    if isinstance(whole, Collocation) and whole.inner is pieces:  # nothing inside a step is made from values at its ends
        whole.ends = y[1:].copy()
        for last, (own_y, _) in breaks.items():
            whole.ends[last - 1] = own_y
        return whole
    parts, first = list[Any](), 0
    for last in [*breaks, len(t) - 1]:
        piece = slice(first, last + 1)
        own_y, own_yp = y[piece], yp[piece]
        if last in breaks:
            own_y, own_yp = own_y.copy(), own_yp.copy()
            own_y[-1], own_yp[-1] = breaks[last]
        parts.append(dense(t[piece], own_y, own_yp, pieces[first:last]))
        first = last
    if not all(isinstance(part, Collocation) for part in parts):
        return Joined(parts)
    t = np.concatenate([*(part.t[:-1] for part in parts), parts[-1].t[-1:]])
    y = np.concatenate([*(part.y[:-1] for part in parts), parts[-1].y[-1:]])
    inner, ends = (np.concatenate([getattr(part, name) for part in parts]) for name in ("inner", "ends"))
    return Collocation(parts[0].table, t, y, inner, ends)
