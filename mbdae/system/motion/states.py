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

from mbdae.deferred import sp
from mbdae.errors import SolverError
from mbdae.kernels.plan import Outputs, plan
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Force
from mbdae.symbolic.outputs import Target, acceleration, jacobian_G, position, slopes, velocity
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.model.model import Model
from mbdae.system.model.nodes import Node, quaternion_product, turned
from mbdae.system.model.numbering import Numbering, Row

Index = NDArray[np.intp]
AT_ONCE = 4_000_000  #: count of numbers in the workspaces of all states that are evaluated together, which bounds the memory


def blocks(count: int, width: int) -> list[slice]:
    """Slices that divide `count` states with workspaces of `width` numbers into parts of at most AT_ONCE numbers."""
    size = max(1, AT_ONCE // max(width, 1))
    return [slice(first, min(first + size, count)) for first in range(0, count, size)] or [slice(0, 0)]


class States:
    """Evaluates a model at nt states: t (nt,), q (nt, nq) and u (nt, nu) of all nodes, internal states s (nt, ns). rows: the
    constraint rows in force; redundant: how many of them follow from the others (which of them, depends on the position)."""

    def __init__(self, model: Model, rows: list[Row], redundant: int = 0) -> None:
        self.model, self.rows, self.redundant = model, rows, redundant
        self.numbering = Numbering(model, rows, ("lambda",))
        self.nq, self.nu, self.m = model.nq, model.nu, len(rows)
        self._in_G: dict[int, tuple[Index, Index, Index]] = {}
        self._plans: dict[tuple[Outputs, int], tuple[Any, Index]] = {}
        self._of_row: dict[tuple[int, int], Index] = {}

    @cached_property
    def reactive(self) -> list[int]:
        """Numbers of the groups of joints whose friction depends on their own reactions."""
        return [g for g, group in enumerate(self.model.groups) if group.derived.reactive]

    @cached_property
    def followed(self) -> dict[tuple[str, str], int]:
        """(joint, coordinate) -> number of the internal state that follows this angle beyond whole turns, where there is one."""
        found = {}
        for n, (g, i, j) in enumerate(self.numbering.states):
            group = self.model.groups[g]
            if group.derived.states[j] == group.instances[i].law.follows:
                found[group.instances[i].item, group.instances[i].law.name_of_coordinate] = n
        return found

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
                 ) -> list[tuple[int, Any, Array]]:
        """Evaluate outputs of the laws. Returns (group, plan, values (nt, instances, outputs)) for every group whose laws have
        such outputs. outputs: selects them; groups: numbers of the groups, None: all."""
        parts = blocks(len(t), self.numbering.width)
        if len(parts) > 1:
            found = [self.evaluate(outputs, t[part], q[part], u[part], None if s is None else s[part],
                                   None if multipliers is None else multipliers[part], groups) for part in parts]
            return [(g, p, np.concatenate([of[k][2] for of in found])) for k, (g, p, _) in enumerate(found[0])]
        W = self.workspace(t, q, u, s, multipliers)
        chosen = range(len(self.model.groups)) if groups is None else groups
        planned = ((g, *self._planned(outputs, g)) for g in chosen)
        return [(g, p, p.kernel.values(W[:, columns])) for g, p, columns in planned if p.targets]

    def _planned(self, outputs: Outputs, g: int) -> tuple[Any, Index]:
        """The plan of these outputs for group g, and the slots (instances, inputs) of the workspace that it reads."""
        if (outputs, g) not in self._plans:
            p = plan(self.model.groups[g].derived, outputs)
            self._plans[outputs, g] = p, self.numbering.gather(g, p.all_inputs)
        return self._plans[outputs, g]

    def workspace(self, t: Array, q: Array, u: Array, s: Array | None, multipliers: Array | None) -> Array:
        """(nt, width) workspaces of all states, which the kernels read."""
        nb = self.numbering
        W = nb.workspace(len(t))
        W[:, : self.nq], W[:, self.nq : self.nq + self.nu] = q, u
        if s is not None:
            W[:, nb.start["s"] : nb.start["s"] + len(nb.states)] = s
        if multipliers is not None:
            # laws read multipliers of scaled rows, which are the unknowns of the forms
            W[:, nb.start["lambda"] : nb.start["lambda"] + self.m] = multipliers / nb.scaling()
        nb.fill_clock(W, t)
        return W

    def constraint_jacobian(self, t: Array, q: Array) -> Array:
        """Constraint Jacobian G (nt, m, nu)."""
        G = np.zeros((len(t), self.m, self.nu))
        for values, rows, columns in self._entries_of_G(t, q):
            places: Any = slice(None), rows, columns
            np.add.at(G, places, values)
        return G

    def sparse_constraint_jacobian(self, t: Array, q: Array) -> list[sp.csr_matrix]:
        """Constraint Jacobian G (m, nu) of every state, sparse."""
        values, rows, columns = self.entries_of_G(t, q)
        return [sp.csr_matrix((of_state, (rows, columns)), shape=(self.m, self.nu)) for of_state in values]

    def entries_of_G(self, t: Array, q: Array) -> tuple[Array, Index, Index]:
        """Values (nt, k) of entries of G with their rows and columns (k,); values of the same entry have to be summed."""
        parts = self._entries_of_G(t, q)
        rows, columns = (np.concatenate([np.zeros(0, np.intp), *(part[i] for part in parts)]) for i in (1, 2))
        return np.concatenate([np.zeros((len(t), 0)), *(part[0] for part in parts)], axis=1), rows, columns

    def _entries_of_G(self, t: Array, q: Array) -> list[tuple[Array, Index, Index]]:
        """Values (nt, k) of the entries of G, group by group, with their rows and columns (k,)."""
        found = []
        for g, p, values in self.evaluate(jacobian_G, t, q, np.zeros((len(t), self.nu))):
            taken, rows, columns = self._places_in_G(g, p)
            found.append((values.reshape(len(t), -1)[:, taken], rows, columns))
        return found

    def rows_without_slope(self, t: Array, q: Array) -> Any:
        """(m,) bool: which rows have no finite derivative, an entry of G being infinite or NaN, at positions q (nq,)."""
        found = np.zeros(self.m, dtype=bool)
        for g, p, values in self.evaluate(jacobian_G, t, q[None], np.zeros((1, self.nu))):
            taken, rows, _ = self._places_in_G(g, p)
            np.logical_or.at(found, rows, ~np.isfinite(values.reshape(-1)[taken]))
        return found

    def _places_in_G(self, g: int, p: Any) -> tuple[Index, Index, Index]:
        """Which of the values (instances times outputs, flat) of plan p of group g belong to rows in force, and their rows and
        columns in G."""
        if g not in self._in_G:
            nb = self.numbering
            rows = np.stack([self._rows_of(g, target[1]) for target in p.targets], axis=1).ravel()
            columns = np.stack([nb.velocities(("u", *target[2:]), g) for target in p.targets], axis=1).ravel()
            taken = np.flatnonzero(rows >= 0)
            self._in_G[g] = taken, rows[taken], columns[taken]
        return self._in_G[g]

    def _rows(self, outputs: Outputs, t: Array, q: Array, u: Array) -> Array:
        out = np.zeros((len(t), self.m))
        for g, p, values in self.evaluate(outputs, t, q, u):
            for o, target in enumerate(p.targets):
                rows = self._rows_of(g, target[1])
                kept = rows >= 0
                out[:, rows[kept]] = values[:, kept, o]
        return out

    def _rows_of(self, g: int, r: int) -> Index:
        """(instances,) numbers among the rows in force of row r of the laws of group g, -1 for none; stored for later calls."""
        key = g, r
        if key not in self._of_row:
            self._of_row[key] = self.numbering.row_numbers(g, r)
        return self._of_row[key]

    def of_states(self, outputs: Outputs, t: Array, q: Array, u: Array, s: Array | None = None) -> Array:
        """Values (nt, ns) of outputs that belong to the internal states, such as their start values or rates."""
        nb = self.numbering
        out = np.zeros((len(t), len(nb.states)))
        for g, p, values in self.evaluate(outputs, t, q, u, s):
            for o, target in enumerate(p.targets):
                out[:, nb.places(target, g) - nb.start["s"]] = values[:, :, o]
        return out

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
    nb, scaling = mechanics.numbering, mechanics.numbering.scaling()
    R, slope = np.zeros((len(multipliers), mechanics.nu)), np.zeros((len(multipliers), mechanics.nu, mechanics.m))
    for g, p, values in mechanics.evaluate(slopes, *state, multipliers, groups=mechanics.reactive):
        for i in range(values.shape[1]):
            for o, target in enumerate(p.targets):
                at = nb.velocity(target, g, i)
                if target[0] != "slope":
                    R[:, at] -= values[:, i, o]
                    continue
                row = nb.row(g, i, target[3])
                if row is not None:
                    slope[:, at, row] -= values[:, i, o] / scaling[row]
    return R, slope


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
