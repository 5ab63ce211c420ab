"""Mechanics of scenes with trees: accelerations in joint coordinates, and the reactions of the joints that these satisfy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import as_full
from mbdae.kernels.tree_passes import Place, TreePasses
from mbdae.native.program import Made, Operations, narrow_order
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import jacobian_G
from mbdae.system.base import Array
from mbdae.system.model.model import Model
from mbdae.system.model.moved_bodies import MovedBodies, slot_of
from mbdae.system.model.numbering import Numbering, Row
from mbdae.system.model.trees import Tree
from mbdae.system.motion import AllBodies
from mbdae.system.motion.constrained import Evaluator, Index, least_norm, solve_constrained
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.motion.states import Solve

#: pivot of the mass matrix over the largest pivot, up to which a motion counts as having no inertia
NOTHING = 1e-13
Inertia = Mapping[tuple[int, int], float]  #: (row, column) among the velocity unknowns -> entry of the mass matrix


class _Accelerations(Evaluator):
    """Computes u' of all nodes from forces on them, which are given in the slots from `force` on. mass: (row, column) -> entry of
    the mass matrix among the velocity unknowns."""

    def __init__(self, model: Model, moved: MovedBodies, numbering: Numbering, mass: Inertia) -> None:
        super().__init__(numbering)
        self._given = model, moved, mass
        self.force, self.pivots = self.operations.slots(model.nu), list[tuple[int, int]]()

    def __reduce__(self) -> tuple[Any, ...]:
        model, moved, mass = self._given
        return _Accelerations, (model, moved, self.numbering, mass)

    def _emitted(self, part: Operations) -> Any:
        (model, moved, mass), nb = self._given, self.numbering
        rates, own, every = part.slots(nb.nu), nb.of_velocities, part.zeros(model.nu)
        left = part.zeros(model.nu)
        part.add(left + np.arange(model.nu), self.force + np.arange(model.nu), -1.0)
        part.set(rates + np.arange(nb.nu), self.force + own)
        for tree in moved.trees:
            ordered = moved.passes(nb, _bare(model, tree), inertia={
                pair: part.constant([m]) for pair, m in own_inertia(nb, tree, mass).items()})
            self.pivots += self._solve(part, ordered, tree, left, rates)
            ordered.write_motion(part, [j for j in ordered.bodies if j],
                                 lambda j, _, i, of=tree: every + of.node(j).u + i, ("up",))  # type: ignore[misc]
            driven = [(every + tree.node(-c).u, moved.slot(nb, tree, ("clock", c, 2))) for _, c, _ in tree.driven]
            part.set([to for to, _ in driven], [slot for _, slot in driven])
        rest = np.setdiff1d(np.arange(nb.nu), [k for _, k in self.pivots])
        if len(rest):
            solve_mass(part, *entries_among(mass, rest), rates + rest)
        part.set(every + own, rates + np.arange(nb.nu))
        return every + np.arange(model.nu)

    def of_forces(self, t: Array, q: Array, u: Array, f: Array) -> Array:
        """u' (nt, nu) of all nodes at q, u of the unknowns (nt, ...), for forces f (nt, nu) on all nodes."""
        return self._owner.waiting(self._of_forces, t, q, u, f)

    def _of_forces(self, t: Array, q: Array, u: Array, f: Array) -> Array:
        y, out = np.zeros((1, self.n)), np.empty_like(f)
        self.choose("accelerations", self._emitted)
        for i in range(len(t)):
            y[0, : self.numbering.nq], y[0, self.numbering.nq : self.numbering.nq + self.numbering.nu] = q[i], u[i]
            self.W[self.force : self.force + f.shape[1]] = f[i]
            out[i] = self.at_states("accelerations", self._emitted, t[i : i + 1], y)[0]
        return out

    def _solve(self, part: Operations, ordered: TreePasses, tree: Tree, left: int, rates: int) -> list[tuple[int, int]]:
        ordered.outwards(part)
        nodes = [j for j in ordered.bodies if j]
        forces = [ordered.at(j, place) for j in nodes for place in ordered.bodies[j].kernels.outward.column if place[0] == "p"]
        # the given forces contain the gyroscopic forces already, so that those which the outward pass computes are set to 0
        part.set(forces, np.full(len(forces), part.zeros(1)))
        ordered.loads(part, nodes, lambda j, i: left + tree.node(j).u + i)
        first = rates - self.numbering.nq

        def rate(place: tuple[object, ...]) -> int:
            return first + slot_of(self.numbering, tree, place)

        pivots = [(slot, rate(place) - rates) for slot, place in ordered.inwards(part, rate)]
        ordered.accelerations(part, rate)
        return pivots


def own_inertia(nb: Numbering, tree: Tree, mass: Inertia) -> dict[tuple[Place, Place], float]:
    """Entries of the mass matrix by laws outside of a tree, by pairs of its velocities. mass: (row, column) among the velocity
    unknowns -> entry."""
    nodes, moved = [(0, tree.nodes[0])] if tree.structure.root.moves else [], set(tree.moved_nodes)
    nodes += [(-c, n) for c, n in enumerate(tree.coordinates, 1) if n not in moved]
    places: dict[int, Place] = {nb.node_place("u", n, i) - nb.nq: ("u", j, i) for j, n in nodes if n is not None
                                for i in range(n.kind.sizes[1])}
    return {(places[a], places[b]): m for (a, b), m in mass.items() if a in places and b in places}


def solve_mass(part: Operations, places: tuple[Index, Index], values: Array | Made, slots: Index, once: Operations | None = None,
               entries: Index | None = None) -> tuple[Index, slice]:
    """Append the accelerations of the velocities whose forces are in `slots` (n,), into the same slots, by Cholesky of their mass
    matrix in a band. places, values (k,): rows, columns and values of its entries, or what makes the values; once: list of
    operations that factorises it when the array is made, None: it is factorised whenever the operations run; entries (k,): slots
    of terms of the entries that vary. Returns the order in which the velocities are eliminated, and the slots of the factors."""
    n, (i, j) = len(slots), places
    order, place = narrow_order(n, np.concatenate([i, j]), np.concatenate([j, i]))
    width = int(np.abs(place[i] - place[j]).max(initial=0)) + 1
    lower = place[i] >= place[j]
    cell = (place[i] * width + place[j] - place[i] + width - 1)[lower]

    def band(of: Any) -> Array:
        found = np.zeros(n * width)
        np.add.at(found, cell, (values(of) if callable(values) else values)[lower])  # type: ignore[index]
        return found

    matrix, right = part.slots(n * width), part.slots(n)
    (part if once is None else once).load(matrix, band if callable(values) else band(None))
    if entries is not None:
        part.add(matrix + cell, entries[lower])
    part.set(right + place, slots)
    if once is None:
        part.cholesky(n, width, matrix, right)
    else:
        once.cholesky(n, width, matrix, right)
        part.solve(n, width, matrix, right, 1)
    part.set(slots, right + place)
    return order, slice(matrix, matrix + n * width)


def entries_among(inertia: Inertia, some: Index) -> tuple[tuple[Index, Index], Array]:
    """Rows and columns, and values, of the entries of a mass matrix among some velocities, which are numbered anew."""
    number = {int(k): n for n, k in enumerate(some)}
    found = [(number[a], number[b], m) for (a, b), m in inertia.items() if a in number and b in number]
    i, j, m = np.array(found).reshape(-1, 3).T
    return (i.astype(np.intp), j.astype(np.intp)), m


def _bare(model: Model, tree: Tree) -> Tree:
    """A tree whose only laws are the inertias of its bodies, without forces between them."""
    kept = [k for k, (g, i) in enumerate(tree.members) if isinstance(model.groups[g].instances[i].law, Element)]
    structure = replace(tree.structure, members=tuple(tree.structure.members[k] for k in kept), loaded=())
    return replace(tree, structure=structure, members=tuple(tree.members[k] for k in kept))


class TreeMechanics(Mechanics):
    """Mechanics of a model with recursive joints: accelerations are solved for in joint coordinates; the reactions of the
    recursive joints then follow from the balance of every body, from the leaves of the trees to the root."""

    def __init__(self, model: Model, rows: list[Row], all_bodies: AllBodies, redundant: int = 0) -> None:
        super().__init__(model, rows, redundant)
        self.all_bodies, self.carries_bodies = all_bodies, all_bodies.moved.alone

    def admissible(self, t: Array, q: Array, u: Array) -> tuple[Array, Array]:
        """q (nt, nq) and u (nt, nu) with every body where the coordinates of its recursive joints place it: positions of such
        bodies in the arguments count for nothing."""
        return self.all_bodies.states(t, np.hstack(self.all_bodies.reduced(q, u)))

    def _constrained(self, t: Array, q: Array, u: Array) -> Solve:
        """u' (nt, nu) and lambda (nt, m) of all nodes and rows, those of recursive joints included."""
        e = self.all_bodies
        qr, ur = e.reduced(q, u)
        if e.moved.alone:
            return self._by_passes(t, q, qr, ur)
        if self.model.elastic:  # many velocities for few recursive joints: the rows of these are solved with all others
            return super()._constrained(t, q, u)
        T = e.velocity_map(t, qr)
        bias = e.accelerations(t, qr, ur, np.zeros_like(ur))
        G, gamma, M, closing = self.constraint_jacobian(t, q), self.acceleration_bias(t, q, u), as_full(self.mass), self.closing
        Tt, units = T.transpose(0, 2, 1), 1 / self.velocity_units[e.numbering.of_velocities]
        mass, rows = Tt @ (M @ T), G[:, closing] @ T
        right = gamma[:, closing] + np.einsum("tij,tj->ti", G[:, closing], bias)
        E = self.unique(G[:, closing], rows, 1 / units)

        def solve(f: Array, slope: Array | None) -> tuple[Array, Array]:
            # friction depends on multipliers of joints that close loops only: a joint with reaction friction is never recursive
            inner = None if slope is None else slope[:, :, closing]
            reduced = mass, np.einsum("tij,tj->ti", Tt, f - bias @ M), rows, right, units
            ud, lam = solve_constrained(*reduced, None if inner is None else Tt @ inner, E)
            acceleration = np.einsum("tij,tj->ti", T, ud) + bias
            # G^T lambda, the sum of all reactions, once the friction that depends on lambda is added to f
            left = f - acceleration @ M
            if inner is not None:
                left += np.einsum("tij,tj->ti", inner, lam)
            if self.redundant:
                return acceleration, least_norm(G * self.velocity_units, left * self.velocity_units)
            multipliers = np.zeros((len(t), self.m))
            multipliers[:, closing] = lam
            self._leaf_to_root(t, q, left - np.einsum("tij,ti->tj", G[:, closing], lam), multipliers)
            return acceleration, multipliers

        return solve

    @cached_property
    def closing(self) -> NDArray[np.intp]:
        """(k,) numbers of the rows of joints that are not recursive: they close loops between bodies of the trees."""
        inside = self.all_bodies.moved.replaced
        return np.array([n for n, r in enumerate(self.rows) if (r.group, r.instance) not in inside], dtype=int)

    def _by_passes(self, t: Array, q: Array, qr: Array, ur: Array) -> Solve:
        """As `_constrained`, where all rows belong to trees evaluated joint by joint: without any matrix of all bodies."""

        def solve(f: Array, slope: Array | None) -> tuple[Array, Array]:
            acceleration, multipliers = self._passes.of_forces(t, qr, ur, f), np.zeros((len(t), self.m))
            self._leaf_to_root(t, q, f - acceleration @ self.mass, multipliers)
            return acceleration, multipliers

        return solve

    @cached_property
    def _passes(self) -> _Accelerations:
        e = self.all_bodies
        number = {int(k): i for i, k in enumerate(e.numbering.of_velocities)}
        mass = {(number[a], number[b]): m for (a, b), m in self.inertia.items() if a in number and b in number}
        return _Accelerations(self.model, e.moved, e.numbering, mass)

    def without_inertia(self, t: Array, q: Array) -> list[int]:
        """Numbers, among the velocity unknowns, of those that have no inertia at positions q (nq,)."""
        zero, solver = np.zeros((1, self.nu)), self._passes
        solver.of_forces(t, *self.all_bodies.reduced(q[None], zero), zero)
        pivots = np.array([solver.W[slot] for slot, _ in solver.pivots])
        lost = np.flatnonzero(~(pivots > NOTHING * float(np.max(pivots, initial=0.0))))
        return [solver.pivots[i][1] for i in lost]

    def _leaf_to_root(self, t: Array, q: Array, left: Array, multipliers: Array) -> None:
        """Solve G^T lambda = left (nt, nu) joint by joint, from the leaves to the root: the reaction of a joint balances the
        force on the body that it moves, and its opposite is added to the force left on the carrying body. The entries of G are
        those of one joint at a time, never the whole matrix."""
        entries = {g: (p.targets, values) for g, p, values in self.evaluate(jacobian_G, t, q, np.zeros((len(t), self.nu)))}
        numbers = {(r.group, r.instance, r.row): n for n, r in enumerate(self.rows)}
        for tree in self.all_bodies.moved.trees:
            drives = {(at, name): c for at, c, name in tree.driven}
            for j in range(len(tree.joints), 0, -1):
                g, i = tree.joints[j - 1]
                names = self.model.groups[g].derived.rows
                if not names:
                    continue
                targets, values = entries[g]
                columns = [self.numbering.velocity(("u", *target[2:]), g, i) for target in targets]
                G = {(target[1], columns[o]): values[:, i, o] for o, target in enumerate(targets)}
                rows, driven = {r: numbers[g, i, r] for r in range(len(names))}, {r: (j, name) for r, name in enumerate(names)}
                self._one(tree, j, rows, G, {r: drives[key] for r, key in driven.items() if key in drives}, left, multipliers)

    def _one(self, tree: Tree, j: int, rows: dict[int, int], G: dict[tuple[int, int], Array], drives: dict[int, int],
             left: Array, multipliers: Array) -> None:
        """Compute the multipliers of joint j of a tree. rows: row of the law -> number of its multiplier; G: (row of the law,
        velocity) -> entries (nt,); drives: row of the law that prescribes a coordinate -> number of this coordinate in the
        tree."""
        node, own = tree.node(j), [r for r in rows if r not in drives]
        at, zero = range(node.u, node.u + node.kind.sizes[1]), np.zeros(len(left))
        on_body = np.array([[G.get((r, k), zero) for r in own] for k in at]).transpose(2, 0, 1)
        found = np.linalg.solve(on_body, left[:, at.start : at.stop, None])[..., 0] if own else np.zeros((len(left), 0))
        multipliers[:, [rows[r] for r in own]] = found
        force = dict(zip(own, found.T, strict=True))
        for (r, k), value in G.items():
            if r in force:
                left[:, k] -= value * force[r]
        for r, c in drives.items():  # the multiplier of a row that prescribes a coordinate is the force left on it
            u = tree.node(-c).u
            multipliers[:, rows[r]] = left[:, u] / G[r, u]
