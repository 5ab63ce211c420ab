"""Collocation methods: base class of methods that are given by their table of coefficients.

A stiffly accurate method (the last node is 1) solves F(t, y, y') = 0 of index up to 3. Any other takes ordinary differential
equations alone: the equations hold at its stages, not at the end of the step.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np

from mbdae.errors import OptionError
from mbdae.integrators.base import Solver
from mbdae.integrators.constant import constant_steps
from mbdae.integrators.dense import Collocation, hermite
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.rates import check_rates
from mbdae.integrators.runge_kutta.adaptive import Adaptive
from mbdae.integrators.runge_kutta.step import CollocationStep, Demand
from mbdae.integrators.runge_kutta.tables import CollocationTable
from mbdae.integrators.solution import Interpolant
from mbdae.system.base import Array, System

#: with a constant step, and no tolerance of its own for Newton's method, that method ends where the error expected to remain is
#: below TARGET times ROUND times the unknown's magnitude plus scale, or where corrections no longer fall and are round-off
ROUND, TARGET = 1e-10, 1e-5


class CollocationMethod(Solver):
    """Base of implicit Runge-Kutta methods by collocation. A frozen dataclass that derives from it defines `table` and has as
    fields those of the options `rtol`, `atol`, `step` and `newton` (see `RadauIIA`) that users may set.

    `highest_index` is 0 (ordinary differential equations) where it is not stated; 3 is for stiffly accurate tables.
    """

    highest_index = 0
    restarts = False
    rtol: float | None = None
    atol: Any = None
    step: float | None = None
    newton: float | None = None

    @property
    @abstractmethod
    def table(self) -> CollocationTable:
        """The method's coefficients, from `collocation_table(nodes, order)`."""

    @property
    def fixed(self) -> bool:
        """Whether the step is constant."""
        return self.step is not None

    def check(self, system: System) -> None:
        """Raise OptionError for an index above 3; for a method without a stage at the end of the step, for all systems but
        ordinary differential equations."""
        highest = int(np.max(system.index))
        if highest > 3:
            raise OptionError(f"index = {highest}: {self.label} solves index 1 to 3; reduce the index of the equations")
        if not self.table.stiffly_accurate:
            check_rates(self.label, system)

    def integrate(self, system: System, loop: StepLoop, h0: float | None) -> None:
        """Step from system.t0 to loop.t_end."""
        if self.step is None:
            Adaptive(self, self.table, self.atol, system, loop).run(h0)
        else:
            self._constant(system, loop, self.step)

    def _constant(self, system: System, loop: StepLoop, h: float) -> None:
        tolerance, target = (ROUND, TARGET) if self.newton is None else (self.newton, 1.0)
        demand = Demand(tolerance, tolerance * np.asarray(system.scale, dtype=float), target, limit=15)
        step = CollocationStep(system, self.table, loop.stats, demand, estimate=False)
        with step.run:
            constant_steps(loop, h, step, step.solve_surely, self.table.c[self.table.c < 1])

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """The collocation polynomials, or polynomials through y and y' at ends of steps where these have a higher order."""
        if self.table.stiffly_accurate:
            return Collocation.of(len(self.table.c), t, y, pieces)
        return hermite(self.table.order, t, y, yp)
