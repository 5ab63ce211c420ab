"""The order in which the rows of a scene are solved for the multipliers, force balances first.

A row in which one multiplier is left with the coefficient 1 or -1 gives it without a division: force balances, in trees from
the leaves to the root. Where there is none, a row with a coefficient 1 or -1 is put into the others. What remains is split into
the smallest blocks that can be solved one after the other by determinants: single rows, and two rows per dyad. Further rows with
the same multipliers join their block, so that it is solved wherever any of its determinants differs from 0. Where the smallest
block has more than three rows, up to three rows of a body are taken from the others, times factors with which as many multipliers
vanish there, and solved after these: the moments of a leg as a whole do not have those of the slide inside of it. Rows whose
determinant is 0 in every position are no block: those of a rod between two balls, which may turn about its line. Last: states at
which the solution is next to zeros of its divisors.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from itertools import combinations, permutations
from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Equation, every
from mbdae.errors import MbdaeError
from mbdae.reports.page import Printed, divisors
from mbdae.reports.reading import key_of
from mbdae.reports.vectors import ZERO
from mbdae.symbolic.vectors import Expr

LARGEST_BLOCK = 3  #: largest number of multipliers that are solved for together by determinants
FURTHER = 2  #: largest number of rows that join a block
WELL_OFF = 0.02  #: least determinant at the start, of rows of unit length, with which rows are taken from others
ROUND_OFF = 1e-12  #: determinants of this part of the sum of the sizes of their products are 0
Coefficients = dict[Any, Expr]  #: coefficients by multiplier; the constant term under None


class SolvedTogether(NamedTuple):
    """Multipliers that are solved for together, the rows that determine them, and the places of these in u. A row of a force
    balance is solved already: it holds the value of its multiplier, which is no longer in it."""

    unknowns: list[Any]
    rows: list[Coefficients]
    places: list[int]


class TakenOut(NamedTuple):
    """Rows of a body that are taken from others, so that multipliers vanish in these. rows: what is left of the others, by their
    places in u."""

    rows: dict[int, Coefficients]
    letters: list[str]  #: all that is defined for it, in order


def solved(rows: Mapping[int, Coefficients], number: Callable[[Expr], float], efforts: Mapping[int, str],
           bodies: Mapping[int, Any], letters: Callable[[SolvedTogether, dict[int, Coefficients]], TakenOut],
           drawn: Callable[[Expr], Any]) -> list[SolvedTogether | TakenOut]:
    """The steps of the solution in their order. number: value of a coefficient at the start; efforts: units of the rows; bodies:
    what each row is a balance of; letters: takes rows from others, with letters for all of it; drawn: values of a coefficient at
    random states."""
    left, later = {at: dict(row) for at, row in rows.items()}, list[SolvedTogether | TakenOut]()
    while (found := _pivot(left)) is not None:
        at, unknown = found
        row = left.pop(at)
        c = row.pop(unknown)
        value = {key: -e * c for key, e in row.items()}  # c is 1 or -1, so that dividing by c is multiplying by it
        later.insert(0, SolvedTogether([unknown], [value], [at]))
        left = {a: _inserted(r, unknown, value) for a, r in left.items()}
    open_, steps, known = {a: r for a, r in left.items() if len(r) > 1}, list[SolvedTogether | TakenOut](), set[Any]()
    while open_:
        block = _block(open_, known, number, drawn)
        if block is None:
            together = _of_one_body(open_, known, number, bodies)
            open_ = {at: row for at, row in open_.items() if at not in together.places}
            later.insert(0, together)
            others = {at: row for at, row in open_.items() if row.keys() & {*together.unknowns}}
            if others:
                taken = letters(together, others)
                steps.append(taken)
                open_ |= taken.rows
            continue
        places, unknowns = block
        places += _further(open_, places, unknowns, known, efforts)
        steps.append(SolvedTogether(unknowns, [open_.pop(at) for at in places], places))
        known |= set(unknowns)
        open_ = {a: r for a, r in open_.items() if _unsolved(r, known)}
    return steps + later


def _of_one_body(rows: dict[int, Coefficients], known: set[Any], number: Callable[[Expr], float],
                 bodies: Mapping[int, Any]) -> SolvedTogether:
    """Up to three rows of one body and as many multipliers, which they give wherever the others are known: those that fewest
    other rows contain, with a determinant well off 0 at the start. ValueError where there are none."""
    found = []
    for body in dict.fromkeys(bodies[at] for at in sorted(rows)):
        places = [at for at in sorted(rows) if bodies[at] == body]
        inside = sorted({key for at in places for key in _unsolved(rows[at], known)}, key=str)
        A = np.array([[number(rows[at].get(key, ZERO)) for key in inside] for at in places])
        size = np.prod(np.linalg.norm(A, axis=1))
        for chosen in combinations(range(len(inside)), len(places)) if len(places) <= LARGEST_BLOCK else ():
            unknowns = [inside[i] for i in chosen]
            others = sum(bool(row.keys() & {*unknowns}) for at, row in rows.items() if at not in places)
            well = abs(float(np.linalg.det(A[:, chosen]))) / size
            if well > WELL_OFF:
                found.append((others, len(inside) - len(places), -round(well, 9), places, unknowns))
    if not found:
        raise ValueError(f"more than {LARGEST_BLOCK} constraint rows must be solved together (no mistake in the scene)")
    _, _, _, places, unknowns = min(found, key=lambda entry: (*entry[:4], str(entry[4])))
    return SolvedTogether(unknowns, [rows[at] for at in places], places)


def less(row: Coefficients, together: SolvedTogether, factors: list[Expr]) -> Coefficients:
    """A row less other rows times factors, with which the multipliers of these vanish in it."""
    keys = dict.fromkeys([*row, *(key for other in together.rows for key in other)])
    found = {key: se.expand(row.get(key, ZERO) - sum((f * other.get(key, ZERO)
                                                      for f, other in zip(factors, together.rows, strict=True)), ZERO))
             for key in keys if key not in together.unknowns}
    return {key: e for key, e in found.items() if key is None or e != 0}


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


def _block(rows: dict[int, Coefficients], known: set[Any], number: Callable[[Expr], float],
           drawn: Callable[[Expr], Any]) -> tuple[list[int], list[Any]] | None:
    """Fewest rows with as many multipliers not in `known`: their places in u, and these; by determinant if several. None where
    there are none whose determinant differs from 0, at the start or at random states."""
    for size in range(1, LARGEST_BLOCK + 1):
        found = []
        for places in combinations(sorted(rows), size):
            unknowns = sorted({key for at in places for key in _unsolved(rows[at], known)}, key=str)
            if len(unknowns) == size:
                e = [[rows[at].get(unknown, ZERO) for unknown in unknowns] for at in places]
                A = np.array([[number(entry) for entry in row] for row in e])
                if _differs(A) or _differs(np.array([[*map(drawn, row)] for row in e])):
                    found.append((-abs(float(np.linalg.det(A))), list(places), unknowns))
        if found:
            return min(found, key=lambda entry: (round(entry[0], 9), entry[1]))[1:]
    return None


def _differs(A: Any) -> bool:
    """Whether the determinant of a matrix (n, n, ...) differs from 0 by more than round-off, at some of its values."""
    B = np.moveaxis(A, (0, 1), (-2, -1))
    size = sum(np.prod([np.abs(A[i, j]) for i, j in enumerate(order)], axis=0) for order in permutations(range(len(A))))
    return bool(np.any(np.abs(np.linalg.det(B)) > ROUND_OFF * size))


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


def divided_by(e: Expr) -> list[Expr]:
    """What an expression divides by."""
    own = [e.args[0] ** -e.args[1]] if isinstance(e, se.Pow) and e.args[1].is_Number and e.args[1] < 0 else []
    return [*own, *(d for part in e.args for d in divided_by(part))]


# -- States of a scene next to the zeros of the divisors of its closed forms, found along lines through random positions


LINES, POINTS, MOST = 6, 40, 4  #: lines through the start, points on each, and largest number of zeros that are approached
REFINED = 12  #: times that the piece of a line around a zero is cut to a tenth: round-off
TURN = 6.0  #: rad; bodies turn by about so much along a line
STEPS = (1e-9, 1e-6, 1e-3)  #: distances from a zero of the states, parts of the line


def next_to_zeros(page: Any, blocks: list[Block]) -> tuple[Any, Any, Any, Any] | None:
    """Times, positions, velocities and internal states, as `SceneEquations.values` takes them, next to zeros of divisors that
    change sign along some line; None where none does."""
    keys = list(dict.fromkeys(d for e in every(Equation, blocks) for d in divisors(key_of(e.latex))))
    line = _Line(page)

    def signs(at: Any) -> Any:
        """(keys, lines, points) values of the divisors."""
        return np.array([np.real(v).reshape(at.shape) for v in _values(page, blocks, keys, line.states(at))])

    try:
        at = np.tile(np.linspace(0, 1, POINTS), (LINES, 1))
        found = signs(at)
        places = np.argwhere(found[..., 1:] * found[..., :-1] < 0)[:MOST]
        ends = []
        for key, i, j in places:
            low, high = at[i, j], at[i, j + 1]
            for _ in range(REFINED):
                grid = np.tile(np.linspace(low, high, 11), (LINES, 1))
                v = signs(grid)[key, i]
                first = int(np.argmax(v[1:] * v[:-1] <= 0))
                low, high = grid[i, first], grid[i, first + 1]
            ends.append((i, low))
    except (MbdaeError, np.linalg.LinAlgError):
        return None  # the mechanics of the scene has no accelerations on some of the lines
    if not ends:
        return None
    steps = np.array([sign * step for step in (0.0, *STEPS) for sign in (1, -1)])
    parts = [line.one(i, low + steps) for i, low in ends]
    return tuple(np.concatenate(p) for p in zip(*parts, strict=True))  # type: ignore[return-value]


class _Line:
    """Lines through random positions of a scene."""

    def __init__(self, page: Any) -> None:
        self.page, self.start = page, page.prepared.start
        rng, m = np.random.default_rng(12), page.prepared.model
        size = np.full(len(self.start.q), 0.3 * page.prepared.length)
        for node in m.nodes:
            nq, n = node.kind.sizes[0], node.kind.translations
            size[node.q + n : node.q + nq] = 1.0 if node.kind.by_quaternion else TURN
        self.directions = size * rng.normal(size=(LINES, len(size)))
        self.u = rng.normal(size=len(self.start.u))

    def one(self, i: int, at: Any) -> tuple[Any, Any, Any, Any]:
        """States on the line i at the places `at`, 0 to 1."""
        n = len(at)
        q = self.start.q + at[:, None] * self.directions[i]
        t, u = np.full(n, self.start.t), np.tile(self.u, (n, 1))
        return t, *self.page.m.admissible(t, q, u), np.tile(self.start.s, (n, 1))

    def states(self, at: Any) -> tuple[Any, ...]:
        """States on all lines at the places (lines, points)."""
        return tuple(np.concatenate(p) for p in zip(*(self.one(i, row) for i, row in enumerate(at)), strict=True))


def _values(page: Any, blocks: list[Block], keys: list[Any], states: tuple[Any, ...]) -> list[Any]:
    """Values of printed formulas at states of the scene."""
    known, multipliers = page.values(*states)
    known |= {page.latex[str(s)]: multipliers[:, i] for i, s in enumerate(page.unknowns)}
    printed = Printed(known, {}, len(multipliers))
    printed.read(blocks)
    return [printed.value(key) for key in keys]
