"""Formulas of the notation in LaTeX. Names such as b3k or zkdot become letters with indices and dots, others stay as written;
a text overrides this by `NAME [UNIT] $TEX$: MEANING`.

Motion of a body that a joint connects to another, computed by the compiled recursion of a tree, as simulations use it.
"""

from __future__ import annotations

import cmath
import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np
import symengine as se

from mbdae.audit.evaluate import SizeError, Value
from mbdae.audit.notation import GIVE_OWN_CLASS, Node, Relation, bare
from mbdae.documents.mathml import GREEK
from mbdae.errors import LawError
from mbdae.laws import joints
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.program import Language, called, defined, python_power, written
from mbdae.symbolic.rebuild import complex_atan2
from mbdae.symbolic.stated import motion_key
from mbdae.symbolic.tree import tree_program
from mbdae.symbolic.tree_motion import Link, TreeStructure

_LETTERS = {name: "\\" + name for name in GREEK} | {"phi": r"\varphi", "w": r"\omega"}
_WORDS = "|".join(sorted(GREEK, key=len, reverse=True))
_NAME = re.compile(
    rf"(?P<change>delta(?=.)|d(?=(?:{_WORDS})|[wW]))?(?P<letter>{_WORDS}|[A-Za-z])(?P<bar>bar)?"
    r"(?P<figure>\d*)(?P<index>phi|)(?P<last>\d*)(?P<body>k|l)?(?P<dots>ddot|dot)?$"
)
_SIGNS = {"delta": r"\delta", "rate": r"\frac{d}{dt}", "slope": r"\frac{d}{ds}"}
#: functions with a LaTeX form of their own; the others are written as name and brackets
_CALLS = {"norm": r"\left\|{0}\right\|", "abs": r"\left|{0}\right|", "sqrt": r"\sqrt{{{0}}}",
          "sum": r"\sum_{{{1}={2}}}^{{{3}}} {0}", "integral": r"\int_{{{2}}}^{{{3}}} {0} \, d{1}",
          "diff": r"\frac{{\partial {0}}}{{\partial {1}}}"}
_LONG = {*_SIGNS, "sum", "integral", "diff"}  #: functions that need brackets before an exponent or a transposition sign
_KNOWN = {"sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "det"}  #: names of LaTeX commands
Letters = Mapping[str, str]  #: names of symbols with the TeX that the text gives for them
_NONE: Letters = MappingProxyType({})


def name(text: str, letters: Letters = _NONE, transposed: bool = False, tilde: bool = False) -> str:
    """A name in LaTeX: the TeX given by the text, else its parts as letter, index and dots."""
    match = _NAME.match(text)
    mark = "^{T}" if transposed else ""
    if text in letters:
        inner = rf"\tilde{{{letters[text]}}}" if tilde else letters[text]
        return f"{{{inner}}}{mark}" if mark else inner
    if text == "pi":
        return r"\pi"
    if match is None and "_" in text.strip("_") and len(text.partition("_")[0]) < 8:  # J_1, omega_rel
        head, low = (text.partition("_")[i] for i in (0, 2))
        index = _LETTERS.get(low, low if len(low) == 1 or low.isdigit() else rf"\mathrm{{{low}}}".replace("_", r"\_"))
        return (rf"\tilde{{{name(head)}}}" if tilde else name(head)) + f"_{{{index}}}" + mark
    text = text.replace("_", r"\_")
    if match is None or text == "I":
        return (rf"\tilde{{{text}}}" if tilde else text if text == "I" else rf"\mathrm{{{text}}}") + mark
    body, index = match["body"] or "", match["index"]
    if match["letter"] == "mu":
        body, index = "", index + body  # the k of muk stands for kinetic friction, not for body k: it is an index
    letter = _LETTERS.get(match["letter"], match["letter"])
    for accent, given in (("tilde", tilde), ("bar", match["bar"]), (match["dots"] or "", match["dots"])):
        letter = rf"\{accent}{{{letter}}}" if given else letter
    low = match["figure"] + _LETTERS.get(index, index) + match["last"]
    high = body + ("T" if transposed else "")
    change = {"delta": r"\delta ", "d": r"d"}.get(match["change"] or "", "")
    return change + letter + (f"_{{{low}}}" if low else "") + (f"^{{{high}}}" if high else "")


def statement(s: Relation, letters: Letters = _NONE) -> str:
    """A statement in LaTeX."""
    return (" = " if s.relation == "=" else r" \le ").join(formula(side, letters) for side in s.sides)


def formula(node: Node, letters: Letters = _NONE, level: int = 0) -> str:
    """A formula in LaTeX; level 0: in a sum, 1: in a product, 2: under a tilde, prime or power."""
    kind, parts = node.kind, node.parts
    if parts and letters and (printed := letters.get(str(node))) is not None:
        return f"{{{printed}}}" if level == 2 else printed
    if kind == "number":
        return f"{node.value:g}"
    if kind == "symbol":
        return name(node.value, letters)
    if kind == "call":
        text = _call(node, letters)
        return rf"\left({text}\right)" if level == 2 and node.value in _LONG else text
    if kind == "block":
        rows = r" \\ ".join(" & ".join(formula(p, letters) for p in row.parts) for row in parts)
        return rf"\begin{{bmatrix}} {rows} \end{{bmatrix}}"
    if kind in ("cross", "transposed"):
        return _marked(node, letters)
    if kind == "power":
        return f"{{{formula(parts[0], letters, 2)}}}^{{{formula(parts[1], letters)}}}"
    if kind == "inverse":
        return rf"\frac{{1}}{{{formula(parts[0], letters)}}}"
    text = _sum(node, letters) if kind in ("sum", "neg") else _product(node, letters)
    return rf"\left({text}\right)" if level > (0 if kind in ("sum", "neg") else 1) else text


def _marked(node: Node, letters: Letters) -> str:
    transposed = node.kind == "transposed"
    inner = node.parts[0] if transposed else node
    tilde = inner.kind == "cross"
    base = inner.parts[0] if tilde else inner
    if base.kind == "symbol":
        return name(base.value, letters, transposed, tilde)
    text = rf"\widetilde{{{formula(base, letters, 2)}}}" if tilde else formula(base, letters, 2)
    return f"{{{text}}}^{{T}}" if transposed else text


def _sum(node: Node, letters: Letters) -> str:
    terms = node.parts if node.kind == "sum" else (node,)
    shown = [(" - " if t.kind == "neg" else " + ", formula(bare(t), letters, 1)) for t in terms]
    text = "".join(sign + term for sign, term in shown if term != "0") or "0"
    return text.removeprefix(" + ").lstrip()


def _product(node: Node, letters: Letters) -> str:
    """A product in LaTeX. A product with one factor becomes one fraction over all divisors; with several factors, each divisor
    goes under the factor before it, so that the order of matrices stays."""
    above = [formula(p, letters, 1) for p in node.parts if p.kind != "inverse"]
    below = [p.parts[0] for p in node.parts if p.kind == "inverse"]
    if below and len(above) < 2:
        bottom = r" \, ".join(formula(p, letters, 1) for p in below)
        return rf"\frac{{{above[0] if above else 1}}}{{{bottom}}}"
    out: list[str] = []
    for part in node.parts:
        if part.kind == "inverse" and out:
            out[-1] = rf"\frac{{{out[-1]}}}{{{formula(part.parts[0], letters)}}}"
        else:
            out.append(formula(part, letters, 1))
    return r" \, ".join(out)


def _call(node: Node, letters: Letters) -> str:
    level = 1 if node.value in ("sum", "integral") else 0
    inner = [formula(p, letters, level if i == 0 else 0) for i, p in enumerate(node.parts)]
    if node.value in _CALLS:
        return _CALLS[node.value].format(*inner)
    if node.value in _SIGNS:
        sign = _SIGNS[node.value]
        return rf"{sign} \left({inner[0]}\right)" if node.parts[0].parts else f"{sign} {inner[0]}"
    head = rf"\{node.value}" if node.value in _KNOWN else rf"\operatorname{{{node.value}}}"
    return rf"{head}\left({', '.join(inner)}\right)"


# -- what letters usually stand for

#: units and meanings by what the text says of a letter, then by the letter: only guesses, which the user confirms
_SAID = [line.split(" | ") for line in r"""inertia | kg m^2 | positive number
mass\b | kg | positive number
angular (velocity|speed) | rad/s | number
angle|rotation | rad | function of time
torque|moment | N m | number
length|radius|radii|distance|thickness|height|width | m | positive number
velocity|speed | m/s | number
torsion.*stiffness | N m/rad | positive number
stiffness | N/m | positive number
damp | N s/m | positive number
force|load|reaction | N | number
energy|work|lagrangian | J | number
gravit | m/s^2 | positive number
young|modulus|pressure|stress | Pa | positive number
density | kg/m^3 | positive number
coefficient|ratio|exponent | 1 | positive number
penetration|deflection|displacement|coordinate|position | m | function of time
unit vector|axis | 1 | vector
time | s | positive number""".splitlines()]
_USUAL = [line.split(" | ") for line in r"""m(_|$) | kg | positive number
g$ | m/s^2 | positive number
[lrRabh](_|$)|\\ell | m | positive number
\\(theta|phi|varphi|psi|alpha|beta)(_|$) | rad | function of time
\\omega|\\Omega | rad/s | number
[IJ](_|$) | kg m^2 | positive number
k(_|$) | N/m | positive number
c(_|$) | N s/m | positive number
[FNRQ](_|$) | N | number
[TVUELW](_|$) | J | number
\\tau|M(_|$) | N m | number
[xyzuqws](_|$) | m | function of time
v(_|$) | m/s | number
t$ | s | time""".splitlines()]


def guessed(letter: str, words: str, moving: bool) -> tuple[str, str]:
    """Unit and meaning of a letter, by what a text says of it, else by the letter; moving: whether it is printed with a dot."""
    said = next(((u, m) for pattern, u, m in _SAID if words and re.search(pattern, words.lower())), None)
    unit, meaning = said or next(((u, m) for pattern, u, m in _USUAL if re.match(pattern, letter)), ("1", "number"))
    return unit, "function of time" if moving else meaning


# -- expressions of laws as Python functions of complex numbers: symengine computes powers by logarithms, which makes complex
# steps inexact


def _no_case() -> Value:
    raise SizeError("a se.Piecewise in the class of the law has no case that holds in this state; end it with the case (value, "
                    "True)")


def _cases(*parts: str) -> str:
    """Python text of a Piecewise, whose parts are value, condition, value, ...: it evaluates the value of the first condition
    that holds and no other value, which may be undefined."""
    return f"({parts[0]} if {parts[1]} else {_cases(*parts[2:])})" if parts else "_no_case()"


def _compared(sign: str) -> Callable[..., str]:
    return lambda a, b: f"({a}.real {sign} {b}.real)"


_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(cmath, name) for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "log")},
    **{name: getattr(cmath, name) for name in ("asin", "acos", "atan", "asinh", "acosh", "atanh")},
    "atan2": complex_atan2, "floor": lambda a: complex(math.floor(a.real)),
}
_PYTHON = Language(
    lambda e: f"({e})" if isinstance(e, se.Integer) else f"({complex(e)!r})", python_power,
    {name: called(name) for name in _FUNCTIONS} | dict.fromkeys(("let", "UnevaluatedExpr"), lambda a: a)
    | {"StrictLessThan": _compared("<"), "LessThan": _compared("<="), "Equality": _compared("=="), "Unequality": _compared("!=")}
    | {"And": lambda *a: f"({' and '.join(a)})", "Or": lambda *a: f"({' or '.join(a)})", "Not": lambda a: f"(not {a})"}
    | {"BooleanTrue": lambda: "True", "BooleanFalse": lambda: "False", "Piecewise": _cases})


def expression_function(symbols: Sequence[Any], steps: Mapping[Any, Any], outputs: Sequence[Any]) -> Callable[..., list[Any]]:
    """Expressions as a Python function: it takes the complex values of the symbols, a sequence in their order, and returns the
    list of values of the outputs. steps: intermediate results, {name: expression of symbols and earlier names}."""
    names = {s: f"x[{i}]" for i, s in enumerate(symbols)}
    found = []
    try:
        for i, (name, e) in enumerate(steps.items()):
            found.append((f"a{i}", written(e, names, _PYTHON)))
            names[name] = f"a{i}"
        values = [written(e, names, _PYTHON) for e in outputs]
    except LawError as error:
        raise SizeError(str(error)) from error
    return defined(found, values, _FUNCTIONS | {"_sqrt": cmath.sqrt, "_exp": cmath.exp, "_no_case": _no_case})


@lru_cache(maxsize=4096)
def _alone(e: Any) -> tuple[list[Any], Callable[..., list[Any]]]:
    symbols = list(e.free_symbols)
    return symbols, expression_function(symbols, {}, [e])


def expression_value(e: Any, known: Mapping[Any, complex]) -> Any:
    """Value of an expression for values of its symbols."""
    symbols, function = _alone(e)
    return complex(function([known[s] for s in symbols])[0])


_AXES = (Axes.GENERAL, Axes.GENERAL)


def joint_class(word: str, own: Any = ()) -> Any:
    """The class of a joint with coordinates by its name, in upper or lower case; None where there is none. own: the user's
    laws."""
    known = {name.lower(): getattr(joints, name) for name in joints.__all__} | {name.lower(): cls for name, cls in own}
    cls = known.get(word.lower().replace(" ", ""))
    return cls if isinstance(cls, type) and issubclass(cls, Joint) and cls.coordinates else None


def _stated(cls: Any) -> Any:
    return cls("audited", None, None, **dict.fromkeys(cls.params, 1.0))


@lru_cache(maxsize=16)
def _program(cls: Any, stated: object) -> tuple[list[tuple[Any, ...]], Callable[..., list[Any]]]:
    """The recursion that moves l by the joint from a free body k, as a compiled function: the inputs it takes, each by its place
    (see `TreeProgram`), and the function from their values to the 19 numbers q, u, u' of l. stated: see `motion_key`."""
    law = _stated(cls)
    of_side = [*("p1", "p2", "p3"), *(f"Q{a}{i}" for a in "xyz" for i in (1, 2, 3)), *(f"P{i}" for i in range(4))]
    structure, names = law.structure(), tuple(cls.coordinates)
    numbers = [f"{side}_{n}" for side in "kl" for n in of_side] + [n for n in cls.params if n not in law.derived()]
    stated = tuple((n, None) for n in numbers if n not in structure.absent)
    link = Link(cls, structure, 0, "k", NodeKind.SPATIAL, _AXES, stated, True, names, (False,) * len(names), 1)
    tree = tree_program(TreeStructure(NodeKind.SPATIAL, (link,), (), (1,)))
    found = {(name, i): se.sympify(e) for (name, _, i), e in tree.states((1,))}
    outputs = [found[name, i] for name, size in (("q", 7), ("u", 6), ("up", 6)) for i in range(size)]
    steps = {name: tree.program.steps[name] for name in tree.program.needed(outputs)}
    return list(tree.inputs.values()), expression_function(list(tree.inputs), steps, outputs)


class Carried:
    """Motion of l connected to k by a joint whose points and axes coincide with those of the bodies."""

    def __init__(self, word: str, own: Any = ()) -> None:
        cls = joint_class(word, own)
        if cls is None:
            give_own_class = GIVE_OWN_CLASS.format(word.capitalize())
            raise SizeError(f"an audit knows no joint '{word}' with coordinates; {give_own_class}")
        if any(spec.unit == "rotation" for spec in cls.coordinates.values()):
            raise SizeError(f"the joint '{word}' turns freely, which an audit cannot use: name one whose coordinates are "
                            f"angles and displacements")
        self.coordinates = tuple(cls.coordinates)
        self.inputs, self.function = _program(cls, motion_key(cls, _stated(cls).structure()))

    def motion(self, k: dict[str, Value], state: Any) -> dict[str, Value]:
        """Attitude "Q", Euler parameters "P" and motion vectors of l, from those of k and the coordinates of the state."""
        found = np.array(self.function([complex(self._input(place, k, state)) for place in self.inputs]), dtype=complex)
        q, u, up = found[:7, None], found[7:13, None], found[13:, None]
        P = q[3:]
        w, e = P[0, 0], P[1:]
        x, y, z = e[:, 0]
        Q = (2 * w * w - 1) * np.eye(3) + 2 * e @ e.T + 2 * w * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return {"Q": Q, "P": q[3:], "x": q[:3], "v": u[:3], "w": Q @ u[3:], "a": up[:3], "alpha": Q @ up[3:]}

    def _input(self, place: tuple[Any, ...], k: dict[str, Value], state: Any) -> Value:
        head, j, i = place
        if head == "number":
            return _number(i, state)
        if j < 0:
            return state.coordinates[self.coordinates[-j - 1]][("q", "u", "up").index(head)]
        if head in ("wu", "wq"):
            return 0.0
        moves, turns = {"q": ("x", k["P"]), "u": ("v", k["Q"].T @ k["w"]), "up": ("a", k["Q"].T @ k["alpha"])}[head]
        return k[moves][i, 0] if i < 3 else turns[i - 3, 0]


def _number(name: str, state: Any) -> float:
    """Value of a parameter of the joint; parameters of its points and axes make them coincide with those of the bodies."""
    side, _, what = name.partition("_")
    if side not in ("k", "l") or not what:
        return float(state.positive(f"parameter {name}"))
    return float(what in ("Qx1", "Qy2", "Qz3", "P0"))
