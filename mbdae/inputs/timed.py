"""Prescribed values: numbers or expressions of the time symbol `mb.t`, and where they jump."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.symbolic.vectors import Expr

TIME = se.Symbol("t")
#: functions with derivatives the kernels can compile; `REWRITTEN` ones become Piecewise
FUNCTIONS = (
    "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "exp", "log", "Piecewise",
)  # fmt: skip
REWRITTEN = ("Abs", "sign", "Heaviside", "Max", "Min")
GRID, BISECTIONS = 2001, 45


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
    """A SymPy expression with its one-sided functions written as Piecewise; refuses functions without derivative."""
    if not hasattr(value, "free_symbols") or isinstance(value, se.Basic):
        return value
    import sympy

    if value.has(sympy.zoo, sympy.nan, sympy.oo, -sympy.oo):
        raise ValueError(f"{value} is not finite")
    used = {type(f).__name__ for f in value.atoms(sympy.core.function.Application)}
    if used & set(REWRITTEN):
        real = sympy.Symbol("t", real=True)
        value = value.subs(time_symbol(), real).rewrite(sympy.Piecewise).subs(real, time_symbol())
        value = sympy.piecewise_fold(value)
        used = {type(f).__name__ for f in value.atoms(sympy.core.function.Application)}
    if value.has(sympy.I):
        raise ValueError(f"{value} is not real")
    unknown = sorted(used - set(FUNCTIONS))
    if unknown:
        known = ", ".join(FUNCTIONS + REWRITTEN)
        raise ValueError(f"{value} contains the function {unknown[0]}; expressions of mb.t may use {known}")
    return value


def derivatives(e: Expr) -> tuple[Expr, Expr, Expr]:
    """The expression and its first two time derivatives."""
    d = se.diff(e, TIME)
    return e, d, se.diff(d, TIME)


def values(e: Expr, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """The expression at times (k,)."""
    if not e.free_symbols:
        return np.full(len(times), float(e))
    with np.errstate(all="ignore"):
        return np.asarray(_compiled(e)(np.asarray(times, dtype=float)[:, None])).reshape(-1)


@lru_cache(maxsize=256)
def _compiled(e: Expr) -> Any:
    return se.Lambdify([TIME], [e], backend="llvm")


def first_jump(e: Expr, t0: float, t_end: float) -> tuple[float, float] | None:
    """Time and size (inf at a pole) of the first jump of an expression in [t0, t_end], by bisection; None if smooth."""
    if not e.free_symbols:
        return None
    grid = np.unique(np.concatenate([np.linspace(t0, t_end, GRID), _boundaries(e, t0, t_end)]))
    at = values(e, grid)
    bad = np.flatnonzero(~np.isfinite(at))
    if len(bad):
        return float(grid[bad[0]]), float(at[bad[0]])
    steps = np.abs(np.diff(at))
    worst = np.argsort(steps)[-40:]
    a, b = grid[worst], grid[worst + 1]
    for _ in range(BISECTIONS):
        middle = (a + b) / 2
        low, mid, high = values(e, a), values(e, middle), values(e, b)
        left = ~(np.abs(mid - low) < np.abs(high - mid))  # keeps a pole: nan counts as the larger half
        a, b = np.where(left, a, middle), np.where(left, middle, b)
    jump = values(e, b) - values(e, a)
    size = max(1e-300, float(np.max(np.abs(at))))
    found = np.flatnonzero(~(np.abs(jump) <= 1e-7 * size))
    if not len(found):
        return None
    first = found[np.argmin(a[found])]
    if not abs(jump[first]) < 1e3 * size:
        return float(b[first]), float("inf")
    beyond = 1e-10 * (t_end - t0)  # a Piecewise may have a value of its own exactly at the jump
    around = values(e, np.array([max(a[first] - beyond, t0), min(b[first] + beyond, t_end)]))
    return float(b[first]), float(around[1] - around[0])


def _boundaries(e: Expr, t0: float, t_end: float) -> NDArray[np.float64]:
    """Times around which the conditions of a Piecewise change, so that no short pulse falls between grid points."""
    if "Piecewise" not in str(e):
        return np.zeros(0)
    import sympy

    times: list[float] = []
    for relation in sympy.sympify(e).atoms(sympy.core.relational.Relational):
        difference = relation.lhs - relation.rhs
        slope = difference.diff(time_symbol())
        if slope.is_number and slope != 0:
            times.append(float(-difference.subs(time_symbol(), 0) / slope))
    near = np.array([t + s * 1e-6 * (t_end - t0) for t in times for s in (-1, 0, 1)])
    return near[(near > t0) & (near < t_end)]
