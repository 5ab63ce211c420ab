"""Loops of beams that no rigid motion closes or follows start bent, with the least elastic energy, and have a state at rest."""

from __future__ import annotations

import numpy as np
import pytest

import mbdae as mb
from mbdae.system.prepare import prepare

SECTION = mb.Section.rectangular(0.01, 0.02, E=2e9, nu=0.3, rho=1200, damping=1e-3)
A, B, C, D = (0, 0, 0), (0, 0.2, 0), (0.4, 0.3, 0), (0.4, 0, 0)


def four_bar(degrees=3.0, where="C", kind="beam", section=SECTION, **first):
    """A four-bar in space, the hinge at `where` out of parallel by so many degrees; first: options of hinge A."""
    s = mb.Scene("four-bar", gravity=(0, 0, -9.81))
    made = s.beam if kind == "beam" else s.link
    options = {"section": section} if kind == "beam" else {"mass": 0.1}
    crank, coupler, rocker = (made(name, *ends, **options) for name, ends in
                              (("crank", (A, B)), ("coupler", (B, C)), ("rocker", (D, C))))
    tilt = np.deg2rad(degrees)
    axes = dict.fromkeys("ABCD", (0, 0, 1)) | {where: (np.sin(tilt), 0, np.cos(tilt))}
    s.revolute("A", s.ground, crank, at=A, axis=axes["A"], **first)
    s.revolute("B", crank, coupler, at=B, axis=axes["B"])
    s.revolute("C", coupler, rocker, at=C, axis=axes["C"])
    s.revolute("D", s.ground, rocker, at=D, axis=axes["D"])
    return s


@pytest.mark.parametrize("where", ["A", "D", *(pytest.param(where, marks=pytest.mark.slow) for where in "BC")])
def test_a_misaligned_four_bar_of_beams_starts_at_speed_from_its_drawn_pose(where):
    s = four_bar(where=where, angle=2 * mb.t)
    r = s.simulate(0.1, accuracy=1e-4)
    assert r.warnings == ()
    assert r.start.changes == ["the beams start bending, because no rigid motion of them has the rates given: they begin with "
                               "velocities of least elastic power"]
    assert r.drift.position[0] < 1e-12
    assert r.drift.velocity[0] < 1e-10
    np.testing.assert_allclose(r["A"].rate[0], 2.0, rtol=1e-9)
    aligned = four_bar(0.0, angle=2 * mb.t).simulate(0.1, accuracy=1e-4)
    ends = [run["rocker"].at((0.4, 0.3, 0)).velocity[0] for run in (r, aligned)]
    np.testing.assert_allclose(*ends, atol=0.02)  # m/s, of 0.4: a tilt of 3 degrees changes little


def test_velocities_of_least_elastic_power_are_those_of_the_aligned_mechanism_in_the_limit():
    """The tilt bends the beams by an amount that falls with it."""
    rigid = four_bar(0.0, angle=2 * mb.t).simulate(1e-3, accuracy=1e-4).u[0]
    off = [np.abs(four_bar(degrees, angle=2 * mb.t).simulate(1e-3, accuracy=1e-4).u[0] - rigid).max() for degrees in (1.0, 0.1)]
    assert off[1] < 0.12 * off[0]
    assert off[0] < 0.2


def test_a_bent_start_is_the_same_however_stiff_the_beams_are():
    """Where all beams become stiffer alike, other positions and rates have no less energy and power."""
    soft = mb.Section.rectangular(0.01, 0.02, E=2e-3, nu=0.3, rho=1200, damping=1e-3)
    first, other = (prepare(four_bar(section=section, angle=0.1 + 2 * mb.t)).start for section in (SECTION, soft))
    assert any("start bent" in change for change in first.changes)
    np.testing.assert_allclose(other.q, first.q, atol=1e-12)
    np.testing.assert_allclose(other.u, first.u, atol=1e-9)


@pytest.mark.parametrize("first", [{"angle": 0.1}, {"angle0": 0.1}, {"angle": 0.1 + 2 * mb.t}])
def test_loops_that_close_only_bent_start_with_the_least_elastic_energy(first):
    r = four_bar(**first).simulate(1e-3, accuracy=1e-4)
    assert r.start.changes[0].startswith("the beams start bent, with an elastic energy of ")
    assert r.drift.position[0] < 1e-11
    np.testing.assert_allclose(r["A"].angle[0], 0.1, atol=1e-9)
    if "angle0" not in first:
        return
    told = float(r.start.changes[0].split("energy of ")[1].split(" J")[0])
    held = four_bar(angle=0.1)
    held.gravity = (0, 0, 0)
    e = held.equilibrium()  # the same loop, held, without loads: its state at rest is that of least energy
    assert told == pytest.approx(float(e.energy.potential[0]), rel=1e-2)


def test_a_misaligned_four_bar_of_beams_has_a_state_at_rest():
    for first in ({}, {"angle": 0.0}, {"angle": 0.1}):
        e = four_bar(**first).equilibrium()
        assert e.load_factor == 1
        weight = sum(b.mass for b in e.prepared.model.scene.bodies if b.name in ("crank", "coupler", "rocker")) * 9.81
        assert e["A"].force[0, 2] + e["D"].force[0, 2] == pytest.approx(weight, rel=1e-8)


def test_rigid_links_in_the_same_place_are_refused():
    with pytest.raises(mb.StartError, match="do not allow the motion prescribed for 'A'"):
        four_bar(kind="link", angle=2 * mb.t).check()
