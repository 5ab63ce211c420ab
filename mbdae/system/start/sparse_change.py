"""Changes of positions or velocities that satisfy linear conditions and minimise a quadratic function, by sparse matrices."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from mbdae.deferred import as_full, sp, splu
from mbdae.system.base import Array
from mbdae.system.motion.constrained import largest_entries

CORRECTIONS = 5
#: conditions get this compliance, relative to that of the stiffest unknown (1 over the largest diagonal entry of W), which keeps
#: the matrix regular if they are redundant; iterations remove the error
GIVEN = 1e-10
STATED = 1e-5  #: the same for stated velocities: larger, so that conditions prevail where stated velocities contradict them


def cheapest(W: Any, units: Array, A: Any, right: Array, pull: Array, give: Array | None = None) -> Array:
    """x (nu,) with A x = right (m,) that minimises x^T W x / 2 - pull^T x; rows of A (m, nu) may be redundant.

    W (nu, nu) is positive definite, sparse or full; units (nu,): unit displacements, by which unknowns are scaled; give (m,):
    compliances of the conditions, by default `GIVEN`. Where conditions contradict each other, those with the larger compliance
    are violated."""
    whole, pull = isinstance(W, np.ndarray), pull * units
    A, W = (as_full(A) * units, units[:, None] * W * units) if whole else (
        sp.csr_matrix(A) @ sp.diags(units), sp.diags(units) @ W @ sp.diags(units))  # fmt: skip
    size = largest_entries(A)
    size[size == 0] = 1.0
    stiff = float(np.max(W.diagonal()))
    share = stiff / size  # rows get entries as large as those of W
    A, right = share[:, None] * A if whole else sp.diags(share) @ A, share * right
    corner = -stiff * (np.full(A.shape[0], GIVEN) if give is None else give)
    solve = partial(np.linalg.solve, np.block([[W, A.T], [A, np.diag(corner)]])) if whole else (
        splu(sp.bmat([[W, A.T], [A, sp.diags(corner)]], format="csc")).solve)  # fmt: skip
    x, forces = np.zeros(len(units)), np.zeros(A.shape[0])
    for _ in range(CORRECTIONS):
        step = solve(np.r_[pull - W @ x - A.T @ forces, right - A @ x])
        x, forces = x + step[: len(x)], forces + step[len(x) :]
    return np.asarray(x * units)


def sparse_least_change(A: Any, right: Array, weight: Any, units: Array, stated: Any, off: Array,
                        pull: Array | None = None) -> Array:  # fmt: skip
    """As `least_change.least_change`, for many bodies: x (n,) with A x = right, then with stated @ x nearest to `off`, then with
    the smallest x^T W x / 2 - pull^T x, where W is `weight` (n, n) and pull (n,) by default 0. units (n,): unit displacements."""
    give = np.r_[np.full(A.shape[0], GIVEN), np.full(stated.shape[0], STATED)]
    return cheapest(weight, units, sp.vstack([A, stated]), np.r_[right, off],
                    np.zeros(len(units)) if pull is None else pull, give)
