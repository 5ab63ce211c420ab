"""Recursive joints with a coordinate across the plane leave planar scenes planar."""

from __future__ import annotations

import numpy as np
import pytest

import mbdae as mb


def scene(joint, **more):
    s = mb.Scene("plane", gravity=(0, -9.81, 0))
    s.link("rod", (0, 0), (0.4, 0.3), mass=1)  # a slender rod: in space it could spin without inertia
    s.bushing("B", s.ground, "rod", at=(0, 0), stiffness=(200, 200, 200))
    s.link("next", (0.4, 0.3), (0.8, 0.6), mass=1)
    getattr(s, joint)("J", "rod", "next", at=(0.4, 0.3), **more)
    return s


JOINTS = {"fixed_orientation": {}, "revolute": {}, "planar": {"axis": (0, 0, 1)}, "prismatic": {"axis": (0.6, 0.8, 0)}}


@pytest.mark.parametrize("joint", JOINTS)
def test_a_planar_scene_stays_planar(joint):
    made = scene(joint, **JOINTS[joint])
    assert made.check().planar
    check = made.recursive().check()
    assert check.planar
    if joint == "fixed_orientation":
        assert "z stays 0" in str(check)


def test_a_run_goes_on_in_every_form():
    """The default run of a planar scene can be continued by any other: it stays in the plane."""
    first = scene("fixed_orientation").simulate(0.1, 1e-6)
    exact = scene("fixed_orientation").simulate(0.2, 1e-9)["next"].position[-1]
    for form in ("ggl", "index1", "index3"):
        r = scene("fixed_orientation").simulate(0.2, 1e-6, start=first, form=form)
        np.testing.assert_allclose(r["next"].position[-1], exact, atol=1e-5)
