"""Symbols in drawings of mechanisms, such as springs, arrows and hatching, as polylines: arrays of points (n, 3), m."""

from __future__ import annotations

import numpy as np

from mbdae.scene.components import Array

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
    along = a[:, None] + share[None, :, None] * (b - a)[:, None]
    return np.asarray(along + offset[None, :, None] * side[:, None])


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
    corners = _chain(order)[:-1] + _chain(order[::-1])[:-1]
    return np.array([[*p, 0.0] for p in corners])


def _chain(points: list[tuple[float, ...]]) -> list[tuple[float, ...]]:
    out: list[tuple[float, ...]] = []
    for p in points:
        while len(out) > 1 and _turn(out[-2], out[-1], p) <= 0:
            out.pop()
        out.append(p)
    return out


def _turn(a: tuple[float, ...], b: tuple[float, ...], c: tuple[float, ...]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
