"""The elastica: an inextensible cantilever under a transverse dead load on its tip."""

from __future__ import annotations

import numpy as np
from beam_scenes import cantilever, thin
from runner import Case, Claim, Found
from scenes import data

claim = Claim("elastica_tip_load", "sag, shortening and tip angle of a cantilever under P L^2 / EI from 1 to 10", 1e-5,
              "of its length, rad", "closed form by elliptic integrals (problem of Mattiasson 1981)")


def bent(row: dict[str, float], elements: int, order: int, space: str) -> Found:
    e = cantilever(thin(), elements, order, force=(0, row["PL2_EI"], 0), space=space).equilibrium()
    tip = e["beam"].at(1.0)
    (x, y, _), R = tip.position[0], tip.rotation[0]
    errors = (y - row["w"], 1 - x - row["u"], np.arctan2(R[1, 0], R[0, 0]) - row["tip_angle"])
    return Found(float(np.max(np.abs(errors))), note=f"{e.iterations} Newton corrections")


def cases() -> list[Case]:
    return [Case(f"P L^2 / EI = {row['PL2_EI']:g}, {name} elements", space,
                 lambda row=row, mesh=mesh, space=space: bent(row, *mesh, space))
            for name, mesh, space in (("16 quadratic", (16, 2), "auto"), ("8 cubic", (8, 3), "spatial"))
            for row in data("elastica_tip_load")["rows"]]
