"""Which constraint rows say nothing new, by the rank of all in several consistent positions."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, field

import numpy as np

from mbdae.errors import StartError
from mbdae.system.base import Array
from mbdae.system.mechanics import Mechanics
from mbdae.system.numbering import Row
from mbdae.system.rows import DEPENDENT, chosen_rows, in_order, novelty, smallest, unit_rows
from mbdae.system.scaling import position_scale
from mbdae.system.start import Starter

CERTAIN, DOUBTFUL = 1e-8, 1e-3  #: between the two: nearly redundant, reported whether kept or left out
SAMPLES = 3
STEPS = (0.3, 0.1, 0.03)  #: rad, or parts of the scene's length, by which other positions are tried
LEAST = 0.02  #: part of such a step that has to be left when the loops are closed


@dataclass
class RankReport:
    """Rank of all constraint rows, and what follows from it.

    kept and dropped rows, rows nearly redundant (among either), rows dependent at the start only, and the freedoms. Which of
    the rows are kept holds for the start: a run chooses others where these go bad (`RowsInForce`)."""

    kept: list[Row]
    dropped: list[Row] = field(default_factory=list)
    doubtful: list[tuple[Row, float]] = field(default_factory=list)
    singular_here: list[Row] = field(default_factory=list)
    not_unique: list[Row] = field(default_factory=list)  #: rows whose reactions the redundant ones could share
    degrees_of_freedom: int = 0
    smallest: float = 1.0  #: smallest singular value that counts of all rows, of unit length


def analyse(mechanics: Mechanics, starter: Starter, q: Array, always: Container[Row] = ()) -> RankReport:
    """Rank of all constraint rows: the largest at the start and in other consistent positions.

    always: rows that recursive joints and shared displacements satisfy; they are kept."""
    if not mechanics.m:
        return RankReport([], degrees_of_freedom=mechanics.nu)
    closing = {c.name for c in starter.tree.closing}
    order = sorted(range(mechanics.m), key=lambda i: (mechanics.rows[i] not in always,
                                                      mechanics.rows[i].name.rsplit(".", 1)[0] in closing))  # fmt: skip
    rows, first = [mechanics.rows[i] for i in order], range(sum(row in always for row in mechanics.rows))
    here = _rows_at(mechanics, starter.t, q)[order]
    new = novelty(here)
    dependent = {row.name for row, part in zip(rows, new, strict=True) if part <= DEPENDENT}
    elsewhere = _other_positions(mechanics, starter, q, dependent) if closing else []  # a tree has no dependent rows anywhere
    places = [here, *(_rows_at(mechanics, starter.t, p)[order] for p in elsewhere)]
    ranks = [int(np.sum(novelty(B) > DEPENDENT)) for B in places]
    rank, at_start = max(ranks), ranks[0]
    chosen = chosen_rows(here, at_start, first) if at_start < len(rows) else list(range(len(rows)))
    singular = set[int]()
    if at_start < rank:  # the start is a singular position: rows that are new elsewhere make up for those that are not here
        chosen = in_order(places[int(np.argmax(ranks))], rank, chosen)
        singular = set(chosen[at_start:])
    report = RankReport([row for row in mechanics.rows if row in {rows[i] for i in chosen}])
    report.degrees_of_freedom, report.smallest = mechanics.nu - rank, smallest(here, rank)
    report.dropped = [row for i, row in enumerate(rows) if i not in set(chosen)]
    report.singular_here = [rows[i] for i in sorted(singular)]
    report.doubtful = _nearly(rows, chosen, singular, places)
    report.not_unique = [rows[i] for i in _dependent_on_others(here)] if report.dropped else []
    return report


def _nearly(rows: list[Row], chosen: list[int], singular: set[int], places: list[Array]) -> list[tuple[Row, float]]:
    """Rows that are left out although they are not quite dependent, and rows that are kept although they nearly are."""
    kept, left = sorted(set(chosen) - singular), [i for i in range(len(rows)) if i not in set(chosen)]
    parts = novelty(places[0][kept])
    found = [(rows[i], float(part)) for i, part in zip(kept, parts, strict=True) if DEPENDENT < part < DOUBTFUL]
    sound = [B for B in places if smallest(B[chosen], len(chosen)) > DOUBTFUL]
    for i in left if sound else ():
        part = max(float(novelty(np.vstack([B[chosen], B[i]]))[-1]) for B in sound)
        if part > CERTAIN:
            found.append((rows[i], part))
    return found


def _dependent_on_others(B: Array) -> list[int]:
    """Rows whose multiplier can change without any effect: they take part in a dependency."""
    left, sizes, _ = np.linalg.svd(B)
    null = left[:, int(np.sum(sizes > DEPENDENT)) :]
    return [int(i) for i in np.flatnonzero(np.max(np.abs(null), axis=1, initial=0.0) > 1e-6)]


def _rows_at(mechanics: Mechanics, t: Array, q: Array) -> Array:
    return unit_rows(mechanics, mechanics.constraint_jacobian(t, q[None])[0])


def _other_positions(mechanics: Mechanics, starter: Starter, q: Array, dependent: set[str]) -> list[Array]:
    """Consistent positions reached by moving along the freedoms (drives released) and closing the loops again; where
    nearly dependent rows lock the loops, they are released too."""
    free = [row for row in mechanics.rows if not row.name.endswith(".drive")]
    found: list[Array] = []
    for rows in (free, [row for row in free if row.name not in dependent]):
        released = Mechanics(mechanics.model, rows)
        closer = Starter(released, float(starter.t[0]), holding=False)
        freedoms, rng = free_motions(released, closer.t, q, closer), np.random.default_rng(11)
        for _ in range(SAMPLES if freedoms.size else 0):
            direction = freedoms @ rng.normal(size=freedoms.shape[1])
            found += _moved(closer, q, direction / np.max(np.abs(direction)) * closer.units(q))
        if found or not dependent:
            break
    return found


def _moved(closer: Starter, q: Array, direction: Array) -> list[Array]:
    """The position a step in a direction leads to once the loops are closed again; none where they close at no step, or only by
    going back: a position near one that cannot be left violates the loops by less than closing sees."""
    for step in STEPS:
        try:
            found = closer.close(closer.moved(q, step * direction))
        except StartError:
            continue
        if np.max(np.abs(found - q) / position_scale(closer.mechanics)) > LEAST * step:
            return [found]
    return []


def free_motions(mechanics: Mechanics, t: Array, q: Array, starter: Starter) -> Array:
    """(coordinates, freedoms) basis of the motions the constraints leave to rigid beams, over unit displacements."""
    G = mechanics.constraint_jacobian(t, q[None])[0]
    return null_space((G @ starter.rigid.basis(q) if mechanics.model.lines else G) * starter.units(q))


def null_space(A: Array) -> Array:
    """Orthonormal basis (n, k) of the x with A x = 0; rows of A (m, n) of about the same size."""
    if not len(A):
        return np.eye(A.shape[1])
    _, sizes, V = np.linalg.svd(A, full_matrices=True)
    return np.asarray(V[int(np.sum(sizes > 1e-9 * sizes[0])) :].T)
