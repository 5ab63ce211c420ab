"""A cantilever rolled up by a moment on its tip: half a circle, one, two; slenderness 10, 100, 10 000."""

from __future__ import annotations

import numpy as np
from beam_scenes import cantilever, slender
from runner import Case, Claim, Found
from scenes import data

claim = Claim("rollup", "a cantilever under the moment 2 pi n EI / L rolls up into n circles, whatever its slenderness", 2e-5,
              "of its length", "closed form: x = sin(k s) / k, y = (1 - cos(k s)) / k, k = M / EI")
MESHES = {"quadratic": (2, 2e-5), "cubic": (3, 1e-8)}


def rolled(turns: float, ratio: float, order: int, tolerance: float, space: str) -> Found:
    """Distance of the tip from its place on the circle."""
    scene = cantilever(slender(ratio), 16, order, moment=(0, 0, 2 * np.pi * turns), space=space)
    e = scene.equilibrium()
    (exact,) = (case["tip"] for case in data("rollup")["cases"] if case["n"] == turns)
    error = float(np.linalg.norm(e["beam"].at(1.0).position[0, :2] - exact))
    return Found(error, tolerance, note=f"{e.iterations} Newton corrections")


def cases() -> list[Case]:
    found = [Case(f"one circle, slenderness {ratio:g}, 16 {name} elements", space,
                  lambda ratio=ratio, mesh=mesh, space=space: rolled(1, ratio, *mesh, space),
                  slow=space == "spatial" and (ratio != 10 or mesh != MESHES["cubic"]))
             for name, mesh in MESHES.items() for space in ("auto", "spatial") for ratio in (10, 100, 10000)]
    found.append(Case("half a circle, 16 cubic elements", "auto", lambda: rolled(0.5, 100, 3, 1e-8, "auto")))
    found.append(Case("two circles, 16 cubic elements", "spatial", lambda: rolled(2, 100, 3, 1e-6, "spatial"), slow=True))
    return found
