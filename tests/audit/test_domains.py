"""Formulas that are real on a part of all states: judged there, with the condition said; assumptions of a text."""

from __future__ import annotations

import pytest

import mbdae as mb

SYMBOLS = """
section: domains
x [1]: function of time
q [rad]: function of time
z [m]: function of time
r [m]: positive number
l [m]: positive number
u [m]: vector function of time
d [m]: position of l relative to k
vk [m/s]: velocity of k
vl [m/s]: velocity of l
let n [1] = u/norm(u)
"""


def row(*lines: str):
    """The verdict on the last line."""
    return mb.audit(SYMBOLS + "\n".join(lines) + "\n").equations[-1]


@pytest.mark.parametrize(("formula", "where"), [
    ("rate(acos(x)) = -rate(x)/sqrt(1 - x^2)", "x in (-1, 1)"),
    ("rate(asin(r/l*sin(q))) = r*cos(q)*rate(q)/sqrt(l^2 - r^2*sin(q)^2)", "r/l*sin(q) in (-1, 1)"),
    ("rate(sqrt(z)) = rate(z)/(2*sqrt(z))", "z > 0"),
    ("rate(log(z/r)) = rate(z)/z", "z/r > 0"),
    ("rate(rate(z^1.5)) = 3/2*sqrt(z)*rate(rate(z)) + 3/4*rate(z)^2/sqrt(z)", "z > 0"),
    ("1 + tan(q)^2 = 1/cos(q)^2", "cos(q) != 0"),
    ("1/(1/r - 1/l) = r*l/(l - r)", "1/r - 1/l != 0 and l - r != 0"),
    ("x/abs(x) = sign(x)", "x != 0"),
    ("rate(n) = (I - n*n')*rate(u)/norm(u)", "u != 0"),
    ("rate(norm(d)) = d'*(vl - vk)/norm(d)", "d != 0"),
    ("sqrt(l^2 + r^2 + 2*l*r*cos(q)) = sqrt((l + r*cos(q))^2 + r^2*sin(q)^2)", ""),  # never negative: nothing to say
    ("diff(diff(log(1 + x^2), x), x) = 2*(1 - x^2)/(1 + x^2)^2", ""),
])
def test_right_where_it_is_real(formula: str, where: str) -> None:
    found = row(f"1: {formula}")
    assert (found.verdict, found.where) == ("RIGHT", where)
    assert found.said == (f"for {where}" if where else "")


@pytest.mark.parametrize(("formula", "mended"), [
    ("rate(acos(x)) = rate(x)/sqrt(1 - x^2)", "rate(acos(x)) = -rate(x)/sqrt(1 - x^2)"),
    ("rate(sqrt(l^2 - r^2*sin(q)^2)) = -r^2*sin(q)*cos(q)*rate(q)/sqrt(l^2 - r^2*cos(q)^2)",
     "rate(sqrt(l^2 - r^2*sin(q)^2)) = -r^2*sin(q)*cos(q)*rate(q)/sqrt(l^2 - r^2*sin(q)^2)"),
    ("sin(acos(x)) = sqrt(x^2 - 1)", "sin(acos(x)) = sqrt(1 - x^2)"),  # the sides are real together nowhere
    ("rate(sqrt(z)) = rate(z)/(3*sqrt(z))", "rate(sqrt(z)) = rate(z)/(2*sqrt(z))"),
])
def test_misprints_are_mended_in_their_domain(formula: str, mended: str) -> None:
    found = row(f"1: {formula}")
    assert found.verdict == "MISPRINT"
    assert found.repaired is not None
    assert found.repaired.text == mended


@pytest.mark.parametrize("lines", [
    ("q in (0, pi)", "1: sin(q) = sqrt(1 - cos(q)^2)"), ("assume: l > r; 0 < q < pi", "1: sin(q) = sqrt(1 - cos(q)^2)"),
    ("1: sin(q) = sqrt(1 - cos(q)^2) for q in (0, pi)",), ("q [rad]: angle in (0, pi)", "1: sin(q) = sqrt(1 - cos(q)^2)"),
    ("q [rad]: positive number < 3", "1: sin(q) = sqrt(1 - cos(q)^2)"), ("1: l - 8*r = sqrt((l - 8*r)^2) if l > 8*r",),
    ("y [m]: number in (7, 9)", "1: abs(y) = y"), ("u != 0, d != 0", "1: norm(u)/norm(u) = norm(d)/norm(d)"),
])
def test_what_a_text_assumes_holds_in_all_states(lines: tuple[str, ...]) -> None:
    found = row(*lines)
    assert found.verdict == "RIGHT", found.said
    assert found.where or "y" in lines[0]


def test_an_assumption_goes_with_its_symbols() -> None:
    text = ("q in (0, pi)", "1: sin(q) = sqrt(1 - cos(q)^2)")
    assert row(*text, "x [1]: number", "2: sin(q) = sqrt(1 - cos(q)^2)").verdict == "RIGHT"
    assert row(*text, "q [rad]: angle", "2: sin(q) = sqrt(1 - cos(q)^2)").verdict == "INCOMPLETE"


@pytest.mark.parametrize(("formula", "part"), [
    ("sin(q) = sqrt(1 - cos(q)^2)", "sin(q) > 0"), ("asin(sin(q)) = q", "cos(q) > 0"), ("sqrt(x^2) = x", "x > 0"),
])
def test_a_branch_holds_on_a_part(formula: str, part: str) -> None:
    found = row(f"1: {formula}")
    assert (found.verdict, found.repair) == ("INCOMPLETE", f"say that it holds for {part}")


@pytest.mark.parametrize(("lines", "told"), [
    (("1: sqrt(-1 - x^2) = x",), "a side is real for -1 - x^2 > 0 alone"), (("l > r, r > l", "1: l = l*r/r"), "l > r and r > l"),
    (("l > y", "1: l = r"), "the symbol 'y' has no meaning"), (("x in (0 1)", "1: x = x*l/l"), "follows a complete formula"),
    (("u > 0", "1: norm(u) = sqrt(u'*u)"), "compares numbers"),
])
def test_what_cannot_be_judged_says_why(lines: tuple[str, ...], told: str) -> None:
    rows = mb.audit(SYMBOLS + "\n".join(lines) + "\n").equations
    assert any(r.verdict == "CANNOT JUDGE" and told in r.remark for r in rows), rows


def test_a_text_may_declare_the_letter_of_the_identity() -> None:
    lines = ("I [m^4]: positive number", "P [N]: positive number", "E [N/m^2]: positive number", "let k [1/m] = sqrt(P/(E*I))")
    assert row(*lines, "1: diff(tan(k*l)/k, l) = 1/cos(k*l)^2").where == "cos(k*l) != 0"
    assert row("1: n'*I*n = 1").verdict == "RIGHT"


def test_repairs_keep_units() -> None:
    """No repair adds metres to a unit vector, although the sum would make the sides equal: the rate of n has no part along n."""
    found = row("1: 2*n'*rate(n) = n'*rate(u)")
    assert found.verdict == "MISPRINT"
    assert found.repaired is None or "n + " not in found.repaired.text


def test_edges_near_second_derivatives_are_no_misprints() -> None:
    """States in which the differences of a second derivative would reach beyond the edge of a root are left out."""
    for formula in ("rate(rate(sqrt(z))) = rate(rate(z))/(2*sqrt(z)) - rate(z)^2/(4*z^1.5)",
                    "rate(rate(abs(x))) = sign(x)*rate(rate(x))",
                    "rate(rate(asin(x))) = rate(rate(x))/sqrt(1 - x^2) + x*rate(x)^2/(1 - x^2)^1.5"):
        assert row(f"1: {formula}").verdict == "RIGHT"
