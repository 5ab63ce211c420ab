"""The audit beyond one paper: what it knows and says that it does not know, its language, the laws that judge."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sympy as sp

import mbdae as mb
from mbdae.audit import carried
from mbdae.audit.motion import VECTORS, RandomMotion
from mbdae.laws.journal import JournalContact
from mbdae.symbolic import tree

BODIES = """
b1k [1]: axis 1 of k
b2k [1]: axis 2 of k
b3k [1]: axis 3 of k
b1l [1]: axis 1 of l
wk [rad/s]: angular velocity of k
wl [rad/s]: angular velocity of l
alphak [rad/s^2]: angular acceleration of k
alphal [rad/s^2]: angular acceleration of l
Ak [1]: attitude of k
rk [m]: position of k
vk [m/s]: velocity of k
ak [m/s^2]: acceleration of k
s [m]: vector fixed in k
u [m]: position of l relative to k
phi [rad]: relative angle
n [1]: number
"""


def verdict(text: str, **given: Any) -> tuple[str, str]:
    """Verdict and remark of the last equation of a text."""
    row = mb.audit(BODIES + text + "\n", **given).equations[-1]
    return row.verdict, row.remark


# -- motion


@pytest.mark.parametrize("kind", ["free", "clearance", "revolute", "prismatic", "cylindrical", "universal", "screw", "planar"])
def test_states_are_those_of_a_motion(kind: str) -> None:
    """Velocities and accelerations are the time derivatives of positions and attitudes, of l on every joint too."""
    m = RandomMotion(3, kind)
    later, h = m.moved("time"), 1e-30
    for side in "kl":
        for name, rate in (("x", "v"), ("v", "a"), ("w", "alpha")):
            np.testing.assert_allclose(np.imag(later.of(name, side)) / h, np.real(m.of(rate, side)), atol=1e-12)
        Q = np.real(m.rotation(side))
        spin = np.imag(later.rotation(side)) / h @ Q.T
        np.testing.assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], np.real(m.of("w", side))[:, 0], atol=1e-12)
        P = m.euler_parameters(side)
        assert abs(np.sum(P * P) - 1) < 1e-12
    assert set(m.vectors) == set(VECTORS)


# -- what it says it does not know


@pytest.mark.parametrize(("formula", "expected", "told"), [
    ("1: abs(b1k'*b1l) <= 1", "CANNOT JUDGE", "too few reach it"),
    ("d [m]: number\n1: u = d*b1k", "CANNOT JUDGE", "the text gives d as a number"),
    ("1: u = n*b1k", "MISPRINT", "u has the unit m, n*b1k the unit 1"),
    ("n2 [1]: number\n1: n = n2", "CANNOT JUDGE", "nothing but this formula says what n is"),
    ("1: phi = log(0*n)", "CANNOT JUDGE", "a side is real for 0*n > 0 alone"),
    ("1: ~u*~wk*wl + ~wk*~wl*u + ~wl*~u*wk = 0", "RIGHT", ""),
    ("1: ~u*~wk*wl + ~wk*~wl*u - ~wl*~u*wk = 0", "MISPRINT", ""),
    ("1: b1k'*b2k = 0", "RIGHT", ""),
    ("1: rate(phi) = b3k'*(wl - wk)", "INCOMPLETE", "holds where a revolute joint connects the bodies"),
    ("let d [N] = u'*u\n1: d = u'*u", "CANNOT JUDGE", "d is defined with the unit m^2 and declared with N"),
    ("d [1]: energy of Beam\n1: d = n", "CANNOT JUDGE", "law on a line"),
])
def test_limits(formula: str, expected: str, told: str) -> None:
    found, remark = verdict(formula)
    assert (found, told in remark) == (expected, True), (found, remark)


def test_a_side_that_is_not_declared_is_no_misprint() -> None:
    text = """
c [1]: row tilt_y of Revolute
m [N m]: multiplier of row tilt_y of Revolute
a [1]: parameter scaling of Revolute
p [N m]: parameter penalty of Revolute
{}
F [N m]: force of row tilt_y of Revolute on turn k, turn l
1: F = -(a*m + 2*p*c)*[~b3k*b1l; -~b3k*b1l]
"""
    assert verdict(text.format(""))[0] == "AMBIGUOUS"
    assert verdict(text.format("forces: applied"))[0] == "RIGHT"
    assert verdict(text.format("forces: left"))[0] == "MISPRINT"


def test_what_vanishes_in_the_joint_proves_nothing_there() -> None:
    text = "states: revolute\nc [1]: row tilt_y of Revolute\nd [1]: axis 3 of l\n1: b3k = d + c*d\n"
    assert verdict(text)[0] == "MISPRINT"


# -- the language


@pytest.mark.parametrize("formula", [
    "let P [m] = rk + s\n1: rate(rate(P)) = ak + ~alphak*s + ~wk*~wk*s",
    "let P [m] = rk + s\n1: rate(P) = vk + ~wk*s",
    "1: rate(rate(b1k)) = (~alphak + ~wk*~wk)*b1k",
    "1: Ak^-1 = Ak'",
    "1: trace(Ak) = b1k'*[1; 0; 0] + b2k'*[0; 1; 0] + b3k'*[0; 0; 1]",
    "1: det(Ak) = 1",
    "1: sum(n^i, i, 0, 3) = 1 + n + n^2 + n^3",
    "1: sum(b1k'*b1l*i, i, 1, 4) = 10*b1k'*b1l",
    "1: integral(x^2, x, 0, n) = n^3/3",
    "1: integral(sqrt(1 - x^2), x, -1, 1) = pi/2",
    "1: log(exp(n)) = n",
    "1: n = sign(n)*abs(n)",
    "q [rad]: function of time\n1: rate(sin(q)) = cos(q)*rate(q)",
    "q [m]: function of time\nm [kg]: positive number\nlet T [J] = 1/2*m*rate(q)^2\n1: rate(T) = m*rate(q)*rate(rate(q))",
    "1: diff(u'*u, u) = 2*u'",
    "1: sinh(n) = (exp(n) - exp(-n))/2",
])
def test_formulas_of_the_language(formula: str) -> None:
    assert verdict(formula) == ("RIGHT", "")


def test_quantities_of_the_caller() -> None:
    x, t = sp.Symbol("x"), sp.Symbol("t")
    given = {"energy of my spring": sp.Rational(1, 2) * 3 * x**2, "my motion": sp.sin(2 * t + 1)}
    text = "x [m]: number\nV [m^2]: energy of my spring\nq [rad]: my motion\n"
    assert verdict(text + "1: diff(V, x) = 3*x", quantities=given)[0] == "RIGHT"
    assert verdict(text + "1: diff(V, x) = 2*x", quantities=given)[0] == "MISPRINT"
    assert verdict(text + "1: rate(rate(q)) = -4*q", quantities={**given})[0] in ("RIGHT", "MISPRINT")  # 4 has no unit here
    with pytest.raises(mb.OptionError, match="quantities\\['energy'\\] = 'x' is not an expression"):
        mb.audit("1: a = b\n", quantities={"energy": "x"})


def test_repairs_in_the_letters_of_the_text() -> None:
    text = r"""
w [rad/s] $\boldsymbol\omega_i$: angular velocity of k
e [1] $\mathbf{e}_i$: axis 1 of k
1: rate(e) = -~w*e
"""
    found = mb.audit(text)
    assert r"\boldsymbol\omega_i" in found["1"].tex
    assert r"\tilde{\boldsymbol\omega_i}" in found.document().to_markdown()


@pytest.mark.parametrize(("planted", "repaired"), [
    ("let l [m] = norm(u)\n1: rate(l^2) = u'*rate(u)", "2"),
    ("q [rad]: function of time\n1: rate(q^3) = 3*q*rate(q)", "q"),
    ("1: rate(rate(b1k)) = ~alphak*b1k", "~wk*~wk"),
    ("q [rad]: angle\n1: cos(2*q) = 1 - 2*sin(q)", "sin(q)^2"),
    ("q [rad]: angle\n1: abs(q) = q", "sign(q)"),
])
def test_what_was_left_out_is_found(planted: str, repaired: str) -> None:
    row = mb.audit(BODIES + planted + "\n").equations[-1]
    assert row.verdict == "MISPRINT"
    assert row.repaired is not None
    assert repaired in row.repaired.text


# -- the laws that run are the judges


FRICTION = """
fn [N]: normal force
muk [1]: friction parameter mu_k
ft [N]: friction force of sliding
forces: applied
1: ft = -muk*fn
"""


def _forget() -> None:
    for cache in (carried._program, tree.tree_program):
        cache.cache_clear()


@pytest.fixture
def anew():
    """Nothing derived before or after."""
    _forget()
    yield
    _forget()


def test_friction_is_judged_by_the_contact_law(monkeypatch) -> None:
    assert verdict(FRICTION)[0] == "RIGHT"
    braking = JournalContact._friction
    monkeypatch.setattr(JournalContact, "_friction", lambda self, *args: braking(self, *args) * -1)
    assert verdict(FRICTION)[0] == "MISPRINT"


@pytest.mark.parametrize("formula", [
    "1: wl = wk + b3k*rate(phi)", "1: alphal = alphak + b3k*rate(rate(phi)) + ~wk*b3k*rate(phi)"])
def test_recursion_is_judged_by_the_tree(formula: str, anew, monkeypatch) -> None:
    text = "states: revolute only\n" + formula
    assert verdict(text)[0] == "RIGHT"
    _forget()
    way = tree.way

    def wrong(program, node, *args):
        found = way(program, node, *args)
        found.w, found.al = node.w - (found.w - node.w), node.al - (found.al - node.al)
        return found

    monkeypatch.setattr(tree, "way", wrong)
    assert verdict(text)[0] == "MISPRINT"


def test_a_friction_law_of_ones_own() -> None:
    class Viscous(mb.Friction):
        params = mb.params(c=("s/m", "friction over speed"))

        def coefficient(self, v):
            return self.c * v

    text = "v [m/s]: sliding speed\nc [s/m]: friction parameter c\nmu [1]: coefficient of Viscous\n1: mu = c*v"
    assert verdict(text, laws={"Viscous": Viscous})[0] == "RIGHT"
    assert verdict(text.replace("mu = c*v", "mu = -c*v"), laws={"Viscous": Viscous})[0] == "MISPRINT"


def test_restitution_is_that_of_the_law() -> None:
    text = """
e [1]: coefficient of restitution of Hertz
v [m/s]: impact speed
c [s/m]: parameter damping of Hertz
let d [1] = c*v
1: (1 - d*e)*exp(d*e) = (1 + d)*exp(-d)
"""
    assert verdict(text)[0] == "RIGHT"
    assert verdict(text.replace("exp(-d)", "exp(d)"))[0] == "MISPRINT"


def test_remarks_beside_the_verdict() -> None:
    states = "states: revolute\nb2l [1]: axis 2 of l\nc [1]: row tilt_y of Revolute\n"
    assert "half a turn about its axis 2" in verdict(states + "1: c = b3k'*b1l = 0")[1]
    force = "states: revolute\nK [N m/rad]: parameter stiffness of JointSpring\nb3l [1]: axis 3 of l\n"
    force += "F [N m]: force of JointSpring on turn k, turn l\n"
    assert "leave a resultant" in verdict(force + "1: F = K*phi*[-b3k; b3l]")[1]
    assert "leave a resultant" not in verdict(force + "1: F = K*phi*[-b3k; b3k]")[1]
    mended = mb.audit(BODIES + "let P [m] = rk + s\n1: P = rk + s'\n")["1"]
    assert "accents alone" in mended.remark
