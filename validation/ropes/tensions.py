"""Tensions as they are read: of masses that bounce on damped ropes, where they jump, and of cars on drums with large strains."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from runs import verdict_of
from scipy.integrate import solve_ivp

import mbdae as mb

G = 9.81
SOLVERS = (None, mb.RadauIIA(3), mb.RadauIIA(2), mb.IDA(), mb.DOP853(), mb.CVODE())
#: an instant at which the tension jumps is as accurate as the motion: so many accuracies (s) on either side do not count
BESIDE = 3.0


def followed(times: Any, y: Any, taut: Callable[[Any], Any], slack: Callable[[Any], Any], stretch: Callable[[Any], float],
             pull: Callable[[Any], float], tight: bool) -> tuple[Any, Any]:
    """Tensions (nt,) at the times by SciPy, and the instants at which the rope tightens or slackens. taut, slack: y' of a state
    in either case; stretch: by how much the path is longer than the rope; pull: tension of a taut rope."""
    begin, found, instants = 0.0, np.zeros(len(times)), []
    while begin < times[-1]:
        def event(t: float, y: Any, tight: bool = tight) -> float:
            return pull(y) if tight else min(pull(y), stretch(y))

        event.terminal, event.direction = True, -1 if tight else 1  # type: ignore[attr-defined]
        part = solve_ivp(lambda t, y, f=taut if tight else slack: f(y), (begin, times[-1]), y, "DOP853", dense_output=True,
                         events=event, rtol=1e-12, atol=1e-13, max_step=0.02)
        now = (times >= begin) & (times <= part.t[-1])
        if tight:
            found[now] = [pull(one) for one in part.sol(times[now]).T]
        begin, y, tight = part.t[-1], part.y[:, -1], not tight
        instants.append(begin)
    return found, np.array(instants[:-1])


def bouncing(rng: np.random.Generator) -> tuple[mb.Scene, float, Callable[[Any], tuple[Any, Any]]]:
    """A mass dropped on a damped rope: scene, end (s), and its tensions at times."""
    mass, length = rng.uniform(0.5, 20), rng.uniform(0.5, 3)
    EA, start = 10 ** rng.uniform(2.5, 5) * mass, length * rng.uniform(0.6, 0.95)
    D = 10 ** rng.uniform(-3, -0.6) * 2 * np.sqrt(EA * mass / length) * length
    s = mb.Scene("bouncing", gravity=(0, -G, 0))
    body = s.point_mass("body", mass, at=(0, -start))
    s.rope("rope", s.ground, body, at_k=(0, 0), at_l=(0, -start), stiffness=EA, damping=D, length=length)

    def pull(y: Any) -> float:
        return (EA * (y[0] - length) + D * y[1]) / length

    def stretch(y: Any) -> float:
        return float(EA * (y[0] - length))

    return s, rng.uniform(0.5, 2), lambda times: followed(
        times, [start, 0.0], lambda y: [y[1], G - pull(y) / mass], lambda y: [y[1], G], stretch, pull, False)


def lifted(rng: np.random.Generator) -> tuple[mb.Scene, float, Callable[[Any], tuple[Any, Any]]]:
    """A car on a drum that a motor turns, at strains up to a tenth: tension times radius on the drum, the rope ever shorter."""
    car, drum, inertia, length = rng.uniform(1, 5), rng.uniform(0.1, 0.3), rng.uniform(0.05, 0.5), rng.uniform(2, 5)
    EA, torque = car * G / rng.uniform(0.01, 0.1), car * G * drum * rng.uniform(0.9, 1.1)
    D, stretched = EA * rng.uniform(0.005, 0.03), 1.0 + 1e-3
    s = mb.Scene("lifted", gravity=(0, -G, 0))
    cabin, wheel = s.rigid_body("cabin", car, 1.0, at=(drum, -length)), s.rigid_body("drum", 1.0, inertia)
    s.revolute("axle", s.ground, wheel, at=(0, 0), torque=torque)
    s.prismatic("guide", s.ground, cabin, at=(drum, -length), axis=(0, 1, 0))
    s.rope("rope", wheel, cabin, at_k=(0, 0), at_l=(drum, -length), radius_k=-drum, stiffness=EA, damping=D,
           length=length / stretched)

    def over(y: Any) -> float:  # y: height and rate of the car, angle and rate of the drum
        return float(drum * y[2] - y[0] + length - length / stretched)

    def pull(y: Any) -> float:
        return (EA * over(y) + D * (drum * y[3] - y[1])) / (length / stretched - drum * y[2])

    def taut(y: Any) -> list[float]:
        return [y[1], pull(y) / car - G, y[3], (torque - drum * pull(y)) / inertia]

    return s, rng.uniform(0.3, 1.0), lambda times: followed(
        times, [0.0] * 4, taut, lambda y: [y[1], -G, y[3], torque / inertia], lambda y: EA * over(y), pull, True)


def verdict(seed: int) -> tuple[str, str]:
    """"right", "told", "silent" or "needless" for the tension of a seed over its run, with a remark."""
    rng = np.random.default_rng(seed)
    s, end, known = (bouncing, lifted)[seed % 3 == 2](rng)
    accuracy, solver = float(10.0 ** -rng.integers(2, 9)), SOLVERS[rng.integers(len(SOLVERS))]
    r = s.simulate(end, accuracy=accuracy, solver=solver)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        tension = r["rope"].tension
    right, instants = known(r.t)
    apart = np.min(np.abs(r.t[:, None] - instants), axis=1, initial=np.inf) > BESIDE * accuracy
    ratio = float(np.max(np.abs(tension - right)[apart], initial=0.0) / np.max(np.abs(right))) / accuracy
    return verdict_of(ratio, bool(told) or r.reliable is False), (
        f"seed {seed}: {s.name}, {solver}, {accuracy:.0e}: error {ratio:.2g} x asked{''.join(f'; {w.message}' for w in told)}")
