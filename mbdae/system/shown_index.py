"""Equations of motion given as their parts: mass matrix M, forces f, constraints g and constraint Jacobian G, by a user's
functions.

Derivatives of a user's functions by forward differences, where the user gives none.

The index of equations of a user's own, measured, beside the one that was declared.

In E y' + A y = r the solution of (E + h A) y = h r, a step of the implicit Euler method, hands a disturbance of r on to an
unknown of index k in proportion to h^(1 - k): multiples of the inverse of the step reach what is differentiated. The slope of
each row of (E + h A)^-1 over h, from step to step shorter, is therefore the index of that unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import group_columns
from mbdae.errors import OptionError
from mbdae.system.base import Array, System
from mbdae.values import BadValueError, option, sequence, shown

#: largest residual at the start that is accepted: of M u' + G^T lambda = f over the sum of the largest magnitudes of M u' and f,
#: of g = 0 over 1 plus the largest magnitude of q
TOLERANCE = 1e-6

Parts = tuple[Callable[..., Any], ...]


def checked_partition(system: System, parts: Sequence[Callable[..., Any]]) -> tuple[Parts, tuple[str, ...]]:
    """The parts (M, f, g, G), and the kind of every unknown of the system, which follows from their shapes; OptionError where
    they do not fit the unknowns or the start."""
    remedy = "give four functions (M, f, g, G): M(t, q), f(t, q, u), g(t, q), G(t, q)"
    given = option("partition", parts, sequence, remedy, each=_function)
    if len(given) != 4:
        raise OptionError(f"partition = {shown(parts)}: {remedy}")
    M, f, g, G = given
    failure: Exception | None = None
    for nu in range(system.n // 2, 0, -1):
        left = system.n - 2 * nu
        try:
            q, u = system.y0[:nu], system.y0[nu : 2 * nu]
            shapes = [np.shape(value) for value in (M(system.t0, q), f(system.t0, q, u), g(system.t0, q), G(system.t0, q))]
        except (IndexError, ValueError, TypeError) as error:  # try the next division of the unknowns into q, u and multipliers
            failure = error
            continue
        m = shapes[2][0] if shapes[2] else 0
        if shapes == [(nu, nu), (nu,), (m,), (m, nu)] and left in (m, 2 * m):
            _check_start(system, (M, f, g, G), nu, m)
            kinds = ("q",) * nu + ("v",) * nu + ("lambda",) * m + ("mu",) * (left - m)
            return (M, f, g, G), kinds
    raise OptionError(f"partition: no division of the {system.n} unknowns into y = (q, u, lambda) or (q, u, lambda, mu) fits; "
                      "with nu numbers in q and in u, and m in lambda and in mu, the functions have to return M (nu, nu), "
                      "f (nu,), g (m,) and G (m, nu): correct what they return, or y0") from failure


def _function(value: Any) -> Callable[..., Any]:
    """The value if it is a function, of any arguments; else raises an error."""
    if not callable(value):
        raise BadValueError(f"{shown(value)} is not a function")
    return value  # type: ignore[no-any-return]


def _check_start(system: System, parts: Sequence[Callable[..., Any]], nu: int, m: int) -> None:
    """Raise OptionError where the parts are not satisfied at the start."""
    M, f, g, G = parts
    t, q, u, multipliers = system.t0, system.y0[:nu], system.y0[nu : 2 * nu], system.y0[2 * nu : 2 * nu + m]
    inertia, force, rows = np.asarray(M(t, q)) @ system.yp0[nu : 2 * nu], np.asarray(f(t, q, u)), np.asarray(G(t, q))
    left, size = inertia + rows.T @ multipliers - force, np.max(np.abs(inertia)) + np.max(np.abs(force)) + 1e-300
    if np.max(np.abs(left)) > TOLERANCE * size:
        raise OptionError(f"partition: M u' + G^T lambda - f = {left} at the start instead of 0: M, f or G state other equations "
                          "than the residual, or lambda has the other sign there; correct them")
    if np.max(np.abs(g(t, q)), initial=0.0) > TOLERANCE * (1 + np.max(np.abs(q))):
        raise OptionError(f"partition: g = {g(t, q)} at the start, where it has to vanish; correct g or y0")


EPS = float(np.finfo(float).eps)
#: increments relative to the larger of an argument and its scale: of y, and of y', in which equations are linear as a rule, so
#: that a longer increment costs no digit and the round-off of the other terms is divided by more. Measured (capacitors of 1e-6 F
#: beside conductances of 1e-4 A/V): five digits of dF/dy' with the increment of y, eight with this one
OF_Y, OF_RATES = EPS**0.5, EPS ** (1 / 3)
#: increments of an unknown are relative to SMALL times its scale where it is smaller. Measured: Robertson's reaction, of which
#: one concentration falls to 1e-13, takes 3655 steps to 1e11 s, and more than 1e5 with increments of the scale itself
SMALL = 1e-4


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
        least = self._scale * (SMALL if relative == OF_Y else 1.0)
        return np.asarray(relative * np.maximum(np.abs(x), least) * np.where(x >= 0, 1.0, -1.0))


def _over(change: Array, step: float) -> Array:
    with np.errstate(invalid="ignore"):  # inf - inf: the solver reports that the equations are not finite there
        return np.asarray(change / step)


#: steps over the time of the run, each a tenth of the one before
STEPS = 10.0 ** -np.arange(1, 11)
#: a slope counts where it keeps within NEAR of a whole number over LASTING steps in a row
NEAR, LASTING = 0.2, 2
#: relative errors of derivatives by differences, and of exact ones; an index is read from rows of the inverse that such errors
#: change by less than SURE of their size. A limit of the condition number instead stops at index 3
BY_DIFFERENCES, ROUNDING, SURE = 1e-7, 1e-14, 0.1
HIGHEST = 3  #: index that methods solve
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
    error = BY_DIFFERENCES if system.by_differences else ROUNDING
    wave = error * np.sin(1.0 + np.arange(system.n**2).reshape(system.n, -1) % 9973)
    sizes, known = [], np.ones(system.n, dtype=bool)
    for h in STEPS:
        here, beside = _row_sizes(E + h * A), _row_sizes(E * (1 + wave) + h * A * (1 - wave))
        known = known & (np.abs(here - beside) < SURE * here)
        if not known.any():
            break
        sizes.append(np.where(known, here, np.nan))
    if len(sizes) <= LASTING:
        return Slopes((frozenset(),) * system.n)
    slopes = np.diff(np.log10(np.maximum(sizes, 1e-300)), axis=0)
    return Slopes(tuple(frozenset(_lasting(slopes[:, j])) for j in range(system.n)))


def _row_sizes(matrix: Array) -> Array:
    """Largest magnitude (n,) in each row of the inverse; inf where there is none."""
    try:
        with np.errstate(all="ignore"):
            return np.asarray(np.max(np.abs(np.linalg.inv(matrix)), axis=1))
    except np.linalg.LinAlgError:
        return np.full(len(matrix), np.inf)


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
    remedy = (f"give index={highest}, or {system.n} numbers, one per unknown" if highest <= HIGHEST else
              f"no method here solves equations of an index above {HIGHEST}: differentiate constraints until it is at most that")
    return f"the declared index is not that of the equations near the start: {names}{more}; {remedy}"
