"""The lowest modes of scenes with beams: sparse equations with the stresses as unknowns, by shifted inverse iteration.

With X = (displacements, internal states, stresses, multipliers): (w^2 M + w C + K) X = 0, w the eigenvalue. Stresses keep
the stiffness of slender beams out of the matrices: their frequencies spread over ten powers of ten.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, eigs, eigsh, splu

from mbdae.analysis.pencil import Pencil, acting_states
from mbdae.analysis.spectrum import Spectrum
from mbdae.system.base import Array
from mbdae.system.model.model import Model

Complex = NDArray[np.complex128]

SYMMETRIC = 1e-9  #: asymmetry that counts as rounding, relative to the largest entry of the block
ZERO = 3e-4  #: eigenvalues (rad/s) up to this part of the lowest frequency of the softest beam count as 0
ROUND_OFF = 1e-9  #: imaginary part of an eigenvalue, relative to its size, that counts as 0
GROWTH = 1e-8  #: real part of an eigenvalue, relative to its size, that counts as 0
FEW = 60  #: largest number of freedoms for which all eigenvalues are computed; with more, only as many as are asked for
FINITE = 1e-12  #: inverse eigenvalues smaller than this, relative to the largest, belong to unknowns without inertia
DEFAULT = 20  #: number of modes found for a scene with beams where the user gives no `count`


@dataclass(frozen=True)
class Quadratic:
    """w^2 M + w C + K, sparse; the first nu unknowns are displacements, M has entries in their columns alone."""

    M: Any
    C: Any
    K: Any
    nu: int
    freedoms: int

    @property
    def conservative(self) -> bool:
        """Whether the equations are symmetric and have no damping, gyroscopic terms or internal states."""
        nu, S = self.nu, self.K
        blocks = ((S[:nu, :nu], S[:nu, :nu].T), (S[:nu, nu:], S[nu:, :nu].T), (S[nu:, nu:], S[nu:, nu:].T))
        return not self.C.count_nonzero() and all(_largest(a - b) <= SYMMETRIC * _largest(a) for a, b in blocks)


def _largest(A: Any) -> float:
    return float(np.max(np.abs(A.data), initial=0.0))


def quadratic(p: Pencil) -> Quadratic:
    """The equations of a pencil in displacements, acting internal states, algebraic unknowns and multipliers."""
    at = {"p": p.places["p"], "w": p.places["w"], "s": acting_states(p), "z": p.places["z"], "c": p.places["c"]}
    rows = np.concatenate([at[k] for k in "wszc"])
    others = np.concatenate([at[k] for k in "szc"])
    E, A = p.E[rows], p.A[rows]
    second = E[:, at["w"]]
    first = E[:, at["p"]] + second @ p.kinematics + A[:, at["w"]]
    zeroth = A[:, at["p"]] + A[:, at["w"]] @ p.kinematics
    return Quadratic(sp.hstack([second, sp.csr_matrix((len(rows), len(others)))], format="csc"),
                     sp.hstack([first, E[:, others]], format="csc"), sp.hstack([zeroth, A[:, others]], format="csc"),
                     len(at["p"]), len(at["p"]) + len(at["s"]) - len(at["c"]))  # fmt: skip


def softest_beam(model: Model) -> float:
    """rad/s: about the lowest frequency of the softest beam of a model."""
    found = []
    for line in model.lines:
        bending = 1 / max(line.numbers["compliance_M2"], line.numbers["compliance_M3"], 1e-300)
        found.append(np.sqrt(bending / line.numbers["mass_per_length"]) / line.mesh.length**2)
    return float(min(found))


def lowest(p: Pencil, count: int, scale: float) -> Spectrum:
    """The smallest eigenvalues (k,) with imaginary part >= 0 by rising frequency, and displacements (nu, k) of their modes.
    scale: the lowest frequency of the softest beam, rad/s, near which eigenvalues are expected."""
    equations = quadratic(p)
    count = min(count, equations.freedoms - 2) if equations.freedoms > FEW else count
    values, vectors = (_conservative if equations.conservative else _general)(equations, count, scale)
    values = np.where(np.abs(values) <= ZERO * scale, 0.0, values)
    values = np.where(np.abs(values.imag) <= ROUND_OFF * np.abs(values), values.real + 0j, values)
    values = np.where(np.abs(values.real) <= GROWTH * np.abs(values), 1j * values.imag, values)
    keep = np.flatnonzero(values.imag >= 0)
    keep = keep[np.argsort(np.abs(values[keep]), kind="stable")][:count]
    keep = keep[np.lexsort((values[keep].real, values[keep].imag))]
    return Spectrum(values[keep], vectors[:, keep], np.zeros(len(keep)), None)


def _conservative(q: Quadratic, count: int, scale: float) -> tuple[Complex, Complex]:
    """K X = s M X: the squares s of the frequencies are real, and negative where a motion grows."""
    n, shift = q.K.shape[0], -(scale**2)
    factors = splu((q.K - shift * q.M).tocsc())
    if q.freedoms <= FEW:
        inverted = factors.solve(q.M[:, : q.nu].toarray())[: q.nu]
        found, shapes = _of_inverse(inverted, shift)
        squares, vectors = found.real, shapes.real
    else:
        begin = np.random.default_rng(3).normal(size=n)
        for _ in range(2):  # removes from the start vector its components in unknowns without inertia
            begin = factors.solve(q.M @ begin)
        inverse = LinearOperator((n, n), matvec=factors.solve, dtype=float)
        squares, vectors = eigsh(q.K, k=count, M=q.M, sigma=shift, OPinv=inverse, v0=begin,
                                 ncv=min(q.freedoms - 1, max(2 * count + 1, 40)))  # fmt: skip
    squares = np.where(np.abs(squares) <= (ZERO * scale) ** 2, 0.0, squares)
    roots = np.where(squares >= 0, 1j, 1.0) * np.sqrt(np.abs(squares))
    double = squares <= 0  # such a square stands for two real roots: twice 0, or one growing and one decaying motion
    return np.r_[roots, -roots[double]], np.hstack([vectors[: q.nu], vectors[: q.nu, double]])


def _general(q: Quadratic, count: int, scale: float) -> tuple[Complex, Complex]:
    """Eigenpairs of the equations in first order, with the velocities as unknowns of their own: (X, w p)."""
    n, nu, shift = q.K.shape[0], q.nu, scale
    factors = splu((q.K + shift * q.C + shift**2 * q.M).tocsc())
    M = q.M[:, :nu]

    def solve(x: Array) -> Array:
        inertia = -(q.C @ x[:n] + M @ x[n:])
        X = factors.solve(inertia - shift * (M @ x[:nu]))
        return np.concatenate([X, x[:nu] + shift * X[:nu]])

    size = n + nu
    if q.freedoms <= FEW:
        values, vectors = _of_inverse(solve(np.eye(size)), shift)
        return values, vectors[:nu]
    begin = np.random.default_rng(3).normal(size=size)
    for _ in range(3):
        begin = solve(begin)
    wanted = min(2 * count + 4, 2 * q.freedoms - 2)
    values, vectors = eigs(LinearOperator((size, size), matvec=solve, dtype=float), k=wanted, which="LM", v0=begin,
                           ncv=min(2 * q.freedoms - 1, max(2 * wanted + 1, 60)))  # fmt: skip
    return shift + 1 / values, vectors[:nu]


def _of_inverse(inverse: Array, shift: float) -> tuple[Complex, Complex]:
    """All eigenvalues w and their vectors from the matrix `inverse`, whose eigenvalues are 1 / (w - shift); those of its
    eigenvalues that are zero belong to unknowns without inertia and are left out."""
    values, vectors = np.linalg.eig(inverse)
    keep = np.abs(values) > FINITE * np.max(np.abs(values), initial=0.0)
    return shift + 1 / values[keep], vectors[:, keep]
