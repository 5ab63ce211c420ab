"""The orders Radau IIA has at index 2 and 3."""

from __future__ import annotations

import numpy as np
from dae_problems import circle, circle_exact, jay, jay_exact

from mbdae.integrators.radau import RadauIIA
from mbdae.validation import Case, Claim, Found, Row, measure

claim = Claim("radau_orders", "Radau IIA has its theoretical orders on index-3, stabilised and index-2 problems", 0.2, "order",
              "closed forms: a point driven on a circle (x = cos t^2, y = sin t^2) and Jay's index-2 problem (1993); orders: "
              "Hairer, Lubich, Roche 1989")  # fmt: skip
ORDERS = [  # problem, stages, steps, {part of the unknowns: order}
    ("index3", 2, (64, 128), {(0, 2): 3, (2, 4): 2, (4, 5): 1}),
    ("index3", 3, (16, 32), {(0, 2): 5, (2, 4): 3, (4, 5): 2}),
    ("ggl", 2, (32, 64), {(0, 2): 3, (2, 4): 3, (4, 5): 2}),
    ("ggl", 3, (16, 32), {(0, 2): 5, (2, 4): 5, (4, 5): 3}),
    ("jay", 2, (64, 128), {(0, 2): 3, (2, 3): 2}),
    ("jay", 3, (32, 64), {(0, 2): 5, (2, 3): 3}),
]
PROBLEMS = {"index3": "circle, index 3", "ggl": "circle, stabilised", "jay": "Jay, index 2"}
PARTS = {(0, 2): "positions", (2, 4): "velocities", (4, 5): "multiplier", (2, 3): "z"}


def errors(problem: str, stages: int, steps: int) -> np.ndarray:
    """Largest error of each unknown over [1/4, 1] with constant steps."""
    system, exact = (jay(), jay_exact) if problem == "jay" else (circle(problem), circle_exact)
    solution = RadauIIA(stages, step=1 / steps).solve(system, 1.0)
    reference = exact(solution.t)
    difference = np.abs(solution.y[:, : reference.shape[1]] - reference)
    return difference[steps // 4 :].max(axis=0)


def slopes(problem: str, stages: int, steps: tuple[int, int], expected: dict[tuple[int, int], int]) -> list[Found]:
    """Observed order minus the theoretical one, for every part of the unknowns."""
    coarse, fine = (errors(problem, stages, n) for n in steps)
    found = []
    for part, order in expected.items():
        slope = float(np.log2(coarse[slice(*part)].max() / fine[slice(*part)].max()))
        name = "y" if problem == "jay" and part == (0, 2) else PARTS[part]
        found.append(Found(abs(slope - order), quantity=f"{name}, order {order} (observed {slope:.2f})"))
    return found


def cases() -> list[Case]:
    return [Case(PROBLEMS[row[0]], f"RadauIIA({row[1]})", lambda row=row: slopes(*row)) for row in ORDERS]


def run() -> list[Row]:
    return measure(claim, cases())
