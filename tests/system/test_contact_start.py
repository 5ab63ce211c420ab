"""What is expected of a contact before the run."""

import pytest

import mbdae as mb
from mbdae.system.prepare import prepare


def driven_slider_crank(angle0):
    """A crank of 0.15 m that turns at 50 rad/s from angle0, with play at its pin."""
    s = mb.Scene("slider-crank")
    s.link("crank", (0, 0), (0.15, 0), mass=0.5)
    s.link("rod", (0.15, 0), (0.55, 0), mass=0.3)
    s.rigid_body("slider", 1.0, 1e-3, at=(0.55, 0))
    s.revolute("A", s.ground, "crank", at=(0, 0), angle0=angle0, rate0=50.0)
    s.revolute("B", "crank", "rod", at=(0.15, 0), model=mb.Clearance(0.0205, 0.02, mb.Hertz(1e9)))
    s.revolute("C", "rod", "slider", at=(0.55, 0))
    s.prismatic("D", s.ground, "slider", at=(0.55, 0), axis=(1, 0, 0))
    return s


@pytest.mark.parametrize("angle0", [0.0, 0.3, 0.7, 2.0])
def test_roundoff_of_a_closed_loop_is_no_speed_of_impact(angle0):
    """Pin and race move together at 7.5 m/s: what is expected is the fall through the play under the forces of inertia."""
    (contact,) = prepare(driven_slider_crank(angle0)).contacts
    assert 1e-5 < contact.depth < 1e-3


@pytest.mark.parametrize("speed", [1e-60, 1e-144])
def test_next_to_no_speed_is_no_mistake_of_a_law(speed):
    """The tail of a bell gives such speeds: the penetration of an impact at them is smaller than any number a user may give."""
    depth, duration = mb.Hertz(1e9).impact(1.0, speed)
    assert 0 <= depth < 1e-30
    assert duration > 1e3


def test_tiny_values_of_a_users_normal_law_are_accepted():
    class Soft(mb.Normal):
        params = mb.params(stiffness=("N/m", "stiffness"))

        def impact(self, mass, speed):
            return abs(speed) * 1e-90, 1e-3

    assert Soft(stiffness=1.0).impact(1.0, 1e-100)[0] == pytest.approx(1e-190)
