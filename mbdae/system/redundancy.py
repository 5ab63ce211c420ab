"""Which constraint rows follow from the others: by the rank of all rows at the start, near it, and in other consistent
positions.

Which constraint rows of an over-constrained mechanism are integrated during a run.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mbdae.deferred import issparse
from mbdae.errors import StartError
from mbdae.system.base import Array
from mbdae.system.dependent_rows import (
    DEPENDENT,
    WORN,
    Rows,
    best_rows,
    chosen_rows,
    independent_parts,
    rows_in_order,
    smallest,
    unit_rows,
)
from mbdae.system.many_rows import (
    ASIDE,
    CHANGING,
    DENSE,
    SAMPLES,
    NotResolvedError,
    SparseRows,
    chosen_beside,
    motions,
    nearly_redundant,
    numbers_of_joints,
    rank_lost_here,
    sparse_rows,
    too_many,
)
from mbdae.system.model.numbering import Row
from mbdae.system.motion.constrained import row_lengths
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.start import Starter

#: rows of unit length that are reported as nearly redundant: kept rows whose independent part (distance from the span of the rows
#: before them) is between DEPENDENT (2e-6, `rows`) and DOUBTFUL at the start, and rows left out whose distance from the span of
#: the kept rows is above CERTAIN at the start or in another position in which the smallest singular value of the kept rows is
#: above DOUBTFUL
CERTAIN, DOUBTFUL = 1e-8, 1e-3
STEPS = (0.3, 0.1, 0.03)  #: displacements (rad, or over the scene's length) tried in turn to reach another consistent position
#: positions that are found without the rows that are dependent at the start are used, in the search for nearly redundant rows,
#: only if the largest violation of any row (m or rad) is below this times the scene's length; else they belong to another branch
#: of the motion
NEARBY = 1e-3


@dataclass
class RankReport:
    """Rank of all constraint rows, and which of them are redundant.

    kept, dropped: rows that are integrated, and redundant ones; doubtful: nearly redundant rows (kept or dropped), each with its
    independent part; singular_here: rows that depend on others at the start only. The kept rows are chosen for the start: a run
    chooses others before these become dependent (`RowsInForce`)."""

    kept: list[Row]
    dropped: list[Row] = field(default_factory=list)
    doubtful: list[tuple[Row, float]] = field(default_factory=list)
    singular_here: list[Row] = field(default_factory=list)
    #: rows whose reactions are not unique, at the start or in other positions, because redundant rows can carry a share of them
    not_unique: list[Row] = field(default_factory=list)
    elsewhere: list[Array] = field(default_factory=list, compare=False)  #: q (nq,) of other positions that the joints allow
    degrees_of_freedom: int = 0
    #: smallest singular value, at the start, of all rows scaled to unit length, without those that are 0 by redundancy
    smallest: float = 1.0

    @property
    def sharing(self) -> list[str]:
        """Names of the joints whose reactions are not unique."""
        return list(dict.fromkeys(row.name.rpartition(".")[0] for row in self.not_unique))

    @property
    def locking(self) -> list[str]:
        """Messages, one sentence each, on kept rows that are nearly redundant: they may lock the mechanism."""
        dropped = set(self.dropped)
        return [f"constraint row {row.name} is nearly redundant at the start (only {size:.1e} of it is independent of the "
                "others) and was kept: it takes a freedom because the joints of its loop are misaligned by about that part of "
                "the scene's length, or rad, or because the start is near a singular position; if the loop is meant to move, "
                "draw its points and axes exactly (calculated, not rounded), or leave out a joint that others make superfluous"
                for row, size in self.doubtful if row not in dropped]


def analyse(mechanics: Mechanics, starter: Starter, q: Array, always: Container[Row] = ()) -> RankReport:
    """Rank of all rows: the largest of that at the start, near it (`_rank_lost_here`) and in other consistent positions.

    starter: finds other positions; q (nq,): positions at the start; always: rows that recursive joints and shared displacements
    satisfy, which are kept."""
    if not mechanics.m:
        return RankReport([], degrees_of_freedom=mechanics.nu)
    if mechanics.large:
        try:
            return _analysed_sparse(mechanics, starter, q, always)
        except NotResolvedError:
            if mechanics.m > DENSE:
                raise too_many(mechanics.m) from None
    closing = {row.name.rsplit(".", 1)[0] for row in mechanics.rows} - {joint.name for _, joint, _ in starter.tree.edges}
    order = sorted(range(mechanics.m), key=lambda i: (mechanics.rows[i] not in always, mechanics.rows[i].by_rates,
                                                      mechanics.rows[i].name.rsplit(".", 1)[0] in closing))
    rows, first = [mechanics.rows[i] for i in order], range(sum(row in always for row in mechanics.rows))
    here = _rows_at(mechanics, starter.t, q)[order]
    dependent = {row.name for row, part in zip(rows, independent_parts(here), strict=True) if part <= DEPENDENT}
    elsewhere = _other_positions(mechanics, starter, q) if dependent and closing else []
    places = [here, *(_rows_at(mechanics, starter.t, p)[order] for p in elsewhere)]
    freed = _other_positions(mechanics, starter, q, dependent) if dependent and closing else []
    nearby = [_rows_at(mechanics, starter.t, p)[order] for p in freed
              if np.max(np.abs(mechanics.position_residual(starter.t, p[None]))) < NEARBY * mechanics.model.length]
    ranks = [int(np.sum(independent_parts(B) > DEPENDENT)) for B in places]
    at_start = ranks[0]
    lost, beside = _rank_lost_here(mechanics, starter.t, q, at_start) if dependent else (0, here)
    rank = max(at_start + lost, *ranks)
    chosen = chosen_rows(here, at_start, first) if at_start < len(rows) else list(range(len(rows)))
    singular = set[int]()
    if at_start < rank:  # singular start position: rows that are independent near it or elsewhere are chosen too
        best_place = beside[order] if at_start + lost == rank else places[int(np.argmax(ranks))]
        chosen = rows_in_order(best_place, rank, chosen)
        singular = set(chosen[at_start:])
    kept, dropped = {rows[i] for i in chosen}, [row for i, row in enumerate(rows) if i not in set(chosen)]
    doubtful = _nearly_redundant(rows, chosen, singular, [*places, *nearby])
    turned = _steered(mechanics, starter, q, elsewhere)
    shared = {i for B in (*places, *(_rows_at(mechanics, starter.t, p)[order] for p in turned)) for i in _dependent_on_others(B)}
    not_unique = [rows[i] for i in sorted(shared)] if dropped else []
    return RankReport([row for row in mechanics.rows if row in kept], dropped, doubtful, [rows[i] for i in sorted(singular)],
                      not_unique, [*elsewhere, *turned], mechanics.nu - rank, smallest(here, rank))


def _analysed_sparse(mechanics: Mechanics, starter: Starter, q: Array, always: Container[Row]) -> RankReport:
    """As `analyse`, for many rows, by sparse elimination; raises NotResolvedError where that cannot determine the rank."""
    t, rows = starter.t, mechanics.rows
    here = sparse_rows(mechanics, t, q, always)
    closing = {row.name.rsplit(".", 1)[0] for row in rows} - {joint.name for _, joint, _ in starter.tree.edges}
    dependent = {rows[i].name for i in here.left}
    elsewhere = _other_positions(mechanics, starter, q) if dependent and closing else []
    freed = _other_positions(mechanics, starter, q, dependent) if dependent and closing else []
    nearby = [p for p in freed if np.max(np.abs(mechanics.position_residual(t, p[None]))) < NEARBY * mechanics.model.length]
    places = [here, *(sparse_rows(mechanics, t, p, always) for p in elsewhere)]
    lost, beside = rank_lost_here(mechanics, t, q, here) if dependent else (0, here.B)
    rank = max(here.rank + lost, *(place.rank for place in places))
    chosen, singular = here.kept, here.kept[:0]
    if here.rank < rank:
        best = beside if here.rank + lost == rank else places[int(np.argmax([place.rank for place in places]))].B
        chosen, singular = chosen_beside(here, best, rank)
    others = [*places[1:], *(sparse_rows(mechanics, t, p, always) for p in nearby)]
    doubtful = nearly_redundant(here, chosen, singular, others, (CERTAIN, DOUBTFUL))
    turned = _steered(mechanics, starter, q, elsewhere)
    shared = {int(i) for place in (*places, *(sparse_rows(mechanics, t, p, always) for p in turned)) for i in place.dependent}
    kept = set(chosen.tolist())
    dropped = [row for i, row in enumerate(rows) if i not in kept]
    return RankReport([row for i, row in enumerate(rows) if i in kept], dropped, [(rows[i], part) for i, part in doubtful],
                      [rows[i] for i in singular],
                      [rows[i] for i in sorted(shared)] if dropped else [], [*elsewhere, *turned], mechanics.nu - rank,
                      smallest(here.B, rank) if here.rank == rank else 0.0)


def _nearly_redundant(rows: list[Row], chosen: list[int], singular: set[int], places: list[Array]) -> list[tuple[Row, float]]:
    """Nearly redundant rows with their independent parts: dropped rows that are not exactly dependent, and kept rows that nearly
    are.

    chosen: numbers of the kept rows; singular: those of them that are dependent at the start only; places: rows of unit length at
    the start and in other positions."""
    kept, left = sorted(set(chosen) - singular), [i for i in range(len(rows)) if i not in set(chosen)]
    parts = independent_parts(places[0][kept])
    found = [(rows[i], float(part)) for i, part in zip(kept, parts, strict=True) if DEPENDENT < part < DOUBTFUL]
    sound = [B for B in places if smallest(B[chosen], len(chosen)) > DOUBTFUL]
    for i in left if sound else ():
        part = max(float(independent_parts(np.vstack([B[chosen], B[i]]))[-1]) for B in sound)
        if part > CERTAIN:
            found.append((rows[i], part))
    return found


def _dependent_on_others(B: Array) -> list[int]:
    """Numbers of rows that are part of a vanishing linear combination of rows: their multipliers can be changed along it without
    any effect on the motion."""
    left, sizes, _ = np.linalg.svd(B)
    null = left[:, int(np.sum(sizes > DEPENDENT)) :]
    return [int(i) for i in np.flatnonzero(np.max(np.abs(null), axis=1, initial=0.0) > 1e-6)]


def _rows_at(mechanics: Mechanics, t: Array, q: Array) -> Array:
    return np.asarray(unit_rows(mechanics, mechanics.constraint_jacobian(t, q[None])[0]))


def _rank_lost_here(mechanics: Mechanics, t: Array, q: Array, rank: int) -> tuple[int, Array]:
    """How many rows depend on the others in this position alone (a singular position), and the rows of unit length (m, nu) near
    it. rank: that of the rows at q.

    Along a motion v that the rows allow, G changes by G'(v). Linear combinations W of rows that vanish here (W^T G = 0) still
    vanish near it if W^T G'(v) N = 0, where N are all motions that the rows allow; else the rank rises by the rank of this
    matrix. This test needs no other consistent position, and so also serves where there is none: a stretched chain between two
    fixed points can move to first order only."""
    units, G = mechanics.velocity_units, mechanics.constraint_jacobian(t, q[None])[0]
    lengths = row_lengths(G * units)
    B = G * units / lengths
    left, _, right = np.linalg.svd(B)
    W, N = left[:, rank:], right[rank:].T
    released = [i for i, row in enumerate(mechanics.rows) if not row.prescribes]
    tangent, rng = null_space(B[released]), np.random.default_rng(11)
    most, beside, seen = 0, B, np.zeros(mechanics.nu)  # seen: 0 for nodes without a constraint row, which are not moved
    for own in (slice(node.u, node.u + node.kind.sizes[1]) for node in mechanics.model.nodes):
        seen[own] = np.any(B[:, own])
    for _ in range(SAMPLES if tangent.size and N.size else 0):
        v = seen * (tangent @ rng.normal(size=tangent.shape[1]))
        if not np.any(v):
            break
        step = ASIDE * v / np.max(np.abs(v)) * units
        there, back = (mechanics.constraint_jacobian(t, mechanics.integrate_positions(q, s * step)[None])[0] * units / lengths
                       for s in (1.0, -1.0))
        change = W.T @ (there - back) @ N / (2 * ASIDE)
        found = int(np.sum(np.linalg.svd(change, compute_uv=False) > CHANGING))
        if found > most:
            most, beside = found, there / np.maximum(np.linalg.norm(there, axis=1, keepdims=True), 1e-300)
    return most, beside


def _other_positions(mechanics: Mechanics, starter: Starter, q: Array, without: Container[str] = ()) -> list[Array]:
    """Other consistent positions, reached by random displacements from q that the rows allow, after which the loops are closed
    again. Rows that prescribe coordinates and those named in `without` are released for this."""
    rows = [row for row in mechanics.rows if not row.prescribes and row.name not in without]
    released = Mechanics(mechanics.model, rows)
    closer = Starter(released, float(starter.t[0]), holding=False)
    found: list[Array] = []
    if mechanics.large and not mechanics.model.lines:
        for v in motions(released, sparse_rows(released, closer.t, q), SAMPLES):
            found += _moved(closer, q, v * closer.units(q))
        return found
    freedoms, rng = free_motions(released, closer.t, q, closer), np.random.default_rng(11)
    for _ in range(SAMPLES if freedoms.size else 0):
        direction = freedoms @ rng.normal(size=freedoms.shape[1])
        found += _moved(closer, q, direction / np.max(np.abs(direction)) * closer.units(q))
    return found


def _steered(mechanics: Mechanics, starter: Starter, q: Array, elsewhere: list[Array]) -> list[Array]:
    """Positions that what rolls or cuts reaches by detours: those to which the rows of velocities alone forbid the direct way.
    elsewhere: those reached directly; where there are none, no row is redundant."""
    by_rates = {row.name for row in mechanics.rows if row.by_rates}
    return _other_positions(mechanics, starter, q, by_rates) if elsewhere and by_rates else []


def _moved(closer: Starter, q: Array, direction: Array) -> list[Array]:
    """The position after the first of `STEPS` in this direction from which the loops can be closed again, in a list; empty where
    there is none."""
    for step in STEPS:
        try:
            return [closer.close(closer.moved(q, step * direction))]
        except StartError:
            continue
    return []


def free_motions(mechanics: Mechanics, t: Array, q: Array, starter: Starter) -> Array:
    """Orthonormal basis (coordinates, degrees of freedom) of the motions that the constraints allow, with beams taken as rigid:
    in the coordinates of `RigidMotions` (without beams the velocities), divided by unit displacements."""
    G = mechanics.constraint_jacobian(t, q[None])[0]
    return null_space((G @ starter.rigid.basis(q) if mechanics.model.lines else G) * starter.units(q))


def null_space(A: Array) -> Array:
    """Orthonormal basis (n, k) of the x with A x = 0, A (m, n); its rows have to be of similar size, because singular values are
    compared with the largest one."""
    if not len(A):
        return np.eye(A.shape[1])
    _, sizes, V = np.linalg.svd(A, full_matrices=True)
    return np.asarray(V[int(np.sum(sizes > 1e-9 * sizes[0])) :].T)


#: an earlier choice of rows is used again if its smallest singular value is at least this part of that of the best choice
GOOD = 0.5
#: margin: smallest singular value of the rows in force less the limit below which they are replaced (WORN). They are checked
#: again after the positions have changed by this part of the margin at the last check, assuming that a singular value changes by
#: about as much
SHARE = 0.5


class RowsInForce:
    """The rows that are integrated of an over-constrained mechanism, and when they have to be replaced by others.

    all_rows: mechanics with all rows; rank: that of all rows; always: numbers of rows that recursive joints and shared
    displacements satisfy, which are always kept; rows: those in force; known: earlier choices, whose equations are compiled
    already, so that they are preferred where they are good enough (GOOD)."""

    def __init__(self, all_rows: Mechanics, rank: int, always: Sequence[int], rows: Rows, known: Iterable[Rows] = ()) -> None:
        self.all_rows, self.rank, self.always, self.known = all_rows, rank, list(always), known
        self._number = {row: i for i, row in enumerate(all_rows.rows)}
        self.numbers = self._numbers(rows)
        self._units = all_rows.position_units
        self.seen: tuple[Array, float] | None = None  # positions at the last check, and the margin there, see SHARE

    def smallest(self, t: float, q: Array) -> float:
        """Smallest singular value of all rows that is not 0 by redundancy. Where it is near 0, the position is singular: no
        choice of rows determines the motion."""
        return smallest(self._unit_rows(t, q), self.rank)

    def _numbers(self, rows: Rows) -> list[int]:
        return [self._number[row] for row in rows]

    def better(self, t: float, q: Array) -> Rows | None:
        """The rows to be integrated from the present positions q (nq,) of all nodes on; None where those in force are still
        good."""
        if self.seen is not None and self._distance(q) < SHARE * self.seen[1]:
            return None
        B = self._unit_rows(t, q)
        others = self._choice(B)
        reached = smallest(B[others], self.rank)
        slack = smallest(B[self.numbers], self.rank) - WORN * reached
        if slack >= 0 or reached <= DEPENDENT:  # in a singular position (reached <= DEPENDENT) no choice is good
            self.seen = q.copy(), max(slack, 0.0)
            return None
        for rows in self.known:
            if smallest(B[self._numbers(rows)], self.rank) >= GOOD * reached:
                return rows
        return tuple(self.all_rows.rows[i] for i in sorted(others))

    def _choice(self, B: Any) -> list[int]:
        """Numbers of independent, well-conditioned rows: by `best_rows`, or for many rows by sparse elimination."""
        if not issparse(B):
            return best_rows(B, self.rank, self.always)
        return [int(i) for i in SparseRows(B, self.always, numbers_of_joints(self.all_rows.rows)).kept]

    def _unit_rows(self, t: float, q: Array) -> Any:
        return unit_rows(self.all_rows, self.all_rows.constraint_matrix(np.array([t]), q))

    def _distance(self, q: Array) -> float:
        """Largest change of the positions since the last check, over the scene's length, or rad."""
        assert self.seen is not None
        return float(np.max(np.abs(q - self.seen[0]) / self._units, initial=0.0))
