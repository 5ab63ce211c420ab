"""Tip of the 45 degree bend under three loads, and the order of the error in the mesh."""

from __future__ import annotations

import numpy as np
from beam_scenes import bend45
from runner import Case, Claim, Found
from scenes import data

claim = Claim("bend45", "the 45 degree bend of Bathe and Bolourchi with 8 quadratic elements; errors of order 2p", 5e-5,
              "of the tip's distance", "converged shooting of the rod equations, 1e-11, computed independently")
SECTION = "GJ=G*polar I (8.3333e5), shear 5/6"


def tip_error(load: float, elements: int, order: int) -> tuple[float, int]:
    """Error of the tip over its distance from the clamp, and Newton's corrections."""
    e = bend45(load, elements, order).equilibrium()
    tip = np.array(data("bend45")["results"][SECTION][f"{load:.1f}"]["tip_xyz"])
    return float(np.linalg.norm(e["bend"].at(1.0).position[0] - tip) / np.linalg.norm(tip)), e.iterations


def displaced(load: float, elements: int, order: int, tolerance: float) -> Found:
    error, iterations = tip_error(load, elements, order)
    return Found(error, tolerance, note=f"{iterations} Newton corrections")


def observed(order: int, elements: int) -> Found:
    """How far the order between two meshes is from 2p."""
    coarse, fine = (tip_error(600.0, n, order)[0] for n in (elements, 2 * elements))
    found = float(np.log2(coarse / fine))
    return Found(abs(found - 2 * order), 0.3, "1", note=f"order {found:.2f} between {elements} and {2 * elements} elements")


def cases() -> list[Case]:
    quadratic = [Case(f"P = {P:g}, 8 quadratic elements", "equilibrium", lambda P=P: displaced(P, 8, 2, claim.tolerance))
                 for P in (300.0, 450.0, 600.0)]
    cubic = Case("P = 600, 16 cubic elements", "equilibrium", lambda: displaced(600.0, 16, 3, 2e-9))
    return [*quadratic, cubic, *(Case(f"order of the error, p = {p}", "equilibrium", lambda p=p, n=n: observed(p, n), slow=p < 3)
                                 for p, n in ((1, 8), (2, 8), (3, 8)))]
