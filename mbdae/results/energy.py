"""Energy of a run: kinetic, potential, dissipated, work of drives and loads, and their balance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.deferred import distinct
from mbdae.kernels import plan
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Element, Force
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.motion.mechanics import Mechanics

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


States = Callable[[Array], tuple[Array, Array, Array, Array | None]]  #: times -> q, u, s, and stresses where known


def stored(mechanics: Mechanics, t: Array, states: States) -> tuple[Array, Array]:
    """Kinetic and potential energy (nt,), J."""
    q, u, s, z = states(t)
    totals = {"kinetic": np.zeros(len(t)), "potential": np.zeros(len(t))}
    for _, p, values in mechanics.evaluate(energy_outputs, t, q, u, s):
        for o, target in enumerate(p.targets):
            totals[target[0]] += values[:, :, o].sum(axis=1)
    first = 0
    for line in mechanics.model.lines:
        of_line = slice(first, first + len(line.stresses))
        first = of_line.stop
        for part in _parts(mechanics, len(t)):
            totals["kinetic"][part] += line.kinetic(u[part])
            if z is None or line.numbers["damping"]:  # with damping the stresses z contain more than the elastic part
                elastic = line.energy(q[part], u[part])[0]
            else:
                elastic = line.stored(q[part], u[part], z[part, of_line])
            totals["potential"][part] += elastic + line.potential(q[part])
    return totals["kinetic"], totals["potential"]


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


def powers(mechanics: Mechanics, t: Array, states: States) -> Array:
    """(nt, 4): dissipated power; power of loads and of prescribed motions; power lost in impacts, in friction, W."""
    q, u, s, z = states(t)
    out = np.zeros((len(t), len(TRANSFERS)))
    driven = any(instance.timed for group in mechanics.model.groups if group.derived.rows for instance in group.instances)
    multipliers = mechanics.accelerations(t, q, u, s, z)[1] if driven or mechanics.reactive else None
    for _, p, values in mechanics.evaluate(power_outputs, t, q, u, s, multipliers):
        for o, target in enumerate(p.targets):
            out[:, TRANSFERS.index(target[0])] += values[:, :, o].sum(axis=1)
    for line in mechanics.model.lines:
        out[:, 0] += line.energy(q, u)[1]
    out[:, 1] += mechanics.power_of_loads(t, q, u)
    if driven and multipliers is not None:
        rheonomic = mechanics.velocity_residual(t, q, np.zeros_like(u))
        out[:, 1] += np.einsum("ti,ti->t", multipliers, rheonomic)
    return out


def integrated(mechanics: Mechanics, steps: Array, at: Array, states: States) -> Array:
    """(len(at), 4), J: `TRANSFERS` since the first step, by Gauss quadrature over the steps."""
    grid = distinct(np.r_[steps, at])
    width, middle = np.diff(grid) / 2, (grid[1:] + grid[:-1]) / 2
    points = (middle[:, None] + width[:, None] * _NODES).ravel()
    values = np.concatenate([powers(mechanics, points[part], states) for part in _parts(mechanics, len(points))]
                            or [np.zeros((0, len(TRANSFERS)))])  # fmt: skip
    per_step = np.einsum("ijk,j->ik", values.reshape(-1, 3, len(TRANSFERS)), _WEIGHTS) * width[:, None]
    sums = np.vstack([np.zeros((1, len(TRANSFERS))), np.cumsum(per_step, axis=0)])
    return sums[np.searchsorted(grid, at)]


def energy(mechanics: Mechanics, steps: Array, at: Array, states: Any) -> Energy:
    """The energies of a run at times `at`, its steps given."""
    kinetic, potential = stored(mechanics, at, states)
    zero = np.zeros((len(at), len(TRANSFERS)))
    transferred = integrated(mechanics, steps, at, states) if has_power(mechanics) else zero
    return Energy(kinetic, potential, *transferred.T)
