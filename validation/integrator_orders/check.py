"""The orders of every method that takes constant steps, in every form it declares them for."""

from __future__ import annotations

from math import inf
from typing import Any

from dae_problems import circle, circle_exact, circle_ode, jay, jay_exact
from exported_solvers import ALL
from runner import Case, Claim, Found

import mbdae as mb
from mbdae.integrators.base import Solver

claim = Claim("integrator_orders", "every method has the orders it declares on index-3, stabilised and index-1 problems and on "
              "ordinary differential equations", 0.2, "order",
              "closed forms: a point driven on a circle (x = cos t^2, y = sin t^2) and Jay's index-2 problem (1993); "
              "orders: Hairer, Lubich, Roche 1989; Arnold, Bruels, Cardona 2015")
FORMS = {"Index3": "index3", "GGL": "ggl", "Index1": "index1"}
TITLES = {"Index3": "circle, index 3", "GGL": "circle, stabilised", "Index1": "circle, index 1", "ODE": "circle, no constraint",
          "jay": "Jay, index 2"}
PARTS = ("positions", "velocities", "multipliers")
STEPS = (2, 3, 4, 5, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)  #: the first ones for methods of high order
JAY = {"RadauIIA(2)": {"unknowns": 3, "multipliers": 2}, "RadauIIA(3)": {"unknowns": 5, "multipliers": 3}}


def deviations(solver: Solver, system: Any, exact: Any, orders: dict[str, int]) -> list[Found]:
    """Observed order minus the declared one of every part of the unknowns; 0.4 of it above order 5, where few runs have errors
    above round-off."""
    measured = mb.measure_order(solver, system, 1.0, exact=exact, steps=STEPS)
    found = []
    for part, order in orders.items():
        seen = measured.orders[part]
        off = inf if seen is None else abs(seen - order) * (1.0 if order <= 5 else 0.4)
        text = measured.why[part] if seen is None else f"observed {seen:.2f}"
        found.append(Found(off, quantity=f"{part}, order {order} ({text})"))
    return found


def on_circle(solver: Solver, form: str) -> list[Found]:
    orders = dict(zip(PARTS, solver.orders[solver.label][form], strict=True))
    return deviations(solver, circle(FORMS[form]), circle_exact, orders)


def cases() -> list[Case]:
    plain = [solver for solver in ALL if solver.by_steps and solver.highest_index == 0]
    found = [Case(TITLES[form], solver.label, lambda solver=solver, form=form: on_circle(solver, form))
             for solver in ALL for form in solver.orders.get(solver.label, ())]
    found += [Case(TITLES["ODE"], solver.label, lambda solver=solver: deviations(
        solver, circle_ode(), lambda t: circle_exact(t)[:, :2], {"unknowns": solver.order})) for solver in plain]
    return found + [Case(TITLES["jay"], solver.label, lambda solver=solver: deviations(
        solver, jay(), jay_exact, JAY[solver.label])) for solver in ALL if solver.label in JAY]
