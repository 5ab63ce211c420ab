"""Motions of a scene in which beams move as rigid bodies; the start closes loops by them.

A start with bent beams, where no rigid motion of the beams closes the loops or follows the prescribed motions.

Loops of beams may be drawn or driven so that they close only if beams bend, such as a four-bar with one hinge that is not
parallel to the others. Positions are then those of least elastic energy, and velocities minimise the same quadratic form of the
stiffness, as in a quasi-static motion. Rigid motions cost no elastic energy: a small weight on the inertia makes them unique.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mbdae.deferred import sp
from mbdae.scene.components import Body
from mbdae.symbolic.frames import NodeKind
from mbdae.system.base import Array
from mbdae.system.changes import cheapest, largest_violation
from mbdae.system.model.model import Model
from mbdae.system.model.nodes import Node, quaternion_product, rotation_matrices, rotation_of, turned
from mbdae.system.motion.mechanics import Mechanics, in_units

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


#: assumed ratio of the motion's frequency to the lowest bending frequency. Its square weighs the inertia against the stiffness
SLOW = 0.01
STEPS = 50
#: size of a step of Newton's method (rad, or over the scene's length) up to which it has converged, if the loops are closed too
CONVERGED = 1e-9


def can_bend(mechanics: Mechanics) -> bool:
    """Whether a scene has beams and none of their strains is rigid."""
    lines = mechanics.model.lines
    return bool(lines) and not any(line.beam.section.rigid for line in lines)


class Bending:
    """Of a scene with beams at positions q (nq,): stiffness matrix, elastic forces, and mass matrix times a small weight."""

    def __init__(self, mechanics: Mechanics, q: Array) -> None:
        self.units = mechanics.velocity_units
        self.inertia = SLOW**2 * _lowest(mechanics) * sp.csc_matrix(mechanics.weight)
        self.weight = stiffness(mechanics, q) + self.inertia
        self.force = mechanics.elastic_force(q)

    def least(self, A: Array, right: Array, pull: Array) -> Array:
        """Displacement x (nu,) with A x = right (m,) that minimises x^T W x / 2 - pull^T x, where W is stiffness plus weighted
        inertia; A (m, nu) may have redundant rows."""
        return cheapest(self.weight, self.units, A, right, pull)


def stiffness(mechanics: Mechanics, q: Array) -> sp.csc_matrix:
    """Stiffness matrix (nu, nu) of all beams at positions q (nq,), per virtual displacement."""
    parts: list[Any] = []
    for line in mechanics.model.lines:
        K = line.stiffness(q)
        at = line.places("u").reshape(len(K), -1)
        a, b = np.broadcast_arrays(at[:, :, None], at[:, None, :])
        parts.append((((K + K.transpose(0, 2, 1)) / 2).ravel(), a.ravel(), b.ravel()))
    values, rows, columns = (np.concatenate(of) for of in zip(*parts, strict=True))
    return sp.csc_matrix((values, (rows, columns)), shape=(mechanics.nu,) * 2)


def closed_by_bending(mechanics: Mechanics, q: Array, closure: Callable[[Array], Array], jacobian: Callable[[Array], Array],
           within: float) -> Array | None:
    """Positions (nq,) of least elastic energy that satisfy closure(q) = 0 (m,), found by Newton's method from q; None where it
    fails. jacobian(q) (m, nu): derivative of closure by displacements; within: largest violation, over the scene's length or
    rad."""
    for _ in range(STEPS):
        bending, A, g = Bending(mechanics, q), jacobian(q), closure(q)
        off = largest_violation(g, in_units(mechanics, A))
        x = bending.least(A, -g, bending.force)
        step = float(np.max(np.abs(x) / mechanics.velocity_units))
        if off <= within and step <= CONVERGED:
            return q
        factor = min(1.0, 0.5 / max(step, 1e-300))
        while factor > 1e-4:
            moved = mechanics.integrate_positions(q, factor * x)
            if largest_violation(closure(moved), in_units(mechanics, A)) < max(off, within) * (1 + 1e-9) or off <= 1e-6:
                break
            factor /= 2
        else:
            return None
        q = moved
    return None


def _lowest(mechanics: Mechanics) -> float:
    """Square of the lowest bending frequency of all beams, (rad/s)^2, estimated as EI / (mass per length * length^4)."""
    beams = [line.beam for line in mechanics.model.lines]
    lengths = [float(np.sum(np.linalg.norm(np.diff(beam.outline, axis=0), axis=1))) for beam in beams]
    sections = [beam.section for beam in beams]
    return float(min(min(s.EI2, s.EI3) / s.mass_per_length / l**4 for s, l in zip(sections, lengths, strict=True)))
