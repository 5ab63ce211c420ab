"""Stiffness and damping law by law: whether their sum is positive, where rounding hides the small ones beside the large ones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.analysis.definite import EPS, sign
from mbdae.analysis.pencil import ROUNDED, Basis
from mbdae.system.base import Array

NOISE = 8 * EPS  #: eigenvalues of the matrix of one law up to this part of its largest count as 0, and asymmetry as none
LEVELS = 6  #: number of sizes above which stiff parts are left out, one after the other


@dataclass(frozen=True)
class Laws:
    """The equations of momentum law by law, at rest in axes that do not turn.

    terms: dF/dy of every instance of a law; basis: that of the pencil; nu: number of velocities; weights (nu,):
    masses and inertias, which make stiffnesses of displacements and of rotations comparable."""

    terms: list[Any]
    basis: Basis
    nu: int
    weights: Array

    @cached_property
    def _split(self) -> dict[str, list[tuple[Array, Array]]]:
        """For "K" and "C", of every instance with an influence: its displacements (k,), and its matrix (k, k) divided by the
        roots of the weights."""
        found: dict[str, list[tuple[Array, Array]]] = {"K": [], "C": []}
        at, root = slice(self.nu, 2 * self.nu), np.sqrt(self.weights)
        for term in self.terms:
            for name, columns in (("K", slice(0, self.nu)), ("C", at)):
                S = (self.basis.L[at] @ term @ self.basis.T[:, columns]).tocoo()
                own = np.unique(np.r_[S.row[S.data != 0], S.col[S.data != 0]])
                if len(own):
                    S = S.tocsr()[own][:, own].toarray() / root[own, None] / root[own]
                    found[name].append((own, S))
        return found

    def none_resists(self, p: Any) -> bool:
        """Whether no law has a stiffness against the motion p (nu,), divided by the roots of the weights."""
        return all(np.max(np.abs(S @ p[own])) <= NOISE * np.max(np.abs(S)) * np.max(np.abs(p[own]))
                   for own, S in self._split["K"])  # fmt: skip

    def surely(self, name: str, N: Array) -> bool:
        """Whether x^T S x >= 0 is certain for S = "K" or "C" on the motions N x.

        The parts of laws that are positive and stiffer than some size are left out: the rest is positive by itself, or the sum is
        not known to be."""
        parts = []
        for own, S in self._split[name]:
            if np.max(np.abs(S - S.T)) > NOISE * np.max(np.abs(S)):
                return False
            values, V = np.linalg.eigh((S + S.T) / 2)
            values = np.where(np.abs(values) <= NOISE * np.max(np.abs(values)), 0.0, values)
            parts.append((own, values, V, NOISE * np.max(np.abs(values))))
        sizes = np.array([np.max(values) for _, values, _, _ in parts if np.max(values, initial=0.0) > 0])
        least = -min((float(np.min(values)) for _, values, _, _ in parts), default=0.0)
        if not len(sizes):
            return least <= 0
        if least <= 0:
            return True
        scaled = np.sqrt(self.weights)[:, None] * N
        for level in np.geomspace(max(least, float(np.min(sizes))), float(np.max(sizes)), LEVELS):
            S, dS = np.zeros((N.shape[1],) * 2), np.zeros((N.shape[1],) * 2)
            for own, values, V, noise in parts:
                kept = values <= level
                U = V[:, kept].T @ scaled[own]
                S += U.T @ (values[kept, None] * U)
                size = np.abs(V[:, kept]).T @ np.abs(scaled[own])
                rounding = ROUNDED * size.T @ (np.abs(values[kept])[:, None] * size)
                if np.any(values[kept] != 0) and not np.all(kept):
                    rounding = rounding + noise * size.T @ size
                dS += rounding
            if sign(S, dS) > 0:
                return True
        return False
