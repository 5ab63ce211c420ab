"""Accelerations by sparse matrices in one pattern are those by full ones."""

from __future__ import annotations

import beam_scenes
import numpy as np
import pytest

import mbdae as mb
from mbdae.deferred import as_full


def hinged(twice: bool) -> mb.Scene:
    """A beam on a hub: with a second hinge that says nothing new, or with friction by the reaction of its only one."""
    s = mb.Scene("hinged", gravity=(0, 0, -9.81))
    hub = s.rigid_body("hub", 1.0, (0.1, 0.1, 0.1))
    arm = s.beam("arm", (0, 0, 0), (1, 0, 0), section=mb.Section.circular(0.02, 2e9, 0.3, 1000.0), elements=2)
    rubbing = {} if twice else {"friction": mb.Coulomb(0.2, 0.1), "radius": 0.01}
    s.revolute("lower", s.ground, hub, at=(0, 0, -0.2), axis=(0, 0, 1), rate0=1.0, **rubbing)
    if twice:
        s.revolute("upper", s.ground, hub, at=(0, 0, 0.2), axis=(0, 0, 1))
    s.weld("clamp", hub, arm, at=(0, 0, 0))
    return s


@pytest.mark.parametrize("make", [lambda: beam_scenes.slider_crank(2, 2), lambda: hinged(True), lambda: hinged(False)])
def test_sparse_accelerations_are_those_of_full_matrices(make, monkeypatch):
    r = make().simulate(0.005, 1e-3)
    t = np.linspace(0, 0.005, 7)
    q, u, s, *_ = r.prepared.states(t, r.solution(t))
    for mechanics in (r.prepared.mechanics, r.prepared.with_all_rows):
        sparse = mechanics.accelerations(t, q, u, s)
        mass, along = as_full(mechanics.mass), mechanics.mobility_with_joints(0.0, q[0], np.eye(mechanics.nu)[:3])
        for name, value in (("sparse", False), ("mass", mass)):
            monkeypatch.setitem(vars(mechanics), name, value)
        full = mechanics.accelerations(t, q, u, s)
        assert along == pytest.approx(mechanics.mobility_with_joints(0.0, q[0], np.eye(mechanics.nu)[:3]), rel=1e-6)
        monkeypatch.undo()
        for one, other in zip(sparse, full, strict=True):
            assert np.max(np.abs(one - other)) <= 1e-7 * np.max(np.abs(other))
