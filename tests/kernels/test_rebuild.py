"""One-sided functions rewritten with Piecewise and floor have the values of Python's own."""

from __future__ import annotations

import math

import pytest
import symengine as se

from mbdae.symbolic.rebuild import one_sided

X, Y, Z = se.symbols("x y z")
PLACES = [(1.5, -2.0, 0.25), (-2.0, 1.5, 3.0), (0.5, 0.5, -1.0), (0.0, 0.0, 0.0), (-3.25, -3.5, -3.5)]


@pytest.mark.parametrize(("e", "value"), [
    (se.Max(X, Y, Z), max), (se.Min(X, Y, Z), min), (abs(X) + Y, lambda x, y, z: abs(x) + y),
    (se.sign(X) * Y, lambda x, y, z: (x > 0) * y - (x < 0) * y), (se.ceiling(X) + 2 * Z, lambda x, y, z: math.ceil(x) + 2 * z),
    (se.Max(abs(X), se.Min(Y, Z)) ** 2, lambda x, y, z: max(abs(x), min(y, z)) ** 2),
], ids=["max", "min", "abs", "sign", "ceiling", "all"])
def test_values(e, value):
    rewritten = one_sided(e)
    for place in PLACES:
        found = rewritten.subs(dict(zip((X, Y, Z), map(se.RealDouble, place), strict=True)))
        assert float(found) == pytest.approx(value(*place), abs=1e-15)
