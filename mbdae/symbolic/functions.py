"""Numerical properties of the functions in statements and inputs: how fast they vary, and atan2 of complex numbers.

A steep function has a width: the change of its argument u over which the function changes by a substantial part of itself. PHI(u)
is u on a scale where one width has length 1, so that a change of PHI counts widths; it is constant where the function is flat.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Scale = Callable[[Any], Any]

#: function -> kind: how it changes with its argument (`system.base.Switches` describes the kinds)
KINDS = {
    "tanh": "saturating", "erf": "saturating", "erfc": "saturating", "coth": "arc", "sech": "saturating", "csch": "arc",
    "atan": "arc", "acot": "arc", "asinh": "arc", "asin": "periodic", "acos": "periodic", "atanh": "periodic", "acosh": "arc",
    "sin": "periodic", "cos": "periodic", "tan": "periodic", "cot": "periodic", "sec": "periodic", "csc": "periodic",
    "sinh": "growing", "cosh": "growing", "log": "power", "abs": "kink", "Abs": "kink", "sign": "kink",
}  # fmt: skip


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
