"""Shafts with joints of Cardan, a screw jack with friction, and gears, against closed forms (`validation/joints/`)."""

from __future__ import annotations

import numpy as np
import pytest
from joints import gears, jack, shafts

import mbdae as mb
from mbdae.errors import LawError
from mbdae.system.prepare import prepare

CLOSE = 1e-8


@pytest.mark.parametrize("errors", [
    shafts.errors, jack.free, gears.planetary_errors, gears.differential_errors, gears.rack_errors, gears.arm_errors,
    gears.mill_errors,
], ids=lambda f: f"{f.__module__}.{f.__name__}")
def test_closed_forms(errors):
    wrong = {name: error for name, error in errors() if not error < CLOSE}
    assert not wrong


@pytest.mark.parametrize("lead", [0.005, -0.02])
@pytest.mark.parametrize("turning", [8.0, -8.0])
@pytest.mark.parametrize("outwards", [True, False])
def test_torque_of_a_screw_jack_is_that_of_the_wedge(lead, turning, outwards):
    """W r tan(phi + rho) up, W r tan(phi - rho) down; the guide of the nut takes the opposite torque."""
    r = jack.jack(lead, 0.12, turning, outwards=outwards).simulate(0.1, outputs=3)
    phi, up = np.arctan(lead / (2 * np.pi * jack.RADIUS)), np.sign(turning * lead)
    torque = jack.WEIGHT * jack.RADIUS * np.tan(abs(phi) + up * np.arctan(0.12)) * np.sign(lead)
    np.testing.assert_allclose(r["bearing"].torque[:, 2], torque, rtol=CLOSE)
    np.testing.assert_allclose(r["guide"].torque[:, 2], -torque, rtol=CLOSE)


def test_a_self_locking_screw_is_named_and_does_not_turn():
    locking, steep = jack.jack(0.005, 0.12), jack.jack(0.02, 0.12)  # tan(lead angle) = 0.066 and 0.265
    found = str(locking.check())
    assert "joint 'thread': self-locking: its friction coefficient 0.12 is above tan(lead angle) = 0.06631" in found
    assert "self-locking" not in str(steep.check())
    assert not jack.jack(0.005, 0.0).check().remarks
    assert not jack.jack(0.0, 0.12).check().remarks  # a hinge: no axial force turns any
    # it creeps at the speed where the smoothed coefficient is the slope of the thread
    slope, travel = 0.005 / (2 * np.pi * jack.RADIUS), np.hypot(jack.RADIUS, 0.005 / (2 * np.pi))
    creep = jack.CREEP * np.arctanh(slope / 0.12) / travel
    assert locking.simulate(0.5, outputs=3)["bearing"].rate[-1] == pytest.approx(-creep, rel=1e-4)


def test_a_thread_that_no_torque_turns_is_refused():
    """Lead angle and angle of friction of 90 degrees or more together."""
    with pytest.raises(LawError, match="no torque turns it"):
        jack.jack(0.2, 0.5)


def test_a_spindle_too_light_for_its_friction_finds_no_balance():
    """Where friction grows faster by the axial force than inertia resists, there is no solution: self-locking, by name."""
    s = mb.Scene("jack", gravity=(0, 0, -10.0))
    nut = s.rigid_body("load", 100.0, (1.0, 1.0, 1e-6), at=(0, 0, 0))
    s.screw("thread", s.ground, nut, at=(0, 0, 0), axis=(0, 0, 1), lead=0.005, friction=mb.Coulomb(0.12, 1e-4), radius=0.012,
            start_rate=-5.0)
    with pytest.raises(mb.SolverError, match=r"'thread'.*self-locking"):
        prepare(s)


def test_a_coupling_reads_prescribed_coordinates():
    """Of joints that are recursive otherwise: the scene says that they stay kinematic."""
    s = mb.Scene("pair")
    for name, place in (("A", 0.0), ("B", 1.0)):
        wheel = s.rigid_body(f"wheel {name}", 1.0, (0.1, 0.1, 0.2), at=(place, 0, 0))
        s.revolute(name, s.ground, wheel, at=(place, 0, 0), angle=2 * mb.t if name == "A" else None, model=mb.Recursive())
    s.gear("G", "A", "B", ratio=-3)
    assert s.check().kept_kinematic == {"A": "a coupling reads its prescribed coordinate, which is no unknown where the joint "
                                             "is recursive"}
    for form in (mb.GGL(), mb.Index1()):
        np.testing.assert_allclose(s.simulate(0.5, form=form, outputs=3)["B"].angle, [0, -1.5, -3.0], atol=1e-6)
