"""The contacts of a run as its results count them."""

import warnings

import pytest

import mbdae as mb


def test_a_contact_within_one_step_is_counted():
    """Two spheres graze each other by 0.1 mm, within a step of a loose run at 100 m/s."""
    s = mb.Scene("grazing")
    ball = s.rigid_body("ball", 1.0, (4e-4,) * 3, at=(-5, 0, 0), velocity=(100, 0, 0))
    s.contact("peg", s.ground, ball, mb.Sphere(at=(0, 0.0999, 0), radius=0.05), mb.Sphere(radius=0.05), normal=mb.Hertz(1e8, 0.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        r = s.simulate(0.1, accuracy=1e-2)
    assert abs(r["ball"].velocity[-1, 1]) > 1e-3
    assert r.contacts["peg"]["contacts"] == 1
    assert r.contacts["peg"]["first"] == pytest.approx(0.05, abs=1e-3)
    assert r.contacts["peg"]["deepest"] == pytest.approx(1e-4, rel=0.05)
