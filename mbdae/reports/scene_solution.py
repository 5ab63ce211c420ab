"""The order in which the rows of a scene are solved for the multipliers, force balances first.

A row in which one multiplier is left with the coefficient 1 or -1 gives it without a division: force balances, in trees from
the leaves to the root. Where there is none, a row with a coefficient 1 or -1 is put into the others. What remains is split into
the smallest blocks that can be solved one after the other by determinants: single rows, and two rows per dyad. Further rows with
the same multipliers join their block, so that it is solved wherever any of its determinants differs from 0.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.symbolic.vectors import Expr

LARGEST_BLOCK = 3  #: largest number of multipliers that are solved for together by determinants
FURTHER = 2  #: largest number of rows that join a block
ZERO = se.Integer(0)
Coefficients = dict[Any, Expr]  #: coefficients by multiplier; the constant term under None


class SolvedTogether(NamedTuple):
    """Multipliers that are solved for together, the rows that determine them, and the places of these in u. A row of a force
    balance is solved already: it holds the value of its multiplier, which is no longer in it."""

    unknowns: list[Any]
    rows: list[Coefficients]
    places: list[int]


def solved(rows: Mapping[int, Coefficients], number: Callable[[Expr], float], efforts: Mapping[int, str]) -> list[SolvedTogether]:
    """The steps of the solution in their order. number: value of a coefficient at the start; efforts: units of the rows.
    ValueError where too many multipliers must be solved for together."""
    left, later = {at: dict(row) for at, row in rows.items()}, list[SolvedTogether]()
    while (found := _pivot(left)) is not None:
        at, unknown = found
        row = left.pop(at)
        c = row.pop(unknown)
        value = {key: -e * c for key, e in row.items()}  # c is 1 or -1, so that dividing by c is multiplying by it
        later.insert(0, SolvedTogether([unknown], [value], [at]))
        left = {a: _inserted(r, unknown, value) for a, r in left.items()}
    open_, steps, known = {a: r for a, r in left.items() if len(r) > 1}, list[SolvedTogether](), set[Any]()
    while open_:
        block = _block(open_, known, number)
        if block is None:
            raise ValueError(f"more than {LARGEST_BLOCK} constraint rows must be solved together (no mistake in the scene)")
        places, unknowns = block
        places += _further(open_, places, unknowns, known, efforts)
        steps.append(SolvedTogether(unknowns, [open_.pop(at) for at in places], places))
        known |= set(unknowns)
        open_ = {a: r for a, r in open_.items() if _unsolved(r, known)}
    return steps + later


def _pivot(left: dict[int, Coefficients]) -> tuple[int, Any] | None:
    """A row and a multiplier in it with coefficient 1 or -1: of the row with the fewest multipliers, one that appears in the
    fewest rows."""
    counts = Counter(key for row in left.values() for key in row)
    found = [(len(row), counts[key], at, str(key), key) for at, row in left.items() for key, e in row.items()
             if key is not None and e in (1, -1) and len(row) > 1]
    best = min(found, key=lambda entry: entry[:4], default=None)
    return None if best is None else (best[2], best[4])


def _unsolved(row: Coefficients, known: set[Any]) -> list[Any]:
    return sorted((key for key in row if key is not None and key not in known), key=str)


def _block(rows: dict[int, Coefficients], known: set[Any], number: Callable[[Expr], float]) -> tuple[list[int], list[Any]] | None:
    """Fewest rows with as many multipliers not in `known`: their places in u, and these; by determinant if several."""
    for size in range(1, LARGEST_BLOCK + 1):
        found = []
        for places in combinations(sorted(rows), size):
            unknowns = sorted({key for at in places for key in _unsolved(rows[at], known)}, key=str)
            if len(unknowns) == size:
                A = [[number(rows[at].get(unknown, ZERO)) for unknown in unknowns] for at in places]
                found.append((-abs(float(np.linalg.det(A))), list(places), unknowns))
        if found:
            return min(found, key=lambda entry: (round(entry[0], 9), entry[1]))[1:]
    return None


def _further(rows: dict[int, Coefficients], places: list[int], unknowns: list[Any], known: set[Any],
             efforts: Mapping[int, str]) -> list[int]:
    """Places of further rows of the same unit that have no multipliers but those of a block."""
    found = [at for at in sorted(rows) if at not in places and efforts[at] == efforts[places[0]]
             and {*_unsolved(rows[at], known)} <= {*unknowns}]
    return found[:FURTHER] if len({efforts[at] for at in places}) == 1 else []


def _inserted(row: Coefficients, unknown: Any, value: Coefficients) -> Coefficients:
    """A row with a multiplier replaced by its expression."""
    if unknown not in row:
        return row
    c, out = row[unknown], {key: e for key, e in row.items() if key != unknown}
    for key, e in value.items():
        out[key] = se.expand(out.get(key, ZERO) + c * e)
    return {key: e for key, e in out.items() if key is None or e != 0}


def total(row: Coefficients) -> Expr:
    """The sum of a row's terms."""
    return sum((e if key is None else e * key for key, e in row.items()), ZERO)


def determinant(A: list[list[Expr]]) -> Expr:
    """Determinant of a square matrix, by expansion in minors."""
    if len(A) == 1:
        return A[0][0]
    minors = [[row[:j] + row[j + 1 :] for row in A[1:]] for j in range(len(A))]
    return sum(((-1) ** j * A[0][j] * determinant(minor) for j, minor in enumerate(minors)), ZERO)
