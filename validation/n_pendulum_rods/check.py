"""Chains of 2 to 20 rods released horizontally, planar and spatial."""

from __future__ import annotations

from typing import Any

import numpy as np
from runner import Case, Claim, Found
from runs import largest, simulated, with_both
from scenes import data, n_rods

import mbdae as mb

claim = Claim("n_pendulum_rods", "chains of 2 to 20 rods are followed in the plane and in space", 1e-7, "rad",
              "computed independently of mbdae: equations in the N absolute angles, DOP853 at 3e-14, which differs by less "
              "than 1e-9 from a looser run at the times compared")
CHAINS = [(2, "planar"), (5, "planar"), (10, "planar"), (20, "planar"), (2, "spatial"), (5, "spatial"), (10, "spatial"),
          (20, "spatial")]
RECURSIVE = CHAINS[:-1]  #: 20 joints in space are too many for one program: they would stay kinematic


def angles(solver: Any, n: int, space: str, model: Any = None) -> Found:
    """Largest error of the absolute angles."""
    e = data("n_pendulum_rods")["results"][str(n)]
    r = simulated(n_rods(n, space, model), e["t"], claim.tolerance, solver)
    theta = np.cumsum([r[f"J{i + 1}"].angle for i in range(n)], axis=0).T + np.pi / 2
    return Found(largest(theta, e["theta"]))


def cases() -> list[Case]:
    recursive = [case for chain in RECURSIVE
                 for case in with_both(f"{chain[0]} rods, {chain[1]}, recursive joints",
                                       lambda solver, chain=chain: angles(solver, *chain, mb.Recursive()),
                                       chain[0] > 5, [mb.CVODE()])]
    return recursive + [case for chain in CHAINS
                        for case in with_both(f"{chain[0]} rods, {chain[1]}", lambda solver, chain=chain: angles(solver, *chain),
                                              slow=chain[0] > 5 and chain != (20, "planar"))]
