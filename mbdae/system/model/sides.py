"""The frames of a law in a model: kinds of their nodes, axes, and numbers."""

from __future__ import annotations

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
    """Kinds and axes of the law's frames, and the numbers of those frames."""
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
        numbers |= {f"{side}_p{i + 1}": float(v) for i, v in enumerate(offset)}
        numbers |= {f"{side}_Q{a}{i + 1}": float(Q[i, j]) for j, a in enumerate("xyz") for i in range(3)}
        numbers[f"{side}_theta0"] = body.heading
    if law.at_nodes:
        sides = [(kind, Axes.NORMAL if planar else Axes.GENERAL) for kind, _ in sides]
    return tuple(sides), numbers


def joint_axes(law: Any, k: Body) -> Array:
    """Joint axes as drawn (columns, inertial): z along the axis; laws along the axes of a body take that body's."""
    if law.axes_of == "k":
        return k.drawn.rotation
    if law.axes_of == "l":
        return law.l.drawn.rotation  # type: ignore[no-any-return]
    z = np.asarray(law.axis, dtype=float)
    if law.axis_x is not None:
        x = np.asarray(law.axis_x, dtype=float) - (law.axis_x @ z) * z
        x /= np.linalg.norm(x)
    elif abs(z[2]) < 1e-14:
        x = np.array([0.0, 0.0, 1.0])
    else:
        helper = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
        x = helper - (helper @ z) * z
        x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def pattern(Q: Array) -> Axes:
    """The planar structure of Q; raises LawError where there is none."""
    if abs(Q[2, 2] - 1) < 1e-12:
        return Axes.NORMAL
    if abs(Q[2, 2] + 1) < 1e-12:
        return Axes.REVERSED
    if abs(Q[2, 2]) < 1e-12 and abs(Q[2, 0] - 1) < 1e-12:
        return Axes.IN_PLANE
    raise LawError(f"its axis ({Q[0, 2]:.6g}, {Q[1, 2]:.6g}, {Q[2, 2]:.6g}) is neither in the plane nor normal to it")
