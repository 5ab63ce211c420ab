"""Parameters that a text leaves out, that a law refuses at zero, and sides of forces that a text does not declare."""

from __future__ import annotations

import pytest

import mbdae as mb
from mbdae.audit.remarks import refuses_zero

SPRING = """
k [N/m]: parameter stiffness of PointSpring
L [m]: parameter length of PointSpring
rk [m]: position of k
rl [m]: position of l
F [N]: force of PointSpring on move k, move l
let d [m] = rl - rk
let n [1] = d/norm(d)
"""
ROW = """
a3 [1]: axis 3 of k
b1 [1]: axis 1 of l
mu [N m]: multiplier of row tilt_y of Revolute
T [N m]: force of row tilt_y of Revolute on turn k, turn l
"""
COULOMB = """
N [N]: normal force
v [m/s]: sliding speed
mu [1]: parameter mu of Coulomb
vc [m/s]: parameter v_c of Coulomb
F [N]: friction force of Coulomb
"""
LUGRE = """
v [m/s]: sliding speed
z [m]: deflection
s0 [1/m]: parameter sigma0 of LuGre
mk [1]: parameter mu_k of LuGre
ms [1]: parameter mu_s of LuGre
vs [m/s]: parameter v_s of LuGre
zd [m/s]: rate of deflection of LuGre
zs [m]: steady deflection of LuGre
"""
HERTZ = """
d [m]: penetration
v [m/s]: rate of penetration
k [N/m^1.5]: parameter stiffness of Hertz
c [1]: damping factor of Hertz
F [N]: normal force of Hertz
"""


def row(text: str, formula: str) -> tuple[str, str]:
    found = mb.audit(f"{text}1: {formula}\n")["1"]
    return found.verdict, found.said


@pytest.mark.parametrize(("text", "formula", "named"), [
    (SPRING, "F = [-k*(norm(d)-L)*n; k*(norm(d)-L)*n]", "parameter damping of PointSpring is 0"),
    (SPRING, "F = [k*(norm(d)-L)*n; -k*(norm(d)-L)*n]", "right with the opposite sign"),
    (ROW, "T = [~a3*b1*mu; -~a3*b1*mu]", "parameter scaling of Revolute is 1"),
    (HERTZ, "F = k*d^1.5", "parameter damping of Hertz is 0"),
])
def test_a_term_of_a_parameter_that_is_not_declared_is_missing(text: str, formula: str, named: str) -> None:
    verdict, said = row(text, formula)
    assert verdict == "INCOMPLETE"
    assert named in said


@pytest.mark.parametrize(("text", "formula"), [
    (SPRING, "F = [-k*(norm(d)+L)*n; k*(norm(d)-L)*n]"),
    (SPRING + "c [N s/m]: parameter damping of PointSpring\n", "F = [-k*(norm(d)-L)*n; k*(norm(d)-L)*n]"),
    (ROW, "T = [~a3*b1*mu; ~a3*b1*mu]"),
    (HERTZ, "F = k*d^1.5*(1 + 2*c)"),  # right where the damping is 0 only because c is
])
def test_what_no_parameter_explains_is_a_misprint(text: str, formula: str) -> None:
    assert row(text, formula)[0] == "MISPRINT"


def test_what_a_law_refuses_at_zero_is_not_tried_at_zero() -> None:
    assert refuses_zero("v_c", "Coulomb")
    assert not refuses_zero("mu", "Coulomb")
    assert row(COULOMB, "F = -mu*N*tanh(v/vc)")[0] == "RIGHT"
    assert row(SPRING, "k = k^2/k")[0] == ("RIGHT" if refuses_zero("stiffness", "PointSpring") else "INCOMPLETE")


def test_side_of_a_friction_force_that_is_not_declared() -> None:
    verdict, said = row(COULOMB, "F = mu*N*tanh(v/vc)")
    assert (verdict, "forces: left" in said) == ("AMBIGUOUS", True)
    assert row(COULOMB + "forces: left\n", "F = mu*N*tanh(v/vc)")[0] == "RIGHT"
    assert row(COULOMB + "forces: applied\n", "F = mu*N*tanh(v/vc)")[0] == "MISPRINT"


def test_an_option_that_is_not_declared_has_its_default() -> None:
    by = "zd = v - s0*abs(v)*z/(mk + (ms - mk)*exp(-{}))"
    assert row(LUGRE, by.format("(v/vs)^2"))[0] == "RIGHT"
    assert row(LUGRE, by.format("abs(v/vs)"))[0] == "MISPRINT"
    for words in ("friction parameter gamma", "parameter gamma of LuGre"):
        assert row(f"g [1]: {words}\n{LUGRE}", by.format("abs(v/vs)^g"))[0] == "RIGHT"
        assert row(f"g [1]: {words}\n{LUGRE}", by.format("(v/vs)^2"))[0] == "MISPRINT"


def test_a_law_of_a_contact_is_no_law_between_bodies() -> None:
    verdict, said = row(COULOMB + "P [W]: dissipated power of Coulomb\n", "P = N*v")
    assert verdict == "CANNOT JUDGE"
    assert "Coulomb is a friction law" in said


def test_a_row_is_shown_in_a_line() -> None:
    shown = repr(mb.audit(COULOMB + "1: F = -mu*N*tanh(v/vc)\n")["1"])
    assert shown.startswith("Row('1', 'F = -mu*N*tanh(v/vc)', 'RIGHT'")
    assert len(shown) < 120
