"""The coordinates of a tree: their order, which follow from others, and the scene in which every body is carried by a joint."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mbdae.errors import SceneError
from mbdae.laws.joint_rows import Free
from mbdae.laws.on_coordinates import Gear, Rack, WeightedSum
from mbdae.scene.models import spanning_tree
from mbdae.system.model.model import Model

FLOATS = "{} floats"  #: name of the joint by which a body that no joint holds is given six freedoms


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


def moving_scene(scene: Any, origins: dict[str, Any]) -> Any:
    """A copy of a scene whose joints are recursive where they form trees; bodies that no joint carries move by a free joint.
    origins: points of bodies, as drawn, at which such a joint is; by default the centre."""
    if scene.problems:
        raise SceneError(list(scene.problems))
    made = scene._copied()
    for root in spanning_tree(made).roots:
        if root is not made.ground:
            at = origins.get(root.name, root.drawn.position)
            made.joint(Free, FLOATS.format(root.name), made.ground, root, at=at, axis=(0, 0, 1), axis_x=(1, 0, 0))
    if made.problems:
        raise SceneError(list(made.problems))
    return made.recursive()


def coordinates_of(model: Model, order: list[str], folded: dict[tuple[str, str], Folded]) -> list[Coordinate]:
    """The coordinates of joints named in their order; folded ones are left out."""
    found: list[Coordinate] = []
    q = v = 0
    for name in order:
        joint = model.scene[name]
        for c in joint.coordinates:
            if (name, c) in folded:
                continue
            nq, nv = (4, 3) if joint.unit(c) == "rotation" else (1, 1)
            found.append(Coordinate(name, c, q, v, nq, nv))
            q, v = q + nq, v + nv
    return found


def ordered(scene: Any, trees: list[Any]) -> list[str]:
    """Names of the joints of trees, base outwards, in the order of the scene."""
    carried: dict[str, str] = {}  #: joint -> the joint that carries its parent
    for tree in trees:
        for name, link in zip(tree.names, tree.structure.links, strict=True):
            carried[name] = tree.names[link.parent - 1] if link.parent else ""
    done: dict[str, None] = {}

    def take(name: str) -> None:
        if name and name not in done:
            take(carried[name])
            done[name] = None

    floats = [name for name in carried if name.endswith(FLOATS.format(""))]
    for name in (*floats, *(c.name for c in scene.joints if c.name in carried)):
        take(name)
    return list(done)


def folded_of(scene: Any, inside: set[str]) -> tuple[dict[tuple[str, str], Folded], set[str]]:
    """Coordinates that couplings of two coordinates make multiples of others, and the names of these couplings. inside: names of
    the joints of trees."""
    found: dict[tuple[str, str], Folded] = {}
    names: set[str] = set()
    for c in scene.connections:
        law = c.laws[0]
        if not isinstance(law, Gear | Rack | WeightedSum):
            continue
        pair, value = _pair(law)
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


def _pair(law: Any) -> tuple[list[tuple[tuple[str, str], float]], Any]:
    """Coordinates with their factors and the value of the sum; the first is the one that follows."""
    if isinstance(law, Gear):
        return [(law.of["driven"], 1.0), (law.of["driving"], -float(law.ratio))], 0.0
    if isinstance(law, Rack):
        return [(law.of["displacement"], 1.0), (law.of["angle"], -float(law.radius))], 0.0
    terms = [(law.of[f"c{n + 1}"], float(getattr(law, f"factor{n + 1}"))) for n in range(len(law.of))]
    return terms, law.value


def neutral(coordinates: list[Coordinate]) -> np.ndarray[Any, Any]:
    """q of the drawing."""
    return np.concatenate([np.eye(4)[0] if c.nq == 4 else np.zeros(1) for c in coordinates] or [np.zeros(0)])
