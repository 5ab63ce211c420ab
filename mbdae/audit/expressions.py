"""Expressions of laws as Python functions of complex numbers: symengine computes powers by logarithms, which makes complex steps
inexact."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import symengine as se

from mbdae.audit.evaluate import SizeError, Value
from mbdae.errors import LawError
from mbdae.symbolic.functions import complex_atan2
from mbdae.symbolic.source import Language, called, defined, python_power, written


def _no_case() -> Value:
    raise SizeError("a se.Piecewise in the class of the law has no case that holds in this state; end it with the case (value, "
                    "True)")  # fmt: skip


def _cases(*parts: str) -> str:
    """Python text of a Piecewise, whose parts are value, condition, value, ...: it evaluates the value of the first condition
    that holds and no other value, which may be undefined."""
    return f"({parts[0]} if {parts[1]} else {_cases(*parts[2:])})" if parts else "_no_case()"


def _compared(sign: str) -> Callable[..., str]:
    return lambda a, b: f"({a}.real {sign} {b}.real)"


_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(cmath, name) for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "log")},
    **{name: getattr(cmath, name) for name in ("asin", "acos", "atan", "asinh", "acosh", "atanh")},
    "atan2": complex_atan2, "floor": lambda a: complex(math.floor(a.real)),
}  # fmt: skip
_PYTHON = Language(
    lambda e: f"({e})" if isinstance(e, se.Integer) else f"({complex(e)!r})", python_power,
    {name: called(name) for name in _FUNCTIONS} | dict.fromkeys(("let", "UnevaluatedExpr"), lambda a: a)
    | {"StrictLessThan": _compared("<"), "LessThan": _compared("<="), "Equality": _compared("=="), "Unequality": _compared("!=")}
    | {"And": lambda *a: f"({' and '.join(a)})", "Or": lambda *a: f"({' or '.join(a)})", "Not": lambda a: f"(not {a})"}
    | {"BooleanTrue": lambda: "True", "BooleanFalse": lambda: "False", "Piecewise": _cases})  # fmt: skip


def expression_function(symbols: Sequence[Any], steps: Mapping[Any, Any], outputs: Sequence[Any]) -> Callable[..., list[Any]]:
    """Expressions as a Python function: it takes the complex values of the symbols, a sequence in their order, and returns the
    list of values of the outputs. steps: intermediate results, {name: expression of symbols and earlier names}."""
    names = {s: f"x[{i}]" for i, s in enumerate(symbols)}
    found = []
    try:
        for i, (name, e) in enumerate(steps.items()):
            found.append((f"a{i}", written(e, names, _PYTHON)))
            names[name] = f"a{i}"
        values = [written(e, names, _PYTHON) for e in outputs]
    except LawError as error:
        raise SizeError(str(error)) from error
    return defined(found, values, _FUNCTIONS | {"_sqrt": cmath.sqrt, "_exp": cmath.exp, "_no_case": _no_case})


@lru_cache(maxsize=4096)
def _alone(e: Any) -> tuple[list[Any], Callable[..., list[Any]]]:
    symbols = list(e.free_symbols)
    return symbols, expression_function(symbols, {}, [e])


def expression_value(e: Any, known: Mapping[Any, complex]) -> Any:
    """Value of an expression for values of its symbols."""
    symbols, function = _alone(e)
    return complex(function([known[s] for s in symbols])[0])
