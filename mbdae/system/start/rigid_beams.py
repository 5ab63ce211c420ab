"""Motions of a scene in which beams move as rigid bodies; the start closes loops by them."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.deferred import sp
from mbdae.scene.components import Body
from mbdae.symbolic.frames import NodeKind
from mbdae.system.base import Array
from mbdae.system.model.model import Model
from mbdae.system.model.nodes import Node
from mbdae.system.model.rotations import quaternion_product, rotation_matrices, rotation_of, turned

#: number of coordinates up to which the rows that give the stated velocities of bodies are full arrays; above it they are sparse
FULL = 400


class RigidMotions:
    """Coordinates of the motions in which beams are rigid: the velocities of every node that belongs to no beam (single nodes),
    and for every beam the velocity of its first node and its angular velocity, six numbers, or three in the plane."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.beams: list[list[Node]] = [line.nodes for line in model.lines]
        of_beams = {n.name for nodes in self.beams for n in nodes}
        self.single = [n for n in model.nodes if n.name not in of_beams]
        self.size = sum(n.kind.sizes[1] for n in self.single) + sum(nodes[0].kind.sizes[1] for nodes in self.beams)

    @property
    def massless(self) -> Any:
        """(size,) bool: joint coordinates, which have no mass of their own."""
        counts = [n.kind.sizes[1] for n in self.single]
        mask = np.repeat([n.body is None for n in self.single], counts)
        return np.r_[mask, np.zeros(self.size - len(mask), dtype=bool)].astype(bool)

    def given(self, q: Array) -> list[tuple[Body, Any, Any]]:
        """Bodies whose velocity the user states, each with the derivatives of the velocity of its centre of mass, (2 or 3, size),
        and of its angular velocity, (0, 1 or 3, size), by the coordinates."""
        moving: list[tuple[Node, Body | None, Array]] = [(n, n.body, np.zeros(3)) for n in self.single]
        for nodes in self.beams:
            own = nodes[0].body
            assert own is not None
            beam = own.owner
            turn = rotation_of(nodes[0].kind, q[nodes[0].q : nodes[0].q + nodes[0].kind.sizes[0]]) @ own.drawn.rotation.T
            moving.append((nodes[0], beam, turn @ (beam.drawn.position - own.drawn.position)))
        column = 0
        found: list[tuple[Body, Any, Any]] = []
        for node, body, arm in moving:
            n, end = node.kind.translations, column + node.kind.sizes[1]
            if body is not None and body.given_velocity:
                moves, turns = (self._ones(first, last) for first, last in ((column, column + n), (column + n, end)))
                spins = (np.eye(3)[[2]] if n == 2 else np.eye(3))[: end - column - n]
                arms = np.cross(spins, arm)[:, :n].T
                found.append((body, moves + (arms if isinstance(turns, np.ndarray) else sp.csr_array(arms)) @ turns, turns))
            column = end
        return found

    def _ones(self, first: int, last: int) -> Any:
        """Rows `first` to `last` of the identity matrix of this size; sparse where `size` is above FULL."""
        if self.size > FULL:
            return sp.eye_array(last - first, self.size, k=first, format="csr")
        return np.eye(last - first, self.size, k=first)

    def basis(self, q: Array) -> Array:
        """B (nu, size) at q: the velocities of all nodes are B times these coordinates. Those of beams, velocity of the first
        node and angular velocity, are in inertial axes."""
        B, column = np.zeros((self.model.nu, self.size)), 0
        for node in self.single:
            nu = node.kind.sizes[1]
            B[node.u : node.u + nu, column : column + nu] = np.eye(nu)
            column += nu
        for nodes in self.beams:
            n, nu = nodes[0].kind.translations, nodes[0].kind.sizes[1]
            spins = np.eye(3)[[2]] if n == 2 else np.eye(3)
            at, by = (np.array([[place] for place in of]) for of in ([x.q for x in nodes], [x.u for x in nodes]))
            r = np.zeros((len(nodes), 3))
            r[:, :n] = q[at + np.arange(n)]
            B[by + np.arange(n), column + np.arange(n)] = 1.0
            for j, spin in enumerate(spins, start=column + n):
                B[by + np.arange(n), j] = np.cross(spin, r - r[0])[:, :n]
            turning = rotation_matrices(q[at + np.arange(3, 7)]).transpose(0, 2, 1) if n == 3 else np.ones((len(nodes), 1, 1))
            rows, columns = by[:, :, None] + np.arange(n, nu)[:, None], column + np.arange(n, nu)
            B[rows, columns] = turning
            column += nu
        return B

    def moved(self, q: Array, x: Array, free: Array) -> Array:
        """Positions (nq,) after displacements x (size,) of the coordinates. free: positions in which single nodes are displaced
        already, so that only beams remain to be moved."""
        q, column = free.copy(), self.size - sum(nodes[0].kind.sizes[1] for nodes in self.beams)
        before = free
        for nodes in self.beams:
            n, nu = nodes[0].kind.translations, nodes[0].kind.sizes[1]
            move, turn = np.zeros(3), np.zeros(3)
            move[:n] = x[column : column + n]
            turn[3 - (nu - n) :] = x[column + n : column + nu]
            P = turned(np.array([1.0, 0, 0, 0]), turn)
            R, pivot = rotation_matrices(P), nodes[0].position(before)
            for node in nodes:
                q[node.q : node.q + n] = (pivot + move + R @ (node.position(before) - pivot))[:n]
                if node.kind is NodeKind.PLANAR:
                    q[node.q + 2] += turn[2]
                else:
                    q[node.q + 3 : node.q + 7] = quaternion_product(P, before[node.q + 3 : node.q + 7])
            column += nu
        return q
