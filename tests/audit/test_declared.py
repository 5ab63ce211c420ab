"""What a text declares is what judges it: parameters of laws, and a force on one body beside the one it does not list."""

from __future__ import annotations

import pytest
import symengine as se

import mbdae as mb
from mbdae.audit import laws
from mbdae.audit.motion import RandomMotion
from mbdae.audit.phrases import Env
from mbdae.audit.reading import read
from mbdae.audit.rules_laws import law
from mbdae.laws import forces, joints

SPRING = """
b3 [1]: axis 3 of k
c [N m/rad]: parameter stiffness of JointSpring
V [J]: energy of JointSpring
F [N m]: force of JointSpring on turn k, turn l
let W [J] = 2*V
"""
REST = "t0 [rad]: parameter rest of JointSpring\n"
ANGLES = ["th [rad]: relative angle\n", "states: revolute\nth [rad]: relative angle\n",
          "states: revolute\nth [rad]: coordinate angle of the joint\n"]
POINTS = """
forces: applied
rk [m]: position of k
rl [m]: position of l
c [N/m]: parameter stiffness of PointSpring
d [N s/m]: parameter damping of PointSpring
l0 [m]: parameter length of PointSpring
F [N]: force of PointSpring on move l
let L [m] = norm(rl - rk)
let f [N] = (c*(L - l0) + d*rate(L))*(rl - rk)/L
"""


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("formula", [
    "V = 1/2*c*(th - t0)^2", "W = c*(th - t0)^2", "F = [-c*(th - t0)*b3; c*(th - t0)*b3]"])
def test_a_declared_parameter_is_that_of_the_judge(angle: str, formula: str) -> None:
    """Also where a `let` reads the energy before the text declares the parameter."""
    head = "forces: left\n" + angle + SPRING
    bare = formula.replace("(th - t0)", "th")
    right = "RIGHT" if "states" in angle or "F" not in formula else "INCOMPLETE"  # the torque holds on the joint alone
    assert mb.audit(f"{head}{REST}1: {formula}\n")["1"].verdict == right
    assert mb.audit(f"{head}{REST}1: {bare}\n")["1"].verdict == "MISPRINT"
    assert mb.audit(f"{head}1: {bare}\n")["1"].verdict == right


@pytest.mark.parametrize("name", sorted({*joints.__all__, *forces.__all__, "JournalContact"}))
def test_every_declared_parameter_of_every_law(name: str) -> None:
    """The judge's law has the random value of the letter."""
    cls = laws.law_class(name)
    if cls is None or cls.frames != ("k", "l") or not cls.params:
        return
    units = [spec.unit.split(" or ")[0] or "1" for spec in cls.params.values()]
    text = "".join(f"p{i} [{u}]: parameter {p} of {name}\n" for i, (p, u) in enumerate(zip(cls.params, units, strict=True)))
    env = Env(RandomMotion(0), read(text + "1: p0 = p0\n").equations[-1].scope)
    state = law(env, name)
    for i, p in enumerate(cls.params):
        assert state.values[se.Symbol(p)] == env.value(f"p{i}")


def test_a_parameter_of_a_friction_law_has_one_value() -> None:
    text = "a [1]: parameter mu_s of LuGre\nb [1]: friction parameter mu_s\n1: a = b\n"
    assert mb.audit(text)["1"].verdict == "RIGHT"


@pytest.mark.parametrize(("formula", "verdict"), [
    ("F = -f", "INCOMPLETE"), ("F = f", "MISPRINT"), ("F = -(c*(L - l0) - d*rate(L))*(rl - rk)/L", "MISPRINT"),
    ("F = -c*(L - l0)*(rl - rk)", "MISPRINT"), ("F = [f; f]", "MISPRINT"), ("F = 3*[f; -f]", "MISPRINT")])
def test_a_force_on_one_body_is_compared_as_printed(formula: str, verdict: str) -> None:
    row = mb.audit(f"{POINTS}1: {formula}\n")["1"]
    assert row.verdict == verdict
    assert "there is a force on move k too, which the text does not list" in row.remark
    assert (0 < row.residual < 1e-12) if verdict == "INCOMPLETE" else row.residual > 0.1


@pytest.mark.parametrize(("joint", "name"), [("prismatic", "displacement"), ("cylindrical", "displacement"),
                                             ("revolute", "angle")])
def test_the_coordinates_of_the_joint_of_a_section_have_values(joint: str, name: str) -> None:
    """Between free bodies too, where a formula is compared first."""
    text = f"states: {joint}\nq [1]: coordinate {name} of the joint\n1: q + q = 2*q\n2: q + q = 3*q\n"
    found = mb.audit(text)
    assert [found[number].verdict for number in "12"] == ["RIGHT", "MISPRINT"]
