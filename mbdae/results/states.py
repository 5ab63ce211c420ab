"""The states of a run at the times that a result shows, and accelerations and multipliers from them: what sensors read.

Energy of a run: kinetic, potential, dissipated, work of drives and loads, and their balance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from mbdae.deferred import distinct
from mbdae.errors import NamesArguments
from mbdae.inputs import timed
from mbdae.integrators.solution import Solution
from mbdae.kernels.plan import Outputs, plan
from mbdae.process import unchanging
from mbdae.scene.components import Connection
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Element, Force
from mbdae.symbolic.outputs import Target, coordinate
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembled.guards import Observer
from mbdae.system.base import Array
from mbdae.system.motion.mechanics import Mechanics
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
    fixed: ClassVar[bool] = True

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


def inside(first: float, last: float, run: Solution) -> float:
    """The end (s) of the part of a run from `first` to `last`, just before a jump at `last`: the value after it is not in it."""
    return last - 16 * float(np.spacing(last)) if first < last < run.t[-1] else last


class RunStates(NamesArguments):
    """A run of a prepared scene, read at times t (nt,)."""

    def __init__(self, prepared: Prepared, solution: Solution, t: Array) -> None:
        self.prepared, self.solution, self.t = prepared, solution, unchanging(np.array(t, dtype=float))
        self._silent = False  # while an expression is read, its sensors tell nothing: it does

    def __call__(self, t: Any) -> RunStates:
        """The same run at other times t (s)."""
        return RunStates(self.prepared, self.solution, t)

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

    def over_laws(self, outputs: Outputs, item: Connection) -> Iterator[tuple[Any, Any, Array]]:
        """(law, targets, values (nt, outputs)) of every law of one item that has such outputs; they may depend on multipliers."""
        q, u, s = self._states
        for g, p, values in self.prepared.with_all_rows.evaluate(outputs, self.t, q, u, s, self._dynamics[1]):
            for i, instance in enumerate(self.prepared.model.groups[g].instances):
                if instance.item == item.name and len(p.targets):
                    yield instance.law, p.targets, values[:, i]

    def sum_over_laws(self, outputs: Outputs, item: Connection, width: int) -> Array:
        """Outputs (nt, width) of the laws of one item, summed."""
        return sum((values for *_, values in self.over_laws(outputs, item)), np.zeros((len(self.t), width)))

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


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
TRANSFERS = ("dissipated", "work", "impact", "friction")  #: energies that are integrals over time
_CHUNK = 3000  #: largest number of states evaluated at once
_ELEMENTS = 20_000  #: largest number of beam elements times states evaluated at once, but at least one state


def energy_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Kinetic energy of elements, potential energy of forces."""
    if isinstance(d.law, Element):
        return [(("kinetic",), d.energy)]
    return [(("potential",), d.energy)] if isinstance(d.law, Force) and d.energy != 0 else []


def power_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Dissipated power, power of applied loads, and the parts of the dissipated power lost in impacts and in friction."""
    parts = [(("dissipated",), d.dissipated_power), (("work",), d.work_power)]
    if isinstance(d.law, Force):
        parts += [((cause,), d.variation.resolve(d.variation.name(e))) for cause, e in d.law.losses(*d.sides).items()]
    if d.reactive:
        parts.append((("friction",), d.dissipated_power))
    return [(target, e) for target, e in parts if e != 0]


@dataclass(frozen=True)
class Energy:
    """Energies over the result's times (nt,), J. `balance` is the numerical error of the energy: positive where the run gained
    energy without a cause, negative where it lost some.

    impact, friction: the parts of `dissipated` lost in contacts normal and tangential to them; other: the rest."""

    kinetic: Array
    potential: Array
    dissipated: Array
    work: Array
    impact: Array
    friction: Array

    @property
    def other(self) -> Array:
        """Energy (nt,), J, dissipated by dampers and all else that is neither contact nor friction."""
        return self.dissipated - self.impact - self.friction

    @property
    def total(self) -> Array:
        """Kinetic and potential energy (nt,), J."""
        return self.kinetic + self.potential

    @property
    def balance(self) -> Array:
        """T + V + dissipated - work minus its start value (nt,), J; zero in an exact run."""
        sum_ = self.total + self.dissipated - self.work
        return sum_ - sum_[0] if len(sum_) else sum_


StatesAt = Callable[[Array], tuple[Array, Array, Array, Array | None]]  #: times -> q, u, s, and stresses where known


def stored(mechanics: Mechanics, t: Array, states: StatesAt) -> tuple[Array, Array]:
    """Kinetic and potential energy (nt,), J."""
    q, u, s, z = states(t)
    kinetic, potential = mechanics.sums(energy_outputs, ("kinetic", "potential"), t, q, u, s).T
    first = 0
    for line in mechanics.model.lines:
        of_line = slice(first, first + len(line.stresses))
        first = of_line.stop
        for part in _parts(mechanics, len(t)):
            kinetic[part] += line.kinetic(u[part])
            if z is None or line.numbers["damping"]:  # with damping the stresses z contain more than the elastic part
                elastic = line.energy(q[part], u[part])[0]
            else:
                elastic = line.stored(q[part], u[part], z[part, of_line])
            potential[part] += elastic + line.potential(q[part])
    return kinetic, potential


def _parts(mechanics: Mechanics, count: int) -> list[slice]:
    """Slices of `count` states, each of bounded memory."""
    elements = sum(len(line.mesh.elements) for line in mechanics.model.lines)
    size = min(_CHUNK, max(1, _ELEMENTS // elements)) if elements else _CHUNK
    return [slice(i, i + size) for i in range(0, count, size)]


def has_power(mechanics: Mechanics) -> bool:
    """Whether anything dissipates or does work."""
    timed = any(instance.timed for group in mechanics.model.groups for instance in group.instances)
    timed |= any(line.loads or line.numbers["damping"] for line in mechanics.model.lines)
    return timed or any(plan(group.derived, power_outputs).targets for group in mechanics.model.groups)


def powers(mechanics: Mechanics, t: Array, states: StatesAt) -> Array:
    """(nt, 4): dissipated power; power of loads and of prescribed motions; power lost in impacts, in friction, W."""
    q, u, s, z = states(t)
    driven = any(instance.timed for group in mechanics.model.groups if group.derived.rows for instance in group.instances)
    multipliers = mechanics.accelerations(t, q, u, s, z)[1] if driven or mechanics.reactive else None
    out = mechanics.sums(power_outputs, TRANSFERS, t, q, u, s, multipliers)
    for line in mechanics.model.lines:
        out[:, 0] += line.energy(q, u)[1]
    out[:, 1] += mechanics.power_of_loads(t, q, u)
    if driven and multipliers is not None:
        rheonomic = mechanics.velocity_residual(t, q, np.zeros_like(u))
        out[:, 1] += np.einsum("ti,ti->t", multipliers, rheonomic)
    return out


def integrated(mechanics: Mechanics, steps: Array, at: Array, states: StatesAt) -> Array:
    """(len(at), 4), J: `TRANSFERS` since the first step, by Gauss quadrature over the steps."""
    grid = distinct(np.r_[steps, at])
    width, middle = np.diff(grid) / 2, (grid[1:] + grid[:-1]) / 2
    points = (middle[:, None] + width[:, None] * _NODES).ravel()
    values = np.concatenate([powers(mechanics, points[part], states) for part in _parts(mechanics, len(points))]
                            or [np.zeros((0, len(TRANSFERS)))])
    per_step = np.einsum("ijk,j->ik", values.reshape(-1, 3, len(TRANSFERS)), _WEIGHTS) * width[:, None]
    sums = np.vstack([np.zeros((1, len(TRANSFERS))), np.cumsum(per_step, axis=0)])
    return sums[np.searchsorted(grid, at)]


def energy(mechanics: Mechanics, steps: Array, at: Array, states: Any) -> Energy:
    """The energies of a run at times `at`, its steps given."""
    kinetic, potential = stored(mechanics, at, states)
    zero = np.zeros((len(at), len(TRANSFERS)))
    transferred = integrated(mechanics, steps, at, states) if has_power(mechanics) else zero
    return Energy(kinetic, potential, *transferred.T)
