"""Expressions rebuilt with some of their parts replaced: one-sided functions, exponentials that would overflow.

Properties of the functions in statements and inputs: how fast they vary, which can be used, and atan2 of complex numbers.

A steep function has a width: the change of its argument u over which the function changes by a substantial part of itself. PHI(u)
is u on a scale where one width has length 1, so that a change of PHI counts widths; it is constant where the function is flat.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from functools import lru_cache
from typing import Any

import numpy as np
import symengine as se

from mbdae.symbolic.vectors import Expr
from mbdae.values import shown

LOGIC = ("And", "Or", "Not", "Xor")  #: connectives of conditions
#: name of a relation or connective -> function that makes it
CONDITIONS: dict[str, Any] = {"StrictLessThan": se.Lt, "LessThan": se.Le, "Equality": se.Eq, "Unequality": se.Ne,
                               **{name: getattr(se, name) for name in LOGIC}}
ONE_SIDED = ("Abs", "Max", "Min", "sign", "ceiling", "UnevaluatedExpr")  #: functions that are rewritten with Piecewise and floor
STEPPED = ("floor", "ceiling", "sign", "Piecewise")  #: functions that jump where their derivatives do not show it
LARGEST = 300.0  #: bound of exponents in denominators: exp(-300) = 5e-131 is as good as 0, and exp(300)^2 does not overflow


def nodes(e: Expr) -> list[Expr]:
    """Every subexpression once, after its own parts; conditions included."""
    found: dict[Expr, None] = {}

    def visit(node: Expr) -> None:
        if node not in found:
            for part in node.args:
                visit(part)
            found[node] = None

    visit(e)
    return list(found)


def symbols_of(expressions: Iterable[Any]) -> set[Expr]:
    """The symbols in some expressions, in one pass: much faster than one after the other where they share parts."""
    row = list(map(se.sympify, expressions))
    return set(se.Matrix(1, len(row), row).free_symbols) if row else set()


def substituted(e: Expr, table: dict[Expr, Expr]) -> Expr:
    """e with its symbols replaced by their values in a table, where they have one."""
    return e.subs({x: table[x] for x in e.free_symbols if x in table})


def rebuilt(e: Expr, rule: Callable[[Expr, list[Expr]], Expr | None]) -> Expr:
    """The expression with every part, from the inside out, replaced by what rule(part, its arguments) gives; None keeps it."""
    made: dict[Expr, Expr] = {}
    for node in nodes(e):
        args = [made[part] for part in node.args]
        found = rule(node, args)
        made[node] = found if found is not None else node if list(node.args) == args else joined(node, args)
    return made[e]


def joined(node: Expr, args: list[Expr]) -> Expr:
    """The function or condition of a node, with other arguments."""
    if isinstance(node, se.Piecewise):
        return se.Piecewise(*((args[i], args[i + 1]) for i in range(0, len(args), 2)))
    if isinstance(node, se.FunctionSymbol):
        return se.Function(node.get_name())(*args)
    make = CONDITIONS.get(type(node).__name__)
    return make(*args) if make is not None else node.func(*args)


def is_condition(node: Expr) -> bool:
    """Whether a node is a condition: a relation, relations joined by logic, True or False."""
    name = type(node).__name__
    return name in CONDITIONS or name in ("BooleanTrue", "BooleanFalse")


def jumps_with(e: Expr, symbols: set[Expr]) -> bool:
    """Whether an expression contains a function that jumps and is constant elsewhere, of an argument with some of the symbols."""
    return any(type(node).__name__ in STEPPED and node.free_symbols & symbols for node in nodes(e))


def one_sided(e: Expr) -> Expr:
    """The expression with Piecewise for Abs, sign, Max and Min, and floor for ceiling: functions that have derivatives. Brackets
    (UnevaluatedExpr) are left out."""

    def rule(node: Expr, args: list[Expr]) -> Expr | None:
        name = type(node).__name__
        if name in ("Max", "Min"):
            return _extreme(args, largest=name == "Max")
        if name == "Abs":
            return se.Piecewise((args[0], args[0] >= 0), (-args[0], True))
        if name == "sign":
            return se.Piecewise((se.Integer(1), args[0] > 0), (se.Integer(-1), args[0] < 0), (se.Integer(0), True))
        if name == "UnevaluatedExpr":
            return args[0]
        return -se.floor(-args[0]) if name == "ceiling" else None

    e = se.sympify(e)
    return rebuilt(e, rule) if any(type(node).__name__ in ONE_SIDED for node in nodes(e)) else e


def _extreme(args: list[Expr], largest: bool) -> Expr:
    found = args[0]
    for other in args[1:]:
        found = se.Piecewise((found, found >= other if largest else found <= other), (other, True))
    return found


def without_overflow(e: Expr) -> Expr:
    """The expression with bounded exponentials in its denominators.

    1/cosh(u) and 1/(1 + exp(u)) are small for large u, but their derivatives are then quotients of two numbers that overflow.
    Where |u| exceeds `LARGEST`, the exponential keeps its value at that limit."""
    e = se.sympify(e)
    if not any(_overflows(node) for node in nodes(e)):
        return e

    def bounded(node: Expr, args: list[Expr]) -> Expr | None:
        if isinstance(node, se.Piecewise) and se.RealDouble(LARGEST) in node.args[1].args:
            return node  # it is bounded already
        if not _overflows(node):
            return None
        u = args[1] if isinstance(node, se.Pow) else args[0]
        function = se.exp if isinstance(node, se.Pow) else node.func
        most, least = (function(se.RealDouble(end)) for end in (LARGEST, -LARGEST))
        return se.Piecewise((most, u > LARGEST), (least, u < -LARGEST), (function(u), True))

    def rule(node: Expr, args: list[Expr]) -> Expr | None:
        below = isinstance(node, se.Pow) and node.args[1].is_number and float(node.args[1]) < 0
        return rebuilt(args[0], bounded) ** args[1] if below else None

    return rebuilt(e, rule)


def _overflows(node: Expr) -> bool:
    """Whether a node is exp, cosh or sinh of something that varies; symengine's exp is a power of e."""
    exponential = isinstance(node, se.Pow) and node.args[0] == se.E and bool(node.args[1].free_symbols)
    return exponential or type(node).__name__ in ("cosh", "sinh")


Scale = Callable[[Any], Any]

#: function -> kind: how it changes with its argument (`system.base.Switches` describes the kinds)
KINDS = {
    "tanh": "saturating", "erf": "saturating", "erfc": "saturating", "coth": "arc", "sech": "saturating", "csch": "arc",
    "atan": "arc", "acot": "arc", "asinh": "arc", "asin": "periodic", "acos": "periodic", "atanh": "periodic", "acosh": "arc",
    "sin": "periodic", "cos": "periodic", "tan": "periodic", "cot": "periodic", "sec": "periodic", "csc": "periodic",
    "sinh": "growing", "cosh": "growing", "log": "power", "abs": "kink", "Abs": "kink", "sign": "kink",
}


#: kinds of expressions that symengine differentiates and compiles; others are tried, see `unusable`
USABLE = {*KINDS, "Symbol", "Add", "Mul", "Pow", "atan2", "floor", "ceiling", "Max", "Min", "Piecewise", "asec", "acsc", "asech",
          "acsch", "acoth", "UnevaluatedExpr"}
#: functions of mbdae's own: names of intermediate results, time derivatives, tables
OWN = ("let", "rate", "table_")
OTHER_FUNCTIONS = "state it by other functions, such as se.sin, se.exp, se.sqrt, or by cases: se.Piecewise((a, x > 0), (b, True))"


def unusable(e: Any, fixed: Collection[Any] | None = ()) -> str:
    """Why an expression cannot be differentiated and compiled, in words, with a remedy; "" where it can. fixed: symbols by which
    it is not differentiated; None: it is not differentiated at all, and not compiled."""
    for node in nodes(se.sympify(e)):
        kind = type(node).__name__
        if not is_condition(node) and kind != "Piecewise" and any(is_condition(part) for part in node.args):
            return f"the condition {next(filter(is_condition, node.args))} where a number is needed; state cases by " \
                   f"se.Piecewise((a, x > 0), (b, True))"
        if kind == "Piecewise" and node.args[-1] != se.true:
            return f"{shown(node)}, which has no value where none of its conditions holds; end it with (value, True)"
        if without_powers(node):
            return f"{shown(node)}, a power whose base is not positive: no real number for most exponents; state it by cases"
        if node.is_Number or not (node.args or kind in USABLE or is_condition(node)):
            if not _is_finite(node):
                return f"{node}, which is no real, finite number; look for a division by 0, or for numbers that are too large"
        elif isinstance(node, se.FunctionSymbol) and kind == "FunctionSymbol":
            if not node.get_name().startswith(OWN):
                return f"{shown(node)}, a function that is only a name; {OTHER_FUNCTIONS}"
        elif kind not in USABLE and not is_condition(node) and not _works(node, fixed):
            return f"{shown(node)}, a function whose derivatives cannot be compiled; {OTHER_FUNCTIONS}"
    return ""


def without_powers(e: Any) -> bool:
    """Whether an expression is a power, with an exponent that varies, of 0 or a negative number, which has no real value for most
    exponents."""
    if type(e).__name__ != "Pow" or not e.args[1].free_symbols:
        return False
    base = e.args[0]
    return not base.free_symbols and _is_finite(base) and float(base) <= 0


def _is_finite(number: Any) -> bool:
    try:
        return math.isfinite(float(number))
    except Exception:  # complex numbers and infinities of symengine
        return False


def _works(node: Any, fixed: Collection[Any] | None) -> bool:
    foreign = type(node).__name__ in ("PyFunction", "Derivative", "Subs")
    if foreign or fixed is None:
        return not foreign
    symbols = [se.Symbol(f"x{i}") for i in range(len(node.args))]
    try:
        return _compiles(joined(node, symbols), node.free_symbols <= set(fixed))
    except Exception:  # the function takes numbers of one kind only
        return False


@lru_cache(maxsize=256)
def _compiles(e: Any, fixed: bool) -> bool:
    """Whether LLVM compiles a function and, where its arguments are not fixed, its first and second derivatives."""
    symbols = sorted(e.free_symbols, key=str)
    slopes = [] if fixed else [se.diff(e, s) for s in symbols]
    try:
        se.Lambdify(symbols, [e, *slopes, *(se.diff(d, s) for d in slopes for s in symbols)], backend="llvm")
    except Exception:  # symengine says by errors of all kinds that it does not know a function
        return False
    return True


def limited(low: float, high: float) -> Scale:
    """PHI(u) = u between two limits, constant beyond them."""
    return lambda u: np.minimum(np.maximum(u, low), high)


def scales(saturated: float, steep: float) -> dict[str, Scale]:
    """PHI by kind; saturated, steep: largest |u| at which a saturating or a growing function is followed."""
    return {"saturating": limited(-saturated, saturated), "growing": limited(-steep, steep), "arc": np.arcsinh,
            "periodic": lambda u: u}


def complex_atan2(y: Any, x: Any) -> Any:
    """atan2 whose imaginary part is exact to first order, as derivatives by the complex step need it."""
    real = np.arctan2(np.real(y), np.real(x))
    if not (np.iscomplexobj(y) or np.iscomplexobj(x)):
        return real
    slope = (np.real(x) * np.imag(y) - np.real(y) * np.imag(x)) / (np.real(x) ** 2 + np.real(y) ** 2)
    return real + 1j * slope
