"""Expressions as NumPy source: the reference for compiled kernels, and for derivatives by the complex step.

Every operation of an expression is written in parentheses of its own, so that NumPy evaluates it exactly as stated, in real or
complex numbers and without LLVM.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.symbolic.functions import complex_atan2
from mbdae.symbolic.source import python_function
from mbdae.symbolic.vectors import Expr


def _larger(*values: Any) -> Any:
    return reduce(lambda a, b: np.where(np.real(a) >= np.real(b), a, b), values)


def _smaller(*values: Any) -> Any:
    return reduce(lambda a, b: np.where(np.real(a) <= np.real(b), a, b), values)


def _piecewise(*parts: Any) -> Any:
    """The value that stands before the first true condition; NaN where none is true. parts: value, condition, value, ..."""
    found: Any = np.nan
    for value, condition in zip(parts[-2::-2], parts[::-2], strict=True):
        found = np.where(condition, value, found)
    return found


def _special(name: str) -> Callable[[Any], Any]:
    return lambda a: getattr(import_module("scipy.special"), name)(a)


#: function of NumPy or SciPy for every function of symengine, by the name of its class. Comparisons use real parts, so that the
#: imaginary parts of the complex step do not disturb them
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "log")},
    **{name: getattr(np, "arc" + name[1:]) for name in ("asin", "acos", "atan", "asinh", "acosh", "atanh")},
    "atan2": complex_atan2, "UnevaluatedExpr": lambda a: a, "Piecewise": _piecewise, "Max": _larger, "Min": _smaller,
    "Abs": lambda a: np.where(np.real(a) < 0, -a, a), "sign": lambda a: np.sign(np.real(a)),
    "floor": lambda a: np.floor(np.real(a)), "ceiling": lambda a: np.ceil(np.real(a)),
    "StrictLessThan": lambda a, b: np.real(a) < np.real(b), "LessThan": lambda a, b: np.real(a) <= np.real(b),
    "Equality": lambda a, b: np.real(a) == np.real(b), "Unequality": lambda a, b: np.real(a) != np.real(b),
    "And": lambda *a: reduce(np.logical_and, a), "Or": lambda *a: reduce(np.logical_or, a), "Not": np.logical_not,
    **{name: _special(name) for name in ("erf", "erfc", "gamma", "loggamma")},
    "BooleanTrue": lambda: True, "BooleanFalse": lambda: False, "_sqrt": np.sqrt, "_exp": np.exp,
}  # fmt: skip


def numpy_function(symbols: Sequence[Expr], expressions: Sequence[Expr]) -> Callable[[NDArray[Any]], NDArray[Any]]:
    """The function x (..., inputs) -> (..., outputs), real or complex; raises LawError for an unknown function."""
    function = python_function(symbols, expressions, _FUNCTIONS)

    def evaluate(x: NDArray[Any]) -> NDArray[Any]:
        out = np.empty((len(expressions), *x.shape[:-1]), dtype=x.dtype)
        for i, column in enumerate(function(np.moveaxis(x, -1, 0))):
            out[i] = column
        return np.moveaxis(out, 0, -1)

    return evaluate
