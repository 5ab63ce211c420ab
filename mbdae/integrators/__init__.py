"""Solvers, each in a file with its kin, and the coefficients of collocation methods; all use the same step loop.

A run that is kept in a folder (`integrators/stored_runs.py`, `record.py`) is a list of stretches, each one call of
`Solver.integrate`. A solver that calls `loop.goes_on(method)` before its first step and `loop.keep(method)` between steps goes
on from any of them: `snapshot` reads its state off its objects, and what needs more than that has `snapshot` and `go_back` (LU
factors). All others begin anew every so many steps. What a System remembers beside y is told by `memory` and taken by
`remember`.

Coefficients are computed from the nodes c_1 < ... < c_s in (0, 1], by which a collocation method with s stages is known, and
checked where they are made (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., IV.5 and IV.8).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from mbdae.errors import OptionError
from mbdae.system.base import Array
from mbdae.values import array, option, whole

#: largest absolute error up to which the conditions on a table (quadrature, collocation, inverse, transformation, embedded
#: formula) count as fulfilled; else the table is refused
EXACT = 1e-11


@dataclass(frozen=True)
class CollocationTable:
    """One collocation method in the letters of Hairer and Wanner.

    order    p: the local error of an ordinary differential equation is O(h^(p + 1))
    c        (s,) nodes
    A        (s, s) Runge-Kutta matrix
    b        (s,) weights of the stage slopes k_i at the end of the step: y1 = y0 + h sum b_i k_i
    A_inv    (s, s) inverse of A: h y'_i = sum_j A_inv[i, j] Z_j with the stage increments Z
    real     (r,) real eigenvalues of A_inv, r = s mod 2
    pairs    (m,) complex eigenvalues of A_inv, the one with positive imaginary part of each pair
    T, T_inv (s, s) real form of the eigenvectors: rows of T_inv give the real part(s), then Re and Im per pair
    gamma0   weight of the start slope in the embedded formula
    e        (s,) weights of the increments in the embedded error: gamma0 h y'_0 + sum e_i Z_i
    V_inv    (s, s) increments at the nodes -> coefficients of theta, theta^2, ... of the collocation polynomial
    """

    order: int
    c: Array
    A: Array
    b: Array
    A_inv: Array
    real: Array
    pairs: NDArray[np.complex128]
    T: Array
    T_inv: Array
    gamma0: float
    e: Array
    V_inv: Array

    def __post_init__(self) -> None:
        """Check collocation (stage order s), quadrature of the order stated, the transformation and the embedded formula."""
        s = len(self.c)
        k = np.arange(1, max(self.order, s) + 1)
        powers = self.c[:, None] ** (k - 1)
        conditions = {
            "quadrature": (self.b @ powers - 1 / k)[: self.order],
            "collocation": self.A @ powers[:, :s] - self.c[:, None] ** k[:s] / k[:s],
            "inverse": self.A @ self.A_inv - np.eye(s),
            "transformation": self.T @ self._blocks() @ self.T_inv - self.A_inv,
            "embedded": (self.e @ self.A) @ powers[:, :s] + self.gamma0 * (k[:s] == 1),
        }
        for condition, defect in conditions.items():
            if not np.abs(defect).max() < EXACT:
                raise OptionError(f"nodes {self.c.tolist()}, order {self.order}: the {condition} condition is off "
                                  f"by {np.abs(defect).max():.1e} in the coefficients made of them: give the order that the "
                                  "quadrature on these nodes has, or nodes farther apart")

    @property
    def stiffly_accurate(self) -> bool:
        """Whether the last stage is the end of the step, so that all equations hold there."""
        return bool(self.c[-1] == 1.0)

    @cached_property
    def end(self) -> Array:
        """(s,) weights of the increments Z in the increment of the whole step: b A_inv."""
        return np.eye(len(self.c))[-1] if self.stiffly_accurate else np.asarray(self.b @ self.A_inv)

    def _blocks(self) -> Array:
        """Real block-diagonal form (s, s) of A_inv, a block of 2 by 2 for every complex pair: A_inv = T blocks T_inv."""
        blocks = np.diag(np.concatenate([self.real, np.repeat(self.pairs.real, 2)]))
        for j, value in enumerate(self.pairs):
            k = len(self.real) + 2 * j
            blocks[k, k + 1], blocks[k + 1, k] = -value.imag, value.imag
        return blocks

    def values(self, theta: Array) -> Array:
        """Weights (..., s) of the increments in the collocation polynomial at theta (...) of the step."""
        return np.asarray(theta[..., None] ** np.arange(1, len(self.c) + 1) @ self.V_inv)

    def slopes(self, theta: Array) -> Array:
        """Weights (..., s) of the increments in the derivative of the collocation polynomial with respect to theta."""
        k = np.arange(1, len(self.c) + 1)
        return np.asarray((k * theta[..., None] ** (k - 1)) @ self.V_inv)


def collocation_table(nodes: Any, order: int) -> CollocationTable:
    """The method on nodes (s,), increasing in (0, 1], of the order (s to 2 s) that its quadrature has; OptionError where a
    condition does not hold."""
    c: Array = option("nodes", nodes, array, "give increasing numbers above 0 up to 1")
    if c.ndim != 1 or len(c) == 0 or not (np.diff(c, prepend=0.0) > 0).all() or c[-1] > 1:
        raise OptionError(f"nodes = {c.tolist()}: give increasing numbers above 0 up to 1")
    s = len(c)
    p: int = option("order", order, whole, "a collocation method with s stages has an order from s to 2 s", least=s, most=2 * s)
    k = np.arange(1, s + 1)
    V_inv = np.linalg.inv(c[:, None] ** k)
    A = (c[:, None] ** k / k) @ np.linalg.inv(c[:, None] ** (k - 1))
    A_inv = np.linalg.inv(A)
    values, vectors = np.linalg.eig(A_inv)
    is_real = np.abs(values.imag) < 1e-9
    upper = values.imag > 1e-9
    real = np.asarray(values[is_real].real, dtype=float)
    pairs = np.asarray(values[upper], dtype=complex)
    T, T_inv = _real_transformation(vectors, is_real, upper)
    gamma0 = 1 / float(real[0]) if len(real) else 1 / float(np.abs(pairs[0]))
    e = np.asarray(-np.linalg.solve((c[:, None] ** (k - 1)).T, gamma0 * (k == 1)) @ A_inv, dtype=float)
    b = np.asarray(A[-1] if c[-1] == 1.0 else np.linalg.solve((c[:, None] ** (k - 1)).T, 1 / k), dtype=float)
    return CollocationTable(p, c, A, b, A_inv, real, pairs, T, T_inv, gamma0, e, np.asarray(V_inv, dtype=float))


@cache
def radau_table(s: int) -> CollocationTable:
    """Radau IIA with s stages: right Radau points, roots of the (s-1)-th derivative of x^(s-1) (x-1)^s; order 2 s - 1."""
    x = _roots((Polynomial([0, 1]) ** (s - 1) * Polynomial([-1, 1]) ** s).deriv(s - 1))
    x[-1] = 1.0
    return collocation_table(x, 2 * s - 1)


def _roots(p: Polynomial) -> Array:
    """Real roots of a polynomial, in rising order."""
    x = np.sort(np.asarray(p.roots()).real)
    for _ in range(3):  # Newton's method reduces the round-off of the roots, which NumPy finds as eigenvalues of a matrix
        x = x - p(x) / p.deriv()(x)
    return x


def _real_transformation(
    vectors: NDArray[Any], is_real: NDArray[np.bool_], upper: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Real T and T_inv from the eigenvectors (s, s) of A_inv, in columns. is_real (s,): which are real; upper (s,): which have an
    eigenvalue with positive imaginary part. Every complex pair t, conj(t) becomes two real columns: Z = t_r w_r + 2 Re(t w)."""
    inverse = np.linalg.inv(vectors)
    columns = [vectors[:, j].real for j in np.flatnonzero(is_real)]
    rows = [inverse[j].real for j in np.flatnonzero(is_real)]
    for j in np.flatnonzero(upper):
        columns += [2 * vectors[:, j].real, -2 * vectors[:, j].imag]
        rows += [inverse[j].real, inverse[j].imag]
    return np.array(columns).T, np.array(rows)
