"""Printed equations of laws judged by SymPy alone: a reader of LaTeX, motions of bodies and derivatives written down here.

What a law states (rows c, an energy V, a dissipation function D, a force F and torque T) is taken from its print;
what follows from it, rates, variations, forces, moments, gradients, balances, is formed here by derivatives and compared."""

from __future__ import annotations

import random
import re

import sympy as sp

from mbdae.documents.blocks import Equation, Table, every

E = sp.Symbol("e")
DIGITS = 30
SPACES = {r"\,", r"\;", r"\!", r"\left", r"\right", r"\bigl", r"\bigr"}
FUNCTIONS = {r"\sin": sp.sin, r"\cos": sp.cos, r"\tan": sp.tan, r"\exp": sp.exp, r"\ln": sp.log, r"\tanh": sp.tanh,
             r"\arcsin": sp.asin, r"\arccos": sp.acos, r"\arctan": sp.atan}
BASE = r"(?:\\mathbf\{[rvxyzs]\}|\\boldsymbol\{\\omega\}|\\delta\\mathbf\{r\}|\\delta\\boldsymbol\{\\psi\})_[klm]"


class UnreadError(Exception):
    """A formula that is no sum of products of known symbols."""


def tokens(latex):
    """Commands, texts and characters, without spaces and sizes of brackets."""
    found = re.findall(r"\\text\{[^{}]*\}|\\operatorname\{[^{}]*\}|\\[A-Za-z]+|\\.|\d+(?:\.\d+)?|\S", latex)
    return [t for t in found if t not in SPACES]


class Reader:
    """The value of a formula. values: of names, tuples of tokens, or functions without arguments."""

    def __init__(self, latex, values):
        self.t, self.i, self.values = tokens(latex), 0, values

    def whole(self):
        found = self.sum()
        if self.i < len(self.t):
            raise UnreadError(self.t[self.i :])
        return found

    def peek(self):
        return self.t[self.i] if self.i < len(self.t) else ""

    def take(self, wanted=None):
        token = self.peek()
        if not token or (wanted and token != wanted):
            raise UnreadError(f"{token} for {wanted}")
        self.i += 1
        return token

    def sum(self):
        total = None
        while total is None or self.peek() in ("+", "-"):
            sign = -1 if self.peek() in ("+", "-") and self.take() == "-" else 1
            term = self.product() * sign
            total = term if total is None else term if total == 0 else total if term == 0 else total + term
        return total

    def product(self):
        found = self.power()
        while self.peek() not in ("", "+", "-", ")", "}", ",", "]", "&", r"\rVert", r"\rvert", "=", r"\end", r"\\", ">", "<"):
            sign = self.take() if self.peek() in (r"\cdot", r"\times") else ""
            found = times(found, self.power(), sign)
        return found

    def power(self):
        found = self.atom()
        while self.peek() == "^":
            self.take()
            found = found ** self.group()
        return found

    def group(self):
        self.take("{")
        found = self.sum()
        self.take("}")
        return found

    def atom(self):
        names = [n for n in self.values if tuple(self.t[self.i : self.i + len(n)]) == n]
        if names:
            name = max(names, key=len)
            self.i += len(name)
            if self.peek() in ("_", "'"):
                raise UnreadError(f"{name} with {self.peek()}")
            found = self.values[name]
            return found() if callable(found) else found
        token = self.take()
        if re.fullmatch(r"\d+(\.\d+)?", token):
            return sp.Rational(token)
        if token == r"\pi":
            return sp.pi
        if token in (r"\frac", r"\tfrac"):
            above = self.group()
            return above / self.group()
        if token == r"\sqrt":
            return sp.sqrt(self.group())
        if token == r"\mathbf" and self.t[self.i : self.i + 3] == ["{", "0", "}"]:
            self.i += 3
            return sp.zeros(3, 1)
        if token in FUNCTIONS or token == r"\operatorname{atan2}":
            if self.peek() != "(":
                return FUNCTIONS[token](self.atom())
            self.take("(")
            arguments = [self.sum()]
            while self.peek() == ",":
                self.take()
                arguments.append(self.sum())
            self.take(")")
            return (FUNCTIONS.get(token) or sp.atan2)(*arguments)
        if token in ("(", "{"):
            found = self.sum()
            self.take(")" if token == "(" else "}")
            return found
        if token in (r"\lVert", r"\lvert"):
            found = self.sum()
            self.take(r"\rVert" if token == r"\lVert" else r"\rvert")
            return sp.sqrt(found.dot(found)) if token == r"\lVert" else sp.Abs(found)
        raise UnreadError(token)


def times(a, b, sign):
    """A product of numbers and vectors."""
    m, n = (isinstance(x, sp.MatrixBase) for x in (a, b))
    if m and n:
        if sign == r"\times":
            return a.cross(b)
        if sign == r"\cdot":
            return a.dot(b)
        raise UnreadError("two vectors without a sign")
    if sign == r"\times":
        raise UnreadError("a vector product with a number")
    return a * b


def skew(a):
    """The matrix of the vector product with a."""
    return sp.Matrix(3, 3, lambda i, j: sum(-sp.LeviCivita(i, j, k) * a[k] for k in range(3)))


class Printed:
    """The equations of a report by their left-hand sides, and exact numbers for all symbols that none of them defines."""

    def __init__(self, document, symbols, seed=0):
        self.lines, left = [], ""
        for e in every(Equation, document.blocks):
            parts = re.split(r"(?<!\\l)(?<!\\g) = ", e.latex) if not e.latex.startswith("= ") else [left, e.latex[2:]]
            left = parts[0].strip()
            self.lines += [(e.latex, left, right.strip()) for right in parts[1:] if right.strip() not in ("0", r"\mathbf{0}")
                           or len(parts) == 2]
        self.rng = random.Random(seed)
        self.numbers, self.vectors = {}, {}
        self.defined = {}
        for _, left, right in self.lines:
            self.defined.setdefault(left, right)
        for name in symbols:
            vector = re.search(r"\\(?:mathbf|boldsymbol)", name)
            (self.vectors if vector else self.numbers)[name] = None
        state = [n for n in self.defined if re.fullmatch(BASE, n) or (n in self.numbers and rf"\dot{{{n}}}" in self.numbers)]
        self.defined = {n: right for n, right in self.defined.items() if n not in state}
        self.numbers = {n: None for n in self.numbers if n not in self.defined}
        self.vectors = {n: None for n in self.vectors if n not in self.defined}
        for name in self.numbers:
            self.numbers[name] = sp.Rational(self.rng.randint(20, 60), 40)
        attitudes = {side: rotation(self.rng) for side in "klm"}
        for name in self.vectors:
            axis = re.fullmatch(r"\\mathbf\{([xyz])\}_([klm])", name)
            inertial = re.fullmatch(r"\\mathbf\{i\}_([xyz])", name)
            value = sp.Matrix([sp.Rational(self.rng.randint(-40, 40), 20) for _ in range(3)])
            if axis:
                value = attitudes[axis[2]].col("xyz".index(axis[1]))
            if inertial:
                value = sp.eye(3).col("xyz".index(inertial[1]))
            self.vectors[name] = value

    def value(self, latex, move=None):
        """The value of a formula, at a moved state. move: function (name, value at rest) -> value as a function of e."""
        known = {}
        for name, value in (self.numbers | self.vectors).items():
            known[tuple(tokens(name))] = value if move is None else move(name, value)
        made = {}
        for name, right in self.defined.items():
            key = tuple(tokens(name))
            if key not in known and "+" not in name:
                def of(key=key, right=right):
                    if key not in made:
                        made[key] = Reader(right, known).whole()
                    return made[key]

                known[key] = of
        return Reader(latex, known).whole()

    # -- motions

    def _of(self, name, default=0):
        return (self.numbers | self.vectors).get(name, default)

    def in_time(self, name, value):
        """Motion without accelerations of centres and bodies."""
        side = name[-1]
        w = self._of(rf"\boldsymbol{{\omega}}_{side}", sp.zeros(3, 1))
        if re.fullmatch(r"\\mathbf\{[xyzs]\}_[klm]", name):
            return value + E * w.cross(value) + E**2 / 2 * w.cross(w.cross(value))
        if re.fullmatch(r"\\mathbf\{[rv]\}_[klm]", name):
            bent = w.cross(w.cross(self._of(rf"\mathbf{{s}}_{side}", sp.zeros(3, 1))))
            v = self._of(rf"\mathbf{{v}}_{side}", sp.zeros(3, 1))
            return value + E * v + E**2 / 2 * bent if name[8] == "r" else value + E * bent
        rates = [self._of(rf"\{d}{{{name}}}", self._of(rf"\{d} {name}")) for d in ("dot", "ddot")]
        return value + E * rates[0] + E**2 / 2 * rates[1] if name in self.numbers else value

    def virtual(self, name, value):
        """A virtual displacement."""
        side = name[-1]
        if re.fullmatch(r"\\mathbf\{[xyzs]\}_[klm]", name):
            return value + E * self._of(rf"\delta\boldsymbol{{\psi}}_{side}", sp.zeros(3, 1)).cross(value)
        if re.fullmatch(r"\\mathbf\{r\}_[klm]", name):
            return value + E * self._of(rf"\delta\mathbf{{r}}_{side}", sp.zeros(3, 1))
        return value + E * self._of(rf"\delta {name}") if name in self.numbers else value

    def along(self, kind, side, i):
        """Unit displacements (r), rotations (psi), velocities (v), angular velocities (omega) along axis i of one body."""
        unit = sp.eye(3).col(i)

        def move(name, value):
            if name[-1] != side:
                return value
            if kind == "psi" and re.fullmatch(r"\\mathbf\{[xyz]\}_[klm]", name):
                return value + E * unit.cross(value)
            hit = {"r": rf"\mathbf{{r}}_{side}", "v": rf"\mathbf{{v}}_{side}", "omega": rf"\boldsymbol{{\omega}}_{side}"}
            return value + E * unit if name == hit.get(kind) else value

        return move

    def derivative(self, latex, move, order=1):
        """d/de of a formula at e = 0."""
        return sp.diff(sp.sympify(self.value(latex, move)), E, order).subs(E, 0)

    def gradient(self, latex, kind, side):
        """Vector of derivatives of a scalar formula."""
        return sp.Matrix([self.derivative(latex, self.along(kind, side, i)) for i in range(3)])


def rotation(rng):
    """An exact rotation matrix."""
    a, b, c, d = (sp.Rational(rng.randint(1, 5), rng.randint(1, 5)) * rng.choice((1, -1)) for _ in range(4))
    n = a * a + b * b + c * c + d * d
    return sp.Matrix([[a*a + b*b - c*c - d*d, 2*(b*c - a*d), 2*(b*d + a*c)],
                      [2*(b*c + a*d), a*a - b*b + c*c - d*d, 2*(c*d - a*b)],
                      [2*(b*d - a*c), 2*(c*d + a*b), a*a - b*b - c*c + d*d]]) / n


def symbols_of(document):
    """The names in the table of symbols."""
    rows = [row[0] for t in every(Table, document.blocks) if [*t.head] == ["symbol", "unit", "meaning"] for row in t.rows]
    return [name for cell in rows for latex in re.findall(r"\$([^$]*)\$", cell) for name in re.split(r",\\ ", latex)]


def demanded(p, left):
    """What the left-hand side of an equation must be by what the law states; None where nothing here says it."""
    rows = {m[1]: right for _, name, right in p.lines if (m := re.fullmatch(r"c_\{(\\text\{[^{}]*\})\}", name))
            and right not in ("0", r"\mathbf{0}")}
    held = {row: rf"\lambda_{{{row}}}" for row in rows}
    work = " + ".join(rf"{held[row]}\,\left({right}\right)" for row, right in rows.items() if held[row] in p.numbers)
    if m := re.fullmatch(r"\\(dot|delta) c_\{(.*)\}", left):
        return p.derivative(rows[m[2]], p.in_time if m[1] == "dot" else p.virtual) if m[2] in rows else None
    if (m := re.fullmatch(r"\\gamma_\{(\\text\{.*\})\}", left)) and m[1] in rows:
        return p.derivative(rows[m[1]], p.in_time, 2)
    if (m := re.fullmatch(r"\\(dot|ddot|delta)\{?(\\mathbf\{[a-z]\}'*)\}?", left)) and m[2] in p.defined:
        return p.derivative(p.defined[m[2]], p.virtual if m[1] == "delta" else p.in_time, 2 if m[1] == "ddot" else 1)
    if m := re.fullmatch(r"\\nabla_\{\\?(r|psi|v|omega),([klm])\}\\,(\\eta_\{\d+\})", left):
        return p.gradient(p.defined[m[3]], m[1], m[2]) if m[3] in p.defined else None
    if m := re.fullmatch(r"\\delta\\mathbf\{([fm])\}_([klm])", left):
        name = rf"\mathbf{{{m[1]}}}_{m[2]}"
        return p.derivative(p.defined[name], p.virtual) if name in p.defined else None
    if left == r"\delta W" and work:
        return p.derivative(work, p.virtual)
    if (m := re.fullmatch(r"\\mathbf\{([fm])\}_([klm])", left)) and work:
        return p.gradient(work, "r" if m[1] == "f" else "psi", m[2])
    if m and {"V", "D", r"\mathbf{F}", r"\mathbf{T}"} & p.defined.keys():
        return force(p, m[1], m[2])
    if m := re.fullmatch(r"h_\{(?:\\text\{)?([^{}]*)\}?\}", left):
        return effort(p, m[1].replace("_", " "), work)
    if re.search(r" \+ |\\cdot", left) and left.startswith(r"\mathbf"):
        return p.value(left)
    return None


def force(p, kind, side):
    """Force or moment on a body of a law with energies, dissipation and a stated force on l at its point, the opposite on k."""
    found = sp.zeros(3, 1)
    for name, moved in (("V", "r" if kind == "f" else "psi"), ("D", "v" if kind == "f" else "omega")):
        if name in p.defined:
            found -= p.gradient(p.defined[name], moved, side)
    sign = 1 if side == "l" else -1
    F, T = (p.value(p.defined[rf"\mathbf{{{letter}}}"]) if rf"\mathbf{{{letter}}}" in p.defined else sp.zeros(3, 1)
            for letter in "FT")
    if kind == "f":
        return found + sign * F
    arm = sp.zeros(3, 1) if side == "l" or sp.zeros(3, 1) == F else p.value(r"\mathbf{r}_l - \mathbf{r}_k")
    return found + sign * (T + arm.cross(F))


def effort(p, name, work):
    """Generalised force on a coordinate, whose letter is that of the only one with this variation or this name."""
    own = [n for n in p.numbers if rf"\dot{{{n}}}" in p.numbers and not n.startswith((r"\dot", r"\ddot"))]
    hit = [n for n in own if name in (n, re.sub(r"\\text\{(.*)\}", r"\1", n))] or (own if len(own) == 1 else [])
    if not hit:
        return None

    def move(n, value):
        return value + E if n == hit[0] else value

    def speed(n, value):
        return value + E if n == rf"\dot{{{hit[0]}}}" else value

    if work:
        return p.derivative(work, move)
    parts = [(p.defined[letter], by) for letter, by in (("V", move), ("D", speed)) if letter in p.defined]
    return sum((p.derivative(latex, by) for latex, by in parts), sp.Integer(0)) if parts else None


def judged(document, symbols):
    """(LaTeX, whether it holds) of the equations that SymPy can judge."""
    p = Printed(document, symbols)
    stated = set()
    for latex, left, right in p.lines:
        try:
            must = demanded(p, left)
            if must is None or (latex, right) in stated:
                continue
            got = p.value(right)
        except UnreadError:
            continue
        stated.add((latex, right))
        yield latex, equal(got, must)


def equal(got, must):
    """Whether two values agree to DIGITS."""
    one, other = (sp.Matrix([v]) if not isinstance(v, sp.MatrixBase) else sp.Matrix(v) for v in (got, must))
    if one.shape != other.shape:
        return False
    bound = 10 ** (8 - DIGITS)
    return all(abs(sp.N(a - b, DIGITS, chop=True)) < bound * (1 + abs(sp.N(b, DIGITS))) for a, b in zip(one, other, strict=True))
