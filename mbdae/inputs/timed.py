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

from mbdae.disk.entries import code_key, keep, recall
from mbdae.inputs import Timed, tables
from mbdae.inputs.sensed import is_plain, named_by, refuse_symbols, rewritten
from mbdae.inputs.text import TIME as TIME
from mbdae.inputs.text import canonical
from mbdae.symbolic.rebuild import is_condition, nodes, rebuilt
from mbdae.symbolic.vectors import Expr
from mbdae.values import BadValueError, number, shown

SIDE = se.Symbol("t_of_conditions")


def expression(value: Any, sensors: bool = False, named: bool = False) -> Expr:
    """A number or expression of time as a symengine expression whose numbers are doubles; raises BadValueError with the reason.
    sensors: whether it may depend on sensors too; named: whether named numbers (mb.number) stay in it."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if type(value) is Timed:
        # the expression in symengine, or in SymPy where SymPy has to rewrite it or to refuse it
        try:
            found = value._symengine_()
        except Exception:  # a division by zero, a number that symengine does not know: SymPy says what is wrong
            found = se.nan
        value = found if is_plain(found) else value._sympy_()
    if callable(value) and not isinstance(value, type) and not hasattr(value, "free_symbols"):
        raise BadValueError(f"{shown(value)} is a function of Python: write what it returns as an expression of mb.t, with the "
                            f"functions of SymPy, such as 2*sympy.sin(3*mb.t)")
    if not _has_symbols(value):
        return _plain_number(value)
    _refuse_other_time(value)
    try:
        e = rewritten(value)
    except BadValueError:
        raise
    except Exception as error:  # SymPy may raise anything
        raise BadValueError(f"{shown(value)} is neither a number nor an expression of mb.t") from error
    if not isinstance(e, se.Basic) or isinstance(e, se.DenseMatrix) or is_condition(e):
        raise BadValueError(f"{shown(value)} is neither a number nor an expression of mb.t")
    refuse_symbols(value, {s for s in e.free_symbols if s != TIME and not (named and named_by(s))}, sensors)
    if not e.free_symbols:
        return _plain_number(e)
    plain = _with_usual_tables(_with_plain_numbers(e))
    if not plain.free_symbols:
        return _plain_number(plain)
    try:
        return canonical(plain)
    except ValueError as reason:
        raise BadValueError(f"{shown(value)} cannot be used as an expression of mb.t: {reason}") from reason


def _with_usual_tables(e: Expr) -> Expr:
    """The expression with numbers for tables at a fixed time, and cases for tables of time that are not read at a*mb.t + b and
    for angles by atan2, whose jumps they show. What reads sensors stays."""

    def rule(node: Expr, args: list[Expr]) -> Expr | None:
        if isinstance(node, se.atan2) and node.free_symbols <= {TIME}:
            return _half_angle(*args)
        found = tables.lookup_of(node)
        if found is None or args[0].free_symbols - {TIME}:
            return None
        a, b = affine(args[0])
        if not math.isfinite(a):
            if found.table.outside == "error" or any(map(tables.lookup_of, nodes(args[0]))):
                raise BadValueError(tables.readable(f"{shown(e)} reads a table with outside='{found.table.outside}' at "
                                                    f"{shown(args[0])}: of time it may be read at a*mb.t + b, or, with "
                                                    f"outside='hold' or 'periodic', at an expression without tables"))
            return tables.in_cases(found, args[0])
        if a:
            return None
        return se.RealDouble(float(found.table.lookup(np.array([b]), after(np.array([b])), found.order)[0]))

    return rebuilt(e, rule)


def _half_angle(y: Expr, x: Expr) -> Expr:
    """atan2(y, x) by the half angle in cases, smooth but for the jump at x < 0, y = 0; pi at the jump, 0 where both are 0."""
    size = se.Piecewise((x, x > 0), (-x, True))
    acute = 2 * se.atan(y / (se.sqrt(x**2 + y**2) + size))
    return se.Piecewise((acute, x > 0), (se.pi - acute, y > 0), (-se.pi - acute, y < 0), (se.pi, x < 0), (se.Integer(0), True))


def curves(e: Expr) -> list[tuple[tables.Table, Expr]]:
    """The tables in an expression that are read at more than the time, each with where it is read."""
    found = ((tables.lookup_of(node), node) for node in nodes(se.sympify(e)))
    return [(one.table, node.args[0]) for one, node in found if one is not None and node.free_symbols - {TIME}]


def curves_in_cases(e: Expr) -> Expr:
    """An expression with cases of a Piecewise for its curves over sensors."""

    def rule(node: Expr, args: list[Expr]) -> Expr | None:
        found = tables.lookup_of(node)
        return None if found is None or args[0].free_symbols <= {TIME} else tables.in_cases(found, args[0])

    return rebuilt(e, rule) if curves(e) else e


def affine(x: Expr, symbol: Expr = TIME) -> tuple[float, float]:
    """a and b of x = a t + b; NaN where x has another form."""
    a = se.diff(x, symbol) if all(isinstance(n, se.Add | se.Mul | se.Symbol) or n.is_number for n in nodes(x)) else symbol
    return (float(a), float(x.subs({symbol: 0}))) if a.is_number and x.free_symbols <= {symbol} else (math.nan, math.nan)


def _refuse_other_time(value: Any) -> None:
    """Refuse a symbol t with assumptions beyond real: SymPy may have simplified the expression by them."""
    for symbol in value.free_symbols:
        assumed = getattr(symbol, "_assumptions_orig", {}) if str(symbol) == str(TIME) else {}
        if set(assumed) - {"real", "commutative"}:
            raise BadValueError(f"{shown(value)} contains a symbol t of its own ({', '.join(map(str, assumed))}), which is not "
                                f"mb.t: use mb.t")


def _has_symbols(value: Any) -> bool:
    try:
        return bool(getattr(value, "free_symbols", None))
    except Exception:  # an object of the user may raise anything
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
            import sympy

            raise BadValueError(f"{shown(e)} contains the number {sympy.sympify(node).n(6)}, which is not a real number of "
                                f"double precision: give real numbers up to 1.8e308")
        return se.RealDouble(float(node)) if type(node).__name__ == "RealMPFR" else None

    return rebuilt(e, rule)


# ---- values before and after an instant --------------------------------------------------------------------------------


@lru_cache(maxsize=512)
def sided(e: Expr) -> Expr:
    """The expression with the symbol `SIDE`, a time inside the interval of interest, in place of the time in its conditions and
    floors and as second argument of its tables."""
    if not any(isinstance(node, se.Piecewise | se.FunctionSymbol) or type(node).__name__ == "floor" for node in nodes(e)):
        return e

    def rule(node: Expr, args: list[Expr]) -> Expr | None:
        if isinstance(node, se.FunctionSymbol) and len(args) == 1 and TIME in node.free_symbols:
            return se.Function(node.get_name())(args[0], args[0].subs({TIME: SIDE}))
        if isinstance(node, se.Piecewise):
            conditions = [condition.subs({TIME: SIDE}) for condition in node.args[1::2]]
            return se.Piecewise(*zip(args[::2], conditions, strict=True))
        return node.subs({TIME: SIDE}) if type(node).__name__ == "floor" else None

    return rebuilt(e, rule)


@lru_cache(maxsize=512)
def derivatives(e: Expr) -> tuple[Expr, Expr, Expr]:
    """The expression and its first two time derivatives, each `sided`."""
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
    """Expressions at whose jumps steps have to end: the input itself; where it prescribes a motion (`moves`) by a table, also its
    first two time derivatives."""
    e = se.sympify(e)
    return tuple(dict.fromkeys(derivatives(e))) if moves and any(map(tables.lookup_of, nodes(e))) else (e,)


def values(e: Expr, times: NDArray[np.float64], sides: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """The expression at times (k,); sides (k,): times at which its conditions are evaluated, by default `times`."""
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
        """Times and sides (k, 2) with the values of the tables as further columns."""
        read = [found.table.lookup(a * inputs[:, column] + b, a * inputs[:, 1] + b, found.order)
                for found, a, b, column in self.readings]
        return np.column_stack([inputs, *read]) if read else inputs


@lru_cache(maxsize=256)
def split(expressions: tuple[Expr, ...]) -> Split:
    """`sided` expressions with symbols for their tables; a table in a condition is read at the time of conditions."""
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
