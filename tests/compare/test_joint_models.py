"""The paper's first claim: classical and kinematic revolutes give the same motion; what the fewer constraints buy."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

import mbdae as mb

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def benchmark(name, monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    spec = importlib.util.spec_from_file_location(name, BENCHMARKS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("free", [False, True])
def test_classical_against_kinematic(free, monkeypatch):
    build = benchmark("accuracy", monkeypatch).example_module("ground_resonance").scene
    models = [(mb.Kinematic, 1.0, 0.0), (mb.Classical, 1.0, 0.0), (mb.Classical, 1e6, 1e6)]
    kinematic, classical, augmented = benchmark("joint_models", monkeypatch).rows(build, free, models)
    for other in (classical, augmented):
        assert other["fixed"] <= 1e-9  # equal steps, Radau IIA with 3 stages, index 3
        assert other["adaptive"] <= 1e-7
        assert other["multipliers"] == kinematic["multipliers"] + 5  # one row more for each of the five joints
        assert other["smallest"] <= 1e-9
    sys.modules.pop("accuracy", None)
