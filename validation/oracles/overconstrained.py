"""Mechanisms that move although their joints are more than enough: planar and spherical loops in space, Bennett, Sarrus, Cardan
shafts held at both ends, parallel cranks, doors on several hinges; at a random place, of random size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from oracles.bodies import GROUND, Mechanism, perpendicular
from oracles.mechanisms import a_body, a_joint, acted, around, unit

Z = np.array([0.0, 0.0, 1.0])


def chained(rng, letters, places, axes, pins=None, springs=(0,), drives=(), placed=None):
    """Bodies from the ground to the ground through joints at given places about given axes, all turned and moved at random
    (or by `placed`)."""
    turn, shift = placed or (Rotation.random(random_state=rng).as_matrix(), 0.3 * rng.normal(size=3))
    places, axes, n = np.asarray(places) @ turn.T + shift, np.asarray(axes) @ turn.T, len(letters) - 1
    bodies = tuple(a_body(rng, f"b{i}", (places[i] + places[i + 1]) / 2 + 0.1 * rng.normal(size=3)) for i in range(n))
    ends = [GROUND, *range(n), GROUND]
    joints = [a_joint(rng, a, f"J{i}", ends[i], ends[i + 1], places[i], axes[i], **({"pin": turn @ pins[i]} if a == "U" else {}))
              for i, a in enumerate(letters)]
    return Mechanism(bodies, acted(rng, joints, springs, drives))


def polygon(rng, n):
    """Corners of an irregular polygon in the plane."""
    angles = 2 * np.pi * np.arange(n) / n + 0.2 * rng.uniform(-1, 1, n)
    return np.column_stack([np.cos(angles), np.sin(angles), np.zeros(n)]) * rng.uniform(0.7, 1.3, n)[:, None]


def planar(rng, letters="RRRR", **own):
    """A planar loop in space: revolute joints normal to its plane at any height, prismatic ones in the plane."""
    n = len(letters)
    places = polygon(rng, n)
    direction = rng.uniform(0, 2 * np.pi, n)
    axes = [Z if a == "R" else np.array([np.cos(d), np.sin(d), 0.0]) for a, d in zip(letters, direction, strict=True)]
    return chained(rng, letters, places + rng.uniform(-0.3, 0.3, n)[:, None] * Z, axes, **own)


def parallelogram(rng, **own):
    """Two equal cranks."""
    angle, crank, base = rng.uniform(0.5, 1.5), rng.uniform(0.3, 0.8), rng.uniform(0.6, 1.2)
    up, along = crank * np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([base, 0.0, 0.0])
    return chained(rng, "RRRR", [0 * up, up, along + up, along], [Z] * 4, **own)


def spherical(rng, letters="RRRR", **own):
    """Axes that meet in a point."""
    n = len(letters)
    tilt, turn = rng.uniform(0.5, 1.0, n), 2 * np.pi * np.arange(n) / n + rng.uniform(-0.3, 0.3, n)
    axes = np.column_stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    return chained(rng, letters, axes * rng.uniform(0.5, 1.5, n)[:, None], axes, **own)


def bennett(rng, **own):
    """Bennett's linkage: opposite links equal, twists in the ratio of their sines to the lengths."""
    a, alpha, beta = rng.uniform(0.5, 1.0), rng.uniform(0.4, 0.9), rng.uniform(1.0, 1.5)
    lengths, twists, first = (a, a * np.sin(beta) / np.sin(alpha)), (alpha, beta), rng.uniform(0.5, 2.0)

    def along(angles):
        T, frames = np.eye(4), []
        for i, angle in enumerate(angles):
            frames.append(T)
            turned, twisted = np.eye(4), np.eye(4)
            turned[:3, :3] = Rotation.from_rotvec([0, 0, angle]).as_matrix()
            twisted[:3, :3], twisted[0, 3] = Rotation.from_rotvec([twists[i % 2], 0, 0]).as_matrix(), lengths[i % 2]
            T = T @ turned @ twisted
        return frames, T

    def angles(second):
        return first, second, 2 * np.pi - first, 2 * np.pi - second

    grid = np.linspace(0.05, 2 * np.pi - 0.05, 200)
    off = [along(angles(second))[1][2, 3] for second in grid]
    for low, high, one, other in zip(grid[:-1], grid[1:], off[:-1], off[1:], strict=True):
        if one * other < 0:
            second = brentq(lambda x: along(angles(x))[1][2, 3], low, high, xtol=1e-15, rtol=1e-15)
            frames, T = along(angles(second))
            if np.max(np.abs(T - np.eye(4))) < 1e-12:
                return chained(rng, "RRRR", [f[:3, 3] for f in frames], [f[:3, 2] for f in frames], **own)
    raise AssertionError("Bennett's linkage does not close")


def sarrus(rng, **own):
    """Two chains of three parallel hinges each in two planes: the plate between them moves along a straight line."""
    x, y = np.eye(3)[:2]
    tilted = Rotation.from_rotvec([0, 0, rng.uniform(-0.4, 0.4)]).as_matrix() @ y
    height, out = rng.uniform(0.6, 1.0), rng.uniform(0.3, 0.6)

    def hinges(axis):
        normal = np.cross(axis, Z)
        return [normal, (1 + out) * normal + height / 2 * Z, normal + height * Z]

    return chained(rng, "RRRRRR", [*hinges(x), *hinges(tilted)[::-1]], [x] * 3 + [tilted] * 3, **own)


def cardan(rng, **own):
    """A shaft of three parts with two universal joints, both ends held."""
    bends = [Rotation.from_rotvec(rng.uniform(0.2, 0.6) * unit(rng)).as_matrix() @ Z for _ in range(2)]
    directions = [Z, bends[0], bends[0] + bends[1] - Z]
    directions = [d / np.linalg.norm(d) for d in directions]
    places = np.cumsum([np.zeros(3), 0.5 * directions[0], rng.uniform(0.5, 1) * directions[1], 0.5 * directions[2]], axis=0)
    crosses = [perpendicular(d)[0] for d in directions]
    pins = [None, np.cross(crosses[0], directions[1]), np.cross(crosses[1], directions[2]), None]
    pins = [p if p is None else p / np.linalg.norm(p) for p in pins]
    return chained(rng, "RUUR", places, [directions[0], crosses[0], crosses[1], directions[2]], pins, springs=(3,), **own)


def one_joint_shaft(rng, **own):
    """A shaft of two parts with one universal joint, both ends held: a spherical loop."""
    a, b = Z, Rotation.from_rotvec(rng.uniform(0.3, 0.8) * np.eye(3)[0]).as_matrix() @ Z
    cross = perpendicular(a)[0]
    pin = np.cross(cross, b)
    return chained(rng, "RUR", [-0.5 * a, 0 * a, 0.6 * b], [a, cross, b], [None, pin / np.linalg.norm(pin), None], **own)


def door(rng, hinges=3, letter="R", **own):
    """A body on several hinges, or ball joints, of one line, with a second body on it."""
    axis, foot = unit(rng), rng.normal(size=3)
    bodies = (a_body(rng, "door", foot + 0.5 * unit(rng)), a_body(rng, "flap", foot + unit(rng)))
    heights = np.arange(hinges) + rng.uniform(-0.2, 0.2, hinges)
    joints = [a_joint(rng, letter, f"J{i}", GROUND, 0, foot + h * axis, axis) for i, h in enumerate(heights)]
    joints.append(a_joint(rng, "R", "flap hinge", 0, 1, foot + 0.7 * unit(rng)))
    return Mechanism(bodies, acted(rng, joints, (len(joints) - 1,), own.get("drives", ())))


def welded_twice(rng, **own):
    """A loop of three bodies of which two are welded together at two places."""
    m = planar(rng, "RWRRR", **own)
    again = a_joint(rng, "W", "second weld", 0, 1, m.bodies[1].at)
    return replace(m, joints=(*m.joints, again))


def cranks(rng, number=3, **own):
    """A platform on parallel cranks of equal length, whose feet lie anywhere in space."""
    crank, axis = rng.uniform(0.4, 0.8), unit(rng)
    x, y = perpendicular(axis)
    arm = crank * (np.cos(0.7) * x + np.sin(0.7) * y)
    feet = rng.normal(size=(number, 3))
    bodies = [a_body(rng, "platform", np.mean(feet, axis=0) + arm)]
    joints = []
    for i, foot in enumerate(feet):
        bodies.append(a_body(rng, f"crank {i}", foot + arm / 2 + 0.1 * rng.normal(size=3)))
        joints.append(a_joint(rng, "R", f"foot {i}", GROUND, i + 1, foot, axis))
        joints.append(a_joint(rng, "R", f"head {i}", i + 1, 0, foot + arm, axis))
    return Mechanism(tuple(bodies), acted(rng, joints, (0,), own.get("drives", ())))


def six_bar(rng, spherical_one=False, placed=None, **own):
    """A four-bar with a further pair of bars between its coupler and the ground, planar or spherical."""
    placed = placed or (Rotation.random(random_state=rng).as_matrix(), 0.3 * rng.normal(size=3))
    m = spherical(rng, placed=placed, **own) if spherical_one else planar(rng, placed=placed, **own)
    turn, shift = placed
    corners = np.array([[1.6, 0.6, 0.0], [1.9, -0.3, 0.1], [0.9, -1.0, -0.2]]) + 0.1 * rng.normal(size=(3, 3))
    axes = (corners + Z * 1.5) / np.linalg.norm(corners + Z * 1.5, axis=1)[:, None] if spherical_one else np.array([Z] * 3)
    places = (axes if spherical_one else corners) @ turn.T + shift
    bodies = tuple(a_body(rng, f"c{i}", (places[i] + places[i + 1]) / 2 + 0.1 * rng.normal(size=3)) for i in range(2))
    ends = [1, 3, 4, GROUND]
    joints = tuple(a_joint(rng, "R", f"K{i}", ends[i], ends[i + 1], places[i], turn @ axes[i]) for i in range(3))
    return replace(m, bodies=(*m.bodies, *bodies), joints=(*m.joints, *joints))


def crossed(rng, **own):
    """A planar four-bar whose first crank is shared by a loop in space."""
    m = planar(rng, **own)
    axis = unit(rng)
    x, y = perpendicular(axis)
    corners = np.array([[0.5, 0.1], [1.2, 0.3], [0.9, -0.6]]) @ np.array([x, y])
    places = m.joints[0].at + corners + 0.1 * rng.normal(size=(3, 1)) * axis
    bodies = tuple(a_body(rng, f"c{i}", (places[i] + places[i + 1]) / 2 + 0.1 * rng.normal(size=3)) for i in range(2))
    ends, letters = [0, 3, 4, GROUND], "SUS"
    joints = tuple(a_joint(rng, a, f"K{i}", ends[i], ends[i + 1], places[i]) for i, a in enumerate(letters))
    return replace(m, bodies=(*m.bodies, *bodies), joints=(*m.joints, *joints))


def driven(make, joint=0):
    """The same with a drive at one joint in place of its spring."""

    def made(rng, **own):
        m = make(rng, **own)
        joints = tuple(replace(j, spring=0.0, damper=0.0, load=0.0) if i == joint else j for i, j in enumerate(m.joints))
        return replace(m, joints=acted(rng, joints, (), (joint,)))

    return made


def under_forces(make):
    """The same with gravity, springs and loads."""
    return lambda rng: around(rng, make(rng))
