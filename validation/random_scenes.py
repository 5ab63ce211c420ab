"""Seeded random scenes: trees and single loops of 1 to 20 bodies with all joints and force elements, planar and spatial."""

from __future__ import annotations

import numpy as np

import mbdae as mb


def random_scene(seed: int) -> mb.Scene:
    """A scene every user could have drawn; small seeds give small scenes."""
    rng = np.random.default_rng(seed)
    planar = bool(rng.integers(2))
    gravity = np.array([0.0, -9.81, 0.0])
    s = mb.Scene(f"random {seed}", gravity=gravity)
    if rng.random() < 0.3:
        _loop(s, rng, planar)
    else:
        _tree(s, rng, planar, int(rng.integers(1, 21)))
    return s


def _direction(rng: np.random.Generator, planar: bool) -> np.ndarray:
    d = rng.normal(size=3)
    if planar:
        d[2] = 0
    return d / np.linalg.norm(d)


def _axis(rng: np.random.Generator, planar: bool) -> np.ndarray:
    return np.array([0.0, 0.0, 1.0 if rng.random() < 0.8 else -1.0]) if planar else _direction(rng, False)


def _body(s: mb.Scene, rng: np.random.Generator, name: str, a: np.ndarray, b: np.ndarray, planar: bool,
          free: bool = False) -> mb.scene.components.Body:  # type: ignore[name-defined]
    mass = float(10 ** rng.uniform(-0.7, 0.7))
    length2 = float(np.sum((b - a) ** 2))
    base = mass * length2 / 12
    inertia = base if planar else base * np.array([1.0, rng.uniform(0.6, 1.0), rng.uniform(0.6, 1.0)])
    at = a + rng.uniform(0.3, 0.7) * (b - a)
    spin = rng.normal(size=3) * (0.5 if free else 0.0)
    if planar:
        spin[:2] = 0
    return s.rigid_body(name, mass, inertia, at=at, angular_velocity=spin)


def _tree(s: mb.Scene, rng: np.random.Generator, planar: bool, n: int) -> None:
    ends: list[tuple[object, np.ndarray]] = [(s.ground, np.zeros(3))]
    for i in range(n):
        parent, a = ends[int(rng.integers(max(0, len(ends) - 3), len(ends)))]
        b = a + rng.uniform(0.3, 1.0) * _direction(rng, planar)
        name = f"b{i + 1}"
        if rng.random() < 0.12:
            body = s.point_mass(name, float(10 ** rng.uniform(-0.5, 0.5)), at=b)
            s.distance(f"J{i + 1}", parent, body, a, b)
            if not planar and rng.random() < 0.5:
                stiffness = float(10 ** rng.uniform(0, 2))
                s.spring(f"S{i + 1}", s.ground, body, b + np.array([0.0, 1.0, 0.3]), b, stiffness=stiffness, damping=0.1)
            ends.append((body, b))
            continue
        body = _body(s, rng, name, a, b, planar)
        _join(s, rng, f"J{i + 1}", parent, body, a, b, planar)
        if rng.random() < 0.2:
            anchor = b + 0.7 * _direction(rng, planar)
            stiffness, damping = float(10 ** rng.uniform(0, 2)), float(rng.uniform(0, 0.5))
            s.spring(f"S{i + 1}", s.ground, body, anchor, b, stiffness=stiffness, damping=damping)
        if rng.random() < 0.1:
            value = rng.normal(size=3)
            value[2] = 0 if planar else value[2]
            s.force(f"F{i + 1}", body, tuple(v * mb.t for v in value), at=b)
        ends.append((body, b))


def _join(s: mb.Scene, rng: np.random.Generator, name: str, k: object, l: object, a: np.ndarray, b: np.ndarray,
          planar: bool) -> None:
    kind = rng.choice(["revolute", "revolute", "revolute", "prismatic", "spherical", "weld", "bushing", "drive", "orientation"])
    if getattr(k, "is_point", False):
        kind = "spherical"  # a point mass has no axes a joint could use
    spring, damper = (float(10 ** rng.uniform(0, 1.5)), float(rng.uniform(0, 0.3))) if rng.random() < 0.4 else (None, None)
    if kind == "revolute":
        s.revolute(name, k, l, at=a, axis=_axis(rng, planar), angle0=float(rng.uniform(-1, 1)) if rng.random() < 0.3 else None,
                   rate0=float(rng.normal()) if rng.random() < 0.3 else None, spring=spring, damper=damper)
    elif kind == "drive":
        s.revolute(name, k, l, at=a, axis=_axis(rng, planar), angle=0.5 * mb.t + 0.3 * mb.t**2)
    elif kind == "prismatic":
        s.prismatic(name, k, l, at=a, axis=_direction(rng, planar), spring=float(10 ** rng.uniform(1, 2)), damper=0.2)
    elif kind == "spherical":
        s.spherical(name, k, l, at=a)
    elif kind == "weld":
        s.weld(name, k, l, at=a)
    elif kind == "orientation":
        s.fixed_orientation(name, k, l)
        s.spring(name + "s", k, l, a, b, stiffness=float(10 ** rng.uniform(1, 2)), damping=0.3)
    else:
        turn = (30.0, 30.0, 30.0)
        s.bushing(name, k, l, at=a, stiffness=(300.0, 300.0, 300.0, *turn), damping=(1.0, 1.0, 1.0, 0.1, 0.1, 0.1))


def _loop(s: mb.Scene, rng: np.random.Generator, planar: bool) -> None:
    """A four-bar: planar, or in space closed by ball joints (crank revolute, coupler on two spherical joints with inertia)."""
    A, D = np.zeros(3), np.array([1.0, 0.0, 0.0])
    B, C = np.array([0.0, rng.uniform(0.2, 0.4), 0.0]), np.array([rng.uniform(0.9, 1.3), rng.uniform(0.6, 0.9), 0.0])
    if not planar:
        C[2], D[2] = rng.uniform(0.1, 0.4), rng.uniform(0.1, 0.4)
    bodies = [_body(s, rng, n, a, b, planar) for n, a, b in (("crank", A, B), ("coupler", B, C), ("rocker", C, D))]
    drive = {"angle": 3.0 * mb.t} if rng.random() < 0.4 else {"rate0": float(rng.uniform(2, 5))}
    s.revolute("A", s.ground, bodies[0], at=A, **drive)
    if planar:
        s.revolute("B", bodies[0], bodies[1], at=B, damper=0.01)
        s.revolute("C", bodies[1], bodies[2], at=C, spring=2.0, damper=0.02)
    else:
        s.spherical("B", bodies[0], bodies[1], at=B)
        s.spherical("C", bodies[1], bodies[2], at=C)
    s.revolute("D", bodies[2], s.ground, at=D)
