"""The discrete derivatives of a run: of its states by numbers of the scene (tangent), and of one number made of its states by all
numbers (adjoint), over the steps that it made.

The steps are those of the run, constants of the derivative. Explicit steps are repeated from their starts: each stage evaluates
y' = f(t, y), whose tangent and pullback are lists of operations (`lists.Lists`); where a run solves for y' and multipliers in
Python, they follow from F = 0 as an implicit function. The stages of an implicit step satisfy F(t, Y, Y') = 0 together; their
derivative is a linear equation with the exact matrices dF/dY and dF/dY'.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import symengine as se

from mbdae.derivatives.chart import Chart
from mbdae.derivatives.landings import Balance, Landing, rates_at_nodes
from mbdae.errors import DerivativeError
from mbdae.inputs import timed
from mbdae.integrators import radau_table
from mbdae.integrators.dense import Collocation
from mbdae.integrators.dop853 import DENSE, DOP853, NODES, STAGES
from mbdae.integrators.matrices import searches
from mbdae.integrators.solution import Solution
from mbdae.native import Entries
from mbdae.native.equations import Called
from mbdae.native.explicit import ALL, Path
from mbdae.native.sparse import SingularMatrixError, Stages
from mbdae.system.base import Array
from mbdae.system.model.moved_bodies import timeline

REPEATED = 1e-6  #: largest distance of a repeated step from the run's, relative to the unknown's size
RESTS = 1e-6  #: an unknown whose rate would move it by less than this share of its typical size in the run counts as at rest
BLOCK = 64  #: steps of one call of C, for which the derivatives of inputs of time are made beforehand
A, D = np.zeros((ALL, ALL)), np.zeros((4, ALL))
for _table, _entries in ((A, STAGES), (D, DENSE)):
    for _i, _j, _a in _entries:
        _table[_i, _j] = _a
C = A.sum(axis=1)


def inside() -> Array:
    """(inner, 16): increments of DOP853's interpolant at its inner nodes, over h, by the stages."""
    x, unit = radau_table(NODES).c[:-1, None], np.eye(ALL)
    change, c = A[12], D
    first, second = unit[0] - change, 2 * change - unit[12] - unit[0]
    return np.asarray(x * (change + (1 - x) * (first + x * (second + (1 - x) * (
        c[0] + x * (c[1] + (1 - x) * (c[2] + x * c[3])))))))


#: number of a step -> unknowns that sampled controllers set before it, with their derivatives by all unknowns and by the numbers
Calls = dict[int, tuple[Any, Array, Array]]


class Derived:
    """A run with its derivatives by numbers. charts: of the numbers; scale (n,): typical sizes of the unknowns; calls: of sampled
    controllers; touches: landings by the number of the step that begins there, with which the steps behind move."""

    def __init__(self, run: Solution, charts: Sequence[Chart], scale: Array, calls: Calls, touches: dict[int, Landing]) -> None:
        self.landings, self.shift = touches, np.zeros(len(charts))  # shift (P,): how the present steps move with the numbers
        self.calls, self.held = calls, {int(place) for one in calls.values() for place in one[0]}
        base = charts[0].varied.base
        self.run, self.charts, self.scale, self.n = run, charts, scale, run.y.shape[1]
        self.assembly, nb = base.assembly, base.listed.of.numbering
        self.seeds = np.array([chart.inputs for chart in charts]).reshape(len(charts), -1)
        self.lists = base.lists(np.any(self.seeds != 0, axis=0))
        self.clocks, self._conditions = len(nb.clock.expressions), nb.model.conditions
        self.solved = not base.rates
        steps = _Explicit if self.explicit else _Implicit
        self.steps: Any = steps(self)
        used = [(seed, np.flatnonzero(seed)) for seed in self.seeds]
        self.lists.twins.by([(self.lists.places[at], seed[at]) for seed, at in used], self.lists.fixed)

    @property
    def explicit(self) -> bool:
        """Whether the run's method is DOP853."""
        return isinstance(self.run.solver, DOP853)

    def start(self) -> Array:
        """Derivatives (n, P) of the unknowns at the start; those of multipliers, which do not enter the next step, are 0."""
        found: Array = np.zeros((self.n, len(self.charts)))
        for k, chart in enumerate(self.charts):
            found[: len(chart.start), k] = chart.start
        return found

    def tangent(self) -> Collocation:
        """The derivatives of the run as polynomials over its steps, (n P) unknowns, numbers within unknowns."""
        self.lists.twins.clear()
        S, begins, ends, inner, m = self.start(), [], [], [], len(self.run.t) - 1
        self.shift = np.zeros(len(self.charts))
        with self.within(0.0):
            for some in self._blocks():
                if some.start in self._fixed:
                    S = S - self._before(some)[:, None] * self.shift
                    self.shift = np.zeros(len(self.charts))
                if (touch := self.landings.get(some.start)) is not None:
                    later = touch.moves(S, self.shift)
                    S, self.shift = S + touch.yp[:, None] * later, self.shift + later
                if (call := self.calls.get(some.start)) is not None:
                    S = S.copy()
                    S[call[0]] = call[1] @ S + call[2]
                after, increments = self.steps.along(some, S)
                S = after[-1]
                begins.append(after[:-1])
                ends.append(after[1:])
                inner.append(increments)
                if self.shift.any():
                    moved = rates_at_nodes(self.run, self.steps.stages, some)[..., None] * self.shift
                    begins[-1] = begins[-1] - moved[:, 0]
                    ends[-1] = ends[-1] - moved[:, -1]
                    inner[-1] = inner[-1] - moved[:, 1:-1] + moved[:, :1]
        flat = [np.concatenate(part).reshape(sum(map(len, part)), -1) for part in ([*begins, ends[-1][-1:]], ends)]
        pieces = np.concatenate(inner).reshape(m, self.steps.stages - 1, -1)
        return Collocation(radau_table(self.steps.stages), self.run.t, flat[0], pieces, flat[1])

    def _blocks(self) -> list[slice]:
        """Steps that one call of C takes."""
        edges = sorted({*range(0, m := len(self.run.t) - 1, BLOCK), *self.calls, *self.landings, *self._fixed, m})
        return [slice(i, j) for i, j in pairwise(edges)]

    @cached_property
    def _fixed(self) -> set[int]:
        """Numbers of steps that begin at times which do not move: calls of controllers, jumps and kinks of inputs of time."""
        run = self.run
        line = timeline(self.assembly.model, float(run.t[0]), float(run.t[-1])) if self.landings else None
        edges = np.zeros(0) if line is None else np.concatenate([line.edges, line.stretches.kinks])
        places = {int(np.argmin(np.abs(run.t - t))) for t in edges if run.t[0] < t < run.t[-1]}
        return {*places, *self.calls} - {0, *self.landings} if self.landings else set()

    def _before(self, some: slice) -> Array:
        return np.asarray(rates_at_nodes(self.run, self.steps.stages, slice(some.start - 1, some.start))[0, -1])

    def adjoint(self, ends: Array, inner: Array) -> Array:
        """(P,) derivatives of a sum of weights times states. ends (m + 1, n): weights of y at the ends of steps; inner (m, s - 1,
        n): of the increments at the inner nodes."""
        self.lists.twins.clear()
        total, found = ends[-1].copy(), np.zeros(len(self.charts))
        of_shift = -float(total @ self._before(slice(len(self.run.t) - 1, None))) if self.landings else 0.0
        self.shift = np.zeros(len(self.charts))
        with self.within(0.0):
            for some in reversed(self._blocks()):
                of_clock, *times = self.steps.back(some, ends[some], inner[some], total)
                if self.clocks:
                    found += np.einsum("kq,kpq->p", of_clock, self.prescribed(*times))
                if self.landings:
                    rates = rates_at_nodes(self.run, self.steps.stages, some)
                    of_shift -= float(np.sum(ends[some] * rates[:, 0]) + np.sum(inner[some] * (rates[:, 1:-1] - rates[:, :1])))
                    of_shift += float(np.sum(of_clock * self.clock_rates(*times))) if self.clocks else 0.0
                if (call := self.calls.get(some.start)) is not None:
                    weights = total[call[0]]
                    total[call[0]] = 0.0
                    total += weights @ call[1]
                    found += weights @ call[2]
                if (touch := self.landings.get(some.start)) is not None:
                    weight = (total @ touch.yp + of_shift) / touch.rate
                    of_shift -= weight * touch.by_time
                    found -= weight * touch.by_numbers
                    total -= weight * touch.by_state
                if some.start in self._fixed:
                    of_shift = -float(total @ self._before(some))
        W, places = self.lists.W, self.lists.places
        found += self.seeds[:, places >= 0] @ W[places[places >= 0]]
        return np.asarray(found + total @ self.start())

    @contextmanager
    def within(self, time: float) -> Iterator[None]:
        """Context in which conditions of inputs are read at a time (s) inside a step."""
        self._conditions.time = time
        try:
            yield
        finally:
            self._conditions.time = None

    def prescribed(self, t: Array, sides: Array) -> Array:
        """Derivatives (k, P, clocks) of the values of the clock at times (k,), conditions being read at the times `sides`
        (k,)."""
        if not self.clocks:
            return np.zeros((0, len(self.charts), 0))
        found = np.stack([chart.prescribed(t, sides) for chart in self.charts], axis=1)
        if self.shift.any():
            found += self.clock_rates(t, sides)[:, None] * self.shift[:, None]
        return np.ascontiguousarray(found)

    def clock_rates(self, t: Array, sides: Array) -> Array:
        """Rates (k, clocks) of the values of the clock."""
        clock = self.assembly.numbering.clock
        return np.column_stack([timed.values(timed.derivatives(se.sympify(e))[1], t, sides) for e in clock.expressions])

    @property
    def side(self) -> Array:
        """Its first number is the time at which conditions are read."""
        return np.asarray(self._conditions.read)

    def jump(self, sides: Array) -> Array:
        """(k,) jump of y' between two times, over its largest; of F at equal y', over its terms with y' and multipliers."""
        known = np.clip(sides, self.run.t[0], self.run.t[-1])
        y = self.run(known) + (sides - known)[:, None] * self.run.yp[-1]
        size = np.maximum(np.abs(self.run.yp).max(axis=0), RESTS * self.scale / np.ptp(self.run.t))
        if self.lists.n > self.n or not self.solved:
            a, b = [self.balance.at(t, x)[1][: self.n] if self.solved else self.lists.value(t, x, np.zeros_like(x))
                    for t, x in zip(sides, y, strict=True)]
            return np.asarray(np.abs(b - a) / (size + 1e-300))
        rate = self.run.interpolant.derivative(sides[:1])[0]
        before, after = (self.lists.value(t, one, rate) for t, one in zip(sides, y, strict=True))
        fy, fyp = (np.abs(one[0]) for one in self.assembly.dense_stages(sides[:1], y[:1], rate[None]))
        terms = fyp @ size + (fy * ~fyp.any(axis=0)) @ np.abs(self.run.y).max(axis=0)
        moved = fyp.any(axis=1)
        return np.asarray(np.abs(after - before)[moved] / terms[moved])

    @cached_property
    def balance(self) -> Balance:
        """y' and multipliers as implicit functions."""
        return Balance(self)


class _Explicit:
    """Steps of DOP853, repeated from their starts."""

    stages = NODES

    def __init__(self, of: Derived) -> None:
        self.of = of

    def _path(self, some: slice, columns: int) -> tuple[Any, Array, Array]:
        """The path, and times of all stages of some steps, with those at which conditions are read."""
        of, t = self.of, self.of.run.t[some.start : some.stop + 1]
        self.called = Called(of.balance, of.n, columns) if of.solved else None
        twin = self.called.twin if self.called else of.lists.twins.twin
        times = (t[:-1, None] + np.diff(t)[:, None] * C).ravel()
        return Path(twin, A, inside(), of.side), times, np.repeat((t[1:] + t[:-1]) / 2, ALL)

    def along(self, some: slice, S: Array) -> tuple[Array, Array]:
        """Derivatives (m + 1, n, P) at the ends of steps, and their increments (m, inner, n, P); S (n, P): at the first."""
        of, run = self.of, self.of.run
        path, times, sides = self._path(some, S.shape[1])
        prescribed = of.prescribed(times, sides)
        of.lists.twins.at(prescribed=prescribed)
        if of.solved:
            of.balance.prescribed = prescribed
        more = slice(some.start, some.stop + 1)
        code, reached, after, inner = path.along(run.t[more], run.y[more], S)
        self._checked(code, some, reached)
        return after, inner

    def back(self, some: slice, ends: Array, inner: Array, total: Array) -> tuple[Array, Array, Array]:
        """Take weights back over some steps, total (n,) from their end to their beginning. Returns the weights (states, clocks)
        of the clock, with the times (states,) and those at which conditions are read."""
        of, run = self.of, self.of.run
        path, times, sides = self._path(some, 0)
        of_clock = np.zeros((len(times), of.clocks))
        of.lists.twins.at(of_clock=of_clock if of.clocks else None, room=0 if of.solved else ALL)
        if of.solved:
            of.balance.of_clock = of_clock
        more = slice(some.start, some.stop + 1)
        code, reached = path.back(run.t[more], run.y[more], ends, inner, total)
        self._checked(code, some, reached)
        return of_clock, times, sides

    def _checked(self, code: int, some: slice, reached: Array) -> None:
        run = self.of.run
        if self.called and self.called.error:
            raise self.called.error
        ends: Any = run.interpolant
        off = np.abs(reached - ends.ends[some]) > REPEATED * (np.abs(run.y).max(axis=0) + self.of.scale)
        if code or off.any():
            step = some.start + int(np.argmax(off.any(axis=1)))
            raise DerivativeError(f"the step of the run that ends at t = {run.t[step + 1]:.9g} s cannot be repeated from its "
                                  "start, so that it has no derivative")


class _Implicit:
    """Steps of Radau IIA, at the stages that the run has stored."""

    def __init__(self, of: Derived) -> None:
        interpolant: Any = of.run.interpolant
        self.of, self._inner, self._ends = of, interpolant.inner, interpolant.ends
        self.table, self.size = interpolant.table, of.assembly.n
        self.stages = len(self.table.c)
        n, pattern = self.size, of.assembly.pattern
        self._entries = Entries.full(n) if pattern is None else Entries(n, *pattern)
        self._kept: dict[bool, Stages] = {}

    def _stages(self, some: slice) -> tuple[Array, Array, Array, Array, Array]:
        """h (m,), and times (m, s), unknowns and rates (m, s, n of F) at the stages of some steps, and the times inside them."""
        of, t = self.of, self.of.run.t[some.start : some.stop + 1]
        h, y0 = np.diff(t), of.run.y[some]
        increments = np.concatenate([self._inner[some], (self._ends[some] - y0)[:, None]], axis=1)
        times, inside = t[:-1, None] + h[:, None] * self.table.c, t[:-1] + h / 2
        Y, Yp = y0[:, None] + increments, np.einsum("jk,mkn->mjn", self.table.A_inv, increments) / h[:, None, None]
        if of.n < self.size:
            lacking: Array = np.zeros((*Y.shape[:2], self.size - of.n))
            Y, Yp = np.concatenate([Y, lacking], axis=2), np.concatenate([Yp, lacking], axis=2)
            for m, j in np.ndindex(*Y.shape[:2]):
                of.side[0] = inside[m]
                Y[m, j] = of.balance.at(times[m, j], Y[m, j, : of.n])[0]
        return h, times, Y, Yp, inside

    def _jacobians(self, times: Array, Y: Array, Yp: Array, inside: Array) -> tuple[Array, Array]:
        shape = *times.shape, self._entries.nnz
        if not self.of.clocks:
            found = self.of.assembly.evaluation.jacobians(times.ravel(), *(x.reshape(-1, self.size) for x in (Y, Yp)))
            return found[0].reshape(shape), found[1].reshape(shape)
        fy: Array = np.empty(shape)
        fyp: Array = np.empty(shape)
        for m in range(len(times)):
            self.of.side[0] = inside[m]
            fy[m], fyp[m] = self.of.assembly.evaluation.jacobians(times[m], Y[m], Yp[m])
        return fy, fyp

    def _equations(self, some: slice, transposed: bool) -> tuple[Any, Array, Array]:
        """The equations of the stages of some steps, times of all stages, and those at which conditions are read."""
        of, (h, times, Y, Yp, middles) = self.of, self._stages(some)
        if transposed not in self._kept:
            pattern, kinds = of.assembly.pattern, of.assembly.kinds
            numbers, orders = 1 if transposed else len(of.charts), () if pattern is None else searches(kinds)
            self._kept[transposed] = Stages(self.table, self._entries, transposed, numbers, orders)
        jacobians = self._jacobians(times, Y, Yp, middles)
        self._kept[transposed].over(of.lists.twins, of.n, of.side, h, middles, times, Y, Yp, *jacobians)
        return self._kept[transposed], times.ravel(), np.repeat(middles, self.stages)

    def along(self, some: slice, S: Array) -> tuple[Array, Array]:
        """Derivatives (m + 1, n, P) at the ends of steps, and their increments (m, inner, n, P); S (n, P): at the first."""
        equations, *times = self._equations(some, False)
        self.of.lists.twins.at(prescribed=self.of.prescribed(*times) if self.of.clocks else None)
        with self._named(equations):
            found: tuple[Array, Array] = equations.along(S)
            return found

    def back(self, some: slice, ends: Array, inner: Array, total: Array) -> tuple[Array, Array, Array]:
        """Take weights back over some steps, total (n,) from their end to their beginning. Returns the weights (states, clocks)
        of the clock, with the times (states,) and those at which conditions are read."""
        equations, *times = self._equations(some, True)
        of_clock = np.zeros((len(times[0]), self.of.clocks))
        self.of.lists.twins.at(of_clock=of_clock if self.of.clocks else None)
        with self._named(equations):
            equations.back(ends, inner, total)
        return of_clock, times[0], times[1]

    @contextmanager
    def _named(self, equations: Any) -> Iterator[None]:
        try:
            yield
        except SingularMatrixError as error:
            raise DerivativeError(f"a step of the run near t = {equations.times[error.unknown, 0]:.6g} s has no derivative: the "
                                  "equations of its stages are singular; ask for a smaller accuracy, with other steps") from None
