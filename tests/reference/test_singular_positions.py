"""Linkages at positions where constraints depend on each other; more is measured in validation/iftomm_a02 and extremes."""

from __future__ import annotations

import numpy as np
import pytest
from extremes.check import places
from scenes import n_four_bar

import mbdae as mb


def test_ida_stops_with_its_reason_and_the_run_so_far():
    with pytest.raises(mb.SolverError) as caught:
        n_four_bar(2).simulate(10.0, solver=mb.IDA())
    assert 0.70 < caught.value.time < 0.73  # the first flat position is at 0.71436 s
    assert len(caught.value.solution.t) > 1
    assert np.isfinite(caught.value.solution["A0"].angle).all()




def test_errors_of_bdf_that_scatter_are_not_taken_for_small_ones():
    """A linkage that nearly locks: two runs of IDA were off to one side by 4e-5, and differed by half of that."""
    assert places("near_singular", ["tilt = 1e-07"]).error == 0
