"""Tip of the strip of the Princeton experiment under three weights, turned by seven angles."""

from __future__ import annotations

import numpy as np
from beam_scenes import princeton
from runner import Case, Claim, Found
from runs import largest
from scenes import data

claim = Claim("princeton_beam", "the strip of Dowell and Traybar, 21 cases of weight and angle", 1e-6, "of its length",
              "converged shooting of the rod equations, computed independently; section as in Bauchau et al. 2016")
MESHES = {"4 cubic": (4, 3), "16 quadratic": (16, 2)}


def displaced(load: float, elements: int, order: int, angles: tuple[int, ...] | None = None) -> Found:
    """Largest error of the tip's displacement over the angles."""
    d = data("princeton_beam")
    L, errors, iterations = d["parameters"]["L"], [0.0], 0
    for case in d["results"]:
        if case["P"] == load and (angles is None or case["theta_deg"] in angles):
            e = princeton(load, case["theta_deg"], elements, order).equilibrium()
            u = e["beam"].at(1.0).position[0] - np.array([L, 0, 0])
            errors.append(largest(u, [case["u1"], case["u2_soft"], case["u3_stiff"]]) / L)
            iterations += e.iterations
    return Found(max(errors), note=f"{len(errors) - 1} angles, {iterations} Newton corrections")


def cases() -> list[Case]:
    found = [Case(f"P = {P:g} N, {name} elements", "equilibrium", lambda P=P, mesh=mesh: displaced(P, *mesh), slow=True)
             for name, mesh in MESHES.items() for P in data("princeton_beam")["loads"]]
    return [Case("P = 13.345 N, 15 and 75 degrees, 4 cubic elements", "equilibrium",
                 lambda: displaced(13.345, 4, 3, (15, 75))), *found]
