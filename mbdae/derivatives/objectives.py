"""What of a run one number is made of, whose gradient is asked for: an integral, a value at the end, the largest value."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.errors import DerivativeError, OptionError
from mbdae.results.quantities import Quantity
from mbdae.results.result import Result
from mbdae.system.base import Array
from mbdae.values import number, optional, shown

POINTS, POINT_WEIGHTS = np.polynomial.legendre.leggauss(8)
NEAR = 1e-3  #: two maxima that differ by less than this share may change places, so that the largest has no derivative there


@dataclass(frozen=True)
class Objective:
    """One number of a run: a sum of values of `quantity` at some times, with weights. kind: "integral", "end" or "largest"."""

    quantity: Any
    kind: str
    smooth: float | None = None

    def points(self, run: Result) -> tuple[Array, Array]:
        """Times (k,) and weights (k,), with which the derivative of the objective is the sum over the derivatives of the
        quantity."""
        t = run.solution.t
        if self.kind == "end":
            return t[-1:], np.ones(1)
        half = np.diff(t) / 2
        times = ((t[1:] + t[:-1])[:, None] / 2 + half[:, None] * POINTS).ravel()
        weights = (half[:, None] * POINT_WEIGHTS).ravel()
        if self.kind == "integral":
            return times, weights
        if self.smooth is not None:
            size = np.abs(values := self.read(run, times))
            share = weights * np.exp((size - size.max(initial=0.0)) / (self.smooth * size.max(initial=0.0) or 1.0))
            return times, np.sign(values) * share / share.sum()
        peak = run.peak(self.quantity)
        self._refuse_ties(run, np.unique(np.concatenate([times, t])), peak)
        at = np.array([peak.t])
        return at, np.sign(self.read(run, at))

    def _refuse_ties(self, run: Result, times: Array, peak: Any) -> None:
        size = np.abs(self.read(run, times))
        tops = np.flatnonzero((size >= np.r_[-1.0, size[:-1]]) & (size > np.r_[size[1:], -1.0]))
        others = [i for i in tops if abs(times[i] - peak.t) > 2 * np.diff(times).max() and size[i] > (1 - NEAR) * peak.value]
        if others:
            raise DerivativeError(f"the largest {shown(self.quantity)} has no derivative: it is nearly as large at t = "
                                  f"{times[others[0]]:.6g} s as at t = {peak.t:.6g} s, so that the largest may change its place; "
                                  "give mb.largest(..., smooth=1e-3)")

    def read(self, run: Result, times: Array) -> Array:
        """Values (k,) of the quantity at times (k,)."""
        values = np.asarray(run(times).value(self.quantity))
        if values.ndim > 1:
            raise OptionError(f"{shown(self.quantity)} has components: name one, as in {shown(self.quantity)}[0], or norm(...)")
        return values


def integral(quantity: Quantity) -> Objective:
    """The integral over the run of a quantity, "body.acceleration[1]**2": an objective for `Result.gradient`."""
    return Objective(quantity, "integral")


def at_end(quantity: Quantity) -> Objective:
    """The value of a quantity at the end of the run: an objective for `Result.gradient`."""
    return Objective(quantity, "end")


def largest(quantity: Quantity, smooth: float | None = None) -> Objective:
    """The largest magnitude of a quantity over the run, as `Result.peak` finds it: an objective for `Result.gradient`. smooth: a
    mean is taken in its place in which values that are lower by this share of the largest count e times less; it has a derivative
    also where two maxima may change places."""
    optional("smooth", smooth, number, "give a share of the largest value, such as 1e-3", above=0)
    return Objective(quantity, "largest", smooth)
