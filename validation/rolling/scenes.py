"""Scenes that roll or cut, each with its own equations beside it: (scene, function Result -> positions, the same by `own`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import sympy as sp
from rolling.own import TIME, Array, coordinates, disc, moved

import mbdae as mb

Problem = tuple[Any, Callable[[Any], Array], Array]
T_END = 2.0


def times() -> Array:
    """The times at which runs are compared, s."""
    return np.linspace(0, T_END, 41)


def bicycle(speed: float, lean_rate: float = 0.0, model: Any = None) -> Any:
    """The benchmark bicycle (z down) at a speed (m/s), begun with a lean rate (rad/s). Table 1 of the paper named in `own`."""
    s = mb.Scene("bicycle", gravity=(0, 0, 9.81))
    tilt, base, trail = np.pi / 10, 1.02, 0.08

    def body(name: str, mass: float, inertia: Any, at: tuple[float, float, float], radius: float | None = None) -> Any:
        return s.rigid_body(name, mass, inertia, at=at, velocity=(speed, -lean_rate * at[2], 0),
                            angular_velocity=(lean_rate, -speed / radius if radius else 0, 0))

    rear = body("rear wheel", 2, (0.0603, 0.12, 0.0603), (0, 0, -0.3), 0.3)
    front = body("front wheel", 3, (0.1405, 0.28, 0.1405), (base, 0, -0.35), 0.35)
    frame = body("frame", 85, [[9.2, 0, 2.4], [0, 11, 0], [2.4, 0, 2.8]], (0.3, 0, -0.9))
    fork = body("fork", 4, [[0.05892, 0, -0.00756], [0, 0.06, 0], [-0.00756, 0, 0.00708]], (0.9, 0, -0.7))
    s.revolute("rear hub", frame, rear, at=(0, 0, -0.3), axis=(0, 1, 0), model=model)
    s.revolute("front hub", fork, front, at=(base, 0, -0.35), axis=(0, 1, 0), model=model)
    s.revolute("steer", frame, fork, at=(base + trail, 0, 0), axis=(np.sin(tilt), 0, np.cos(tilt)), model=model)
    s.rolling("rear tyre", s.ground, rear, at=(0, 0, -0.3), axis=(0, 1, 0), radius=0.3, normal=(0, 0, -1))
    s.rolling("front tyre", s.ground, front, at=(base, 0, -0.35), axis=(0, 1, 0), radius=0.35, normal=(0, 0, -1))
    return s


def coin(model: Any = None) -> Problem:
    """A coin that wobbles on a table."""
    r, m, lean = 0.1, 0.3, 0.3
    J = 0.25 * m * r * r, 0.5 * m * r * r
    axle = np.array([np.cos(lean), 0, np.sin(lean)])
    center, spin = np.array([r * np.sin(-lean), 0, r * np.cos(lean)]), np.array([15.0, 1.0, 4.0])
    s = mb.Scene("coin", gravity=(0, 0, -9.81))
    R = np.column_stack([axle, [0, 1, 0], np.cross(axle, [0, 1, 0])])
    arm = -r * (np.array([0, 0, 1]) - axle[2] * axle) / np.cos(lean)
    b = s.rigid_body("coin", m, (J[1], J[0], J[0]), at=center, rotation=R, velocity=-np.cross(spin, arm), angular_velocity=spin)
    s.rolling("edge", s.ground, b, at=center, axis=axle, radius=r)
    return s, lambda x: x["coin"].position, disc(r, m, J, center, axle, spin, times())


def ball_on_turntable(model: Any = None) -> Problem:
    """The centre of a ball on a table that turns steadily moves in a circle, at 2/7 of the table's rate."""
    W, r, m = 2.0, 0.1, 1.0
    s = mb.Scene("turntable", gravity=(0, 0, -9.81))
    table = s.rigid_body("table", 5.0, (1, 1, 1.5), at=(0, 0, -0.05))
    s.revolute("shaft", s.ground, table, at=(0, 0, 0), axis=(0, 0, 1), angle=W * mb.t, model=model)
    J = 0.4 * m * r * r
    b = s.rigid_body("ball", m, (J, J, J), at=(0.5, 0, r), velocity=(0, 0.3, 0))
    s.rolling("roll", table, b, at=(0.5, 0, r), radius=r)
    w = 2 / 7 * W
    middle, turned = 0.5 - 0.3 / w, w * times()
    found = np.column_stack([middle + 0.3 / w * np.cos(turned), 0.3 / w * np.sin(turned), np.full_like(turned, r)])
    return s, lambda x: x["ball"].position, found


def sleigh(model: Any = None) -> Problem:
    """Chaplygin's sleigh: a blade behind the centre of mass."""
    m, J, a, v, w = 2.0, 0.5, 0.3, 1.0, 0.5
    s = mb.Scene("sleigh")
    b = s.rigid_body("sleigh", m, J, at=(a, 0), velocity=(v, a * w), angular_velocity=(0, 0, w))
    s.knife_edge("blade", s.ground, b, at=(0, 0), along=(1, 0))
    (_, _, h), (dx, dy, dh) = q, u = coordinates("x y h")
    T = m * (dx**2 + dy**2) / 2 + J * dh**2 / 2
    row = -sp.sin(h) * (dx + a * sp.sin(h) * dh) + sp.cos(h) * (dy - a * sp.cos(h) * dh)
    found = moved(T, q, u, [row], [a, 0, 0, v, a * w, w], times())
    return s, lambda r: r["sleigh"].position[:, :2], found[:2].T


def snakeboard(model: Any = None) -> Problem:
    """A board with a rotor and two trucks, all turned by drives, which propels itself from rest."""
    m, J, rotor, truck, half = 2.0, 0.1, 0.05, 0.002, 0.25
    steer, spin = 0.4 * sp.sin(3 * TIME), 0.8 * sp.sin(3 * TIME)
    s = mb.Scene("snakeboard")
    board = s.rigid_body("board", m, J, at=(0, 0))
    wheel = s.rigid_body("rotor", 0.5, rotor, at=(0, 0))
    s.revolute("hub", board, wheel, at=(0, 0), angle=0.8 * sp.sin(3 * mb.t), model=model)
    (_, _, h), (dx, dy, dh) = q, u = coordinates("x y h")
    T = (m + 0.5) * (dx**2 + dy**2) / 2 + J * dh**2 / 2 + rotor * (dh + spin.diff(TIME)) ** 2 / 2
    rows = []
    for name, side in (("front", 1), ("back", -1)):
        b = s.rigid_body(name, 0.1, truck, at=(side * half, 0))
        s.revolute(f"pin {name}", board, b, at=(side * half, 0), angle=side * 0.4 * sp.sin(3 * mb.t), model=model)
        s.knife_edge(f"wheels {name}", s.ground, b, at=(side * half, 0), along=(1, 0))
        vx, vy = dx - side * half * sp.sin(h) * dh, dy + side * half * sp.cos(h) * dh
        T += 0.1 * (vx**2 + vy**2) / 2 + truck * (dh + side * steer.diff(TIME)) ** 2 / 2
        rows.append(-sp.sin(h + side * steer) * vx + sp.cos(h + side * steer) * vy)
    return s, lambda r: r["board"].position[:, :2], moved(T, q, u, rows, start_of(T, u, rows), times())[:2].T


def start_of(T: Any, u: list[Any], rows: list[Any]) -> list[float]:
    """q = 0 and the velocities of least relative kinetic energy that a scene at rest starts with: here 0 is consistent."""
    at = {TIME: 0.0, **dict.fromkeys(u, 0.0), **{sp.Symbol(str(v).removesuffix("_rate")): 0.0 for v in u}}
    assert all(abs(float(row.subs(at))) < 1e-12 for row in rows)
    return [0.0] * 2 * len(u)


def steered_wheel(model: Any = None) -> Problem:
    """A cart on a blade with a wheel in a fork that is steered: the wheel rolls, so that its spin follows."""
    m, J, a, base, r = 5.0, 0.4, 0.3, 0.8, 0.2
    wheel, diameter, axial, speed = 1.0, 0.01, 0.02, 1.2
    angle = 0.5 * sp.sin(2 * TIME)
    s = mb.Scene("cart", gravity=(0, 0, -9.81))
    cart = s.rigid_body("cart", m, (J, J, J), at=(a, 0, r), velocity=(speed, 0, 0))
    fork = s.rigid_body("fork", 0.2, (0.001, 0.001, 0.001), at=(base, 0, r), velocity=(speed, 0, 0))
    disc_ = s.rigid_body("wheel", wheel, (diameter, axial, diameter), at=(base, 0, r), velocity=(speed, 0, 0),
                         angular_velocity=(0, speed / r, 0))
    s.planar("floor", s.ground, cart, at=(0, 0, r), axis=(0, 0, 1))
    s.revolute("steer", cart, fork, at=(base, 0, r), axis=(0, 0, 1), angle=0.5 * sp.sin(2 * mb.t), model=model)
    s.revolute("hub", fork, disc_, at=(base, 0, r), axis=(0, 1, 0), model=model)
    s.knife_edge("blade", s.ground, cart, at=(0, 0, r), along=(1, 0, 0))
    s.rolling("tyre", s.ground, disc_, at=(base, 0, r), axis=(0, 1, 0), radius=r)
    (_, _, h, _), (dx, dy, dh, dp) = q, u = coordinates("x y h p")
    vx, vy = dx - base * sp.sin(h) * dh, dy + base * sp.cos(h) * dh
    turn = dh + angle.diff(TIME)
    T = m * ((dx - a * sp.sin(h) * dh) ** 2 + (dy + a * sp.cos(h) * dh) ** 2) / 2 + J * dh**2 / 2
    T += (wheel + 0.2) * (vx**2 + vy**2) / 2 + (diameter + 0.001) * turn**2 / 2 + axial * dp**2 / 2
    way = sp.cos(h + angle), sp.sin(h + angle)
    rows = [-sp.sin(h) * dx + sp.cos(h) * dy, -way[1] * vx + way[0] * vy, way[0] * vx + way[1] * vy - r * dp]
    found = moved(T, q, u, rows, [0, 0, 0, 0, speed, 0, 0, speed / r], times())
    place = np.column_stack([found[0] + a * np.cos(found[2]), found[1] + a * np.sin(found[2])])
    return s, lambda r: r["cart"].position[:, :2], place


PROBLEMS = {f.__name__: f for f in (coin, ball_on_turntable, sleigh, snakeboard, steered_wheel)}
