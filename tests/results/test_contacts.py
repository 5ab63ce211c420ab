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


def test_a_warning_that_many_contacts_share_is_given_once():
    """Five soft balls that fall from different heights: the deepest is told, the others by name."""
    s = mb.Scene("balls", gravity=(0, -9.81, 0))
    for i in range(5):
        s.rigid_body(f"b{i}", 1.0, 0.01, at=(i, 0.5 + 0.1 * i))
        s.contact(f"c{i}", s.ground, f"b{i}", mb.Plane(normal=(0, 1, 0)), mb.Sphere(radius=0.1), normal=mb.Hertz(1e5))
    told = [text for text in s.simulate(0.6, accuracy=1e-3).warnings if "smallest radius" in text]
    assert len(told) == 1
    assert told[0].startswith("'c4' penetrates")
    assert "the same of 4 others: 'c3', 'c2', 'c1', ..." in told[0]
