"""Dry friction at tiny clearance: the pin is driven backwards around the race, and a run that cannot see it says so."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import mbdae as mb

sys.path.insert(0, str(Path(__file__).parents[2] / "validation"))
from rotor_scenes import rotor_with_clearance

FAST, SLOW = mb.Coulomb(0.3, 0.01), mb.Coulomb(0.1, 0.01)


def told(result, what):
    return [note for note in result.warnings if what in note]


@pytest.mark.filterwarnings("ignore::mbdae.errors.AccuracyWarning")
def test_backward_whirl_without_clearance_is_named():
    r = rotor_with_clearance(FAST, clearance=0.0).simulate(0.16, solver=mb.RadauIIA(3, rtol=1e-9))
    (note,) = told(r, "backward whirl in 'T'")
    assert "driven by dry friction" in note
    assert not told(r, "unstable")
    late = np.linspace(0.13, 0.16, 20000)
    x, y = r["T"].at_times(late)["orbit"].T
    assert np.median(np.diff(np.unwrap(np.arctan2(y, x))) / np.diff(late)) < -2000  # rad/s, the shaft turns at 24


@pytest.mark.filterwarnings("ignore::mbdae.errors.AccuracyWarning")
@pytest.mark.parametrize(("friction", "clearance", "damping", "expected"),
                         [(FAST, 0.0, 0.3, 1), (SLOW, 0.0, 0.3, 0), (FAST, 8e-6, 30.0, 0), (FAST, 8e-5, 0.3, 0),
                          (FAST, 8e-4, 0.3, 0)],
                         ids=["unstable", "less friction", "more damping", "80 micrometres", "800 micrometres"])
def test_steps_that_damp_an_unstable_contact_away_are_told(friction, clearance, damping, expected):
    r = rotor_with_clearance(friction, clearance, damping).simulate(0.3, solver=mb.RadauIIA(3, rtol=1e-7))
    assert len(told(r, "friction makes the contact in 'T' unstable")) == expected
    assert r.reliable is (False if expected else None)  # a run with a tolerance of its own has no estimate
    assert not told(r, "backward whirl")
