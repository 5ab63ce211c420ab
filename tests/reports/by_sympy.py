"""Printed equations of laws judged by SymPy alone: motions of bodies and derivatives written down here.

What a law states (rows c, an energy V, a dissipation function D, a force F and torque T) is taken from its print;
what follows from it, rates, variations, forces, moments, gradients, balances, is formed here by differences in 120 digits."""

from __future__ import annotations

import random
import re

import sympy as sp
from formulas import DIGITS, WORKING, E, Reader, UnreadError, tokens

from mbdae.documents.blocks import Equation, Paragraph, Section, Table, every

STEP = sp.Float("1e-25", WORKING)
STATED = "stated"  #: verdict on an equation of which nothing here says what it must be
ZERO, K_POINT = sp.zeros(3, 1), r"\mathbf{r}_k"
#: what a lecture prints of body l where the joint holds
ON_JOINT = (r"\mathbf{x}_l", r"\mathbf{y}_l", r"\mathbf{z}_l", r"\boldsymbol{\omega}_l", r"\mathbf{r}_l - \mathbf{r}_k")
BASE = r"(?:\\mathbf\{[rvxyzs]\}|\\boldsymbol\{\\omega\}|\\delta\\mathbf\{r\}|\\delta\\boldsymbol\{\\psi\})_[klm]"


class Printed:
    """The equations of a report by their left-hand sides, and exact numbers for all symbols that none of them defines."""

    def __init__(self, document, symbols, seed=0):
        self.lines, left = [], ""
        blocks = [b for b in document.blocks if not getattr(b, "title", "").startswith(("The element", "Tangent of the element"))]
        for e in every(Equation, blocks):  # elements are compared with the kernel
            parts = re.split(r"(?<!\\l)(?<!\\g) = ", e.latex) if not e.latex.startswith("= ") else [left, e.latex[2:]]
            left = parts[0].strip()
            self.lines += [(e.latex, left, right.strip()) for right in parts[1:] if right.strip() not in ("0", r"\mathbf{0}")
                           or len(parts) == 2]
        self.rng = random.Random(seed)
        self.numbers, self.vectors = {}, {}
        self.defined = {}
        for _, left, right in self.lines:
            self.defined.setdefault(left, right)
        self.held = any(getattr(block, "title", "") == "On the joint" for block in document.blocks)
        moved = " ".join(right for _, left, right in self.lines if self.held and left in ON_JOINT)
        read = [n for n in symbols if n in self.defined and n in moved and n not in ON_JOINT]  # coordinates, read from the axes
        symbols = [*symbols, *(rf"\boldsymbol{{\lambda}}_{n[11:]}" for n in self.defined if n.startswith(r"\mathbf{c}_{"))]
        for name in symbols:
            vector = re.search(r"\\(?:mathbf|boldsymbol)", name)
            (self.vectors if vector else self.numbers)[name] = None
        state = [n for n in self.defined if re.fullmatch(BASE, n) or (n in self.numbers and rf"\dot{{{n}}}" in self.numbers)]
        self.defined = {n: right for n, right in self.defined.items() if n not in [*state, *read, ON_JOINT[-1]]}
        self.read = frozenset(read)
        self.numbers = {n: None for n in self.numbers if n not in self.defined}
        self.vectors = {n: None for n in self.vectors if n not in self.defined}
        for name in self.numbers:
            self.numbers[name] = sp.Float(sp.Rational(self.rng.randint(20, 60), 40), WORKING)
        attitudes = {side: rotation(self.rng) for side in "klm"}
        for name in self.vectors:
            axis = re.fullmatch(r"\\mathbf\{([xyz])\}_([klm])", name)
            inertial = re.fullmatch(r"\\mathbf\{i\}_([xyz])", name)
            value = sp.Matrix([sp.Rational(self.rng.randint(-40, 40), 20) for _ in range(3)])
            if axis:
                value = attitudes[axis[2]].col("xyz".index(axis[1]))
            if inertial:
                value = sp.eye(3).col("xyz".index(inertial[1]))
            self.vectors[name] = value.evalf(WORKING)
        for side in "klm":
            centre, point, arm = (rf"\mathbf{{{a}}}_{side}" for a in "crs")
            if {centre, arm} <= self.vectors.keys():
                self.vectors[centre] = self.vectors.get(point, ZERO) - self.vectors[arm]
        if self.held and (point := r"\mathbf{r}_l") in self.vectors:
            self.vectors[point] = self._of(K_POINT)
        for name in ON_JOINT if self.held else ():  # a lecture is true where the joint holds: l stands where its relations say
            if right := next((r for _, left, r in self.lines if left == name), ""):
                self.vectors[name.partition(" - ")[0]] = self.value(right) + (self._of(K_POINT) if " - " in name else ZERO)

    def value(self, latex, move=None, at=None):
        """The value of a formula, at a moved state. move: function (name, value at rest) -> value as a function of e; at: value
        of e."""
        known = {}
        for name, value in (self.numbers | self.vectors).items():
            moved = value if move is None else move(name, value)
            known[tuple(tokens(name))] = moved if at is None else sp.sympify(moved).subs(E, at)
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
        w = self._of(rf"\boldsymbol{{\omega}}_{side}", ZERO)
        if re.fullmatch(r"\\mathbf\{[xyzs]\}_[klm]", name):
            return value + E * w.cross(value) + E**2 / 2 * w.cross(w.cross(value))
        if re.fullmatch(r"\\mathbf\{[rv]\}_[klm]", name):
            bent = w.cross(w.cross(self._of(rf"\mathbf{{s}}_{side}", ZERO)))
            v = self._of(rf"\mathbf{{v}}_{side}", ZERO)
            return value + E * v + E**2 / 2 * bent if name[8] == "r" else value + E * bent
        rates = [self._of(rf"\{d}{{{name}}}", self._of(rf"\{d} {name}")) for d in ("dot", "ddot")]
        rates[1] *= int(rf"\delta {name}" not in self.numbers)  # a coordinate that is an unknown has its own acceleration
        return value + E * rates[0] + E**2 / 2 * rates[1] if name in self.numbers else value

    def virtual(self, name, value):
        """A virtual displacement."""
        side = name[-1]
        if re.fullmatch(r"\\mathbf\{[xyzs]\}_[klm]", name):
            return value + E * self._of(rf"\delta\boldsymbol{{\psi}}_{side}", ZERO).cross(value)
        moved = self._of(rf"\delta\mathbf{{r}}_{side}", ZERO)
        if re.fullmatch(r"\\mathbf\{c\}_[klm]", name):
            turned = self._of(rf"\delta\boldsymbol{{\psi}}_{side}", ZERO).cross(self._of(rf"\mathbf{{s}}_{side}", ZERO))
            return value + E * (moved - turned)
        if re.fullmatch(r"\\mathbf\{r\}_[klm]", name):
            return value + E * moved
        return value + E * self._of(rf"\delta {name}") if name in self.numbers else value

    def allowed(self, name, value):
        """Velocities changed by a virtual displacement, which satisfies rows of velocities as they do."""
        if m := re.fullmatch(r"\\mathbf\{v\}_([klm])", name):
            return value + E * self._of(rf"\delta\mathbf{{r}}_{m[1]}", ZERO)
        if m := re.fullmatch(r"\\boldsymbol\{\\omega\}_([klm])", name):
            return value + E * self._of(rf"\delta\boldsymbol{{\psi}}_{m[1]}", ZERO)
        coordinate = re.fullmatch(r"\\dot\{?(.*?)\}?", name)
        return value + E * self._of(rf"\delta {coordinate[1].strip()}") if coordinate and name in self.numbers else value

    def along(self, kind, side, i):
        """Unit displacements (r), rotations (psi), velocities (v), angular velocities (omega) along axis i of one body."""
        unit = sp.eye(3).col(i)

        def move(name, value):
            if name[-1] != side:
                return value
            if kind == "psi" and re.fullmatch(r"\\mathbf\{[xyzs]\}_[klm]", name):
                return value + E * unit.cross(value)
            if kind in ("r", "psi") and re.fullmatch(r"\\mathbf\{c\}_[klm]", name):
                return value + E * (unit if kind == "r" else -unit.cross(self._of(rf"\mathbf{{s}}_{side}", ZERO)))
            hit = {"r": rf"\mathbf{{r}}_{side}", "v": rf"\mathbf{{v}}_{side}", "omega": rf"\boldsymbol{{\omega}}_{side}"}
            return value + E * unit if name == hit.get(kind) else value

        return move

    def derivative(self, latex, move, order=1):
        """d/de of a formula at e = 0, by differences whose error is of the order of STEP^2."""
        before, after = (self.value(latex, move, at) for at in (-STEP, STEP))
        return (after - before) / (2 * STEP) if order == 1 else (after - 2 * self.value(latex, move, 0) + before) / STEP**2

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
    """The names in the table of symbols, or those that sentences explain where they appear."""
    cells = [row[0] for t in every(Table, document.blocks) if [*t.head] == ["symbol", "unit", "meaning"] for row in t.rows]
    for paragraph in every(Paragraph, document.blocks):
        heads = (part.partition(": ")[0] for part in paragraph.text.removeprefix("Here ").split("; "))
        cells += [head for head in heads if re.fullmatch(r"(\$[^$]*\$(, )?)+( \([^()]*(\([^()]*\))?[^()]*\))?", head)]
    names = [name for cell in cells for latex in re.findall(r"\$([^$]*)\$", cell) for name in re.split(r",\\ ", latex)]
    return [*dict.fromkeys(n for n in names if "=" not in n)]


def demanded(p, left):
    """What the left-hand side of an equation must be by what the law states; None where nothing here says it."""
    rows = {m[1]: right for _, name, right in p.lines if (m := re.fullmatch(r"c_\{(\\text\{[^{}]*\})\}", name))
            and right not in ("0", r"\mathbf{0}")}
    speeds = {m[1]: right for _, name, right in p.lines[::-1] if (m := re.fullmatch(r"\\dot c_\{(\\text\{[^{}]*\})\}", name))
              and m[1] not in rows and right != "0"}  # rows of velocities: what is printed first states them
    work, power = (" + ".join(rf"{multiplier}\,\left({right}\right)" for row, right in of.items()
                              if (multiplier := rf"\lambda_{{{row}}}") in p.numbers) for of in (rows, speeds))
    for _, name, right in p.lines:  # three rows along the inertial axes, as one
        if name.startswith(r"\mathbf{c}_{") and right not in ("0", r"\mathbf{0}"):
            work = rf"\boldsymbol{{\lambda}}_{name[11:]}\cdot \left({right}\right)" + (f" + {work}" if work else "")
    if re.fullmatch(r"c_\{.*\}", left) and p.held:
        return sp.Integer(0)
    if left.startswith(r"\mathbf{c}_{") and p.held:
        return ZERO
    if left in p.read:
        return p.numbers[left]
    if left == ON_JOINT[3] and p.held:
        axes = [(p._of(name), p.derivative(right, p.in_time)) for _, name, right in p.lines if name in ON_JOINT[:3]]
        return sum((a.cross(rate) for a, rate in axes), ZERO) / 2 if len(axes) == 3 else None
    if m := re.fullmatch(r"\\(dot|delta) c_\{(.*)\}", left):
        if m[2] in speeds:
            return p.derivative(speeds[m[2]], p.allowed) if m[1] == "delta" else None
        return p.derivative(rows[m[2]], p.in_time if m[1] == "dot" else p.virtual) if m[2] in rows else None
    if (m := re.fullmatch(r"\\gamma_\{(\\text\{.*\})\}", left)) and m[1] in rows | speeds:
        return p.derivative((rows | speeds)[m[1]], p.in_time, 2 if m[1] in rows else 1)
    if (m := re.fullmatch(r"\\(dot|ddot|delta)\{?(\\mathbf\{[a-z]\}'*)\}?", left)) and m[2] in p.defined:
        fields = [n for n in p.vectors if n in p.defined[m[2]] and not re.fullmatch(BASE + r"|\\mathbf\{(?:c|i)\}_[klmxyz]", n)]
        order = 2 if m[1] == "ddot" else 1
        return None if fields else p.derivative(p.defined[m[2]], p.virtual if m[1] == "delta" else p.in_time, order)
    if m := re.fullmatch(r"\\nabla_\{\\?(r|psi|v|omega),([klm])\}\\,(\S+)", left):
        return p.gradient(p.defined[m[3]], m[1], m[2]) if m[3] in p.defined else None
    if m := re.fullmatch(r"\\delta\\mathbf\{([fm])\}_([klm])", left):
        name = rf"\mathbf{{{m[1]}}}_{m[2]}"
        return p.derivative(p.defined[name], p.virtual) if name in p.defined else None
    if left == r"\delta W" and (work or power):
        return sum(p.derivative(of, by) for of, by in ((work, p.virtual), (power, p.allowed)) if of)
    if (m := re.fullmatch(r"\\mathbf\{([fm])\}_([klm])", left)) and (work or power):
        kinds = ("r", "v") if m[1] == "f" else ("psi", "omega")
        return sum((p.gradient(of, kind, m[2]) for of, kind in zip((work, power), kinds, strict=True) if of), ZERO)
    if m and {"V", "D", "Q", r"\mathbf{F}", r"\mathbf{T}"} & p.defined.keys():
        return force(p, m[1], m[2])
    if "T" in p.defined and not p.vectors and (m := re.fullmatch(r"([fm])_([xyz])", left)):
        return inertia(p, m[1], "xyz".index(m[2]))
    if left == "f_e" and "V" in p.defined:
        return p.derivative(p.defined["V"], lambda name, value: value + E if name == "a" else value)
    if left == "P" and "f_t" in p.defined:
        return p.value(r"v\,f_t")
    if r"\kappa_1" in p.numbers and left in LINE:
        return resultant(p, *LINE[left])
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
    if "Q" in p.defined and "q" in p.defined:
        found += p.value("Q") * p.gradient(p.defined["q"], "r" if kind == "f" else "psi", side)
    sign = 1 if side == "l" else -1
    F, T = (p.value(p.defined[rf"\mathbf{{{letter}}}"]) if rf"\mathbf{{{letter}}}" in p.defined else sp.zeros(3, 1)
            for letter in "FT")
    if kind == "f":
        return found + sign * F
    arm = sp.zeros(3, 1) if side == "l" or sp.zeros(3, 1) == F else p.value(r"\mathbf{r}_l - \mathbf{r}_k")
    return found + sign * (T + arm.cross(F))


def inertia(p, kind, i):
    """Row of a body's equations of motion: d/dt of the derivative of T by a velocity, and Omega x dT/dOmega about body axes."""
    names = [(rf"{letter}_{axis}", rf"\dot{letter}_{axis}".replace("tv", "t v")) for letter in ("v", r"\Omega") for axis in "xyz"]
    e = sp.symbols("e0:6")
    values = [p._of(name) + p._of(rate) * E + x for (name, rate), x in zip(names, e, strict=True)]
    moved = {name: value for (name, _), value in zip(names, values, strict=True)}
    T = sp.sympify(p.value(p.defined["T"], lambda name, value: moved.get(name, value)))
    gradient = [sp.diff(T, x).subs(dict.fromkeys(e, 0)) for x in e]
    turned = sp.Matrix([p._of(name) for name, _ in names[3:]]).cross(sp.Matrix(gradient[3:]).subs(E, 0))
    return sp.diff(gradient[i + 3 * (kind == "m")], E) + (turned[i] if kind == "m" else 0)


#: of a law on a line: what is differentiated by which vector, or along which axes by their scalars
LINE = {r"\mathbf{n}": ("strains", r"\mathbf{r}'"), r"\mathbf{q}": ("strains", ""), r"\mathbf{m}": ("strains", r"\kappa"),
        r"\mathbf{p}": ("T", r"\mathbf{v}"), r"\mathbf{l}": ("T", r"\Omega")}


def resultant(p, of, by):
    """A stress resultant or a momentum of a section; by: "" for a rotation of its axes."""
    terms = [rf"{m[1]}_{{{m[1]}{m[2]}}}".replace(f"{{{m[1]}", "{") + rf"\,\left({right}\right)" for _, left, right in p.lines
             if (m := re.fullmatch(r"\\gamma_\{([NM])(\d)\}", left)) and r"u_" not in right and r"\theta" not in right]
    latex, units = " + ".join(terms) if of == "strains" else p.defined["T"], [sp.eye(3).col(i) for i in range(3)]
    if by.startswith(r"\mathbf"):
        return sp.Matrix([p.derivative(latex, lambda n, v, u=u: v + E * u if n == by else v) for u in units])
    if not by:
        return sp.Matrix([p.derivative(latex, lambda n, v, u=u: v + E * u.cross(v) if n.startswith(r"\mathbf{d}_") else v)
                          for u in units])
    return sum((p.value(rf"\mathbf{{d}}_{i}") * p.derivative(latex, lambda n, v, i=i: v + E if n == f"{by}_{i}" else v)
                for i in (1, 2, 3)), ZERO)


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


def judged(document, symbols, seed=0):
    """(LaTeX, verdict) of every equation; a report of two laws is judged law by law.

    Verdict: True or False where something here says what the equation must be, None where it cannot be read, STATED where it
    can be read and nothing here says what it must be: what a law states, names of parts, what is beyond this judge."""
    own = [b for b in document.blocks if isinstance(b, Section) and any(isinstance(x, Section) for x in b.blocks)]
    for part in own if len(own) > 1 else ():
        yield from judged(part, symbols_of(part), seed)
    if len(own) > 1:
        return
    p = Printed(document, symbols, seed)
    for latex, left, right in dict.fromkeys(p.lines):
        try:
            must, got = demanded(p, left), p.value(right)
            yield latex, STATED if must is None else equal(got, must)
        except UnreadError:
            yield latex, None


def counts(verdicts):
    """[equations that are judged, those that are only stated, those that cannot be read]."""
    return [sum(v in (True, False) for v in verdicts), verdicts.count(STATED), verdicts.count(None)]


def equal(got, must):
    """Whether two values agree to DIGITS."""
    one, other = (sp.Matrix([v]) if not isinstance(v, sp.MatrixBase) else sp.Matrix(v) for v in (got, must))
    if one.shape != other.shape:
        return False
    bound = 10 ** (8 - DIGITS)
    return all(abs(sp.N(a - b, DIGITS, chop=True)) < bound * (1 + abs(sp.N(b, DIGITS))) for a, b in zip(one, other, strict=True))
