"""Equations with the literal 0, bounds, units of both: whatever side they stand on."""

from __future__ import annotations

import pytest

import mbdae as mb

TEXT = """
states: revolute
a1 [1]: axis 1 of k
a2 [1]: axis 2 of k
a3 [1]: axis 3 of k
wk [rad/s]: angular velocity of k
wl [rad/s]: angular velocity of l
q [rad/s]: rate of the relative angle
d [1]: row tilt_y of Revolute
"""


def row(formula: str) -> tuple[str, str]:
    found = mb.audit(f"{TEXT}1: {formula}\n")["1"]
    return found.verdict, found.said


@pytest.mark.parametrize("side", ["1", "wk", "a1'*a1", "wl - wk + q*a3"])
def test_what_is_not_zero_is_a_misprint_on_either_side(side: str) -> None:
    verdicts = [row(text)[0] for text in (f"0 = {side}", f"{side} = 0", f"-0 = {side}", f"0 = {side} = {side}")]
    assert verdicts == ["MISPRINT"] * 4


def test_what_is_zero_is_right_on_either_side_and_repaired_alike() -> None:
    assert row("0 = wl - wk - q*a3") == row("wl - wk - q*a3 = 0") == ("RIGHT", "")
    assert row("0 = a1'*a2")[0] == "RIGHT"
    assert row("0 = wl - wk + q*a3")[1] == row("wl - wk + q*a3 = 0")[1] == "sign of q*a3"
    assert "half a turn" in mb.audit(TEXT + "b [1]: axis 3 of l\n1: 0 = a1'*b\n")["1"].remark


@pytest.mark.parametrize(("formula", "verdict", "said"), [
    ("0 <= norm(a1)", "CANNOT JUDGE", "too few reach it"),
    ("0 <= wk'*a1 <= norm(wk)", "MISPRINT", ""),
    ("0 <= norm(wk) <= wk'*a1", "MISPRINT", ""),
    ("0 <= a1", "CANNOT JUDGE", "a bound is one of numbers"),
    ("0 = 0", "CANNOT JUDGE", "both sides are 0"),
    ("a1 >= a2", "CANNOT JUDGE", "write a bound as `smaller <= larger`"),
    ("0 = wk'*a1 <= 1", "CANNOT JUDGE", "write two"),
    ("abs(wk'*a3) <= norm(wk)^2", "MISPRINT", "the unit s^-2"),
])
def test_bounds_and_statements_about_nothing(formula: str, verdict: str, said: str) -> None:
    assert row(formula)[0] == verdict
    assert said in row(formula)[1]


@pytest.mark.parametrize(("formula", "tex"), [
    ("norm(wk)^2 = 4*rate(pk)'*rate(pk)", r"{\left(\frac{d}{dt} p^{k}\right)}^{T}"),
    ("(pk')' = pk", r"{p^{kT}}^{T}"),
    ("rate(q)^2 = rate(q)*rate(q)", r"{\left(\frac{d}{dt} q\right)}^{2}"),
])
def test_marks_behind_pieces_with_marks(formula: str, tex: str) -> None:
    """No letter has two exponents, which LaTeX refuses."""
    page = mb.audit(f"{TEXT}pk [1]: Euler parameters of k\n1: {formula}\n").document().to_markdown()
    assert tex in page
    assert "}^{k}^" not in page
