"""The orders of every method that takes constant steps, in every form it declares them for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from dae_problems import circle, circle_exact, jay, jay_exact
from exported_solvers import VARIANTS
from runner import Case, Claim, Found, Row, measure

from mbdae.integrators.base import Solver

claim = Claim("integrator_orders", "every method has the orders it declares on index-3, stabilised and index-1 problems", 0.2,
              "order", "closed forms: a point driven on a circle (x = cos t^2, y = sin t^2) and Jay's index-2 problem (1993); "
              "orders: Hairer, Lubich, Roche 1989; Arnold, Bruels, Cardona 2015")  # fmt: skip
FORMS = {"Index3": "index3", "GGL": "ggl", "Index1": "index1"}
TITLES = {"Index3": "circle, index 3", "GGL": "circle, stabilised", "Index1": "circle, index 1", "jay": "Jay, index 2"}
PARTS = {"positions": slice(0, 2), "velocities": slice(2, 4), "multiplier": slice(4, 5)}
JAY = {"RadauIIA(2)": {"y": 3, "z": 2}, "RadauIIA(3)": {"y": 5, "z": 3}}
JAY_PARTS = {"y": slice(0, 2), "z": slice(2, 3)}
STEPS = {2: (128, 256), 3: (64, 128), 5: (16, 32)}  #: coarse and fine, by the highest order


METHODS = [variant for variant in VARIANTS if variant.orders]


def slopes(solver: Solver, system: Any, exact: Any, steps: tuple[int, int], parts: dict[str, slice],
           orders: dict[str, int]) -> list[Found]:  # fmt: skip
    """Observed order minus the declared one of every part of the unknowns: of its largest error over t in [1/4, 1]."""
    errors = []
    for count in steps:
        solution = replace(solver, step=1 / count).solve(system, 1.0)  # type: ignore[type-var]
        reference = exact(solution.t)
        errors.append(np.abs(solution.y[:, : reference.shape[1]] - reference)[count // 4 :].max(axis=0))
    found = []
    for name, order in orders.items():
        slope = float(np.log2(errors[0][parts[name]].max() / errors[1][parts[name]].max()) / np.log2(steps[1] / steps[0]))
        found.append(Found(abs(slope - order), quantity=f"{name}, order {order} (observed {slope:.2f})"))
    return found


def on_circle(solver: Solver, form: str) -> list[Found]:
    orders = dict(zip(PARTS, solver.orders[solver.label][form], strict=True))
    return slopes(solver, circle(FORMS[form]), circle_exact, STEPS[max(orders.values())], PARTS, orders)


def on_jay(solver: Solver) -> list[Found]:
    orders = JAY[solver.label]
    steps = {3: (64, 128), 5: (32, 64)}[max(orders.values())]
    return slopes(solver, jay(), jay_exact, steps, JAY_PARTS, orders)


def cases() -> list[Case]:
    found = [Case(TITLES[form], solver.label, lambda solver=solver, form=form: on_circle(solver, form))
             for solver in METHODS for form in solver.orders[solver.label]]  # fmt: skip
    return found + [Case(TITLES["jay"], solver.label, lambda solver=solver: on_jay(solver))
                    for solver in METHODS if solver.label in JAY]  # fmt: skip


def run() -> list[Row]:
    return measure(claim, cases())
