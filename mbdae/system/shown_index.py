"""The index of equations of a user's own, measured, beside the one that was declared.

In E y' + A y = r the solution of (E + h A) y = h r, a step of the implicit Euler method, hands a disturbance of r on to an
unknown of index k in proportion to h^(1 - k): multiples of the inverse of the step reach what is differentiated. The slope of
each row of (E + h A)^-1 over h, from step to step shorter, is therefore the index of that unknown.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from mbdae.system.base import Array

#: steps over the time of the run, each a tenth of the one before
STEPS = 10.0 ** -np.arange(1, 11)
#: a slope counts where it keeps within NEAR of a whole number over LASTING steps in a row
NEAR, LASTING = 0.2, 2
#: largest condition number of E + h A (scaled) at which its inverse is used; with derivatives by differences, whose errors enter
ILL, ILL_BY_DIFFERENCES = 1e13, 1e9
SAID = 4  #: largest number of unknowns that a message names
MOST = 300  #: largest number of unknowns for which the index is measured


class Slopes(NamedTuple):
    """The indices that each unknown shows (n,), each as a set of whole numbers: more than one where fast motions look like
    constraints at some steps and not at others. Empty where none was found."""

    shown: tuple[frozenset[int], ...]

    @property
    def settled(self) -> list[int | None]:
        """(n,) the index of each unknown where only one shows; else None."""
        return [next(iter(one)) if len(one) == 1 else None for one in self.shown]


def slopes_at(system: Any, t: float, y: Array, yp: Array, span: float) -> Slopes:
    """The indices that the unknowns show at a state; span: time of the run, s."""
    A, E = system.dense_parts(t, y, yp)
    A, E = A * system.scale, E * system.scale / span
    rows = np.max(np.abs(A) + np.abs(E), axis=1)
    rows[rows == 0] = 1.0
    A, E = A / rows[:, None], E / rows[:, None]
    sizes = []
    ill = ILL_BY_DIFFERENCES if system.by_differences else ILL
    for h in STEPS:
        found = _inverse(E + h * A, ill / h)
        if found is None:
            break
        sizes.append(np.max(np.abs(found), axis=1))
    if len(sizes) <= LASTING:
        return Slopes((frozenset(),) * system.n)
    slopes = np.diff(np.log10(np.maximum(sizes, 1e-300)), axis=0)
    return Slopes(tuple(frozenset(_lasting(slopes[:, j])) for j in range(system.n)))


def _inverse(matrix: Array, most: float) -> Array | None:
    """The inverse of a matrix, None where its condition number is above `most`."""
    try:
        found = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(found).all() or np.linalg.norm(matrix, np.inf) * np.linalg.norm(found, np.inf) > most:
        return None
    return np.asarray(found)


def _lasting(slopes: Array) -> set[int]:
    """Whole numbers, 1 at least, near which slopes keep over LASTING steps in a row."""
    whole = np.where(np.abs(slopes - np.round(slopes)) < NEAR, np.round(slopes), np.nan)
    return {max(int(a), 1) for a, b in pairwise(whole.tolist()) if a == b}


def measured(system: Any, span: float) -> list[int | None]:
    """(n,) index of each unknown near the start, where it is the same at two points; else None. (At the start itself entries of
    the Jacobian may be zero by chance.)"""
    if system.n > MOST:
        return [None] * system.n
    found = [slopes_at(system, t, y, yp, span).settled for t, y, yp in system.probes()[1:]]
    return [a if a == b else None for a, b in zip(*found, strict=True)]


def contradiction(system: Any, span: float) -> str:
    """What the declared index contradicts, in words; "" where it does not."""
    found = measured(system, span)
    known = [k for k in found if k is not None]
    if not known:
        return ""
    highest, whole = max(known), len(known) == system.n
    off = [(j, k) for j, k in enumerate(found) if k is not None and k > system.index[j]]
    if not off and whole and system.declared is not None and system.declared > highest:
        return f"index = {system.declared}, but the equations have index {highest} near the start: give index={highest}"
    if not off and whole and max(system.index) > highest:
        off = [(j, k) for j, k in enumerate(found) if k is not None and k < system.index[j]]
    if not off:
        return ""
    names = ", ".join(f"{system.names[j]} has index {k}, declared {system.index[j]}" for j, k in off[:SAID])
    more = f" (and {len(off) - SAID} more)" if len(off) > SAID else ""
    return (f"the declared index is not that of the equations near the start: {names}{more}; give index={highest}, or "
            f"{system.n} numbers, one per unknown")
