"""The N-four-bar of IFToMM A02 where a method stops; what is reached is measured in validation/iftomm_a02."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import n_four_bar

import mbdae as mb


def test_ida_stops_with_its_reason_and_the_run_so_far():
    with pytest.raises(mb.SolverError) as caught:
        n_four_bar(2).simulate(10.0, solver=mb.IDA())
    assert 0.70 < caught.value.time < 0.73  # the first flat position is at 0.71436 s
    assert len(caught.value.solution.t) > 1
    assert np.isfinite(caught.value.solution["A0"].angle).all()


