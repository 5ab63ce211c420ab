"""Values that users, files and command lines hand over by mistake, with what is wrong in each: for every public argument."""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import sympy as sp


class Loud:
    """An object whose every use is an error of its own."""

    def __repr__(self) -> str:
        raise RuntimeError("no repr")


#: no number at all, in any option that takes a number
NO_NUMBERS: dict[str, Any] = {
    "text": "heavy", "digits as text": "1.0", "empty text": "", "bytes": b"1", "a truth value": True, "numpy's": np.False_,
    "complex": 1 + 2j, "numpy's complex": np.complex128(1j), "SymPy's i": sp.I, "a list": [1.0, 2.0], "a nested list": [[1.0]],
    "ragged": [[1.0], [1.0, 2.0]], "a tuple of text": ("a", "b"), "a dict": {"a": 1}, "a set": {1.0}, "a function": math.sin,
    "a class": float, "a module": math, "an object": object(), "no repr": Loud(), "one entry": np.array([1.0]),
    "an array": np.ones((2, 2)), "an array of objects": np.array([None, "x"], dtype=object), "a free symbol": sp.Symbol("w"),
    "a generator": (i for i in range(3)), "a range": range(3), "not a time": np.datetime64("2020-01-01"), "ellipsis": ...,
    "a duration": np.timedelta64(1, "s"), "masked": np.ma.masked, "a masked entry": np.ma.array([1.0, 2.0], mask=[True, False]),
    "a condition": sp.Symbol("w") > 1, "a matrix": sp.Matrix([1.0]), "a lambda": lambda t: t, "a bytearray": bytearray(b"1"),
}
#: numbers that no calculation survives
NO_USE: dict[str, Any] = {
    "nan": math.nan, "infinity": math.inf, "minus infinity": -math.inf, "numpy's nan": np.float64("nan"), "huge": 1e308,
    "huge integer": 10**400, "tiny": 5e-324, "SymPy's zoo": sp.zoo, "decimal nan": Decimal("nan"), "SymPy's oo": sp.oo,
}
#: the number one, as different libraries write it: everywhere as good as 1.0
ONES: dict[str, Any] = {
    "int": 1, "float64": np.float64(1), "float32": np.float32(1), "int64": np.int64(1), "uint8": np.uint8(1),
    "0-d array": np.array(1.0), "fraction": Fraction(1, 1), "decimal": Decimal(1), "SymPy's": sp.Integer(1),
    "SymPy's float": sp.Float(1.0),
}
HOSTILE = NO_NUMBERS | NO_USE
#: numbers that some options take and others do not
SIGNS: dict[str, Any] = {"zero": 0, "minus one": -1.0, "numpy's minus one": np.int64(-1), "a half": 0.5, "much": 1e9}
