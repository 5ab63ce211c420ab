"""The N-four-bar of IFToMM A02: in its flat positions the constraints lose rank, and any other branch is near."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scenes import data, n_four_bar

import mbdae as mb


def deviation(n: int, accuracy: float, solver: object = None) -> tuple[float, mb.Result]:  # type: ignore[name-defined]
    """Largest error of the first bar's tip over the reference times, and the run."""
    d = data("iftomm_a02")["results"][str(n)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        r = n_four_bar(n).simulate(10.0, accuracy, solver=solver, outputs=np.array([0.0, *d["t"]]))
    tip = r["bar0"].at((0, 1)).position[1:, :2]
    return float(np.abs(tip - np.c_[d["B0x"], d["B0y"]]).max()), r


@pytest.mark.parametrize("accuracy", [1e-3, 1e-4, 1e-5])
def test_no_success_flag_on_a_wrong_answer(accuracy):
    error, r = deviation(2, accuracy, mb.RadauIIA(3))
    assert error <= 10 * accuracy or r.warnings
    assert error <= 1e-2, "the mechanism left its branch"


def test_error_falls_with_accuracy():
    errors = [deviation(2, accuracy, mb.RadauIIA(3))[0] for accuracy in (1e-3, 1e-4, 1e-6)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] <= 1e-5


def test_ida_stops_with_its_reason_and_the_run_so_far():
    with pytest.raises(mb.SolverError) as caught:
        n_four_bar(2).simulate(10.0, solver=mb.IDA())
    assert 0.70 < caught.value.time < 0.73  # the first flat position is at 0.71436 s
    assert len(caught.value.solution.t) > 1
    assert np.isfinite(caught.value.solution["A0"].angle).all()


def test_the_default_falls_back_to_radau_and_says_so():
    _, r = deviation(2, 1e-3)
    assert "RadauIIA" in r.info.solver.label
    assert "IDA stopped" in r.info.choice


@pytest.mark.slow
@pytest.mark.parametrize("n", [10, 40])
def test_many_bars(n):
    error, r = deviation(n, 1e-4, mb.RadauIIA(3))
    assert error <= 1e-3 or r.warnings
