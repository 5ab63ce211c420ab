"""Nodes of beams that joints join share unknowns: the same motion as with constraints, without their multipliers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.system.model.shared_nodes import Sharing

SECTION = mb.Section(1e5, 4e4, 4e4, 1.0, 1.0, 1.0, 1.0, 1e-3)


def straight(space: str) -> mb.Scene:
    """A clamped beam, another welded to its end, and a link that hangs from that by a revolute joint."""
    s = mb.Scene("chain", space=space, gravity=(0, -9.81, 0))
    a = s.beam("a", (0, 0), (1, 0), section=SECTION, elements=2)
    b = s.beam("b", (1, 0), (1.5, 0), section=SECTION, elements=1)
    s.weld("clamp", s.ground, a.at(0.0))
    s.weld("weld", a.at(1.0), b.at((1, 0)))
    s.revolute("hinge", b, s.link("rod", (1.5, 0), (2, 0), mass=0.2), at=(1.5, 0))
    return s


def cornered(space: str) -> mb.Scene:
    """Beams welded at a right angle: the welded nodes are given the same axes, so they share their rotation too."""
    s = mb.Scene("corner", space=space, gravity=(0, -9.81, 0))
    a = s.beam("a", (0, 0), (1, 0), section=SECTION, elements=2)
    b = s.beam("b", (1, 0), (1, 0.5), section=SECTION, elements=1)
    s.weld("clamp", s.ground, a.at(0.0))
    s.weld("weld", b.at((1, 0)), a.at(1.0))
    return s


@pytest.mark.parametrize(("make", "space", "left"), [(straight, "auto", 2), (straight, "spatial", 5), (cornered, "auto", 0),
                                                     (cornered, "spatial", 0)])
def test_the_same_motion_with_fewer_unknowns(make: Any, space: str, left: int, monkeypatch: Any) -> None:
    s = make(space)
    shared = s.system(mb.GGL())
    assert shared.kinds.count("lambda") == left
    solver = mb.RadauIIA(3, rtol=1e-8)
    r = s.simulate(0.1, solver=solver, outputs=[0, 0.05, 0.1])
    monkeypatch.setattr("mbdae.system.model.moved_bodies.shared_displacements", lambda *args: Sharing())
    full = make(space).simulate(0.1, solver=solver, outputs=[0, 0.05, 0.1])
    size = 3 if space == "auto" else 6
    assert make(space).system(mb.GGL()).n >= shared.n + 2 * size
    for place in (s["b"].at(1.0), s["a"].at(1.0)):
        ends = [result[place.body.name].at(place.point) for result in (r, full)]
        assert ends[0].position == pytest.approx(ends[1].position, abs=1e-6)
        assert ends[0].rotation == pytest.approx(ends[1].rotation, abs=1e-5)
    start = slice(0, 1)  # later the reactions ring with the beams
    for name in ("clamp", "weld"):
        assert r[name].force[start] == pytest.approx(full[name].force[start], abs=1e-6)
        assert r[name].torque[start] == pytest.approx(full[name].torque[start], abs=1e-6)
    assert np.max(r.drift.position) < 1e-8


@pytest.mark.parametrize("space", ["auto", "spatial"])
@pytest.mark.parametrize("form", [mb.GGL(), mb.Index3()])
def test_jacobian_is_that_of_the_residual(space: str, form: Any) -> None:
    system = straight(space).system(form)
    rng, n = np.random.default_rng(4), system.n
    y, yp = (a + 1e-2 * rng.normal(size=n) for a in (system.y0, system.yp0))
    J: Any = np.zeros((n, n) if system.sparsity is None else system.sparsity.nnz)
    system.jacobian(0.0, y, yp, 3.0, J)
    if system.sparsity is not None:
        pattern = system.sparsity
        J = type(pattern)((J, pattern.indices, pattern.indptr), shape=pattern.shape).toarray()
    d = rng.normal(size=n)
    values = []
    for e in (1e-6, -1e-6):
        out = np.empty(n)
        system.residual(0.0, y + e * d, yp + 3 * e * d, out)
        values.append(out)
    slope = (values[0] - values[1]) / 2e-6
    assert J @ d == pytest.approx(slope, abs=1e-5 * np.abs(slope).max())
