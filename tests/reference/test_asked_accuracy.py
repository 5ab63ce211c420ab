"""What is asked is delivered, at outputs between steps too: five scenes, from the accuracy alone.

Random scenes are measured in validation/asked_accuracy.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "accuracy.py"


def benchmark():
    spec = importlib.util.spec_from_file_location("accuracy", BENCHMARK)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["pendulum", "four_bar", "andrews_squeezer", "heavy_top",
                                  pytest.param("ground_resonance", marks=pytest.mark.slow)])
@pytest.mark.parametrize("accuracies", [(1e-3, 1e-6), pytest.param((1e-4, 1e-5, 1e-7, 1e-8), marks=pytest.mark.slow)])
def test_five_scenes(name, accuracies):
    for row in benchmark().ratios(name, accuracies):
        assert row["error"] <= 3, row
        assert not row["warned"] or row["error"] > 1, row
