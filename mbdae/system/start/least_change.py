"""The smallest change of positions or velocities, weighted by mass, that satisfies linear conditions; the start closes loops by
it."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.system.base import Array
from mbdae.system.motion.constrained import largest_entries, row_lengths

DEPENDENT = 1e-9  #: singular value of rows of unit length (in least squares: over the largest) up to which it counts as 0


def least_change(A: Array, right: Array, root: Array, massless: Any, stated: Array, off: Array) -> Array:
    """x (n,) by three requirements, each as far as those before it allow: A x = right (least squares), then stated @ x as near to
    `off` (s,) as possible, then x of the smallest size, sqrt(x^T M x).

    A (rows, n); stated (s, n): conditions that are only to be met as well as possible; root: Cholesky factor of the mass matrix M
    of the coordinates that have mass; massless (n,) bool: joint coordinates, which have no mass of their own and follow from the
    rows of A that contain them."""
    heavy, x = ~massless, np.zeros(len(massless))
    rows, values, pivots = _without(A, right, np.flatnonzero(massless))
    left = np.array([row for row in range(len(A)) if row not in set(pivots.values())], dtype=np.intp)
    scaled, wanted = (np.asarray(np.linalg.solve(root, part.T).T) for part in (rows[np.ix_(left, heavy)], stated[:, heavy]))
    sizes, lengths = row_lengths(scaled), row_lengths(wanted)
    scaled, wanted = scaled / sizes, wanted / lengths
    # y = root^T x, so that |y| is the size of x; free: stated rows, projected on the motions that A x = right leaves free
    found = np.linalg.lstsq(scaled, np.column_stack([values[left] / sizes[:, 0], scaled @ wanted.T]), rcond=DEPENDENT)[0]
    y, free = found[:, 0], wanted - found[:, 1:].T
    y = y + _pseudo_inverse(free) @ (off / lengths[:, 0] - wanted @ y)
    x[heavy] = np.linalg.solve(root.T, y)
    for column, p in pivots.items():
        x[column] = (values[p] - rows[p, heavy] @ x[heavy]) / rows[p, column]
    return x


def violations(g: Array, B: Any) -> Array:
    """(m,) violation of constraints g (m,) as a displacement: |g| over the magnitude of the largest entry of the row of B (m, n),
    the constraint Jacobian in unit displacements, sparse or not."""
    size = largest_entries(B)
    return np.asarray(np.abs(g) / np.where(size > 0, size, 1.0))


def largest_violation(g: Array, B: Any) -> float:
    """The largest of the violations of constraints g (m,), see `violations`; 0 where there are no constraints."""
    return float(np.max(violations(g, B), initial=0.0))


def _without(A: Array, right: Array, columns: Any) -> tuple[Array, Array, dict[int, int]]:
    """The equations A x = right after eliminating these columns: each remains in one row only. Returns matrix, right-hand side,
    and column -> number of this row."""
    A, right = A.copy(), right.copy()
    pivots: dict[int, int] = {}
    for column in columns:
        size = np.abs(A[:, column])
        size[list(pivots.values())] = 0.0
        p = int(np.argmax(size)) if len(size) else 0
        if not len(size) or size[p] == 0:
            continue
        factor = A[:, column] / A[p, column]
        factor[p] = 0.0
        A -= np.outer(factor, A[p])
        A[:, column][np.arange(len(A)) != p] = 0.0
        right -= factor * right[p]
        pivots[int(column)] = p
    return A, right, pivots


def _pseudo_inverse(A: Array) -> Array:
    """Pseudo-inverse (n, rows) of A, with singular values below `DEPENDENT` taken as zero."""
    U, sizes, V = np.linalg.svd(A, full_matrices=False)
    kept = sizes > DEPENDENT
    return np.asarray(V[kept].T @ (U[:, kept] / sizes[kept]).T)
