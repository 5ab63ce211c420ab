"""Shapes of bodies: what touches, and what is drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Shape:
    """A shape that is fixed to a body. `at`: a point (m) as drawn; None: the body's centre of mass."""

    at: Any = None


@dataclass(frozen=True)
class Plane(Shape):
    """A half space; `normal`, as drawn, points out of it, to the free side."""

    normal: Any = (0, 0, 1)


@dataclass(frozen=True)
class Sphere(Shape):
    """A ball of `radius` (m) about `at`; a disc in a planar scene."""

    radius: float = 1.0


@dataclass(frozen=True)
class Point(Shape):
    """A point of a body."""


@dataclass(frozen=True)
class Cylinder(Shape):
    """A cylinder about `axis`, as drawn, of `radius` and `length` (m), its middle at `at`; without a length it has no ends."""

    axis: Any = (0, 0, 1)
    radius: float = 1.0
    length: float | None = None


@dataclass(frozen=True)
class Box(Shape):
    """A box with its middle at `at` and edges of `size` (three lengths, m) along the columns of `rotation` (3, 3) as drawn; None:
    along the inertial axes."""

    size: Any = (1, 1, 1)
    rotation: Any = None
