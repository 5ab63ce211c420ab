"""The discrete tangent of a run: derivatives of its states by numbers of the scene, step by step over the steps that it made.

The steps are those of the run, constants of the derivative. Every stage of a step satisfies F(t, Y, Y') = 0; its derivative is a
linear equation with the exact matrices dF/dY and dF/dY' and the changes of F by the numbers (`lists.Lists`, `chart.Chart`). Where
a run eliminated its multipliers, they are unknowns of every stage here, found as the run finds them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.deferred import sp, splu
from mbdae.derivatives.chart import Chart
from mbdae.derivatives.lists import Lists
from mbdae.errors import DerivativeError
from mbdae.integrators.collocation_tables import CollocationTable, radau_table
from mbdae.integrators.dense import Collocation
from mbdae.integrators.dop853 import DENSE, NODES, STAGES
from mbdae.integrators.solution import Solution
from mbdae.system.base import Array

BALANCED, ITERATIONS = 1e-13, 30  #: largest relative step of Newton's method for y' and the multipliers at which it stops
REPEATED = 1e-6  #: largest distance of a repeated step from the run's, relative to the unknown's size
#: y' is compared on both sides of an instant, this share of the run away from it; a difference of more than JUMP times the
#: largest y' of the run counts as a jump
BESIDE, JUMP = 1e-9, 1e-5
BISECTIONS = 60
LARGE = 400  #: number of unknowns of all stages of a step above which sparse linear algebra costs less

A = np.zeros((16, 16))
for _i, _j, _a in STAGES:
    A[_i, _j] = _a
D = np.zeros((4, 16))
for _i, _j, _a in DENSE:
    D[_i, _j] = _a
C = A.sum(axis=1)


@dataclass(eq=False)
class Stage:
    """A state at which F vanishes: matrices dF/dY and dF/dY' (n, n), and the changes of F (n, P) by the numbers."""

    fy: Array
    fyp: Array
    fp: Array


class Tangent:
    """The derivatives of a run's unknowns. run: its steps; lists: the equations of the run; charts: of the numbers; scale (n,):
    typical sizes of the unknowns."""

    def __init__(self, run: Solution, lists: Lists, charts: Sequence[Chart], scale: Array) -> None:
        self.scale = scale
        self.run, self.lists, self.charts, self.n = run, lists, charts, run.y.shape[1]
        self._rate = np.arange(lists.n) < self.n
        self._inputs = np.array([chart.inputs for chart in charts]).reshape(len(charts), -1)
        nb = lists.assembly.numbering
        self._clock = nb.first_input + np.arange(len(nb.clock.expressions))
        self._conditions = nb.model.conditions
        self._multipliers = np.zeros(lists.n - self.n)

    def start(self) -> Array:
        """Derivatives (n, P) of the unknowns at the start; those of multipliers, which do not enter the next step, are 0."""
        found: Array = np.zeros((self.n, len(self.charts)))
        for k, chart in enumerate(self.charts):
            found[: len(chart.start), k] = chart.start
        return found

    def over_steps(self) -> Collocation:
        """The derivatives as polynomials over the steps, (n P) unknowns, numbers within unknowns."""
        t = self.run.t
        steps = _Explicit(self) if self.explicit else _Implicit(self)
        states, inner = [self.start()], []
        for i in range(len(t) - 1):
            with self.within((t[i] + t[i + 1]) / 2):
                after, inside = steps.step(i, states[-1])
            states.append(after)
            inner.append(inside.reshape(len(inside), -1))
        flat = np.array(states).reshape(len(t), -1)
        return Collocation.of(steps.stages, t, flat, inner)

    @property
    def explicit(self) -> bool:
        """Whether the run's method is DOP853."""
        return self.run.solver.label == "DOP853"

    @contextmanager
    def within(self, time: float) -> Iterator[None]:
        """Context in which conditions of inputs are read at a time (s) inside a step."""
        self._conditions.time, self._side = time, time
        try:
            yield
        finally:
            self._conditions.time = None

    # -- states at which F vanishes

    def full(self, y: Array) -> Array:
        """Unknowns of F: those of the run, and the multipliers found last where it eliminated them."""
        return y if len(y) == self.lists.n else np.concatenate([y, self._multipliers])

    def stage(self, t: float, y: Array, yp: Array) -> Stage:
        """Matrices and changes of F at a state, y and y' (n,) of F."""
        fy, fyp = self.lists.jacobian(t, y, yp)
        changes = self._inputs
        if len(self._clock):
            at, side = np.array([t]), np.array([self._side])
            changes = changes.copy()
            changes[:, self._clock] = [chart.prescribed(at, side)[0] for chart in self.charts]
        self.lists.residual(t, y, yp)
        return Stage(fy, fyp, self.lists.along(changes).T)

    def balance(self, t: float, y: Array) -> tuple[Array, Array, Array]:
        """y' (n,) at y (n,), with the unknowns and rates of F at which it vanishes: y' and multipliers by Newton's method."""
        rates = np.zeros(self.n)
        for _ in range(ITERATIONS):
            Y, Yp = self.full(y), np.concatenate([rates, np.zeros(self.lists.n - self.n)])
            fy, fyp = self.lists.jacobian(t, Y, Yp)
            step = np.linalg.solve(np.where(self._rate, fyp, fy), self.lists.residual(t, Y, Yp))
            rates, self._multipliers = rates - step[: self.n], self._multipliers - step[self.n :]
            size = max(np.abs(rates).max(initial=0.0), np.abs(self._multipliers).max(initial=0.0))
            if np.abs(step).max(initial=0.0) <= BALANCED * size:
                break
        return rates, self.full(y), np.concatenate([rates, np.zeros(self.lists.n - self.n)])

    def rates(self, stage: Stage, dy: Array) -> Array:
        """Derivatives (n, P) of y' for those of y, dy (n, P)."""
        matrix = np.where(self._rate, stage.fyp, stage.fy)
        found = -np.linalg.solve(matrix, stage.fp + stage.fy[:, : self.n] @ dy)[: self.n]
        return np.asarray(found, dtype=float)

    def checked(self, i: int, y: Array) -> None:
        """Raise DerivativeError where a step that was repeated does not end where step i of the run did."""
        if np.any(np.abs(y - self.run.y[i + 1]) > REPEATED * (np.abs(self.run.y).max(axis=0) + self.scale)):
            raise DerivativeError(f"the step of the run that ends at t = {self.run.t[i + 1]:.9g} s cannot be repeated from its "
                                  "start, so that it has no derivative")


class _Explicit:
    """Steps of DOP853, repeated from their starts."""

    stages = NODES

    def __init__(self, of: Tangent) -> None:
        self.of = of
        self._parts = radau_table(NODES).c[:-1, None, None]

    def step(self, i: int, S: Array) -> tuple[Array, Array]:
        """Derivatives (n, P) at the end of step i, and their increments at the inner nodes."""
        of, h = self.of, self.of.run.t[i + 1] - self.of.run.t[i]
        y0 = of.run.y[i]
        K, dK = np.zeros((16, of.n)), np.zeros((16, *S.shape))
        for s in range(16):
            y, dy = y0 + h * A[s, :s] @ K[:s], S + h * np.tensordot(A[s, :s], dK[:s], 1)
            if s == 12:
                of.checked(i, y)
                end = dy
            t = of.run.t[i] + C[s] * h
            K[s], Y, Yp = of.balance(t, y)
            dK[s] = of.rates(of.stage(t, Y, Yp), dy)
        return end, self._inside(h, end - S, dK)

    def _inside(self, h: float, change: Array, dK: Array) -> Array:
        x, c = self._parts, h * np.tensordot(D, dK, 1)
        first, second = h * dK[0] - change, 2 * change - h * (dK[12] + dK[0])
        return np.asarray(x * (change + (1 - x) * (first + x * (second + (1 - x) * (
            c[0] + x * (c[1] + (1 - x) * (c[2] + x * c[3])))))))


class _Implicit:
    """Steps of Radau IIA, at the stages that the run has stored."""

    def __init__(self, of: Tangent) -> None:
        interpolant: Any = of.run.interpolant
        self.of, self._inner, self._ends = of, interpolant.inner, interpolant.ends
        self.table: CollocationTable = interpolant.table
        self.stages = len(self.table.c)

    def step(self, i: int, S: Array) -> tuple[Array, Array]:
        """Derivatives (n, P) at the end of step i, and their increments at the inner nodes."""
        of, table, n, s = self.of, self.table, self.of.lists.n, self.stages
        h, y0 = of.run.t[i + 1] - of.run.t[i], of.run.y[i]
        increments = np.concatenate([self._inner[i], (self._ends[i] - y0)[None]])
        rates, stages = table.A_inv @ increments / h, []
        for j in range(s):
            t, y, yp = of.run.t[i] + table.c[j] * h, y0 + increments[j], rates[j]
            if of.n < n:
                _, y, _ = of.balance(t, y)
                yp = np.concatenate([yp, np.zeros(n - of.n)])
            stages.append(of.stage(t, y, yp))
        right = -np.concatenate([stage.fp + stage.fy[:, : of.n] @ S for stage in stages])
        found = _solved([[table.A_inv[j, k] / h * stages[j].fyp + (j == k) * stages[j].fy for k in range(s)] for j in range(s)],
                        right).reshape(s, n, -1)[:, : of.n]
        return S + found[-1], found[:-1]


def _solved(blocks: list[list[Array]], right: Array) -> Array:
    """The solution of the stages' linear equations, scaled by columns and rows, because unknowns have very different sizes."""
    M = np.block(blocks)
    columns = 1 / np.abs(M).max(axis=0)
    M *= columns
    rows = 1 / np.abs(M).max(axis=1)
    M *= rows[:, None]
    right = rows[:, None] * right
    found = splu(sp.csc_matrix(M)).solve(right) if len(M) > LARGE else np.linalg.solve(M, right)
    return np.asarray(columns[:, None] * found)


def refuse_jumps(tangent: Tangent) -> None:
    """Raise DerivativeError where y' jumps at an instant that depends on the motion, at which the derivative would jump too."""
    run = tangent.run
    system = run.systems[0][1] if run.systems else None
    switches: Any = None if system is None else system.switches
    if switches is None or not len(run.t) > 1:
        return
    kinks = np.array([kind == "kink" for kind in switches.kinds], dtype=bool)
    if not kinks.any():
        return
    values = switches.arguments(run.t, run.y)[:, kinks]
    names = [name for name, kink in zip(switches.names, kinks, strict=True) if kink]
    size = np.abs(run.yp).max(axis=0) + 1e-300
    for i, a in np.argwhere(values[1:] * values[:-1] < 0):
        low, high = run.t[i], run.t[i + 1]
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            at = switches.arguments(np.array([middle]), run(np.array([middle])))[0, kinks][a]
            low, high = (middle, high) if at * values[i, a] > 0 else (low, middle)
        span = BESIDE * (run.t[-1] - run.t[0])
        sides = [max(low - span, run.t[0]), min(high + span, run.t[-1])]
        with tangent.within((run.t[i] + run.t[i + 1]) / 2):
            before, after = (tangent.balance(t, run(np.array([t]))[0][: tangent.n])[0] for t in sides)
        if np.any(np.abs(after - before) > JUMP * size[: len(before)]):
            raise DerivativeError(f"there are no derivatives of this run: '{names[a]}' makes accelerations jump at t = "
                                  f"{high:.6g} s, at an instant that depends on the motion, and derivatives do not pass such "
                                  "jumps yet; state it by a function without jumps, such as tanh")
