"""Mechanisms with more constraints than their motion needs, in random poses, with the freedoms and redundant rows they have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import mbdae as mb

SPEED = 3.0  #: rad/s, of the driven or started joint
Z = np.array([0.0, 0.0, 1.0])


class Universal(mb.Joint):
    """The points coincide; the pins of the cross stay perpendicular. Multiplier of `cross`: N m."""

    def constraints(self, k: Any, l: Any) -> dict[str, Any]:
        d = l.r - k.r
        return {"x": k.x @ d, "y": k.y @ d, "z": k.z @ d, "cross": k.x @ l.y}


class Cylindrical(mb.Joint):
    """A shaft that turns and slides along its axis."""

    def constraints(self, k: Any, l: Any) -> dict[str, Any]:
        d = l.r - k.r
        return {"x": k.x @ d, "y": k.y @ d, "tilt_x": k.x @ l.z, "tilt_y": k.y @ l.z}


class Pose:
    """A scene built in a frame of its own that lies anywhere in space; the first hinge gets `start`."""

    def __init__(self, name: str, rng: np.random.Generator, start: dict[str, Any]) -> None:
        self.scene, self.rng, self.start = mb.Scene(name), rng, start
        self.R, self.r = Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)
        self.ground = self.scene.ground

    def point(self, x: Any) -> Any:
        return self.r + self.R @ np.asarray(x, dtype=float)

    def body(self, name: str, *points: Any) -> Any:
        centre = np.mean(points, axis=0)
        return self.scene.rigid_body(name, 1.0, (0.02, 0.03, 0.025), at=self.point(centre), rotation=self.R)

    def hinge(self, name: str, k: Any, l: Any, at: Any, axis: Any = Z) -> None:
        options, self.start = self.start, {}
        self.scene.revolute(name, k, l, at=self.point(at), axis=self.R @ np.asarray(axis), **options)

    def add(self, law: Any, name: str, k: Any, l: Any, at: Any, axis: Any) -> None:
        self.scene.add(law(name, k, l, at=self.point(at), axis=self.R @ np.asarray(axis)))

    def ball(self, name: str, k: Any, l: Any, at: Any) -> None:
        self.scene.spherical(name, k, l, at=self.point(at))


def cardan(p: Pose, output: str) -> None:
    """Two universal joints between shafts at angles, not in one plane; output: how the last shaft is held."""
    first = Rotation.from_rotvec(p.rng.uniform(0.2, 0.7) * np.array([0, 1, 0])).apply(Z)
    around = p.rng.uniform(0, 2 * np.pi)
    last = Rotation.from_rotvec(p.rng.uniform(0.2, 0.7) * np.array([np.cos(around), np.sin(around), 0])).apply(first)
    points = np.cumsum([np.zeros(3), Z, first, last], axis=0)
    a, b, c = (p.body(name, *points[i : i + 2]) for i, name in enumerate(("input", "middle", "output")))
    p.hinge("in", p.ground, a, points[0])
    p.add(Universal, "first cross", a, b, points[1], Z if p.rng.random() < 0.5 else first)
    p.add(Universal, "second cross", b, c, points[2], last if p.rng.random() < 0.5 else first)
    if output == "held":
        p.hinge("out", p.ground, c, points[3], last)
    elif output == "slides":
        p.add(Cylindrical, "out", p.ground, c, points[3], last)


def ball_ended(p: Pose) -> None:
    """A rod with balls at both ends, on the axes of two shafts."""
    axis = Rotation.from_rotvec([p.rng.uniform(0.2, 0.8), 0, 0]).apply(Z)
    points = np.array([np.zeros(3), Z, [0.5, p.rng.uniform(0, 0.3), 1.8]])
    end = points[2] + axis
    a, b, c = p.body("a", *points[:2]), p.body("rod", *points[1:]), p.body("b", points[2], end)
    p.hinge("in", p.ground, a, points[0])
    p.ball("first ball", a, b, points[1])
    p.ball("second ball", b, c, points[2])
    p.hinge("out", p.ground, c, end, axis)


def sarrus(p: Pose) -> None:
    """A plate lifted straight by two pairs of hinged plates in planes that are not parallel."""
    height = p.rng.uniform(0.8, 1.2)
    reach, top = np.sqrt(1 - (height / 2) ** 2), p.body("plate", [0, 0, height])
    for n, turn in enumerate((0.0, p.rng.uniform(0.8, 2.2))):
        M = Rotation.from_rotvec(turn * Z)
        foot, knee, head = M.apply([[0.5, 0, 0], [0.5 + reach, 0, height / 2], [0.5, 0, height]])
        lower, upper, axis = p.body(f"lower {n}", foot, knee), p.body(f"upper {n}", knee, head), M.apply([0, 1.0, 0])
        p.hinge(f"foot {n}", p.ground, lower, foot, axis)
        p.hinge(f"knee {n}", lower, upper, knee, axis)
        p.hinge(f"head {n}", upper, top, head, axis)


def bennett(p: Pose) -> None:
    """Four hinges in space with sin(alpha) / a = sin(beta) / b, the only movable loop of four skew hinges."""
    alpha, beta, theta = p.rng.uniform(0.4, 1.0), p.rng.uniform(1.1, 1.5), p.rng.uniform(-np.pi, np.pi)
    lengths = 1.0, np.sin(beta) / np.sin(alpha)
    across = np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2)
    phi = 2 * np.arctan2(across * np.cos(theta / 2), np.sin(theta / 2))
    ways = [_around((theta, s * phi, -theta, -s * phi), 2 * lengths, (alpha, beta) * 2) for s in (1, -1)]
    frames = min(ways, key=lambda f: np.abs(f[4] - np.eye(4)).max())
    points, axes = [f[:3, 3] for f in frames[:4]], [f[:3, 2] for f in frames[:4]]
    links = [p.ground, *(p.body(f"link {i}", points[i], points[i + 1]) for i in range(3)), p.ground]
    for i in range(4):
        k, l = (links[i], links[i + 1]) if i < 3 else (links[3], p.ground)
        p.hinge(f"hinge {i}", k, l, points[i], axes[i])


def _around(turns: Any, lengths: Any, twists: Any) -> list[Any]:
    """Frames of Denavit and Hartenberg along a chain, as matrices (4, 4)."""
    frames = [np.eye(4)]
    for turn, length, twist in zip(turns, lengths, twists, strict=True):
        step, about = np.eye(4), Rotation.from_rotvec(turn * Z)
        step[:3, :3], step[:3, 3] = (about * Rotation.from_rotvec([twist, 0, 0])).as_matrix(), about.apply([length, 0, 0])
        frames.append(frames[-1] @ step)
    return frames


def platform(p: Pose, cranks: int) -> None:
    """A platform on equal parallel cranks whose feet are not in line: it circles without turning."""
    feet = np.array([[0, 0, 0], [1, 0.2, 0], [0.4, 1.1, p.rng.uniform(-0.3, 0.3)], [1.3, 1.2, 0.1]])[:cranks]
    at = p.rng.uniform(0, 2 * np.pi)
    arm = 0.3 * np.array([np.cos(at), np.sin(at), 0])
    top = p.body("platform", *(feet + arm))
    for i, foot in enumerate(feet):
        crank = p.body(f"crank {i}", foot, foot + arm)
        p.hinge(f"foot {i}", p.ground, crank, foot)
        p.hinge(f"pin {i}", crank, top, foot + arm)


def door(p: Pose) -> None:
    """A door on three hinges."""
    leaf = p.body("leaf", [0.4, 0, 1])
    for i, height in enumerate((0.2, 1.0, 1.8)):
        p.hinge(f"hinge {i}", p.ground, leaf, [0, 0, height])


def parallelogram(p: Pose) -> None:
    """Two equal cranks and a coupler as long as their distance, hinged in space."""
    at = p.rng.uniform(0.9, 1.6)
    arm, across = 0.5 * np.array([np.cos(at), np.sin(at), 0]), np.array([1.0, 0, 0])
    left, right = p.body("left", 0 * arm, arm), p.body("right", across, across + arm)
    coupler = p.body("coupler", arm, across + arm)
    p.hinge("A", p.ground, left, 0 * arm)
    p.hinge("B", left, coupler, arm)
    p.hinge("C", coupler, right, across + arm)
    p.hinge("D", p.ground, right, across)


@dataclass(frozen=True)
class Mechanism:
    """How it is built, its freedoms and redundant rows, and the angle (rad) it turns by without a singular position."""

    build: Callable[[Pose], None]
    freedoms: int
    redundant: int
    turn: float = 2 * np.pi

    def scene(self, seed: int, **start: Any) -> Any:
        """The mechanism in a random pose; start: of its first hinge."""
        pose = Pose(self.build.__name__, np.random.default_rng(seed), start or {"rate0": SPEED})
        self.build(pose)
        return pose.scene


MECHANISMS = {
    "shaft with two universal joints, held": Mechanism(lambda p: cardan(p, "held"), 1, 1),
    "shaft with two universal joints, output slides": Mechanism(lambda p: cardan(p, "slides"), 1, 0),
    "shaft with two universal joints, output free": Mechanism(lambda p: cardan(p, "free"), 5, 0),
    "ball-ended shaft": Mechanism(ball_ended, 3, 1),
    "Sarrus": Mechanism(sarrus, 1, 1, turn=0.25),
    "Bennett": Mechanism(bennett, 1, 3),
    "platform on three cranks": Mechanism(lambda p: platform(p, 3), 1, 7),
    "platform on four cranks": Mechanism(lambda p: platform(p, 4), 1, 11),
    "door on three hinges": Mechanism(door, 1, 10),
    "parallelogram": Mechanism(parallelogram, 1, 3, turn=0.6),
}
