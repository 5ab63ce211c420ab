"""Coordinates of a tree; couplings of two of them: one is folded in, a multiple of the other; two trees whose coordinates have
other names and another order."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from mbdae.errors import SceneError
from mbdae.laws.on_coordinates import Gear, Rack, WeightedSum
from mbdae.scene.shapes import joint_axes

Array = NDArray[np.float64]
FLOATS = "{} floats"  #: name of the joint by which a body that no joint holds is given six freedoms
STATES = 5  #: random states at which two trees are compared


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


def differences(one: Any, other: Any, there: Callable[[str, str], tuple[str, str]]) -> tuple[Array, Array]:
    """Largest differences of the forces that accelerations need, at STATES random states, which hold mass matrix and bias, and
    the largest of these forces. one, other: what `s.tree()` returns; there: names of a joint and its coordinate in the other."""
    by_name = {(c.joint.removesuffix(FLOATS.format("")), c.name): c for c in other._coordinates}
    to_q, to_v = np.zeros((other.nq, one.nq)), np.zeros((other.nv, one.nv))
    for c in one._coordinates:
        name = c.joint.removesuffix(FLOATS.format(""))
        found = by_name.get(there(name, c.name))
        if found is None or found.nv != c.nv:
            raise SceneError([f"joint '{c.joint}': MJCF does not say it with the same coordinates"])
        at_q, at_v = ((slice(y, y + n), slice(x, x + n)) for y, x, n in ((found.q, c.q, c.nq), (found.v, c.v, c.nv)))
        if c.nq == 4:  # a quaternion and a spin along the axes of the joint, which in the other are the inertial ones
            joint = None if c.joint == FLOATS.format(name) else one.scene[name]
            axes = np.eye(3) if joint is None else joint_axes(joint.laws[0], joint.k)
            to_q[at_q], to_v[at_v] = block_diag(1, axes), axes
        else:
            to_q[at_q], to_v[at_v] = np.eye(c.nq), np.eye(c.nv)
    rng = np.random.default_rng(0)
    q, (v, a) = rng.normal(size=(STATES, one.nq)), rng.normal(size=(2, STATES, one.nv))
    for c in one._coordinates:
        if c.nq == 4:
            q[:, c.q : c.q + 4] /= np.linalg.norm(q[:, c.q : c.q + 4], axis=1)[:, None]
    tau, again = one._interpreted(q, v, a), other._interpreted(q @ to_q.T, v @ to_v.T, a @ to_v.T) @ to_v
    return np.max(np.abs(tau - again), axis=1), np.max(np.abs(tau), axis=1)
