"""Positions changed by virtual displacements, for unknowns of any numbering: rotations are composed, all others are added.

The motion of all bodies from the unknowns of a form, including joint coordinates; dynamics in joint coordinates.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from mbdae.errors import internal
from mbdae.system.base import Array
from mbdae.system.model.model import Model
from mbdae.system.model.moved_bodies import MovedBodies, slot_of
from mbdae.system.model.nodes import Node
from mbdae.system.model.numbering import Numbering, Row
from mbdae.system.model.trees import Tree
from mbdae.system.motion.constrained import least_norm, solve_constrained
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.motion.states import Solve

#: index and sign table by which the quaternion product is a matrix product: P o r = (P[FACTORS] * SIGNS) r
FACTORS = np.array([[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]])
SIGNS = np.array([[1.0, -1, -1, -1], [1, 1, -1, 1], [1, 1, 1, -1], [1, -1, 1, 1]])


class Displacements:
    """The function (q (nq,), virtual displacements (nu,)) -> displaced q (nq,). Virtual displacements correspond to the velocity
    unknowns: m and rad, those of rotations of bodies in body axes."""

    def __init__(self, numbering: Numbering) -> None:
        nb = numbering
        spatial = [n for n in nb.free if n.kind.by_quaternion and not nb.shares(n, n.kind.translations, "q")]
        P = [[nb.node_place("q", n, n.kind.translations + i) for i in range(4)] for n in spatial]
        turn = [[nb.node_place("u", n, n.kind.translations + i) - nb.nq for i in range(3)] for n in spatial]
        self._P = np.array(P, dtype=np.intp).reshape(-1, 4)
        self._turn = np.array(turn, dtype=np.intp).reshape(-1, 3)
        self._factors, self._r = self._P[:, FACTORS], np.empty((len(self._P), 4))
        self._q, self._u = np.delete(np.arange(nb.nq), self._P), np.delete(np.arange(nb.nu), self._turn)

    def __call__(self, q: Array, by: Array) -> Array:
        """Positions q (nq,) after the virtual displacements `by` (nu,), a new array."""
        out = q.copy()
        if not len(self._P):
            out += by
            return out
        out[self._q] += by[self._u]
        half = by[self._turn] / 2
        angle = np.sqrt((half * half).sum(axis=1))
        self._r[:, 0] = np.cos(angle)
        np.multiply(half, np.sinc(angle / np.pi)[:, None], out=self._r[:, 1:])
        out[self._P] = (q.take(self._factors) * SIGNS @ self._r[:, :, None])[:, :, 0]
        return out

    def units(self, scale: Array) -> Array:
        """(nu,) typical size of every displacement, from the typical sizes of the positions, scale (nq,); 1 rad for rotations by
        quaternions."""
        out = np.ones(len(self._u) + self._turn.size)
        out[self._u] = scale[self._q]
        return out


class AllBodies:
    """The motion of all nodes of a model from its unknowns (q, u, s), among which are the coordinates of recursive joints."""

    def __init__(self, model: Model, moved: MovedBodies) -> None:
        self.model, self.moved = model, moved
        self.numbering = moved.numbering(model, [], (), loaded=False)
        self.nq, self.nu = self.numbering.nq, self.numbering.nu

    def workspace(self, t: Array, q: Array, u: Array, up: Array | None = None) -> Array:
        """Workspaces (nt, width) that the kernels of the trees read, filled with t (nt,), and q, u and u' (up) of the
        unknowns."""
        nb = self.numbering
        W = nb.workspace(len(t))
        W[:, : self.nq], W[:, self.nq : self.nq + self.nu] = q, u
        if up is not None:
            W[:, nb.n + self.nq : nb.n + self.nq + self.nu] = up
        nb.fill_clock(W, t)
        return W

    def states(self, t: Array, y: Array) -> tuple[Array, Array]:
        """q (nt, nq), u (nt, nu) of all nodes from unknowns y (nt, n)."""
        if not self.moved.trees and not self.moved.sharing.nodes:
            return y[:, : self.nq], y[:, self.nq : self.nq + self.nu]
        W = self.workspace(t, y[:, : self.nq], y[:, self.nq : self.nq + self.nu])
        q, u, _ = self._motion(W, None)
        return q, u

    def accelerations(self, t: Array, q: Array, u: Array, up: Array) -> Array:
        """u' (nt, nu) of all nodes from positions q, velocities u and accelerations up of the unknowns."""
        return self._motion(self.workspace(t, q, u, up), up)[2]

    def reduced(self, q: Array, u: Array) -> tuple[Array, Array]:
        """Positions and velocities of the unknowns from those of all nodes, (nt, ...) each."""
        return q[:, self.numbering.of_positions], u[:, self.numbering.of_velocities]

    def _motion(self, W: Array, up: Array | None) -> tuple[Array, Array, Array]:
        if self.moved.ordered:
            raise internal("the bodies behind recursive joints were asked for as one function, where they are computed joint by "
                           "joint", TypeError)
        nb, model = self.numbering, self.model
        q, u, a = (np.zeros((len(W), n)) for n in (model.nq, model.nu, model.nu))
        q[:, nb.of_positions], u[:, nb.of_velocities] = W[:, : self.nq], W[:, self.nq : self.nq + self.nu]
        if up is not None:
            a[:, nb.of_velocities] = up
        out = {"q": q, "u": u, "up": a}
        self._share(out)
        for plan, trees in self.moved.plans():
            piece = plan.motion_of_all
            values = piece.kernel.values(W[:, self.moved.gather(nb, piece, trees)])
            for i, tree in enumerate(trees):
                for o, (head, j, component) in enumerate(piece.targets):
                    out[head][:, _first(tree.node(j), head) + component] = values[:, i, o]
                self._prescribed(W, tree, out)
        return q, u, a

    def _share(self, out: dict[str, Array]) -> None:
        """Set in out ("q", "u", "up" of all nodes) the displacements and rotations of nodes that share those of other nodes, or
        are fixed."""
        sharing, nodes = self.moved.sharing, {n.name: n for n in self.model.nodes}
        for turning, fixed in enumerate((sharing.fixed_position, sharing.fixed_rotation)):
            for name, value in fixed.items():
                part = _part(nodes[name], "q", turning)
                out["q"][:, part] = value[: part.stop - part.start]
        for turning, leaders in enumerate((sharing.displacement_of, sharing.rotation_of)):
            for name, leader in leaders.items():
                for head, values in out.items():
                    values[:, _part(nodes[name], head, turning)] = values[:, _part(leader, head, turning)]

    def _prescribed(self, W: Array, tree: Tree, out: dict[str, Array]) -> None:
        for _, c, _ in tree.driven:
            for order, head in enumerate(("q", "u", "up")):
                slot = self.moved.slot(self.numbering, tree, ("clock", c, order))
                out[head][:, _first(tree.node(-c), head)] = W[:, slot]

    def velocity_map(self, W: Array) -> Array:
        """T (nt, nu of all nodes, nu of the unknowns): derivatives of the velocities of all nodes by the velocity unknowns, from
        workspaces W (nt, width)."""
        nb = self.numbering
        T = np.zeros((len(W), self.model.nu, self.nu))
        T[:, nb.of_velocities, np.arange(self.nu)] = 1.0
        for plan, trees in self.moved.plans():
            for piece in plan.velocities:
                values = piece.kernel.values(W[:, self.moved.gather(nb, piece, trees)])
                for i, tree in enumerate(trees):
                    for o, ((head, j, component), place) in enumerate(piece.targets):
                        column = slot_of(nb, tree, place) - nb.nq
                        T[:, _first(tree.node(j), head) + component, column] = values[:, i, o]
        return T


def _first(node: Node, head: str) -> int:
    return node.q if head == "q" else node.u


def _part(node: Node, head: str, turning: int) -> slice:
    """Slice of a node's translations (turning = 0) or of its rotation (1) among all q (head "q") or u."""
    first, n = _first(node, head), node.kind.translations
    return slice(first + n, first + node.kind.sizes[0 if head == "q" else 1]) if turning else slice(first, first + n)


class TreeMechanics(Mechanics):
    """Mechanics of a model with recursive joints: accelerations are solved for in joint coordinates; the reactions of the
    recursive joints then follow from the balance of every body, from the leaves of the trees to the root."""

    def __init__(self, model: Model, rows: list[Row], all_bodies: AllBodies, redundant: int = 0) -> None:
        super().__init__(model, rows, redundant)
        self.all_bodies = all_bodies

    def admissible(self, t: Array, q: Array, u: Array) -> tuple[Array, Array]:
        """q (nt, nq) and u (nt, nu) with every body where the coordinates of its recursive joints place it: positions of such
        bodies in the arguments count for nothing."""
        return self.all_bodies.states(t, np.hstack(self.all_bodies.reduced(q, u)))

    def _constrained(self, t: Array, q: Array, u: Array) -> Solve:
        """u' (nt, nu) and lambda (nt, m) of all nodes and rows, those of recursive joints included."""
        e = self.all_bodies
        qr, ur = e.reduced(q, u)
        T = e.velocity_map(e.workspace(t, qr, ur))
        bias = e.accelerations(t, qr, ur, np.zeros_like(ur))
        G, gamma, M, closing = self.constraint_jacobian(t, q), self.acceleration_bias(t, q, u), self.mass, self.closing
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
            self._leaf_to_root(left - np.einsum("tij,ti->tj", G[:, closing], lam), G, multipliers)
            return acceleration, multipliers

        return solve

    @cached_property
    def closing(self) -> Any:
        """(k,) numbers of the rows of joints that are not recursive: they close loops between bodies of the trees."""
        inside = self.all_bodies.moved.replaced
        return np.array([n for n, r in enumerate(self.rows) if (r.group, r.instance) not in inside], dtype=int)

    def _leaf_to_root(self, left: Array, G: Array, multipliers: Array) -> None:
        """Solve G^T lambda = left (nt, nu) joint by joint, from the leaves to the root: the reaction of a joint balances the
        force on the body that it moves, and its opposite is added to the force left on the carrying body."""
        numbers = {(r.group, r.instance, r.row): n for n, r in enumerate(self.rows)}
        for tree in self.all_bodies.moved.trees:
            for j in range(len(tree.joints), 0, -1):
                g, i = tree.joints[j - 1]
                names = self.model.groups[g].derived.rows
                rows = [numbers[g, i, r] for r in range(len(names))]
                drives = {name: c for at, c, name in tree.driven if at == j}
                node, own = tree.node(j), [n for n, name in zip(rows, names, strict=True) if name not in drives]
                body = slice(node.u, node.u + node.kind.sizes[1])
                on_body = G[:, own, body].transpose(0, 2, 1)
                multipliers[:, own] = np.linalg.solve(on_body, left[:, body, None])[..., 0]
                left -= np.einsum("tij,ti->tj", G[:, own], multipliers[:, own])
                for row, name in zip(rows, names, strict=True):
                    if name in drives:  # the multiplier of a row that prescribes a coordinate is the force left on it
                        u = tree.node(-drives[name]).u
                        multipliers[:, row] = left[:, u] / G[:, row, u]
