"""Errors in the rows of comparisons against equations by hand; decisions against many repeats."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from runner import Case, Claim, Found
from scipy.integrate import solve_ivp

import mbdae as mb

claim = Claim("compared", "errors of coordinate, joint force and rate in the rows of a comparison are those against equations by "
              "hand within a factor 2, and the method that it decides for costs at most 1.3 times the cheapest of 20 repeats",
              0.0, "rows", "equations of motion and joint forces by hand, DOP853 of SciPy at rtol 1e-12; the clock itself")
T_END, FACTOR, DEARER, REPEATS = 1.0, 2.0, 1.3, 20
G = 9.81


class Stated(NamedTuple):
    """A scene of one freedom with its equations: rate(t, q, v) -> acceleration; force(t, q, v, a) -> force of the joint (2,), N;
    energy(q, v), J; start (q, v); sensors of coordinate and force."""

    scene: Any
    rate: Callable[[Any, Any, Any], Any]
    force: Callable[[Any, Any, Any, Any], Any]
    energy: Callable[[Any, Any], Any]
    start: tuple[float, float]
    sensors: tuple[str, str]


def pendulum(length: float, damper: float, rate0: float, torque: float) -> Stated:
    """A rod that turns under gravity with a damper and a motor in its joint."""
    m, a, J = 1.0, length / 2, length**2 / 3
    s = mb.Scene(f"pendulum {length:g}", gravity=(0, -G, 0))
    load = torque * mb.t**2 if torque else None
    rod = s.link("rod", (0, 0), (length, 0), mass=m)
    s.revolute("A", s.ground, rod, at=(0, 0), damper=damper or None, rate0=rate0, torque=load)

    def rate(t: Any, q: Any, v: Any) -> Any:
        return (torque * t**2 - damper * v - m * G * a * np.cos(q)) / J

    def force(t: Any, q: Any, v: Any, acceleration: Any) -> Any:
        along, across = -m * a * v**2, m * a * acceleration
        return np.stack([along * np.cos(q) - across * np.sin(q), along * np.sin(q) + across * np.cos(q) + m * G], axis=-1)

    return Stated(s, rate, force, lambda q, v: J * v**2 / 2 + m * G * a * np.sin(q), (0.0, rate0), ("A.angle", "A.force"))


def slider(mass: float, slope: float, stiffness: float, push: float) -> Stated:
    """A mass on an inclined guide with a spring and a force in time; its guide carries the weight normal to it."""
    s = mb.Scene(f"slider {mass:g}", gravity=(0, -G, 0))
    axis = (np.cos(slope), np.sin(slope), 0.0)
    load = push * mb.t if push else None
    s.prismatic("P", s.ground, s.rigid_body("b", mass, (1, 1, 1), at=(0, 0, 0)), (0, 0, 0), axis, rate0=1.0, spring=stiffness,
                force=load)
    normal = mass * G * np.cos(slope)

    def rate(t: Any, q: Any, v: Any) -> Any:
        return (push * t - stiffness * q) / mass - G * np.sin(slope)

    def force(t: Any, q: Any, v: Any, acceleration: Any) -> Any:
        along = push * t - stiffness * q  # spring and load act in the joint
        return np.stack([along * np.cos(slope) - normal * np.sin(slope), along * np.sin(slope) + normal * np.cos(slope)], axis=-1)

    return Stated(s, rate, force, lambda q, v: mass * v**2 / 2 + mass * G * q * np.sin(slope) + stiffness * q**2 / 2, (0.0, 1.0),
                  ("P.displacement", "P.force"))


STATED: tuple[Callable[[], Stated], ...] = (
    lambda: pendulum(1.0, 0.0, 0.0, 0.0), lambda: pendulum(0.4, 0.05, 3.0, 0.0), lambda: pendulum(2.0, 0.5, -2.0, 4.0),
    lambda: pendulum(0.7, 0.0, 6.0, 1.0), lambda: pendulum(1.5, 0.2, 0.5, -3.0), lambda: slider(2.0, 0.3, 400.0, 0.0),
    lambda: slider(0.5, -0.6, 50.0, 5.0), lambda: slider(5.0, 0.1, 2000.0, 20.0), lambda: pendulum(0.25, 0.01, 8.0, 0.0),
    lambda: slider(1.0, 0.0, 100.0, -3.0))


def errors(number: int) -> list[Found]:
    """Of one scene the largest factor between the errors of rows and the true ones, by measure; errors that are round-off, or
    within what is known of the reference, are left out."""
    one = STATED[number]()
    w = mb.compare(one.scene, T_END, [mb.RadauIIA(3), mb.RadauIIA(2), mb.IDA()], [1e-3, 1e-5],
                   measure=[*one.sensors, f"{one.sensors[0].split('.')[0]}.rate"])
    t = np.linspace(0, T_END, 1001)
    q, v = solve_ivp(lambda t, y: [y[1], one.rate(t, *y)], (0, T_END), one.start, "DOP853", t, rtol=1e-12, atol=1e-13).y
    exact = {w.measure: q, one.sensors[1]: one.force(t, q, v, one.rate(t, q, v)), list(w.units)[2]: v}
    worst = dict.fromkeys(exact, 1.0)
    for row in w.runs:
        made = next(s for s in (mb.RadauIIA(3), mb.RadauIIA(2), mb.IDA()) if s.label == row.solver)
        solver = made.at_accuracy(row.accuracy, row.form)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            r = one.scene.simulate(T_END, solver=solver, outputs=t)
            for name, true in exact.items():
                found = np.asarray(r.read(name))
                off = float(np.max(np.abs((found[:, :2] if found.ndim > 1 else found) - true)))
                if off > 10 * max(w.reference.differences[name], 1e-13 * float(np.max(np.abs(true)))):
                    worst[name] = max(worst[name], off / row.errors[name], row.errors[name] / off)
    return [Found(factor, FACTOR, "factor", name) for name, factor in worst.items()]


def decided(number: int) -> Found:
    """CPU time of the run for which a comparison decides, over that of the cheapest; both the least of REPEATS repeats."""
    one, asked = STATED[number % len(STATED)](), 1e-5
    solvers = [mb.RadauIIA(3), mb.RadauIIA(2), mb.IDA(), mb.RadauIIA(5)]
    w = mb.compare(one.scene, T_END, solvers, [asked])
    reached = [row for row in w.runs if row.error is not None and row.error <= asked]
    system = one.scene.system(mb.GGL())
    cost = {}
    for row in reached:
        solver = next(s for s in solvers if s.label == row.solver).at_accuracy(asked, row.form)
        seconds = []
        for _ in range(REPEATS):
            begin = time.process_time()
            solver.solve(system, T_END)
            seconds.append(time.process_time() - begin)
        cost[row.label] = float(np.median(seconds))
    best = w.cheapest(asked)
    return Found(cost[best.label] / min(cost.values()), DEARER, "factor", "cost of what is decided for", note=best.label)


def some(numbers: Sequence[int]) -> list[Found]:
    """How many of some decisions cost more than they may."""
    found = [decided(n) for n in numbers]
    wrong = [one for one in found if one.error > DEARER]
    return [Found(len(wrong), len(found) // 10, "decisions", "dearer than they may be", note=", ".join(
        f"{one.note} {one.error:.2f}" for one in wrong))]


def cases() -> list[Case]:
    """The errors of every scene, and decisions."""
    return [*(Case(f"errors, scene {n + 1}", "all", lambda n=n: errors(n), slow=n > 1) for n in range(len(STATED))),
            Case("decisions", "all", some, slow=True, parts=range(200))]
