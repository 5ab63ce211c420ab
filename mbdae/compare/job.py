"""What all runs of a comparison share: the prepared scene, its systems by form, the time grid and the measure."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mbdae.errors import OptionError
from mbdae.formulations import Form, default_form, system_for
from mbdae.integrators.base import Solver
from mbdae.integrators.solution import Solution
from mbdae.notation import QUANTITIES
from mbdae.results.control import measure_of
from mbdae.results.result import Accuracy, Result, RunInfo
from mbdae.system.base import Array, System
from mbdae.system.prepare import Prepared

GRID = 1001  #: times at which trajectories are compared
SHORT = 0.5  #: s; shorter runs are timed twice
WHOLE_SCENE = "whole state: positions over the scene's length, angles in rad, velocities over the largest characteristic speed"
WHOLE_SYSTEM = "every unknown but multipliers, over its scale"


@dataclass(frozen=True)
class Timed:
    """A finished run with the least CPU s of its repeats and their spread."""

    solution: Solution
    cpu_s: float
    spread_s: float | None


@dataclass
class Job:
    """A scene prepared once (or a System as it is), run to t_end s by many solvers."""

    prepared: Prepared | None
    given: System | None
    t_end: float
    measure: str | None
    max_wall: float | None
    systems: dict[Form | None, System] = field(default_factory=dict)
    spent: float = 0.0  #: CPU s inside solver calls, repeats included

    @property
    def name(self) -> str:
        """Name of the scene, or of the system's form."""
        return self.prepared.model.scene.name if self.prepared is not None else f"system ({self.system(None).label})"

    @property
    def what(self) -> str:
        """What the error is, in words with its unit."""
        if self.measure is None:
            return WHOLE_SCENE if self.prepared is not None else WHOLE_SYSTEM
        quantity = QUANTITIES.get(self.measure.rpartition(".")[2])
        return f"largest difference of {self.measure}" + (f" [{quantity.unit}]" if quantity and quantity.unit else "")

    @property
    def times(self) -> Array:
        """(nt,) s at which trajectories are compared."""
        return np.linspace(self.system(None).t0, self.t_end, GRID)

    @property
    def constrained(self) -> bool:
        """Whether a scene has constraints (so that index 3 exists)."""
        return self.prepared is not None and self.prepared.mechanics.m > 0

    def system(self, form: Form | None) -> System:
        """The equations in a form, assembled once and called once so that compilation is not timed."""
        if form not in self.systems:
            self.systems[form] = self._assemble(form)
            _warm(self.systems[form])
        return self.systems[form]

    def _assemble(self, form: Form | None) -> System:
        if self.prepared is None:
            assert self.given is not None
            if form is not None:
                raise OptionError(f"form {form.label}: a System comes in its own form; leave the form of its runs out")
            return self.given
        return system_for(self.prepared, form)

    def solve(self, solver: Solver, form: Form | None, repeat: bool = True) -> Timed:
        """Run a solver; short runs twice, for the least CPU time."""
        if self.prepared is not None:
            form = (form if form is not None else default_form(self.prepared)).for_index(solver.highest_index)
        system, seconds = self.system(form), []
        for _ in range(2 if repeat else 1):
            begin = time.process_time()
            try:
                solution = solver.solve(system, self.t_end, max_wall=self.max_wall)
            finally:
                seconds.append(time.process_time() - begin)
                self.spent += seconds[-1]
            if not solution.complete:
                raise KeyboardInterrupt
            if seconds[0] >= SHORT:
                break
        return Timed(solution, min(seconds), max(seconds) - min(seconds) if len(seconds) > 1 else None)

    def values(self, solution: Solution, form_label: str) -> Array:
        """What is compared, (nt, ...) at `times`: the sensor, or the positions and velocities (all unknowns of a System)."""
        if self.prepared is None:
            return solution(self.times)
        if self.measure is not None:
            info = RunInfo(solution.solver, form_label, Accuracy(None, None), solution.stats)
            return Result(self.prepared, solution, info, self.times).read(self.measure)
        m = self.prepared.mechanics
        return solution(self.times)[:, : m.nq + m.nu]

    def error(self, values: Any, reference: Any) -> float:
        """Largest difference over the run."""
        if self.measure is None:
            return float(np.max(measure_of(self.system(None), self.prepared)(values, reference)))
        return float(np.max(np.abs(values - reference)))


def _warm(system: System) -> None:
    """Call everything once: kernels compile and caches fill on first use."""
    y, yp, out = system.y0, system.yp0, np.empty(system.n)
    shape = (system.n, system.n) if system.sparsity is None else (system.sparsity.nnz,)
    system.residual(system.t0, y, yp, out)
    system.jacobian(system.t0, y, yp, 1.0, np.zeros(shape))
    system.jacobian_parts(system.t0, y, yp)
    for stages in (2, 3):
        t, many = np.full(stages, system.t0), (stages, system.n)
        system.residual_stages(t, np.broadcast_to(y, many).copy(), np.broadcast_to(yp, many).copy(), np.empty(many))
