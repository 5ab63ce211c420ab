"""Parts of `redundancy.analyse` for many rows, by sparse elimination (`large.SparseRows`) instead of dense matrices."""

from __future__ import annotations

from collections.abc import Container
from typing import Any

import numpy as np

from mbdae.deferred import qr, sp
from mbdae.system.base import Array
from mbdae.system.model.numbering import Row
from mbdae.system.motion.constrained import row_lengths
from mbdae.system.motion.mechanics import Mechanics, in_units
from mbdae.system.rank.large import SparseRows, Whole
from mbdae.system.rank.rows import DEPENDENT, smallest, unit_rows

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
                     limits: tuple[float, float]) -> list[tuple[int, float]]:  # fmt: skip
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
