"""What a text assumes of its quantities (`x in (-1, 1)`, `l > r`, `u != 0`), which states of a comparison satisfy."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from mbdae.audit.evaluate import SizeError, attempt
from mbdae.audit.motion import Motion
from mbdae.audit.notation import Comparison, Node, Reader, symbol
from mbdae.audit.phrases import Env, Scope

SAID = re.compile(r"<|>|!=|\bin\s*[(\[]")  #: what every assumption contains
TURN = 3.1  #: largest angle that is drawn, rad
_ENDLESS = symbol("inf")


@dataclass(frozen=True)
class Assumption:
    """One assumption: its text, and the comparisons that it consists of."""

    text: str
    parts: tuple[Comparison, ...]

    @property
    def names(self) -> frozenset[str]:
        """Names that appear."""
        return frozenset().union(*(n.free for a, _, b in self.parts for n in (a, b)))

    def holds(self, env: Env) -> bool:
        """Whether it holds in a state; False where one of its sides has no value."""
        return all(_holds(attempt(a, env), sign, attempt(b, env)) for a, sign, b in self.parts)

    def bounds(self, scope: Scope) -> dict[str, list[float]]:
        """Bounds, low and high, of numbers that are drawn at random, by the words of their meaning."""
        found: dict[str, list[float]] = {}
        for a, sign, b in self.parts:
            for side, other, end in ((a, b, 1 if "<" in sign else 0), (b, a, 0 if "<" in sign else 1)):
                meaning = scope.symbols.get(str(side))
                value = constant(other)
                if meaning is not None and meaning.phrase.given and value is not None and sign != "!=":
                    found.setdefault(meaning.text, [-np.inf, np.inf])[end] = value
        return found


def assumptions(text: str, line: int) -> list[Assumption]:
    """The assumptions of a text, separated by commas, semicolons or `and`; AuditError where one cannot be read."""
    pieces, depth, start = [], 0, 0
    for match in re.finditer(r"[(\[]|[)\]]|[,;]|\band\b", text + ";"):
        depth += (match[0] in "([") - (match[0] in ")]")
        if match[0] in (",", ";", "and") and not depth:
            pieces.append(text[start : match.start()].strip())
            start = match.end()
    read = [(piece, Reader(piece, line, relations=True).assumption()) for piece in filter(None, pieces)]
    return [Assumption(piece, tuple(c for c in parts if _ENDLESS.value not in c[0].free | c[2].free)) for piece, parts in read]


def bounds(assumed: Iterable[Assumption], scope: Scope, names: Iterable[str]) -> dict[str, tuple[float, float]]:
    """The bounds of several assumptions together; those of positive numbers begin at 0. Angles of either sign among the named
    quantities turn by nearly half a turn either way, so that a branch of an inverse function is not taken for all of it."""
    known = [m for n in sorted(names) if (m := scope.symbols[n]).phrase.given and "rad" in map(str, m.units)]
    found = {m.text: (-TURN, TURN) for m in known if m.phrase.wording in ("number", "angle", "function of time")}
    for one in assumed:
        for words, (low, high) in one.bounds(scope).items():
            old = found.get(words, (0.0 if words.startswith("positive") else -np.inf, np.inf))
            found[words] = max(old[0], low), min(old[1], high)
    return found


def _holds(a: Any, sign: str, b: Any) -> bool:
    if a is None or b is None:
        return False
    if sign == "!=":
        return bool(np.max(np.abs(np.asarray(a) - np.asarray(b))) > 0)
    if np.ndim(a) or np.ndim(b):
        raise SizeError(f"an assumption with '{sign}' compares numbers, not vectors or matrices: write norm(u) > 0, or u != 0")
    gap = float(np.real(np.asarray(b)) - np.real(np.asarray(a))) * (1 if "<" in sign else -1)
    return gap >= 0 if "=" in sign else gap > 0


def constant(node: Node) -> float | None:
    """The value of a formula of numbers alone; None where it has symbols."""
    if node.free - {"pi"}:
        return None
    value = attempt(node, _anywhere())
    return None if value is None or np.ndim(value) else float(np.real(value))


@lru_cache(maxsize=1)
def _anywhere() -> Env:
    return Env(Motion(0), Scope({}))
