"""Geometry of a scene over time, for drawings, GIFs and the player: shapes fixed to bodies, or given at every time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbdae.scene.components import Array

INK = "#222222"


@dataclass(frozen=True, eq=False)
class Shape:
    """A polyline or markers of one item. `points`, m: (1, n, 3) in axes of the named body, from its centre of mass; where `body`
    is "", in the inertial frame, (nt, n, 3), or (1, n, 3) if it does not move."""

    item: str
    kind: str  #: key of `drawing.LOOKS`
    colour: str
    points: Array
    body: str = ""
    faces: tuple[tuple[int, ...], ...] = ()  #: faces of a solid by point numbers, counter-clockwise from outside
    shades: tuple[int, ...] = ()  #: shade of each face, 0 or 1


@dataclass(frozen=True, eq=False)
class Pose:
    """Position (nt, 3), m, of the centre of mass and rotation matrix (nt, 3, 3), body to inertial."""

    position: Array
    rotation: Array


@dataclass(frozen=True, eq=False)
class Label:
    """A name and its point, m: (1, 3) in axes of the body, or (1, 3) or (nt, 3) in the inertial frame, as for a `Shape`."""

    text: str
    points: Array
    body: str
    of_body: bool


@dataclass(frozen=True, eq=False)
class Geometry:
    """Shapes and names of a scene at times t (nt,), s; `size`: extent of the scene, m."""

    name: str
    t: Array
    planar: bool
    size: float
    gravity: Array
    poses: dict[str, Pose]
    shapes: tuple[Shape, ...]
    labels: tuple[Label, ...]

    def polyline(self, shape: Shape) -> Array:
        """Points (nt, n, 3) of a shape over time, m, inertial frame."""
        if shape.body:
            return moved(self.poses[shape.body], shape.points[0])
        return np.broadcast_to(shape.points, (len(self.t), *shape.points.shape[1:]))

    def place(self, label: Label) -> Array:
        """Positions (nt, 3), m, to which a name belongs."""
        if label.body:
            return moved(self.poses[label.body], label.points)[:, 0]
        return np.broadcast_to(label.points, (len(self.t), 3))

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest coordinates (3,), m, over all times; for a single point those of a cube of 1 m around it."""
        lines = [self.polyline(shape).reshape(-1, 3) for shape in self.shapes]
        points: Array = np.concatenate(lines)
        low, high = points.min(axis=0), points.max(axis=0)
        return (low - 0.5, high + 0.5) if np.array_equal(low, high) else (low, high)


def moved(pose: Pose, local: Array) -> Array:
    """Positions (nt, n, 3), m, over time of a body's points (n, 3) given in its axes."""
    return np.asarray(pose.position[:, None] + np.einsum("tij,nj->tni", pose.rotation, local))
