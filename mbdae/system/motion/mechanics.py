"""The mechanics of a model, independent of forms: masses, forces, accelerations and multipliers at given states, many at once.

Effective masses of impacts: the inertia that a contact force accelerates, along the directions in which it may act.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mbdae.deferred import issparse, later, sp, splu
from mbdae.kernels.plan import linearised_plan
from mbdae.native.program import Operations
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Element, Force
from mbdae.symbolic.outputs import Target, acceleration, dynamics, loads, scatter_pair
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.model.numbering import Numbering
from mbdae.system.motion.constrained import FixedPattern, row_lengths, solve_constrained, unique_multipliers
from mbdae.system.motion.states import Solve, States, solve_with_friction
from mbdae.threads import one_thread

if TYPE_CHECKING:
    from mbdae.system.model.beams import ElementBatch, batches
else:
    (batches,) = later("mbdae.system.model.beams", "batches")

AT_ONCE = 100  #: number of rows whose `mobility` is computed together in large scenes with beams, which bounds the memory
LARGE = 400  #: number of velocities above which mass matrix and constraint Jacobian are stored as sparse matrices
TOGETHER = 200  #: number of states whose entries of sparse matrices are stored together, which bounds the memory


def _inertia(d: Derived) -> Any:
    return dynamics(d) if isinstance(d.law, Element) else []


class Mechanics(States):
    """Masses, forces, accelerations and multipliers of a model at given states (positions and velocities of all nodes)."""

    #: whether every constraint row belongs to a recursive joint of a large tree, so that trees carry all jointed bodies
    carries_bodies: bool = False

    @cached_property
    def sparse(self) -> bool:
        """Whether the equations for u' and lambda are solved with sparse matrices: with elastic bodies, and for many bodies."""
        return self.model.elastic or self.large

    @property
    def large(self) -> bool:
        """Whether there are so many velocities that mass matrix and constraint Jacobian are stored as sparse matrices."""
        return self.nu > LARGE

    def constraint_matrix(self, t: Array, q: Array) -> Any:
        """Constraint Jacobian G (m, nu) at one state t (1,), q (nq,); a sparse matrix where `large`."""
        if self.large:
            return self.sparse_constraint_jacobian(t, q[None])[0]
        return self.constraint_jacobian(t, q[None])[0]

    def closing_matrix(self, t: Array, q: Array) -> Any:
        """Derivatives (m, nu) of the constraints of positions, as `constraint_matrix`; rows of velocities are 0."""
        G, kept = self.constraint_matrix(t, q), np.array([not row.by_rates for row in self.rows], dtype=float)
        return G if kept.all() else sp.diags(kept) @ G if self.large else G * kept[:, None]

    @cached_property
    def mass(self) -> Any:
        """Mass matrix (nu, nu). It is constant because velocities are those of centres of mass, and angular velocities are in
        body axes; a sparse matrix where `large`."""
        parts = [self._entries_of_mass, *(line.mass for line in self.model.lines)]
        values, rows, columns = (np.concatenate(part) for part in zip(*parts, strict=True))
        if self.large:
            return sp.csc_matrix((values, (rows, columns)), shape=(self.nu, self.nu))
        M = np.zeros((self.nu, self.nu))
        np.add.at(M, (rows, columns), values)
        return M

    @cached_property
    def inertia(self) -> dict[tuple[int, int], float]:
        """(row, column) -> entry of the mass matrix of everything but beams."""
        found: dict[tuple[int, int], float] = {}
        for value, *place in zip(*(part.tolist() for part in self._entries_of_mass), strict=True):
            found[place[0], place[1]] = found.get((place[0], place[1]), 0.0) + value
        return found

    @cached_property
    def _entries_of_mass(self) -> tuple[Array, Any, Any]:
        """Values, rows and columns of entries of the mass matrix of everything but beams; entries of equal place have to be
        summed."""
        if "mass" not in self._plans:
            found: list[tuple[int, Any, list[int]]] = []
            places: list[tuple[Any, Any]] = []
            for g, group in enumerate(self.model.groups):
                p = linearised_plan(group.derived, _inertia)
                at = [(k, row, target) for k, (row, target) in enumerate(p.constant_places) if target[0] == "up"]
                of = self.numbering.velocities
                places += [(of(p.targets[row], g), of(target, g)) for _, row, target in at]
                found += [(g, p, [k for k, *_ in at])] if at else []
            rows, columns = (np.concatenate([np.zeros(0), *parts]).astype(np.intp) for parts in zip(*places, strict=True)
                             ) if places else (np.zeros(0, dtype=np.intp),) * 2
            self._plans["mass"] = found, rows, columns
        found, rows, columns = self._plans["mass"]
        values = [np.zeros(0), *(self.numbering.constants(g, p)[:, at].T.ravel() for g, p, at in found)]
        return np.concatenate(values), rows, columns

    @cached_property
    def weight(self) -> Any:
        """The mass matrix plus a millionth of its largest entries (of translations and of rotations) on the diagonal, so that it
        is positive definite; it measures the size of displacements in projections."""
        M, rotational = self.mass, self.rotational
        d = M.diagonal()
        floor = np.where(rotational, _largest(d[rotational], self.model.length**2), _largest(d[~rotational], 1.0))
        return M + (sp.diags(1e-6 * floor, format="csc") if self.large else np.diag(1e-6 * floor))

    def mobility(self, G: Any) -> Array:
        """(m,) for every row g of G (m, nu), sparse or not: the velocity g u that a unit impulse along g causes, the inverse of
        an effective mass, of bodies without their joints. `weight` is the mass matrix."""
        if not self.large:
            return np.asarray(np.einsum("ij,ji->i", G, np.linalg.solve(self.weight, G.T)))
        if not self.model.lines:  # the mass matrix consists of blocks of single bodies, which are inverted once
            G = sp.csr_matrix(G)
            return np.asarray((G @ self._inverse_weight).multiply(G).sum(axis=1))[:, 0]
        factors, parts = splu(self.weight), [np.zeros(0)]
        for first in range(0, G.shape[0], AT_ONCE):
            rows = G[first : first + AT_ONCE]
            rows = rows.toarray() if issparse(rows) else rows
            parts.append(np.einsum("ij,ji->i", rows, factors.solve(rows.T.copy())))
        return np.concatenate(parts)

    @cached_property
    def _inverse_weight(self) -> Any:
        """Inverse (nu, nu) of `weight` in scenes of rigid bodies, computed node by node because `weight` couples none."""
        parts = []
        for _, _, by in self._kinds:
            rows, columns = np.broadcast_arrays(by[:, :, None], by[:, None, :])
            blocks = np.asarray(self.weight.tocsr()[rows.ravel(), columns.ravel()]).reshape(rows.shape)
            parts.append((np.linalg.inv(blocks).ravel(), rows.ravel(), columns.ravel()))
        values, rows, columns = (np.concatenate(part) for part in zip(*parts, strict=True))
        return sp.csr_matrix((values, (rows, columns)), shape=(self.nu, self.nu))

    def mobility_with_joints(self, t: float, q: Array, rows: Array) -> Array:
        """(k,) for every row g of rows (k, nu): the velocity g u that a unit impulse along g causes at positions q (nq,), with
        the constraints in force."""
        if self.sparse:
            return self._sparse_mobility(t, q, rows)
        impulses = np.vstack([rows, np.zeros((1, self.nu))])  # subtracting the last result, without impulse, removes gamma
        with one_thread():
            solve = self._constrained(np.full(len(impulses), t), np.tile(q, (len(impulses), 1)), np.zeros(impulses.shape))
            moved = solve(impulses, None)[0]
        return np.asarray(np.einsum("ij,ij->i", rows, moved[:-1] - moved[-1]))

    def _sparse_mobility(self, t: float, q: Array, rows: Array) -> Array:
        """The result of `mobility_with_joints`, by one factorisation of sparse matrices."""
        G, places, give = self._entries_and_give(np.array([t]), q[None])
        found = FixedPattern(self.mass, self.m, *places, None)
        solve = found.at(found.values(G, None)[0], give[0], self.redundant > 0)
        return np.array([row @ solve(np.r_[row, np.zeros(self.m)])[: self.nu] for row in rows])

    def load(self, t: Array, q: Array, u: Array, s: Array | None = None, z: Array | None = None) -> Array:
        """f (nt, nu) of M u' + G^T lambda = f: all forces but those of constraints and of friction that depends on lambda. s:
        internal states; z (nt, nz): stresses of the beams, None: those that follow from the strains (with stiff beams a small
        error of the positions is then a large error of the forces)."""

        def emitted(part: Operations) -> Any:
            first = self.added(part, loads, self.nu, self.in_velocities, -1.0)
            for line in self.model.lines:
                part.add(first[line.places("u").ravel()], part.constant(line.dead) + np.arange(line.dead.size))
            for batch in self._batches[z is not None]:
                self._add_batch(part, batch, first)
            return first

        return self.at_states(("load", z is not None), emitted, t, q, u, s, None, z)

    @cached_property
    def _batches(self) -> dict[bool, list[ElementBatch]]:
        return {mixed: batches(self.model.lines, mixed) if self.model.lines else [] for mixed in (False, True)}

    def _add_batch(self, part: Operations, batch: ElementBatch, first: Any) -> None:
        """Append the forces of elements on their nodes; first (nu,): the slots to which they are added."""
        momentum = [(o, a, i) for o, (head, a, i) in enumerate((*t, 0)[:3] for t in batch.kernel.targets) if head == "u"]
        at = np.array([[e[a].u + i for _, a, i in momentum] for e in batch.nodes], dtype=np.intp)
        values = batch.kernel.emit(part, inputs_of(batch, self.numbering))[:, [o for o, _, _ in momentum]]
        part.add(first[at], values, -1.0)

    def elastic_force(self, q: Array) -> Array:
        """Internal elastic forces (nu,) of the beams at positions q (nq,)."""
        return np.asarray(self._of_elements(False, np.zeros(1), q[None], np.zeros((1, self.nu)))[0])

    def power_of_loads(self, t: Array, q: Array, u: Array) -> Array:
        """Power (nt,) of follower loads and time-dependent loads on beams, W."""
        return np.asarray(np.einsum("ti,ti->t", self._of_elements(True, t, q, u), u))

    def _of_elements(self, loads: bool, t: Array, q: Array, u: Array) -> Array:
        """Forces (nt, nu) on the nodes of beams; loads: True for those of `Line.loads`, False for those of elements."""

        def emitted(part: Operations) -> Any:
            first = part.zeros(self.nu) + np.arange(self.nu)
            for batch in self._batches[False]:
                if batch.is_load is loads:
                    self._add_batch(part, batch, first)
            return first

        return self.at_states(("elements", loads), emitted, t, q, u)

    def accelerations(self, t: Array, q: Array, u: Array, s: Array | None = None,
                      z: Array | None = None) -> tuple[Array, Array]:
        """u' (nt, nu) and lambda (nt, m) from M u' + G^T lambda = f, G u' = -gamma; where lambda is not unique, the one of least
        norm, see `unique_multipliers`. s, z: as in `load`.

        With friction that follows from reactions f depends on lambda: see `reaction_friction.py`."""
        f = self.load(t, q, u, s, z)
        with one_thread():
            solve = self._constrained(t, q, u)
            return solve_with_friction(self, (t, q, u, s), f, solve) if self.reactive and self.m else solve(f, None)

    def admissible(self, t: Array, q: Array, u: Array) -> tuple[Array, Array]:
        """q (nt, nq) and u (nt, nu) changed to values at which `accelerations` is defined. Here these are all values; with
        recursive joints the bodies have to be where the joints place them."""
        return q, u

    def _constrained(self, t: Array, q: Array, u: Array) -> Solve:
        """The function that solves the linear equations for u' and lambda at these states, see `reaction_friction.Solve`."""
        if self.sparse:
            return self._sparse(t, q, u)
        if not self.m:
            return lambda f, _: (np.linalg.lstsq(self.mass, f.T, rcond=1e-13)[0].T, np.zeros((len(t), 0)))
        G, gamma = self.constraints_of_rates(t, q, u)
        E = self.unique(G)
        return lambda f, slope: solve_constrained(self.mass, f, G, gamma, 1 / self.velocity_units, slope, E)

    def sparse_constraint_jacobian(self, t: Array, q: Array) -> list[sp.csr_matrix]:
        """Constraint Jacobian G (m, nu) of every state, sparse."""
        values, rows, columns = self.entries_of_G(t, q)
        return [sp.csr_matrix((of_state, (rows, columns)), shape=(self.m, self.nu)) for of_state in values]

    def constraints_of_rates(self, t: Array, q: Array, u: Array) -> tuple[Array, Array]:
        """G (nt, m, nu) and gamma (nt, m), by one evaluation: d2g/dt2 = G u' + gamma."""
        def both(part: Operations) -> Any:
            return np.concatenate([self.emitted_G(part), self.added(part, acceleration, self.m, self.in_rows)])

        found = self.at_states("rates", both, t, q, u)
        return self.full_of_G(found[:, : -self.m]), found[:, -self.m :]

    def unique(self, G: Array, rows: Array | None = None, units: Any = 1.0) -> Array | None:
        """E (nt, m, m) of `unique_multipliers` for G (nt, m, nu), or None where no rows are redundant. rows (nt, m, n): these
        rows in joint coordinates, where these are the unknowns; units (n,): unit displacements of these."""
        if not self.redundant:
            return None
        mass = float(np.max(self.mass.diagonal() * self.velocity_units**2))
        B = G * self.velocity_units
        return unique_multipliers(B if rows is None else rows * units, self.redundant, mass, np.linalg.norm(B, axis=2))

    def _sparse(self, t: Array, q: Array, u: Array) -> Solve:
        """The function that solves the linear equations for u' and lambda at these states with sparse matrices of one pattern."""
        gamma = self.acceleration_bias(t, q, u)
        G, places, give = self._entries_and_give(t, q)

        def solve(f: Array, slope: Array | None) -> tuple[Array, Array]:
            found = FixedPattern(self.mass, self.m, *places, slope)
            out, right = np.empty((len(t), self.nu + self.m)), np.hstack([f, -gamma])
            for first in range(0, len(t), TOGETHER):
                some = slice(first, first + TOGETHER)
                values = found.values(G[some], None if slope is None else slope[some])
                for i, of_state in enumerate(values, start=first):
                    out[i] = found.at(of_state, give[i], self.redundant > 0)(right[i])
            return out[:, : self.nu], out[:, self.nu :]

        return solve

    def _entries_and_give(self, t: Array, q: Array) -> tuple[Array, tuple[Any, Any], Array]:
        """Entries (nt, k) of G, their rows and columns (k,), and of every row the number `give` (nt, m) of `FixedPattern.at`."""
        G, rows, columns = self.entries_of_G(t, q)
        mass = float(np.max(self.mass.diagonal() * self.velocity_units**2))
        give = np.zeros((len(t), self.m))
        at: Any = slice(None), rows
        np.add.at(give, at, (G * self.velocity_units[columns]) ** 2 / mass)
        give[give == 0] = 1 / mass
        return G, (rows, columns), give


def inputs_of(batch: ElementBatch, nb: Numbering) -> Any:
    """(elements, inputs) slots that a kernel over elements of beams reads."""
    timed = iter([nb.slot(-1, *place) for place in batch.timed])
    columns = [nb.start["z"] + batch.stresses[:, t[1]] if t[0] == "z" else np.full(len(batch.nodes), next(timed)) if t[0] == "p"
               else [nb.node_place(t[0], nodes[t[1]], t[2]) for nodes in batch.nodes] for t in batch.kernel.inputs]
    return np.stack(columns, axis=1)


def in_units(mechanics: States, G: Any) -> Any:
    """G (m, nu), sparse or not, with its columns multiplied by unit displacements: the scene's length, 1 rad."""
    return G @ sp.diags(mechanics.velocity_units) if issparse(G) else G * mechanics.velocity_units


def row_sizes(mechanics: Mechanics, t: float, q: Array) -> Array:
    """Sizes (m,) of constraint rows, to which their violations are related: how much a displacement by the scene's length, or a
    rotation by 1 rad, changes each row at t (s), q (nq,); bounded by the scene's length (rows in m) and 1 (rows in rad)."""
    least, most = sorted((mechanics.model.length, 1.0))
    B = in_units(mechanics, mechanics.constraint_matrix(np.array([t]), q))
    return np.asarray(np.clip(row_lengths(B)[:, 0], least, most))


def _largest(values: Array, otherwise: float) -> float:
    largest = float(np.max(values, initial=0.0))
    return largest if largest > 0 else otherwise


InstanceNumber = tuple[int, int]  #: numbers of the group and the instance of a law


def approach_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Derivatives, by virtual displacements, of the relative displacements along which the force of a contact may act."""
    if not isinstance(d.law, Force):
        return []
    out: list[tuple[Target, Expr]] = []
    for i, e in enumerate(d.law.approach(*d.sides)):
        for f in d.frames:
            move, turn = d.variation.gradient(f, d.variation.name(e))
            pair = tuple(type(part)(*map(d.variation.resolve, part)) for part in (move, turn))
            out += [(("A", i, *t[1:]), entry) for t, entry in scatter_pair(f, pair)]  # type: ignore[arg-type]
    return out


def approaches(mechanics: Mechanics, t: float, q: Array,
               of: Collection[InstanceNumber] | None = None) -> dict[InstanceNumber, Array]:
    """For every contact law, or those of `of` alone, the rows (directions, nu) at positions q (nq,): rows @ u are the rates of
    the relative displacements along which its force may act."""
    found = {}
    for g, p, values in mechanics.evaluate(approach_outputs, np.array([t]), q[None], np.zeros((1, mechanics.nu))):
        for i in (i for i in range(len(mechanics.model.groups[g].instances)) if of is None or (g, i) in of):
            rows = np.zeros((1 + max(target[1] for target in p.targets), mechanics.nu))
            for o, (_, r, side, column) in enumerate(p.targets):
                rows[r, mechanics.numbering.velocity(("u", side, column), g, i)] += values[0, i, o]
            found[g, i] = rows[np.any(rows != 0, axis=1)]
    return found


def effective_masses(mechanics: Mechanics, t: float, q: Array, with_joints: bool, rows: Sequence[Array]) -> list[float]:
    """Effective masses (kg or kg m^2) of contacts at positions q (nq,), of each the smallest of its directions; infinite where
    nothing can move. rows: of each contact those of `approaches`; with_joints: whether joints tie further inertia to the bodies
    in contact."""
    together = np.concatenate(rows)
    mobility = mechanics.mobility_with_joints(t, q, together) if with_joints else mechanics.mobility(together)
    parts = np.split(mobility, np.cumsum([len(part) for part in rows])[:-1])
    largest = [float(np.max(part, initial=0.0)) for part in parts]
    return [1 / value if value > 0 else np.inf for value in largest]
