"""Units of what laws state: reports name terms that do not fit, and print the unit that a coordinate has."""

from __future__ import annotations

import numpy as np
import pytest
import symengine as se

import mbdae as mb
from mbdae.reports import exported
from mbdae.reports.statement import derived, structure_of
from mbdae.reports.units import Unit, UnitError, dimensions, law_faults, unit
from mbdae.symbolic.law import Element, Law
from mbdae.symbolic.line import LineLaw


class Slanted(mb.Joint):
    """A row that adds a length to a cosine."""

    def constraints(self, k, l):
        return {"slant": (l.r - k.r) @ k.x + k.x @ l.y}


class Wedged(mb.Coupling):
    """A row that adds an angle to a length."""

    coordinates = mb.params(turn="rad", path="m")

    def constraints(self):
        return {"mesh": self.turn - self.path}


class Heavy(mb.Force):
    """A force that adds a torque."""

    params = mb.params(f="N", m="N m")

    def wrench(self, k, l):
        return (self.f + self.m) * k.x, 0 * k.x


class Waving(mb.Force):
    """The sine of a length."""

    params = mb.params(f="N")

    def wrench(self, k, l):
        return self.f * se.sin((l.r - k.r) @ k.x) * k.x, 0 * k.x


class Twisted(mb.Force):
    """A force of the unit of a torque."""

    params = mb.params(m="N m")

    def wrench(self, k, l):
        return self.m * k.x, 0 * k.x


WRONG = [
    (Slanted, "the row slant adds terms in 1 and in m"), (Wedged, "the row mesh adds terms in 1 and in m"),
    (Heavy, "the force on l adds terms in N and in N m"), (Waving, "the force on l is a function of m"),
    (Twisted, "the force on l has the unit m^2 kg s^-2, not N"),
]


@pytest.mark.parametrize(("law", "told"), WRONG)
def test_reports_name_what_adds_several_units(law, told):
    text = mb.report(law).to_markdown()
    assert f"The units do not fit: {told}." in text
    assert "NOT EQUAL" in text


def test_sheets_name_it_too():
    s = mb.Scene("mixed")
    b = s.rigid_body("b", 1.0, (1, 1, 1), at=(1, 0, 0))
    s.add(Heavy("push", s.ground, b, at=(0, 0, 0), f=1.0, m=1.0))
    assert "The units do not fit: push: the force on l adds terms in N and in N m." in mb.report(s).to_markdown()


def laws():
    return {n: law for n, law in exported().items() if issubclass(law, Law) and not issubclass(law, Element | LineLaw)}


@pytest.mark.parametrize("name", sorted(laws()))
def test_laws_of_the_package_have_units(name):
    law = laws()[name]
    for options in ({}, {"kept": True}) if "kept" in law.options else ({},):
        d = derived(law, structure_of(law, options))
        assert dimensions(d)
        assert law_faults(d) == []


def test_what_a_unit_is():
    assert unit("N m s/rad").powers == (2, 1, -1)
    assert (unit("J") / unit("m")).of_force == "N"
    assert str(Unit((2, 0, -1))) == "m^2 s^-1"
    np.testing.assert_allclose(unit("N/m^1.5").size({"m": 4.0, "kg": 3.0, "s": 2.0}), 3 / 4 / 4**0.5)
    with pytest.raises(UnitError, match="'furlong' is not known"):
        unit("furlong")


def test_exports_have_the_unit_of_the_coordinate_that_a_law_acts_on():
    s = mb.Scene("units")
    k, l = (s.rigid_body(name, 1.0, (1, 1, 1), at=(1, 0, 0)) for name in "kl")
    s.revolute("h", s.ground, k, at=(0, 0, 0), axis=(0, 0, 1), spring=3.0, damper=1.0, model=mb.Classical())
    s.prismatic("p", s.ground, l, at=(0, 0, 0), axis=(0, 0, 1), spring=3.0, damper=1.0)
    export = mb.export(s, form=mb.GGL())
    units = {e.name: e.unit for e in (*export.inputs["p"], *export.inputs["y"])}
    assert {n: units[n] for n in ("h.stiffness", "h.damping", "h.rest")} == {
        "h.stiffness": "N m/rad", "h.damping": "N m s/rad", "h.rest": "rad"}
    assert {n: units[n] for n in ("p.stiffness", "p.damping", "p.rest")} == {
        "p.stiffness": "N/m", "p.damping": "N s/m", "p.rest": "m"}
    assert {units[f"{x}(h.{row})"] for x, row in (("lambda", "x"), ("mu", "x"))} == {"N s", "m"}
    assert [name for name, stated in units.items() if not stated or " or " in stated] == []
