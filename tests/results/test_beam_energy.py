"""Energy of beams: kinetic, elastic and potential energy, what damping takes, what loads give; nothing is lost."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sympy as sp

import mbdae as mb


def swinging(space: str, damping: float, load: Any, frame: str) -> mb.Scene:
    """A beam on a pin, in space with a corner out of the plane."""
    section = mb.Section.rectangular(0.02, 0.01, 1e8, 0.3, 1000, damping=damping)
    s = mb.Scene("swinging", gravity=(0, -9.81, 0), space=space)
    points = ((0, 0), (1, 0)) if space == "planar" else ((0, 0, 0), (1, 0, 0), (1, 0, 0.4))
    b = s.beam("b", *points, section=section)
    s.revolute("A", s.ground, b, at=(0, 0))
    if load is not None:
        b.load(load, frame=frame)
    return s


LOADS = {
    "none, undamped": (0.0, None, "inertial"),
    "none": (1e-2, None, "inertial"),
    "dead": (1e-2, (0.5, 3.0), "inertial"),
    "dead, timed": (1e-2, (0.5, 3 * sp.sin(20 * mb.t)), "inertial"),
    "following": (1e-2, (0.5, 3.0), "section"),
    "following, timed": (1e-2, (0.5, 3 * sp.sin(20 * mb.t)), "section"),
}


@pytest.mark.parametrize(("damping", "load", "frame"), LOADS.values(), ids=list(LOADS))
@pytest.mark.parametrize("space", ["planar", "spatial"])
def test_balance(space: str, damping: float, load: Any, frame: str) -> None:
    e = swinging(space, damping, load, frame).simulate(0.3, solver=mb.RadauIIA(3, rtol=1e-6)).energy
    size = np.max(e.kinetic) + np.max(np.abs(e.potential))
    assert np.max(np.abs(e.balance)) < 5e-6 * size  # measured 5e-8 to 1.4e-6 at rtol 1e-6
    assert np.all(e.kinetic >= 0)
    if damping:
        assert e.dissipated[-1] > 1e-3 * size
        assert np.all(np.diff(e.dissipated) >= 0)
    else:
        assert not np.any(e.dissipated)
    timed = load is not None and hasattr(load[1], "free_symbols")
    assert np.any(np.abs(e.work) > 0.02 * size) == (frame == "section" or timed)  # constant dead loads have a potential


def test_elastic_energy_and_work_by_hand() -> None:
    """A slow end moment M bends a beam by M L / EI: elastic energy M^2 L / (2 EI), the same as the work of the moment."""
    section = mb.Section.rectangular(0.02, 0.01, 2e9, 0.3, 1000)
    s = mb.Scene("clamped")
    b = s.beam("b", (0, 0), (1, 0), section=section, order=3, elements=2)
    s.weld("W", s.ground, b, at=(0, 0))
    s.torque("M", b.at(1.0), (0, 0, 0.5))
    e = s.equilibrium()
    assert e.energy.potential[0] == pytest.approx(0.5**2 / (2 * section.EI3), rel=1e-6)


def test_energy_is_the_same_in_portions(monkeypatch: Any) -> None:
    from mbdae.results import states

    r = swinging("planar", 1e-2, (0, 3.0), "section").simulate(0.05, solver=mb.RadauIIA(3, rtol=1e-4))
    again = r(r.t)
    monkeypatch.setattr(states, "_ELEMENTS", 40)
    assert again.energy.balance == pytest.approx(r.energy.balance, abs=1e-15)
    assert again.energy.dissipated == pytest.approx(r.energy.dissipated, abs=1e-15)
