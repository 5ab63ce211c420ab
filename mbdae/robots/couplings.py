"""Coordinates of a tree, and couplings of two of them: one is folded in, a multiple of the other."""

from __future__ import annotations

from typing import Any, NamedTuple

from mbdae.laws.on_coordinates import Gear, Rack, WeightedSum


class Coordinate(NamedTuple):
    """A coordinate of a joint: first entry in q and v, and how many it has there."""
    joint: str
    name: str
    q: int
    v: int
    nq: int
    nv: int


class Folded(NamedTuple):
    """A coordinate that is factor times another one, plus offset."""
    of: tuple[str, str]
    factor: float
    offset: float


def folded_of(scene: Any, inside: set[str]) -> tuple[dict[tuple[str, str], Folded], set[str]]:
    """Coordinates that couplings of two coordinates make multiples of others, and the names of these couplings. inside: names of
    the joints of trees."""
    found: dict[tuple[str, str], Folded] = {}
    names: set[str] = set()
    for c in scene.connections:
        law = c.laws[0]
        if not isinstance(law, Gear | Rack | WeightedSum):
            continue
        pair, value = couples(law)
        if len(pair) != 2 or not isinstance(value, int | float) or any(key[0] not in inside for key, _ in pair):
            continue
        (one, f), (other, g) = pair
        if one in found or f == 0 or one in {x.of for x in found.values()}:
            continue
        if other in found:
            via = found[other]
            other, g, value = via.of, g * via.factor, value - g * via.offset
        if other != one:
            found[one] = Folded(other, -g / f, value / f)
            names.add(c.name)
    return found, names


def couples(law: Any) -> tuple[list[tuple[tuple[str, str], float]], Any]:
    """Coordinates with their factors and the value of the sum; the first is the one that follows."""
    if isinstance(law, Gear):
        return [(law.of["driven"], 1.0), (law.of["driving"], -float(law.ratio))], 0.0
    if isinstance(law, Rack):
        return [(law.of["displacement"], 1.0), (law.of["angle"], -float(law.radius))], 0.0
    terms = [(law.of[f"c{n + 1}"], float(getattr(law, f"factor{n + 1}"))) for n in range(len(law.of))]
    return terms, law.value
