"""How much small disturbances grow over a run: the linearised equations, carried along its steps.

In every piece of the run E x' + A x = 0, with E = dF/dy' and A = dF/dy, is solved by one step of Radau IIA(3) for some
disturbances at once; with many unknowns E and A are those in the middle of the piece. Pieces are some steps together, as far as
that changes nothing, or parts of steps in which positions change much. `growing` sees to it that the steps of a run follow what
grows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property, partial

import numpy as np
from numpy.typing import NDArray

from mbdae.integrators import radau_table
from mbdae.integrators.matrices import IterationMatrix
from mbdae.integrators.solution import Solution, systems_at
from mbdae.native.sparse import SingularMatrixError
from mbdae.system.base import Array, System
from mbdae.system.prepare import Prepared
from mbdae.threads import check, single_threaded
from mbdae.values import largest

ROUNDED = 1e-16  #: relative round-off of a coordinate
#: words are said where round-off, as it grows over the run, may make more than this fraction of the accuracy asked
DECIDES = 1.0
LEAST = 10.0  #: growth with frozen coefficients below which round-off decides nothing that can be asked
#: largest number of unknowns for which all stages of a step are solved together, and for which all roots are computed at once:
#: with 54 to 58 unknowns of beams the first took .7 ms a piece, and equations of its middle .2
STAGED, SMALL = 24, 60
COPIES = 2  #: number of disturbances, drawn at random, that are carried along
MOST = 50_000  #: largest number of pieces of a run along which disturbances are carried
#: largest numbers of steps of the run in one piece that are tried one after the other, each where the pieces are FEWER times more
#: than before and less than the finest, until the largest rise (natural logarithm) changes by less than SURE, or by less than
#: CLEAR of its distance from the value on which a decision depends
TOGETHER, FEWER, SURE, CLEAR = (32, 16, 8, 4, 2, 1), 1.5, 0.5, 0.3
DIGITS = 3  #: decimals with which a growth (natural logarithm) is told: it is sure to SURE
BLOCK = 2**13  #: number of pieces whose matrices, or states, are computed together, times the size of one of them
SLACK = 3.0  #: growth (natural logarithm) beyond that asked for after which it is not carried on
TINY = 1e-300
VANISHED = 1e-150  #: size of a disturbance, after a step from size 1, below which nothing is left of it: no motion is free
#: largest change of a position in a piece, in pieces of several steps up to WIDER times as large; largest number of parts of a
#: step
TURNED, WIDER, PARTS = 0.1, 8, 16
PLACES = 50  #: number of times at which the largest coordinate is sought


class Disturbances:
    """Small disturbances of a run of a system, as they grow along its steps."""

    def __init__(self, system: System, run: Solution, longest: float = math.inf) -> None:
        """longest: of the pieces of the run along which they are carried, s."""
        self._system, self._run, self._longest = system, run, longest
        self._matrix: IterationMatrix | None = None
        kinds = np.array(system.kinds)
        self._fast = kinds == "v"
        self._slow = ~np.isin(kinds, ("v", "lambda", "mu", "z"))
        self._others = ~(self._slow | self._fast)  # they follow from the positions and velocities

    def growth(self, enough: float = math.inf) -> tuple[float, float] | None:
        """(natural logarithm of the largest factor by which a disturbance grows from one time of the run to a later one, time of
        the largest, s). It ends early where the logarithm exceeds `enough`. None where `course` is None."""
        course = self.course(enough)
        return None if course is None else rise(course)

    @single_threaded
    def course(self, enough: float = math.inf, least: float = 0.0) -> tuple[Array, Array] | None:
        """Times (k,), s, at the ends of pieces of the run, and there the natural logarithm of the size (k,) of the disturbances
        that grow most. Velocities are measured in units in which they are as large as the positions in the median, so that a
        vibration rises by nothing. The pieces are halved until the largest rise stays, is surely below `least`, or above or below
        `enough`. None where an impact leaves it unknown, equations are singular, or there are more than MOST pieces."""
        if self._run.stats.contacts or len(self._run.t) < 2:
            return None
        finest, found, fewest = self._pieces(1), None, 0.0
        for together in TOGETHER:
            ends = self._pieces(together) if together > 1 else finest
            if together > 1 and not fewest <= len(ends) <= len(finest) / FEWER:
                continue
            before, found, fewest = found, self._along(ends, enough) if len(ends) <= MOST else None, FEWER * len(ends)
            if found is None or (before is not None and _settled(rise(before)[0], rise(found)[0], enough, least)):
                break
        return found

    def _along(self, ends: Array, enough: float) -> tuple[Array, Array] | None:
        """`course` by the pieces of the run between `ends` (s)."""
        x = np.where(self._others[:, None], 0.0, spread((COPIES, self._system.n)).T)
        carried, sizes, size, least = list[Array](), list[float](), 0.0, 0.0
        try:
            for step in self._steps(ends):
                x = step(x)
                now = math.sqrt(float(np.vdot(x, x)))
                if not (math.isfinite(now) and now > VANISHED):
                    return None
                carried.append(x)
                sizes.append(size)
                x, size = x / now, size + math.log(now)
                least = min(least, size) if len(sizes) > 1 else size
                if size - least > enough + SLACK:
                    break
        except (SingularMatrixError, np.linalg.LinAlgError):
            return None
        slow, fast = (np.log(np.maximum(np.linalg.norm(np.array(carried)[:, kind], axis=(1, 2)), TINY)) + sizes
                      for kind in (self._slow, self._fast))
        return ends[1 : 1 + len(slow)], np.logaddexp(2 * slow, 2 * (fast + np.median(slow - fast))) / 2

    def _pieces(self, together: int) -> Array:
        """Times (s) that divide the run into pieces in which no position changes by more than TURNED (over its scale): of at most
        so many steps `together`, or parts of a step."""
        run, here = self._run, np.array(self._system.kinds) == "q"
        moved = np.max(np.abs(np.diff(run.y[:, here] / self._system.scale[here], axis=0)), axis=1, initial=0.0)
        moved, long = moved / (TURNED * min(together, WIDER)), np.diff(run.t) / self._longest
        count = np.maximum(np.clip(np.ceil(moved), 1, PARTS), np.ceil(long)).astype(int)
        moved = np.maximum(moved, long)
        filled = np.floor(np.cumsum(np.clip(moved, 1 / together, 1.0)) + 1e-9)
        last = np.append(filled[1:] != filled[:-1], True) if len(filled) else np.zeros(0, dtype=bool)
        last |= count > 1
        last[:-1] |= count[1:] > 1
        last[np.minimum(np.searchsorted(run.t[1:], self._edges), len(last) - 1)] = True
        count[~last] = 0
        step = np.repeat(np.arange(len(count)), count)
        part = np.arange(len(step)) + 1 - (np.cumsum(count) - count)[step]
        inside = run.t[step] + np.diff(run.t)[step] * part / count[step]
        return np.concatenate([run.t[:1], np.where(part < count[step], inside, run.t[1:][step])])

    @cached_property
    def _edges(self) -> Array:
        """Times (s) between which inputs of time are smooth and vary little, as far as the equations know them."""
        t0, t1 = float(self._run.t[0]), float(self._run.t[-1])
        line = None if self._system.timeline is None else self._system.timeline(t0, t1)
        return np.zeros(0) if line is None else np.concatenate([line.edges, line.stretches.edges, line.stretches.kinks])

    def _steps(self, ends: Array) -> Iterator[Callable[[Array], Array]]:
        """For every piece of the run the function that takes disturbances (n, k), over the scales of the unknowns, from its begin
        to its end."""
        middle, h = (ends[1:] + ends[:-1]) / 2, np.diff(ends)
        systems = systems_at(self._run, middle, self._system)
        n, together = self._system.n, self._system.n <= STAGED
        block = BLOCK // (n**2 if together else n) + 1
        for first in range(0, len(h), block):
            check("the growth of small disturbances was computed")
            some = slice(first, first + block)
            if together:
                for system in dict.fromkeys(systems[some]):
                    own = [i for i in range(first, min(first + block, len(h))) if systems[i] is system]
                    yield from (by.__matmul__ for by in self._exactly(system, ends[own], h[own]))
                continue
            states = self._run(middle[some]), self._run.derivative(middle[some])
            for i, (y, yp) in enumerate(zip(*states, strict=True), first):
                yield partial(self._carried, systems[i], float(middle[i]), y, yp, float(h[i]))

    def _exactly(self, system: System, t: Array, h: Array) -> Array:
        """The matrices (k, n, n) by which disturbances, over the scales of the unknowns, are multiplied in k pieces of lengths h
        (s) from times t (s) on, with the equations at all stages of Radau IIA(3): where a motion passes an unstable rest several
        times, what grew there fades before the next, which frozen equations do not reproduce."""
        table, k, n = radau_table(3), len(t), system.n
        times = np.minimum((t[:, None] + table.c * h[:, None]).ravel(), self._run.t[-1])
        A, E = (part.reshape(k, 3, n, n) * system.scale for part in system.dense_stages(
            times, self._run(times), self._run.derivative(times)))
        M = np.einsum("kiab,ij,k->kiajb", A, table.A, h)
        for i in range(3):
            M[:, i, :, i] += E[:, i]
        M, right = M.reshape(k, 3 * n, 3 * n), -A.reshape(k, 3 * n, n)
        size = np.max(np.abs(M), axis=2, keepdims=True)
        rates = np.linalg.solve(M / size, right / size).reshape(k, 3, n, n)
        found = np.eye(n) + np.einsum("j,kjab,k->kab", table.b, rates, h)
        found[:, self._others] = 0.0
        return np.asarray(found)

    def _carried(self, system: System, t: float, y: Array, yp: Array, h: float, x: Array) -> Array:
        """Disturbances (n, k), over the scales of the unknowns, at the end of a piece h (s) from those at its begin; t, y, yp:
        time (s) and state in its middle, with whose equations it is made."""
        real, pair, weights = _weights()
        if self._matrix is None or self._matrix.system is not system:
            self._matrix = IterationMatrix(system, real, pair)
        matrix = self._matrix
        matrix.refresh(t, y, yp)
        matrix.factor(h)
        out = np.empty_like(x)
        for k, one in enumerate(x.T * system.scale):
            right = matrix.row * matrix.mass(one) / h
            parts = [weight * factors.solve(right) for weight, factors in zip(weights, matrix.factors, strict=True)]
            out[:, k] = matrix.column * sum(part if part.dtype.kind == "f" else 2 * part.real for part in parts) / system.scale
        out[self._others] = 0.0
        return out


@dataclass(frozen=True, eq=False)
class Amplified:
    """The growth of disturbances over a run (natural logarithm of the factor), None where not known; computed when it is called.
    A copy in another process does not have the equations and returns None."""

    run: Solution

    def __call__(self) -> float | None:
        found = Disturbances(self.run.systems[0][1], self.run).growth() if self.run.systems else None
        return None if found is None else round(found[0], DIGITS)


def decided_by_round_off(prepared: Prepared | None, run: Solution, frozen: float, accuracy: float) -> list[str]:
    """Words about a run in which small disturbances grow so much that round-off decides digits of the accuracy asked. prepared:
    None for own equations; frozen: the sum of the growth with frozen coefficients; where it is too small for that, the growth
    along the run is not computed."""
    system = run.systems[0][1]
    if frozen < LEAST:
        return []
    enough = math.log(DECIDES * accuracy / (ROUNDED * (1.0 if prepared is None else _farthest(prepared, run))))
    found = Disturbances(system, run).growth(enough) if frozen > enough else None
    if found is None or found[0] < enough:
        return []
    factor = f"e^{found[0]:.0f} (1e{found[0] / math.log(10):.0f})"
    decisive = accuracy * math.exp(-min(found[0], 300.0))
    measure = "the scene's length (or rad)" if prepared is not None else "the scale of an unknown"
    return [f"small disturbances grow by a factor of {factor} up to t = {found[1]:.4g} s: what is below {decisive:.0e} of "
            f"{measure} at the start, round-off too, decides whether an accuracy of {accuracy:g} is kept; a shorter run, or a "
            "start farther from the unstable rest, can be predicted"]


def _farthest(prepared: Prepared, run: Solution) -> float:
    """Largest coordinate of a place of a body in a run over the scene's length, 1 where that is less (angles in rad)."""
    some = run.t[:: len(run.t) // PLACES + 1]
    q = prepared.states(some, run(some))[0]
    places = [np.max(np.abs(q[:, node.q : node.q + node.kind.translations])) for node in prepared.model.nodes
              if node.unit == "m" and node.kind.translations]
    return max(1.0, float(max(places, default=0.0)) / prepared.length)


def spread(shape: tuple[int, int]) -> Array:
    """Numbers from -1 to 1 without any pattern that equations could have, for disturbances in all directions."""
    return np.cos(np.arange(1.0, shape[0] * shape[1] + 1) ** 2 * math.sqrt(2)).reshape(shape)


def _settled(before: float, now: float, enough: float, least: float) -> bool:
    """Whether the largest rise, which was `before` with pieces twice as long, is known as `Disturbances.course` needs it."""
    left = abs(now - enough) if math.isfinite(enough) else least - now
    return abs(now - before) < max(SURE, CLEAR * left)


def rise(course: tuple[Array, Array]) -> tuple[float, float]:
    """The largest rise of a course, and the time (s) of its end."""
    t, size = course
    rises = size - np.minimum.accumulate(size)
    i = largest(rises)
    return float(rises[i]), float(t[i])


@cache
def _weights() -> tuple[Array, NDArray[np.complex128], tuple[complex, ...]]:
    """The real and the complex eigenvalue m of A^-1 of Radau IIA(3), and the weights w with which one of its steps of h is the
    sum of w (m E / h + A)^-1 E / h, of the complex one twice the real part."""
    table = radau_table(3)
    values, vectors = np.linalg.eig(table.A_inv)
    start = np.linalg.solve(vectors.astype(complex), np.ones(len(values), complex))
    weights = vectors[-1] * values * start
    found = []
    for value in (*table.real, *table.pairs):
        j = int(np.argmin(np.abs(values - value)))
        found.append(weights[j].real if abs(values[j].imag) < 1e-9 else weights[j])
    return table.real, table.pairs, tuple(found)
