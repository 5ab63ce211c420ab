"""Rank of many constraint rows by sparse elimination: which rows follow from others, and which motions all rows allow.

B are the rows, scaled to unit length. B B^T is factorised in an order with little fill-in; its pivots are the squared distances
of rows from the span of the rows before them. Squares lose half of the digits: rows with a small pivot are left aside at first,
and their component orthogonal to all other rows is then computed by repeated projection, which loses no digits. Among these few
rows those with the largest component are taken first. Where the projections do not converge because rows are too nearly
dependent, dense matrices decide (for `DENSE` rows at most).

Parts of `redundancy.analyse` for many rows, by sparse elimination (`large.SparseRows`) instead of dense matrices.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from copy import copy
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import distinct, qr, sp, splu
from mbdae.errors import SceneError
from mbdae.native import Entries, Order, Orders
from mbdae.native.sparse import Factors
from mbdae.system.base import Array
from mbdae.system.dependent_rows import DEPENDENT, smallest, unit_rows
from mbdae.system.model.numbering import Row
from mbdae.system.motion.constrained import row_lengths
from mbdae.system.motion.mechanics import Mechanics, in_units

Whole = NDArray[np.intp]
#: number of repeated projections, and change of a unit vector by the last one up to which they count as converged (else
#: NotResolvedError)
PASSES, ROUND_OFF = 3, 1e-9
AT_ONCE = 64  #: number of vectors that are projected together
#: the independent part of a row of unit length is its distance from the span of the rows before it. Elimination leaves rows aside
#: whose independent part is at most the first of these limits; if more than FEW of those turn out to be independent, the next
#: limit is tried, and after the last one NotResolvedError is raised
LIMITS = (1e-3, 1e-4, 1e-5)
FEW = 500
DENSE = 3000  #: number of rows up to which dense matrices decide where sparse ones cannot; with more the scene is refused
#: magnitude of the coefficient of a row in a vanishing linear combination of unit rows, with coefficients of unit length, above
#: which the row counts as part of it
TAKES_PART = 1e-6


def order_of(pattern: Any, first: Sequence[int], label: Any) -> Whole:
    """An order in which eliminating a matrix of products of rows, with this sparsity pattern, has little fill-in. first: numbers
    of rows that come before all others; label (m,): number of the joint of every row, whose rows stay together in their order."""
    count = int(np.max(label, initial=-1)) + 1
    member = sp.csr_matrix((np.ones(len(label)), (label, np.arange(len(label)))), shape=(count, len(label)))
    joined = member @ abs(pattern) @ member.T
    joined.data[:] = 1.0
    place = splu((joined + sp.identity(count) * (2.0 * count)).tocsc(), permc_spec="MMD_AT_PLUS_A",
                 options={"SymmetricMode": True}).perm_c
    later = np.ones(len(label), dtype=bool)
    later[list(first)] = False
    return np.lexsort((np.arange(len(label)), place[label], later))


class SparseRows:
    """Sparse constraint rows B (m, n) of unit length, with a choice of independent rows that span all rows.

    always: numbers of rows that are chosen first; label (m,): number of the joint of every row. kept: numbers of the chosen rows,
    ascending; left: numbers of the others; parts (m,): of rows that elimination left aside the length of the component orthogonal
    to all others, 1 for all other rows."""

    def __init__(self, B: Any, always: Sequence[int] = (), label: Any = None) -> None:
        self.B, self.m = sp.csr_matrix(B), B.shape[0]
        label = np.arange(self.m) if label is None else np.asarray(label)
        self._gram = sp.csc_matrix(self.B @ self.B.T)
        self.order = order_of(self._gram, always, label)
        self.parts = np.ones(self.m)
        self._take(self._chosen())

    def _take(self, kept: Whole) -> None:
        self.kept, self.left = kept, np.setdiff1d(np.arange(self.m), kept)
        self._solve = self._factors(kept)

    def spanning(self, kept: Whole) -> SparseRows:
        """A copy with another choice of rows, `kept`."""
        other = copy(self)
        other.__dict__.pop("dependencies", None)
        other._take(kept)
        return other

    @property
    def rank(self) -> int:
        """Number of independent rows."""
        return len(self.kept)

    def _chosen(self) -> Whole:
        for limit in LIMITS:
            aside = self._eliminated(limit)
            self._take(np.setdiff1d(np.arange(self.m), aside))
            sizes, near = np.zeros(len(aside)), list[Array]()
            for some in _pieces(len(aside)):
                remaining = self.remainders(aside[some])
                sizes[some] = np.linalg.norm(remaining, axis=1)
                near += list(remaining[sizes[some] > DEPENDENT])
                if len(near) > FEW:
                    break
            else:
                break
        else:
            raise NotResolvedError
        self.parts[aside] = sizes
        new = aside[np.flatnonzero(sizes > DEPENDENT)[_newest(np.array(near))]] if near else aside[:0]
        return np.sort(np.r_[self.kept, new])

    def _eliminated(self, limit: float) -> Whole:
        """Numbers of the rows that elimination leaves aside: their distance from the span of the rows before is at most
        `limit`."""
        matrix = self._gram
        entries = Entries(self.m, matrix.indptr, matrix.indices)
        factors = Factors(Orders(entries, ()), float)
        factors.values[:] = matrix.data
        return np.flatnonzero(factors.left_out(Order(entries, self.order, self.order), limit**2))

    def _factors(self, rows: Whole) -> Callable[[Array], Array]:
        """The function b (k, ...) -> x with C C^T x = b, where C (k, n) are the rows with these numbers."""
        if not len(rows):
            return lambda b: b
        place = np.empty(self.m, dtype=int)
        place[self.order] = np.arange(self.m)
        order = np.argsort(place[rows])
        some = rows[order]
        factors = splu(self._gram[some][:, some].tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0,
                       options={"SymmetricMode": True})

        def solve(b: Array) -> Array:
            x = np.empty_like(b)
            x[order] = factors.solve(np.ascontiguousarray(b[order]))
            return x

        return solve

    def project(self, X: Array) -> Array:
        """Vectors X (n, k) projected on the space orthogonal to the chosen rows: the motions that these rows allow."""
        K, size = self.B[self.kept], np.linalg.norm(X, axis=0)
        for _ in range(PASSES if len(self.kept) else 0):
            change = K.T @ self._solve(K @ X)
            X = X - change
        if len(self.kept) and np.any(np.linalg.norm(change, axis=0) > ROUND_OFF * np.maximum(size, 1e-300)):
            raise NotResolvedError
        return X

    def remainders(self, rows: Whole) -> Array:
        """(k, n) components of some rows orthogonal to the span of the chosen rows."""
        return self.project(self.B[rows].toarray().T).T

    def sizes_of(self, rows: Whole) -> Array:
        """(k,) lengths of the components of some rows orthogonal to the span of the chosen rows."""
        return np.concatenate([np.zeros(0), *(np.linalg.norm(self.remainders(rows[p]), axis=1) for p in _pieces(len(rows)))])

    @cached_property
    def dependencies(self) -> sp.csr_matrix:
        """W (number of rows left, m): coefficients, of unit length, of vanishing linear combinations of rows; for every row in
        `left` one, of this row with the chosen ones."""
        K, parts = self.B[self.kept], []
        for piece in _pieces(len(self.left)):
            some = self.left[piece]
            right, Y = self.B[some].toarray().T, np.zeros((len(self.kept), len(some)))
            for _ in range(PASSES):
                Y += self._solve(K @ (right - K.T @ Y))
            W = np.zeros((len(some), self.m))
            W[:, self.kept] = -Y.T
            W[np.arange(len(some)), some] = 1.0
            W /= np.linalg.norm(W, axis=1, keepdims=True)
            W[np.abs(W) < 1e-14] = 0.0
            parts.append(sp.csr_matrix(W))
        return sp.vstack(parts).tocsr() if parts else sp.csr_matrix((0, self.m))

    @property
    def dependent(self) -> Whole:
        """Numbers of the rows that are part of a vanishing linear combination."""
        W = self.dependencies.tocoo()
        return distinct(W.col[np.abs(W.data) > TAKES_PART])


def _pieces(count: int) -> list[slice]:
    """Slices that divide `count` vectors into parts of `AT_ONCE`."""
    return [slice(first, first + AT_ONCE) for first in range(0, count, AT_ONCE)]


def _newest(rows: Array) -> Whole:
    """Numbers of rows, among these (k, n), that span all of them; those with the largest independent part first."""
    R, order = qr(rows.T, mode="r", pivoting=True)
    found: Whole = order[: int(np.sum(np.abs(np.diag(R)) > DEPENDENT))]
    return found


class NotResolvedError(Exception):
    """Constraint rows are so nearly dependent that the projections of `SparseRows` do not converge."""


def too_many(m: int) -> SceneError:
    """The error for m rows whose rank neither sparse nor dense matrices can determine."""
    return SceneError([f"which of the {m} constraint rows of the scene are redundant cannot be told, since they depend on each "
                       f"other nearly but not exactly, and more than {DENSE} are too many for full matrices: align the joints of "
                       "its loops exactly, or leave out joints that other joints make superfluous"])


SAMPLES = 3
ASIDE = 1e-4  #: displacement (rad, or part of the scene's length) for central differences of rows
#: derivative (per rad, or per scene's length) of a vanishing linear combination of rows above which it vanishes in the present,
#: singular position only
CHANGING = 2e-6


def numbers_of_joints(rows: list[Row]) -> Whole:
    """(m,) number of the joint that each row belongs to."""
    joints = {key: n for n, key in enumerate(dict.fromkeys((row.group, row.instance) for row in rows))}
    return np.array([joints[row.group, row.instance] for row in rows], dtype=np.intp)


def sparse_rows(mechanics: Mechanics, t: Array, q: Array, always: Container[Row] = ()) -> SparseRows:
    """The constraint rows at positions q (nq,), scaled to unit length; rows in `always` are the first to be chosen."""
    first = [i for i, row in enumerate(mechanics.rows) if row in always]
    return SparseRows(unit_rows(mechanics, mechanics.constraint_matrix(t, q)), first, numbers_of_joints(mechanics.rows))


def rank_lost_here(mechanics: Mechanics, t: Array, q: Array, here: SparseRows) -> tuple[int, Any]:
    """As `redundancy._rank_lost_here`, for sparse rows `here`: number of rows that depend on the others in this position alone,
    and the rows of unit length near it."""
    units, lengths = mechanics.velocity_units, row_lengths(in_units(mechanics, mechanics.constraint_matrix(t, q)))

    def rows_at(step: Array) -> Any:
        G = mechanics.constraint_matrix(t, mechanics.integrate_positions(q, step))
        return sp.diags(1 / lengths[:, 0]) @ in_units(mechanics, G)

    most, beside = 0, here.B
    for v in motions(mechanics, here, SAMPLES):
        step = ASIDE * v * units
        there, back = rows_at(step), rows_at(-step)
        change = sp.csr_matrix(here.dependencies @ ((there - back) / (2 * ASIDE)))
        sizes = np.sqrt(np.asarray(change.multiply(change).sum(axis=1)))[:, 0]
        changing = change[np.flatnonzero(sizes > CHANGING)].toarray()
        left = np.vstack([here.project(row[:, None])[:, 0] for row in changing]) if len(changing) else changing
        left = left[np.linalg.norm(left, axis=1) > CHANGING / 10] if len(left) else left
        found = int(np.sum(np.linalg.svd(left, compute_uv=False) > CHANGING)) if len(left) else 0
        if found > most:
            most, beside = found, sp.diags(1 / row_lengths(there)[:, 0]) @ there
    return most, beside


def motions(mechanics: Mechanics, here: SparseRows, count: int) -> list[Array]:
    """Up to `count` random motions (nu,) that the rows allow, those that prescribe coordinates left out; in unit displacements,
    with the largest entry 1. Only nodes with a constraint row move; the list is empty where nothing can move."""
    released = np.array([i for i, row in enumerate(mechanics.rows) if not row.prescribes], dtype=np.intp)
    space = here if len(released) == here.m else SparseRows(here.B[released])
    seen, rng = np.zeros(mechanics.nu), np.random.default_rng(11)
    touched = np.zeros(mechanics.nu, dtype=bool)
    touched[here.B.indices[here.B.data != 0]] = True
    for node in mechanics.model.nodes:
        own = slice(node.u, node.u + node.kind.sizes[1])
        seen[own] = np.any(touched[own])
    found = [seen * space.project(rng.normal(size=(mechanics.nu, 1)))[:, 0] for _ in range(count)]
    return [v / np.max(np.abs(v)) for v in found if np.max(np.abs(v), initial=0.0) > DEPENDENT]


def chosen_beside(here: SparseRows, beside: Any, rank: int) -> tuple[Whole, Whole]:
    """Numbers of the rows to keep in a singular position, and of those among them that are independent near this position only.
    here, beside: rows at the position and near it; rank: that near it."""
    there, missing = SparseRows(beside, [int(i) for i in here.kept]), rank - here.rank
    new = np.setdiff1d(there.kept, here.kept)[:missing]
    if len(new) < missing:  # so near the position some of the missing rows still count as dependent: take the best ones
        rest = there.spanning(here.kept).remainders(here.left)
        new = np.sort(here.left[qr(rest.T, mode="r", pivoting=True)[1][:missing]])
    return np.sort(np.r_[here.kept, new]), new


def nearly_redundant(here: SparseRows, kept: Whole, singular: Whole, others: list[SparseRows],
                     limits: tuple[float, float]) -> list[tuple[int, float]]:
    """As `redundancy._nearly_redundant`, for sparse rows: numbers of nearly redundant rows with the independent part of each.
    limits: CERTAIN and DOUBTFUL."""
    certain, doubtful = limits
    own = np.setdiff1d(kept, singular)
    found = [(int(i), float(here.parts[i])) for i in own if DEPENDENT < here.parts[i] < doubtful]
    left = np.setdiff1d(np.arange(here.m), kept)
    if not len(left):
        return found
    parts = np.zeros(len(left))
    for place in (here, *others):
        if smallest(place.B[kept], len(kept)) > doubtful:
            parts = np.maximum(parts, place.spanning(kept).sizes_of(left))
    return found + [(int(i), float(part)) for i, part in zip(left, parts, strict=True) if part > certain]
