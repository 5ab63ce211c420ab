"""Andrews' squeezing mechanism: seven bodies, three loops."""

from __future__ import annotations

from typing import Any

import numpy as np
from runner import Case, Claim, Found
from runs import largest, simulated, with_both
from scenes import andrews, data

claim = Claim("andrews_squeezer", "the angles of Andrews' squeezer at 0.03 s, and the forces closing its loops", 1e-8, "relative",
              "problem: IVP test set; values computed independently of mbdae in one coordinate; the published digits hold to "
              "about 1e-9")


def motion(solver: Any) -> list[Found]:
    """The seven absolute angles and the six multipliers."""
    d = data("andrews_squeezer")["own"]
    r = simulated(andrews(), [0.0, 0.03], claim.tolerance, solver)
    q = np.array(d["q"])
    absolute = np.array([q[0], q[0] + q[1], q[2], q[3] + q[4], q[4], q[5] + q[6], q[6]])
    closing = np.concatenate([r[name].force[-1, :2] for name in ("P3", "P4", "P6")])
    return [Found(largest(r.q[-1, 2::3] / absolute, 1.0), quantity="angles"),
            Found(largest(closing, d["lam"]) / largest(d["lam"]), 1e-5, quantity="closing forces")]


def cases() -> list[Case]:
    return with_both("0.03 s", motion)
