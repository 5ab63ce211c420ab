"""Recorded formulas as LaTeX, and their values in numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.errors import LawError
from mbdae.reports.vectors import Atom, Base, NamedVector, Product, Record, Vector
from mbdae.symbolic.functions import complex_atan2
from mbdae.symbolic.vectors import Expr

_SUM, _PRODUCT, _POWER, _ATOM = 0, 1, 2, 3  #: how tightly a formula holds together
_VECTORS = {"r": r"\mathbf{r}", "s": r"\mathbf{s}", "c": r"\mathbf{c}", "x": r"\mathbf{x}", "y": r"\mathbf{y}",
            "z": r"\mathbf{z}",
            "v": r"\mathbf{v}", "w": r"\boldsymbol{\omega}", "du": r"\delta\mathbf{r}", "dpsi": r"\delta\boldsymbol{\psi}",
            "bx": r"\mathbf{b}^x", "by": r"\mathbf{b}^y", "bz": r"\mathbf{b}^z"}  # fmt: skip
NAMES = (r"\mathbf{a}", r"\mathbf{b}", r"\mathbf{c}", r"\mathbf{e}", r"\mathbf{f}", r"\mathbf{g}", r"\mathbf{h}", r"\mathbf{p}",
         r"\mathbf{q}")  # fmt: skip
_FUNCTIONS = {"sin": r"\sin", "cos": r"\cos", "tan": r"\tan", "tanh": r"\tanh", "exp": r"\exp", "log": r"\ln",
              "atan2": r"\operatorname{atan2}", "asin": r"\arcsin", "acos": r"\arccos", "atan": r"\arctan", "sinh": r"\sinh",
              "cosh": r"\cosh", "sign": r"\operatorname{sgn}"}  # fmt: skip
_RELATIONS = {"LessThan": (r"\le", np.less_equal), "StrictLessThan": ("<", np.less), "Equality": ("=", np.equal),
              "Unequality": (r"\ne", np.not_equal)}  # fmt: skip


class Writer:
    """LaTeX of the formulas of one record; remembers which symbols it wrote."""

    def __init__(self, record: Record, letters: Mapping[str, str], names: Mapping[int, str] | None = None) -> None:
        self.record, self.letters, self.names = record, letters, dict(names or {})
        self.used: set[str] = set()  #: scalar symbols
        self.bases: set[Base] = set()
        self.vectors: set[int] = set()
        self.frame: Callable[[Base], str] | None = None  #: another way to write frame vectors

    @staticmethod
    def plain(base: Base) -> str:
        """A frame vector as it is written."""
        return f"\\mathbf{{i}}_{base.side}" if base.kind == "E" else f"{_VECTORS[base.kind]}_{base.side}"

    # -- scalars

    def scalar(self, e: Expr) -> str:
        """A scalar."""
        return self._scalar(se.sympify(e))[0]

    def factor(self, e: Expr, level: int = _PRODUCT) -> str:
        """A scalar as a factor."""
        text, tight = self._scalar(se.sympify(e))
        return text if tight >= level else f"\\left({text}\\right)"

    def _scalar(self, e: Expr) -> tuple[str, int]:
        if isinstance(e, se.Symbol):
            return self._symbol(e)
        if e.is_Number or e == se.pi:
            return self._number(e)
        if isinstance(e, se.Add):
            return self._sum(sorted(e.args, key=self._place)), _SUM
        if isinstance(e, se.Mul):
            return self._product(e)
        if isinstance(e, se.Pow):
            return self._power(e)
        if isinstance(e, se.Piecewise):
            return self._cases(e), _ATOM
        if isinstance(e, se.floor):
            return f"\\left\\lfloor {self.scalar(e.args[0])}\\right\\rfloor", _ATOM
        name = e.get_name() if isinstance(e, se.FunctionSymbol) else type(e).__name__
        if name in ("let", "rate", "UnevaluatedExpr"):
            return self._scalar(e.args[0])
        if name in _RELATIONS:
            return self._comparison(e, name), _SUM
        if name in ("sin", "cos", "tanh") and len(e.args) == 1:
            argument, tight = self._scalar(e.args[0])
            if tight == _ATOM and "\\left" not in argument:
                return f"{_FUNCTIONS[name]} {argument}", _POWER
        arguments = ",\\, ".join(self.scalar(a) for a in e.args)
        return f"{_FUNCTIONS.get(name, f'{chr(92)}operatorname{{{name}}}')}\\left({arguments}\\right)", _ATOM

    def _symbol(self, e: Expr) -> tuple[str, int]:
        if e in self.record.dots:
            a, b = self.record.dots[e]
            return f"{self.atom(a, True)}\\cdot {self.atom(b, True)}", _PRODUCT
        name = str(e)
        self.used.add(name)
        if name not in self.letters:
            raise LawError(f"the report has no letter for the symbol '{name}'")
        return self.letters[name], _ATOM

    def _number(self, e: Expr) -> tuple[str, int]:
        if e == se.pi:
            return r"\pi", _ATOM
        if isinstance(e, se.Rational) and not isinstance(e, se.Integer):
            p, q = abs(int(e.p)), int(e.q)
            return f"{'-' if e < 0 else ''}\\tfrac{{{p}}}{{{q}}}", _ATOM if e > 0 else _SUM
        value = float(e)
        if value != int(value) or abs(value) > 1e6:
            text = f"{value:g}"
            if "e" in text:
                mantissa, exponent = text.split("e")
                power = f"10^{{{int(exponent)}}}"
                text = power if mantissa == "1" else f"{mantissa}\\cdot {power}"
        else:
            text = str(int(value))
        return text, _ATOM if value >= 0 else _SUM

    @staticmethod
    def _place(term: Expr) -> tuple[bool, bool, str]:
        """Order of the terms of a sum: positive ones first, numbers last."""
        negative = bool(isinstance(term, se.Mul) and term.args[0].is_Number and term.args[0] < 0)
        return (negative, bool(term.is_Number), f"{len(str(term)):4d}{term}")

    def _sum(self, terms: list[Expr]) -> str:
        out = ""
        for term in terms:
            text = self._scalar(term)[0]
            out += text if not out else f" - {text[1:].lstrip()}" if text.startswith("-") else f" + {text}"
        return out

    def _product(self, e: Expr) -> tuple[str, int]:
        sign, above, below = "", [], []
        for factor in e.args:
            if factor.is_Number:
                if factor < 0:
                    sign, factor = "-", -factor
                p, q = (int(factor.p), int(factor.q)) if isinstance(factor, se.Rational) else (factor, 1)
                above += [se.sympify(p)] if p != 1 else []
                below += [se.sympify(q)] if q != 1 else []
            elif isinstance(factor, se.Pow) and factor.args[1].is_Number and factor.args[1] < 0:
                below.append(factor.args[0] ** (-factor.args[1]))
            else:
                above.append(factor)
        if below and not any(not f.is_Number for f in below):  # a number below: in front
            number = [f for f in above if f.is_Number]
            rest = [f for f in above if not f.is_Number]
            front = f"\\tfrac{{{self._joined(number) or '1'}}}{{{self._joined(below)}}}"
            return f"{sign}{front}{self._joined(rest)}", _SUM if sign else _PRODUCT
        if below:
            return f"{sign}\\frac{{{self._joined(above, True) or '1'}}}{{{self._joined(below, True)}}}", (
                _SUM if sign else _PRODUCT
            )
        return f"{sign}{self._joined(above)}", _SUM if sign else _PRODUCT

    def _joined(self, factors: list[Expr], alone: bool = False) -> str:
        if alone and len(factors) == 1:
            return self.scalar(factors[0])
        ordered = sorted(
            factors, key=lambda f: (not f.is_Number, f in self.record.dots, isinstance(f, se.Add | se.Function), str(f))
        )
        if len(ordered) == 1 and ordered[0] in self.record.dots:
            return self.scalar(ordered[0])
        return "\\,".join(self.factor(f, _POWER) for f in ordered)

    def _power(self, e: Expr) -> tuple[str, int]:
        base, exponent = e.args
        if base == se.E:
            return f"\\exp\\left({self.scalar(exponent)}\\right)", _ATOM
        if exponent == se.Rational(1, 2):
            dot = self.record.dots.get(base)
            if dot is not None and dot[0] == dot[1]:
                return f"\\lVert {self.atom(dot[0])}\\rVert", _ATOM
            return f"\\sqrt{{{self.scalar(base)}}}", _ATOM
        if exponent.is_Number and exponent < 0:
            return f"\\frac{{1}}{{{self.scalar(base ** (-exponent))}}}", _PRODUCT
        if isinstance(exponent, se.Rational) and not isinstance(exponent, se.Integer):
            dot = self.record.dots.get(base)
            if dot is not None and dot[0] == dot[1] and int(exponent.q) == 2:
                return f"\\lVert {self.atom(dot[0])}\\rVert^{{{int(exponent.p)}}}", _POWER
            return f"{self.factor(base, _ATOM)}^{{{int(exponent.p)}/{int(exponent.q)}}}", _POWER
        return f"{self.factor(base, _ATOM)}^{{{self.scalar(exponent)}}}", _POWER

    def _comparison(self, e: Expr, name: str) -> str:
        left, right = e.args
        if left.is_Number and not right.is_Number and name in ("StrictLessThan", "LessThan"):  # read with the unknown first
            return f"{self.scalar(right)} {'>' if name[0] == 'S' else chr(92) + 'ge'} {self.scalar(left)}"
        return f"{self.scalar(left)} {_RELATIONS[name][0]} {self.scalar(right)}"

    def _cases(self, e: Expr) -> str:
        first, condition, second, _ = (*e.args, None, None)[:4]
        if len(e.args) == 4 and condition == se.Lt(0, first) and second == -first:
            return f"\\lvert {self.scalar(first)}\\rvert"
        rows = []
        for value, condition in zip(e.args[::2], e.args[1::2], strict=True):
            said = r"\text{otherwise}" if str(condition) == "True" else self.scalar(condition)
            rows.append(f"{self.scalar(value)} & {said}")
        return r"\begin{cases} " + r" \\ ".join(rows) + r" \end{cases}"

    # -- vectors

    def atom(self, atom: Atom, nested: bool = False) -> str:
        """A vector without a factor."""
        if isinstance(atom, Base):
            self.bases.add(atom)
            if self.frame is not None:
                return self.frame(atom)
            return self.plain(atom)
        if isinstance(atom, NamedVector):
            self.vectors.add(atom.number)
            if self.frame is not None:
                return f"\\bar{{{self.names[atom.number]}}}"
            return self.names[atom.number]
        text = f"{self.atom(atom.left, True)}\\times {self.atom(atom.right, True)}"
        return f"({text})" if nested else text

    def vector(self, a: Vector) -> str:
        """A sum of vectors."""
        out = ""
        for atom, c in a.terms.items():
            text = self._term(c, atom)
            out += text if not out else f" - {text[1:].lstrip()}" if text.startswith("-") else f" + {text}"
        return out or r"\mathbf{0}"

    def _term(self, c: Expr, atom: Atom) -> str:
        if c in self.record.dots or -c in self.record.dots:
            sign, c = ("", c) if c in self.record.dots else ("-", -c)
            return f"{sign}({self.scalar(c)})\\,{self.atom(atom, True)}"
        vector = self.atom(atom, not _plain(c))
        if c == 1:
            return self.atom(atom)
        if c == -1:
            return "-" + self.atom(atom)
        text, tight = self._scalar(c)
        if text.startswith(r"\frac{1}{"):
            return f"\\frac{{{self.atom(atom)}}}{text[len(chr(92) + 'frac{1}') :]}"
        if text.startswith(r"-\frac{1}{"):
            return f"-\\frac{{{self.atom(atom)}}}{text[len(chr(92) + '-frac{1}') :]}"
        if tight == _SUM and isinstance(c, se.Add):
            text = f"\\left({text}\\right)"
        return f"{text}\\,{vector}"


def _plain(c: Expr) -> bool:
    return bool(c == 1 or c == -1)


def name_vectors(record: Record) -> dict[int, str]:
    """Letters of the named vectors: the law's own, d from point to point, then a, b, c."""
    found: dict[int, str] = {}
    taken = {f"\\mathbf{{{label}}}" for key, label in record.labels.items() if isinstance(key, int)}
    letters = [letter for letter in NAMES if letter not in taken]
    difference = {Base("r", "l"): 1, Base("r", "k"): -1}
    scalars = name_scalars(record)
    for number, value in record.vectors.items():
        if number in record.changes:
            sign, of = record.changes[number]
            found[number] = (
                f"\\ddot{found[of].removeprefix(sign)}" if sign == r"\dot" == found[of][:4] else f"{sign}{{{found[of]}}}"
            )
        elif number in record.gradients:
            kind, symbol, side = record.gradients[number]
            found[number] = f"\\nabla_{{{kind},{side}}}\\,{scalars[str(symbol)]}"
        elif number in record.labels:
            found[number] = _own(f"\\mathbf{{{record.labels[number]}}}", list(found.values()))
        elif value.terms == difference:
            found[number] = r"\mathbf{d}"
        else:
            found[number] = letters.pop(0) if letters else f"\\mathbf{{a}}_{{{number}}}"
    return found


def name_scalars(record: Record) -> dict[str, str]:
    """Letters of the named scalars: the law's own, else eta with a number."""
    found: dict[str, str] = {}
    for symbol in record.scalars:
        label = record.labels.get(symbol)
        found[str(symbol)] = _own(label, list(found.values())) if label else f"\\eta_{{{len(found) + 1}}}"
    return found


def _own(letter: str, taken: list[str]) -> str:
    """The letter, with a prime where it is taken."""
    while letter in taken:
        letter += "'"
    return letter


# ---- numbers -----------------------------------------------------------------------------------------------------------

Values = dict[str, NDArray[Any]]


def value(e: Expr, get: Callable[[Expr], Any]) -> Any:
    """A scalar in numbers, real or complex; `get` gives symbols."""
    if isinstance(e, se.Symbol):
        return get(e)
    if e.is_Number or e == se.pi or e == se.E:
        return float(e)
    if isinstance(e, se.Piecewise):
        return _chosen(e, get)
    a = [value(x, get) for x in e.args]
    if isinstance(e, se.Add):
        return sum(a[1:], a[0])
    if isinstance(e, se.Mul):
        out = a[0]
        for factor in a[1:]:
            out = out * factor
        return out
    if isinstance(e, se.Pow):
        return _raised(a[0], a[1])
    name = e.get_name() if isinstance(e, se.FunctionSymbol) else type(e).__name__
    if name in ("let", "UnevaluatedExpr"):
        return a[0]
    if name in _RELATIONS:
        return _RELATIONS[name][1](np.real(a[0]), np.real(a[1]))
    if name == "floor":
        return np.floor(np.real(a[0]))
    if name == "atan2":
        return complex_atan2(a[0], a[1])
    return getattr(np, {"asin": "arcsin", "acos": "arccos", "atan": "arctan"}.get(name, name))(*a)


def _raised(base: Any, exponent: Any) -> Any:
    if isinstance(exponent, float) and exponent == int(exponent):
        return base ** int(exponent) if exponent > 0 else 1.0 / base ** int(-exponent)
    return base**exponent


def _chosen(e: Expr, get: Callable[[Expr], Any]) -> Any:
    """The first case whose condition holds; branches may be invalid elsewhere."""
    conditions, values = [], []
    with np.errstate(all="ignore"):
        for result, condition in zip(e.args[::2], e.args[1::2], strict=True):
            conditions.append(True if str(condition) == "True" else value(condition, get))
            values.append(value(result, get))
        shape = np.broadcast_shapes(*(np.shape(x) for x in (*conditions, *values)))
        return np.select([np.broadcast_to(c, shape) for c in conditions], [np.broadcast_to(v, shape) for v in values])


class Numbers:
    """Values of the formulas of a record at many states at once: `atoms` (points, 3), symbols (points,)."""

    def __init__(self, record: Record, atoms: Callable[[Base], NDArray[Any]], symbols: Callable[[str], Any],
                 known: Mapping[Base, NDArray[Any]] | None = None) -> None:  # fmt: skip
        self.record, self.atoms, self.symbols = record, atoms, symbols
        self._known: dict[Any, Any] = dict(known or {})

    def scalar(self, e: Expr) -> Any:
        """A scalar."""
        return value(se.sympify(e), self._symbol)

    def _symbol(self, symbol: Expr) -> Any:
        if symbol not in self._known:
            if symbol in self.record.dots:
                a, b = (self.atom(x) for x in self.record.dots[symbol])
                self._known[symbol] = np.sum(a * b, axis=-1)
            elif symbol in self.record.scalars:
                self._known[symbol] = self.scalar(self.record.scalars[symbol])
            else:
                self._known[symbol] = self.symbols(str(symbol))
        return self._known[symbol]

    def atom(self, atom: Atom) -> NDArray[Any]:
        """An atom."""
        if atom not in self._known:
            if isinstance(atom, Base):
                axis = atom.kind == "E"
                self._known[atom] = np.eye(3)["xyz".index(atom.side)] if axis else self.atoms(atom)
            elif isinstance(atom, NamedVector):
                self._known[atom] = self.vector(self.record.vectors[atom.number])
            else:
                self._known[atom] = np.cross(self.atom(atom.left), self.atom(atom.right))
        found: NDArray[Any] = self._known[atom]
        return found

    def vector(self, a: Vector) -> NDArray[Any]:
        """A vector."""
        total: NDArray[Any] = np.zeros(3)
        for atom, c in a.terms.items():
            total = total + np.asarray(self.scalar(c))[..., None] * self.atom(atom)
        return total


__all__ = ["NAMES", "Numbers", "Product", "Values", "Writer", "name_scalars", "name_vectors", "value"]
