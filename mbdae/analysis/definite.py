"""Signs of symmetric matrices whose entries have errors."""

from __future__ import annotations

import numpy as np

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

