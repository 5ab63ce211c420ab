"""Inputs: numbers or expressions of the time symbol `mb.t`, in one canonical form.

One-sided functions (Abs, sign, Heaviside, Max, Min) become Piecewise, Mod and ceiling become floor. What switches is then
either a condition of a Piecewise or a floor. Between two switching instants none of them changes, so `sided` lets them read a
second symbol, `SIDE`: a time inside the interval that is meant. An instant of switching itself then has two values, one for
either side of it, and every expression is smooth up to both its ends.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.symbolic.vectors import Expr

TIME, SIDE = se.Symbol("t"), se.Symbol("t_of_conditions")
#: functions with derivatives the kernels can compile
FUNCTIONS = (
    "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "exp", "log", "Piecewise",
    "floor",
)  # fmt: skip
#: functions that are rewritten with those above, and what joins conditions
REWRITTEN = ("Abs", "sign", "Heaviside", "Max", "Min", "Mod", "ceiling", "frac")
LOGIC = ("And", "Or", "Not", "Xor", "ITE")


@lru_cache(maxsize=1)
def time_symbol() -> Any:
    """The SymPy symbol `mb.t`."""
    import sympy

    return sympy.Symbol("t")


def expression(value: Any) -> Expr:
    """A number or expression of time as symengine sees it; raises TypeError or ValueError with the reason."""
    if isinstance(value, bool | str):
        raise TypeError(f"{value!r} is neither a number nor an expression of mb.t")
    try:
        e = se.sympify(_supported(value))
    except (TypeError, RuntimeError, AttributeError, se.SympifyError) as error:
        raise TypeError(f"{value!r} is neither a number nor an expression of mb.t") from error
    if not isinstance(e, se.Basic) or isinstance(e, se.DenseMatrix):
        raise TypeError(f"{value!r} is neither a number nor an expression of mb.t")
    others = sorted(str(s) for s in e.free_symbols if s != TIME)
    if others:
        raise ValueError(f"{value} contains the symbol {others[0]}; only mb.t may appear")
    return e


def _supported(value: Any) -> Any:
    """A SymPy expression in canonical form; refuses what has no value or no derivative."""
    if not getattr(value, "free_symbols", None):
        return value
    if isinstance(value, se.Basic) and _canonical(value):
        return value
    import sympy

    value = sympy.sympify(value)
    if value.has(sympy.zoo, sympy.nan, sympy.oo, -sympy.oo):
        raise ValueError(f"{value} is not finite")
    real = sympy.Symbol("t", real=True)  # conditions of complex numbers cannot be stated
    value = _rewritten(value.subs(time_symbol(), real)).subs(real, time_symbol())
    if value.has(sympy.I):
        raise ValueError(f"{value} is not real")
    used = {type(f).__name__ for f in value.atoms(sympy.core.function.Application)}
    unknown = sorted(used - {*FUNCTIONS, *LOGIC})
    if unknown:
        known = ", ".join(FUNCTIONS + REWRITTEN)
        raise ValueError(f"{value} contains the function {unknown[0]}; expressions of mb.t may use {known}")
    for piecewise in value.atoms(sympy.Piecewise):
        if not _complete(piecewise):
            raise ValueError(f"{piecewise} has no value where none of its conditions holds; end it with (value, True)")
    return value


def _canonical(e: Expr) -> bool:
    """Whether a symengine expression contains nothing that has to be rewritten or refused."""
    names = {type(node).__name__ for node in nodes(e)}
    numbers = {"Integer", "Rational", "RealDouble", "Zero", "One", "NegativeOne", "Half", "Pi", "Exp1"}
    return names <= {*FUNCTIONS, "Add", "Mul", "Pow", "Symbol", *numbers} - {"Piecewise"}


def _rewritten(e: Any) -> Any:
    import sympy as sp

    def steps(x: Any, at_zero: Any = None) -> Any:
        return sp.Piecewise((1, x > 0), (0, x < 0), (sp.Rational(1, 2) if at_zero is None else at_zero, True))

    def largest(*args: Any) -> Any:
        first, *others = args
        for other in others:
            first = sp.Piecewise((first, first >= other), (other, True))
        return first

    def smallest(*args: Any) -> Any:
        return -largest(*(-a for a in args))

    rules: dict[Any, Any] = {
        sp.Abs: lambda x: sp.Piecewise((x, x >= 0), (-x, True)),
        sp.sign: lambda x: sp.Piecewise((1, x > 0), (-1, x < 0), (0, True)),
        sp.Heaviside: steps, sp.Max: largest, sp.Min: smallest,
        sp.Mod: lambda x, period: x - period * sp.floor(x / period),
        sp.ceiling: lambda x: -sp.floor(-x), sp.frac: lambda x: x - sp.floor(x),
        sp.ITE: lambda c, a, b: sp.Or(sp.And(c, a), sp.And(sp.Not(c), b)),
    }  # fmt: skip
    for function, rule in rules.items():
        e = e.replace(function, rule)
    return e


def _complete(piecewise: Any) -> bool:
    """Whether one of the conditions always holds."""
    import sympy

    conditions = [condition for _, condition in piecewise.args]
    return bool(conditions[-1] == True or sympy.simplify_logic(sympy.Or(*conditions)) == True  # noqa: E712
                or sympy.Or(*conditions).simplify() == True)  # fmt: skip  # noqa: E712


# ---- sides of an instant -------------------------------------------------------------------------------------------------


def nodes(e: Expr) -> list[Expr]:
    """Every subexpression once, what it contains before itself; conditions included."""
    found: dict[Expr, None] = {}

    def visit(node: Expr) -> None:
        if node not in found:
            for part in node.args:
                visit(part)
            found[node] = None

    visit(e)
    return list(found)


def sided(e: Expr) -> Expr:
    """The expression with `SIDE` for the time in its conditions and floors; unchanged where it has them already."""
    if not any(isinstance(node, se.Piecewise) or type(node).__name__ == "floor" for node in nodes(e)):
        return e
    made: dict[Expr, Expr] = {}
    for node in nodes(e):
        args = node.args
        if isinstance(node, se.Piecewise):
            pairs = [(made[args[i]], args[i + 1].subs({TIME: SIDE})) for i in range(0, len(args), 2)]
            made[node] = se.Piecewise(*pairs)
        elif type(node).__name__ == "floor":
            made[node] = node.subs({TIME: SIDE})
        elif args and not is_condition(node):
            made[node] = node.func(*(made[part] for part in args))
        else:
            made[node] = node
    return made[e]


def is_condition(node: Expr) -> bool:
    """Whether a node is a relation, or conditions joined."""
    return type(node).__name__ in ("StrictLessThan", "LessThan", "Equality", "Unequality", "BooleanTrue", "BooleanFalse", *LOGIC)


def derivatives(e: Expr) -> tuple[Expr, Expr, Expr]:
    """The expression and its first two time derivatives, with sides."""
    e = sided(e)
    d = se.diff(e, TIME)
    return e, d, se.diff(d, TIME)


def values(e: Expr, times: NDArray[np.float64], sides: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """The expression at times (k,); sides (k,): times at which its conditions are read, by default the same."""
    times = np.asarray(times, dtype=float)
    if not e.free_symbols:
        return np.full(len(times), float(e))
    inputs = np.stack([times, times if sides is None else sides], axis=1)
    with np.errstate(all="ignore"):
        return np.asarray(_compiled(sided(e))(inputs)).reshape(-1)


def value_at(e: Any, t: float) -> float:
    """An input, a number or an expression, at one time."""
    return float(values(se.sympify(e), np.array([t]))[0])


def rate_at(e: Any, t: float) -> float:
    """The time derivative of an input at one time."""
    return float(values(derivatives(se.sympify(e))[1], np.array([t]))[0])


@lru_cache(maxsize=256)
def _compiled(e: Expr) -> Any:
    return se.Lambdify([TIME, SIDE], [e], backend="llvm")
