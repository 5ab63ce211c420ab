"""Planar scenes say so; motions out of the plane are looked at once, where there are beams or free bodies."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from out_of_plane.cases import Planar, between_springs, cases, spinning
from out_of_plane.check import said

import mbdae as mb

BY_NAME = {c.name: c for c in cases()}
#: one of each kind on both sides; the claim `out_of_plane` has the rest
CHOSEN = [name for name in BY_NAME if name[:2] in ("00", "01", "05", "06", "11", "12", "14", "15", "18", "19")]


@pytest.mark.parametrize("name", CHOSEN)
def test_told_or_stable(name: str) -> None:
    case: Planar = BY_NAME[name]
    assert said(case) == (case.right, int(case.right == "unstable"))


def test_every_print_of_a_planar_scene_says_planar() -> None:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (0, -1), mass=1.0), at=(0, 0), spring=1.0)
    e = s.equilibrium()
    l, r, f = s.linearize(at=e), s.simulate(0.1, start=e), s.floquet(1.0, at=e)
    for printed in (s.check(), e, l, r, f):
        assert "planar" in repr(printed)
        assert "planar" in str(printed)
    assert "planar" in r._repr_html_()
    assert l.out_of_plane is None
    assert "not looked at" in str(l)
    space = mb.Scene("top", gravity=(0, 0, -9.81))
    space.spherical("O", space.ground, space.rigid_body("top", 1.0, (1, 1, 1), at=(0, 0, -1)), at=(0, 0, 0))
    for printed in (space.check(), space.linearize(), space.simulate(0.1)):
        assert "planar" not in repr(printed) + str(printed)


def test_it_can_be_switched_off() -> None:
    s = between_springs(-20.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        e = s.equilibrium(out_of_plane=False)
        found = s.linearize(at=e, out_of_plane=False)
    assert (e.out_of_plane, found.out_of_plane) == (None, None)
    with pytest.raises(mb.OptionError, match="out_of_plane"):
        s.linearize(out_of_plane="no")


def test_growth_out_of_the_plane_is_that_of_the_same_scene_in_space() -> None:
    """A mass between pushed springs: z'' = 2 N / (L m) z."""
    with pytest.warns(mb.AccuracyWarning, match=rf"grow by {np.sqrt(40.0):.4g}/s"):
        assert between_springs(-20.0).linearize().out_of_plane == "unstable"


def test_an_inertia_that_is_not_stated_decides_nothing_of_a_spin() -> None:
    s = mb.Scene("disc")
    body = s.rigid_body("disc", 1.0, 0.5, angular_velocity=(0, 0, 3.0))
    assert s.linearize(frame=body).out_of_plane is None
    still = mb.Scene("still")
    still.rigid_body("disc", 1.0, 0.5)
    assert still.linearize().out_of_plane == "stable"
    assert spinning(2).linearize(frame="body").out_of_plane == "stable"
