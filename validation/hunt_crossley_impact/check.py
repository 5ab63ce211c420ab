"""Exit speed, deepest penetration and sign of the force of single impacts, as a mass point in a joint with clearance."""

from __future__ import annotations

from typing import Any

from contact_scenes import ball
from runner import Case, Claim, Found
from scenes import data

import mbdae as mb

claim = Claim("hunt_crossley_impact", "impacts on Hertz contact with Hunt-Crossley damping end with the exact speed", 1e-6,
              "relative", "closed form: v/mu - ln(1 + mu v)/mu^2 is the same at entry and exit")


def impact(row: dict[str, float], options: dict[str, Any]) -> list[Found]:
    s = ball(row["v0"], mb.Hertz(1e9, row["mu"]))
    r = s.simulate(1e-3 / row["v0"] + 2e-3, **options)
    exit_speed = abs(r["m"].velocity[-1, 0] / row["v_exit"] - 1)
    deepest = abs(r["J"].contacts.deepest / row["a_max"] - 1)
    return [Found(exit_speed, quantity="exit speed"), Found(deepest, 1e-4, quantity="deepest penetration"),
            Found(max(0.0, -float(r["J"].normal_force.min())), 0.0, "N", "pull")]


def cases() -> list[Case]:
    ways = [("IDA", {"solver": mb.IDA(rtol=1e-9)}), ("default", {"accuracy": 1e-7})]
    return [Case(f"damping {row['mu']:g} s/m, {row['v0']:g} m/s", name, lambda row=row, options=options: impact(row, options))
            for row in data("hunt_crossley_impact")["rows"] for name, options in ways]
