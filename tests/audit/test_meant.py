"""Repairs are what can have been meant, reasons say in words what has no value, and what is written twice or wrongly is told."""

from __future__ import annotations

import re

import pytest
import sympy as sp

import mbdae as mb
from mbdae.audit import carried

SYMBOLS = """
b3k [1]: axis 3 of k
wk [rad/s]: angular velocity of k
u [m]: position of l relative to k
Ak [1]: attitude of k
q [rad]: function of time
n [1]: number
g [m/s^2]: positive number
m [kg]: positive number
L [m]: positive number
"""


def row(text: str, **given):
    """The last row of a text."""
    return mb.audit(SYMBOLS + text + "\n", **given).equations[-1]


# -- repairs


@pytest.mark.parametrize("formula", [
    "m*g = 0", "rate(g*q) = g", "rate(q*g*L) = 0", "m*rate(rate(q)) = 0", "rate(b3k) = ~wk*b3k*(1 + n)",
    "rate(b3k) = g*~wk*b3k", "rate(m*b3k*L) = ~wk*b3k*m + rate(m)*b3k", "g*rate(q) = rate(g*q) + g*q"])
def test_no_repair_has_a_derivative_of_a_constant(formula: str) -> None:
    found = row(f"1: {formula}")
    repaired = found.repaired.text if found.repaired else ""
    assert found.verdict == "MISPRINT"
    assert repaired.count("rate(") <= formula.count("rate(")
    assert "rate(n)" not in repaired
    assert "sign(" not in repaired
    assert "- m)" not in repaired


@pytest.mark.parametrize(("formula", "repair"), [
    ("rate(b3k) = g*~wk*b3k", "without the factor g"),
    ("rate(b3k) = ~wk*b3k*(1 + n)", "without the factor 1 + n"),
    ("rate(b3k) = ~wk*b3k/(1 + n^2 + g^2*L)", "without the factor 1/(1 + n^2 + g^2*L)"),
    ("g*rate(q) = rate(g*q) + g*q", "without the term g*q"),
    ("rate(b3k) = ~u*b3k", "u -> wk"),  # another unit
])
def test_the_repair_is_what_was_printed_in_excess(formula: str, repair: str) -> None:
    assert row(f"1: {formula}").repair == repair


# -- reasons


@pytest.mark.parametrize(("formula", "told"), [
    ("n = 1/(n - n)", "1/(n - n) is infinite or undefined in a random state of motion"),
    ("Ak = (0*Ak)^-1", "(0*Ak)^-1 has no value: its matrix has no inverse"),
    ("n = sum(n, i, 0, 1/0)", "the limits of a sum must be whole numbers, not 0 and nan"),
    ("n = sum(i, i, 0, n)", "sum(i, i, 0, n) has no value: the limits of a sum must be whole numbers, not 0 and "),
    ("u = u + n", "u + n has no value: sizes do not fit: 3 x 1 + a number"),
    ("u = ~n*u", "~n has no value: the matrix of a cross product is that of a 3 x 1 column, not of a number"),
    ("n = norm(n)", "norm(n) has no value: norm takes a column (n x 1), not a number; of a number write abs"),
    ("n = n*atan2(n - n, n - n)", "atan2(n - n, n - n) has no value: a quantity it divides by is 0"),
])
def test_reasons_name_the_piece_that_has_no_value(formula: str, told: str) -> None:
    found = row(f"1: {formula}")
    assert found.verdict == "CANNOT JUDGE"
    assert told in found.remark


def test_an_expression_that_cannot_be_evaluated_is_told() -> None:
    own = sp.Function("mine")(sp.Symbol("n"))
    found = row("V [J]: my energy\n1: V = g*m*L", quantities={"my energy": own})
    assert found.verdict == "CANNOT JUDGE"
    assert "quantities: the expression mine(n) for 'my energy' cannot be evaluated" in found.remark


# -- numbers and names


def test_a_number_that_two_equations_have_is_refused() -> None:
    rows = mb.audit(SYMBOLS + "1: rate(b3k) = ~wk*b3k\n1: rate(b3k) = 2*~wk*b3k\n").equations
    assert [r.verdict for r in rows] == ["RIGHT", "CANNOT JUDGE"]
    assert "line 12: the equation in line 11 is 1 too" in rows[1].remark
    claims = mb.audit("claims:\na: 3 = rows\na: 4 = columns\n")
    assert "line 3: a claim above has the name a too" in claims.equations[0].remark


@pytest.mark.parametrize("letter", ["$ $", "$$", r"$\mathbf{}$", r"$\nosuch$", "${$"])
def test_letters_that_print_nothing_are_refused(letter: str) -> None:
    rows = mb.audit(f"x [m] {letter}: position of k\n1: x = x\n").equations
    assert "prints nothing or is no TeX: give the TeX of the letter that the text prints for x" in rows[0].remark


@pytest.mark.parametrize("name", ["ω", "größe", "_", "__", "a_", "é1", "変", "x_y", "b3κ"])
def test_names_survive_in_formulas(name: str, tmp_path) -> None:
    found = mb.audit(f"{name} [m]: position of k\nv [m/s]: velocity of k\n1: rate({name}) = v\n")
    assert found["1"].verdict == "RIGHT"
    printed = r"x_{y}" if name == "x_y" else rf"\mathrm{{{name}}}".replace("_", r"\_")
    assert carried.name(name) == printed
    page = found.save(tmp_path / "page.html").read_text(encoding="utf-8")
    shown = [re.sub(r"<[^>]*>|\s", "", formula) for formula in re.findall(r"<math.*?</math>", page, re.S)]
    assert f"ddt{name}".replace("x_y", "xy") in shown


@pytest.mark.parametrize("name", ["ph", "mass", "eps", "rho0in"])
def test_names_of_several_letters_are_no_index(name: str) -> None:
    """They read as they are written, or as the text declares."""
    assert carried.name(name) == rf"\mathrm{{{name}}}"
    assert carried.name(name, {name: "p_h"}) == "p_h"
    found = [carried.name(n) for n in ("b3k", "phik", "alphal", "rkdot", "mu", "dphi", "v12")]
    assert found == ["b_{3}^{k}", r"\varphi^{k}", r"\alpha^{l}", r"\dot{r}^{k}", r"\mu", r"d\varphi", "v_{12}"]


# -- laws of one's own


class Bent(mb.Force):
    """An energy whose terms have two units, or one that is none of an energy."""

    params = mb.params(stiffness="N/m", length="m")
    power = 1

    def energy(self, k, l):
        d = l.r - k.r
        return self.stiffness * (d @ d + self.length**self.power) / 2


class Straight(Bent):
    """The same with the right unit."""

    power = 2


class Slanted(mb.Joint):
    """A row that adds a length to a cosine."""

    def constraints(self, k, l):
        return {"slant": (l.r - k.r) @ k.x + k.x @ l.y}


class Sticky(mb.Friction):
    """A coefficient with the unit of a speed."""

    params = mb.params(c=("1", "friction over speed"))

    def coefficient(self, v):
        return self.c * v


class Stiff(mb.Normal):
    """A force that is an energy."""

    params = mb.params(k="N/m")

    def elastic_force(self, x):
        return self.k * x**2


OWN = {cls.__name__: cls for cls in (Bent, Straight, Slanted, Sticky, Stiff)}


@pytest.mark.parametrize(("name", "text", "told"), [
    ("Straight", "V [J]: energy of Straight\n1: V = 1/2*c*(u'*u + d^2)", ""),
    ("Bent", "V [J]: energy of Bent\n1: V = 1/2*c*(u'*u + d)", "the energy adds terms in m and in m^2"),
    ("Slanted", "c [m]: row slant of Slanted\n1: c = u'*u", "the row slant adds terms in 1 and in m"),
    ("Sticky", "f [1]: coefficient of Sticky\n1: f = n", "its coefficient has the unit m s^-1, not 1"),
    ("Stiff", "f [N]: elastic force of Stiff\n1: f = n", "its elastic_force has the unit m^2 kg s^-2, not N"),
])
def test_units_of_laws_of_ones_own(name: str, text: str, told: str) -> None:
    own = f"c [N/m]: parameter stiffness of {name}\nd [m]: parameter length of {name}\n" if issubclass(OWN[name], Bent) else ""
    found = row(own + text, laws=OWN)
    wanted = ("CANNOT JUDGE", f"the law {name} that judges this has wrong units: {told}") if told else ("RIGHT", "")
    assert (found.verdict, found.remark) == wanted
