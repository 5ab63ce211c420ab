"""Shapes as they are drawn: outlines and hatched lines in the plane, faces and grids in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np

from mbdae.scene.components import Array
from mbdae.scene.shapes import Box, Cylinder, Plane, Point, Shape, Sphere
from mbdae.show import symbols

AROUND, STACKS = 24, 10  #: number of faces around a ball or cylinder, and from pole to pole
SECTOR = 6  #: number of neighbouring faces with one shade; shades alternate so that rotation is visible
ENDLESS = 3.0  #: drawn length of a cylinder without ends, relative to the size of the scene


@dataclass(frozen=True, eq=False)
class Drawn:
    """A polyline (n, 3), m as drawn, and its kind; for a solid its corners, its faces (counter-clockwise seen from outside) and
    a shade (0 or 1) of each."""

    kind: str
    points: Array
    faces: tuple[tuple[int, ...], ...] = ()
    shades: tuple[int, ...] = ()


def drawn(one: Any, planar: bool, size: float) -> list[Drawn]:
    """Pieces with which a shape other than a plane is drawn; size: extent of the scene, m."""
    if isinstance(one, Point):
        return [Drawn("dot", one.at[None])]
    if planar:
        return _flat(one, size)
    if isinstance(one, Sphere):
        return [_ball(one.at, one.radius)]
    if isinstance(one, Cylinder):
        return [_cylinder(one, ENDLESS * size if one.length is None else one.length)]
    return [_box(one)]


def outline(one: Any) -> list[Array]:
    """Points (n, 3), m as drawn, that bound a shape: none for a plane; for a cylinder its ends where it has some."""
    if isinstance(one, Plane):
        return []
    if isinstance(one, Box):
        return [corners(one)]
    half = getattr(one, "length", None) or 0.0
    about = one.at + half / 2 * np.array([[-1.0], [1.0]]) * getattr(one, "axis", symbols.Z)
    return [about + sign * getattr(one, "radius", 0.0) * e for sign in (-1, 1) for e in np.eye(3)]


def _flat(one: Any, size: float) -> list[Drawn]:
    """Outlines of a shape in the plane z = 0."""
    upright = isinstance(one, Cylinder) and abs(one.axis[2]) > 1 / 2**0.5
    if isinstance(one, Sphere) or upright:
        x, y = one.radius * np.eye(3)[:2]
        return [Drawn("disc", symbols.circle(one.at, x, y, 4 * AROUND)), Drawn("line", np.array([one.at, one.at + x]))]
    if isinstance(one, Cylinder):
        along = symbols.unit(one.axis * (1, 1, 0)) * (ENDLESS * size if one.length is None else one.length) / 2
        beside = one.radius * symbols.across(along)
        outline = one.at + np.array([along + beside, beside - along, -along - beside, along - beside])
    else:
        outline = symbols.hull(corners(one)) + one.at * symbols.Z
    return [Drawn("plate", np.vstack([outline, outline[:1]]))]


def corners(box: Box) -> Array:
    """Corners (8, 3), m, of a box as drawn."""
    axes = np.eye(3) if box.rotation is None else np.asarray(box.rotation)
    return np.asarray(box.at + np.array(list(product((-0.5, 0.5), repeat=3))) * box.size @ axes.T)


def _box(box: Box) -> Drawn:
    faces = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return Drawn("solid", corners(box), faces, (0,) * 6)


def _band(low: int, high: int) -> list[tuple[int, ...]]:
    """Faces between two rings of corners with the numbers of their first corners."""
    return [(low + i, low + j, high + j, high + i) for i, j in pairwise([*range(AROUND), 0])]


def _alternate(bands: int) -> tuple[int, ...]:
    return tuple(i // SECTOR % 2 for _ in range(bands) for i in range(AROUND))


def _turned() -> Array:
    a = 2 * np.pi * np.arange(AROUND) / AROUND
    return np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)


def _ball(center: Array, radius: float) -> Drawn:
    rise = np.pi * (np.arange(STACKS + 1) / STACKS - 0.5)
    rings = [np.cos(b) * _turned() + np.sin(b) * symbols.Z for b in rise]
    bands = [_band(AROUND * i, AROUND * (i + 1)) for i in range(STACKS)]
    faces = tuple(face for band in bands for face in band)
    return Drawn("solid", center + radius * np.vstack(rings), faces, _alternate(STACKS))


def _cylinder(one: Cylinder, length: float) -> Drawn:
    e1, e2 = symbols.plane_of(one.axis)
    ring = one.radius * _turned()[:, :2] @ np.array([e1, e2])
    half = length / 2 * np.asarray(one.axis)
    points = one.at + np.vstack([ring - half, ring + half, [-half, half]])
    ends = [(2 * AROUND, j, i) for i, j in pairwise([*range(AROUND), 0])]
    ends += [(2 * AROUND + 1, AROUND + i, AROUND + j) for i, j in pairwise([*range(AROUND), 0])]
    return Drawn("solid", points, (*_band(0, AROUND), *ends), _alternate(3))


def plane(one: Plane, reach: Array, size: float, planar: bool) -> Drawn:
    """A plane as far as the points (n, 3), m, in the axes of the plane as drawn: a hatched line, or a grid."""
    normal = np.asarray(one.normal)
    if planar:
        along = symbols.across(normal)
        low, high = _ends((reach - one.at) @ along, 0.1 * size)
        return Drawn("hatch", _hatched(one.at + low * along, one.at + high * along, -0.03 * size * symbols.unit(normal)))
    sides = [_ends((reach - one.at) @ e, 0.1 * size) for e in symbols.plane_of(normal)]
    return Drawn("grid", _grid(np.asarray(one.at), symbols.plane_of(normal), sides))


def _ends(ways: Array, more: float) -> tuple[float, float]:
    return float(min(0.0, np.min(ways, initial=0.0)) - more), float(max(0.0, np.max(ways, initial=0.0)) + more)


def _hatched(a: Array, b: Array, down: Array) -> Array:
    """A line with hatching on its lower side, as one polyline."""
    way = float(np.linalg.norm(b - a))
    along = symbols.unit(b - a) * np.linalg.norm(down)
    on = a + np.linspace(0, 1, int(np.clip(way / (1.2 * np.linalg.norm(down)), 8, 400)))[:, None] * (b - a)
    return np.stack([on, on + down - along, on], axis=1).reshape(-1, 3)


def _grid(at: Array, axes: tuple[Array, Array], sides: Sequence[tuple[float, float]]) -> Array:
    """A grid of about ten by ten squares as one polyline that runs back and forth."""
    (a, b), (c, d) = sides
    step = max(b - a, d - c) / 10
    x, y = (np.linspace(low, high, max(2, round((high - low) / step) + 1)) for low, high in sides)
    path = [(u, v) for i, u in enumerate(x) for v in ((c, d) if i % 2 == 0 else (d, c))]
    back = path[-1][1] == d
    path += [(u, v) for j, v in enumerate(y[::-1] if back else y) for u in ((b, a) if j % 2 == 0 else (a, b))]
    return np.asarray(at + np.array(path) @ np.array(axes))


def same(one: Shape, other: Shape) -> bool:
    """Whether two shapes are drawn alike; planes may have different points."""
    if type(one) is not type(other):
        return False
    if isinstance(one, Plane) and isinstance(other, Plane):
        return bool(np.allclose(one.normal, other.normal) and abs((one.at - other.at) @ one.normal) < 1e-12)
    mine, others = vars(one).values(), vars(other).values()
    return all((a is None and b is None) or (a is not None and b is not None and np.array_equal(a, b))
               for a, b in zip(mine, others, strict=True))  # fmt: skip
