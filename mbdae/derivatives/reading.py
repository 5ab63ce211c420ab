"""What is read of a run, with its derivatives: one number that is asked for (an integral, a value at the end, the largest value),
or values over time, along the tangent of the run or by its adjoint."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.derivatives.chart import ATTEMPTS, BOTH, CLOSER, DISTANCE, SLIGHT, Chart, Equations, differenced, refused
from mbdae.derivatives.landings import BESIDE, JUMP, landings, refuse_forces_that_jump, refuse_jumps, slopes
from mbdae.derivatives.steps import Calls, Derived
from mbdae.errors import DerivativeError, OptionError
from mbdae.integrators import radau_table
from mbdae.integrators.dense import interval
from mbdae.integrators.solution import Solution
from mbdae.results.quantities import Quantity, magnitudes
from mbdae.results.result import Result
from mbdae.system.base import Array
from mbdae.system.sampling import Sampling
from mbdae.values import number, optional, shown

POINTS, POINT_WEIGHTS = np.polynomial.legendre.leggauss(8)
NEAR = 1e-3  #: two maxima that differ by less than this share may change places, so that the largest has no derivative there
FOLLOWED, MOST = 0.5, 40  #: maxima above this share of the largest are followed, at most so many
SHORT = 1e-9  #: at ends of steps shorter than this share of the run, beside touches, multipliers are rounded
HELD = 2**28  #: bytes of derivatives over time that are held at once; of more numbers they are made some after others
SIDES = (1, -1, 2, -2, 3, -3)  #: nodes of the differences of what is read along one unknown, which is cheap and smooth


@dataclass(frozen=True)
class Objective:
    """One number of a run: a sum of values of `quantity` at some times, with weights. kind: "integral", "end" or "largest"."""

    quantity: Any
    kind: str
    smooth: float | None = None

    def points(self, run: Result) -> tuple[Array, Array]:
        """Times (k,) and weights (k,), with which the derivative of the objective is the sum over the derivatives of the
        quantity."""
        t = run.solution.t
        if self.kind == "end":
            return t[-1:], np.ones(1)
        half = np.diff(t) / 2
        times = ((t[1:] + t[:-1])[:, None] / 2 + half[:, None] * POINTS).ravel()
        weights = (half[:, None] * POINT_WEIGHTS).ravel()
        if self.kind == "integral":
            return times, weights
        if self.smooth is not None:
            size = np.abs(values := self.read(run, times))
            share = weights * np.exp((size - size.max(initial=0.0)) / (self.smooth * size.max(initial=0.0) or 1.0))
            return times, np.sign(values) * share / share.sum()
        peak = run.peak(self.quantity)
        self._refuse_ties(run, np.unique(np.concatenate([times, t])), peak)
        at = np.array([peak.t])
        return at, np.sign(self.read(run, at))

    def _refuse_ties(self, run: Result, times: Array, peak: Any) -> None:
        size = np.abs(self.read(run, times))
        tops = maxima_among(size)
        others = [i for i in tops if abs(times[i] - peak.t) > 2 * np.diff(times).max() and size[i] > (1 - NEAR) * peak.value]
        if others:
            raise DerivativeError(f"the largest {shown(self.quantity)} has no derivative: it is nearly as large at t = "
                                  f"{times[others[0]]:.6g} s as at t = {peak.t:.6g} s, so that the largest may change its place; "
                                  "give mb.largest(..., smooth=1e-3)")

    def value(self, run: Result) -> float:
        """The number itself, of a run."""
        if self.kind == "largest" and self.smooth is None:
            return float(run.peak(self.quantity).value)
        times, weights = self.points(run)
        return float(weights @ self.read(run, times))

    def __le__(self, limit: float) -> Bound:
        return Bound(self, 1.0, number(limit))

    def __ge__(self, limit: float) -> Bound:
        return Bound(self, -1.0, number(limit))

    def __str__(self) -> str:
        word = {"end": "at the end", "integral": "integral"}.get(self.kind, self.kind)
        return f"{word} {self.quantity if isinstance(self.quantity, str) else shown(self.quantity)}"

    def read(self, run: Result, times: Array) -> Array:
        """Values (k,) of the quantity at times (k,); magnitudes of a vector where its largest value is asked for."""
        values = np.asarray(run(times).value(self.quantity))
        if values.ndim > 1 and self.kind == "largest":
            return magnitudes(values)
        if values.ndim > 1:
            name = self.quantity if isinstance(self.quantity, str) else "f"
            raise OptionError(f"{shown(self.quantity)} has components: name one, as in '{name}[0]', or 'norm({name})'")
        return values


def maxima_among(size: Array) -> Any:
    """Places of the local maxima among values (k,)."""
    return np.flatnonzero((size >= np.r_[-np.inf, size[:-1]]) & (size > np.r_[size[1:], -np.inf]))


def maxima(of: Objective, run: Result) -> Array:
    """(m, 2) times, rising, and values, with their signs, of the maxima over a run of a quantity whose largest value is asked
    for: those that are not far below the largest."""
    t = np.unique(np.concatenate([replace(of, kind="integral").points(run)[0], run.solution.t]))
    size = np.abs(of.read(run, t))
    tops = maxima_among(size)
    tops = tops[size[tops] >= FOLLOWED * size.max()]
    tops = np.sort(tops[np.argsort(-size[tops], kind="stable")[:MOST]])
    i = np.clip(tops, 1, len(t) - 2)
    left, right = (size[i] - size[i - 1]) / (t[i] - t[i - 1]), (size[i + 1] - size[i]) / (t[i + 1] - t[i])
    vertex = (t[i - 1] + t[i]) / 2 + (t[i + 1] - t[i - 1]) / 2 * left / np.where(left > right, left - right, 1.0)  # of a parabola
    times = np.where((tops == i) & (left > right), np.clip(vertex, t[i - 1], t[i + 1]), t[tops])
    return np.column_stack([times, of.read(run, times)])


@dataclass(frozen=True)
class Bound:
    """A bound on one number of a run, for `mb.design`: sign * (of - limit) is at most 0. Made by `mb.largest(...) <= 30.0`."""

    of: Any
    sign: float
    limit: float

    def __bool__(self) -> bool:
        # Python reads `a <= x <= b` as `(a <= x) and (x <= b)`, which would be the second bound alone
        raise OptionError(f"{self} is a bound, which is neither true nor false: give two bounds, such as [-0.5 <= q, q <= 2.0], "
                          "in the place of -0.5 <= q <= 2.0, of which Python would keep the last one alone")

    def __str__(self) -> str:
        return f"{self.of} {'<=' if self.sign > 0 else '>='} {self.limit:g}"


def integral(quantity: Quantity) -> Objective:
    """The integral over the run of a quantity, "body.acceleration[1]**2": an objective for `Result.gradient`."""
    return Objective(quantity, "integral")


def at_end(quantity: Quantity) -> Objective:
    """The value of a quantity at the end of the run: an objective for `Result.gradient`."""
    return Objective(quantity, "end")


def largest(quantity: Quantity, smooth: float | None = None) -> Objective:
    """The largest magnitude of a quantity, also of a vector, over the run, as `Result.peak` finds it: an objective for
    `Result.gradient`. smooth: a mean is taken in its place in which values that are lower by this share of the largest count e
    times less; it has a derivative also where two maxima may change places."""
    optional("smooth", smooth, number, "give a share of the largest value, such as 1e-3", above=0)
    return Objective(quantity, "largest", smooth)


@dataclass(frozen=True, eq=False)
class _Moved:
    """Interpolant of a run displaced by `by` times its derivative by number k of P."""

    of: Any
    tangent: Any
    k: int
    count: int
    by: float

    def value(self, t: Array) -> Array:
        """Unknowns (k, n) at times (k,)."""
        change = self.tangent.value(t).reshape(len(t), -1, self.count)[:, :, self.k]
        return np.asarray(self.of.value(t) + self.by * change)

    def derivative(self, t: Array) -> Array:
        """Rates (k, n) of the unknowns at times (k,)."""
        change = self.tangent.derivative(t).reshape(len(t), -1, self.count)[:, :, self.k]
        return np.asarray(self.of.derivative(t) + self.by * change)


def sampled(run: Solution, charts: Sequence[Chart], scale: Array) -> Calls:
    """The calls of sampled controllers in a run, with the derivatives of the outputs that they set: by the unknowns, and by the
    numbers, which sensors may contain."""
    base = charts[0].varied.base
    if not base.prepared.model.scene.controllers:
        return {}
    nb, begin = base.assembly.numbering, float(run.t[0])
    sampler, due = Sampling(base.prepared, nb)(begin), dict[int, list[Any]]()
    for instant, _ in sampler.parts(begin, float(run.t[-1])):
        due[int(np.argmin(np.abs(run.t - instant)))] = list(sampler.due)
        for one in sampler.due:
            one.count += 1
    at, held = np.array([*due]), np.array([place for one in sampler.called for place in one.outputs])
    t, y = run.t[at], run.y[at].copy()
    y[:, held] = np.where(at[:, None] > 0, run.y[at - 1][:, held], base.start[held])  # what the functions read
    values = sampler.observer(t, y)
    by_states = slopes(lambda states: sampler.observer(t, states), y, np.maximum(np.abs(run.y).max(axis=0), scale))
    of_numbers = [chart.varied.explicit(lambda one: Sampling(one.prepared, nb)(begin).observer(t, y))[0] for chart in charts]
    found: Calls = {}
    for m, (k, ones) in enumerate(due.items()):
        D = np.zeros((len(held), values.shape[1]))
        for one in ones:
            D[np.searchsorted(held, one.outputs), one.inputs] = one.derivative(float(t[m]), values[m, one.inputs])
        kept = np.isin(held, [place for one in ones for place in one.outputs])
        found[k] = held[kept], D[kept] @ by_states[m], D[kept] @ np.stack([one[m] for one in of_numbers], axis=1)
    return found


class Along:
    """A run and its derivatives by numbers of the scene. finer: by what the tolerance of the result is divided in the run."""

    def __init__(self, result: Result, run: Solution, charts: Sequence[Chart], scale: Array, finer: float = 1.0) -> None:
        self.result = Result(result.prepared, run, None, result.t)  # type: ignore[arg-type]
        self.charts, self.run, self.finer = charts, run, finer
        self.derived = Derived(run, charts, scale, sampled(run, charts, scale), landings(run, charts, scale))
        refuse_jumps(self.derived)
        refuse_forces_that_jump(self.derived, BESIDE, JUMP)
        self._sums: dict[int, list[tuple[Array, Array]]] = {}
        each = len(run.t) * (self.derived.steps.stages + 1) * run.y.shape[1] * 8
        self._together, self._made, self._part = max(HELD // each, 1), (result, scale), (-1, self)

    def forget(self) -> None:
        """Let go of derivatives over time, which are large."""
        self.__dict__.pop("tangent", None)
        self._part = -1, self

    @cached_property
    def tangent(self) -> Any:
        """The derivatives of the run's unknowns, as a function of time."""
        return self.derived.tangent()

    def of(self, k: int, read: Callable[[Result], Array]) -> tuple[Array, Array]:
        """Derivative of what is read of a result by number k, and its estimated error by rounding and differences: that along
        the change of the states in the scene as it is, and that of the same states in the changed scene."""
        if len(self.charts) > (many := self._together):
            if self._part[0] != (first := k - k % many):
                self.forget()  # those before
                self._part = first, Along(self._made[0], self.run, self.charts[first : first + many], self._made[1], self.finer)
            return self._part[1].of(k - first, read)
        run, count, base = self.run, len(self.charts), self.charts[0].varied.base
        own = self.tangent.y.reshape(len(run.t), -1, count)[:, :, k]
        size = np.maximum(np.abs(run.y).max(axis=0), self.derived.scale)
        steps = np.diff(run.t, prepend=-np.inf) > SHORT * np.ptp(run.t)
        by = DISTANCE / (float(np.max(np.abs(own[steps]) / size, initial=0.0)) or 1.0)

        def moved(node: int, by: float) -> Array:
            return read(self._result(base, _Moved(run.interpolant, self.tangent, k, count, node * by), run.y + node * by * own))

        for _ in range(ATTEMPTS):
            one = differenced(lambda node, by=by: moved(node, by), BOTH, by)  # type: ignore[misc]
            if one.agrees():
                break
            by /= CLOSER
        explicit, further = self._explicit(k, lambda one: self._result(one, run.interpolant, run.y), read)
        rounded = np.finfo(float).eps / SLIGHT * one.rounding  # which differences of two orders have in common
        return self._finite(k, one.found + explicit), one.doubt + further + rounded

    def _explicit(self, k: int, at: Callable[[Equations], Result], read: Callable[[Result], Array]) -> tuple[Array, Array]:
        """Derivative of what is read of the same states, and its error."""
        found, doubt = self.charts[k].varied.explicit(lambda one: read(at(one)))
        return self._finite(k, found), doubt

    def _finite(self, k: int, found: Array) -> Array:
        if not np.isfinite(found).all():
            refused(self.charts[k].name, "what is read has no finite derivative by it")
        return found

    def _result(self, at: Equations, interpolant: Any, y: Array) -> Result:
        run = replace(self.run, y=y, interpolant=interpolant, outputs=None, systems=())
        return Result(at.prepared, run, None, self.result.t)  # type: ignore[arg-type]

    def sums(self, of: Objective) -> list[tuple[Array, Array]]:
        """Derivatives of an objective by all numbers, each with its error by differences: the adjoint."""
        if id(of) not in self._sums:
            self._sums[id(of)] = self._summed(of)
        return self._sums[id(of)]

    def _summed(self, of: Objective) -> list[tuple[Array, Array]]:
        base, run, (times, weights) = self.charts[0].varied.base, self.run, of.points(self.result)

        def read(one: Result) -> Array:
            return of.read(one, times)

        ends, inner = np.zeros_like(run.y), np.zeros((len(run.t) - 1, self.derived.steps.stages - 1, run.y.shape[1]))
        ask, table, doubt = _Asked(run.interpolant), radau_table(self.derived.steps.stages), 0.0
        read(self._result(base, ask, run.y))
        step = interval(run.t, times)
        h = run.t[step + 1] - run.t[step]
        theta = (times - run.t[step]) / h
        size = np.maximum(np.abs(run.y).max(axis=0), self.derived.scale)
        for part, used in (("value", True), ("derivative", ask.asked)):
            if not used:
                continue
            basis = table.values(theta) if part == "value" else table.slopes(theta) / h[:, None]
            for j in range(run.y.shape[1]):
                whole = j in self.derived.held  # such an unknown has one value throughout a step
                by = DISTANCE * size[j] / (1.0 if part == "value" else run.t[-1] - run.t[0])

                def moved(node: int, j: int = j, by: float = by, part: str = part) -> Array:
                    return read(self._result(base, _Shifted(run.interpolant, j, node * by, part), run.y))

                found, off, _ = differenced(moved, SIDES, by)
                given, doubt = weights * found, doubt + float(np.abs(weights) @ off) * size[j]
                if whole:
                    np.add.at(ends[:, j], step, given * float(part == "value"))
                    continue
                np.add.at(inner[:, :, j], step, given[:, None] * basis[:, :-1])
                np.add.at(ends[:, j], step + 1, given * basis[:, -1])
                np.add.at(ends[:, j], step, given * (float(part == "value") - basis[:, -1]))
        total = self.derived.adjoint(ends, inner)
        parts = [self._explicit(k, lambda one: self._result(one, run.interpolant, run.y), read)
                 for k in range(len(self.charts))]
        worst = np.abs(total).max(initial=0.0) or 1.0
        return [(np.asarray(own + weights @ found), np.asarray(np.abs(weights) @ off + doubt * abs(own) / worst))
                for own, (found, off) in zip(total, parts, strict=True)]


@dataclass
class _Asked:
    """Interpolant of a run that knows whether derivatives over time were asked for."""

    of: Any
    asked: bool = False

    def value(self, t: Array) -> Array:
        """Unknowns (k, n) at times (k,)."""
        return np.asarray(self.of.value(t))

    def derivative(self, t: Array) -> Array:
        """Rates (k, n) of the unknowns at times (k,)."""
        self.asked = True
        return np.asarray(self.of.derivative(t))


@dataclass(frozen=True, eq=False)
class _Shifted:
    """Interpolant of a run with unknown j, or its rate (part: "value", "derivative"), larger by `by`."""

    of: Any
    j: int
    by: float
    part: str

    def value(self, t: Array) -> Array:
        """Unknowns (k, n) at times (k,)."""
        return self._shifted(self.of.value(t), "value")

    def derivative(self, t: Array) -> Array:
        """Rates (k, n) of the unknowns at times (k,)."""
        return self._shifted(self.of.derivative(t), "derivative")

    def _shifted(self, found: Array, part: str) -> Array:
        found = np.array(found)
        if part == self.part:
            found[:, self.j] += self.by
        return found
