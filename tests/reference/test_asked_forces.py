"""Some of the scenes of validation/asked: what was asked for is within the accuracy, or told."""

from __future__ import annotations

import pytest
from asked.judge import asked


@pytest.mark.parametrize("seed", [7, 16], ids=["engine on bushings", "rigid, with loads"])
def test_asked_forces_are_right_or_told(seed: int) -> None:
    found = asked(seed)
    assert len(found) == 2
    assert [one for one in found if one.silent or not one.near] == []
    assert all(one.error <= one.asked for one in found)
