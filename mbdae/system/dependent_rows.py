"""Constraint rows that follow from each other: their rank, and which of them are integrated.

An over-constrained mechanism has more constraint rows than its motion needs. Which of them can be left out depends on the
position: rows that determine the motion in one position may depend on each other in another, although the rank of all rows is the
same. So the rows that are integrated, called rows in force, are chosen from the geometry of the present position, and chosen
again before they become dependent (`rows_in_force`).

Combinations of constraint rows that nearly vanish in a position, and what they mean for the motion there.

The rows B (m, nu) have unit length, in unit displacements (the scene's length, 1 rad). Where a combination w^T B = s v^T with
|w| = |v| = 1 has a small length s, the motion v is hardly forbidden. Prescribed values ask for velocities u with B u = -r, where
r are their rates over the lengths of the rows, and so for the speed -w^T r / s along v: it grows without bound where s goes to 0
and w^T r does not. With the curvature c = w^T g''(v, v) of the rows, another branch of the motion is 2 s / c away along v, and
the states between both violate the rows by s^2 / (2 c) at most.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from mbdae.deferred import LinearOperator, eigsh, issparse, qr, sp, splu
from mbdae.system.base import Array
from mbdae.system.model.numbering import Row
from mbdae.system.motion.constrained import row_lengths
from mbdae.system.motion.mechanics import Mechanics, in_units

#: a row of unit length counts as dependent if its distance from the span of the independent rows before it (its independent part)
#: is at most this; a singular value of such rows counts as 0 if it is at most this
DEPENDENT = 2e-6
SHIFT = 1e-12  #: added to the diagonal of a singular B B^T so that it can be factorised; less than the square of `DEPENDENT`
CLEAR = 0.1  #: rows with an independent part above this are chosen first, in their order; then always the best of the others
MOST_TRIPLETS = 6  #: largest number of singular values, the smallest first, that `smallest_triplets` returns
Rows = tuple[Row, ...]
#: other rows are chosen where the smallest singular value of the rows in force falls below this part of that of the best choice,
#: except in a singular position, where no choice is good
WORN = 0.2


def unit_rows(mechanics: Mechanics, G: Any) -> Any:
    """The rows of G with columns in unit displacements (the scene's length, 1 rad), scaled to unit length; sparse where G is."""
    B = in_units(mechanics, G)
    return sp.diags(1 / row_lengths(B)[:, 0]) @ B if issparse(B) else np.asarray(B / row_lengths(B))


def smallest_at(mechanics: Mechanics, rank: int, t: Array, q: Array) -> Array:
    """(nt,) the smallest singular value of all rows, as by `smallest`, at states t (nt,), q (nt, nq)."""
    if mechanics.large or not rank:
        return np.array([smallest(unit_rows(mechanics, G), rank) for G in mechanics.sparse_constraint_jacobian(t, q)])
    return np.asarray(np.linalg.svd(unit_rows(mechanics, mechanics.constraint_jacobian(t, q)), compute_uv=False)[:, rank - 1])


def least_parts(mechanics: Mechanics, rank: int, t: Array, q: Array) -> Array:
    """(nt,) the smallest part of a row that is independent of the rows before it, at states t (nt,), q (nt, nq): it falls to 0
    where the smallest singular value does, and takes a third of the time. With redundant or many rows, that value itself."""
    if mechanics.large or rank < mechanics.m:
        return smallest_at(mechanics, rank, t, q)
    B = unit_rows(mechanics, mechanics.constraint_jacobian(t, q))
    R = np.asarray(np.linalg.qr(B.swapaxes(1, 2), mode="r"))
    return np.asarray(np.min(np.abs(R.diagonal(axis1=1, axis2=2)), axis=1))


def smallest(B: Any, rank: int) -> float:
    """The smallest singular value of rows B (m, n) that is not 0 because of their rank: number `rank` in descending order; 1
    where there are no rows."""
    if not rank:
        return 1.0
    B = _full_where_few(B)
    return _smallest_sparse(B, rank, 1)[0][0] if issparse(B) else float(np.linalg.svd(B, compute_uv=False)[rank - 1])


def smallest_triplets(B: Any, rank: int, below: float) -> list[tuple[float, Array, Array]]:
    """Singular values of unit rows B (m, n) with their left and right singular vectors, w (m,) and v (n,): the smallest that is
    not 0 because of the rank, and those less than `below`, MOST_TRIPLETS at most, in rising order."""
    B = _full_where_few(B)
    if issparse(B):
        found = _smallest_sparse(B, rank, MOST_TRIPLETS)
    else:
        left, sizes, right = np.linalg.svd(B, full_matrices=False)
        found = [(float(sizes[i]), left[:, i], right[i]) for i in range(rank - 1, max(rank - 1 - MOST_TRIPLETS, -1), -1)]
    return [one for i, one in enumerate(found) if i == 0 or one[0] < below]


def _full_where_few(B: Any) -> Any:
    """Sparse rows as a full array where they are as few as MOST_TRIPLETS: Arnoldi's method finds fewer values than there are
    rows."""
    return B.toarray() if issparse(B) and B.shape[0] <= MOST_TRIPLETS else B


def _smallest_sparse(B: Any, rank: int, count: int) -> list[tuple[float, Array, Array]]:
    """The `count` smallest singular values of sparse unit rows that are not 0 because of the rank, with their vectors."""
    m, n = B.shape
    gram, random = sp.csc_matrix(B @ B.T), np.random.default_rng(3)
    if rank < m:  # in the space of motions, where combinations of rows that vanish everywhere do not appear
        solve = _solve(gram, SHIFT)
        operator = LinearOperator((n, n), matvec=lambda x: B.T @ solve(solve(B @ x)), dtype=float)
        squares, motions = eigsh(operator, k=min(count, rank, n - 1), which="LA", v0=random.normal(size=n), tol=1e-4)
        combined = [_unit(solve(B @ v)) for v in motions.T]
        return sorted(((float(1 / np.sqrt(square)), w, v) for square, w, v in zip(squares, combined, motions.T, strict=True)),
                      key=lambda found: found[0])
    try:
        solve = _solve(gram, 0.0)
    except RuntimeError:  # a pivot is 0
        solve = _solve(gram, SHIFT)
    operator = LinearOperator((m, m), matvec=solve, dtype=float)
    _, combinations = eigsh(operator, k=min(count, m - 1), which="LA", v0=random.normal(size=m), tol=1e-4)
    lengths = [(float(np.linalg.norm(B.T @ w)), w) for w in combinations.T]
    return [(size, w, B.T @ w / max(size, 1e-300)) for size, w in sorted(lengths, key=lambda found: found[0])]


def _solve(gram: Any, shift: float) -> Callable[[Array], Array]:
    """The function b -> x with (gram + shift I) x = b, for a sparse symmetric matrix; RuntimeError where it is singular."""
    shifted = gram + shift * sp.identity(gram.shape[0], format="csc")
    factors = splu(shifted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    solve: Callable[[Array], Array] = factors.solve
    return solve


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


def independent_parts(B: Array) -> Array:
    """(m,) distance of every row (unit length) from the span of the independent rows before it."""
    basis = np.zeros((0, B.shape[1]))
    out = np.zeros(len(B))
    for i, row in enumerate(B):
        left = _without(row, basis)
        out[i] = np.linalg.norm(left)
        if out[i] > DEPENDENT:
            basis = np.vstack([basis, left / out[i]])
    return out


def rows_in_order(B: Array, rank: int, always: Sequence[int]) -> list[int]:
    """Numbers (rank,) of independent rows: those in `always`, then in their order those with an independent part above CLEAR,
    then always the one with the largest independent part."""
    chosen, basis = list[int](), np.zeros((0, B.shape[1]))
    left = B.copy()

    def take(i: int) -> None:
        nonlocal basis, left
        direction = _without(left[i], basis)
        direction = direction / max(float(np.linalg.norm(direction)), 1e-300)
        basis, left = np.vstack([basis, direction]), left - np.outer(left @ direction, direction)
        chosen.append(i)

    for i in always:
        take(i)
    for i in range(len(B)):
        if i not in chosen and len(chosen) < rank and np.linalg.norm(left[i]) > CLEAR:
            take(i)
    while len(chosen) < rank:
        sizes = np.linalg.norm(left, axis=1)
        sizes[chosen] = -1.0
        take(int(np.argmax(sizes)))
    return chosen


def best_rows(B: Array, rank: int, always: Sequence[int]) -> list[int]:
    """Numbers (rank,) of independent, well-conditioned rows: those in `always`, then those that QR with column pivoting
    chooses."""
    basis = np.linalg.qr(B[list(always)].T)[0] if len(always) else np.zeros((B.shape[1], 0))
    others = np.array([i for i in range(len(B)) if i not in set(always)], dtype=int)
    left = B[others] - (B[others] @ basis) @ basis.T
    _, order = qr(left.T, mode="r", pivoting=True)
    return [*always, *(int(i) for i in others[order[: rank - len(always)]])]


def chosen_rows(B: Array, rank: int, always: Sequence[int]) -> list[int]:
    """Numbers (rank,) of the rows to be integrated from the start: by `rows_in_order`, in the order of the scene, if these are
    conditioned well enough, else by `best_rows`."""
    ordered, other = rows_in_order(B, rank, always), best_rows(B, rank, always)
    return ordered if smallest(B[ordered], rank) >= WORN * smallest(B[other], rank) else other


def _without(row: Array, basis: Array) -> Array:
    """The component of a row (n,) orthogonal to an orthonormal basis (k, n); projected twice to remove round-off of the first
    time."""
    for _ in range(2):
        row = row - basis.T @ (basis @ row)
    return row


ASIDE = 1e-4  #: displacement along v, in unit displacements, of the second difference that gives the curvature
SMALLEST = 1e-300  #: least value of a divisor: a singular value or twice a curvature, which may be 0


class Dependency(NamedTuple):
    """A combination of rows: its length s; its coefficients w (m,); the motion v (nu,) in unit displacements; the part (m,) of
    every row in the speed along v that prescribed values ask for, in unit displacements per s; the curvature c."""

    value: float
    rows: Array
    motion: Array
    speeds: Array
    curvature: float

    @property
    def speed(self) -> float:
        """The largest rate of an unknown, in unit displacements per s, that prescribed values ask for by this motion."""
        return float(abs(np.sum(self.speeds)) * np.max(np.abs(self.motion)))

    @property
    def between(self) -> float:
        """Violation of the rows by the states between both branches, over the scene's length or in rad."""
        return self.value**2 / max(2 * self.curvature, SMALLEST)


def dependencies(mechanics: Mechanics, rank: int, t: float, q: Array, below: float = 0.0) -> list[Dependency]:
    """The dependencies of rows at time t (s) and positions q (nq,), the one with the smallest value first: this one, and further
    ones (up to `rows.MOST_TRIPLETS` in all) with values less than `below`. rank: of all rows, redundant ones among them."""
    at, here = np.array([t]), q[None]
    G = mechanics.constraint_matrix(at, q)
    lengths = row_lengths(in_units(mechanics, G))[:, 0]
    rates = mechanics.velocity_residual(at, here, np.zeros((1, mechanics.nu)))[0] / lengths
    found = []
    for value, w, v in smallest_triplets(unit_rows(mechanics, G), rank, below):
        step = ASIDE * v * mechanics.velocity_units
        beside = [mechanics.integrate_positions(q, sign * step) for sign in (1.0, 0.0, -1.0)]
        there, middle, back = (mechanics.position_residual(at, p[None])[0] / lengths for p in beside)
        curvature = abs(float(w @ (there - 2 * middle + back))) / ASIDE**2
        found.append(Dependency(value, w, v, -w * rates / max(value, SMALLEST), curvature))
    return found
