"""Coordinates of a tree; couplings of two of them: one is folded in, a multiple of the other; two trees whose coordinates have
other names and another order; what joints have beside their motion, in words."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from mbdae.errors import SceneError
from mbdae.laws.forces import JointDamper, JointFriction, JointLoad, JointSpring
from mbdae.laws.on_coordinates import Gear, JointStop, Rack, WeightedSum
from mbdae.robots import Robot
from mbdae.scene.shapes import joint_axes

Array = NDArray[np.float64]
FLOATS = "{} floats"  #: name of the joint by which a body that no joint holds is given six freedoms
ROUND_OFF = 1e-12  #: of factors of a sum, over those of its terms
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
    """A coordinate that is factor times another one, plus offset, by couplings of these names; of None: it has this value."""
    of: Any
    factor: float
    offset: float
    by: tuple[str, ...] = ()


def reduced(found: Mapping[Any, Folded], terms: Iterable[tuple[Any, float]], value: float) -> Folding:
    """A sum of coordinates times factors that has a value, in the coordinates that are not folded."""
    left, by, size = dict[Any, float](), dict[str, None](), dict[Any, float]()
    for key, factor in terms:
        one = found.get(key, Folded(key, 1.0, 0.0))
        by |= dict.fromkeys(one.by)
        value -= factor * one.offset
        if one.of is not None:
            left[one.of] = left.get(one.of, 0.0) + factor * one.factor
            size[one.of] = size.get(one.of, 0.0) + abs(factor * one.factor)
    return Folding({key: factor for key, factor in left.items() if abs(factor) > ROUND_OFF * size[key]}, value, tuple(by))


Tie = tuple[str, list[tuple[Any, float]], float]  #: name, coordinates with factors, and the value that the sum of them has


class Folding(NamedTuple):
    """A coupling in the coordinates that are left: their factors, the value of the sum, and by which couplings others went."""
    left: dict[Any, float]
    value: float
    by: tuple[str, ...]

    def into(self, found: dict[Any, Folded], name: str) -> None:
        """Fold the first of one or two coordinates, by the coupling `name`, and write others that follow it anew."""
        (one, f), *rest = self.left.items()
        other, g = rest[0] if rest else (None, 0.0)
        new = Folded(other, -g / f, self.value / f, (*self.by, name))
        for key, old in found.items():
            if old.of == one:
                by = tuple(dict.fromkeys((*old.by, *new.by)))
                found[key] = Folded(other, old.factor * new.factor, old.offset + old.factor * new.offset, by)
        found[one] = new


def satisfied(robot: Robot, ties: Iterable[Tie], keyed: bool | None, exact: float) -> list[str]:
    """Let the joints of a robot start as ties of them demand, where the first joint of a tie follows the other, which starts
    within its limits. Returns mistakes: ties that contradict each other. keyed: whether a key frame says the start; None: the
    ties alone do; exact: up to which a tie holds."""
    joints, found, wrong, broken = {j.name: j for j in robot.joints}, dict[Any, Folded](), list[str](), list[str]()
    for name, terms, value in ties:
        off, rate = sum(f * joints[j].start for j, f in terms) - value, sum(f * joints[j].rate for j, f in terms)
        broken += [f"'{name}'"] if max(abs(off), abs(rate)) > exact else []
        one = reduced(found, terms, value)
        if one.left:
            one.into(found, name)
        elif abs(one.value) > exact:
            wrong.append(f"equalities {', '.join(map(repr, (*one.by, name)))}: they contradict each other, by "
                         f"{abs(one.value):.3g}; remove one of them")
    moved = []
    for name, of in found.items():
        joint, start, rate = joints[name], 0.0, 0.0
        if of.of is not None:
            start, rate = joints[of.of].inside(), joints[of.of].rate
        start, rate, joint.tied = of.offset + of.factor * start, of.factor * rate, True
        moved += [f"'{name}'"] if max(abs(start - joint.start), abs(rate - joint.rate)) > exact else []
        joint.start, joint.rate = start, rate
    if broken and keyed:
        robot.heard.append(f"the key frame contradicts ties of joints ({', '.join(broken)}), by which {', '.join(moved)} start "
                           f"otherwise")
    elif broken and keyed is not None:
        robot.heard.append(f"ties of joints ({', '.join(broken)}) hold from the start on; MuJoCo starts at the file's zero, and "
                           f"pulls {', '.join(moved)} to them")
    return wrong


def folded_of(scene: Any, inside: set[str]) -> tuple[dict[tuple[str, str], Folded], set[str]]:
    """Coordinates that couplings of two coordinates make multiples of others, and the names of these couplings. inside: names of
    the joints of trees."""
    found: dict[tuple[str, str], Folded] = {}
    names: set[str] = set()
    for c in scene.connections:
        law = c.laws[0]
        if not isinstance(law, Gear | Rack | WeightedSum):
            continue
        terms, value = couples(law)
        if len(terms) != 2 or not isinstance(value, int | float) or any(key[0] not in inside for key, _ in terms):
            continue
        one = reduced(found, terms, value)
        if len(one.left) == 2:
            one.into(found, c.name)
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


def unusual(c: Any) -> list[str]:
    """What a joint has that MJCF does not say of any joint, in words."""
    apart = any(getattr(c.laws[0], key) is not None for key in ("at_l", "axis_l", "axis_x_l"))
    has = {"a prescribed motion": c.prescribed, "clearance": c.loose, "a third body": c.others,
           "friction by its reaction (normal_force= states another)": c.rubs,
           "a frame on l stated apart from that on k (draw the bodies in the joint)": apart}
    return [what for what, true in has.items() if true]


def acting(c: Any) -> list[str]:
    """What acts on the coordinates of a joint, in words."""
    words = {JointSpring: "a spring", JointDamper: "a damper", JointLoad: "a load", JointStop: "limits",
             JointFriction: "friction"}
    return [*(words.get(type(force), type(force).__name__) for force in c.laws[1:]), *["a rotor"] * any(c.rotor.values())]
