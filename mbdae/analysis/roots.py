"""Signs of symmetric matrices whose entries have errors.

The roots of E x' + A x = 0 from matrices whose entries have errors, each with a bound of its own error.

Roots of one scene may spread over twenty powers of ten. What is not coupled is solved apart; the rest from the large roots to the
small ones, each stage about a shift of the size of its roots; every simple root is then improved by inverse iteration on the
equations themselves, which leaves the errors of their entries. These are carried to the roots by left and right vectors: with
W^H E V = 1 the perturbed roots are those of diag(roots) + F, |F| <= |W|^H dP |V|, and lie in the discs of Gershgorin's theorem.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from mbdae.system.base import Array

EPS = float(np.finfo(float).eps)


def sign(S: Array, dS: Array) -> int:
    """1 where x^T S x >= 0 for all x is certain, -1 where some x with x^T S x < 0 certainly is, 0 where errors up to dS of the
    entries leave it open; S (n, n) symmetric.

    The matrix is eliminated with the pivots that are largest beside their first size, and the errors with it: stiffnesses of
    any spread count by their own errors, not by those of the largest."""
    S, dS = (S + S.T) / 2, (dS + dS.T) / 2
    left = np.arange(len(S))
    first = np.maximum(np.diagonal(S), 1e-300)
    while len(left):
        d, e = np.diagonal(S), np.diagonal(dS)
        if np.any(d < -e):
            return -1
        if np.any((d == 0) & (e == 0) & np.any(np.abs(S) > dS, axis=1)):
            return -1
        p = int(np.argmax(np.where(d > 2 * e, d / first[left], -1.0)))
        if not d[p] > 2 * e[p]:
            return int(not np.any(S) and not np.any(dS))
        row, error = S[p], dS[p]
        part = np.abs(row) / d[p]
        worse = np.outer(part, error) + np.outer(error, part) + np.outer(part, part) * e[p] + np.outer(error, error) / d[p]
        product = np.outer(row, row / d[p])
        S, dS = S - product, dS + 2 * worse + EPS * np.abs(product)
        keep = np.arange(len(left)) != p
        S, dS, left = S[np.ix_(keep, keep)], dS[np.ix_(keep, keep)], left[keep]
    return 1


Complex = NDArray[np.complex128]

#: a stage keeps the roots down to this part of its shift; rounding of the shifted equations leaves five digits of them or more,
#: from which inverse iteration goes on
BAND = 1e-10
#: the first stage, without a shift, keeps the roots down to this part of the largest
FIRST = 1e-6
STAGES = 4  #: stages of `BAND` each; what is smaller than 1e-36 of the largest root is not told from 0
#: roots nearer to each other than this, relative to their size, are taken as they were found: inverse iteration would lead both
#: to the same vector
APART = 1e-5
#: number of states up to which every root is improved; with more only those whose errors the first solution dominates, while
#: that costs less than `WORK` multiplications
FEW, WORK = 60, 4e9
#: multiplications with the vectors of the inverse iteration are made for as many roots at once as fit into this many numbers
TOGETHER = 2e6


@dataclass(frozen=True)
class Roots:
    """Roots (n,) 1/s, right vectors (n, n) in columns, bounds of the roots' errors (n,) 1/s; alone (n,): whether the disc of a
    root contains no other one."""

    values: Complex
    vectors: Complex
    errors: Array
    alone: NDArray[np.bool_]


def roots(E: Array, A: Array, dE: Array, dA: Array) -> Roots:
    """All roots of E x' + A x = 0 (n, n); dE, dA: bounds of the errors of the entries."""
    n = len(E)
    values, vectors = np.zeros(n, dtype=complex), np.zeros((n, n), dtype=complex)
    errors, alone = np.zeros(n), np.ones(n, dtype=bool)
    for at in parts(E, A):
        block = np.ix_(at, at)
        found = _coupled(E[block], A[block], dE[block], dA[block])
        values[at], errors[at], alone[at] = found.values, found.errors, found.alone
        vectors[block] = found.vectors
    return Roots(values, vectors, errors, alone)


def parts(*matrices: Array) -> list[NDArray[np.intp]]:
    """Indices of the unknowns that are coupled with each other, part by part; matrices (n, n)."""
    joined = np.zeros(matrices[0].shape, dtype=bool)
    for matrix in matrices:
        joined |= matrix != 0
    count, label = connected_components(csr_matrix(joined), directed=False)
    return [np.flatnonzero(label == k) for k in range(count)]


def _coupled(E: Array, A: Array, dE: Array, dA: Array) -> Roots:
    """`roots` of equations that are all coupled. Where roots coincide exactly, so that vectors are missing, the entries are
    changed within their errors."""
    found = _as_given(E, A, dE, dA)
    if np.all(found.errors <= np.max(np.abs(found.values))):
        return found
    rng, more = np.random.default_rng(2), [np.maximum(d, 4 * EPS * np.abs(a)) for a, d in ((E, dE), (A, dA))]
    E, A = (a + d * rng.uniform(-1, 1, d.shape) for a, d in zip((E, A), more, strict=True))
    return _as_given(E, A, 2 * more[0], 2 * more[1])


def _as_given(E: Array, A: Array, dE: Array, dA: Array) -> Roots:
    values, V, kept = _by_stages(E, A)
    apart = np.abs(values[:, None] - values) / np.maximum(np.abs(values)[:, None], np.abs(values) + 1e-300)
    np.fill_diagonal(apart, np.inf)
    simple = (np.min(apart, axis=1, initial=np.inf) > APART) & (values != 0)
    W = _left(E, V)
    if len(E) > FEW:  # only those where the error of the first solution is larger than that of the data
        F = _carried(E, values, V, W, dE, dA)
        simple &= kept > np.abs(np.diagonal(F))
        simple &= np.cumsum(simple) * 12.0 * len(E) ** 3 <= WORK
    improved = np.flatnonzero(simple & (values.imag >= 0))
    values, V, W = _improved(E, A, values, V, W, improved)
    F = _carried(E, values, V, W, dE, dA)
    size = np.abs(values) * np.abs(np.einsum("in,ij,jn->n", W.conj(), np.abs(E), V)) if len(E) <= FEW else 0.0
    left = np.einsum("in,in->n", W.conj(), A @ V + (E @ V) * values)
    F[np.diag_indices_from(F)] += np.abs(left) + EPS * size + np.where(simple, 0.0, kept)
    return Roots(values, V, *_discs(values, F))


# -- the stages


def _by_stages(E: Array, A: Array) -> tuple[Complex, Complex, Array]:
    """Roots by falling size, their vectors, and the errors (n,) that the solution of their stage leaves."""
    n = len(E)
    values, V, kept = _solved(E, A, None)
    order = np.argsort(-np.abs(values), kind="stable")
    values, V, kept = values[order], V[:, order], kept[order]
    largest = float(np.abs(values[0]))
    shift, done = FIRST * largest, int(np.sum(np.abs(values) > FIRST * largest))
    for _ in range(STAGES):
        if done == n or shift < 1e-280:
            break
        found, U, left = _solved(E, A, shift)
        order = np.argsort(np.abs(found), kind="stable")[: n - done][::-1]  # the smallest, by falling size
        values[done:], V[:, done:], kept[done:] = found[order], U[:, order], left[order]
        done += int(np.sum(np.abs(values[done:]) > BAND * shift))
        shift *= BAND
    return values, V, kept


def _solved(E: Array, A: Array, shift: float | None) -> tuple[Complex, Complex, Array]:
    """Roots, vectors and errors (n,) from one standard problem: that of E^-1 A, or the inverse one about a shift."""
    S = -solved(E, A) if shift is None else -solved(A + shift * E, E)
    with np.errstate(invalid="ignore"):  # it rounds the scales too to whole numbers, of which it reads the permutation alone
        balanced, (scale, order) = scipy.linalg.matrix_balance(S, separate=True)
    found, left, right = scipy.linalg.eig(balanced, left=True, right=True)
    V = np.empty_like(right)
    V[order] = right * scale[order, None] if len(scale) else right
    overlap = np.abs(np.einsum("in,in->n", left.conj(), right))
    error = 4 * EPS * np.linalg.norm(balanced) / np.maximum(overlap, EPS)
    if shift is None:
        return found.astype(complex), V.astype(complex), error
    size = np.abs(found)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = np.where(size > 0, shift + 1 / found, np.inf)
        error = np.where(size > 2 * error, error / size**2, np.inf)
    values = np.where(found.imag == 0, values.real, values)  # division leaves no imaginary part of a real root
    return values.astype(complex), V.astype(complex), error


def solved(Z: Any, right: Any) -> Any:
    """Z^-1 right with rows and columns scaled to largest entries of 1; a singular Z is changed by rounding."""
    rows, columns = scales(Z)
    scaled = Z * rows[..., :, None] * columns[..., None, :]
    right = rows[..., :, None] * right
    rng = np.random.default_rng(3)
    for changed in (0.0, 4 * EPS, 64 * EPS):
        try:
            found = np.linalg.solve(scaled * (1 + changed * rng.uniform(-1, 1, Z.shape[-2:])), right)
            return np.asarray(columns[..., :, None] * found)
        except np.linalg.LinAlgError:
            continue
    return np.full((*np.broadcast_shapes(scaled.shape[:-2], right.shape[:-2]), Z.shape[-1], right.shape[-1]), np.nan)


def scales(Z: Any) -> tuple[Array, Array]:
    """Scales of rows and columns of Z (..., n, n), powers of 2, that make the entries as equal as two rounds can."""
    size = np.abs(Z)
    rows, columns = np.ones(Z.shape[:-1]), np.ones(Z.shape[:-1])
    for _ in range(2):
        scaled = size * rows[..., :, None] * columns[..., None, :]
        rows = rows / _root_of_largest(scaled, -1)
        columns = columns / _root_of_largest(scaled, -2)
    scaled = size * rows[..., :, None] * columns[..., None, :]
    rows = rows / _root_of_largest(scaled, -1) ** 2
    return np.asarray(2.0 ** np.round(np.log2(rows))), np.asarray(2.0 ** np.round(np.log2(columns)))


def _root_of_largest(scaled: Array, axis: int) -> Array:
    largest = np.max(scaled, axis=axis)
    return np.asarray(np.sqrt(np.where(largest > 0, largest, 1.0)))


# -- inverse iteration


def _improved(E: Array, A: Array, values: Complex, V: Complex, W: Complex,
              chosen: NDArray[np.intp]) -> tuple[Complex, Complex, Complex]:
    """Chosen roots (imaginary part >= 0) with both vectors after two steps of inverse iteration; conjugates follow."""
    n = len(E)
    values, V, W = values.copy(), V.copy(), W.copy()
    mates = {int(i): int(j) for i in chosen if values[i].imag > 0 for j in np.flatnonzero(values == values[i].conj())}
    rng = np.random.default_rng(7)
    for group in np.array_split(chosen, max(1, int(len(chosen) * n * n / TOGETHER))):
        if not len(group):
            continue
        lam, v, w = values[group], V[:, group].T, rng.normal(size=(len(group), n)) + 0j
        begin = lam.copy()
        for _ in range(3):
            Z = (lam * (1 + 2 * EPS))[:, None, None] * E + A
            v = _normed(solved(Z, (v @ E.T)[..., None])[..., 0])
            w = _normed(solved(Z.conj().transpose(0, 2, 1), (w @ E)[..., None])[..., 0])
            below = np.einsum("kn,kn->k", w.conj(), v @ E.T)
            step = -np.einsum("kn,kn->k", w.conj(), v @ A.T + lam[:, None] * (v @ E.T))
            with np.errstate(divide="ignore", invalid="ignore"):
                step = step / below
            lam = np.where(np.isfinite(step), lam + step, lam)
            lam = np.where(begin.imag == 0, lam.real, lam)
        good = np.abs(lam - begin) <= 1e-2 * np.abs(begin)
        good &= np.isfinite(v).all(axis=1) & np.isfinite(w).all(axis=1) & (below != 0)
        for i, ok, found, right, left, size in zip(group, good, lam, v, w, below, strict=True):
            if ok:
                values[i], V[:, i], W[:, i] = found, right, left / size.conj()
                if int(i) in mates:
                    j = mates[int(i)]
                    values[j], V[:, j], W[:, j] = values[i].conj(), V[:, i].conj(), W[:, i].conj()
    return values, V, W


def _normed(x: Complex) -> Complex:
    largest = np.max(np.abs(x), axis=-1, keepdims=True)
    return np.asarray(x / np.where(np.isfinite(largest) & (largest > 0), largest, 1.0))


def _left(E: Array, V: Complex) -> Complex:
    """Left vectors W with W^H E V = 1."""
    return np.asarray(solved((E @ V).astype(complex), np.eye(len(E), dtype=complex)).conj().T)


# -- errors


def _carried(E: Array, values: Complex, V: Complex, W: Complex, dE: Array, dA: Array) -> Array:
    """Bounds F (n, n) of the perturbation of diag(roots)."""
    left, right = np.abs(W).T, np.abs(V)
    F = left @ (dA @ right + dE @ (right * np.abs(values)))
    return np.where(np.isnan(F), np.inf, F)


def _discs(values: Complex, F: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Bounds of the errors of the roots (n,), and whether the disc of a root contains no other one."""
    n = len(values)
    own = np.diagonal(F).copy()
    beside = np.sqrt(F) * np.sqrt(F.T)
    np.fill_diagonal(beside, 0.0)
    gap = np.abs(values[:, None] - values)
    np.fill_diagonal(gap, np.inf)
    near = gap <= 4 * np.maximum(beside, np.maximum(own[:, None], own))
    if n > 1:
        near |= near.T
    group = connected_components(csr_matrix(near), directed=False)[1]
    same = group[:, None] == group
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(same, 0.0, 2 * beside / gap * beside)
    radius = own + np.nansum(far, axis=1) + np.sum(np.where(same, beside, 0.0), axis=1)
    reach = np.where(same, np.where(np.isfinite(gap), gap, 0.0) + radius, 0.0)
    return np.max(reach, axis=1, initial=0.0), np.sum(same, axis=1) == 1
