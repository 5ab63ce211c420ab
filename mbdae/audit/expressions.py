"""Complex values of the expressions of laws. Symengine's own take powers by logarithms, which spoils complex steps."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import symengine as se

from mbdae.symbolic.functions import complex_atan2

_RELATIONS = {"LessThan": np.less_equal, "StrictLessThan": np.less, "Equality": np.equal, "Unequality": np.not_equal}


def value(e: Any, known: Mapping[Any, complex]) -> Any:
    """Value of an expression for values of its symbols."""
    if isinstance(e, se.Symbol):
        return known[e]
    if e.is_Number or e in (se.pi, se.E):
        return complex(e)
    if isinstance(e, se.Piecewise):
        pairs = zip(e.args[::2], e.args[1::2], strict=True)
        return next(value(result, known) for result, condition in pairs if _holds(condition, known))
    a = [value(x, known) for x in e.args]
    if isinstance(e, se.Add):
        return sum(a)
    if isinstance(e, se.Mul):
        return math.prod(a, start=1 + 0j)
    if isinstance(e, se.Pow):
        n = e.args[1]
        return a[0] ** int(n) if n.is_Integer and n.is_positive else 1 / a[0] ** int(-n) if n.is_Integer else a[0] ** a[1]
    name = e.get_name() if isinstance(e, se.FunctionSymbol) else type(e).__name__
    if name in ("let", "UnevaluatedExpr"):
        return a[0]
    if name == "floor":
        return complex(math.floor(a[0].real))
    return complex_atan2(a[0], a[1]) if name == "atan2" else getattr(cmath, name)(*a)


def _holds(condition: Any, known: Mapping[Any, complex]) -> bool:
    name = type(condition).__name__
    if name in _RELATIONS:
        a, b = (np.real(value(x, known)) for x in condition.args)
        return bool(_RELATIONS[name](a, b))
    parts = (_holds(c, known) for c in condition.args)
    return {"And": all, "Or": any}[name](parts) if name in ("And", "Or") else (
        not next(parts) if name == "Not" else bool(condition))  # fmt: skip
