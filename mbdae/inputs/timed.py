"""Inputs: numbers or expressions of the time symbol `mb.t`, in one canonical form.

One-sided functions (Abs, sign, Heaviside, Max, Min) become Piecewise, Mod and ceiling become floor. Only conditions of Piecewise
and floors then switch, at instants called breaks. Between two breaks they are constant, so `sided` gives them a time of their
own, the symbol `SIDE`: any time inside the interval of interest. At a break an expression then has two values, one for each
side of it, and it is smooth on every interval including both ends.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.disk.entries import keep, recall
from mbdae.disk.exact import code_key
from mbdae.inputs import tables
from mbdae.inputs.deferred_time import Timed
from mbdae.inputs.sensed import refuse_symbols
from mbdae.inputs.text import FUNCTIONS, canonical
from mbdae.inputs.text import TIME as TIME
from mbdae.symbolic.rebuild import LOGIC, ONE_SIDED, is_condition, nodes, one_sided, rebuilt, without_overflow
from mbdae.symbolic.vectors import Expr
from mbdae.values import BadValueError, number, shown

SIDE = se.Symbol("t_of_conditions")
#: functions that are rewritten with Piecewise and floor
REWRITTEN = ("Abs", "sign", "Heaviside", "Max", "Min", "Mod", "ceiling", "frac")
HUGE = 100.0  #: logarithm of a factor above which it stays in the exponent


def expression(value: Any, sensors: bool = False) -> Expr:
    """A number or expression of time as symengine sees it, its numbers plain; raises BadValueError with the reason. sensors:
    whether it may depend on sensors too."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if type(value) is Timed:
        value = _of_symengine(value)
    if callable(value) and not isinstance(value, type) and not hasattr(value, "free_symbols"):
        raise BadValueError(f"{shown(value)} is a function of Python: write what it returns as an expression of mb.t, with the "
                            f"functions of SymPy, such as 2*sympy.sin(3*mb.t)")  # fmt: skip
    if not _has_symbols(value):
        return _plain_number(value)
    _refuse_other_time(value)
    try:
        e = _canonical(value)
    except BadValueError:
        raise
    except Exception as error:  # SymPy may raise anything
        raise BadValueError(f"{shown(value)} is neither a number nor an expression of mb.t") from error
    if not isinstance(e, se.Basic) or isinstance(e, se.DenseMatrix) or is_condition(e):
        raise BadValueError(f"{shown(value)} is neither a number nor an expression of mb.t")
    refuse_symbols(value, e.free_symbols - {TIME}, sensors)
    if not e.free_symbols:
        return _plain_number(e)
    plain = _without_constant_tables(_with_plain_numbers(e))
    if not plain.free_symbols:
        return _plain_number(plain)
    try:
        return canonical(plain)
    except ValueError as error:
        raise BadValueError(f"{shown(value)} is no input of time: {error}") from error


def _of_symengine(value: Timed) -> Any:
    """In symengine, or in SymPy where that has something to rewrite or to refuse."""
    try:
        found = value._symengine_()
    except Exception:  # a division by zero, a number that symengine does not know: SymPy says what is wrong
        found = se.nan
    return found if _known(found) else value._sympy_()


def _without_constant_tables(e: Expr) -> Expr:
    """The expression with numbers for tables at a fixed time; refuses tables of anything but a*mb.t + b."""

    def rule(node: Expr, args: list[Expr]) -> Expr | None:
        found = tables.lookup_of(node)
        if found is None:
            return None
        a, b = affine(args[0]) if len(args) == 1 else (math.nan, 0.0)
        if not math.isfinite(a):
            raise BadValueError(f"{shown(e)} takes a table at {shown(args[0])}: a table is a function of mb.t or of a*mb.t + b")
        if a:
            return None
        return se.RealDouble(float(found.table.lookup(np.array([b]), after(np.array([b])), found.order)[0]))

    return rebuilt(e, rule)


def affine(x: Expr, symbol: Expr = TIME) -> tuple[float, float]:
    """a and b of x = a t + b; NaN where x is nothing of the kind."""
    a = se.diff(x, symbol) if all(isinstance(n, se.Add | se.Mul | se.Symbol) or n.is_number for n in nodes(x)) else symbol
    return (float(a), float(x.subs({symbol: 0}))) if a.is_number and x.free_symbols <= {symbol} else (math.nan, math.nan)


def _refuse_other_time(value: Any) -> None:
    """Refuse a symbol t with assumptions beyond real: SymPy may have simplified the expression by them."""
    for symbol in value.free_symbols:
        assumed = getattr(symbol, "_assumptions_orig", {}) if str(symbol) == str(TIME) else {}
        if set(assumed) - {"real", "commutative"}:
            raise BadValueError(f"{shown(value)} contains a symbol t of its own ({', '.join(map(str, assumed))}), which is not "
                                f"mb.t: use mb.t")  # fmt: skip


def _has_symbols(value: Any) -> bool:
    try:
        return bool(getattr(value, "free_symbols", None))
    except Exception:  # an object of the user's own
        return False


def _plain_number(value: Any) -> Expr:
    try:
        return se.RealDouble(number(value))
    except BadValueError as error:
        if "finite" in str(error) or "calculated" in str(error):
            raise
        raise BadValueError(f"{shown(value)} is neither a number nor an expression of mb.t") from error


def _with_plain_numbers(e: Expr) -> Expr:
    """The expression with doubles for numbers of more digits; refuses numbers that are not real and finite."""

    def rule(node: Expr, _: list[Expr]) -> Expr | None:
        if not getattr(node, "is_Number", False):
            return None
        try:
            size = abs(float(node))
        except (TypeError, ValueError, OverflowError, RuntimeError):
            size = math.inf
        if not math.isfinite(size):
            raise BadValueError(f"{shown(e)} contains the number {shown(node)}, which is not real, not finite or too large")
        return se.RealDouble(float(node)) if type(node).__name__ == "RealMPFR" else None

    return rebuilt(e, rule)


def _canonical(value: Any) -> Expr:
    """An expression in functions the kernels compile; refuses expressions without a value or a derivative."""
    if isinstance(value, se.Basic) and _known(value):
        return without_overflow(one_sided(value))
    import sympy

    value = sympy.sympify(value)
    if value.has(sympy.zoo, sympy.nan, sympy.oo, -sympy.oo):
        raise BadValueError(f"{shown(value)} is not finite")
    used = {type(f).__name__ for f in value.atoms(sympy.core.function.Application)}
    unknown = sorted(name for name in used - {*FUNCTIONS, *REWRITTEN, *LOGIC, "ITE"} if tables.named(name) is None)
    if unknown:
        known = ", ".join(FUNCTIONS + REWRITTEN)
        raise BadValueError(f"{shown(value)} contains the function {unknown[0]}; expressions of mb.t may use {known}")
    for piecewise in value.atoms(sympy.Piecewise):
        if not _complete(piecewise):
            raise BadValueError(f"{shown(piecewise)} has no value where none of its conditions holds; end it with (value, True)")
    if value.has(sympy.I):
        raise BadValueError(f"{shown(value)} is not real")
    return without_overflow(_rewritten(*_exponents(_without_steps(value))))


def _known(e: Expr) -> bool:
    """Whether a symengine expression contains nothing that SymPy has to rewrite or to refuse."""
    parts = nodes(e)
    if not all(part.args[-1] == se.true for part in parts if isinstance(part, se.Piecewise)):
        return False
    numbers = {"Integer", "Rational", "RealDouble", "Zero", "One", "NegativeOne", "Half", "Pi", "Exp1"}
    names = {type(part).__name__ for part in parts if not is_condition(part) and tables.lookup_of(part) is None}
    return names <= {*FUNCTIONS, *ONE_SIDED, "Add", "Mul", "Pow", "Symbol", *numbers}


def _without_steps(e: Any) -> Any:
    """A SymPy expression without the functions symengine does not know."""
    import sympy as sp

    rules: dict[Any, Any] = {
        sp.Heaviside: lambda x, at_zero=None: (1 + sp.sign(x)) / 2,
        sp.Mod: lambda x, period: x - period * sp.floor(x / period), sp.frac: lambda x: x - sp.floor(x),
        sp.ITE: lambda c, a, b: sp.Or(sp.And(c, a), sp.And(sp.Not(c), b)),
    }  # fmt: skip
    for function, rule in rules.items():
        e = e.replace(function, rule)
    return e


def _exponents(e: Any) -> tuple[Any, dict[str, Any]]:
    """The expression with a symbol for every exponential that SymPy has split into a number and a rest, exp(x - 5000) into
    1e-2171 exp(x): neither fits into a double although their product does. Symbols with their exponents, (rest, number)."""
    import sympy as sp

    found: dict[str, Any] = {}

    def huge(x: Any) -> bool:
        number = x.as_coeff_Mul()[0] if x.is_Mul else sp.S.One
        return bool(number.is_Float and number != 0 and abs(sp.log(abs(number))) > HUGE and any(a.func is sp.exp for a in x.args))

    def merged(x: Any) -> Any:
        number, rest = x.as_coeff_Mul()
        power = next(a for a in rest.as_ordered_factors() if a.func is sp.exp)
        name = f"exponential_{len(found)}"
        found[name] = power.args[0], float(sp.log(abs(number)))
        return sp.sign(number) * sp.Symbol(name, real=True) * (rest / power)

    return e.replace(huge, merged), found


def _rewritten(value: Any, exponents: dict[str, Any]) -> Expr:
    """In symengine, with the exponentials in their places and Piecewise for one-sided functions."""

    def rule(node: Expr, _: list[Expr]) -> Expr | None:
        if isinstance(node, se.Symbol) and str(node) in exponents:
            rest, number = exponents[str(node)]
            return se.exp(_rewritten(rest, exponents) + number)
        return None

    return one_sided(rebuilt(se.sympify(value), rule))


def _complete(piecewise: Any) -> bool:
    """Whether one of the conditions always holds."""
    import sympy

    conditions = [condition for _, condition in piecewise.args]
    return bool(conditions[-1] == True or sympy.simplify_logic(sympy.Or(*conditions)) == True  # noqa: E712
                or sympy.Or(*conditions).simplify() == True)  # fmt: skip  # noqa: E712


# ---- sides of an instant -------------------------------------------------------------------------------------------------


@lru_cache(maxsize=512)
def sided(e: Expr) -> Expr:
    """The expression with `SIDE` for the time in its conditions and floors, and as second argument of its tables; once."""
    if not any(isinstance(node, se.Piecewise | se.FunctionSymbol) or type(node).__name__ == "floor" for node in nodes(e)):
        return e

    def rule(node: Expr, args: list[Expr]) -> Expr | None:
        if isinstance(node, se.FunctionSymbol) and len(args) == 1 and TIME in node.free_symbols:
            return se.Function(node.get_name())(args[0], args[0].subs({TIME: SIDE}))
        if isinstance(node, se.Piecewise):
            conditions = [node.args[i].subs({TIME: SIDE}) for i in range(1, len(args), 2)]
            return se.Piecewise(*zip(args[::2], conditions, strict=True))
        return node.subs({TIME: SIDE}) if type(node).__name__ == "floor" else None

    return rebuilt(e, rule)


@lru_cache(maxsize=512)
def derivatives(e: Expr) -> tuple[Expr, Expr, Expr]:
    """The expression and its first two time derivatives, with sides."""
    d = rate(e := sided(e))
    return e, d, rate(d)


def rate(e: Expr) -> Expr:
    """The time derivative of a `sided` expression, whose floors are constant between two breaks."""
    fixed = {node: se.Dummy() for node in nodes(e) if type(node).__name__ == "floor" or tables.lookup_of(node) is not None}
    plain, back = e.subs(fixed), {symbol: node for node, symbol in fixed.items()}
    total = se.diff(plain, TIME).subs(back)
    for node, symbol in fixed.items():
        found = tables.lookup_of(node)
        if found is not None and TIME in node.free_symbols:
            slope = tables.function(found.table, found.order + 1)(*node.args) * se.diff(node.args[0], TIME)
            total += se.diff(plain, symbol).subs(back) * slope
    return total


def used(e: Expr, moves: bool) -> tuple[Expr, ...]:
    """What an input is followed by: itself; a table that prescribes a motion by its derivatives too, which jump more."""
    e = se.sympify(e)
    return tuple(dict.fromkeys(derivatives(e))) if moves and any(map(tables.lookup_of, nodes(e))) else (e,)


def values(e: Expr, times: NDArray[np.float64], sides: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """The expression at times (k,); sides (k,): times at which its conditions are read, by default the same."""
    times = np.asarray(times, dtype=float)
    if not e.free_symbols:
        return np.full(len(times), float(e))
    inputs = np.stack([times, times if sides is None else sides], axis=1)
    plain = split((sided(e),))
    with np.errstate(all="ignore"):
        return np.asarray(_compiled(plain)(plain.with_lookups(inputs))).reshape(-1)


class Reading(NamedTuple):
    """A table read at a*x + b; x: the time (column 0) or the time of conditions (column 1)."""

    lookup: tables.Lookup
    a: float
    b: float
    column: int


class Split(NamedTuple):
    """Expressions with a symbol for every table; the symbols, and how each table is read."""

    expressions: tuple[Expr, ...]
    symbols: tuple[Expr, ...]
    readings: tuple[Reading, ...]

    def with_lookups(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Times and sides (k, 2) with the values of the tables behind them."""
        read = [found.table.lookup(a * inputs[:, column] + b, a * inputs[:, 1] + b, found.order)
                for found, a, b, column in self.readings]  # fmt: skip
        return np.column_stack([inputs, *read]) if read else inputs


@lru_cache(maxsize=256)
def split(expressions: tuple[Expr, ...]) -> Split:
    """`sided` expressions, their tables taken out; a table in a condition is read at the time of conditions."""
    found: dict[Expr, tuple[Expr, Reading]] = {}

    def rule(node: Expr, args: list[Expr]) -> Expr | None:
        lookup = tables.lookup_of(node)
        if lookup is None:
            return None
        if node not in found:
            column = int(SIDE in args[0].free_symbols)
            found[node] = se.Symbol(f"lookup_{len(found)}"), Reading(lookup, *affine(args[0], SIDE if column else TIME), column)
        return found[node][0]

    plain = tuple(rebuilt(e, rule) for e in expressions)
    return Split(plain, tuple(s for s, _ in found.values()), tuple(one for _, one in found.values()))


def after(t: Any) -> Any:
    """Times just after t, at which conditions are evaluated at the start t of a run."""
    return t + 4 * np.spacing(np.abs(t))


def value_at(e: Any, t: float) -> float:
    """An input, a number or an expression, at the start t of a run."""
    return float(values(se.sympify(e), np.array([t]), np.array([after(t)]))[0])


def rate_at(e: Any, t: float) -> float:
    """The time derivative of an input at the start t of a run."""
    return float(values(derivatives(se.sympify(e))[1], np.array([t]), np.array([after(t)]))[0])


@lru_cache(maxsize=256)
def _compiled(plain: Split) -> Any:
    inputs, outputs = [TIME, SIDE, *plain.symbols], list(plain.expressions)
    key = code_key(inputs, outputs, None)
    if (found := recall(key)) is None:
        keep(key, found := se.Lambdify(inputs, outputs, backend="llvm"))
    return found
