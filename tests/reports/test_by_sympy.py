"""Equations drawn from reports for a lecture, checked by SymPy alone: a reader of its own, exact rotations, derivatives of rows
that are written down here."""

from __future__ import annotations

import random
import re
import sys
from pathlib import Path

import pytest
import sympy as sp

import mbdae as mb
from mbdae.documents.blocks import Equation, every

sys.path.insert(0, str(Path(__file__).parent))

from by_sympy import judged, symbols_of

DRAWN = 4  #: of every joint
TURN = sp.Rational(3, 7)  #: tangent of half an angle, so that its cosine and sine are rational
WAY = sp.Rational(5, 4)  #: displacement
COS, SIN = (1 - TURN**2) / (1 + TURN**2), 2 * TURN / (1 + TURN**2)


def about(axis, cos=COS, sin=SIN):
    """Rotation matrix about an axis 0, 1 or 2."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = sp.eye(3)
    R[i, i] = R[j, j] = cos
    R[j, i], R[i, j] = sin, -sin
    return R


ATTITUDE = about(2, sp.Rational(3, 5), sp.Rational(4, 5)) * about(0, sp.Rational(5, 13), sp.Rational(12, 13)) * about(1)
#: axes of l in those of k, way of the point of l along z of k, coordinates
POSES = {
    "Revolute": (about(2), 0), "Prismatic": (sp.eye(3), WAY), "Cylindrical": (about(2), WAY), "Weld": (sp.eye(3), 0),
    "Universal": (about(0) * about(1), 0),
}


def rows(K, L, d):
    """Rows of textbooks by their names; d: from the point of k to that of l."""
    (xk, yk, zk), (xl, yl, _) = ([M.col(i) for i in range(3)] for M in (K, L))
    return {"tilt y": zk.dot(xl), "tilt x": zk.dot(yl), "twist": xk.dot(yl), "pins": xk.dot(yl), "offset x": xk.dot(d),
            "offset y": yk.dot(d)}


class Vector(sp.Matrix):
    """Products of the print: @ is the vector product, % the inner one."""

    def __matmul__(self, other):
        return Vector(self.cross(other))

    def __mod__(self, other):
        return self.dot(other)


def value(latex, names):
    """The value of a printed formula with exact numbers for its symbols."""
    text = re.sub(r"\\boldsymbol\{\\lambda\}_\{\\text\{xyz\}\}", "names['xyz']", latex)
    text = re.sub(r"\\lambda_\{\\text\{([^}]*)\}\}", r"names['lambda \1']", text)
    text = re.sub(r"\\(cos|sin) \\varphi(?:_\{[kl]\})?", r"names['\1']", text)
    text = re.sub(r"\\mathbf\{([a-z])\}_([kl])", r"names['\1_\2']", text)
    text = re.sub(r"\\mathbf\{0\}", "names['0']", text)
    text = text.replace(r"\left", "").replace(r"\right", "").replace(r"\,", "*").replace(r"\times", "@").replace(r"\cdot", "%")
    assert "\\" not in text, text
    return eval(re.sub(r"(?<![\w)\]])s\*", "names['s']*", text.strip()), {"names": names})


def wanted(name):
    """Exact values of what a lecture says of a joint at one pose: given symbols, forces and moments by differentiation."""
    turn, way = POSES[name]
    K, L = ATTITUDE, ATTITUDE * turn
    d = K.col(2) * way
    names = {f"{a}_{side}": Vector(M.col(i)) for side, M in (("k", K), ("l", L)) for i, a in enumerate("xyz")}
    names |= {"r_k": Vector([1, 2, 3]), "r_l": Vector(sp.Matrix([1, 2, 3]) + d), "0": Vector([0, 0, 0])}
    names |= {"cos": COS, "sin": SIN, "s": way}
    forces = {f"lambda {row}": sp.Rational(i + 2, 3) for i, row in enumerate(rows(K, L, d))}
    names |= forces | {"xyz": Vector([2, -3, 5])}
    e, out = sp.Symbol("e"), {}
    for side in "kl":
        for letter in "fm":
            found = []
            for i in range(3):
                S = sp.eye(3) + e * sp.Matrix(3, 3, lambda a, b, i=i: sp.LeviCivita(a, i, b)) if letter == "m" else sp.eye(3)
                moved = d + (0 if letter == "m" else e * (1 if side == "l" else -1)) * sp.eye(3).col(i)
                c = rows(S * K if side == "k" else K, S * L if side == "l" else L, moved)
                found.append({row: sp.diff(f, e).subs(e, 0) for row, f in c.items()})
            out[letter, side] = found
    return names, out


def checked(name):
    """Printed equations of a joint that SymPy can judge: (LaTeX, value of its right-hand side, what it must be)."""
    found, (names, derivatives) = [], wanted(name)
    equations = list(every(Equation, mb.report(getattr(mb, name), level="lecture").blocks))
    stated = " ".join(e.latex for e in equations if e.latex.startswith(("c_", r"\mathbf{c}")))
    used = [row for row in ("tilt y", "tilt x", "twist", "pins", "offset x", "offset y") if rf"\text{{{row}}}" in stated]
    for equation in equations:
        left, _, right = equation.latex.partition(" = ")
        force = re.fullmatch(r"\\mathbf\{([fm])\}_([kl])", left)
        axis = re.fullmatch(r"\\mathbf\{([xyz])\}_l", left)
        if force:
            parts = derivatives[force[1], force[2]]
            must = Vector([sum(parts[i][row] * names[f"lambda {row}"] for row in used) for i in range(3)])
            if r"\text{xyz}" in stated and force[1] == "f":
                must = Vector(must + names["xyz"] * (1 if force[2] == "l" else -1))
            found.append((equation.latex, value(right, names), must))
        elif axis:
            found.append((equation.latex, value(right, names), names[f"{axis[1]}_l"]))
        elif left == r"\mathbf{r}_l - \mathbf{r}_k":
            found.append((equation.latex, value(right, names), Vector(names["r_l"] - names["r_k"])))
    return found


@pytest.mark.parametrize("name", POSES)
def test_drawn_equations_by_sympy(name):
    found = checked(name)
    assert len(found) >= 6
    for latex, got, must in random.Random(name).sample(found, DRAWN):
        assert sp.simplify(sp.Matrix(got) - sp.Matrix(must)) == sp.zeros(3, 1), latex


@pytest.mark.slow
@pytest.mark.parametrize("name", POSES)
def test_all_equations_by_sympy(name):
    for latex, got, must in checked(name):
        assert sp.simplify(sp.Matrix(got) - sp.Matrix(must)) == sp.zeros(3, 1), latex


#: laws whose full reports are judged by derivatives of what they state
LAWS = ("cylindrical", "clearancerevolute", "bushing", "pointspring", "gear", "jointdamper", "appliedforce", "appliedtorque")


@pytest.mark.slow
def test_thirty_equations_of_full_reports_by_sympy():
    """Drawn from joints, couplings and forces: rates, variations, forces, moments, gradients, stiffness, balances."""
    found = []
    for name in LAWS:
        document = mb.report(name)
        found += [(name, latex, holds) for latex, holds in judged(document, symbols_of(document))]
    assert len(found) >= 90
    drawn = random.Random(50).sample(found, 30)
    assert [(name, latex) for name, latex, holds in drawn if not holds] == []


def test_a_wrong_equation_is_judged_wrong():
    document = mb.report("pointspring")
    for e in every(Equation, document.blocks):
        if e.latex.startswith(r"\mathbf{f}_l"):
            object.__setattr__(e, "latex", e.latex.replace("k +", "k -"))
    assert False in [holds for _, holds in judged(document, symbols_of(document))]
