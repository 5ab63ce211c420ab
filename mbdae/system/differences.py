"""Derivatives of a user's functions by forward differences, where the user gives none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import group_columns

Array = NDArray[np.float64]

EPS = float(np.finfo(float).eps)
#: increments relative to the larger of an argument and its scale: of y, and of y', in which equations are linear as a rule, so
#: that a longer increment costs no digit and the round-off of the other terms is divided by more. Measured (capacitors of 1e-6 F
#: beside conductances of 1e-4 A/V): five digits of dF/dy' with the increment of y, eight with this one
OF_Y, OF_RATES = EPS**0.5, EPS ** (1 / 3)


class Differences:
    """Derivatives dF/dy and dF/dy' of F(t, y, y') by forward differences.

    residual: function (t, y, yp, out); scale (n,): typical magnitude of each unknown; pattern: (n, n) CSC pattern of both, or
    None. With a pattern, columns that have no row in common are changed together, as Curtis, Powell and Reid do."""

    def __init__(self, residual: Callable[..., None], scale: Array, pattern: Any = None) -> None:
        self._residual, self._scale, self._pattern = residual, scale, pattern
        n = len(scale)
        self._groups: Sequence[NDArray[np.intp]] = [np.array([j]) for j in range(n)]
        if pattern is not None:
            group = group_columns(pattern, np.arange(n))
            self._groups = [np.flatnonzero(group == g) for g in range(int(group.max(initial=-1)) + 1)]

    def parts(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        """dF/dy and dF/dy', each (n, n), or (nnz,) data of the pattern."""
        base = np.empty(len(y))
        self._residual(t, y, yp, base)
        y, yp = np.array(y, dtype=float), np.array(yp, dtype=float)

        def at(out: Array) -> None:
            self._residual(t, y, yp, out)

        return self._of(at, y, OF_Y, base), self._of(at, yp, OF_RATES, base)

    def of_rates(self, rates: Callable[[float, Array, Array], None], t: float, y: Array) -> Array:
        """df/dy (n, n) of y' = f(t, y); rates: function (t, y, out)."""
        base, y = np.empty(len(y)), np.array(y, dtype=float)
        rates(t, y, base)
        return self._full(lambda out: rates(t, y, out), y, OF_Y, base)

    def _of(self, values: Callable[[Array], None], x: Array, relative: float, base: Array) -> Array:
        """Derivatives of `values` by the argument x (n,), an array that `values` reads and that is changed meanwhile."""
        if self._pattern is None:
            return self._full(values, x, relative, base)
        pattern, shifted, kept = self._pattern, np.empty(len(base)), x.copy()
        steps, data = self._steps(x, relative), np.empty(self._pattern.nnz)
        for group in self._groups:
            x[group] = kept[group] + steps[group]
            values(shifted)
            for j in group:
                entries = slice(pattern.indptr[j], pattern.indptr[j + 1])
                rows = pattern.indices[entries]
                data[entries] = _over(shifted[rows] - base[rows], x[j] - kept[j])
            x[group] = kept[group]
        return data

    def _full(self, values: Callable[[Array], None], x: Array, relative: float, base: Array) -> Array:
        n, shifted, kept = len(x), np.empty(len(base)), x.copy()
        steps, out = self._steps(x, relative), np.empty((len(base), n), order="F")
        for j in range(n):
            x[j] = kept[j] + steps[j]
            values(shifted)
            out[:, j] = _over(shifted - base, x[j] - kept[j])
            x[j] = kept[j]
        return out

    def _steps(self, x: Array, relative: float) -> Array:
        """Increments (n,), away from 0."""
        return np.asarray(relative * np.maximum(np.abs(x), self._scale) * np.where(x >= 0, 1.0, -1.0))


def _over(change: Array, step: float) -> Array:
    with np.errstate(invalid="ignore"):  # inf - inf: the solver reports that the equations are not finite there
        return np.asarray(change / step)
