"""Accelerations do not depend on the states that were tried before: a trial that goes too far costs no digits."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest

import mbdae as mb


def beam():
    s = mb.Scene("beam", gravity=(0, 0, -9.81))
    section = mb.Section(EA=2e3, GA2=8e2, GA3=8e2, GJ=2, EI2=3, EI3=1, mass_per_length=1, rotary_inertia=1e-2, damping=0.02)
    s.beam("beam", (0, 0, 0), (0.8, 0.6, 0), section=section, elements=2, order=1)
    s.rigid_body("tip", mass=0.3, inertia=(0.01, 0.02, 0.03), at=(0.8, 0.6, 0))
    s.weld("W", "beam", "tip", at=(0.8, 0.6, 0))
    return s


def chain():
    s = mb.Scene("chain", gravity=(0, -9.81, 0))
    s.rigid_body("b1", mass=1, inertia=(0.02, 0.03, 0.04), at=(0.5, 0, 0))
    s.revolute("A", s.ground, "b1", at=(0, 0, 0), axis=(0, 0.6, 0.8), rate0=2.0)
    s.rigid_body("b2", mass=1, inertia=(0.02, 0.03, 0.04), at=(1.5, 0, 0))
    s.spherical("B", "b1", "b2", at=(1, 0, 0))
    return s


@pytest.mark.parametrize("made", [beam, chain])
def test_a_wild_trial_costs_no_digits(made):
    system = made().system(mb.Index1(multipliers="eliminated", baumgarte=0.0))
    y, rng = system.y0.copy(), np.random.default_rng(1)
    before, wild, after = np.empty((3, system.n))
    system.rhs(0.0, y, before)
    for size in (1e6, 1e40, 1e160):
        with contextlib.suppress(mb.errors.SolverError), np.errstate(all="ignore"):
            system.rhs(0.0, y + size * rng.normal(size=len(y)), wild)
        system.rhs(0.0, y, after)
        np.testing.assert_array_equal(after, before)
