"""The heavy top of Bruls and Cardona, spinning at 150 rad/s."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from runner import Case, Claim, Found
from runs import largest, simulated, with_both
from scenes import data, heavy_top

claim = Claim("heavy_top", "a top spinning at 150 rad/s is followed over 2 s", 1e-6, "m",
              "problem: Bruls and Cardona 2010; values computed independently of mbdae: rotation matrix as nine unknowns, "
              "DOP853 at 3e-14")


def motion(solver: Any) -> list[Found]:
    """Centre of mass and rotation matrix."""
    d = data("heavy_top")["own"]
    r = simulated(heavy_top(), d["t"], claim.tolerance, solver)
    return [Found(largest(r["top"].position, d["x"]), quantity="position"),
            Found(largest(r["top"].rotation.reshape(-1, 9), d["R"]), 1e-5, "1", "rotation matrix")]


def cases() -> list[Case]:
    return [replace(case, slow=case.solver == "IDA") for case in with_both("to 2 s", motion)]
