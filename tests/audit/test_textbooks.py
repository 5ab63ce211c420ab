"""Displays as textbooks of dynamics print them: the right one is not blamed, the same with one planted error is not cleared."""

from __future__ import annotations

import pytest

import mbdae as mb
from mbdae.audit import Row
from mbdae.documents.mathml import display

RIGHT, CANNOT, INCOMPLETE, MISPRINT = "RIGHT", "CANNOT JUDGE", "INCOMPLETE", "MISPRINT"
MOVING = r"""
m [kg]: positive number
J [kg m^2]: positive number
a [m]: positive number
b [m]: positive number
x [m]: function of time
varphi [rad]: function of time
psi [rad]: function of time
v [m/s] $\vec v$: vector
vw [m/s] $\vec w$: vector
r [m] $\vec r$: vector function of time
"""


def judged(tex: str, meanings: str) -> list[Row]:
    """The rows of one display."""
    audit = mb.audit(f"\n\\begin{{equation}}{tex}\\end{{equation}}\n", meanings=MOVING + meanings + "\n")
    return [row for row in audit.equations if row.printed.place]


PRINTED = {
    "energy of a rotation in dots": (
        "Jv [kg m^2] $\\mathbf I$: symmetric matrix\nw [1/s] $\\vec\\omega$: vector\nlet T [J] = 1/2*w'*Jv*w",
        r"T = \frac12\vec\omega\cdot\mathbf I\cdot\vec\omega", r"T = \vec\omega\cdot\mathbf I\cdot\vec\omega"),
    "a double cross product": (
        "w [1/s] $\\vec\\omega$: vector", r"\vec\omega\times(\vec\omega\times\vec r) = \vec\omega(\vec\omega\cdot\vec r)"
        r" - \vec r(\vec\omega\cdot\vec\omega)", r"\vec\omega\times(\vec\omega\times\vec r) = \vec\omega\cdot\vec r\,\vec r"
        r" - \vec\omega\cdot\vec\omega\,\vec r"),
    "a dot and a vector behind it": (
        "", r"\vec v\cdot\vec w\,\vec v = \vec v(\vec v^T\vec w)", r"\vec v\cdot\vec w\,\vec w = \vec v(\vec v^T\vec w)"),
    "inner product in angle brackets": (
        r"let T [J] = 1/2*m*v'*v", r"T = \frac12 m\langle\vec v,\vec v\rangle", r"T = m\langle\vec v,\vec v\rangle"),
    "inner product in round brackets": (
        r"let T [J] = 1/2*m*v'*v", r"T = \frac12 m(\vec v,\vec v)", r"T = \frac13 m(\vec v,\vec v)"),
    "inner product of two vectors": (
        r"let P [m^2/s^2] = v'*vw", r"P = (\vec v,\vec w)", r"P = -(\vec v,\vec w)"),
    "length by an inner product": (
        "let u [m/s] = norm(v)", r"u = \sqrt{(\vec v,\vec v)} = (\vec v,\vec v)^{1/2}", r"u = (\vec v,\vec v)^{1/3}"),
    "a place as a list": (
        "let R [m] $\\mathbf R$ = [a*cos(psi); a*sin(psi); 0]", r"\mathbf R = (a\cos\psi, a\sin\psi, 0)",
        r"\mathbf R = (a\cos\psi, -a\sin\psi, 0)"),
    "a list in square brackets": (
        "let R [m] $\\mathbf R$ = [x; 2*x]", r"\mathbf R = [x, 2x]^T", r"\mathbf R = [x, 2x]"),
    "two lists": (
        "let R [m] $\\mathbf R$ = [x; 2*x]", r"\mathbf R = 2(x/2, x) = (x, 2x)", r"\mathbf R = 2(x/2, x) = (x, x)"),
    "stacked vectors": (
        "let q [m/s] $\\mathbf q$ = [v; vw]", r"\mathbf q = (\vec v, \vec w)", r"\mathbf q = (\vec w, \vec v)"),
    "virtual displacement": (
        "let xC [m] $x_C$ = a*cos(varphi) + b*cos(psi)", r"\delta x_C = -a\sin\varphi\,\delta\varphi - b\sin\psi\,\delta\psi",
        r"\delta x_C = -a\sin\varphi\,\delta\varphi + b\sin\psi\,\delta\psi"),
    "virtual displacement and rates": (
        "let T [J] = 1/2*m*rate(x)^2", r"\delta T = m\dot x\,\delta\dot x = \frac{d}{dt}(m\dot x\,\delta x) - m\ddot x\,\delta x",
        r"\delta T = m\dot x\,\delta x"),
    "virtual displacement of a vector": (
        "let R [m^2] = r'*r", r"\delta R = 2\vec r\cdot\delta\vec r", r"\delta R = \vec r\cdot\delta\vec r"),
    "virtual work with a letter of its own": (
        "F [N]: number\nlet dW [J] $\\delta W$ = F*delta(x)", r"\delta W = F\,\delta x", r"\delta W = F\,\dot x"),
    "determinant between bars": (
        "A [1] $\\mathbf A$: matrix\nlet D [1] = det(A)", r"D = |\mathbf A|", r"D = -|\mathbf A|"),
    "blank entries of a matrix": (
        "let M [?] $\\mathbf M$ = [m, 0; 0, J]", r"\mathbf M = \begin{bmatrix} m & \\ & J \end{bmatrix}",
        r"\mathbf M = \begin{bmatrix} & m \\ J & \end{bmatrix}"),
    "braces below": (
        "let F [N] = m*rate(rate(x))", r"F \overset{!}{=} \underbrace{m\ddot x}_{\text{inertia}}",
        r"F = \underbrace{m\dot x}_{f}"),
    "signs with marks": (
        "let F [N] = m*rate(rate(x))", r"F \stackrel{!}{=} m\ddot x =: F", r"F \coloneqq -m\ddot x"),
    "decimal comma": (
        "let T [J] = 1/2*m*rate(x)^2", r"T = 0{,}5\,m\dot x^2", r"T = 0{,}6\,m\dot x^2"),
    "fraction of plain TeX": (
        "let T [J] = 1/2*m*rate(x)^2", r"T = {1\over 2} m\dot x^2 = {m{\dot x}^2\over 2}", r"T = {m\dot x\over 2}"),
    "unit in brackets": (
        "let F [N] = m*rate(rate(x))", r"F\,\text{[N]} = m\ddot x", r"F\,\text{[N]} = -m\ddot x"),
    "name with its index": (
        "J_1 [kg m^2]: positive number\nomega_rel [rad/s]: number\nlet K [J] = 1/2*J_1*omega_rel^2",
        r"K = \tfrac12 J_1\omega_{\mathrm{rel}}^2", r"K = \tfrac12 J_1\omega_\text{rel}"),
    "an exponent that the display says": (
        "k [N/m^1.5]: positive number\nd [m]: positive number\nlet F [N] = k*d^(3/2)", r"F = k\,d^n, \quad n = \tfrac32",
        r"F = k\,d^n, \quad n = \tfrac12"),
    "a letter that the display says": (
        "k [N/m]: positive number\nlet f [1/s] = sqrt(k/m)/(2*pi)", r"\omega^2 = \frac km, \quad \omega = 2\pi f",
        r"\omega^2 = \frac km, \quad \omega = \pi f"),
    "a quantity with its argument": (
        "F [N]: number\nu [m]: number\nlet M [N m] = F*(a - u)", r"M(u) = F(a - u)", r"M(u) = F(a + u)"),
    "a place with its argument": (
        "F [N]: number\ns [m]: number\nE [N m^2]: positive number\nlet w [m] = F*s^2*(3*a - s)/(6*E)\nlet M [N m] = -F*(a - s)",
        r"E\,w''(s) = -M(s)", r"E\,w''(s) = M(s)"),
    "derivative of what moves by what moves": (
        "let T [J] = 1/2*m*rate(x)^2\nlet u [m/s] = rate(x)",
        r"\frac{dT}{dx} = m u\frac{du}{dx} = m\ddot x", r"\frac{dT}{dx} = m\dot x"),
    "derivative by the one thing that moves": (
        "k [N/m]: positive number\nlet V [J] = 1/2*k*x^2\nlet F [N] = -k*x", r"F = -\frac{dV}{dx}", r"F = \frac{dV}{dx}"),
    "index on the left": (
        "let rK [m] ${}_K\\mathbf r$ = [a; b]\nlet A [1] $\\mathbf A_{IK}$ = [cos(psi), -sin(psi); sin(psi), cos(psi)]\n"
        "let rI [m] ${}_I\\mathbf r$ = A*rK",
        r"{}_I\mathbf r = \mathbf A_{IK}\,{}_K\mathbf r = (a\cos\psi - b\sin\psi, a\sin\psi + b\cos\psi)",
        r"{}_I\mathbf r = \mathbf A_{IK}^T\,{}_K\mathbf r"),
    "a matrix of its diagonal": (
        "let M [?] $\\mathbf M$ = [m, 0; 0, J]", r"\mathbf M = \operatorname{diag}(m, J)", r"\mathbf M = \mathrm{diag}(J, m)"),
    "integral of a sum": (
        "let K [kg m^2] = m*a^2/3",
        r"K = \frac{m}{2a}\int_{-a}^{a} (y^2 + b y)\,dy", r"K = \frac{m}{2a}\int_{-a}^{a} (y^2 + b^2)\,dy"),
    "constant of every motion": (
        "let c [1] = sin(psi)^2 + cos(psi)^2", r"c = 1 = \text{const.}", r"c = \sin\psi = \mathrm{const}"),
}


@pytest.mark.parametrize("name", PRINTED)
def test_right_ones_are_not_blamed_and_planted_errors_not_cleared(name: str) -> None:
    meanings, right, wrong = PRINTED[name]
    assert [row.verdict for row in judged(right, meanings)] == [RIGHT]
    assert "<math" in display(right)  # beside its verdict it stands as it is printed
    assert [row.verdict for row in judged(wrong, meanings)] == [MISPRINT]


@pytest.mark.parametrize("place", ["u", "s"])
def test_a_value_at_a_place_is_not_the_quantity(place: str) -> None:
    """The deflection at the end depends on less than the deflection; it needs a line of its own."""
    (row,) = judged(r"w(a) = \frac{Fa^3}{3E}", f"F [N]: number\n{place} [m]: number\nE [N m^2]: positive number\n"
                    f"let w [m] = F*{place}^2*(3*a - {place})/(6*E)")
    assert (row.verdict, "value at a place" in row.remark) == (CANNOT, True)


def test_a_list_of_vectors_after_a_letter_may_be_its_arguments() -> None:
    """Of a constant it is no list of arguments; where it may be both, it is not judged."""
    (row,) = judged(r"a = b(\vec v, \vec w)", "")
    assert (row.verdict, "inner product" in row.remark) == (CANNOT, True)
    (row,) = judged(r"P = P(\vec v, \vec w)", "let P [m^2/s^2] = v'*vw")
    assert row.verdict == RIGHT


@pytest.mark.parametrize("also", ["", r"T = \frac{m u^2}{2}, \quad "])
def test_a_root_of_a_square_holds_on_one_side(also: str) -> None:
    """Beside its definition too the root of an even power is right where its letter is positive, which is said."""
    (row,) = judged(also + r"u = \sqrt{2T/m}", "u [m/s]: number\nlet T [J] = 1/2*m*u^2")
    assert (row.verdict, row.repair) == (INCOMPLETE, "say that it holds for u > 0")
    (row,) = judged(also + r"u = \sqrt{2T/m}", "u [m/s]: number > 0\nlet T [J] = 1/2*m*u^2")
    assert (row.verdict, row.where) == (RIGHT, "u > 0")
    (row,) = judged(also + r"u = \sqrt{3T/m}", "u [m/s]: number\nlet T [J] = 1/2*m*u^2")
    assert row.verdict == MISPRINT


def test_an_integral_over_time_of_what_is_taken_at_its_end_is_not_judged() -> None:
    given = "t [s]: number\nc [1/s]: number\nlet u [m/s] = a*exp(c*t)\nlet s [m] = a/c*(exp(c*t) - 1)"
    (row,) = judged(r"s = \int_0^t u\,d\tau", given)
    assert (row.verdict, "tau" in row.remark) == (CANNOT, True)


def test_whole_or_partial_by_what_moves_is_asked() -> None:
    (row,) = judged(r"\frac{dL}{dx} = -k x", "k [N/m]: positive number\nlet L [J] = 1/2*m*rate(x)^2 - 1/2*k*x^2")
    assert (row.verdict, "partial" in row.remark) == (CANNOT, True)


def test_what_is_constant_only_in_some_motions_is_not_judged() -> None:
    energy = "k [N/m]: positive number\nlet E [J] = 1/2*m*rate(x)^2 + 1/2*k*x^2"
    (row,) = judged(r"E = \tfrac12 m\dot x^2 + \tfrac12 k x^2 = \text{const.}", energy)
    assert (row.verdict, "how x moves" in row.remark) == (CANNOT, True)
    (row,) = judged(r"m = \text{const.}", "")
    assert (row.verdict, "does not change" in row.remark) == (CANNOT, True)


def test_a_letter_whose_name_is_in_the_table_is_told() -> None:
    (row,) = judged(r"F_t = m\ddot x", "let Ft [N] = m*rate(rate(x))")
    assert (row.verdict, "Ft [unit] $F_{t}$" in row.remark) == (CANNOT, True)


@pytest.mark.parametrize(("tex", "meanings", "repair"), [
    (r"2\dot\varphi\dot\psi\cos\varphi-\psi = c", "let c [rad^2/s^2] = 2*rate(varphi)*rate(psi)*cos(varphi - psi)",
     "-psi inside of the bracket of cos(varphi)"),
    (r"c = \cos(\varphi - \psi)", "let c [1] = cos(varphi) - psi", "-psi outside of the bracket of cos(varphi - psi)"),
    (r"\tan\varphi/2 = \frac{\sin\varphi}{1+\cos\varphi}", "", "1/2 inside of the bracket of tan(varphi)"),
    (r"c = \sin(\varphi\psi)", "let c [1] = sin(varphi)*psi", "psi outside of the bracket of sin(varphi*psi)"),
    (r"\frac m2\pi a^2 = p", "let p [kg/m^2] = m/(2*pi*a^2)", "pi*a^2 in the denominator"),
    (r"p = \frac{m}{2\pi a^2}", "let p [kg m^2] = m/2*pi*a^2", "pi*a^2 not in the denominator"),
])
def test_a_bracket_that_holds_too_little_or_too_much_is_found(tex: str, meanings: str, repair: str) -> None:
    (row,) = judged(tex, meanings)
    assert (row.verdict, row.repair) == (MISPRINT, repair)


@pytest.mark.parametrize("tex", [r"p = m/2\pi a^2", r"m/2\pi a^2 = p"])
def test_a_slash_before_a_product_is_asked_about(tex: str) -> None:
    """Many print m/2 pi for m/(2 pi): with one of the two readings right, neither is called a misprint or right."""
    (row,) = judged(tex, "let p [kg/m^2] = m/(2*pi*a^2)")
    assert (row.verdict, "brackets" in row.repair) == ("AMBIGUOUS", True)
    (row,) = judged(tex.replace("2", "3", 1), "let p [kg/m^2] = m/(2*pi*a^2)")
    assert row.verdict == MISPRINT


def test_equations_keep_their_tags() -> None:
    text = "\n" + "".join(f"\\begin{{equation}}m = m\\tag{{{tag}}}\\end{{equation}}\n" for tag in ("*", "**", "A.1"))
    audit = mb.audit(text, meanings="m [kg]: positive number\nequation * [kg]: m - m\n")
    assert [row.equation for row in audit.equations] == ["*", "**", "A.1"]
    assert audit["*"].printed.place == "the text:2"
