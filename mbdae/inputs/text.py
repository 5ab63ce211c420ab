"""The language of inputs: expressions of time as text that keeps every digit, and the strict reader of that text.

The text is the notation of Python and SymPy: numbers, + - * / **, comparisons, the functions of `timed`, Piecewise, And, Or, Not
(and, or, not, &, |, ~), Xor, pi, E, the time t, sensors by their paths, sensor("J.angle"), and named numbers,
number("amplitude", 2.0). It may come from a file of unknown origin, so Python and SymPy evaluate nothing of it: the reader
knows these words only, and refuses expressions that would take long to calculate or produce huge numbers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any, NamedTuple

import symengine as se

from mbdae.inputs import tables
from mbdae.notation import counted
from mbdae.symbolic.rebuild import LOGIC, ONE_SIDED, is_condition, nodes
from mbdae.symbolic.vectors import Expr
from mbdae.values import shown

TIME = se.Symbol("t")
#: functions that kernels can compile, their derivatives too
FUNCTIONS = (
    "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "exp", "log", "Piecewise",
    "atan2", "floor",
)
#: most characters of a text that is read or written; most levels of brackets, signs and right-hand operands inside each other
LONGEST, DEEPEST = 100_000, 120
#: most bits of an integer that arises while a text is read, and largest exponent: far more than in doubles written as fractions,
#: which have up to 1100 bits
MOST_BITS = 100_000
MOST_DIGITS = int(MOST_BITS * math.log10(2))  #: MOST_BITS in decimal digits, for messages

_TOKEN = re.compile(r"\s*(?:(?P<float>(?:\d+\.\d*|\.\d+)(?:[eE][+-]?\d+)?|\d+[eE][+-]?\d+)|(?P<integer>\d+)"
                    r"|(?P<sensor>(?:sensor\(\"(?:[^\"\\]|\\.)*\"\)|number\(\"[^\"\\]*\", [-+.\deE]+\)))|(?P<name>[A-Za-z]\w*)"
                    r"|(?P<sign>\*\*|<=|>=|==|!=|[-+*/(),<>&|~]))", re.ASCII)
_CONSTANTS: dict[str, Any] = {
    "t": TIME, "pi": se.pi, "E": se.E, "GoldenRatio": se.GoldenRatio, "EulerGamma": se.EulerGamma, "Catalan": se.Catalan,
    "True": se.true, "False": se.false,
}
_NUMBERS = ("Integer", "Rational", "RealDouble", "Zero", "One", "NegativeOne", "Half")
_PARTS = {*FUNCTIONS, *ONE_SIDED, *_NUMBERS, "Pi", "Exp1", "GoldenRatio", "EulerGamma", "Catalan", "Add", "Mul", "Pow", "Symbol"}
_RELATIONS: dict[str, Any] = {"<": se.Lt, "<=": se.Le, ">": se.Gt, ">=": se.Ge, "==": se.Eq, "!=": se.Ne}
_SIGNS = {"StrictLessThan": "<", "LessThan": "<=", "Equality": "==", "Unequality": "!="}
_JOINED = {"and": se.And, "&": se.And, "or": se.Or, "|": se.Or}
#: precedence of operators between two numbers or conditions: those with a higher number bind closer. Then the precedence of a
#: sign before a number, and of "not"
_STRENGTH = {"or": 1, "|": 1, "and": 2, "&": 2, **dict.fromkeys(_RELATIONS, 4), "+": 5, "-": 5, "*": 6, "/": 6, "**": 8}
_BEFORE_NUMBER, _NOT = 7, 3
#: functions with their numbers of arguments (None: two or more)
_FUNCTIONS: dict[str, tuple[int | None, Callable[..., Any]]] = {
    **{name: (1, getattr(se, name)) for name in FUNCTIONS if name not in ("Piecewise", "atan2")},
    **{name: (1, getattr(se, name)) for name in ("sqrt", "sign", "ceiling")}, "Abs": (1, se.Abs), "abs": (1, se.Abs),
    **dict.fromkeys(("Max", "max"), (None, se.Max)), **dict.fromkeys(("Min", "min"), (None, se.Min)),
    "atan2": (2, se.atan2), "Mod": (2, lambda a, b: a - b * se.floor(a / b)),
    "frac": (1, lambda a: a - se.floor(a)), "Heaviside": (1, lambda a: (1 + se.sign(a)) / 2),
}


# ---- writing -------------------------------------------------------------------------------------------------------------


def canonical(e: Expr) -> Expr:
    """The expression with terms in the order of its text, so that a stored expression has the same values to the last bit."""
    return read(written(e))


def written(e: Expr) -> str:
    """An expression of time as text, the same for all equal ones; ValueError where it is too long."""
    made: dict[Expr, str] = {}
    for node in nodes(e):
        made[node] = _written(node, [made[part] for part in node.args])
        if len(made[node]) > LONGEST:
            raise ValueError(f"written out it takes more than {LONGEST} characters; state a shorter one, or a table (mb.table)")
    return made[e]


def _written(node: Expr, args: list[str]) -> str:
    name = node.get_name() if isinstance(node, se.FunctionSymbol) else type(node).__name__
    if name in _NUMBERS:
        text = repr(_finite(float(node))) if name == "RealDouble" else str(node)
        return f"({text})" if text.startswith("-") or "/" in text else text
    if not args:
        return str(node)
    if name in ("Add", "Mul"):
        return f"({(' + ' if name == 'Add' else '*').join(sorted(args))})"
    if name == "Pow":
        return f"exp({args[1]})" if node.args[0] == se.E else f"({args[0]}**{args[1]})"
    if name in _SIGNS:
        return f"({args[0]} {_SIGNS[name]} {args[1]})"
    if name == "Piecewise":
        return f"Piecewise({', '.join(f'({v}, {c})' for v, c in zip(args[::2], args[1::2], strict=True))})"
    return f"{name}({', '.join(sorted(args) if name in LOGIC else args)})"


# ---- reading -------------------------------------------------------------------------------------------------------------


class _Read(NamedTuple):
    """A part that was read; bits: upper bound of the bits of the integers in it."""

    e: Any
    bits: int


def read(text: Any) -> Expr:
    """The expression of time a text stands for; raises ValueError with the reason where it is none."""
    e = whole(text)
    if is_condition(e):
        raise ValueError("it is a condition, where a number is expected: give an expression such as 2*sin(3*t)")
    return e


def whole(text: Any) -> Expr:
    """The expression or condition a text stands for; raises ValueError with the reason where it is none."""
    if not isinstance(text, str):
        raise ValueError(f"it is no text but {shown(text)}; give a text such as '2*sin(3*t)'")
    if len(text) > LONGEST:
        raise ValueError(f"it has {len(text)} characters; give a text of up to {LONGEST} characters")
    try:
        e = _Reader(text).whole()
    except (RuntimeError, OverflowError, ZeroDivisionError, TypeError, RecursionError, NotImplementedError) as reason:
        raise ValueError(f"it cannot be calculated ({reason}): leave out what has no finite real value") from reason
    for part in nodes(e):
        name = type(part).__name__
        if name == "RealDouble":
            _finite(float(part))
        if not (name in _PARTS or is_condition(part) or tables.lookup_of(part)):
            if str(part).lstrip("-") in ("zoo", "oo", "nan"):
                raise ValueError("it contains a division by zero or an infinite number: give finite numbers")
            raise ValueError(f"it contains '{part}', which is neither a real number nor a function that expressions of t may "
                             f"use: leave it out")
    return e


class _Reader:
    """Reads a text from left to right, by the precedence of its operators (`_STRENGTH`)."""

    def __init__(self, text: str) -> None:
        self.tokens, at = list[tuple[str, str]](), 0
        while at < len(text.rstrip()):
            found = _TOKEN.match(text, at)
            if not found:
                raise ValueError(f"{text[at : at + 20].strip()!r} cannot be part of an expression of t")
            self.tokens.append((str(found.lastgroup), found[str(found.lastgroup)]))
            at = found.end()
        self.tokens.append(("end", "the end"))
        self.at = self.depth = 0

    def whole(self) -> Any:
        """Read the whole text."""
        found = self._expression(0)
        self._expect("the end")
        return found.e

    def _next(self) -> str:
        return self.tokens[self.at][1]

    def _expect(self, sign: str) -> None:
        if self._next() != sign:
            raise ValueError(f"{_quoted(sign)} is expected, not {_quoted(self._next())}")
        self.at += 1

    def _expression(self, strength: int) -> _Read:
        """The expression from here to the next operator of the precedence `strength` or a lower one."""
        self.depth += 1
        if self.depth > DEEPEST:
            raise ValueError(f"its brackets, signs and powers are nested more than {DEEPEST} deep: write it with fewer")
        left = self._begin()
        while _STRENGTH.get(self._next(), 0) > strength:
            sign = self._next()
            left = self._chain(left, sign) if sign in "+-*/" else self._joined(left, sign) if sign in _JOINED else self._pair(
                left, sign)
        self.depth -= 1
        return left

    def _begin(self) -> _Read:
        if self._next() in "+-":
            negative = self._next() == "-"
            self.at += 1
            found = _value(self._expression(_BEFORE_NUMBER))
            return _Read(-found.e, found.bits) if negative else found
        kind, text = self.tokens[self.at]
        self.at += 1
        if text in ("not", "~"):
            return _Read(se.Not(_condition(found := self._expression(_NOT)).e), found.bits)
        if kind == "float":
            return _Read(se.RealDouble(_finite(float(text))), 1)
        if kind == "integer":
            if len(text) > MOST_BITS // 4:
                raise ValueError(f"it contains a number of more than {MOST_BITS // 4} digits: round that number")
            return _Read(se.Integer(int(text) if len(text) < 4000 else _long(text)), 4 * len(text))
        if kind == "sensor":
            return _Read(se.Symbol(text), 1)
        if kind == "name":
            return self._named(text)
        if text != "(":
            raise ValueError(f"a number, t, a sensor, a function or a bracket is expected, not {_quoted(text)}")
        found = self._expression(0)
        self._expect(")")
        return found

    def _chain(self, first: _Read, sign: str) -> _Read:
        """Sums, and products with quotients: all their terms at once, in the order of the text."""
        terms, signs = [_value(first)], ("+-" if sign in "+-" else "*/")
        while self._next() in signs and self.tokens[self.at][0] == "sign":
            inverse = self._next() == signs[1]
            self.at += 1
            term = _value(self._expression(_STRENGTH[sign]))
            terms.append(_Read(-term.e if signs == "+-" else term.e**-1, term.bits) if inverse else term)
        bits = _bounded(sum(term.bits for term in terms))
        return _Read((se.Add if signs == "+-" else se.Mul)(*(term.e for term in terms)), bits)

    def _joined(self, left: _Read, sign: str) -> _Read:
        """Two conditions, joined by and, or, & or |."""
        self.at += 1
        right = _condition(self._expression(_STRENGTH[sign]))
        return _Read(_JOINED[sign](_condition(left).e, right.e), _bounded(left.bits + right.bits))

    def _pair(self, left: _Read, sign: str) -> _Read:
        """A power or a comparison; of a chain such as a < b < c all comparisons have to hold."""
        self.at += 1
        if sign != "**":
            right = _value(self._expression(_STRENGTH[sign]))
            found = _Read(_RELATIONS[sign](_value(left).e, right.e), left.bits + right.bits)
            if self._next() not in _RELATIONS:
                return found
            rest = self._pair(right, self._next())
            return _Read(se.And(found.e, rest.e), _bounded(found.bits + rest.bits))
        right = _value(self._expression(_STRENGTH[sign] - 1))
        # a power whose result is not too large: 9**9**9 would take for ever
        base = _value(left)
        times = 1
        if right.e.is_number:
            size = abs(float(right.e))
            if not size <= MOST_BITS:
                raise ValueError(f"the exponent {shown(right.e)} is no number up to {MOST_BITS} in magnitude: use a smaller one")
            times = math.ceil(size) or 1
        return _Read(base.e**right.e, _bounded(base.bits * times + right.bits))

    def _named(self, name: str) -> _Read:
        if self._next() != "(" or self.tokens[self.at][0] != "sign":
            if name not in _CONSTANTS:
                raise ValueError(f"{name!r} is unknown: write a sensor by its path, such as 'rod.position[0]', or one of "
                                 f"{', '.join(_CONSTANTS)}")
            return _Read(_CONSTANTS[name], 1)
        if name == "Piecewise":
            return self._piecewise()
        arguments = self._arguments()
        bits = _bounded(sum(a.bits for a in arguments))
        if name in LOGIC:
            if not all(is_condition(a.e) for a in arguments) or (name == "Not" and len(arguments) != 1):
                raise ValueError(f"{name} takes {'one condition' if name == 'Not' else 'conditions'}, such as t > 1, alone")
            return _Read(getattr(se, name)(*(a.e for a in arguments)), bits)
        if tables.named(name) is not None and len(arguments) == 1:
            return _Read(se.Function(name)(_value(arguments[0]).e), bits)
        if name not in _FUNCTIONS:
            raise ValueError(f"{name!r} is none of the functions {', '.join([*_FUNCTIONS, 'Piecewise', *LOGIC])}")
        count, function = _FUNCTIONS[name]
        if len(arguments) != count and not (count is None and len(arguments) > 1):
            takes = counted(count, "argument") if count else "two or more arguments"
            raise ValueError(f"{name} takes {takes}, not {len(arguments)}")
        return _Read(function(*(_value(a).e for a in arguments)), bits)

    def _arguments(self) -> list[_Read]:
        self._expect("(")
        found = [self._expression(0)]
        while self._next() == ",":
            self.at += 1
            found.append(self._expression(0))
        self._expect(")")
        return found

    def _piecewise(self) -> _Read:
        """Pieces (value, condition), the last of which holds wherever no other does."""
        pieces, bits = list[tuple[Any, Any]](), 0
        self._expect("(")
        while True:
            piece = self._arguments()
            if len(piece) != 2 or not is_condition(piece[1].e):
                raise ValueError("a Piecewise consists of pairs (value, condition), as in Piecewise((1, t < 2), (0, True))")
            pieces.append((_value(piece[0]).e, piece[1].e))
            bits = _bounded(bits + piece[0].bits + piece[1].bits)
            if self._next() != ",":
                break
            self.at += 1
        self._expect(")")
        return _Read(se.Piecewise(*pieces[:-1], (pieces[-1][0], se.true)), bits)


def _quoted(token: str) -> str:
    """A token in a message."""
    return "the end of the text" if token == "the end" else repr(token)


def _value(part: _Read) -> _Read:
    if is_condition(part.e):
        raise ValueError(f"the condition {shown(part.e)} stands where a number is expected: give a number that depends on it, "
                         f"such as Piecewise((1, t > 2), (0, True))")
    return part


def _condition(part: _Read) -> _Read:
    if not is_condition(part.e):
        raise ValueError(f"{shown(part.e)} stands beside and, or, not, &, | or ~, where a condition such as t > 1 is expected")
    return part


def _finite(number: float) -> float:
    if not math.isfinite(number):
        raise ValueError("it contains a number that is infinite, undefined or beyond 1.8e308: give finite numbers")
    return number


def _bounded(bits: int) -> int:
    if bits > MOST_BITS:
        raise ValueError(f"its whole numbers may grow to more than {MOST_DIGITS} digits: use smaller numbers and exponents")
    return bits


def _long(digits: str) -> int:
    """A whole number of more digits than Python reads at once."""
    half = len(digits) // 2
    return int(digits) if half < 2000 else _long(digits[:-half]) * 10**half + _long(digits[-half:])
