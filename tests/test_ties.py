"""What is equal but for rounding is one: the first by statement is named, whatever the last digits are."""

from __future__ import annotations

import numpy as np
import pytest

import mbdae as mb
from mbdae.analysis.shapes import scaled
from mbdae.laws.line_mesh import polyline
from mbdae.scene.beams import nearest_place
from mbdae.values import largest, nearest

UP, DOWN = 1 + 1e-12, 1 - 1e-12


@pytest.mark.parametrize("digits", [(UP, 1, DOWN), (DOWN, 1, UP), (1, UP, DOWN), (1, 1, 1)])
def test_the_first_of_the_largest(digits):
    assert largest(np.array([0.5, *digits, 0.1])) == 1
    assert largest(3e-300 * np.array([0.5, *digits, 0.1])) == 1
    assert nearest(np.array([0.5, *(1e-3 * np.array(digits)), 0.1]), 1.0) == 1


def test_what_differs_by_more_is_not_equal():
    assert largest([1.0, 1.00001]) == 1
    assert nearest([1e-5, 0.0], 1.0) == 1
    assert nearest([1e-12, 0.0], 1.0) == 0


def test_what_is_not_finite_is_the_largest():
    assert largest([1.0, np.nan, 2.0, np.inf]) == 1
    assert largest([1.0, np.inf, np.nan]) == 1
    assert largest([0.0, 0.0]) == 0


@pytest.mark.parametrize("change", [UP, DOWN])
def test_modes_meshes_and_messages_do_not_hang_on_the_last_digit(change):
    np.testing.assert_allclose(scaled(np.array([1.0, -change])), [1.0, -1.0])  # not [-1, 1]
    stations = polyline([(0, 0, 0), (1, 0, 0), (1, change, 0), (0, change, 0)], 7, order=1).stations
    assert np.sum(stations < 1 - 1e-9) == 3  # three equal segments share seven elements: the first has three of them
    with pytest.raises(mb.OptionError, match=r"F\[0\]"):
        mb.DAE(lambda t, y, yp, out: np.subtract(yp, [1.0, change], out=out), [0.0, 0.0], [0.0, 0.0])


@pytest.mark.parametrize("change", [UP, DOWN])
def test_a_closed_beam_is_held_where_it_begins(change):
    s = mb.Scene("triangle")
    ring = s.beam("ring", (0, 0), (1, 0), (1, 1), (0, 0), section=mb.Section.circular(0.01, 2e11, 0.3, 7800.0))
    assert not s.problems
    assert nearest_place(ring, np.array([1e-13 * (1 - change) / abs(1 - change), 1e-13, 0])) == pytest.approx(0, abs=1e-12)
