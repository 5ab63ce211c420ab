"""One variant of a law with random states, its outputs evaluated by NumPy without the compiled code."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.contracts.states import RandomStates, Values, columns, moved
from mbdae.formulations import ggl_outputs
from mbdae.kernels import Kernel
from mbdae.kernels.plan import LinearisedPlan, Outputs, Plan
from mbdae.symbolic.derive import Derived, Side, derive
from mbdae.symbolic.law import Element, Force, Law, Structure
from mbdae.symbolic.outputs import Target, acceleration, dynamics, input_symbols, jacobian_G, kinematics, position, velocity
from mbdae.symbolic.vectors import ZERO, Expr
from mbdae.system.base import Array
from mbdae.system.model.nodes import turned

FAR = 1e3  #: largest value of a law, of numbers near 1, that is far from where it has none
POINTS = 4  #: number of random states in which a variant of a law is evaluated
STEP = 1e-30  #: imaginary increment of the complex-step derivative
Measured = tuple[str, float]  #: what is checked, in words, and its error, see `BOUNDS` in checks.py


def statement(d: Derived) -> list[tuple[Target, Expr]]:
    """The law as stated: energy V, dissipation function R, force and torque on l, point of l; for a law that acts on a length or
    angle ("thrust", such as friction in a joint) that length or angle and the generalised force on it."""
    v, law, zero = d.variation, d.law, se.Integer(0)
    if isinstance(law, Force):
        wrench, thrust = law.wrench(*d.sides), law.thrust(*d.sides)
        energies = [law.energy(*d.sides), law.dissipation(*d.sides)]
    elif d.reactive:
        wrench, thrust, energies = law.resistance(*d.sides, d.reactions), d.rubbing, [zero, zero]
    else:
        return []
    force, torque = wrench or (ZERO, ZERO)
    parts = [*energies, *force, *torque, *d.sides[1].r, *(thrust or (zero, zero))]
    names = ["V", "R", "Fx", "Fy", "Fz", "Mx", "My", "Mz", "rx", "ry", "rz", "along", "push"]
    return [((n,), v.resolve(v.name(e))) for n, e in zip(names, parts, strict=True)]


def scalars(d: Derived) -> list[tuple[Target, Expr]]:
    """Energy, powers and coordinates (by "coordinate" and their names)."""
    named = {"energy": d.energy, "dissipated": d.dissipated_power, "work": d.work_power}
    named |= {f"coordinate {name}": e for name, e in d.coordinates.items()}
    if isinstance(d.law, Force) and d.law.losses(*d.sides):
        v = d.variation
        named["losses"] = v.resolve(v.name(sum(d.law.losses(*d.sides).values(), se.Integer(0))))
    return [((n,), e) for n, e in named.items() if e != 0]


def branches(d: Derived) -> list[tuple[Target, Expr]]:
    """Expressions of a joint that must be positive (its `positives`) to exclude a second solution of its constraint rows."""
    v, oriented = d.variation, all(f.kind.oriented for f in d.sides)
    found = d.law.positives(*d.sides) if oriented else {}
    return [(("positive", name), v.resolve(v.name(e))) for name, e in found.items()]


def starts(d: Derived) -> list[tuple[Target, Expr]]:
    """Start values of internal states."""
    return [((n,), e) for n, e in zip(d.states, d.state_starts, strict=True)]


def of_elements(d: Derived) -> list[tuple[Target, Expr]]:
    """Kinematic equations q' = H(q) u of a body's law; none for other laws."""
    return kinematics(d) if isinstance(d.law, Element) else []


#: groups of outputs that `Case.all_outputs` puts into one kernel
EVALUATED: tuple[Outputs, ...] = (
    ggl_outputs, dynamics, position, velocity, acceleration, statement, scalars, starts, of_elements,
)


class Case:
    """A law in one variant with random states, evaluated by `Kernel.oracle`: NumPy on the symbolic expressions."""

    def __init__(self, law: type[Law], structure: Structure, sides: tuple[Side, ...], given: dict[str, float],
                 family: dict[Any, Case] | None = None, compiles: bool = True) -> None:
        self.law, self.structure, self.given = law, structure, given
        self.compiles = compiles  #: whether compiled code is evaluated too; False: NumPy alone, which is faster to prepare
        self.family = family if family is not None else {}
        self.d: Derived = derive(law, structure, sides)
        self.family[structure, sides] = self
        self.rng = np.random.default_rng(20)
        self.states = RandomStates(self.d, given, self.rng, POINTS, self._defined)
        self.values = self.states.values

    def _defined(self, values: Values) -> bool:
        """Whether the law is finite in a state, and far from where it is not; asked of laws that say that there are such."""
        if "some places" not in self.d.law.undefined_at():
            return True
        plan = self.all_outputs
        with np.errstate(all="ignore"):
            return bool(np.all(np.abs(plan.kernel.oracle(columns(plan.all_inputs.symbols, values))) < FAR))

    def variant(self, sides: tuple[Side, ...]) -> Case:
        """The same law between other nodes."""
        known = self.family.get((self.structure, sides))
        return known if known is not None else Case(self.law, self.structure, sides, self.given, self.family)

    @cached_property
    def _sections(self) -> dict[Outputs, tuple[list[Target], slice]]:
        sections, start = {}, 0
        for outputs in EVALUATED:
            targets = [target for target, _ in outputs(self.d)]
            sections[outputs] = targets, slice(start, start + len(targets))
            start += len(targets)
        return sections

    @cached_property
    def all_outputs(self) -> Plan:
        """All outputs that the contracts use, in one kernel, so that they are compiled once."""
        return Plan(self.d, lambda d: [entry for outputs in self._sections for entry in outputs(d)])

    @cached_property
    def linearised(self) -> LinearisedPlan:
        """The outputs of GGL split into constant, linear and nonlinear parts, as the assembly uses them; they include Index3."""
        return LinearisedPlan(self.d, ggl_outputs)

    def run(self, kernel: Kernel, x: NDArray[Any]) -> NDArray[Any]:
        """Outputs (points, outputs) by the compiled code, where this case compiles, else by NumPy."""
        return kernel.values(x) if self.compiles else kernel.oracle(x).real

    def targets(self, outputs: Outputs) -> list[Target]:
        """Targets of one group of outputs."""
        return self._sections[outputs][0]

    def evaluate(self, outputs: Outputs, values: Values) -> NDArray[Any]:
        """Outputs (points, outputs), by NumPy."""
        targets, part = self._sections[outputs]
        if not targets:
            return np.zeros((len(next(iter(values.values()))), 0))
        return self.all_outputs.kernel.oracle(columns(self.all_outputs.all_inputs.symbols, values))[:, part]

    def slope(self, outputs: Outputs, u: dict[str, NDArray[Any]], clock: bool = False) -> Array:
        """d/dt (points, outputs) along velocities u, by complex step."""
        return np.asarray(self.evaluate(outputs, moved(self.d, self.values, 1j * STEP, u, clock)).imag / STEP)

    def row_slope(self, u: dict[str, NDArray[Any]]) -> Array:
        """G u (points, rows): rates of the rows at velocities u, without those that parameters prescribe."""
        found, d = self.slope(position, u), self.d
        if by := [d.rows.index(row) for row in d.by_rates]:
            faster = {str(s): self.values[str(s)] + 1j * STEP * u[f.side][:, i] for f in d.frames for i, s in enumerate(f.u)}
            found[:, by] = self.evaluate(velocity, self.values | faster).imag[:, by] / STEP
        return found

    @cached_property
    def u(self) -> dict[str, Array]:
        """Velocities (points, nu) of every side."""
        return {f.side: columns(f.u, self.values) for f in self.d.frames}

    @cached_property
    def on_manifold(self) -> Values:
        """States near the drawn position at which the rows of a joint vanish and its `positives` are positive."""
        values = self.solved(self.states.near)
        meant = np.all(np.abs(self.rows(values)[0]) < 1e-12, axis=1)
        if self._branches.targets:
            with np.errstate(invalid="ignore", divide="ignore"):  # the law may be undefined where Gauss-Newton led
                positive = self._branches.kernel.oracle(columns(self._branches.all_inputs.symbols, values)).real
            meant &= np.all(positive > 0, axis=1)
        chosen = np.flatnonzero(meant)[:POINTS] if meant.any() else np.arange(POINTS)
        return {name: e[chosen] for name, e in values.items()}

    @cached_property
    def _branches(self) -> Plan:
        return Plan(self.d, branches)

    @cached_property
    def _rows(self) -> Plan:
        return Plan(self.d, lambda d: [*position(d), *jacobian_G(d)])

    def rows(self, values: Values) -> tuple[Array, Array]:
        """g (points, rows) and G (points, rows, velocities of all frames one after the other)."""
        found = np.zeros((len(next(iter(values.values()))), 0))
        if self._rows.targets:
            with np.errstate(invalid="ignore", divide="ignore"):  # rows may be undefined in states that violate them
                found = self._rows.kernel.oracle(columns(self._rows.all_inputs.symbols, values)).real
        places = [(f.side, i) for f in self.d.frames for i in range(f.kind.sizes[1])]
        count = len(self.d.rows)
        G = np.zeros((len(found), count, len(places)))
        for (_, row, side, column), entry in zip(self._rows.targets[count:], found.T[count:], strict=True):
            G[:, row, places.index((side, column))] += entry
        return found[:, :count], G

    def solved(self, values: Values, fixed: str = "") -> Values:
        """States at which the rows vanish, found by Gauss-Newton's method from `values`; where it does not converge they do not
        vanish. fixed: name of a side whose body is not moved."""
        still = [f.side == fixed for f in self.d.frames for _ in range(f.kind.sizes[1])]
        for _ in range(30):
            g, G = self.rows(values)
            if not g.size or np.max(np.abs(g), initial=0.0) < 1e-14:
                break
            G[:, :, still] = 0.0
            finite = np.isfinite(g).all(axis=1) & np.isfinite(G).all(axis=(1, 2))  # states with other values stay as they are
            G[~finite], g[~finite] = 0.0, 0.0
            steps = np.array([np.linalg.lstsq(A, -b, rcond=1e-12)[0] for A, b in zip(G, g, strict=True)])
            values = self._displaced(values, steps)
        return values

    def _displaced(self, values: Values, steps: Array) -> Values:
        out, start = dict(values), 0
        for f in self.d.frames:
            part = steps[:, start : start + f.kind.sizes[1]]
            start += f.kind.sizes[1]
            if f.kind.by_quaternion:
                n = f.kind.translations
                P = columns(f.q[n:], values)
                new = np.hstack([part[:, :n], turned(P, part[:, n:]) - P])
            else:
                new = part
            out |= {str(s): values[str(s)] + new[:, i] for i, s in enumerate(f.q)}
        return out


def compared(names: list[str], got: NDArray[Any], wanted: NDArray[Any]) -> Iterator[Measured]:
    """Largest difference of every column over the points, relative to the largest value wanted (at least 1)."""
    if got.size:  # there may be no outputs, or no points
        difference = np.max(np.abs(got - wanted), axis=0) / max(1.0, float(np.max(np.abs(wanted))))
        yield from zip(names, np.where(np.isnan(difference), np.inf, difference).tolist(), strict=True)


_OF_ROWS = {"g": "row", "gd": "rate of row", "gdd": "acceleration of row", "lambda": "multiplier of row",
            "mu": "multiplier mu of row"}
_OF_BODIES = {"u": "equation of motion", "q": "kinematic equation"}


def label(d: Derived, target: Target) -> str:
    """An output in words: constraint rows by name, others by kind, side and number."""
    kind, *place = target
    if kind in _OF_ROWS:
        return f"{_OF_ROWS[kind]} '{d.rows[place[0]]}'"
    if kind in _OF_BODIES:
        return f"{_OF_BODIES[kind]} {place[1] + 1} of {place[0]}"
    return " ".join(map(str, target))


def rebuilt(case: Case, values: Values, index: dict[Target, int]) -> tuple[Array, Array]:
    """Residual (points, outputs) and Jacobian (points, outputs, unknowns), composed of constant, linear and nonlinear parts as in
    the assembly; index: number of each unknown by its target."""
    split = case.linearised
    constants = split.constants.once(columns(split.constant_inputs.symbols, values))
    count = len(split.constant_places)
    J = np.zeros((len(constants), len(split.targets), len(index)))
    residual = np.zeros(J.shape[:2])
    unknown = {target: values[str(symbol)] for target, symbol in zip(index, _symbols(split, index), strict=True)}
    for (o, target), value in zip(split.constant_places, constants[:, :count].T, strict=True):
        J[:, o, index[target]] += value
        if o in split.offset_places:
            residual[:, o] += value * unknown[target]
    for o, value in zip(split.offset_places, constants[:, count:].T, strict=True):
        residual[:, o] += value
    residual[:, split.nonlinear] = case.run(split.residual, columns(split.residual_inputs.symbols, values))
    varying = case.run(split.jacobian, columns(split.jacobian_inputs.symbols, values))
    for (o, target), value in zip(split.jacobian_places, varying.T, strict=True):
        J[:, o, index[target]] += value
    return residual, J


def _symbols(split: LinearisedPlan, index: dict[Target, int]) -> list[Expr]:
    table = dict(input_symbols(split.derived))
    return [table[target] for target in index]
