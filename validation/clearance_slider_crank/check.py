"""Joints with clearance: a slider-crank that converges, its limit of ideal joints, two free bodies."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from clearance_scenes import free_pair, limit, momenta, slider_crank, turn
from runner import Case, Claim, Found
from runs import largest

import mbdae as mb

claim = Claim("clearance_slider_crank", "soft contact in joints with clearance converges over a turn; contact tends to the ideal "
              "joint; free bodies keep their momentum", 1e-8, "m", "the same scene by another method and at a tighter "
              "tolerance; the same scene with ideal joints; conservation laws")
PARTS = {"B": "crank pin", "C": "piston pin", "BC": "both pins"}
CELLS = [(1e-3, 1e6), (1e-4, 1e9), (1e-5, 1e9), (1e-6, 1e11), (1e-8, 1e9), (1e-8, 1e13), (0.0, 1e6), (0.0, 1e11), (0.0, 1e13)]
SLOW = 1e12  # N/m^1.5, cells that take longer
ENVELOPE = 3.0
INERTIA = {False: [4e-3] * 3, True: [2e-3, 3e-3, 4e-3]}  # kg m^2, of the free bodies
LONG = 5.0  # s, some 200 contacts


def convergence(play: str) -> list[Found]:
    """Positions of the slider over one turn against RadauIIA(3) at rtol 1e-11."""
    solvers = mb.RadauIIA(3, rtol=1e-11), mb.RadauIIA(3, rtol=1e-9), mb.IDA(rtol=1e-10)
    best, *others = (slider_crank(play).simulate(turn(), solver=solver) for solver in solvers)
    x = best["slider"].position
    return [Found(largest(r["slider"].position, x), quantity=f"{r.info.solver.label}, rtol {r.info.solver.rtol:.0e}",
                  note=f"{r.stats.steps} steps, {sum(len(r[j].contacts) for j in play)} contacts") for r in others]


def spaces() -> list[Found]:
    """The spatial model against the planar one over a quarter of a turn, after several impacts in both joints."""
    flat, spatial = (slider_crank("BC", space=space).simulate(turn() / 4, solver=mb.RadauIIA(3, rtol=1e-10))
                     for space in ("auto", "spatial"))
    forces = [r["B"].normal_force for r in (flat, spatial)]
    return [Found(largest(flat["slider"].position, spatial["slider"].position), quantity="slider"),
            Found(largest(flat["B"].orbit, spatial["B"].orbit), quantity="pin in its race"),
            Found(largest(*forces) / largest(forces[0]), 1e-4, "relative", "contact force")]


def envelope(clearance: float, stiffness: float) -> Found:
    """Largest deviation of the slider from ideal joints over clearance + static penetration."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)  # a penetration above the clearance is intended here
        found = limit(clearance, stiffness)
    note = f"a = {found.depth:.1e} m, {found.contacts} contacts, {found.result.stats.steps} steps"
    return Found(found.deviation, ENVELOPE, "c + a", note=note)


def conserved(spatial: bool, length: float | None) -> list[Found]:
    """Momenta and energy of two free bodies over a long run, at every step."""
    r = free_pair(spatial, length).simulate(LONG, solver=mb.RadauIIA(3, rtol=1e-9))
    at = r(r.solution.t)
    linear, angular = momenta(at, {"race": 1.0, "pin": 0.7}, INERTIA[spatial])
    energy = at.energy.total
    gained = np.max(energy - np.minimum.accumulate(energy)) / energy[0]
    note = f"{len(r['J'].contacts)} contacts, energy {energy[0]:.4f} to {energy[-1]:.4f} J"
    return [Found(largest(linear, linear[0]) / largest(linear[0]), 1e-10, "relative", "momentum"),
            Found(largest(angular, angular[0]) / largest(angular[0]), 1e-10, "relative", "moment of momentum"),
            Found(float(gained), 1e-9, "relative", "energy gained", note=note),
            Found(largest(r.energy.balance) / energy[0], 1e-7, "relative", "energy balance")]


def cases() -> list[Case]:
    both = "RadauIIA(3), IDA"
    found = [Case(f"soft contact, clearance at {name}", both, lambda play=play: convergence(play), True)
             for play, name in PARTS.items()]
    found.append(Case("space against plane", "RadauIIA(3)", spaces, slow=True))
    found += [Case(f"c = {c:g} m, k = {k:g} N/m^1.5", "RadauIIA(3)", lambda c=c, k=k: envelope(c, k), k > SLOW) for c, k in CELLS]
    pairs: dict[str, tuple[Any, ...]] = {"plane": (False, None), "space": (True, None), "space, tilting pin": (True, 0.05)}
    return found + [Case(f"two free bodies, {name}", "RadauIIA(3)", lambda how=how: conserved(*how), name != "plane")
                    for name, how in pairs.items()]
