"""The roots of the linearised equations at states of a run, with frozen coefficients: which disturbances grow, and which of them
are too small to be seen by the error test of a solver; and whether what decays held the steps short."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import log
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import distinct, median
from mbdae.integrators.base import Solver
from mbdae.integrators.matrices import IterationMatrix
from mbdae.integrators.solution import Solution, systems_at
from mbdae.native.sparse import SingularMatrixError
from mbdae.run.amplification import COPIES, SMALL, TINY, spread
from mbdae.system.base import Array, System

#: growth (natural logarithm of the factor) over the whole run below which steps are not bounded: a disturbance below a third of
#: the accuracy does not reach three times the accuracy by it
HARMLESS = 2.0
#: the steps follow what varies visibly, and that shakes vibrations of up to EXCITED / step (1/s) into growth: those of half its
#: frequency most, and of few multiples of that. Measured: a cantilever of which the stiffest vibration, 2300 / step, was followed
#: took 57 662 steps where 12 do
EXCITED = 10.0
#: largest number of unknowns for which all roots are computed; above SMALL only where `_rises` finds that something grows: with
#: fewer, too, that would miss what vibrates within a step and grows slowly (van der Pol's oscillator beside others)
MOST = 300
#: roots are found best near SHIFT over the step; those beyond RESOLVED times that are left out: constraints have infinite roots,
#: which are inexact in a computer
SHIFT, RESOLVED = 3.0, 1e3
ALIKE = 1e-5  #: relative difference of roots that count as equal
#: number of multiplications by which growth is sought among many roots, and the ratio by which it then shows from their middle to
#: their end: the largest that vibrations alone gave was 1.1. What moves freely grows by 2 there, as a number proportional to the
#: time does, and by 2 again in as many multiplications more as there were; what grows at a rate does by the square of the ratio
ROUNDS, GROWS, FASTER = 20, 1.5, 1.5
#: number of eigenvectors a matrix up to which solving for each takes less time than finding all, and the relative distance from
#: an eigenvalue at which it is solved
FEW, BESIDE = 4, 1e-11
Values = NDArray[Any]  #: numbers, real or complex


class Look(NamedTuple):
    """A state of a run at which roots are sought: the equations there, time (s), y and y' (n,), the step of the run (s), and the
    length of the run (s)."""

    system: System
    t: float
    y: Array
    yp: Array
    h: float
    span: float


class GrowthFound(NamedTuple):
    """What a look finds. rate: the largest real part of a root, 1/s; unseen: the largest magnitude (1/s) of one that grows and
    whose disturbance is not seen, 0: there is none; parts (positions, k), roots (k,): these disturbances in the motion, over the
    scales of the positions, and their roots."""

    rate: float = 0.0
    unseen: float = 0.0
    parts: NDArray[np.complex128] = np.zeros((0, 0), complex)
    roots: NDArray[np.complex128] = np.zeros(0, complex)

    @property
    def size(self) -> float:
        """Size of all disturbances together, over the scales of the positions."""
        return float(np.max(np.abs(np.sum(self.parts, axis=1)), initial=0.0))

    def after(self, time: float, faster: float) -> float:
        """Their size after a time (s), with the roots times `faster`."""
        return float(np.max(np.abs(self.parts @ np.exp(self.roots * (time * faster))), initial=0.0))


class Spectra(NamedTuple):
    """The roots at some states: S (k, n, n), the matrices of `_shifted`, their eigenvalues and the roots (k, n) that belong to
    them, 1/s. With too many unknowns S is empty, and there is one root at every state: 1 over the step where something grows."""

    looks: list[Look]
    S: Array
    values: Values
    roots: Values

    @property
    def rates(self) -> Array:
        """The largest real part of a root at every state (k,), 1/s."""
        return np.asarray(np.max(self.roots.real, axis=1, initial=0.0))

    def found(self, seen: float) -> list[GrowthFound]:
        """What is found at every state; seen: size of a disturbance that is seen, over the scales of the positions."""
        rates = self.rates.tolist()
        if not self.S.size:
            return [GrowthFound(rate, rate) for rate in rates]
        grow = self.roots.real * self.looks[0].span > HARMLESS
        unseen = self._unseen(grow, seen) if max(rates) * self.looks[0].span > HARMLESS else [GrowthFound()] * len(rates)
        return [one._replace(rate=rate) for one, rate in zip(unseen, rates, strict=True)]

    def idle(self, seen: float) -> list[GrowthFound]:
        """Of disturbances that neither grow nor decay with frozen coefficients, and that the equations may shake into growth as
        they vary, what `found` finds of growing ones."""
        span, turning = self.looks[0].span, np.abs(self.roots.imag)
        shaken = (turning * span > HARMLESS) & (turning * np.array([look.h for look in self.looks])[:, None] < EXCITED)
        return self._unseen((np.abs(self.roots.real) * span < turning) & shaken, seen)

    def _unseen(self, wanted: NDArray[np.bool_], seen: float) -> list[GrowthFound]:
        """Of the wanted roots (k, n) those whose disturbances in the motion are smaller than `seen`, at every state."""
        at, found, looks = np.nonzero(wanted)[0], [GrowthFound()] * len(self.looks), self.looks
        if not len(at):
            return found
        right, left = _vectors(self.S, at, self.values[wanted])
        roots, together = np.asarray(self.roots[wanted], complex), at[:, None] == at
        motion = np.array([look.yp for look in looks]) / looks[0].system.scale
        try:
            shares = np.linalg.solve((left @ right.T) * together, np.sum(left * motion[at], axis=1)) / np.abs(roots)
        except np.linalg.LinAlgError:
            shares = np.zeros(len(at), complex)
        parts = right.T[positions(looks[0].system)] * shares
        alike = together & (np.abs(roots[:, None] - roots) < ALIKE * np.abs(roots))  # equal roots share a plane of disturbances
        small = np.max(np.abs(parts @ alike), axis=0, initial=0.0) < seen
        for i in distinct(at[small]).tolist():
            these = small & (at == i)
            found[i] = GrowthFound(0.0, float(np.max(np.abs(roots[these]))), parts[:, these], roots[these])
        return found


def roots_at(looks: list[Look]) -> Spectra:
    """The roots at some states of a system."""
    system, h = looks[0].system, np.array([look.h for look in looks])[:, None]
    if system.n > MOST or (system.n > SMALL and system.has_pattern):
        rising = np.array(_rising_sparse(looks))[:, None]
        if system.n > MOST or not np.any(rising):
            return Spectra(looks, np.zeros((0, 0, 0)), np.zeros(0), np.where(rising, 1 / h, -np.inf))
    S = _shifted(looks)
    if system.n <= SMALL:
        values = np.linalg.eigvals(S)
    else:
        values = np.array([np.linalg.eigvals(one) if _grows(one) else np.zeros(system.n) for one in S])
    finite = np.abs(values) * RESOLVED > 1
    return Spectra(looks, S, values, np.where(finite, (SHIFT / h) * (1 - 1 / np.where(finite, values, 1.0)), -np.inf))


def _vectors(shifted: Array, at: NDArray[np.int64], values: Values) -> tuple[Values, Values]:
    """Right and left eigenvectors (k, n), one a row, to eigenvalues (k,) of the matrices (states, n, n) with the indices at (k,).
    Few are found by solving twice with a matrix that is all but singular, from vectors that differ, as those of equal eigenvalues
    do."""
    n = shifted.shape[1]
    values = values if np.any(values.imag) else values.real
    if len(values) > FEW * len(distinct(at)):
        found = [np.linalg.eig(S) for S in (shifted, shifted.transpose(0, 2, 1))]
        right, left = (np.array([vectors[i][:, j] for i, j in zip(at, _nearest(others, at, values), strict=True)])
                       for others, vectors in found)
        return right, left
    M = shifted[at] - (values * (1 + BESIDE))[:, None, None] * np.eye(n)
    both, x = np.concatenate([M, M.transpose(0, 2, 1)]), np.tile(spread((len(at), n)), (2, 1))[:, :, None]
    for _ in range(2):
        x = np.linalg.solve(both, x)
        x = x / np.max(np.abs(x), axis=1, keepdims=True)
    return x[: len(at), :, 0], x[len(at) :, :, 0]


def _nearest(values: Values, at: NDArray[np.int64], wanted: Values) -> list[int]:
    """Of eigenvalues (states, n) the indices, each once, that are nearest to the wanted ones (k,) of the states at (k,)."""
    free, found = np.ones(values.shape, dtype=bool), []
    for i, one in zip(at, wanted, strict=True):
        found.append(int(np.argmin(np.where(free[i], np.abs(values[i] - one), np.inf))))
        free[i, found[-1]] = False
    return found


def positions(system: System) -> NDArray[np.bool_]:
    """Which unknowns are positions, or, where none are, are differential."""
    kinds = np.array(system.kinds)
    return kinds == "q" if np.any(kinds == "q") else ~np.isin(kinds, ("lambda", "mu", "z"))


def _shifted(looks: list[Look]) -> Array:
    """The matrices (k, n, n) (E + h A / SHIFT)^-1 E of the linearised equations E x' + A x = 0 at k states, in scaled unknowns. A
    root r of the equations is an eigenvalue 1 / (1 - h r / SHIFT); infinite roots, of constraints, are 0. A matrix is 0 where the
    equations are singular."""
    system, h = looks[0].system, np.array([look.h for look in looks])[:, None, None]
    if any(look.system is not system for look in looks):
        return np.concatenate([_shifted([look]) for look in looks])
    A, E = system.dense_stages(*(np.array(part) for part in zip(*((look.t, look.y, look.yp) for look in looks), strict=True)))
    both, E = (A * (h / SHIFT) + E) * system.scale, E * system.scale
    size = np.abs(both).max(axis=2, keepdims=True)
    if not 0 < size.min() <= size.max() < np.inf:
        sound = np.all(np.isfinite(size) & (size > 0), axis=1, keepdims=True)
        size, both, E = (np.where(sound, part, other) for part, other in ((size, 1.0), (both, np.eye(system.n)), (E, 0.0)))
    both, E = both / size, E / size
    try:
        return np.asarray(np.linalg.solve(both, E))
    except np.linalg.LinAlgError:
        return np.zeros_like(both) if len(looks) == 1 else np.concatenate([_shifted([look]) for look in looks])


def _grows(S: Array) -> bool:
    """Whether one of many roots r has a positive real part, from the matrix S of `_shifted`: some disturbances are multiplied
    ROUNDS times by 2 S - 1, that is (1 + z) / (1 - z) with z = h r / SHIFT, whose magnitude is 1 for undamped vibrations."""
    return _rises(lambda x: np.asarray(S @ x), spread((len(S), COPIES)))


def _rising_sparse(looks: list[Look]) -> list[bool]:
    """As `_grows`, at every state of a system with a sparsity pattern, or with too many unknowns for full matrices."""
    matrix, found = None, []
    for look in looks:
        scale = look.system.scale
        if matrix is None or matrix.system is not look.system:
            matrix = IterationMatrix(look.system, np.ones(1), np.zeros(0, complex))
        try:
            matrix.refresh(look.t, look.y, look.yp)
            matrix.factor(look.h / SHIFT)
        except SingularMatrixError:
            found.append(False)
            continue
        found.append(_rises(partial(_product, matrix, scale, SHIFT / look.h), spread((look.system.n, COPIES))))
    return found


def _product(matrix: IterationMatrix, scale: Array, inverse: float, x: Array) -> Array:
    """The matrix of `_shifted` times x (n, k), with sparse factors; inverse: 1 over the step for which they were made (1/s)."""
    right = np.array([matrix.mass(one) for one in x.T * scale]) * inverse
    return np.asarray((matrix.solved(right) / scale).T)


def _rises(product: Callable[[Array], Array], x: Array) -> bool:
    """Whether repeated multiplication of x (n, k) by 2 S - 1 makes it grow, S: the matrix whose `product` is given. The first
    products, with S alone, remove what constraints do not allow."""
    for _ in range(3):
        x = product(x)
    sizes, half = [0.0], ROUNDS // 2

    def at(rounds: int) -> float:
        """Logarithm of the larger of the last two sizes."""
        nonlocal x
        for _ in range(rounds + 1 - len(sizes)):
            x = 2 * product(x) - x
            size = float(np.linalg.norm(x)) + TINY
            sizes.append(sizes[-1] + log(size))
            x = x / size
        return max(sizes[-2:])

    first, second = at(half), at(ROUNDS)
    return second - first > log(GROWS) and at(2 * ROUNDS) - 2 * second + first > log(FASTER)


#: HELD: decay within a step (rate times step, median over some steps of the run) from which on stability and not the error test
#: held the steps, where MANY_STEPS or more were made. Measured with CVODE (Adams) and DOP853 at 1e-3 to 1e-9: 4.5 to 150 on
#: Robertson's reaction, HIRES, the Oregonator and a decay at 1e4 1/s; at most 1.9 where the decay is not faster than ten times
#: what drives it
HELD, MANY_STEPS, SOME, LARGE_MATRIX = 3.0, 1000, 8, 100


def held_by_stability(solver: Solver, solution: Solution) -> str:
    """The hint that a method for equations that are not stiff was stepped through stiff ones; "" where it was not."""
    if solver.highest_index or solver.bdf_order or solution.stats.steps < MANY_STEPS or not solution.systems:
        return ""
    at = solution.t[np.linspace(0, len(solution.t) - 1, SOME + 1).astype(int)[1:] - 1]
    h, decays = solution.t[np.searchsorted(solution.t, at) + 1] - at, []
    for system, t, y, yp in zip(systems_at(solution, at, solution.systems[0][1]), at, solution(at), solution.derivative(at),
                                strict=True):
        if system.n > LARGE_MATRIX or system.guards is not None or system.sampled is not None:
            return ""
        A, E = system.dense_parts(float(t), y, yp)
        rates = np.linalg.eigvals(-np.linalg.solve(E, A))
        decays.append(float(np.max(-rates.real, where=np.abs(rates.real) > np.abs(rates.imag), initial=0.0)))
    if not median(h * decays) > HELD:
        return ""
    return (f"the equations are stiff: what decays within a fraction of a step held the {solution.stats.steps} steps of "
            f"{solver.label} short, and not its error; mb.RadauIIA(3), or mb.CVODE(method='BDF'), takes far fewer")
