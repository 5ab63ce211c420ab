"""A planar beam whose section axis 3 is not z is the beam of the spatial scene."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mbdae as mb

SECTION = mb.Section(2e4, 7e3, 9e3, 10.0, 5.0, 20.0, 0.2, (3e-5, 1e-5, 2e-5), damping=1e-2)


@pytest.mark.parametrize("axis2", [(0, -1, 0), (0, 0, 1), (0, 0, -1)])
def test_planar_and_spatial_agree_for_every_axis2(axis2: Any) -> None:
    found = []
    for space in ("planar", "spatial"):
        s = mb.Scene("turned", gravity=(0, -9.81, 0), space=space)
        b = s.beam("b", (0, 0), (1, 0), section=SECTION, elements=3, order=3, axis2=axis2)
        s.revolute("W", s.ground, b, at=(0, 0), spring=3.0, angle0=0.2)
        s.spring("Q", s.ground, b, at_k=(1, 1), at_l=b.at((0.95, 0.1)), stiffness=20.0)
        b.load((0.3, 2 * mb.t))
        r = s.simulate(0.2, solver=mb.RadauIIA(3, rtol=1e-8), outputs=3)
        place = r["b"].at((0.95, 0.1))
        found.append((place.position[-1], place.rotation[-1], r["b"].at(0.5).stress_resultants[-1], r["W"].angle[-1]))
    for planar, spatial in zip(*found, strict=True):
        np.testing.assert_allclose(planar, spatial, atol=2e-4)


def test_a_following_load_on_a_turned_section_is_spatial() -> None:
    s = mb.Scene("turned")
    s.beam("b", (0, 0), (1, 0), section=SECTION, axis2=(0, -1, 0)).load((0, 1.0), frame="section")
    assert "load 'load on b' turns with the sections of beam 'b', whose axis 3 is not z" in str(s.check())


def test_an_x_axis_in_the_plane_is_named():
    """Of an axis in the plane the x axis is normal to it; the message named the axis, with which nothing was wrong."""
    s = mb.Scene("slide", space="planar")
    s.joint(mb.Prismatic, "p", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), axis=(1, 0, 0), axis_x=(0, 1, 0))
    with pytest.raises(mb.SceneError, match=r"is in the plane, but its x axis \(0, 1, 0\) is not \(0, 0, 1\); omit axis_x"):
        s.check()
