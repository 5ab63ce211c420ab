"""The car axis of the IVP test set as a raw mb.DAE."""

from __future__ import annotations

from dae_problems import car_axis
from runner import Case, Claim, Found
from runs import largest
from scenes import data

import mbdae as mb

claim = Claim("car_axis", "the car axis, given as equations, at t = 3 s", 1e-8, "m",
              "problem: IVP test set, whose published digits agree within 5e-12; values computed independently of mbdae in two "
              "coordinates, DOP853 at 3e-14")
RUNS = [("multipliers as derivatives", "ggl_rates", mb.IDA(1e-11)), ("index 3", "index3", mb.RadauIIA(3, rtol=1e-9)),
        ("stabilised", "ggl", mb.RadauIIA(3, rtol=1e-8)), ("stabilised", "ggl", mb.RadauIIA(3, rtol=1e-10))]


def position(solver: mb.Solver, form: str) -> Found:  # type: ignore[name-defined]
    """Largest error of the four coordinates."""
    found = solver.solve(car_axis(form), 3.0).y[-1, :4]
    return Found(largest(found, data("car_axis")["own"]["y"][:4]))


def cases() -> list[Case]:
    return [Case(f"{words}, rtol {solver.rtol:.0e}", solver.label, lambda solver=solver, form=form: position(solver, form))
            for words, form, solver in RUNS]
