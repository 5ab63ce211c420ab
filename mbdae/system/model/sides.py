"""The frames of a law in a model: kinds of their nodes, axes, and numbers."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from mbdae.errors import LawError
from mbdae.scene.components import Array, Body
from mbdae.symbolic.derive import Side
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.law import Element
from mbdae.system.model.nodes import Node


def sides_of(law: Any, bodies: tuple[Body, ...], nodes: tuple[Node | None, ...],
           planar: bool) -> tuple[tuple[Side, ...], dict[str, float]]:  # fmt: skip
    """Kind of node and structure of axes of every frame of a law, and the numbers of the frames by name: in body axes, the
    joint's point, the joint's axes, and the heading of the body (rad, in the plane)."""
    if isinstance(law, Element):
        assert nodes[0] is not None
        return ((nodes[0].kind, Axes.GENERAL),), {}
    J = joint_axes(law, bodies[0]) if bodies else np.eye(3)
    sides: list[Side] = []
    numbers: dict[str, float] = {}
    for side, body, node in zip(law.frames, bodies, nodes, strict=True):
        kind = node.kind if node is not None else (NodeKind.PLANAR_GROUND if planar else NodeKind.GROUND)
        Q = body.drawn.rotation.T @ J
        offset = body.drawn.rotation.T @ (law.point_on(side) - body.drawn.position)
        sides.append((kind, pattern(Q) if planar else Axes.GENERAL))
        numbers |= zip(_names(side), (*offset.tolist(), *Q.T.ravel().tolist(), body.heading), strict=True)
    if law.at_nodes:
        sides = [(kind, Axes.NORMAL if planar else Axes.GENERAL) for kind, _ in sides]
    return tuple(sides), numbers


@lru_cache(maxsize=64)
def _names(side: str) -> tuple[str, ...]:
    """Names of the numbers of a frame, in the order of `sides_of`: its point, its axes column by column, its heading."""
    axes = (f"{side}_Q{a}{i + 1}" for a in "xyz" for i in range(3))
    return *(f"{side}_p{i + 1}" for i in range(3)), *axes, f"{side}_theta0"


def joint_axes(law: Any, k: Body) -> Array:
    """Joint axes as drawn, columns of a matrix (3, 3) in inertial components: z along the joint's axis. A law with `axes_of` uses
    the axes of that body instead. k: the body of its first frame."""
    if law.axes_of == "k":
        return k.drawn.rotation
    if law.axes_of == "l":
        return law.l.drawn.rotation  # type: ignore[no-any-return]
    return _axes(tuple(map(float, law.axis)), None if law.axis_x is None else tuple(map(float, law.axis_x)))


@lru_cache(maxsize=1024)
def _axes(axis: tuple[float, ...], axis_x: tuple[float, ...] | None) -> Array:
    z = np.array(axis)
    if axis_x is not None:
        x = np.array(axis_x) - (np.array(axis_x) @ z) * z
        x /= np.linalg.norm(x)
    elif abs(z[2]) < 1e-14:
        x = np.array([0.0, 0.0, 1.0])
    else:
        helper = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
        x = helper - (helper @ z) * z
        x /= np.linalg.norm(x)
    y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]]
    found = np.array([x, y, z]).T
    found.flags.writeable = False  # read-only, because all joints with these axes share the array
    return found


def pattern(Q: Array) -> Axes:
    """How the joint axes Q (columns, in body axes) of a planar scene lie, which decides which entries of Q are 0 or 1. Raises
    LawError where z of Q is neither in the plane nor normal to it."""
    if abs(Q[2, 2] - 1) < 1e-12:
        return Axes.NORMAL
    if abs(Q[2, 2] + 1) < 1e-12:
        return Axes.REVERSED
    if abs(Q[2, 2]) < 1e-12 and abs(Q[2, 0] - 1) < 1e-12:
        return Axes.IN_PLANE
    if abs(Q[2, 2]) < 1e-12:
        raise LawError(f"its axis is in the plane, but its x axis ({Q[0, 0]:.6g}, {Q[1, 0]:.6g}, {Q[2, 0]:.6g}) is not (0, 0, "
                       "1); omit axis_x")  # fmt: skip
    raise LawError(f"its axis ({Q[0, 2]:.6g}, {Q[1, 2]:.6g}, {Q[2, 2]:.6g}) is neither in the plane nor normal to it")
