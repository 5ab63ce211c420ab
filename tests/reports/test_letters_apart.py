"""A letter has one meaning: parameters of laws of one's own and the page's own, symbols of an audit."""

from __future__ import annotations

import pytest
import sympy as sp

import mbdae as mb
from mbdae.reports.letters import read_alike


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
