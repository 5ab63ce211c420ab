"""Stiffness of the motions that constraints allow: which have none, and in how many directions it is negative.

Scenes of rigid bodies are small: their stiffness is reduced to the free motions and decomposed. Beams have many nodes:
the tangent stays sparse, inverse iteration finds motions without stiffness, a factorisation the number of negative directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu, spsolve

from mbdae.analysis.pencil import Pencil
from mbdae.analysis.reduced import free_basis
from mbdae.errors import EquilibriumError
from mbdae.system.base import Array

#: a stiffness of at most this part of the sizes of its terms counts as none in scenes with dense matrices; a negative one beyond
#: it counts as a direction in which the state is unstable
SOFT = 1e-11
#: rounding error of a stiffness, relative to the largest entry of the tangent; a stiffness up to it counts as none
ROUND_OFF = 1e-14
#: stiffness against violations of the constraint rows, relative to the largest entry of the scene's stiffness matrix: it makes
#: all motions that the constraints forbid stiff, so that negative directions are counted among the allowed ones only
CLAMP = 3.0
#: asymmetry that counts as rounding, relative to the largest entry; loads with a larger one count as not conservative
SYMMETRIC = 1e-6
PROBES = 6  #: largest number of vectors of the inverse iteration that finds the softest motions


@dataclass(frozen=True)
class Tangent:
    """The linearised equations at a point, K x = right: of forces, internal states, algebraic unknowns and constraints.

    x = (p, s, z, c, torque): displacements p (nu,), internal states s, algebraic unknowns z and multipliers c as in `Pencil`, and
    the torque (N m) that holds the angle of a freely turning frame, where there is one. p: the linearisation with its places of
    those kinds; hold (1 or 0, nu): the row of that angle, a constraint too; units (nu,): sizes of the displacements."""

    p: Pencil
    K: Any
    right: Array
    hold: Array
    units: Array

    @property
    def nu(self) -> int:
        """Number of displacements."""
        return len(self.units)

    @property
    def inner(self) -> int:
        """Number of internal states and algebraic unknowns."""
        return len(self.p.places["s"]) + len(self.p.places["z"])

    @cached_property
    def N(self) -> Array:
        """(nu, freedoms) displacements that constraints allow."""
        return free_basis(np.vstack([self.p.constraints, self.hold]), self.units)

    @cached_property
    def condensed(self) -> Any:
        """(nu, nu) sparse: the tangent of the displacements, with internal states and algebraic unknowns eliminated."""
        nu, inner = self.nu, slice(self.nu, self.nu + self.inner)
        K = self.K[:nu, :nu]
        if not self.inner:
            return K.tocsc()
        own, below, beside = self.K[inner, inner].tocsc(), self.K[inner, :nu].tocsc(), self.K[:nu, inner]
        diagonal = own.diagonal()
        if own.nnz == np.count_nonzero(diagonal) == len(diagonal):
            return (K - beside @ sp.diags(1 / diagonal) @ below).tocsc()
        try:
            return (K - beside @ sp.csc_matrix(spsolve(own, below)).reshape(below.shape)).tocsc()
        except RuntimeError:  # which SciPy raises for a singular matrix
            raise EquilibriumError("no single state at rest: an internal state of the scene, or a combination of some, is an "
                                   "integrator: its rate does not depend on its own value, and it stays where a run has brought "
                                   "it; simulate until it rests, and linearize there, s.linearize(at=r)") from None  # fmt: skip


class DenseStiffness:
    """The stiffness of small scenes, by singular values and eigenvalues."""

    def __init__(self, T: Tangent) -> None:
        self.T, self.full = T, T.condensed.toarray()
        self.reduced = T.N.T @ self.full @ T.N

    @cached_property
    def scales(self) -> Array:
        """(freedoms,) roots of the sizes of the stiffnesses, so that one spring does not hide another; where one has none, the
        root of what rounding of the largest leaves."""
        size = np.abs(self.T.N).T @ np.abs(self.full) @ np.abs(self.T.N)
        largest = float(np.max(size, initial=0.0))
        return np.sqrt(np.maximum(np.diagonal(size), ROUND_OFF**2 * largest)) if largest else np.ones(len(size))

    def softest(self) -> tuple[Array, Array, float]:
        """Stiffnesses in rising order, their motions (nu, k), and the size up to which a stiffness counts as none."""
        if not len(self.reduced):
            return np.zeros(0), np.zeros((self.T.nu, 0)), 0.0
        _, sizes, right = np.linalg.svd(self.reduced / self.scales / self.scales[:, None])
        if sizes[-1] <= SOFT:
            return sizes[::-1], self.T.N @ (right[::-1] / self.scales).T, SOFT
        _, sizes, right = np.linalg.svd(self.reduced)
        return sizes[::-1], self.T.N @ right[::-1].T, 0.0

    @property
    def symmetric(self) -> bool:
        """True without a test: it only decides whether a stable state is searched for, which costs little for small scenes."""
        return True

    def negative(self, inertia: Any = None) -> int:
        """Number of directions in which the symmetric part, or that of K + inertia, is negative."""
        K = self.reduced if inertia is None else self.reduced + self.T.N.T @ inertia @ self.T.N
        scaled = (K + K.T) / 2 / self.scales / self.scales[:, None]
        return int(np.sum(np.linalg.eigvalsh(scaled) < -SOFT)) if len(scaled) else 0


class SparseStiffness:
    """The stiffness of scenes with beams."""

    def __init__(self, T: Tangent) -> None:
        D = sp.diags(T.units)
        self.T, self.scaled = T, (D @ T.condensed @ D).tocsc()
        self.largest = float(np.max(np.abs(self.scaled.data), initial=0.0))

    def softest(self) -> tuple[Array, Array, float]:
        """Estimates of a few of the lowest stiffnesses, their motions (nu, k), and the size up to which one counts as none."""
        T, nu = self.T, self.T.nu
        floor = max(ROUND_OFF * self.largest, 1e-300)
        metric = 1 / T.units**2
        try:
            factors = splu((T.K + sp.diags(np.r_[0.1 * floor * metric, np.zeros(T.K.shape[0] - nu)])).tocsc())
        except RuntimeError:
            return np.zeros(1), T.units[:, None], floor
        X = np.random.default_rng(5).normal(size=(nu, min(PROBES, nu))) * T.units[:, None]
        sizes = np.zeros(X.shape[1])
        for _ in range(4):
            right = np.vstack([metric[:, None] * X, np.zeros((T.K.shape[0] - nu, X.shape[1]))])
            Y = np.asarray(factors.solve(right))[:nu]
            if not np.all(np.isfinite(Y)):
                return np.zeros(1), X[:, :1], floor
            left, grown, _ = np.linalg.svd(Y / T.units[:, None], full_matrices=False)
            X, sizes = left * T.units[:, None], 1 / np.maximum(grown, 1e-300)
        return sizes, X, floor

    @property
    def symmetric(self) -> bool:
        """Whether the loads are conservative: only then does a negative direction mean that the state is unstable."""
        K = self.T.K[: self.T.nu, : self.T.nu].tocsr()
        scaled = sp.diags(self.T.units) @ K @ sp.diags(self.T.units)
        return bool(abs(scaled - scaled.T).max() <= SYMMETRIC * abs(scaled).max())

    def negative(self, inertia: Any = None) -> int:
        """Number of directions in which the symmetric part, or that of K + inertia, is negative."""
        S = self.scaled if inertia is None else self.scaled + sp.diags(self.T.units) @ inertia @ sp.diags(self.T.units)
        S = (S + S.T) / 2
        if len(self.rows.indptr) > 1:
            S = S + CLAMP * float(np.max(np.abs(S.data))) * self.rows.T @ self.rows
        return _negatives((S + sp.identity(len(self.T.units)) * 1e-15 * self.largest).tocsc())

    @cached_property
    def rows(self) -> Any:
        """Constraint rows (m, nu), sparse, for displacements in multiples of the scene's length and rad, each of unit length."""
        T = self.T
        G = (T.K[T.nu + T.inner :, : T.nu] @ sp.diags(T.units)).tocsr()
        norms = np.sqrt(np.asarray(G.multiply(G).sum(axis=1)).ravel())
        return (sp.diags(1 / np.where(norms > 0, norms, 1.0)) @ G).tocsr()


def _negatives(S: Any) -> int:
    """Negative eigenvalues of a symmetric matrix (Sylvester): negative pivots of a factorisation without exchanges."""
    try:
        factors = splu(S, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        if np.array_equal(factors.perm_r, factors.perm_c):
            return int(np.sum(factors.U.diagonal() < 0))
    except RuntimeError:
        pass
    return int(np.sum(np.linalg.eigvalsh(S.toarray()) < 0))


def stiffness(T: Tangent, sparse: bool) -> DenseStiffness | SparseStiffness:
    """The stiffness of a tangent."""
    return SparseStiffness(T) if sparse else DenseStiffness(T)
