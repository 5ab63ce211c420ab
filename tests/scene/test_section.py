"""Sections: closed forms of shapes, and values that are refused."""

from __future__ import annotations

import math

import pytest

from mbdae.errors import OptionError
from mbdae.scene.shapes import Section

STEEL = {"E": 210e9, "nu": 0.3, "rho": 7850.0}
GIVEN = {"EA": 1e6, "GA2": 3e5, "GA3": 4e5, "GJ": 80.0, "EI2": 100.0, "EI3": 200.0, "mass_per_length": 2.0,
         "rotary_inertia": 1e-4}


def test_circle():
    s, r = Section.circular(0.01, **STEEL), 0.01
    G = 210e9 / 2.6
    assert pytest.approx(210e9 * math.pi * r**2) == s.EA
    assert s.EI2 == s.EI3 == pytest.approx(210e9 * math.pi * r**4 / 4)
    assert pytest.approx(G * math.pi * r**4 / 2) == s.GJ
    assert s.GA2 / (G * math.pi * r**2) == pytest.approx(6 * 1.3 / (7 + 6 * 0.3))  # Cowper 1966: 0.886
    assert s.mass_per_length == pytest.approx(7850 * math.pi * r**2)
    assert s.rotary_inertia[0] == pytest.approx(2 * s.rotary_inertia[1])


def test_tube_between_circle_and_thin_wall():
    assert Section.tube(0.02, 0.0, **STEEL) == Section.circular(0.02, **STEEL)
    thin = Section.tube(0.02, 0.01999, **STEEL)
    A = math.pi * (0.02**2 - 0.01999**2)
    assert pytest.approx(2 * 1.3 / (4 + 3 * 0.3), rel=1e-3) == thin.GA2 / (210e9 / 2.6 * A)  # Cowper: thin-walled round tube
    assert pytest.approx(210e9 * A * 0.02**2 / 2, rel=1e-3) == thin.EI3


@pytest.mark.parametrize(("ratio", "beta"), [(1, 0.1406), (2, 0.229), (10, 0.312), (1e6, 1 / 3)])
def test_torsion_of_rectangles(ratio, beta):
    """J = beta a b^3, beta as tabulated by Timoshenko and Goodier."""
    b = 0.01
    for s in (Section.rectangular(ratio * b, b, **STEEL), Section.rectangular(b, ratio * b, **STEEL)):
        assert s.GJ / (210e9 / 2.6 * ratio * b**4) == pytest.approx(beta, abs=4e-4)


def test_rectangle_bends_in_the_plane_over_its_height():
    s = Section.rectangular(width=0.02, height=0.05, damping=0.01, **STEEL)
    assert pytest.approx(210e9 * 0.02 * 0.05**3 / 12) == s.EI3
    assert pytest.approx(210e9 * 0.05 * 0.02**3 / 12) == s.EI2
    assert pytest.approx(210e9 / 2.6 * 0.001 * 10 * 1.3 / (12 + 11 * 0.3)) == s.GA2
    assert s.rotary_inertia[0] == pytest.approx(s.rotary_inertia[1] + s.rotary_inertia[2])
    assert s.swapped.EI3 == s.EI2
    assert s.swapped.swapped == s
    assert s.damping == 0.01


def test_numbers_are_compliances():
    s = Section(**{**GIVEN, "EA": math.inf, "GA2": math.inf})
    assert s.numbers["compliance_N1"] == 0
    assert s.numbers["compliance_M3"] == 1 / 200
    assert s.rigid == ("EA", "GA2")
    assert s.rotary_inertia == (2e-4, 1e-4, 1e-4)
    assert Section(**{**GIVEN, "rotary_inertia": [3, 1, 2]}).numbers["J3"] == 2


@pytest.mark.parametrize(("name", "value"), [(n, v) for n in GIVEN for v in (0, -1.0) if n != "rotary_inertia"] + [
    ("rotary_inertia", (1, -1, 1)), ("rotary_inertia", (1, 2)), ("mass_per_length", math.inf), ("damping", -0.1), ("EA", "stiff"),
    ("GJ", math.nan),
])
def test_values_that_are_refused(name, value):
    with pytest.raises(OptionError, match=name):
        Section(**{**GIVEN, name: value})


def test_all_wrong_values_are_told_at_once():
    with pytest.raises(OptionError, match=r"EA = -1 N is not positive, mass_per_length = 0 kg/m"):
        Section(**{**GIVEN, "EA": -1, "mass_per_length": 0})


@pytest.mark.parametrize(("shape", "sizes", "message"), [
    ("circular", {"radius": 0}, "radius = 0 m"), ("tube", {"outer": 0.01, "inner": 0.01}, "inner = 0.01 m"),
    ("rectangular", {"width": -1, "height": 1}, "width = -1 m"), ("circular", {"radius": 1, "nu": 0.6}, "nu = 0.6"),
    ("circular", {"radius": 1, "E": 0}, "E = 0 Pa"),
])
def test_shapes_that_are_refused(shape, sizes, message):
    with pytest.raises(OptionError, match=message):
        getattr(Section, shape)(**{**STEEL, **sizes})
