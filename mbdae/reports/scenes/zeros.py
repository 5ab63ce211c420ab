"""States of a scene next to the zeros of the divisors of its closed forms, found along lines through random positions."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.documents.blocks import Block, Equation, every
from mbdae.errors import MbdaeError
from mbdae.reports.page import Printed, divisors
from mbdae.reports.reading import key_of

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
