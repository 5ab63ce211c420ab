"""Accelerations and multipliers of constrained equations of motion, many states at once, also where some rows are redundant."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.deferred import issparse
from mbdae.system.base import Array

AT_ONCE = 1_000_000  #: number of entries of the matrices of states that are solved together, which bounds the memory
#: length of a constraint row in joint coordinates, over its length in the coordinates of all nodes, up to which it counts as 0
ROUND_OFF = 1e-12


def row_lengths(B: Any) -> Array:
    """Euclidean lengths (..., m, 1) of rows (..., m, n), sparse or not; 1 where a row is zero, so that one can divide by them."""
    if issparse(B):
        lengths = np.sqrt(np.asarray(B.multiply(B).sum(axis=1))).reshape(-1, 1)
    else:
        lengths = np.linalg.norm(B, axis=-1, keepdims=True)
    return np.where(lengths > 0, lengths, 1.0)


def largest_entries(B: Any) -> Array:
    """(m,) magnitude of the largest entry of every row of B (m, n), sparse or not."""
    if issparse(B) and B.shape[1]:
        return np.asarray(abs(B).max(axis=1).toarray())[:, 0]
    return np.zeros(B.shape[0]) if issparse(B) else np.asarray(np.max(np.abs(B), axis=1, initial=0.0))


def unique_multipliers(B: Array, redundant: int, mass: float, whole: Array) -> Array:
    """E (nt, m, m) of G u' - E lambda = -gamma, which makes the multipliers unique although `redundant` rows of G follow from
    others.

    Accelerations are the same as without E, and lambda is the one of least norm; in the norm each multiplier counts by its work
    in a unit displacement (the scene's length or 1 rad), so that forces and moments can be compared. B (nt, m, nu): columns of G
    times unit displacements; mass: typical mass of a unit displacement; whole (nt, m): lengths of the rows in the coordinates of
    all nodes, used for rows that joint coordinates satisfy by themselves, whose length in B is 0."""
    lengths = np.linalg.norm(B, axis=2)
    lengths = np.where(lengths > ROUND_OFF * whole, lengths, whole)[:, :, None]
    lengths[lengths == 0] = 1.0
    null = np.linalg.svd(B / lengths)[0][:, :, B.shape[1] - redundant :] * lengths
    return np.asarray(null @ null.transpose(0, 2, 1) / mass)


def least_norm(B: Array, force: Array) -> Array:
    """Multipliers lambda (nt, m) with B^T lambda = force, of least norm as in `unique_multipliers`. B (nt, m, nu): columns of G
    times unit displacements; force (nt, nu): generalised forces times unit displacements."""
    lengths = row_lengths(B)
    found = [np.linalg.lstsq(b.T, f, rcond=1e-9)[0] for b, f in zip(B / lengths, force, strict=True)]
    return np.asarray(np.array(found).reshape(lengths.shape[:2]) / lengths[:, :, 0])


def solve_constrained(M: Array, f: Array, G: Array, gamma: Array, units: Array, slope: Array | None = None,
                      E: Array | None = None) -> tuple[Array, Array]:  # fmt: skip
    """u' (nt, nu), lambda (nt, m) of M u' + (G^T - slope) lambda = f (nt, nu), G u' - E lambda = -gamma (nt, m).

    M (nu, nu) or (nt, nu, nu); slope (nt, nu, m): derivative of friction by lambda; E: see `unique_multipliers`; units (nu,):
    scale of u' in the norm that chooses a solution where the matrix is singular."""
    nu, n = f.shape[1], f.shape[1] + gamma.shape[1]
    M = np.broadcast_to(M, (len(f), nu, nu))
    scale, right, out = np.r_[units, np.ones(n - nu)], np.hstack([f, -gamma]), np.empty((len(f), n))
    size = max(1, AT_ONCE // n**2)
    for part in (slice(i, i + size) for i in range(0, len(f), size)):
        K = np.zeros((len(f[part]), n, n))
        K[:, :nu, :nu], K[:, :nu, nu:], K[:, nu:, :nu] = M[part], G[part].transpose(0, 2, 1), G[part]
        if slope is not None:
            K[:, :nu, nu:] -= slope[part]
        if E is not None:
            K[:, nu:, nu:] = -E[part]
        out[part] = _solved(K, right[part], scale)
    return out[:, :nu], out[:, nu:]


def _solved(K: Array, right: Array, scale: Array) -> Array:
    """Solutions (nt, n) of K x = right for many states: all at once, and one by one where a K is singular, see `_solve`."""
    try:
        x = np.linalg.solve(K, right[:, :, None])
    except np.linalg.LinAlgError:
        return np.array([_solve(k, b, scale) for k, b in zip(K, right, strict=True)]).reshape(right.shape)
    missed = np.linalg.norm((K @ x)[:, :, 0] - right, axis=1) > 1e-8 * (np.linalg.norm(right, axis=1) + 1e-300)
    x = x[:, :, 0]
    for i in np.flatnonzero(missed | ~np.isfinite(x).all(axis=1)):
        x[i] = _solve(K[i], right[i], scale)
    return np.asarray(x)


def _solve(K: Array, right: Array, scale: Array) -> Array:
    """Solution of K x = right; where K is singular, the least-squares solution with the smallest norm of x / scale."""
    try:
        x = np.asarray(np.linalg.solve(K, right), dtype=float)
        if np.all(np.isfinite(x)) and np.linalg.norm(K @ x - right) <= 1e-8 * (np.linalg.norm(right) + 1e-300):
            return x
    except np.linalg.LinAlgError:
        pass
    return np.asarray(scale * np.linalg.lstsq(K * scale, right, rcond=1e-12)[0], dtype=float)
