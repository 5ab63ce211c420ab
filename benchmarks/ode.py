"""Error over rtol and cost of CVODE on scenes and textbook problems with a right-hand side; the tables of docs/accuracy.md.

    python benchmarks/ode.py [problem ...]
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.integrators.base import Asked, Solver
from mbdae.run.control import run_controlled
from mbdae.run.estimate import measure_of
from mbdae.system.base import System
from mbdae.system.prepare import Prepared, prepare

RTOLS = (1e-4, 1e-6, 1e-8, 1e-10)
ACCURACIES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
LEVEL = 1e-6  #: error at which evaluations are compared
SOLVERS = (mb.CVODE(), mb.CVODE(method="BDF"), mb.DOP853(), mb.IDA(), mb.RadauIIA(3))


@dataclass(frozen=True)
class Problem:
    """Equations with a right-hand side, the end of their run, and how far two trajectories are apart."""

    system: System
    t_end: float
    measure: Callable[[Any, Any, Any], Any]
    prepared: Prepared | None = None
    stiff: bool = False


# -- scenes


def flipping_body() -> mb.Scene:
    s = mb.Scene("flipping body")
    s.rigid_body("body", 1.0, (1.0, 2.0, 3.0), at=(0, 0, 0), angular_velocity=(1e-3, 2, 1e-3))
    return s


def elastic_pendulum() -> mb.Scene:
    s = mb.Scene("elastic pendulum", gravity=(0, -9.81, 0))
    bob = s.point_mass("bob", 1.0, at=(1, 0))
    s.spring("rod", s.ground, bob, (0, 0), (1, 0), stiffness=100.0)
    return s


def tethered_bodies() -> mb.Scene:
    s = mb.Scene("tethered bodies", gravity=(0, 0, -9.81))
    a = s.rigid_body("a", 2.0, (1.0, 2.0, 2.5), at=(0, 0, 0), angular_velocity=(0.3, 1.0, -0.2))
    b = s.point_mass("b", 0.5, at=(1, 0, 1), velocity=(0, 0.2, 0))
    s.spring("tether", a, b, (0.3, 0, 0), (1, 0, 1), stiffness=40.0, damping=0.5)
    s.bushing("mount", s.ground, a, (0, 0, 0), (100.0, 90.0, 80.0, 5.0, 6.0, 7.0), (1.0, 1.0, 1.0, 0.1, 0.1, 0.1))
    s.force("push", a, (mb.t, 0, 1.0), at=(0, 0.2, 0))
    return s


def shaken_block() -> mb.Scene:
    s = mb.Scene("shaken block")
    block = s.rigid_body("block", 5.0, 0.4, at=(0, 0))
    s.bushing("mount", s.ground, block, (0, 0), (2000.0, 3000.0, 40.0), (5.0, 5.0, 0.2))
    s.force("shaker", block, (100 * sp.sin(12 * mb.t), 0, 0), at=(0, 0.3))
    return s


def string_of_masses(n: int = 10) -> mb.Scene:
    s, before, where = mb.Scene("string of masses", gravity=(0, -9.81, 0)), None, (0.0, 0.0)
    for i in range(n):
        here = (0.1 * (i + 1), 0.0)
        mass = s.point_mass(f"m{i}", 0.1, at=here)
        s.spring(f"s{i}", before or s.ground, mass, where, here, stiffness=500.0, damping=0.1)
        before, where = mass, here
    return s


def stiff_mount() -> mb.Scene:
    s = mb.Scene("stiff mount", gravity=(0, -9.81, 0))
    carrier = s.rigid_body("carrier", 0.1, 1e-3, at=(0, 0))
    bob = s.point_mass("bob", 1.0, at=(1, 0))
    s.bushing("mount", s.ground, carrier, (0, 0), (1e5, 1e5, 1e3), (1e3, 1e3, 10.0))
    s.spring("rod", carrier, bob, (0, 0.1), (1, 0), stiffness=100.0)
    return s


# -- textbook problems


def explicit(f: Callable[[float, Any], list[Any]], df: Callable[[float, Any], Any], y0: list[float]) -> mb.DAE:
    """y' = f(t, y) with its Jacobian as a System."""

    def rhs(t: float, y: Any, out: Any) -> None:
        out[:] = f(t, y)

    return mb.DAE(lambda t, y, yp, out: yp - np.array(f(t, y)), y0, f(0.0, y0),
                    lambda t, y, yp, cj, out: cj * np.eye(len(y)) - np.array(df(t, y)), rhs=rhs)


def kepler(e: float = 0.5) -> mb.DAE:
    def slope(t: float, y: Any) -> Any:
        r2 = y[0] ** 2 + y[1] ** 2
        gravity = (3 * np.outer(y[:2], y[:2]) / r2 - np.eye(2)) / r2**1.5
        return np.block([[np.zeros((2, 2)), np.eye(2)], [gravity, np.zeros((2, 2))]])

    def rate(t: float, y: Any) -> list[Any]:
        r3 = (y[0] ** 2 + y[1] ** 2) ** 1.5
        return [y[2], y[3], -y[0] / r3, -y[1] / r3]

    return explicit(rate, slope, [1 - e, 0.0, 0.0, float(np.sqrt((1 + e) / (1 - e)))])


def van_der_pol(mu: float = 5.0) -> mb.DAE:
    return explicit(lambda t, y: [y[1], mu * (1 - y[0] ** 2) * y[1] - y[0]],
                    lambda t, y: [[0, 1], [-2 * mu * y[0] * y[1] - 1, mu * (1 - y[0] ** 2)]], [2.0, 0.0])


def of_equations(system: System, t_end: float) -> Problem:
    """Equations as a problem."""
    return Problem(system, t_end, measure_of(system, None))


def of_scene(scene: mb.Scene, t_end: float, stiff: bool = False) -> Problem:
    """A scene as a problem."""
    prepared = prepare(scene)
    system = system_for(prepared)
    return Problem(system, t_end, measure_of(system, prepared), prepared, stiff)


PROBLEMS: dict[str, Callable[[], Problem]] = {
    "flipping_body": lambda: of_scene(flipping_body(), 10.0),
    "elastic_pendulum": lambda: of_scene(elastic_pendulum(), 5.0),
    "tethered_bodies": lambda: of_scene(tethered_bodies(), 3.0),
    "shaken_block": lambda: of_scene(shaken_block(), 3.0),
    "string_of_masses": lambda: of_scene(string_of_masses(), 1.0),
    "stiff_mount": lambda: of_scene(stiff_mount(), 2.0, stiff=True),
    "kepler": lambda: of_equations(kepler(), 20.0),
    "van_der_pol": lambda: of_equations(van_der_pol(), 20.0),
}


def reference(p: Problem, times: np.ndarray) -> np.ndarray:
    """y (nt, n) by DOP853 at 3e-14; where that crawls, by Radau IIA at 1e-11."""
    if p.stiff:
        return np.asarray(mb.RadauIIA(3, rtol=1e-11).solve(p.system, p.t_end)(times))

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        out = np.empty(p.system.n)
        p.system.rhs(t, y, out)
        return out

    atol = 1e-14 * p.system.scale
    return np.asarray(solve_ivp(rate, [0, p.t_end], p.system.y0, "DOP853", times, rtol=3e-14, atol=atol).y.T)


def runs(p: Problem, solver: Solver, times: np.ndarray, exact: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Error at `times`, most of them between steps, and evaluations of the equations, each (4,) for RTOLS."""
    errors, work = [], []
    for rtol in RTOLS:
        solution = replace(solver, rtol=rtol).solve(p.system, p.t_end)  # type: ignore[type-var]
        errors.append(float(np.max(p.measure(times, solution(times), exact))))
        work.append(solution.stats.residuals)
    return np.array(errors), np.array(work)


def at_error(error: float, errors: np.ndarray, work: np.ndarray) -> float:
    """Evaluations at an error, on the straight line through the runs in logarithmic axes."""
    return float(np.exp(np.polyval(np.polyfit(np.log(errors), np.log(work), 1), np.log(error))))


def controlled(p: Problem, solver: Solver, times: np.ndarray, exact: np.ndarray) -> list[tuple[float, float]]:
    """Error / asked and estimate / asked of runs to an accuracy."""
    found = []
    for accuracy in ACCURACIES:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mb.AccuracyWarning)
            c = run_controlled(p.system, p.prepared, solver, accuracy, Asked(p.t_end), times)
        found.append((float(np.max(p.measure(times, c.solution(times), exact))) / accuracy, c.estimate / accuracy))
    return found


def main() -> None:
    """Print error / rtol and evaluations of every problem, then a summary of controlled runs."""
    heads = [f"{rtol:.0e}" for rtol in RTOLS] + [f"evaluations at error {LEVEL:.0e}"]
    print(f"| problem | solver, error / rtol at: | {' | '.join(heads)} |\n|---|---|{'---|' * len(heads)}")
    asked: dict[str, list[tuple[float, float]]] = {}
    for name in sys.argv[1:] or PROBLEMS:
        p = PROBLEMS[name]()
        times = np.linspace(0.0, p.t_end, 2001)
        exact = reference(p, times)
        for solver in SOLVERS:
            errors, work = runs(p, solver, times, exact)
            ratios = " | ".join(f"{ratio:.3g}" for ratio in errors / RTOLS)
            print(f"| {name} | {solver.label} | {ratios} | {at_error(LEVEL, errors, work):.0f} |", flush=True)
            if isinstance(solver, mb.CVODE):
                asked.setdefault(solver.label, []).extend(controlled(p, solver, times, exact))
    print("\n| solver | runs | median of error / asked | largest | above asked | of these with a warning |")
    print("|---|---|---|---|---|---|")
    for label, found in asked.items():
        ratio, estimate = np.array(found).T
        above = ratio > 1
        print(f"| {label} | {len(found)} | {np.median(ratio):.2f} | {ratio.max():.2g} | {above.sum()} | "
              f"{(above & (estimate > 1)).sum()} |")


if __name__ == "__main__":
    main()
