"""Coordinates of a tree; couplings of two of them: one is folded in, a multiple of the other; two trees whose coordinates have
other names and another order; what joints have beside their motion, in words; where the mass matrix of a tree is singular but
for rounding, and which coordinate then moves no inertia.

Eliminated from the leaves inwards, every pivot of the mass matrix is the inertia that a coordinate moves when all that it carries
is free to follow. Its rounding is that of the inertia of what is carried about any axis through the joint; below that, an
acceleration is a quotient of rounding errors."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from mbdae.errors import OptionError, SceneError
from mbdae.laws.forces import JointDamper, JointFriction, JointLoad, JointSpring
from mbdae.laws.on_coordinates import Gear, JointStop, Rack, WeightedSum
from mbdae.robots import Robot
from mbdae.scene.record import encode
from mbdae.scene.replay import Known, replay
from mbdae.scene.shapes import joint_axes
from mbdae.system.model.model import build
from mbdae.system.model.trees import Tree

Array = NDArray[np.float64]
FLOATS = "{} floats"  #: name of the joint by which a body that no joint holds is given six freedoms
ROUND_OFF = 1e-12  #: of factors of a sum, over those of its terms
STATES = 5  #: random states at which two trees are compared
NOTHING_MOVED = ("no inertia is moved by it{}, but for rounding, so that nothing says how it accelerates; give its body inertia, "
                 "or the joint rotor=")
WIDE = 1e8  #: ratio of masses from which on messages name it
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


# -- what moves no inertia



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
        masses = [b.mass for b in tree.scene.bodies if b.mass]
        spread = f", of masses between {min(masses):.2g} and {max(masses):.2g} kg," if max(masses) > WIDE * min(masses) else ""
        return (f"{', '.join(tree.coordinates[k] for k in moved)}: they move the same inertia{spread} alike{where}, but for "
                f"rounding, so that nothing says how each accelerates; give {'masses that differ less, or ' if spread else ''}"
                f"one of their joints rotor=, or leave this position")
    return f"{', '.join(alone)}: {NOTHING_MOVED.format(where)}"


def first_of(wrong: Any, one: str) -> tuple[tuple[int, ...], str]:
    """Of states (...) that are wrong the first, and words on which they are; one: those where there is one state alone."""
    row = tuple(int(n[0]) for n in np.nonzero(wrong)) if np.ndim(wrong) else ()
    count = np.count_nonzero(wrong)
    states = f"{count} of {np.size(wrong)} states, the first of them" if count > 1 else "state"
    return row, f" in {states} {list(row)}" if row else one


def refuse_singular(tree: Any, x: Array, wrong: Any) -> None:
    """Raise an error where accelerations cannot be computed: SceneError where the mass matrix is singular but for rounding, else
    OptionError. x (..., inputs): states, which begin with q; wrong (...): where pivots are rounding or are not numbers."""
    if not np.any(wrong):
        return
    row, where = first_of(wrong, " at this q")
    if text := singular(tree, x[row][: tree.nq], where):
        raise SceneError([text])
    raise OptionError(f"accelerations are beyond the range of numbers{where}: give smaller v or tau")


#: moment of inertia, over the largest of a body, that a thin rod gets about its axis, since MuJoCo wants one
THIN = 1e-9


def solid(scene: Any) -> tuple[Any, list[str]]:
    """A scene in space whose bodies have the moments of inertia about all axes that MuJoCo asks for, and what was given, in
    words: in the plane those about its normal alone count."""
    planar = scene.space != "spatial" and bool(scene.bodies) and build(scene).planar
    given: dict[str, Any] = {}
    for b in (b for b in scene.bodies if b.inertia is not None and np.any(b.inertia)):
        moments, axes = np.linalg.eigh(b.inertia)
        if moments[0] >= THIN * moments[-1] and moments[2] <= moments[0] + moments[1]:
            continue
        least = np.maximum(moments, THIN * moments[-1])
        given[b.name] = np.eye(3) * b.inertia[2, 2] if planar else axes @ np.diag(least) @ axes.T
    if not (planar or given):
        return scene, []
    statements = []
    for method, args, kwargs in scene.statements:
        if method in ("link", "rigid_body") and args and args[0] in given:
            b = scene[args[0]]
            kept = {name: value for name, value in kwargs.items() if name in ("shape", "color", "gravity")}
            placed = {"at": encode(b.drawn.position), "rotation": encode(b.drawn.rotation), "as_given": True,
                      "velocity": encode(b.drawn.velocity), "angular_velocity": encode(b.drawn.angular_velocity)}
            method, args, kwargs = "rigid_body", [b.name, b.mass, encode(given[b.name])], kept | placed
        statements.append([method, args, kwargs])
    data = {"name": scene.name, "gravity": scene.gravity.tolist(), "space": "spatial", "statements": statements}
    how = "that about the normal of the plane about all axes" if planar else f"{THIN:g} of their largest moment about thin axes"
    told = [f"inertia that MuJoCo asks for: {', '.join(map(repr, given))} have {how}"] if given else []
    return replay(data, type(scene), Known(dict(scene.own))), told
