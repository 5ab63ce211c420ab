"""Iteration matrices with positions and stresses condensed onto the rest, which is factorised dense.

Of a beam of 8 elements in the plane 100 unknowns become 45: the dense factors cost a sixth, a solution with them a third,
and what is condensed costs a few products of a fixed list of entries.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from mbdae.integrators.matrices.iteration import EntriesMatrix, LapackFactors, SingularMatrixError
from mbdae.integrators.matrices.ordering import FIRST, THRESHOLD
from mbdae.system.base import Array, System

Index = NDArray[np.intp]


def checked_product(rows: int, columns: int, indptr: Index, indices: Index, data: Array, b: Array, out: Array) -> None:
    """out (rows,) += A b with A in CSR form, by SciPy's public product: its checks cost 4 us."""
    out += csr_matrix((data, indices, indptr), shape=(rows, columns)) @ b


try:  # not a public name of SciPy, but four times as fast as the public product, which a Newton iteration takes four of
    from scipy.sparse._sparsetools import csr_matvec as product
except ImportError:
    product = checked_product

WORTH = 150_000  #: multiplications of dense factors to save: for less the sweeps do not pay (measured 27 000 no, 320 000 yes)
MOST = 100  #: unknowns left: sparse factors of more are cheaper


class _SmallPivotError(Exception):
    """A pivot is too small beside the largest entry of its row, 1, or not finite."""


class Level:
    """Pivots that do not touch each other, and the entries their elimination reads and changes, as positions in the data."""

    def __init__(self, pivots: list[int], rows: list[set[int]], columns: list[set[int]], at: dict[tuple[int, int], int]) -> None:
        """rows[i]: columns of row i; columns[j]: rows of column j; at: positions. All three gain what fills in."""
        row: list[tuple[int, int]] = []
        column: list[tuple[int, int]] = []
        products: list[tuple[int, int, int]] = []
        for k, p in enumerate(pivots):
            across, down = sorted(rows[p] - {p}), sorted(columns[p] - {p})
            first = len(row)
            row += [(at[p, j], k) for j in across]
            column += [(at[i, p], k) for i in down]
            for i in down:
                for b, j in enumerate(across):
                    products.append((at.setdefault((i, j), len(at)), at[i, p], first + b))
                    rows[i].add(j)
                    columns[j].add(i)
        self.pivots = np.array([at[p, p] for p in pivots], dtype=np.intp)
        (self.row, self.row_of), (self.column, self.column_of) = (_table(part, 2) for part in (row, column))
        self.target, self.left, self.right = _table(products, 3)

    def sweep(self, data: Array) -> None:
        """Replace the matrix [[A, B], [C, D]] by [[1/A, B/A], [-C/A, D - C B/A]], A the pivots."""
        inverse = 1.0 / data.take(self.pivots)
        if not np.abs(inverse).max() < 1 / THRESHOLD:
            raise _SmallPivotError
        across = data.take(self.row) * inverse.take(self.row_of)
        np.subtract.at(data, self.target, data.take(self.left) * across.take(self.right))
        data[self.row] = across
        data[self.column] *= -inverse.take(self.column_of)
        data[self.pivots] = inverse


def _table(rows: list[Any], width: int) -> Index:
    return np.ascontiguousarray(np.array(rows, dtype=np.intp).reshape(-1, width).T)


class Plan:
    """Which unknowns are condensed, in which order, and where all entries are. Independent of numbers."""

    def __init__(self, pattern: Any, condensed: Sequence[int]) -> None:
        n = self.n = pattern.shape[0]
        owner = np.repeat(np.arange(n), np.diff(pattern.indptr))
        cells = list(zip(pattern.indices.tolist(), owner.tolist(), strict=True))
        at = {cell: k for k, cell in enumerate(cells)}
        rows: list[set[int]] = [set() for _ in range(n)]
        columns: list[set[int]] = [set() for _ in range(n)]
        for i, j in cells:
            rows[i].add(j)
            columns[j].add(i)
        self.levels: list[Level] = []
        waiting = list(condensed)
        while waiting:
            chosen = _apart(waiting, rows, columns)
            self.levels.append(Level(chosen, rows, columns, at))
            waiting = [p for p in waiting if p not in set(chosen)]
        self.size = len(at)
        self.pivots = np.array([at[p, p] for p in condensed], dtype=np.intp)
        self.rest = np.setdiff1d(np.arange(n), condensed)
        self.m = len(self.rest)
        self._place(at, set(condensed))

    def _place(self, at: dict[tuple[int, int], int], out: set[int]) -> None:
        """The swept entries as two operators and a dense matrix: see `Factors`."""
        number = {int(i): k for k, i in enumerate(self.rest)}
        m, ones = self.m, self.size
        before = [(self.n + k, i, ones) for i, k in number.items()]
        behind = [(i, k, ones) for i, k in number.items()]
        dense = []
        for (i, j), k in at.items():
            if i in out:
                (before if j in out else behind).append((i, j if j in out else number[j], k))
            elif j in out:
                before.append((self.n + number[i], j, k))
            else:
                dense.append((k, number[j] * m + number[i]))
        self.before, self.behind = _Operator(before, self.n + m, self.n), _Operator(behind, self.n, m)
        self.dense, self.dense_at = _table(dense, 2)


def _apart(waiting: list[int], rows: list[set[int]], columns: list[set[int]]) -> list[int]:
    """Some of the waiting pivots, in order, of which none has an entry with another."""
    chosen: list[int] = []
    near: set[int] = set()
    for p in waiting:
        if p not in near:
            chosen.append(p)
            near |= rows[p] | columns[p]
    return chosen


class _Operator:
    """A CSR matrix whose data are taken from the swept entries."""

    def __init__(self, entries: list[tuple[int, int, int]], height: int, width: int) -> None:
        """entries: row, column, and position among the swept entries."""
        i, j, k = _table(entries, 3)
        found = csr_matrix((k + 1.0, (i, j)), shape=(height, width))
        self.indptr, self.indices, self.data = found.indptr, found.indices, found.data.astype(np.intp) - 1


class Factors:
    """Solves with one swept matrix: before the dense solution E b_e and b_r - W b_e, behind it x_e -= V x_r and x_r.

    data: the swept entries and one more, for the ones of b_r and x_r.
    """

    def __init__(self, plan: Plan, data: Array) -> None:
        self.plan = plan
        data[-1] = 1.0
        self.before = data.take(plan.before.data)
        data[-1] = -1.0
        self.behind = -data.take(plan.behind.data)
        dense = np.zeros(plan.m * plan.m, dtype=data.dtype)
        dense[plan.dense_at] = data.take(plan.dense)
        try:
            self.rest = LapackFactors(dense.reshape(plan.m, plan.m, order="F"))
        except SingularMatrixError as error:
            raise SingularMatrixError(int(plan.rest[error.unknown]) if error.unknown >= 0 else -1) from error
        self.x = np.zeros(plan.n + plan.m, dtype=data.dtype)
        self.parts = self.x[: plan.n], self.x[plan.n :]

    def solve(self, b: Array) -> Array:
        """Solution (n,), valid until the next call."""
        plan, x, n = self.plan, self.x, self.plan.n
        head, tail = self.parts
        x.fill(0.0)
        o = plan.before
        product(n + plan.m, n, o.indptr, o.indices, self.before, b, x)
        o = plan.behind
        product(n, plan.m, o.indptr, o.indices, self.behind, self.rest.solve(tail), head)
        return head


class CondensedMatrix(EntriesMatrix):
    """Sweeps of positions and stresses, LAPACK factors of what is left; of the whole matrix where a pivot is too small."""

    def __init__(self, system: System, real: Array, pairs: NDArray[np.complex128], plan: Plan) -> None:
        super().__init__(system, real, pairs, system.pattern)
        self._plan: Plan | None = plan

    def refresh(self, t: float, y: Array, yp: Array) -> None:
        """Evaluate both Jacobian parts."""
        self._fy, self._fyp = self.system.jacobian_values(t, y, yp)

    def _factored(self, matrix: NDArray[Any]) -> Any:
        if self._plan is not None:
            with suppress(_SmallPivotError):
                data = np.zeros(self._plan.size + 1, dtype=matrix.dtype)
                data[: len(matrix)] = matrix
                with np.errstate(all="ignore"):
                    for level in self._plan.levels:
                        level.sweep(data)
                return Factors(self._plan, data)
            self._plan = None  # a strain that is nearly rigid stays so
        whole = np.zeros((self.system.n, self.system.n), dtype=matrix.dtype, order="F")
        whole[self._indices, self._columns] = matrix
        return super()._factored(whole)


_PLANS: WeakKeyDictionary[System, Plan | None] = WeakKeyDictionary()


def plan_of(system: System) -> Plan | None:
    """The plan for a system, made once; None where too little can be condensed or too much is left."""
    if system.pattern is None:
        return None
    if system not in _PLANS:
        _PLANS[system] = _plan(system)
    return _PLANS[system]


def _plan(system: System) -> Plan | None:
    diagonal = system.pattern.diagonal() != 0
    condensed = [i for kind in FIRST[::-1] for i in range(system.n) if system.kinds[i] == kind and diagonal[i]]
    left = system.n - len(condensed)
    if system.n**3 - left**3 < WORTH or left > MOST:
        return None
    return Plan(system.pattern, condensed)
