"""A model at given states, many at once: outputs of its laws, constraint rows with their derivatives, displaced positions.

Forces that depend on multipliers: friction of joints, which grows with their own reaction forces.

M u' + G^T lambda = f + R(lambda), G u' = -gamma, where R is the friction, is solved by Newton's method with the exact dR/dlambda,
starting from the multipliers without friction. Where that fails, the friction is increased from 0 to R in steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import distinct
from mbdae.errors import SolverError
from mbdae.kernels.plan import Outputs, Plan, plan
from mbdae.native.program import Operations
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Force
from mbdae.symbolic.outputs import Target, acceleration, jacobian_G, position, slopes, velocity
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.model.model import Model
from mbdae.system.model.nodes import Node, quaternion_product, turned
from mbdae.system.model.numbering import Numbering, Row
from mbdae.system.motion.constrained import Evaluator

Index = NDArray[np.intp]
#: function (group, its plan) -> (instances, outputs) numbers in a vector of results to which the values are added, -1 for none
Adding = Callable[[int, Plan], Index]


class States:
    """Evaluates a model at nt states: t (nt,), q (nt, nq) and u (nt, nu) of all nodes, internal states s (nt, ns). rows: the
    constraint rows in force; redundant: how many of them follow from the others (which of them, depends on the position)."""

    def __init__(self, model: Model, rows: list[Row], redundant: int = 0) -> None:
        self.model, self.rows, self.redundant = model, rows, redundant
        self.nq, self.nu, self.m = model.nq, model.nu, len(rows)
        key = tuple(rows)
        if key not in model.kept:
            found, plans = model.shape.kept.setdefault(key, (None, {}))
            own = found.again(found.numbering.again(model)) if found else Evaluator(Numbering(model, rows, ("lambda", "z")))
            model.kept[key] = model.shape.kept[key] = own, plans
        self._evaluator: Evaluator = model.kept[key][0]
        self._plans: dict[Any, Any] = model.kept[key][1]
        self.numbering: Numbering = self._evaluator.numbering

    @cached_property
    def reactive(self) -> list[int]:
        """Numbers of the groups of joints whose friction depends on their own reactions."""
        return [g for g, group in enumerate(self.model.groups) if group.derived.reactive]

    @cached_property
    def followed(self) -> dict[tuple[str, str], int]:
        """(joint, coordinate) -> number of the internal state that follows this angle beyond whole turns, where there is one."""
        of = [(self.model.groups[g].instances[i], self.model.groups[g].derived.states[j]) for g, i, j in self.numbering.states]
        return {(one.item, one.law.name_of_coordinate): n for n, (one, state) in enumerate(of) if state == one.law.follows}

    @cached_property
    def rotational(self) -> Any:
        """(nu,) bool: which velocities are angular."""
        mask = np.zeros(self.nu, dtype=bool)
        for node in self.model.nodes:
            if node.kind is NodeKind.COORDINATE:
                mask[node.u] = node.unit == "rad"
            elif node.kind.turns:
                mask[node.u + node.kind.translations : node.u + node.kind.sizes[1]] = True
        return mask

    @cached_property
    def velocity_units(self) -> Array:
        """(nu,) unit displacement of every velocity, which makes lengths and angles comparable: the scene's length (m), or 1
        rad."""
        return np.where(self.rotational, 1.0, self.model.length)

    def speed(self, u: Array) -> float:
        """The largest of velocities u (..., nu), m/s: angular ones times the scene's length."""
        return float(np.max(np.abs(u) / self.velocity_units, initial=0.0)) * self.model.length

    @cached_property
    def position_units(self) -> Array:
        """(nq,) unit of each position unknown: the scene's length, 1 for quaternions and angles."""
        units = np.ones(self.nq)
        for node in self.model.nodes:
            if node.unit == "m":
                units[node.q : node.q + node.kind.translations] = self.model.length
        return units

    def evaluate(self, outputs: Outputs, t: Array, q: Array, u: Array, s: Array | None = None,
                 multipliers: Array | None = None, groups: Sequence[int] | None = None,
                 ) -> list[tuple[int, Plan, Array]]:
        """Evaluate outputs of the laws. Returns (group, plan, values (nt, instances, outputs)) for every group whose laws have
        such outputs. outputs: selects them; groups: numbers of the groups, None: all."""
        planned = self._planned(outputs, groups)

        def emitted(part: Operations) -> Any:
            return np.concatenate([self._emitted(part, g, p).ravel() for g, p in planned])

        if not planned:
            return []
        found = self.at_states((outputs, tuple(g for g, _ in planned)), emitted, t, q, u, s, multipliers)
        shapes = [(len(t), len(self.model.groups[g].instances), len(p.targets)) for g, p in planned]
        parts = np.split(found, np.cumsum([i * o for _, i, o in shapes])[:-1], axis=1)
        return [(g, p, values.reshape(shape)) for (g, p), values, shape in zip(planned, parts, shapes, strict=True)]

    def at_states(self, name: Any, emitted: Callable[[Operations], Any], t: Array, q: Array, u: Array | None,
                  s: Array | None = None, multipliers: Array | None = None, z: Array | None = None) -> Array:
        """The results (nt, width) of a list of operations, see `Evaluator`. z (nt, nz): stresses of beams."""
        nb, y = self.numbering, np.zeros((len(t), self.numbering.n))
        # laws read multipliers of scaled rows, which are the unknowns of the forms
        scaled = None if multipliers is None else multipliers / nb.scaling()
        firsts = [*(nb.start[head] for head in ("q", "u", "s", "z", "lambda")), nb.start["mu"]]
        for first, end, values in zip(firsts, firsts[1:], (q, u, s, z, scaled), strict=False):
            if values is not None:
                y[:, first:end] = values
        return self._evaluator.at_states(name, emitted, t, y)

    def _planned(self, outputs: Outputs, groups: Sequence[int] | None = None) -> list[tuple[int, Plan]]:
        """The groups whose laws have such outputs, each with the plan of these."""
        key = outputs, None if groups is None else tuple(groups)
        if key not in self._plans:
            chosen = groups if groups is not None else range(len(self.model.groups))
            self._plans[key] = [(g, p) for g in chosen if (p := plan(self.model.groups[g].derived, outputs)).targets]
        return self._plans[key]  # type: ignore[no-any-return]

    def _emitted(self, part: Operations, g: int, p: Plan) -> Index:
        """Slots (instances, outputs) of the outputs of a group."""
        return p.kernel.emit(part, self.numbering.gather(g, p.all_inputs))

    def added(self, part: Operations, outputs: Outputs, size: int, numbers: Adding, sign: float = 1.0,
              groups: Sequence[int] | None = None) -> Index:
        """Append outputs of the laws, times `sign`, added to a vector of results; returns its slots (size,)."""
        first = part.zeros(size)
        for g, p in self._planned(outputs, groups):
            at, values = numbers(g, p), self._emitted(part, g, p)
            part.add(first + at[at >= 0], values[at >= 0], sign)
        return first + np.arange(size)

    def in_velocities(self, g: int, p: Plan) -> Index:
        """(instances, outputs) numbers of the velocities to which outputs belong, see `Adding`."""
        return np.stack([self.numbering.velocities(target, g) for target in p.targets], axis=1)

    def in_rows(self, g: int, p: Plan) -> Index:
        """(instances, outputs) numbers of the rows to which outputs belong."""
        return np.stack([self.numbering.row_numbers(g, target[1]) for target in p.targets], axis=1)

    def _in_states(self, g: int, p: Plan) -> Index:
        return np.stack([self.numbering.places(target, g) for target in p.targets], axis=1) - self.numbering.start["s"]

    def constraint_jacobian(self, t: Array, q: Array) -> Array:
        """Constraint Jacobian G (nt, m, nu)."""
        return self.full_of_G(self.entries_of_G(t, q)[0])

    def full_of_G(self, values: Array) -> Array:
        """G (nt, m, nu) from its entries (nt, k)."""
        G: Array = np.zeros((len(values), self.m * self.nu))
        G[:, self.cells_of_G] = values
        return G.reshape(len(values), self.m, self.nu)

    def entries_of_G(self, t: Array, q: Array) -> tuple[Array, Index, Index]:
        """Values (nt, k) of the entries of G with their rows and columns (k,)."""
        return self.at_states("G", self.emitted_G, t, q, None), *np.divmod(self.cells_of_G, self.nu)

    def emitted_G(self, part: Operations) -> Index:
        """Append the entries of G; returns their slots (k,)."""
        def numbers(g: int, p: Plan) -> Index:
            return np.where((at := self._in_G(g, p)) >= 0, np.searchsorted(self.cells_of_G, at), -1)

        return self.added(part, jacobian_G, len(self.cells_of_G), numbers)

    @property
    def cells_of_G(self) -> Index:
        """(k,) row times nu plus column of every entry of G."""
        if "cells" not in self._plans:
            found = np.concatenate([np.zeros(0, np.intp), *(self._in_G(g, p).ravel() for g, p in self._planned(jacobian_G))])
            self._plans["cells"] = distinct(found[found >= 0])
        return self._plans["cells"]  # type: ignore[no-any-return]

    def _in_G(self, g: int, p: Plan) -> Index:
        rows = self.in_rows(g, p)
        columns = np.stack([self.numbering.velocities(("u", *target[2:]), g) for target in p.targets], axis=1)
        return np.where(rows >= 0, rows * self.nu + columns, -1)

    def rows_without_slope(self, t: Array, q: Array) -> Any:
        """(m,) bool: which rows have no finite derivative, an entry of G being infinite or NaN, at positions q (nq,)."""
        values, rows, _ = self.entries_of_G(t, q[None])
        return np.bincount(rows, ~np.isfinite(values[0]), self.m) > 0

    def _rows(self, outputs: Outputs, t: Array, q: Array, u: Array) -> Array:
        return self.at_states((outputs, "rows"), lambda part: self.added(part, outputs, self.m, self.in_rows), t, q, u)

    def of_states(self, outputs: Outputs, t: Array, q: Array, u: Array, s: Array | None = None) -> Array:
        """Values (nt, ns) of outputs that belong to the internal states, such as their start values or rates."""
        size = len(self.numbering.states)
        if not size:
            return np.zeros((len(t), 0))
        return self.at_states((outputs, "states"), lambda part: self.added(part, outputs, size, self._in_states), t, q, u, s)

    def forces(self, outputs: Outputs, t: Array, q: Array, u: Array) -> Array:
        """Sums (nt, nu) of outputs that belong to velocities, such as generalised forces."""
        return self.at_states((outputs, "u"), lambda part: self.added(part, outputs, self.nu, self.in_velocities), t, q, u)

    def sums(self, outputs: Outputs, names: Sequence[str], *state: Array | None) -> Array:
        """Sums (nt, names) of outputs over all laws, by the first entry of their targets; state: as in `evaluate`, from t on."""

        def numbers(g: int, p: Plan) -> Index:
            at = [names.index(target[0]) for target in p.targets]
            return np.broadcast_to(np.array(at, dtype=np.intp), (len(self.model.groups[g].instances), len(at)))

        return self.at_states((outputs, "sums"), lambda part: self.added(part, outputs, len(names), numbers), *state)  # type: ignore[arg-type]

    def position_residual(self, t: Array, q: Array) -> Array:
        """Constraint residual g (nt, m)."""
        return self._rows(position, t, q, np.zeros((len(t), self.nu)))

    def velocity_residual(self, t: Array, q: Array, u: Array) -> Array:
        """Velocity constraint residual G u + g_t (nt, m)."""
        return self._rows(velocity, t, q, u)

    def acceleration_bias(self, t: Array, q: Array, u: Array) -> Array:
        """gamma (nt, m): d2g/dt2 = G u' + gamma."""
        return self._rows(acceleration, t, q, u)

    @cached_property
    def _kinds(self) -> list[tuple[NodeKind, Any, Any]]:
        """Every kind of node with the positions in q (k, nq of the kind) and in u (k, nu of the kind) of its k nodes."""
        found: dict[NodeKind, list[Node]] = {}
        for node in self.model.nodes:
            found.setdefault(node.kind, []).append(node)
        first = {kind: np.array([(n.q, n.u) for n in nodes]) for kind, nodes in found.items()}
        return [(kind, at[:, :1] + np.arange(kind.sizes[0]), at[:, 1:] + np.arange(kind.sizes[1])) for kind, at in first.items()]

    def integrate_positions(self, q: Array, displacement: Array) -> Array:
        """q (nq,) after virtual displacements (nu,): translations add, rotations in body axes compose."""
        q = q.copy()
        for kind, at, by in self._kinds:
            d = displacement[by]
            if kind.by_quaternion:
                n = kind.translations
                q[at[:, :n]] += d[:, :n]
                q[at[:, n:]] = turned(q[at[:, n:]], d[:, n:])
            else:
                q[at] += d
        return q

    def rates(self, q: Array, u: Array) -> Array:
        """q' (nq,) from velocities u (nu,)."""
        qp = np.zeros(self.nq)
        for kind, at, by in self._kinds:
            d = u[by]
            if kind.by_quaternion:
                n = kind.translations
                qp[at[:, :n]] = d[:, :n]
                qp[at[:, n:]] = quaternion_product(q[at[:, n:]], np.hstack([np.zeros((len(d), 1)), d[:, n:]])) / 2
            else:
                qp[at] = d
        return qp


def gap_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Gap (m or rad) and its rate of every contact of a law, one after the other."""
    if not isinstance(d.law, Force):
        return []
    pairs = d.law.gaps(*d.sides)
    resolve, name = d.variation.resolve, d.variation.name
    return [((what, i), resolve(name(e))) for i, pair in enumerate(pairs) for what, e in zip(("gap", "rate"), pair, strict=True)]


def gaps_of(mechanics: States, t: Array, q: Array, u: Array) -> dict[tuple[int, int], tuple[Array, Array]]:
    """(group, instance) of every contact law -> its gaps (m or rad) and their rates, (nt, contacts of the law) each."""
    return {(g, i): (values[:, i, ::2], values[:, i, 1::2]) for g, _, values in mechanics.evaluate(gap_outputs, t, q, u)
            for i in range(len(mechanics.model.groups[g].instances))}


ITERATIONS = 30
SETTLED = 1e-10  #: change of the multipliers at which Newton's method stops, relative to the largest multiplier or load
SMALLEST = 1e-6  #: lower bound (N or N m) of the largest multiplier or load in SETTLED, for scenes without any force
STEPS = 8  #: number of equal steps in which friction is increased from 0 where Newton's method fails at once

State = tuple[Array, Array, Array, Array | None]  #: times, q, u, s of many states
#: function (f (nt, nu), dR/dlambda (nt, nu, m) or None) that returns u' (nt, nu) and lambda (nt, m) of the linear equations
#: M u' + (G^T - dR/dlambda) lambda = f, G u' = -gamma
Solve = Callable[[Array, Array | None], tuple[Array, Array]]


def friction_of(mechanics: States, state: State, multipliers: Array) -> tuple[Array, Array]:
    """The friction R (nt, nu) and its derivative dR/dlambda (nt, nu, m) at multipliers lambda (nt, m)."""
    nb, nu, m = mechanics.numbering, mechanics.nu, mechanics.m

    def numbers(g: int, p: Plan) -> Index:
        at = mechanics.in_velocities(g, p)
        for o, target in enumerate(p.targets):
            if target[0] == "slope":
                row = nb.row_numbers(g, target[3])
                at[:, o] = np.where(row >= 0, nu + at[:, o] * m + row, -1)
        return at

    def emitted(part: Operations) -> Index:
        return mechanics.added(part, slopes, nu * (1 + m), numbers, -1.0, mechanics.reactive)

    found = mechanics.at_states("friction", emitted, *state, multipliers)
    return found[:, :nu], found[:, nu:].reshape(-1, nu, m) / nb.scaling()


def solve_with_friction(mechanics: States, state: State, f: Array, solve: Solve) -> tuple[Array, Array]:
    """u' (nt, nu) and lambda (nt, m) with friction. f (nt, nu): all forces, with the friction at lambda = 0; solve: solves the
    linear equations. Raises SolverError where no solution is found."""
    f = f - friction_of(mechanics, state, np.zeros((len(f), mechanics.m)))[0]
    _, start = solve(f, None)
    acceleration, multipliers, left = _newton(mechanics, state, f, solve, start, 1.0)
    if np.any(left):
        multipliers = start
        for step in range(1, STEPS + 1):
            acceleration, multipliers, left = _newton(mechanics, state, f, solve, multipliers, step / STEPS)
    if np.any(left):
        raise SolverError(_refusal(mechanics, left), float(state[0][int(np.argmax(np.any(left, axis=1)))]))
    return acceleration, multipliers


def _newton(mechanics: States, state: State, f: Array, solve: Solve, multipliers: Array,
            share: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Newton's method from the given multipliers for `share` times the friction: u', lambda, and which multipliers (nt, m) have
    not converged."""
    for _ in range(ITERATIONS):
        R, slope = friction_of(mechanics, state, multipliers)
        acceleration, new = solve(f + share * (R - np.einsum("tij,tj->ti", slope, multipliers)), share * slope)
        size = np.maximum(np.max(np.abs(new), axis=1, keepdims=True, initial=SMALLEST), np.max(np.abs(f), axis=1, keepdims=True))
        left, multipliers = ~(np.abs(new - multipliers) <= SETTLED * size), new
        if not np.any(left):
            break
    return acceleration, multipliers, left


def _refusal(mechanics: States, left: NDArray[np.bool_]) -> str:
    """The error message that names the joints whose reactions have not converged."""
    places = {(g, i): mechanics.model.groups[g].instances[i].item
              for g in mechanics.reactive for i in range(len(mechanics.model.groups[g].instances))}
    unsettled = [(r.group, r.instance) for r, found in zip(mechanics.rows, np.any(left, axis=0), strict=True) if found]
    names = dict.fromkeys([places[p] for p in unsettled if p in places] or list(places.values()))
    listed = ", ".join(f"'{name}'" for name in list(names)[:4])
    return (f"friction and reaction of joint {listed} find no balance: friction raises the reaction that presses it by more than "
            f"itself (self-locking); take a smaller friction coefficient or radius, another place of the joint, or for a "
            f"prismatic joint a given normal_force")
