"""Properties of the functions in statements and inputs: how fast they vary, which can be used, and atan2 of complex numbers.

A steep function has a width: the change of its argument u over which the function changes by a substantial part of itself. PHI(u)
is u on a scale where one width has length 1, so that a change of PHI counts widths; it is constant where the function is flat.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from functools import lru_cache
from typing import Any

import numpy as np
import symengine as se

from mbdae.symbolic.rebuild import is_condition, joined, nodes
from mbdae.values import shown

Scale = Callable[[Any], Any]

#: function -> kind: how it changes with its argument (`system.base.Switches` describes the kinds)
KINDS = {
    "tanh": "saturating", "erf": "saturating", "erfc": "saturating", "coth": "arc", "sech": "saturating", "csch": "arc",
    "atan": "arc", "acot": "arc", "asinh": "arc", "asin": "periodic", "acos": "periodic", "atanh": "periodic", "acosh": "arc",
    "sin": "periodic", "cos": "periodic", "tan": "periodic", "cot": "periodic", "sec": "periodic", "csc": "periodic",
    "sinh": "growing", "cosh": "growing", "log": "power", "abs": "kink", "Abs": "kink", "sign": "kink",
}  # fmt: skip


#: kinds of expressions that symengine differentiates and compiles; others are tried, see `unusable`
USABLE = {*KINDS, "Symbol", "Add", "Mul", "Pow", "atan2", "floor", "ceiling", "Max", "Min", "Piecewise", "asec", "acsc", "asech",
          "acsch", "acoth", "UnevaluatedExpr"}  # fmt: skip
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
                   f"se.Piecewise((a, x > 0), (b, True))"  # fmt: skip
        if kind == "Piecewise" and node.args[-1] != se.true:
            return f"{shown(node)}, which has no value where none of its conditions holds; end it with (value, True)"
        if kind == "Pow" and node.args[1].free_symbols and _without_powers(node.args[0]):
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


def _without_powers(base: Any) -> bool:
    """Whether an expression is a number whose powers are no real numbers for all exponents, 0 or a negative one."""
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
            "periodic": lambda u: u}  # fmt: skip


def complex_atan2(y: Any, x: Any) -> Any:
    """atan2 whose imaginary part is exact to first order, as derivatives by the complex step need it."""
    real = np.arctan2(np.real(y), np.real(x))
    if not (np.iscomplexobj(y) or np.iscomplexobj(x)):
        return real
    slope = (np.real(x) * np.imag(y) - np.real(y) * np.imag(x)) / (np.real(x) ** 2 + np.real(y) ** 2)
    return real + 1j * slope
