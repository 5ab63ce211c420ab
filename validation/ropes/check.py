"""Ropes over fixed and moving pulleys, by chance: every motion equals SciPy's to the accuracy, or the run says that not."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from ropes import tensions
from runner import Case, Claim, Found
from runs import counted, few_and_all, verdict_of
from scipy.integrate import solve_ivp

import mbdae as mb

claim = Claim("ropes", "masses and hook blocks on ropes over up to two pulleys, in the plane and one turned in space, move as "
              "the tensions along the tangents say, within three times the accuracy asked, or the run says that not; so do "
              "tensions that are read of ropes that slacken, tighten and are wound on drums", 0.0, "runs",
              "tangents of circles by hand, forces along them without any derivative, DOP853 of SciPy at rtol 1e-11")
QUICK, WHOLE = range(4), range(60)
T_END = 0.6
G = np.array([0.0, -9.81])


def tangent(a: Any, ra: float, b: Any, rb: float) -> tuple[Any, float]:
    """Direction and length of the span between circles that the rope rounds counter-clockwise (r > 0) or clockwise."""
    d = b - a
    distance, angle = np.hypot(*d), np.arctan2(d[1], d[0])
    angle -= np.arcsin((rb - ra) / distance)
    return np.array([np.cos(angle), np.sin(angle)]), float(np.sqrt(distance**2 - (rb - ra) ** 2))


class Rope:
    """A rope by its circles; the circle `moving` is about the mass, of which position and velocity are given."""

    def __init__(self, centres: list[Any], radii: list[float], moving: int, EA: float, D: float) -> None:
        self.centres, self.radii, self.moving, self.EA, self.D = centres, radii, moving, EA, D
        self.length = self.path(np.asarray(centres[moving]))[0]

    def path(self, x: Any) -> tuple[float, Any]:
        """Length of the path, and its gradient by x: the sum of the directions in which the rope pulls, against them."""
        centres = list(self.centres)
        centres[self.moving] = x
        spans = [tangent(centres[i], self.radii[i], centres[i + 1], self.radii[i + 1]) for i in range(len(centres) - 1)]
        total = sum(length for _, length in spans)
        for i in range(1, len(centres) - 1):
            (a, _), (b, _), sense = spans[i - 1], spans[i], np.sign(self.radii[i])
            turn = np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)
            total += abs(self.radii[i]) * np.mod(sense * turn, 2 * np.pi)
        gradient = np.zeros(2)
        if self.moving > 0:
            gradient += spans[self.moving - 1][0]
        if self.moving < len(spans):
            gradient -= spans[self.moving][0]
        return float(total), gradient

    def force(self, x: Any, v: Any) -> Any:
        """The force on the mass."""
        length, gradient = self.path(x)
        over = length - self.length
        tension = max(0.0, self.EA * over + self.D * float(gradient @ v)) / self.length if over > 0 else 0.0
        return -tension * gradient


def drawn(seed: int) -> tuple[mb.Scene, Rope, Any, Any, float, Any]:
    """Scene, rope, start position and velocity, mass, and the rotation of the plane (3, 3)."""
    rng = np.random.default_rng(seed)
    hook = bool(seed % 2)
    r = rng.uniform(0.1, 0.3, 3)
    if hook:  # ground, hook block, maybe a pulley, ground
        centres = [np.array([-1.0, 0.0]), np.array([rng.uniform(-0.3, 0.3), -2.0])]
        radii = [0.0, r[0]]
        if seed % 4 == 3:
            centres, radii = [*centres, np.array([1.0, 0.3])], [*radii, -r[1]]
        centres, radii, moving = [*centres, np.array([2.0, -1.0 if seed % 4 == 3 else 0.2])], [*radii, 0.0], 1
    else:  # ground, pulleys, mass
        centres, radii = [np.array([-1.5, -1.0]), np.array([-0.8, 0.2])], [0.0, -r[0]]
        if seed % 4 == 2:
            centres, radii = [*centres, np.array([0.6, 0.4])], [*radii, -r[1]]
        centres, radii, moving = [*centres, np.array([1.2, -1.2])], [*radii, 0.0], len(centres)
    mass, EA = rng.uniform(0.5, 3.0), 10 ** rng.uniform(3, 4.5)
    D = float(rng.choice([0.0, 0.02])) * EA
    rope, x, v = Rope(centres, radii, moving, EA, D), centres[moving], rng.normal(size=2)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] if seed % 3 == 2 else np.eye(3)
    turn = turn * np.sign(np.linalg.det(turn))

    def at(p: Any) -> Any:
        return turn @ np.array([*p, 0.0])

    s = mb.Scene("rope", gravity=at(G))
    body = s.point_mass("body", mass, at=at(x), velocity=at(v))
    over = [((body if i == moving else s.ground), float(radii[i]), at(centres[i])) for i in range(1, len(centres) - 1)]
    last = body if moving == len(centres) - 1 else s.ground
    s.rope("rope", s.ground, last, at_k=at(centres[0]), at_l=at(centres[-1]), stiffness=EA, damping=D, over=over,
           axis=turn @ np.array([0, 0, 1.0]))
    return s, rope, x, v, mass, turn


def verdict(seed: int) -> tuple[str, str]:
    """"right", "told", "silent" or "needless" for a seed, with a remark."""
    s, rope, x, v, mass, turn = drawn(seed)
    accuracy = float(10.0 ** np.random.default_rng(seed + 1000).uniform(-7, -4))
    solver = [None, mb.RadauIIA(3), mb.IDA()][seed % 5 % 3]
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        r = s.simulate(T_END, accuracy=accuracy, solver=solver)
    ends = solve_ivp(lambda t, y: [*y[2:], *(rope.force(y[:2], y[2:]) / mass + G)], (0, T_END), [*x, *v], "DOP853", r.t,
                     rtol=1e-11, atol=1e-12, max_step=2e-3)
    found = (r["body"].position @ turn)[:, :2]
    ratio = float(np.max(np.abs(found - ends.y[:2].T))) / accuracy
    said = bool(told) or r.reliable is False
    return verdict_of(ratio, said), (
        f"seed {seed}: {solver}, {accuracy:.1e}: error {ratio:.2g} x asked{''.join(f'; {w.message}' for w in told)}")


def judge(seeds: Sequence[int]) -> list[Found]:
    """Counts of verdicts, with what is wrong."""
    return counted([verdict(seed) for seed in seeds])


def judge_tensions(seeds: Sequence[int]) -> list[Found]:
    """The same for tensions that are read."""
    return counted([tensions.verdict(seed) for seed in seeds])


def cases() -> list[Case]:
    """A few seeds, and all."""
    return [*few_and_all(judge, QUICK, WHOLE), Case("tensions", "all", judge_tensions, slow=True, parts=range(120))]
