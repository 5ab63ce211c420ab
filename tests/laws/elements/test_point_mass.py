"""A mass point: Newton's second law, in the plane and in space."""

from __future__ import annotations

import numpy as np
import pytest

import mbdae as mb


@pytest.mark.parametrize("force", [(3.0, -1.0), (3.0, -1.0, 2.0)])
def test_constant_force(force: tuple[float, ...]) -> None:
    """x = v t + F t^2 / (2 m)."""
    F, v = np.zeros(3), np.array([0.5, 0.2, 0])
    F[: len(force)] = force
    s = mb.Scene("pushed")
    s.force("F", s.point_mass("m", 4.0, at=(0, 0), velocity=v), force)
    r = s.simulate(2.0)
    assert r["m"].position == pytest.approx(np.outer(r.t, v) + np.outer(r.t**2, F) / 8, abs=1e-6)
