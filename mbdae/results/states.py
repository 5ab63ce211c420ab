"""The states of a run at the times that a result shows, and accelerations and multipliers from them: what sensors read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.errors import NamesArguments
from mbdae.inputs import timed
from mbdae.integrators.solution import Solution
from mbdae.kernels.plan import Outputs
from mbdae.scene.components import Connection
from mbdae.symbolic.outputs import coordinate
from mbdae.system.assembled.observed import Observer
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared


@dataclass(frozen=True, eq=False)
class States:
    """Positions q (nt, nq), velocities u (nt, nu), internal states s (nt, ns) and, where they were unknowns of the run, stresses
    of the beams z (nt, nz), at times t (nt,). They do not depend on the form of the equations."""

    t: Array
    q: Array
    u: Array
    s: Array
    z: Array | None

    def until(self, end: float) -> States:
        """The states up to a time (s)."""
        kept = self.t <= end
        return States(self.t[kept], self.q[kept], self.u[kept], self.s[kept], None if self.z is None else self.z[kept])


@dataclass(frozen=True, eq=False)
class Instant:
    """Stands in for solver and interpolant where a Result has one instant only, such as an equilibrium: the unknowns y (1, n) and
    their derivatives yp (1, n) are returned for every time."""

    label: str
    y: Array = field(repr=False)
    yp: Array = field(repr=False)

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Instant:
        """The same for other unknowns y (1, n) and yp (1, n); t and pieces, which interpolants of runs need, are not used."""
        return Instant(self.label, y, yp)

    def value(self, t: Array) -> Array:
        """Unknowns y (k, n) at times t (k,)."""
        return np.repeat(self.y, len(t), axis=0)

    def derivative(self, t: Array) -> Array:
        """Derivatives y' (k, n) of the unknowns at times t (k,)."""
        return np.repeat(self.yp, len(t), axis=0)


def stresses(prepared: Prepared, solution: Solution, t: Array) -> Array | None:
    """Stresses z (nt, nz) of the beams at times t (nt,), where they were unknowns of the run; None elsewhere."""
    names = [name for line in prepared.model.lines for name in line.stresses]
    if not names or names[0] not in solution.names:
        return None
    first = solution.names.index(names[0])
    return np.asarray(solution(t)[:, first : first + len(names)])


def states_of(prepared: Prepared, solution: Solution, t: Array) -> States:
    """The states of a run at times t (nt,)."""
    return States(t, *prepared.states(t, solution(t)), stresses(prepared, solution, t))


class RunStates(NamesArguments):
    """A run of a prepared scene, read at times t (nt,)."""

    def __init__(self, prepared: Prepared, solution: Solution, t: Array) -> None:
        self.prepared, self.solution, self.t = prepared, solution, np.asarray(t, dtype=float)
        self._silent = False  # while an expression is read, its sensors tell nothing: it does

    def _judge(self, quantity: Any) -> None:
        """Tell where the error of a quantity that was read is above the accuracy asked; here nothing is known of it."""

    @contextmanager
    def _silently(self) -> Iterator[None]:
        """Context in which what is read is not judged: a part of something that is."""
        before, self._silent = self._silent, True
        try:
            yield
        finally:
            self._silent = before

    @cached_property
    def _states(self) -> tuple[Array, Array, Array]:
        return self.states(self.t)

    def states(self, t: Array) -> tuple[Array, Array, Array]:
        """Positions q (nt, nq), velocities u (nt, nu) and internal states s (nt, ns) at times t (nt,)."""
        y = self.solution(t)
        return self.prepared.states(np.ravel(np.asarray(t, dtype=float)), y.reshape(-1, y.shape[-1]))

    def stresses(self, t: Array) -> Array | None:
        """Stresses z (nt, nz) of the beams at times t (nt,), where they were unknowns of the run (Radau IIA); None elsewhere."""
        return stresses(self.prepared, self.solution, np.atleast_1d(self.solution.times(t)))

    @property
    def q(self) -> Array:
        """Positions of all nodes (nt, nq)."""
        return self._states[0]

    @property
    def u(self) -> Array:
        """Velocities of all nodes (nt, nu)."""
        return self._states[1]

    @cached_property
    def _dynamics(self) -> tuple[Array, Array]:
        return self.prepared.with_all_rows.accelerations(self.t, *self._states, stresses(self.prepared, self.solution, self.t))

    @property
    def acceleration(self) -> Array:
        """u' of all nodes (nt, nu), from the equations of motion at q, u."""
        return self._dynamics[0]

    @property
    def multipliers(self) -> Array:
        """Constraint multipliers (nt, m), from the equations of motion at q, u; names in `multiplier_names`. Where redundant rows
        leave them open, those of least norm (`Mechanics.accelerations`)."""
        return self._dynamics[1]

    @property
    def multiplier_names(self) -> tuple[str, ...]:
        """"joint.row" of every multiplier."""
        return tuple(row.name for row in self.prepared.with_all_rows.rows)

    def observed(self, *expressions: Any) -> Array:
        """(nt, count) values of expressions of sensors and time (of symengine)."""
        moved = self.prepared.all_bodies.moved
        return Observer(self.prepared.model, moved, expressions)(self.t, self.solution(self.t))

    def sum_over_laws(self, outputs: Outputs, item: Connection, width: int) -> Array:
        """Outputs (nt, width) of the laws of one item, summed; they may depend on multipliers."""
        total = np.zeros((len(self.t), width))
        q, u, s = self._states
        for g, _, values in self.prepared.with_all_rows.evaluate(outputs, self.t, q, u, s, self.multipliers):
            for i, instance in enumerate(self.prepared.model.groups[g].instances):
                if instance.item == item.name:
                    total += values[:, i]
        return total

    def coordinate(self, item: Connection, name: str) -> tuple[Array, Array] | None:
        """A coordinate of a joint and its rate (nt,), whole turns counted along the run's steps; None where it cannot be read."""
        found = self._one_coordinate(item, name, self.t)
        model = self.prepared.model
        if found is None or model.planar or item.unit(name) != "rad" or model.coordinate_node(item.name, name) is not None:
            return found
        value, rate = found
        steps = self.solution.t
        grid, fine_rate = self._one_coordinate(item, name, steps)  # type: ignore[misc]
        followed = _unwrapped(steps, grid, fine_rate, self._start_value(item, name))
        near = np.interp(self.t, steps, followed)
        return value + 2 * np.pi * np.round((near - value) / (2 * np.pi)), rate

    def coordinates(self, item: Connection) -> dict[str, tuple[Array, Array]]:
        """All coordinates of a joint that can be read."""
        found = {name: self.coordinate(item, name) for name in item.coordinates}
        return {name: one for name, one in found.items() if one is not None}

    def _start_value(self, item: Connection, name: str) -> float:
        if name in item.prescribed:
            return timed.value_at(item.prescribed[name], float(self.solution.t[0]))
        return self.prepared.start.coordinates.get((item.name, name), item.hold.get(name, 0.0))

    def coordinate_at(self, item: str, name: str, t: Array) -> tuple[Array, Array] | None:
        """A coordinate (turns not counted) and its rate (nt,) of a joint at times t (nt,)."""
        return self._one_coordinate(self.prepared.model.scene[item], name, t)

    def _one_coordinate(self, item: Connection, name: str, t: Array) -> tuple[Array, Array] | None:
        for g, p, values in self.prepared.mechanics.evaluate(coordinate, t, *self.states(t)):
            for i, instance in enumerate(self.prepared.model.groups[g].instances):
                if instance.item == item.name and ("c", name) in p.targets:
                    return values[:, i, p.targets.index(("c", name))], values[:, i, p.targets.index(("cd", name))]
        return None


def _unwrapped(t: Array, principal: Array, rate: Array, start: float) -> Array:
    """Continuous angle along steps from its principal value: each step adds the whole turns nearest to the angle that the rates
    predict."""
    out = np.empty_like(principal)
    previous = start
    for i, value in enumerate(principal):
        guess = previous if i == 0 else previous + (t[i] - t[i - 1]) * (rate[i] + rate[i - 1]) / 2
        out[i] = value + 2 * np.pi * np.round((guess - value) / (2 * np.pi))
        previous = out[i]
    return out
