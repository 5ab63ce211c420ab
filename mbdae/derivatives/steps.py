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

from mbdae.derivatives.chart import Chart
from mbdae.errors import DerivativeError
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

BALANCED, ITERATIONS = 1e-13, 30  #: largest relative step of Newton's method for y' and the multipliers at which it stops
REPEATED = 1e-6  #: largest distance of a repeated step from the run's, relative to the unknown's size
BLOCK = 64  #: steps of one call of C, for which the derivatives of inputs of time are made beforehand

A = np.zeros((ALL, ALL))
for _i, _j, _a in STAGES:
    A[_i, _j] = _a
D = np.zeros((4, ALL))
for _i, _j, _a in DENSE:
    D[_i, _j] = _a
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
    controllers."""

    def __init__(self, run: Solution, charts: Sequence[Chart], scale: Array, calls: Calls) -> None:
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
        places = self.lists.places
        used = [np.flatnonzero(seed) for seed in self.seeds]
        self.lists.twins.by([(places[at], seed[at]) for at, seed in zip(used, self.seeds, strict=True)], self.lists.fixed)

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
        with self.within(0.0):
            for some in self._blocks():
                if (call := self.calls.get(some.start)) is not None:
                    S = S.copy()
                    S[call[0]] = call[1] @ S + call[2]
                after, increments = self.steps.along(some, S)
                S = after[-1]
                begins.append(after[:-1])
                ends.append(after[1:])
                inner.append(increments)
        flat = [np.concatenate(part).reshape(sum(map(len, part)), -1) for part in ([*begins, S[None]], ends)]
        pieces = np.concatenate(inner).reshape(m, self.steps.stages - 1, -1)
        return Collocation(radau_table(self.steps.stages), self.run.t, flat[0], pieces, flat[1])

    def _blocks(self) -> list[slice]:
        """Steps that one call of C takes."""
        m = len(self.run.t) - 1
        edges = sorted({*range(0, m, BLOCK), *self.calls, m})
        return [slice(i, j) for i, j in pairwise(edges)]

    def adjoint(self, ends: Array, inner: Array) -> Array:
        """(P,) derivatives of a sum of weights times states. ends (m + 1, n): weights of y at the ends of steps; inner (m, s - 1,
        n): of the increments at the inner nodes."""
        self.lists.twins.clear()
        total, found = ends[-1].copy(), np.zeros(len(self.charts))
        with self.within(0.0):
            for some in reversed(self._blocks()):
                of_clock, prescribed = self.steps.back(some, ends[some], inner[some], total)
                if self.clocks:
                    found += np.einsum("kq,kpq->p", of_clock, prescribed)
                if (call := self.calls.get(some.start)) is not None:
                    weights = total[call[0]]
                    total[call[0]] = 0.0
                    total += weights @ call[1]
                    found += weights @ call[2]
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
        return np.ascontiguousarray(np.stack([chart.prescribed(t, sides) for chart in self.charts], axis=1))

    @property
    def side(self) -> Array:
        """Array whose first number is the time at which conditions are read."""
        return np.asarray(self._conditions.read)

    def jump(self, sides: Array) -> Array:
        """(k,) how far y' jumps between two times, over its largest of the run; where multipliers are unknowns, how far F does at
        equal y', over its terms with y'."""
        y, size = self.run(sides), np.abs(self.run.yp).max(axis=0)
        if self.lists.n > self.n or not self.solved:
            rates = [self.balance.at(t, x)[1][: self.n] if self.solved else self.lists.value(t, x, np.zeros_like(x))
                     for t, x in zip(sides, y, strict=True)]
            return np.asarray(np.abs(rates[1] - rates[0]) / (size + 1e-300))
        rate = self.run.interpolant.derivative(sides[:1])[0]
        before, after = (self.lists.value(t, one, rate) for t, one in zip(sides, y, strict=True))
        by_rates = np.abs(self.assembly.dense_stages(sides[:1], y[:1], rate[None])[1][0]) @ size
        return np.asarray(np.abs(after - before)[by_rates > 0] / by_rates[by_rates > 0])

    @cached_property
    def balance(self) -> Balance:
        """y' and multipliers as implicit functions."""
        return Balance(self)


class Balance:
    """y' = f(t, y) by F(t, (y, lambda), (y', 0)) = 0, with the derivatives of this implicit function."""

    def __init__(self, of: Derived) -> None:
        self.of, self.lists, self.n = of, of.lists, of.n
        self._rate = np.arange(of.assembly.n) < of.n
        self._multipliers = np.zeros(of.assembly.n - of.n)
        self._at: dict[int, Any] = {}
        self.prescribed: Array = np.zeros(0)
        self.of_clock: Array = np.zeros(0)

    def at(self, t: float, y: Array) -> tuple[Array, Array, Array, Array]:
        """Unknowns and rates of F at which it vanishes, dF/d(y', lambda) and dF/dy."""
        rates, zeros = np.zeros(self.n), np.zeros(len(self._multipliers))
        for _ in range(ITERATIONS):
            Y, Yp = np.concatenate([y, self._multipliers]), np.concatenate([rates, zeros])
            fy, fyp = (x[0] for x in self.of.assembly.dense_stages(np.array([t]), Y[None], Yp[None]))
            matrix = np.where(self._rate, fyp, fy)
            step = np.linalg.solve(matrix, self.lists.value(t, Y, Yp))
            rates, self._multipliers = rates - step[: self.n], self._multipliers - step[self.n :]
            size = max(np.abs(rates).max(initial=0.0), np.abs(self._multipliers).max(initial=0.0))
            if np.abs(step).max(initial=0.0) <= BALANCED * size:
                break
        return np.concatenate([y, self._multipliers]), np.concatenate([rates, zeros]), matrix, fy

    def value(self, at: int, t: float, y: Array) -> Array:
        """y' at stage `at`."""
        self._at[at % ALL] = t, *self.at(t, y.copy())
        return np.asarray(self._at[at % ALL][2][: self.n])

    def along(self, at: int, dy: Array) -> Array:
        """Changes (n, P) of y' for those of y (n, P) and those of the numbers."""
        t, Y, Yp, matrix, fy = self._at[at % ALL]
        self.lists.twins.at(prescribed=np.ascontiguousarray(self.prescribed[at : at + 1]))
        by_numbers = self.lists.twins.states(np.array([t]), Y[None], Yp[None])[0]
        return np.asarray(-np.linalg.solve(matrix, by_numbers + fy[:, : self.n] @ dy)[: self.n])

    def back(self, at: int, weight: Array) -> Array:
        """Weights (n,) of y for weights (n,) of y'."""
        t, Y, Yp, matrix, _ = self._at[at % ALL]
        v = -np.linalg.solve(matrix.T, np.concatenate([weight, np.zeros(len(self._multipliers))]))
        self.lists.twins.at(of_clock=self.of_clock[at : at + 1])
        return self.lists.twins.states(np.array([t]), Y[None], Yp[None], v[None])[0, : self.n]


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

    def back(self, some: slice, ends: Array, inner: Array, total: Array) -> tuple[Array, Array]:
        """Take weights back over some steps, total (n,) from their end to their beginning. Returns the weights (states, clocks)
        of the clock, and its derivatives (states, P, clocks)."""
        of, run = self.of, self.of.run
        path, times, sides = self._path(some, 0)
        of_clock = np.zeros((len(times), of.clocks))
        of.lists.twins.at(of_clock=of_clock if of.clocks else None, room=0 if of.solved else ALL)
        if of.solved:
            of.balance.of_clock = of_clock
        more = slice(some.start, some.stop + 1)
        code, reached = path.back(run.t[more], run.y[more], ends, inner, total)
        self._checked(code, some, reached)
        return of_clock, of.prescribed(times, sides)

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

    def back(self, some: slice, ends: Array, inner: Array, total: Array) -> tuple[Array, Array]:
        """Take weights back over some steps, total (n,) from their end to their beginning. Returns the weights (states, clocks)
        of the clock, and its derivatives (states, P, clocks)."""
        equations, *times = self._equations(some, True)
        of_clock = np.zeros((len(times[0]), self.of.clocks))
        self.of.lists.twins.at(of_clock=of_clock if self.of.clocks else None)
        with self._named(equations):
            equations.back(ends, inner, total)
        return of_clock, self.of.prescribed(*times)

    @contextmanager
    def _named(self, equations: Any) -> Iterator[None]:
        try:
            yield
        except SingularMatrixError as error:
            raise DerivativeError(f"a step of the run near t = {equations.times[error.unknown, 0]:.6g} s has no derivative: the "
                                  "equations of its stages are singular") from None
