"""The equations of a comparison: a scene prepared once per joint model (or a given System), assembled once per form."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mbdae.errors import OptionError
from mbdae.formulations import Form, default_form, system_for
from mbdae.integrators.base import Solver
from mbdae.integrators.solution import Solution
from mbdae.results.accuracy import Accuracy
from mbdae.results.result import Result
from mbdae.results.run_info import RunInfo
from mbdae.system.base import Array, System
from mbdae.system.prepare import Prepared


@dataclass
class Equations:
    """The equations of a comparison: of a prepared scene, with the systems assembled from it by form, or a given System."""

    prepared: Prepared | None
    given: System | None = None
    systems: dict[Form | None, System] = field(default_factory=dict)

    def system(self, form: Form | None) -> System:
        """The equations in a form, assembled and evaluated once, so that the CPU time of runs includes no compilation."""
        if form not in self.systems:
            self.systems[form] = self._assemble(form)
            warm(self.systems[form])
        return self.systems[form]

    def _assemble(self, form: Form | None) -> System:
        if self.prepared is not None:
            return system_for(self.prepared, form)
        assert self.given is not None
        if form is not None:
            raise OptionError(f"form {form.label}: the equations of a System are given, so that a run cannot choose their form; "
                              f"give runs without one, such as mb.Run(mb.IDA())")
        return self.given

    def for_solver(self, form: Form | None, solver: Solver) -> System:
        """The equations in the form, with a lower index where the solver needs it."""
        if self.prepared is None:
            return self.system(form)
        own = form if form is not None else default_form(self.prepared, solver.highest_index)
        return self.system(own.for_index(solver.highest_index))

    def label_of(self, form: Form | None, solver: Solver) -> str:
        """Label of the form that a solver uses; where `form` is None, of the default form for this solver."""
        takes_rates_alone = form is None and not solver.highest_index
        return (self.for_solver(form, solver) if takes_rates_alone else self.system(form)).label

    def sensor(self, solution: Solution, measure: str, times: Array) -> Array:
        """Values (nt, ...) of a sensor of a run."""
        assert self.prepared is not None
        info = RunInfo(solution.solver, "", Accuracy(None, None), solution.stats)
        return Result(self.prepared, solution, info, times).read(measure)

    @property
    def recursive(self) -> tuple[int, int]:
        """Number of joints that are recursive, and number of joints that the user asked to be recursive."""
        if self.prepared is None:
            return 0, 0
        model = self.prepared.model
        return len(model.recursive), len(model.recursive) + len(model.stay_kinematic)

    def motion_as_in(self, other: Equations, t: Array, y: Array) -> Array:
        """Positions and velocities (nt, nq + nu) of the bodies from unknowns y (nt, n) at t, in the order of `other`; 0 in
        place of joint coordinates, which not all joint models have."""
        assert self.prepared is not None
        assert other.prepared is not None
        q, u, _ = self.prepared.states(t, y)
        return np.hstack([q, u, np.zeros((len(q), 1))])[:, _columns(self.prepared, other.prepared)]


def _columns(own: Prepared, wanted: Prepared) -> list[int]:
    """Indices, in the unknowns of `own`, of the body unknowns of `wanted`; -1 in place of joint coordinates."""
    twins = {node.body.name: node for node in own.model.nodes if node.body is not None}
    positions: list[int] = []
    velocities: list[int] = []
    for node in wanted.model.nodes:
        if node.body is None:
            positions += [-1] * node.kind.sizes[0]
            velocities += [-1] * node.kind.sizes[1]
            continue
        twin = twins.get(node.body.name)
        if twin is None or twin.kind is not node.kind:
            raise OptionError(f"body '{node.body.name}' is missing in this run or has other unknowns than in the reference: "
                              f"motions cannot be compared; name a sensor to compare by, such as measure='C.angle'")  # fmt: skip
        positions += range(twin.q, twin.q + node.kind.sizes[0])
        velocities += range(own.mechanics.nq + twin.u, own.mechanics.nq + twin.u + node.kind.sizes[1])
    return positions + velocities


def warm(system: System) -> None:
    """Call every function of a system once, because kernels are compiled and caches filled at the first call."""
    y, yp, out = system.y0, system.yp0, np.empty(system.n)
    shape: Any = system.jacobian_shape
    system.residual(system.t0, y, yp, out)
    system.jacobian(system.t0, y, yp, 1.0, np.zeros(shape))
    system.jacobian_parts(system.t0, y, yp)
    if system.rhs is not None:
        system.rhs(system.t0, y, out)
    for stages in (2, 3):
        t, many = np.full(stages, system.t0), (stages, system.n)
        system.residual_stages(t, np.broadcast_to(y, many).copy(), np.broadcast_to(yp, many).copy(), np.empty(many))
