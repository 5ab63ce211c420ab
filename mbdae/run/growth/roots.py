"""The roots of the linearised equations at states of a run, with frozen coefficients: which disturbances grow, and which of them
are too small to be seen by the error test of a solver."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.integrators.matrices.iteration import IterationMatrix
from mbdae.native.sparse import SingularMatrixError
from mbdae.run.growth.amplification import SMALL, full_jacobians, spread
from mbdae.system.base import Array, System

#: growth (natural logarithm of the factor) over the whole run below which steps are not bounded: a disturbance below a third of
#: the accuracy does not reach three times the accuracy by it
HARMLESS = 2.0
#: largest number of unknowns for which all roots are computed; above SMALL only where `_rises` finds that something grows
MOST = 300
#: roots are found best near SHIFT over the step; those beyond RESOLVED times that are left out: constraints have infinite roots,
#: which are inexact in a computer
SHIFT, RESOLVED = 3.0, 1e3
ALIKE = 1e-5  #: relative difference of roots that count as equal
#: number of multiplications by which growth is sought among many roots, and the ratio by which it then shows from their middle to
#: their end: the largest that vibrations alone gave was 1.1
ROUNDS, GROWS = 20, 1.5


class Look(NamedTuple):
    """A state of a run at which roots are sought: the equations there, time (s), y and y' (n,), the step of the run (s), and the
    length of the run (s)."""

    system: System
    t: float
    y: Array
    yp: Array
    h: float
    span: float


class Found(NamedTuple):
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


def found_at(looks: list[Look], seen: float) -> list[Found]:
    """What is found at every state; seen: size of a disturbance that is seen, over the scales of the positions."""
    system = looks[0].system
    if system.n > MOST or (system.n > SMALL and system.has_pattern):
        rising = _rising_sparse(looks)
        if system.n > MOST or not any(rising):
            return [Found(1 / look.h, 1 / look.h) if up else Found() for look, up in zip(looks, rising, strict=True)]
    shifted = _shifted(looks)
    if system.n <= SMALL:
        return [_roots(look, S, values, seen) for look, S, values in zip(looks, shifted, np.linalg.eigvals(shifted), strict=True)]
    return [_roots(look, S, np.linalg.eigvals(S), seen) if _grows(S) else Found()
            for look, S in zip(looks, shifted, strict=True)]  # fmt: skip


def _roots(look: Look, S: Array, values: NDArray[np.complex128], seen: float) -> Found:
    """What is found at a state, from the matrix of `_shifted` and its eigenvalues."""
    roots = _back(values, look.h)
    rate = float(np.max(roots.real, initial=0.0))
    if rate * look.span < HARMLESS:
        return Found(rate)
    return _unseen(look, S, values[roots.real * look.span > HARMLESS], seen)._replace(rate=rate)


def vibrating(looks: list[Look], seen: float) -> list[Found]:
    """Of disturbances that neither grow nor decay with frozen coefficients what `found_at` finds of growing ones."""
    found = []
    for look, S in zip(looks, _shifted(looks), strict=True):
        values = np.linalg.eigvals(S)
        roots = _back(values, look.h)
        idle = (np.abs(roots.real) * look.span < np.abs(roots.imag)) & (np.abs(roots.imag) * look.span > HARMLESS)
        found.append(_unseen(look, S, values[idle], seen))
    return found


def _unseen(look: Look, S: Array, wanted: NDArray[np.complex128], seen: float) -> Found:
    """Of some eigenvalues (k,) of S, the matrix of `_shifted`, the roots whose disturbances in the motion are smaller than
    `seen`."""
    (values, right), (others, left) = ((np.asarray(part, complex) for part in np.linalg.eig(M)) for M in (S, S.T))
    i, j = _nearest(values, wanted), _nearest(others, wanted)
    V, W, roots = right[:, i], left[:, j], _back(np.asarray(values[i], complex), look.h)
    try:
        shares = np.linalg.solve(W.T @ V, W.T @ (look.yp / look.system.scale)) / np.abs(roots)
    except np.linalg.LinAlgError:
        shares = np.zeros(len(i), complex)
    parts = V[positions(look.system)] * shares
    alike = np.abs(roots[:, None] - roots) < ALIKE * np.abs(roots)  # roots that are equal share a plane of disturbances
    sizes = np.array([np.max(np.abs(np.sum(parts[:, group], axis=1)), initial=0.0) for group in alike])
    small = sizes < seen
    return Found(0.0, float(np.max(np.abs(roots[small]), initial=0.0)), np.asarray(parts[:, small], complex), roots[small])


def _nearest(values: NDArray[np.complex128], wanted: NDArray[np.complex128]) -> NDArray[np.int64]:
    """Indices of values (n,), each once, that are nearest to the wanted ones (k,)."""
    free, found = np.ones(len(values), dtype=bool), []
    for one in wanted:
        found.append(int(np.argmin(np.where(free, np.abs(values - one), np.inf))))
        free[found[-1]] = False
    return np.array(found, dtype=int)


def positions(system: System) -> NDArray[np.bool_]:
    """Which unknowns are positions, or, where none are, are differential."""
    kinds = np.array(system.kinds)
    return kinds == "q" if np.any(kinds == "q") else ~np.isin(kinds, ("lambda", "mu", "z"))


def _shifted(looks: list[Look]) -> Array:
    """The matrices (k, n, n) (E + h A / SHIFT)^-1 E of the linearised equations E x' + A x = 0 at k states, in scaled unknowns. A
    root r of the equations is an eigenvalue 1 / (1 - h r / SHIFT); infinite roots, of constraints, are 0. A matrix is 0 where the
    equations are singular."""
    scale, h = looks[0].system.scale, np.array([look.h for look in looks])[:, None, None]
    parts = [full_jacobians(look.system, look.t, look.y, look.yp) for look in looks]
    A, E = (np.array(part) for part in zip(*parts, strict=True))
    both, E = (A * (h / SHIFT) + E) * scale, E * scale
    size = np.max(np.abs(both), axis=2, keepdims=True)
    sound = np.isfinite(both).all(axis=(1, 2)) & np.all(size > 0, axis=(1, 2))
    out = np.zeros_like(both)
    for i in np.flatnonzero(sound):
        with suppress(np.linalg.LinAlgError):
            out[i] = np.linalg.solve(both[i] / size[i], E[i] / size[i])
    return np.asarray(out)


def _back(values: NDArray[np.complex128], h: float) -> NDArray[np.complex128]:
    """The roots (1/s) that belong to eigenvalues of the matrix of `_shifted`; -inf beyond RESOLVED times SHIFT / h."""
    finite = np.abs(values) * RESOLVED > 1
    return np.where(finite, (SHIFT / h) * (1 - 1 / np.where(finite, values, 1.0)), -np.inf)


def _grows(S: Array) -> bool:
    """Whether one of many roots r has a positive real part, from the matrix S of `_shifted`: three disturbances are multiplied
    ROUNDS times by 2 S - 1, that is (1 + z) / (1 - z) with z = h r / SHIFT, whose magnitude is 1 for undamped vibrations."""
    return _rises(lambda x: np.asarray(S @ x), spread((len(S), 3)))


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
        found.append(_rises(partial(_product, matrix, scale, SHIFT / look.h), spread((look.system.n, 3))))
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
    sizes = []
    for _ in range(ROUNDS):
        x = 2 * product(x) - x
        sizes.append(float(np.linalg.norm(x)))
    half = ROUNDS // 2
    return max(sizes[-2:]) > GROWS * max(sizes[half - 2 : half])
