"""Positions changed by virtual displacements, for unknowns of any numbering: rotations are composed, all others are added."""

from __future__ import annotations

import numpy as np

from mbdae.system.base import Array
from mbdae.system.model.numbering import Numbering

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
