"""Symbols in drawings of mechanisms, such as springs, arrows and hatching, as polylines: arrays of points (n, 3), m;
solids as they are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np

from mbdae.scene.shapes import Box, Cylinder, Plane, Point, Shape, Sphere
from mbdae.values import Array

Z = np.array([0.0, 0.0, 1.0])


def unit(v: Array) -> Array:
    """v (3,) divided by its length; zero where v is zero."""
    length = float(np.linalg.norm(v))
    return v / length if length else v


def across(direction: Array) -> Array:
    """A unit vector (3,) normal to a direction, in the plane z = 0 where possible."""
    side = np.cross(Z, direction)
    if np.linalg.norm(side) < 1e-6 * (np.linalg.norm(direction) or 1.0):
        side = np.array([1.0, 0.0, 0.0])
    return unit(side)


def zigzag(a: Array, b: Array, width: float, turns: int = 6) -> Array:
    """A coil spring as a zigzag (nt, n, 3) between points a and b (nt, 3); width: half its width, m."""
    share = np.r_[0, 0.12, 0.12 + 0.76 * (np.arange(2 * turns) + 0.5) / (2 * turns), 0.88, 1]
    offset = np.r_[0, 0, width * (-1.0) ** np.arange(2 * turns), 0, 0]
    side = np.array([across(d) for d in b - a])
    return np.asarray(a[:, None] + share[None, :, None] * (b - a)[:, None] + offset[None, :, None] * side[:, None])


def arrow(tail: Array, tip: Array, head: float) -> Array:
    """An arrow (5, 3) as one polyline; head: length of its head, m."""
    d = unit(tip - tail)
    side = across(d)
    head = min(head, float(np.linalg.norm(tip - tail)))
    return np.array([tail, tip, tip - head * (d + 0.45 * side), tip, tip - head * (d - 0.45 * side)])


def circle(center: Array, e1: Array, e2: Array, points: int = 48) -> Array:
    """A closed ellipse (points + 1, 3) with half-axes e1 and e2."""
    a = np.linspace(0, 2 * np.pi, points + 1)
    return np.asarray(center + np.cos(a)[:, None] * e1 + np.sin(a)[:, None] * e2)


def plane_of(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors normal to a unit axis and to each other; with the axis they are right-handed."""
    e1 = across(axis)
    return e1, np.cross(axis, e1)


def turning_arrow(center: Array, axis: Array, radius: float) -> Array:
    """An arrow (n, 3) along about 0.7 of a circle about an axis."""
    e1, e2 = plane_of(unit(axis))
    a = np.linspace(-0.25, 1.15, 24) * np.pi
    arc = center + radius * (np.cos(a)[:, None] * e1 + np.sin(a)[:, None] * e2)
    head, forward = 0.5 * radius, unit(arc[-1] - arc[-5])
    side = np.cross(unit(axis), forward)
    barbs = [arc[-1] - head * forward + 0.45 * sign * head * side for sign in (1, -1)]
    return np.vstack([arc, barbs[0], arc[-1], barbs[1]])


def spiral(center: Array, axis: Array, radius: float) -> Array:
    """A torsion spring (n, 3) as a spiral about an axis."""
    e1, e2 = plane_of(unit(axis))
    a = np.linspace(0, 5 * np.pi, 60)
    r = radius * (0.45 + 0.55 * a / a[-1])
    return np.asarray(center + (r * np.cos(a))[:, None] * e1 + (r * np.sin(a))[:, None] * e2)


def helix(start: Array, end: Array, radius: float, pitch: float) -> Array:
    """A thread (n, 3) about the line between two points; pitch: m per turn, right-handed where positive."""
    way = float(np.linalg.norm(end - start))
    e1, e2 = plane_of(unit(end - start))
    s = np.linspace(0.0, 1.0, max(2, int(24 * way / abs(pitch)) + 1))[:, None]
    a = 2 * np.pi * way / pitch * s
    return np.asarray(start + s * (end - start) + radius * (np.cos(a) * e1 + np.sin(a) * e2))


def yoke(center: Array, pin: Array, back: Array) -> Array:
    """A fork (8, 3) that holds a pin; pin: half the pin as a vector, back: vector from the pin to the base of the fork."""
    return np.asarray(center + np.array([pin, -pin, -pin + back, back, 1.8 * back, back, pin + back, pin]))


def hatching(point: Array, down: Array, size: float, foot: bool = True) -> Array:
    """Ground symbol (n, 3) under a point as one polyline: a triangle with its apex in the point, a base line, short strokes."""
    down = unit(down)
    side = across(down)
    base = point + (size if foot else 0.0) * down
    legs = [base - 0.6 * size * side, point, base + 0.6 * size * side] if foot else []
    strokes = []
    for x in np.linspace(-0.9, 0.9, 7) * size:
        on = base + x * side
        strokes += [on, on + 0.3 * size * (down - side), on]
    return np.array([*legs, base + 0.9 * size * side, *strokes[::-1]])


def slider(center: Array, axis: Array, length: float, height: float, flat: bool) -> Array:
    """A box about a point, long along an axis, as one polyline: a rectangle (5, 3) where flat, else its twelve edges (16, 3)."""
    e1, e2 = plane_of(unit(axis))
    a, b, c = length / 2 * unit(axis), height / 2 * (e1 if abs(e1[2]) < 0.9 else e2), height / 2 * np.cross(unit(axis), e1)
    ring = np.array([a + b, a - b, -a - b, -a + b, a + b])
    if flat:
        return np.asarray(center + ring)
    lower, upper = ring - c, ring + c
    return np.asarray(center + np.vstack([lower, upper, upper[1], lower[1], lower[2], upper[2], upper[3], lower[3]]))


def hull(points: Array) -> Array:
    """Corners (n, 3) of the convex hull of points (m, 3) in the plane z = 0, counter-clockwise."""
    order = [tuple(p) for p in np.unique(np.asarray(points)[:, :2], axis=0)]
    if len(order) < 3:
        return np.array([[*p, 0.0] for p in order])
    return np.array([[*p, 0.0] for p in _chain(order)[:-1] + _chain(order[::-1])[:-1]])


def _chain(points: list[tuple[float, ...]]) -> list[tuple[float, ...]]:
    out: list[tuple[float, ...]] = []
    for p in points:
        while len(out) > 1 and _turn(out[-2], out[-1], p) <= 0:
            out.pop()
        out.append(p)
    return out


def _turn(a: tuple[float, ...], b: tuple[float, ...], c: tuple[float, ...]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


# -- Shapes as they are drawn: outlines and hatched lines in the plane, faces and grids in space


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
    about = one.at + half / 2 * np.array([[-1.0], [1.0]]) * getattr(one, "axis", Z)
    return [about + sign * getattr(one, "radius", 0.0) * e for sign in (-1, 1) for e in np.eye(3)]


def _flat(one: Any, size: float) -> list[Drawn]:
    """Outlines of a shape in the plane z = 0."""
    upright = isinstance(one, Cylinder) and abs(one.axis[2]) > 1 / 2**0.5
    if isinstance(one, Sphere) or upright:
        x, y = one.radius * np.eye(3)[:2]
        return [Drawn("disc", circle(one.at, x, y, 4 * AROUND)), Drawn("line", np.array([one.at, one.at + x]))]
    if isinstance(one, Cylinder):
        along = unit(one.axis * (1, 1, 0)) * (ENDLESS * size if one.length is None else one.length) / 2
        beside = one.radius * across(along)
        outline = one.at + np.array([along + beside, beside - along, -along - beside, along - beside])
    else:
        outline = hull(corners(one)) + one.at * Z
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
    rings = [np.cos(b) * _turned() + np.sin(b) * Z for b in np.pi * (np.arange(STACKS + 1) / STACKS - 0.5)]
    bands = [_band(AROUND * i, AROUND * (i + 1)) for i in range(STACKS)]
    faces = tuple(face for band in bands for face in band)
    return Drawn("solid", center + radius * np.vstack(rings), faces, _alternate(STACKS))


def _cylinder(one: Cylinder, length: float) -> Drawn:
    e1, e2 = plane_of(one.axis)
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
        along = across(normal)
        low, high = _ends((reach - one.at) @ along, 0.1 * size)
        return Drawn("hatch", _hatched(one.at + low * along, one.at + high * along, -0.03 * size * unit(normal)))
    sides = [_ends((reach - one.at) @ e, 0.1 * size) for e in plane_of(normal)]
    return Drawn("grid", _grid(np.asarray(one.at), plane_of(normal), sides))


def _ends(ways: Array, more: float) -> tuple[float, float]:
    return float(min(0.0, np.min(ways, initial=0.0)) - more), float(max(0.0, np.max(ways, initial=0.0)) + more)


def _hatched(a: Array, b: Array, down: Array) -> Array:
    """A line with hatching on its lower side, as one polyline."""
    way = float(np.linalg.norm(b - a))
    along = unit(b - a) * np.linalg.norm(down)
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
               for a, b in zip(mine, others, strict=True))
