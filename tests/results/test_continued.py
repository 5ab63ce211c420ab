"""Runs that go on from others: angles keep their whole turns, in every joint model, after storing too."""

from __future__ import annotations

import numpy as np
import pytest

import mbdae as mb


@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical(), mb.Recursive()], ids=lambda m: type(m).__name__)
def test_whole_turns_go_on(model, tmp_path):
    s = mb.Scene("wheel", space="spatial")
    wheel = s.rigid_body("wheel", 1.0, (1, 1, 2))
    s.revolute("hub", s.ground, wheel, at=(0, 0, 0), axis=(0, 0, 1), rate0=8.0, model=model, spring=0.0)
    first = s.simulate(1.0)
    first.save(tmp_path / "first.npz")
    second = s.simulate(2.0, start=mb.load(tmp_path / "first.npz"))
    second.save(tmp_path / "second.npz")
    third = s.simulate(3.0, start=second)
    for r, begin, end in ((first, 0, 8), (second, 8, 16), (mb.load(tmp_path / "second.npz"), 8, 16), (third, 16, 24)):
        np.testing.assert_allclose(r["hub"].angle[[0, -1]], [begin, end], atol=1e-4)


def test_a_tolerance_of_ones_own_claims_no_accuracy():
    """Runs that are compared would share atol, so that their difference says nothing of it."""
    s = mb.Scene("oscillator")
    s.spring("k", s.ground, s.point_mass("m", 1.0, (0, 0), velocity=(1, 0)), (0, 1), (0, 0), 50.0, 2.0, 0.5)
    r = s.simulate(3.0, accuracy=1e-6, solver=mb.IDA(atol=1e-2))
    assert r.accuracy.met is None
    assert r.accuracy.covers == frozenset()


def test_a_row_that_is_not_kept_withdraws_the_accuracy():
    """Two drives of a parallelogram that agree until 15 s; the run says so, and what it is off by."""
    import sympy as sp

    s, arm = mb.Scene("cranks"), np.array([np.cos(1.0), np.sin(1.0)]) * 0.3
    across = arm + np.array([1.0, 0.0])
    left, right = s.link("left", (0, 0), arm, mass=0.5), s.link("right", (1, 0), across, mass=0.5)
    bar = s.link("bar", arm, across, mass=1.0)
    late = sp.Piecewise((0, mb.t < 15), (0.1 * (mb.t - 15) ** 2, True))
    s.revolute("A", s.ground, left, at=(0, 0), angle=5 * mb.t)
    s.revolute("D", s.ground, right, at=(1, 0), angle=5 * mb.t + late)
    s.revolute("B", left, bar, at=arm)
    s.revolute("C", right, bar, at=across)
    with pytest.warns(mb.AccuracyWarning, match="prescribed motions may contradict"):
        r = s.simulate(20.0, accuracy=1e-4)
    assert r.accuracy.met is False
    assert r.accuracy.covers == frozenset()
