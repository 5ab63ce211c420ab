"""The equations of motion at any state: masses, forces, constraints, accelerations and reactions.

Positions changed by virtual displacements, for unknowns of any numbering: rotations are composed, all others are added.

The motion of all bodies from the unknowns of a form, including joint coordinates.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.native.program import Operations
from mbdae.system.base import Array
from mbdae.system.model.model import Model
from mbdae.system.model.moved_bodies import MovedBodies
from mbdae.system.model.nodes import Node
from mbdae.system.model.numbering import Numbering
from mbdae.system.motion.constrained import Evaluator
from mbdae.threads import check

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

    def again(self, model: Model) -> AllBodies | None:
        """The same of a model that differs in numbers alone; None where kernels of trees contain one of these."""
        if (moved := self.moved.again(model, self.model)) is None:
            return None
        made = copy(self)
        made.model, made.moved, made.numbering = model, moved, self.numbering.again(model, moved.constants)
        if (known := made.__dict__.pop("_evaluator", None)) is not None:
            vars(made)["_evaluator"] = known.again(made.numbering)
        return made

    @cached_property
    def _evaluator(self) -> Evaluator:
        return Evaluator(self.numbering)

    def _emitted(self, part: Operations) -> Any:
        """Append q, u and u' of all nodes from the unknowns and their rates; returns their slots."""
        model, nb, count = self.model, self.numbering, self.model.nq + 2 * self.model.nu
        result = part.zeros(count)
        starts = {"q": result, "u": result + model.nq, "up": result + model.nq + model.nu}

        def place(node: Node, head: str, i: int) -> int:
            return starts[head] + (node.q if head == "q" else node.u) + i

        for head, first in starts.items():
            own = nb.of_positions if head == "q" else nb.of_velocities
            unknown = nb.nq * (head != "q") + nb.n * (head == "up")
            part.set(first + own, unknown + np.arange(len(own)))
        sharing = self.moved.sharing
        for node in (n for n in model.nodes if n.name in sharing.nodes or n.name in sharing.turned):
            for head in starts:
                every = range(node.kind.sizes[head != "q"])
                part.set([place(node, head, i) for i in every], [nb.node_place(head, node, i) for i in every])
        self.moved.motion(part, nb, place)
        return result + np.arange(count)

    def _of_all(self, t: Array, q: Array, u: Array, up: Array | None = None) -> tuple[Array, Array, Array]:
        """q, u and u' (nt, ...) of all nodes from those of the unknowns; up: None for 0."""
        check("the motion of all bodies was evaluated")
        y = np.zeros((2, len(t), self.numbering.n))
        y[0, :, : self.nq], y[0, :, self.nq : self.nq + self.nu] = q, u
        y[1, :, self.nq : self.nq + self.nu] = 0.0 if up is None else up
        found, nq, nu = self._evaluator.at_states("motion", self._emitted, t, *y), self.model.nq, self.model.nu
        return found[:, :nq], found[:, nq : nq + nu], found[:, nq + nu :]

    def states(self, t: Array, y: Array) -> tuple[Array, Array]:
        """q (nt, nq), u (nt, nu) of all nodes from unknowns y (nt, n)."""
        q, u = y[:, : self.nq], y[:, self.nq : self.nq + self.nu]
        if not self.moved.trees and not self.moved.sharing.nodes:
            return q, u
        return self._of_all(t, q, u)[:2]

    def accelerations(self, t: Array, q: Array, u: Array, up: Array) -> Array:
        """u' (nt, nu) of all nodes from positions q, velocities u and accelerations up of the unknowns."""
        return self._of_all(t, q, u, up)[2]

    def reduced(self, q: Array, u: Array) -> tuple[Array, Array]:
        """Positions and velocities of the unknowns from those of all nodes, (nt, ...) each."""
        return q[:, self.numbering.of_positions], u[:, self.numbering.of_velocities]

    def velocity_map(self, t: Array, q: Array) -> Array:
        """T (nt, nu of all nodes, nu of the unknowns): derivatives of the velocities of all nodes by the velocity unknowns at
        positions q (nt, nq) of the unknowns. Column by column: velocities for one unknown equal to 1 and the others 0, less those
        for all 0, because velocities depend on the unknowns linearly."""
        each = self.nu + 1
        u = self._of_all(np.repeat(t, each), np.repeat(q, each, axis=0), np.tile(np.eye(each, self.nu), (len(t), 1)))[1]
        u = u.reshape(len(t), each, self.model.nu)
        return (u[:, :-1] - u[:, -1:]).transpose(0, 2, 1)
