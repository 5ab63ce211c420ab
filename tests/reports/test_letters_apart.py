"""A letter has one meaning: parameters of laws of one's own and the page's own, symbols of an audit."""

from __future__ import annotations

import pytest
import sympy as sp

import mbdae as mb
from mbdae.documents.blocks import Equation
from mbdae.reports.letters import read_alike
from mbdae.reports.line_element import ElementWriter
from mbdae.reports.units import ambiguous
from mbdae.reports.vectors import Base


def law(name: str) -> type:
    class Mine(mb.Force):
        """A spring."""

        params = mb.params(**{name: ("1", "mine"), "kk": ("N/m", "stiff")})

        def energy(self, k, l):
            d = l.r - k.r
            return self.kk * (d @ d) * sp.pi * getattr(self, name) / 2

    return Mine


def joint(name: str) -> type:
    class Mine(mb.Joint):
        """Two planes."""

        params = mb.params(**{name: ("m", "mine")})

        def constraints(self, k, l):
            d = l.r - k.r
            return {"x": k.x @ d - getattr(self, name), "y": k.y @ d}

    return Mine


def letter_of(text: str) -> str:
    return next(line for line in text.splitlines() if line.endswith("| mine |")).split("|")[1].strip(" $")


@pytest.mark.parametrize("name", ["V", "D", "P", "pi", "delta", "sin"])
def test_a_parameter_of_a_force_is_told_from_the_letters_of_its_page(name: str) -> None:
    text = mb.report(law(name)).to_markdown()
    assert "NOT EQUAL" not in text
    assert letter_of(text).endswith(r"_{\text{p}}")


@pytest.mark.parametrize("name", ["c_x", "omega", "m", "omega_k", "gamma_x"])
def test_a_parameter_of_a_joint_is_told_from_its_rows_and_the_plane(name: str) -> None:
    text = mb.report(joint(name)).to_markdown()
    assert "NOT EQUAL" not in text
    rows = {read_alike(rf"{head}_\text{{x}}") for head in ("c", r"\gamma")} | {"m", r"\omega", r"\omega_k"}
    assert read_alike(letter_of(text)) not in rows


def test_symbols_of_an_audit_are_printed_apart() -> None:
    text = "wk [rad/s]: angular velocity of k\nomegak [m]: position of k\nvk [m/s]: velocity of k\n"
    text += "1: rate(omegak) = vk\n2: wk = wk\n"
    page = mb.audit(text).document().to_markdown()
    assert r"\mathrm{omegak}" in page
    assert page.count(r"$\omega^{k}$") == 1


def test_a_letter_with_two_meanings_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The momentum per length and the quaternion of an element, both written p."""
    told = "$\\mathbf { p }$ has one meaning"
    assert told not in mb.report("beam").to_markdown()
    monkeypatch.setitem(ElementWriter.told, Base("p", "b"), (r"\mathbf{p}", "1", "value at the point"))
    assert told in mb.report("beam").to_markdown()


def test_two_pages_mean_the_same_where_they_share_a_row_or_a_formula() -> None:
    row, other = ["$a,\\ b$", "m", "sides"], ["$a$", "s", "a time"]
    one, two = type("One", (), {}), type("Two", (), {})
    assert ambiguous([(one, [row], []), (two, [row], [Equation("a = 2")])]) == []
    assert ambiguous([(one, [row], []), (two, [other], [])]) == ["$a$"]
    assert ambiguous([(one, [row], []), (two, [], [Equation("a = 2")])]) == ["$a$"]
    assert ambiguous([(one, [], [Equation("b = c")]), (two, [], [Equation("b = d")])]) == ["$b$"]
    assert ambiguous([(one, [], [Equation("b = c")]), (two, [], [Equation("b = c = d")])]) == []
    assert ambiguous([(one, [], [Equation("b = c")]), (one, [], [Equation("b = d")])]) == []
