"""The lowest modes of scenes with beams: sparse equations with the stresses as unknowns, by shifted inverse iteration.

With X = (displacements, internal states, stresses, multipliers): (w^2 M + w C + K) X = 0, w the eigenvalue. Stresses keep
the stiffness of slender beams out of the matrices: their frequencies spread over ten powers of ten.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, eigs, eigsh, splu

from mbdae.analysis.pencil import Pencil, acting_states
from mbdae.analysis.reduced import free_basis
from mbdae.analysis.roots import parts
from mbdae.analysis.spectrum import Spectrum, Structure, digits, exact_zeros
from mbdae.analysis.state import NOISE
from mbdae.system.base import Array
from mbdae.system.model.model import Model

Complex = NDArray[np.complex128]

SYMMETRIC = 1e-9  #: asymmetry that counts as rounding, relative to the largest entry of the block
LOWEST = 6  #: number of eigenvalues of the stiffness that are looked at for a negative one
BESIDE = 1e3  #: factor for roots near the one in question, in the error that is of second order in that of the vector
APART = 1e-5  #: roots nearer to each other than this, relative to their size, are improved together
FEW = 60  #: largest number of freedoms for which all eigenvalues are computed; with more, only as many as are asked for
FINITE = 1e-12  #: inverse eigenvalues smaller than this, relative to the largest, belong to unknowns without inertia
MASSLESS = 1e-13  #: inertia that counts as none, relative to the largest, where each freedom is measured by its own
DEFAULT = 20  #: number of modes found for a scene with beams where the user gives no `count`


@dataclass(frozen=True)
class Quadratic:
    """w^2 M + w C + K, sparse; the first nu unknowns are displacements, M has entries in their columns alone."""

    M: Any
    C: Any
    K: Any
    nu: int
    freedoms: int
    closing: Array  #: (m, nu) rows that displacements obey

    @property
    def conservative(self) -> bool:
        """Whether the equations are symmetric and have no damping, gyroscopic terms or internal states."""
        return not self.C.count_nonzero() and self.symmetric

    @cached_property
    def symmetric(self) -> bool:
        """Whether the stiffness is symmetric."""
        nu, S = self.nu, self.K
        blocks = ((S[:nu, :nu], S[:nu, :nu].T), (S[:nu, nu:], S[nu:, :nu].T), (S[nu:, nu:], S[nu:, nu:].T))
        return all(_largest(a - b) <= SYMMETRIC * _largest(a) for a, b in blocks)


def _largest(A: Any) -> float:
    return float(np.max(np.abs(A.data), initial=0.0))


def quadratic(p: Pencil, whole: Pencil) -> Quadratic:
    """The equations of a pencil, or the bounds p of the errors of the pencil `whole`, in displacements, acting internal states,
    algebraic unknowns and multipliers."""
    at = whole.places | {"s": acting_states(whole)}
    turn = whole.kinematics if p is whole else 2 * abs(whole.kinematics)  # twice: its own errors are in proportion to it
    rows = np.concatenate([at[k] for k in "wszc"])
    others = np.concatenate([at[k] for k in "szc"])
    E, A = p.E[rows], p.A[rows]
    second = E[:, at["w"]]
    first = E[:, at["p"]] + second @ turn + A[:, at["w"]]
    zeroth = A[:, at["p"]] + A[:, at["w"]] @ turn
    return Quadratic(sp.hstack([second, sp.csr_matrix((len(rows), len(others)))], format="csc"),
                     sp.hstack([first, E[:, others]], format="csc"), sp.hstack([zeroth, A[:, others]], format="csc"),
                     len(at["p"]), len(at["p"]) + len(at["s"]) - len(at["c"]), whole.closing)


def softest_beam(model: Model) -> float:
    """rad/s: about the lowest frequency of the softest beam of a model."""
    found = []
    for line in model.lines:
        bending = 1 / max(line.numbers["compliance_M2"], line.numbers["compliance_M3"], 1e-300)
        found.append(np.sqrt(bending / line.numbers["mass_per_length"]) / line.mesh.length**2)
    return float(min(found))


def lowest(p: Pencil, count: int, scale: float, known: Structure) -> Spectrum:
    """The smallest eigenvalues with imaginary part >= 0 by rising frequency, displacements (nu, k) of their modes, and bounds of
    their errors. scale: the lowest frequency of the softest beam, rad/s, near which eigenvalues are expected."""
    equations = quadratic(p, p)
    assert p.errors is not None
    errors = quadratic(p.errors, p)
    count = min(count, equations.freedoms - 2) if equations.freedoms > FEW else count
    find = _conservative if equations.conservative else _general
    values, vectors, off = find(equations, errors, count, scale)
    zero = np.abs(values) <= off
    off, values = np.where(zero, off + np.abs(values), off), np.where(zero, 0.0, values)
    keep = np.flatnonzero(values.imag >= 0)
    keep = keep[np.argsort(np.abs(values[keep]), kind="stable")][:count]
    keep = keep[np.lexsort((values[keep].real, digits(values[keep].imag)))]
    values, vectors, off = values[keep], vectors[: equations.nu, keep], off[keep]
    near = np.abs(values[:, None] - values) <= 4 * (off[:, None] + off)
    alone = np.sum(near, axis=1) == 1
    passive = _passive(equations, errors, count, scale, known)
    if passive:
        values.real = np.minimum(values.real, 0.0)
    if _in_pairs(equations, errors):
        values.real[alone & (np.abs(values.real) <= off)] = 0.0
        alone &= values.real == 0
        alone |= exact_zeros(values, off, vectors, known)
    else:
        alone[:] = False
    stable = False if np.any(values.real > off) else True if passive or np.all((values.real + off <= 0) | alone) else None
    return Spectrum(values, vectors, off, stable)


def growth(p: Pencil, scale: float, known: Structure) -> Spectrum:
    """The lowest roots of a pencil as far as they are needed to see whether a motion grows: none where the energy excludes it."""
    assert p.errors is not None
    if _passive(quadratic(p, p), quadratic(p.errors, p), LOWEST, scale, known):
        return Spectrum(np.zeros(0, dtype=complex), np.zeros((len(p.places["p"]), 0), dtype=complex), np.zeros(0), True)
    return lowest(p, LOWEST, scale, known)


def _in_pairs(q: Quadratic, e: Quadratic) -> bool:
    """Whether with every root z there is a root -z: no force depends on velocities, or gyroscopic ones alone in symmetric
    equations."""
    if not _beyond(q.C, e.C):
        return True
    C, d = q.C[:, : q.nu], e.C[:, : q.nu]
    square, error = C[: q.nu] + C[: q.nu].T, d[: q.nu] + d[: q.nu].T
    return q.symmetric and not _beyond(square, error) and not _beyond(C[q.nu :], d[q.nu :]) and not q.C[:, q.nu :].count_nonzero()


def _beyond(S: Any, dS: Any) -> bool:
    """Whether any entry of S is larger than its error."""
    return bool(((abs(S) - dS) > 0).nnz)


def _passive(q: Quadratic, e: Quadratic, count: int, scale: float, known: Structure) -> bool:
    """Whether the energy shows that no motion grows: damping and stiffness are not negative. The stiffness of the beams alone is
    not; with stressed beams and loads its lowest eigenvalues are found."""
    C, d = q.C[: q.nu, : q.nu].tocsr(), e.C[: q.nu, : q.nu]
    if not q.symmetric or not _damped_as_strained(q, e) or q.C[:, q.nu :].count_nonzero():
        return False
    damping = (C + C.T).tocsr()
    if _beyond(damping, d + d.T) and not _not_negative(damping):
        return False
    if not _beyond(q.K[: q.nu, : q.nu], e.K[: q.nu, : q.nu]):
        return True
    values, vectors, off = _conservative(q, e, min(count, LOWEST), scale)
    zero = np.abs(values) <= off
    exact = exact_zeros(np.where(zero, 0.0, values), off, vectors[: q.nu], known)
    return bool(np.all((values.imag > off) | exact))


def _damped_as_strained(q: Quadratic, e: Quadratic) -> bool:
    """Whether each stress depends on the rate of its strain in a proportion to the strain that is not negative."""
    rates, strains = q.C[q.nu :, : q.nu].tocsr(), q.K[q.nu :, : q.nu].tocsr()
    size = np.asarray(strains.multiply(strains).sum(axis=1)).ravel()
    d = np.asarray(rates.multiply(strains).sum(axis=1)).ravel() / np.where(size > 0, size, 1.0)
    off = sp.diags(d) @ abs(strains) * SYMMETRIC + e.C[q.nu :, : q.nu]
    return bool(np.all(d >= 0)) and not _beyond(rates - sp.diags(d) @ strains, off)


def _not_negative(S: Any) -> bool:
    """Whether a symmetric sparse matrix with few entries has no negative eigenvalue beyond rounding, coupled part by part."""
    used = np.flatnonzero(abs(S).sum(axis=1))
    dense = S[used][:, used].toarray()
    for at in parts(dense):
        values = np.linalg.eigvalsh(dense[np.ix_(at, at)])
        if values[0] < -NOISE * values[-1]:
            return False
    return True


def _conservative(q: Quadratic, e: Quadratic, count: int, scale: float) -> tuple[Complex, Complex, Array]:
    """K X = s M X: the squares -s of the roots are real; positive ones belong to a motion that grows and one that decays."""
    n, shift = q.K.shape[0], -(scale**2)
    factors = splu((q.K - shift * q.M).tocsc())
    if q.freedoms <= FEW:
        inverted = factors.solve(q.M[:, : q.nu].toarray())[: q.nu]
        found, shapes = _of_inverse(inverted, shift)
        first = np.argsort(np.abs(found), kind="stable")[: count + 2]
        squares, vectors = found.real[first], factors.solve(q.M[:, : q.nu] @ shapes.real[:, first])
    else:
        begin = np.random.default_rng(3).normal(size=n)
        for _ in range(2):  # removes from the start vector its components in unknowns without inertia
            begin = factors.solve(q.M @ begin)
        inverse = LinearOperator((n, n), matvec=factors.solve, dtype=float)
        squares, vectors = eigsh(q.K, k=count, M=q.M, sigma=shift, OPinv=inverse, v0=begin,
                                 ncv=min(q.freedoms - 1, max(2 * count + 1, 40)))
    mass = np.einsum("nk,nk->k", vectors, q.M @ vectors)
    step = np.einsum("nk,nk->k", vectors, q.K @ vectors) / mass - squares  # Rayleigh's quotient: exact to the second order
    squares = squares + step
    size = np.abs(vectors)
    bound = (np.einsum("nk,nk->k", size, e.K @ size) + np.einsum("nk,nk->k", size, e.M @ size) * np.abs(squares)) / np.abs(mass)
    residual = q.K @ vectors - (q.M @ vectors) * squares
    # what Rayleigh's quotient leaves, of second order in the error of the vector; larger where other roots are near
    bound = bound + BESIDE * np.abs(np.einsum("nk,nk->k", residual, factors.solve(residual)) / mass)
    bound = bound * np.sum(np.abs(squares[:, None] - squares) <= 100 * np.minimum(bound[:, None], bound), axis=1)
    roots = np.where(squares >= 0, 1j, 1.0) * np.sqrt(np.abs(squares))
    error = np.where(np.abs(squares) > 2 * bound, bound / np.maximum(np.abs(roots), 1e-300), 2 * np.sqrt(bound))
    double = squares <= bound  # such a square stands for two real roots: twice 0, or one growing and one decaying motion
    return np.r_[roots, -roots[double]], np.hstack([vectors, vectors[:, double]]), np.r_[error, error[double]]


def _general(q: Quadratic, e: Quadratic, count: int, scale: float) -> tuple[Complex, Complex, Array]:
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
        basis, coordinates = _moving(q)
        inverse = solve(basis)
        values, shapes = _of_inverse(coordinates @ inverse, shift)
        vectors = inverse @ shapes
    else:
        begin = np.random.default_rng(3).normal(size=size)
        for _ in range(3):
            begin = solve(begin)
        wanted = min(2 * count + 4, 2 * q.freedoms - 2)
        values, vectors = eigs(LinearOperator((size, size), matvec=solve, dtype=float), k=wanted, which="LM", v0=begin,
                               ncv=min(2 * q.freedoms - 1, max(2 * wanted + 1, 60)))
        values = shift + 1 / values
    chosen = np.argsort(np.abs(values), kind="stable")[: 2 * count + 2]
    chosen = chosen[values[chosen].imag >= 0]
    return _improved(q, e, values[chosen], vectors[:n, chosen], scale)


def _moving(q: Quadratic) -> tuple[Array, Array]:
    """Basis (n + nu, k) of the states (X, w p) that move, and the coordinates (k, n + nu) of a state in it: displacements that
    obey the rows, unknowns whose rates count, velocities of what has inertia. All others belong to infinite roots, which come
    together by twos and threes, so that rounding would turn them into large finite ones."""
    n, nu = q.K.shape[0], q.nu
    N = free_basis(q.closing, np.ones(nu))
    rates = nu + np.flatnonzero(abs(q.C[:, nu:]).sum(axis=0))
    inertia = N.T @ (q.M[:nu, :nu] @ N)
    size = np.sqrt(np.maximum(np.diagonal(inertia), 0.0))
    size = np.where(size > 0, size, 1.0)
    values, Q = np.linalg.eigh(inertia / np.outer(size, size))
    moved = Q if q.M[nu:].count_nonzero() else Q[:, values > MASSLESS * values[-1]]
    a, s, k = N.shape[1], len(rates), moved.shape[1]
    basis = np.zeros((n + nu, a + s + k))
    basis[:nu, :a], basis[rates, a + np.arange(s)], basis[n:, a + s :] = N, 1.0, N @ (moved / size[:, None])
    coordinates = np.zeros(basis.shape[::-1])
    coordinates[:a, :nu], coordinates[a + np.arange(s), rates] = N.T, 1.0
    coordinates[a + s :, n:] = (moved * size[:, None]).T @ N.T
    return basis, coordinates


def _improved(q: Quadratic, e: Quadratic, values: Complex, X: Complex, scale: float) -> tuple[Complex, Complex, Array]:
    """Roots after two steps of inverse iteration from both sides, those that nearly coincide together; bounds of their errors."""
    values, X, errors = values.copy(), X.astype(complex), np.zeros(len(values))
    near = np.abs(values[:, None] - values) <= APART * np.maximum(np.abs(values[:, None]), np.abs(values))
    rng = np.random.default_rng(3)
    for group in dict.fromkeys(tuple(np.flatnonzero(row)) for row in near):
        own = list(group)
        root = complex(np.mean(values[own]))
        root = root.real + 0j if np.all(values[own].imag == 0) else root
        beside = root * (1 + 1e-12) + (1e-6 * scale if root == 0 else 0.0)
        factors = splu((q.K + beside * q.C + beside**2 * q.M).tocsc().astype(complex))
        slope = (q.C + 2 * beside * q.M).tocsr()
        x, y = X[:, own], rng.normal(size=(len(q.K.indptr) - 1, len(own))) + 0j
        for _ in range(2):
            x = _unit(factors.solve(slope @ x) if len(own) == 1 else x)
            y = _unit(factors.solve(slope.conj().T @ y, "H"))
        overlap = y.conj().T @ (slope @ x)
        y = np.linalg.lstsq(overlap, y.conj().T, rcond=None)[0].conj().T
        for i, j in enumerate(own):
            step = -y[:, i].conj() @ (q.K @ x[:, i] + values[j] * (q.C @ x[:, i]) + values[j] ** 2 * (q.M @ x[:, i]))
            values[j] = values[j] + (step.real if values[j].imag == 0 else step)
        size, power = np.abs(x), np.abs(values[own])
        carried = np.abs(y).T @ (e.K @ size + (e.C @ size) * power + (e.M @ size) * power**2)
        off = q.K @ x + (q.C @ x) * values[own] + (q.M @ x) * values[own] ** 2
        errors[own] = np.sum(carried + np.abs(y.conj().T @ off), axis=1)
        X[:, own] = x
    mates = values.imag > 0
    return np.r_[values, values[mates].conj()], np.hstack([X, X[:, mates].conj()]), np.r_[errors, errors[mates]]


def _unit(x: Complex) -> Complex:
    return np.asarray(x / np.maximum(np.max(np.abs(x), axis=0), 1e-300))


def _of_inverse(inverse: Array, shift: float) -> tuple[Complex, Complex]:
    """All eigenvalues w and their vectors from the matrix `inverse`, whose eigenvalues are 1 / (w - shift); those of its
    eigenvalues that are zero belong to unknowns without inertia and are left out."""
    values, vectors = np.linalg.eig(inverse)
    keep = np.abs(values) > FINITE * np.max(np.abs(values), initial=0.0)
    return shift + 1 / values[keep], vectors[:, keep]
