"""Coordinates of a tree: couplings fold one into another, and some move no inertia.

Eliminated from the leaves inwards, every pivot of the mass matrix is the inertia that a coordinate moves when all that it carries
is free to follow. Its rounding is that of the inertia of what is carried about any axis through the joint; below that, the matrix
is singular but for rounding, and an acceleration is a quotient of rounding errors."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import OptionError, SceneError
from mbdae.laws.on_coordinates import Gear, Rack, WeightedSum
from mbdae.system.model.trees import Tree

Array = NDArray[np.float64]
NOTHING_MOVED = ("no inertia is moved by it{}, but for rounding, so that nothing says how it accelerates; give its body inertia, "
                 "or the joint rotor=")
#: pivots below this part of the inertia that their terms may have are rounding
ROUNDING = 64 * float(np.finfo(float).eps)


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


def rounding(scene: Any, tree: Tree, name: str, coordinate: str) -> float:
    """The pivot of a coordinate of a joint up to which it is rounding, kg m^2 or kg: ROUNDING times the inertia of all that the
    joint carries, about its place as drawn (of a sliding coordinate, their mass)."""
    joint, links = scene[name], tree.structure.links
    inside = {tree.names.index(name) + 1}
    for j, link in enumerate(links, start=1):  # a link comes after the one that carries it
        if link.parent in inside:
            inside.add(j)
    names = {node.name for j, node in enumerate(tree.nodes) if node is not None and j in inside}
    size = 0.0
    for b in (b for b in scene.bodies if b.name in names):
        arm, own = b.drawn.position - joint.joint.at, 0.0 if b.inertia is None else float(np.trace(b.inertia))
        size += b.mass if joint.unit(coordinate) == "m" else own + b.mass * float(arm @ arm)
    return ROUNDING * size


def pivots_of(M: Array) -> Array:
    """Pivots (n,) of a symmetric matrix (n, n), eliminated from its last row upwards."""
    M, found = M.copy(), np.zeros(len(M))
    for k in reversed(range(len(M))):
        found[k] = M[k, k]
        if found[k] != 0:
            M[:k, :k] -= np.outer(M[:k, k], M[k, :k]) / found[k]
    return found


def singular(tree: Any, q: Array, where: str = "") -> str:
    """What is said of the coordinates of `s.tree()` whose pivots are rounding at q (nq,), "" where none is; where: in words, of
    which state."""
    M, least = tree.mass_matrix(q), tree._program.least
    still = [k for k, d in enumerate(pivots_of(M)) if not d > least[k]]
    if not still:
        return ""
    alone = [tree.coordinates[k] for k in still if M[k, k] <= least[k]]
    if not alone:  # each moves inertia, but only together with others
        moved = sorted({*still, *np.flatnonzero(np.any(M[still] != 0, axis=0)).tolist()})
        return (f"{', '.join(tree.coordinates[k] for k in moved)}: they move the same inertia alike{where}, but for rounding, so "
                "that nothing says how each accelerates; give one of their joints rotor=, or leave this position")
    return f"{', '.join(alone)}: {NOTHING_MOVED.format(where)}"


def refuse_singular(tree: Any, x: Array, wrong: Any) -> None:
    """Raise an error where accelerations cannot be computed: SceneError where the mass matrix is singular but for rounding, else
    OptionError. x (..., inputs): states, which begin with q; wrong (...): where pivots are rounding or are not numbers."""
    if not np.any(wrong):
        return
    row = tuple(int(n[0]) for n in np.nonzero(wrong)) if np.ndim(wrong) else ()
    where = f" in {np.count_nonzero(wrong)} states, first number {row[0] if len(row) == 1 else row}" if row else " at this q"
    if text := singular(tree, x[row][: tree.nq], where):
        raise SceneError([text])
    raise OptionError(f"accelerations are beyond the range of numbers{where}: give smaller v or tau")
