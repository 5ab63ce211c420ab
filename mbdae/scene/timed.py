"""Prescribed values: numbers or expressions of the time symbol `mb.t`."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import symengine as se

from mbdae.symbolic.vectors import Expr

TIME = se.Symbol("t")


@lru_cache(maxsize=1)
def time_symbol() -> Any:
    """The SymPy symbol `mb.t`."""
    import sympy

    return sympy.Symbol("t")


def expression(value: Any) -> Expr:
    """A number or expression of time as symengine sees it; raises TypeError or ValueError with the reason."""
    try:
        e = se.sympify(value)
    except (TypeError, RuntimeError, AttributeError, se.SympifyError) as error:
        raise TypeError(f"{value!r} is neither a number nor an expression of mb.t") from error
    others = sorted(str(s) for s in e.free_symbols if s != TIME)
    if others:
        raise ValueError(f"{value} contains the symbol {others[0]}; only mb.t may appear")
    return e


def derivatives(e: Expr) -> tuple[Expr, Expr, Expr]:
    """The expression and its first two time derivatives."""
    d = se.diff(e, TIME)
    return e, d, se.diff(d, TIME)
