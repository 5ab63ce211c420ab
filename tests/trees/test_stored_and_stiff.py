"""Trees that are evaluated joint by joint: stored runs, and implicit methods with full matrices of any size."""

from __future__ import annotations

import numpy as np
import pytest

import mbdae as mb


def chain(n: int, spatial: bool = False) -> mb.Scene:
    """A chain of n rods, whose hinges turn about changing axes where it is spatial."""
    s = mb.Scene("chain", gravity=(0, -9.81, 0))
    carrier = s.ground
    for i in range(n):
        rod = s.link(f"rod {i}", (i / n, 0), ((i + 1) / n, 0), mass=1 / n)
        s.revolute(f"J{i}", carrier, rod, at=(i / n, 0), axis=(0, i % 2, 1) if spatial else (0, 0, 1), damper=1e-3)
        carrier = rod
    return s.recursive()


@pytest.mark.parametrize("spatial", [False, True])
def test_a_stored_run_has_the_motion_of_all_bodies(spatial, tmp_path):
    r = chain(20, spatial).simulate(0.1, 1e-4, outputs=4)
    assert r.prepared.all_bodies.moved.ordered
    r.save(tmp_path / "run.npz")
    again = mb.load(tmp_path / "run.npz")
    for item in ("rod 19", "rod 3"):
        assert np.array_equal(again[item].position, r[item].position)
        assert np.array_equal(again[item].velocity, r[item].velocity)
    assert np.array_equal(again["J7"].force, r["J7"].force)
    assert np.array_equal(again.energy.kinetic, r.energy.kinetic)
    assert r.energy.kinetic[-1] > 0.01


def test_radau_factorises_full_matrices_of_any_size():
    s = chain(260)
    r = s.simulate(2e-3, solver=mb.RadauIIA(3, rtol=1e-6))
    other = s.simulate(2e-3, solver=mb.DOP853(rtol=1e-8))
    assert np.allclose(r["J200"].angle, other["J200"].angle, atol=1e-7)
