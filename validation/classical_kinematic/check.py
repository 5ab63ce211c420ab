"""Classical and kinematic revolutes give the same motion."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

from runner import Case, Claim, Found
from scenes import ground_resonance

import mbdae as mb

claim = Claim("classical_kinematic", "classical and kinematic revolutes give the same lag angles in ground resonance", 1e-9,
              "relative", "the kinematic model of the same scene with the same steps")
BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "joint_models.py"


def benchmark() -> Any:
    """The module that makes the whole table."""
    spec = importlib.util.spec_from_file_location("joint_models", BENCHMARK)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def difference(free: bool) -> list[Found]:
    """Relative difference of the lag angles, without and with the scaling and penalty of Eq. 2."""
    models = [(mb.Kinematic, 1.0, 0.0), (mb.Classical, 1.0, 0.0), (mb.Classical, 1e6, 1e6)]
    _, plain, augmented = benchmark().rows(ground_resonance, free, models)
    found = []
    for row, what in ((plain, ""), (augmented, ", k = p = 1e6")):
        found += [Found(row["fixed"], quantity=f"equal steps{what}"), Found(row["adaptive"], 1e-8, quantity=f"adaptive{what}")]
    return found


def cases() -> list[Case]:
    rotors = {"driven": False, "free": True}
    return [Case(f"{name} rotor", "RadauIIA(3)", lambda free=free: difference(free), slow=free) for name, free in rotors.items()]
