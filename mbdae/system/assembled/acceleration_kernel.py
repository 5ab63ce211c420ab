"""Accelerations and multipliers of constrained bodies with a constant mass matrix, at few microseconds per state.

One kernel call per law gives q', -f, the constraints' right-hand side and G. Then S lambda = G M^-1 f + c with S = G M^-1 G^T,
by Cholesky: dense, or banded in an order that keeps chains narrow; where the mass matrix is singular or its entries span too
much, the equations of u' and lambda are factorised as a whole. M is factorised once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
import symengine as se
from numpy.typing import NDArray
from scipy.linalg.lapack import dgesv, dpbsv, dposv

from mbdae.kernels import plan
from mbdae.symbolic import outputs
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembled.evaluation import Evaluation
from mbdae.system.base import Array

VELOCITY, POSITION = "baumgarte_velocity", "baumgarte_position"  #: factors of G u + g_t (1/s) and of g (1/s^2) in the rows
SPREAD = 1e-5  #: squared independent part of a row of G M^-1/2 below which S has lost too many digits
BANDED_FROM = 64  #: rows from which a band is worth its index lists
WHOLE_BELOW = 150  #: velocities and multipliers; above, sparse factors of the full equations cost less than full ones of these

Index = NDArray[np.intp]
RowOf = Callable[[Target, int, int], int]


def _with_drift(d: Derived, rates: list[Expr]) -> list[tuple[Target, Expr]]:
    weights = se.Symbol(VELOCITY), se.Symbol(POSITION)
    off = zip(rates, outputs.velocity(d), outputs.position(d), strict=True)
    return [(("gdd", i), d.scaled(a + weights[0] * v + weights[1] * g)) for i, (a, (_, v), (_, g)) in enumerate(off)]


def stabilised(d: Derived) -> list[tuple[Target, Expr]]:
    """G u' + gamma + 2 alpha (G u + g_t) + beta^2 g, as a form integrates them."""
    return _with_drift(d, outputs.second_rate(d))


def equations_of_motion(d: Derived) -> list[tuple[Target, Expr]]:
    """Outputs of a law from which u' and lambda follow: its rows of F where they and all rates are 0, and its entries of G."""
    still = {se.Symbol(f"{d.frames[0].side}_qp{i + 1}"): 0 for i in range(d.frames[0].kind.sizes[0])}
    if isinstance(d.law, Element):
        return [*((t, e.subs(still)) for t, e in outputs.kinematics(d)), *outputs.loads(d)]
    penalty = getattr(d.law, "penalty", None)
    forces = [se.Integer(0) if penalty is None else 2 * penalty * c for c in d.g]
    stated = [entry for f in d.frames for entry in outputs.scatter_pair(f, outputs.covector(d, f, forces))]
    rates = [(t, e.subs({se.Symbol(f"statep_{d.states[t[1]]}"): 0})) for t, e in outputs.state_rows(d)]
    gamma = [e for _, e in outputs.acceleration(d)]
    return [*stated, *_with_drift(d, gamma), *rates, *((t, d.scaled(e)) for t, e in outputs.jacobian_G(d))]


class Solve(Protocol):
    """Solves M a + G^T x = f, G a = c, from the entries of G."""

    full_rows: bool  #: whether G is wanted as (m, nu), row by row, or by its entries alone

    def __init__(self, M: Array, shape: tuple[int, int], rows: Index, columns: Index) -> None: ...

    def __call__(self, G: Array, f: Array, c: Array) -> tuple[Array, Array, int]:
        """a (nu,), x (m,), and the number of a row that depends on the others, or -1."""

    def shares(self) -> Array:
        """(m,) squared independent part of every row, over its length, at the last solution."""


class AccelerationKernel:
    """q', u', s' and multipliers of a system of constrained bodies; multipliers (m,) are those of the last call."""

    def __init__(self, full: Any, mass: Array, row_of: RowOf, solve: type[Solve]) -> None:
        """full: the equations with multipliers; mass (nu, nu); row_of: row of F of an output of an instance."""
        nb = full.numbering
        self._W, self._clock, self._time = nb.workspace(1), bool(nb.clock.expressions), np.zeros(1)
        self._fill_clock, self.multipliers = nb.fill_clock, np.zeros(nb.m)
        gathers, places, kernels = [], [], []
        entries: dict[tuple[int, int], int] = {}
        for g, group in enumerate(full.model.groups):
            p = plan(group.derived, equations_of_motion)
            active = [i for i in range(len(group.instances)) if (g, i) not in full.moved.replaced]
            if p.targets and active:
                gathers.append(nb.gather(g, p.all_inputs, active))
                kernels.append(p.kernel)
                places += [row_of(t, g, i) if t[0] != "G" else _entry(full, t, g, i, entries, solve.full_rows)
                           for i in active for t in p.targets]  # fmt: skip
        self._laws = Evaluation(self._W, gathers, kernels)
        self._at, self._size = np.array(places, dtype=np.intp), full.n + 1 + (nb.m * nb.nu if solve.full_rows else len(entries))
        self._n, first = full.n, nb.start["lambda"]
        self._u, self._rows, self._states = slice(nb.nq, nb.nq + nb.nu), slice(first, full.n), slice(first)
        self._unknowns = self._W[0, :first]
        cells = np.array(list(entries), dtype=np.intp).reshape(-1, 2)
        self._solve = solve(mass, (nb.m, nb.nu), cells[:, 0], cells[:, 1])
        self.shares = self._solve.shares

    def rates(self, t: float, y: Array, out: Array) -> int:
        """out[:] = y', (n,). Returns the number of a row that depends on the others, or -1."""
        self._unknowns[:] = y
        if self._clock:
            self._time[0] = t
            self._fill_clock(self._W, self._time)
        F: Any = np.bincount(self._at, self._laws.values(), self._size)
        x = F[: self._n]
        np.negative(x, out=x)
        out[:] = x[self._states]
        out[self._u], self.multipliers, row = self._solve(F[self._n + 1 :], x[self._u], x[self._rows])
        return row


def _entry(full: Any, target: Target, g: int, i: int, entries: dict[tuple[int, int], int], full_rows: bool) -> int:
    """Place of an entry of G behind the rows of F and the spare one, which takes those that are dropped."""
    nb = full.numbering
    row, column = nb.row(g, i, target[1]), nb.velocity(("u", *target[2:]), g, i)
    if row is None or not 0 <= column < nb.nu:
        return int(full.n)
    entry = entries.setdefault((row, column), len(entries))
    return int(full.n + 1 + (row * nb.nu + column if full_rows else entry))


def acceleration_kernel(full: Any, M: Array, row_of: RowOf, start: tuple[float, Array]) -> AccelerationKernel | None:
    """The kernel for bodies; None where the full equations are better: trees, beams, many bodies some of which are massless.

    start: a state (t, y), at which it is found out whether masses differ too much."""
    nb = full.numbering
    if full.moved.nodes or full.model.lines or not nb.m:
        return None
    if np.all(M.diagonal() > 0) and np.all(np.linalg.eigvalsh(M) > 0):
        diagonal = not np.any(M - np.diag(M.diagonal()))
        found = AccelerationKernel(full, M, row_of, Banded if nb.m >= BANDED_FROM and diagonal else Dense)
        if found.rates(*start, np.empty(nb.start["lambda"])) < 0 and np.min(found.shares()) > SPREAD:
            return found
    return AccelerationKernel(full, M, row_of, Whole) if nb.nu + nb.m < WHOLE_BELOW else None


class Dense:
    """S = G M^-1 G^T and its Cholesky factor, full."""

    full_rows = True

    def __init__(self, M: Array, shape: tuple[int, int], rows: Index, columns: Index) -> None:
        self._shape, self._diagonal = shape, not np.any(M - np.diag(M.diagonal()))
        self._root = 1 / np.sqrt(M.diagonal()) if self._diagonal else np.linalg.inv(np.linalg.cholesky(M))  # M^-1/2
        self._S = self._factor = np.eye(shape[0])

    def __call__(self, G: Array, f: Array, c: Array) -> tuple[Array, Array, int]:
        root, G = self._root, G.reshape(self._shape)
        W, h = (G * root, f * root) if self._diagonal else (G.dot(root.T), root.dot(f))
        self._S = W.dot(W.T)
        self._factor, x, info = dposv(self._S, W.dot(h) - c, 1)
        h -= x.dot(W)
        return (h * root if self._diagonal else h.dot(root)), x, info - 1

    def shares(self) -> Array:
        """(m,) squared independent part of every row."""
        return np.asarray(self._factor.diagonal() ** 2 / self._S.diagonal())


class Banded:
    """The same with S as a band, its rows in an order that keeps them close; M is diagonal."""

    full_rows = False

    def __init__(self, M: Array, shape: tuple[int, int], rows: Index, columns: Index) -> None:
        from scipy.sparse.csgraph import reverse_cuthill_mckee  # not needed by small scenes

        self._inverse = 1 / M.diagonal()
        self._m, self._nu = shape
        pattern = sp.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=shape)
        self._order = reverse_cuthill_mckee(sp.csr_matrix(pattern @ pattern.T), symmetric_mode=True).astype(np.intp)
        place = np.empty(self._m, dtype=np.intp)
        place[self._order] = np.arange(self._m)
        self._rows, self._columns = place[rows], columns
        by_column = [np.flatnonzero(columns == j) for j in range(self._nu)]
        pairs = np.concatenate([np.array(np.meshgrid(k, k)).reshape(2, -1) for k in by_column], axis=1)
        pairs = pairs[:, self._rows[pairs[0]] >= self._rows[pairs[1]]]
        self._i, self._j = pairs
        below = self._rows[self._i] - self._rows[self._j]
        self._width = int(below.max(initial=0)) + 1
        self._cells = below * self._m + self._rows[self._j]
        self._weights = self._inverse[columns]
        self._band = self._factor = np.ones((1, self._m))

    def __call__(self, G: Array, f: Array, c: Array) -> tuple[Array, Array, int]:
        weighted = G * self._weights
        band: Any = np.bincount(self._cells, weighted.take(self._i) * G.take(self._j), self._width * self._m)
        self._band = band.reshape(self._width, self._m)
        right = np.bincount(self._rows, weighted * f.take(self._columns), self._m) - c.take(self._order)
        self._factor, x, info = dpbsv(self._band, right, 1)
        force = np.bincount(self._columns, G * x.take(self._rows), self._nu)
        multipliers = np.empty(self._m)
        multipliers[self._order] = x
        return (f - force) * self._inverse, multipliers, int(self._order[info - 1]) if info else -1

    def shares(self) -> Array:
        """(m,) squared independent part of every row."""
        share = np.empty(self._m)
        share[self._order] = self._factor[0] ** 2 / self._band[0]
        return share


class Whole:
    """The equations of u' and lambda by LU: for masses that are zero, or differ too much."""

    full_rows = True

    def __init__(self, M: Array, shape: tuple[int, int], rows: Index, columns: Index) -> None:
        m, self._nu = shape
        self._K = np.zeros((m + self._nu, m + self._nu), order="F")
        self._K[: self._nu, : self._nu] = M

    def __call__(self, G: Array, f: Array, c: Array) -> tuple[Array, Array, int]:
        nu, K = self._nu, self._K
        K[nu:, :nu] = G.reshape(-1, nu)
        K[:nu, nu:] = K[nu:, :nu].T
        _, _, x, info = dgesv(K, np.concatenate([f, c]))
        return x[:nu], x[nu:], max(info - 1 - nu, 0) if info else -1

    def shares(self) -> Array:
        """(m,) squared independent part of every row."""
        return row_shares(self._K[self._nu :, : self._nu])


def row_shares(G: Array) -> Array:
    """(m,) squared part of every row of G (m, nu), over its length, that is independent of the others."""
    unit = G / np.linalg.norm(G, axis=1, keepdims=True)
    _, sigma, V = np.linalg.svd(unit.T, full_matrices=False)
    return np.asarray(1 / np.sum((V / np.maximum(sigma[:, None], 1e-150)) ** 2, axis=0))
