"""Where the mass matrix of a tree is singular but for rounding, and which coordinate then moves no inertia.

Eliminated from the leaves inwards, every pivot is the inertia that a coordinate moves when all that it carries is free to follow.
Its rounding is that of the inertia of what is carried about any axis through the joint; below that, an acceleration is a quotient
of rounding errors."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import OptionError, SceneError
from mbdae.scene.record import encode
from mbdae.scene.replay import Known, replay
from mbdae.system.model.model import build
from mbdae.system.model.trees import Tree

Array = NDArray[np.float64]
NOTHING_MOVED = ("no inertia is moved by it{}, but for rounding, so that nothing says how it accelerates; give its body inertia, "
                 "or the joint rotor=")
WIDE = 1e8  #: ratio of masses from which on messages name it
#: pivots below this part of the inertia that their terms may have are rounding
ROUNDING = 64 * float(np.finfo(float).eps)


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
