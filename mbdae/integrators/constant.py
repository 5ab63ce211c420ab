"""The right-hand side f of y' = f(t, y), for methods that take ordinary differential equations.

The roots of linearised equations near a given magnitude.

Steps of constant length, for all methods that take them; how many steps are made in one native call.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from math import ceil
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import LinearOperator, eigs, splu
from mbdae.errors import OptionError
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.matrices import as_csc
from mbdae.integrators.watch import StepWatch
from mbdae.native import Entries
from mbdae.system.base import Array, System


def check_rates(label: str, system: System) -> None:
    """Raise OptionError for a system without a right-hand side; label: of the solver."""
    if system.rhs is not None:
        return
    needs = f"{label} needs y' = f(t, y), but this system"
    if any(kind in ("lambda", "mu") for kind in system.kinds):
        raise OptionError(f"{needs} ({system.label}) has multipliers of constraints, or other algebraic unknowns: use "
                          "mb.RadauIIA(3); or, for a scene, form=mb.Index1(multipliers='eliminated'), which solves for the "
                          "multipliers at every state, or s.recursive() if its joints form a tree")
    raise OptionError(f"{needs} ({system.label}) gives only F(t, y, y') = 0, no right-hand side: use mb.IDA() or mb.RadauIIA(3), "
                      f"or give the DAE its rhs=, a function (t, y, out) that fills out with y'")


def rate_jacobian(system: System, t: float, y: Array, yp: Array) -> Array:
    """df/dy (n, n) of y' = f(t, y) at yp = f(t, y), from the system, or as -(dF/dy')^-1 dF/dy from F(t, y, y') = 0."""
    if system.rate_jacobian is not None:
        return np.asarray(system.rate_jacobian(t, y))
    fy, fyp = system.jacobian_parts(t, y, yp)
    try:
        if not system.sparse:
            return np.asarray(-np.linalg.solve(fyp, fy))
        return np.asarray(-splu(as_csc(system, fyp)).solve(as_csc(system, fy).toarray()))
    except (np.linalg.LinAlgError, RuntimeError) as error:
        raise OptionError(
            f"dF/dy' is singular at t = {t:.9g} s: an equation contains no derivative (such as a motion without mass), or the "
            "derivatives of several depend on each other, so there is no y' = f(t, y); use mb.IDA() or mb.RadauIIA(3)"
        ) from error


#: roots beside a shift are known from its 1 / NEAR to NEAR times its value: infinite roots, of constraints, come out as 1e5
#: times the shift and more. Where the shift is a root itself, ODD times its value is taken. MOST_FELT: number of roots of a large
#: system, each found if its vector is one to UNSURE, and known up to BELOW times the shift: infinite ones were 190 times and more
NEAR, ODD, MOST_FELT, UNSURE, BELOW = 2e3, 1.07, 8, 1e-2, 10.0
#: they are sought where ROUNDS multiplications show that there are any near the shift
FELT, ROUNDS = 0.1, 8


def roots_beside(entries: Entries, parts: Sequence[Array], shift: Array) -> NDArray[np.complex128]:
    """The roots (k, m), 1/s, of dF/dy and dF/dy' (k, nnz) at k states within a factor NEAR of the shifts (k,), 1/s; 0 else."""
    fy, fyp = np.zeros((2, len(shift), entries.n, entries.n))
    fy[:, entries.row_of, entries.column_of], fyp[:, entries.row_of, entries.column_of] = parts
    moving = np.any(fyp != 0, axis=(0, 1))
    for s in (shift[:, None], ODD * shift[:, None]):
        with suppress(np.linalg.LinAlgError):
            found = np.linalg.eigvals(np.linalg.solve(fy + s[..., None] * fyp, fyp[:, :, moving])[:, moving])
            roots = s - 1 / np.where(found == 0, 1.0, found)
            return np.where((np.abs(found) * s * NEAR > 1) & (np.abs(roots) * NEAR > s), roots, 0.0)
    return np.zeros((len(shift), 1), complex)


def roots_about(entries: Entries, parts: Sequence[Array], shift: Array) -> NDArray[np.complex128]:
    """The same of large sparse equations, up to BELOW times the shifts: those MOST_FELT (k, m) for which, with N = (A + s E)^-1 E
    and the shift s, N (1 - s N) is largest, which is 0 for slow and for infinite roots; 0 where none are found."""
    roots, n = np.zeros((len(shift), MOST_FELT), complex), entries.n
    begin = 1 + np.arange(n) % 7 / 7
    for k, s in enumerate(shift.tolist()):
        E = entries.matrix(parts[1][k])
        with suppress(RuntimeError):  # a singular matrix
            solve = splu(entries.matrix(parts[0][k] + s * parts[1][k])).solve
            N = partial(_solved, solve, E)
            if not _felt(N, s, begin):
                continue
            try:
                vectors = eigs(LinearOperator((n, n), lambda x, N=N, s=s: _about(N, s, x), dtype=float), k=MOST_FELT, v0=begin,
                               tol=1e-4, maxiter=50)[1]
            except RuntimeError as error:  # no convergence: some may have been found
                vectors = getattr(error, "eigenvectors", np.zeros((n, 0)))
            images = np.reshape([N(x.real) + 1j * N(x.imag) for x in vectors.T], vectors.T.shape).T
            found = np.sum(vectors.conj() * images, axis=0)
            sure = np.linalg.norm(images - vectors * found, axis=0) < UNSURE * np.linalg.norm(images, axis=0)
            near = s - 1 / found[sure]
            roots[k, : len(near)] = np.where(np.abs(near) < BELOW * s, near, 0.0)
    return roots


def _solved(solve: Callable[[Array], Array], E: Any, x: Array) -> Array:
    return solve(E @ x)


def _about(N: Callable[[Array], Array], s: float, x: Array) -> Array:
    """s N (1 - s N) x."""
    image = s * N(x)
    return image - s * N(image)


def _felt(N: Callable[[Array], Array], s: float, x: Array) -> bool:
    """Whether s N (1 - s N), which is a / (1 + a^2) for a vibration of a times the shift, multiplies a vector x by more than FELT
    in the long run."""
    sizes = []
    for _ in range(ROUNDS):
        x = _about(N, s, x)
        sizes.append(float(np.linalg.norm(x)))
    return sizes[-1] > FELT ** (ROUNDS - ROUNDS // 2) * sizes[ROUNDS // 2 - 1]


#: tolerance of unknowns, relative to their magnitude plus their scale, that the watch for kinks assumes, since constant steps
#: have no tolerance
FOLLOWED = 1e-9
#: fractions of a step: lengths that differ by less than SAME count as equal; a step whose end is nearer than CLOSE to a kink of
#: an input ends at the kink, except for the last step of a run
SAME, CLOSE = 1e-6, 1e-3


#: largest number of steps in one native call, and in the first call where each may hide a contact or switch
ROWS, FEW = 256, 8
#: why a step could not be solved
SINGULAR = "the iteration matrix is singular: the position is singular, or the equations do not determine an unknown"


def not_finite(equation: str, t: float) -> str:
    """What a message says of an equation that has no finite value at t, s."""
    return (f"equation {equation} is not finite near t = {t:.9g} s: look in it for a division by 0, a root or logarithm of a "
            "negative number, or values that grow beyond bounds, as with too long steps")


class Blocks:
    """How many steps are made in one native call, where each may hide a contact or switch: `rows`, at most `most` (1 where every
    step has to be looked at by itself). A block of which a step has to be looked at is thrown away from there on. Where that is
    the first one, twice as many steps as the last time are made one by one before another block is tried."""

    def __init__(self, most: int, watched: bool) -> None:
        """watched: whether steps are looked at for contacts and switches."""
        self.most, self.rows = most, min(most, FEW) if watched else most
        self._singles = self._left = 0  # number of single steps after the last block, and of those that are left

    def made(self, count: int, kept: int) -> None:
        """To be called after `count` steps were made in one call, of which the first `kept` were accepted."""
        if self.rows > 1:
            self._left = self._singles = 0 if kept == count else 1 if kept else min(max(2 * self._singles, 1), self.most)
            self.rows = 1 if self._left else min(2 * self.rows, self.most)
        elif kept:
            self._left -= 1
            self.rows = 1 if self._left > 0 else min(FEW, self.most)


class StepFailedError(Exception):
    """A step could not be solved; culprit: name of the unknown or equation that prevented it."""

    def __init__(self, message: str = "a step cannot be solved", culprit: str = "") -> None:
        super().__init__(message)
        self.culprit = culprit


class Stepping(Protocol):
    """The state of a run with constant steps: the time, and the unknowns at the end of the step just solved."""

    t: float

    def reached(self) -> Array:
        """y (n,) at the end of the step."""

    def inside(self, part: Array) -> Array:
        """y (k, n) on the polynomial of the step at fractions (k,) of it, or (n,) at one fraction."""

    def advance(self, h: float, t1: float) -> tuple[Any, ...]:
        """Accept the step; returns the arguments of `loop.accept`."""


@dataclass
class Going:
    """The state of a run with constant steps that checkpoints store: the step, and the watch for contacts and kinks."""

    step: Stepping
    watch: StepWatch | None


def constant_steps(loop: StepLoop, h: float, step: Stepping, solve: Callable[[float], Any], parts: Iterable[float] = ()) -> None:
    """Make steps of h (s) to the end; the last one is shorter where h does not divide the run. A step that is too long for an
    input of time is divided.

    solve(h): solve a step; parts: fractions of a step at which contacts are sought that close and open inside it.
    """
    watch = StepWatch.of(loop, lambda y: FOLLOWED * (np.abs(y) + loop.system.scale))
    t0, going = step.t, Going(step, watch)
    loop.goes_on(going)

    def inner(width: float) -> list[tuple[float, Array]]:
        return [(step.t + part * width, step.inside(np.asarray(part))) for part in parts]

    for t1, width, whole in _steps(loop, h, step, t0):
        try:
            solve(width)
        except StepFailedError as error:
            raise loop.failure(f"a step of {width:g} s fails, try another step: {error}", error.culprit) from error
        loop.stats.shortened += not whole
        if watch is not None:
            watch.look(t1, step.reached(), step.inside)
            watch.count_hidden(partial(inner, width))
            watch.keep()
        if not loop.accept(*step.advance(width, t1)):
            return
        loop.keep(going)


def _steps(loop: StepLoop, h: float, step: Stepping, t0: float) -> Iterator[tuple[float, float, bool]]:
    """(end, length, whether the length is h) of every remaining step; t0: time from which multiples of h are counted. Steps that
    are too long for an input of time are divided, and steps end at kinks of tables."""
    longest = loop.system.longest_step
    count = max(1, ceil((loop.t_end - t0) / h - SAME))
    for k in range(1, count + 1):
        goal, least = (loop.t_end, 0.0) if k == count else (t0 + k * h, CLOSE * h)
        while goal - step.t > least:
            end, parts = goal, 1
            if longest is not None:
                stretch = longest.of_stretches(step.t)
                kink = longest.kink_after(step.t, SAME * min(h, stretch))
                end = kink if kink < goal + (least or -SAME * h) else goal
                parts = max(1, ceil((end - step.t) / stretch - SAME))
            width = (end - step.t) / parts
            whole = abs(width - h) <= SAME * h
            yield end if parts == 1 else step.t + width, h if whole else width, whole
