"""LU factorisation in a fixed sparsity pattern, and the iteration matrices of integrators: the Python side of sparse.h;
linear equations of the stages of implicit steps, for derivatives along them: that of adjoint.c.

Sizes and indices are checked here, before C uses them; wrong ones raise ValueError.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import cython_lapack
from mbdae.errors import internal
from mbdae.native import Array, Entries, Order, Orders, Searches, address, declared, differ, pivots
from mbdae.native.equations import Number, Pointer, Whole
from mbdae.native.explicit import Twins

#: LAPACK's dense LU is used where the sparse factorisation would take at least FEW multiplications and at least DENSE times those
#: of the dense one. Measured with full matrices, the sparse code is as fast as LAPACK with 25 unknowns, a third slower
#: with 50, and half as fast with 80
FEW, DENSE = 5000, 0.5
#: an order of elimination is kept while the relative error of a solution with its LU factors is below ACCURATE: Newton's method
#: still converges with it. With more than SMALL unknowns, an order that a search finds and that misses ACCURATE is kept below
#: TOLERABLE, because orders with larger pivots are expensive (a chain of 2000 rods has an error of 1.2e-4; another order takes 90
#: times as long). Not checked are the order that the last search finds, with the largest pivots, when it is found, and factors
#: without large entries (TAME in lu.h)
ACCURATE, TOLERABLE = 1e-4, 1e-2
#: largest number of unknowns for which dense LU of LAPACK is tried where every sparse order has too small pivots, and for which
#: TOLERABLE is not used
SMALL = 500


class SingularMatrixError(Exception):
    """A matrix could not be factorised; `unknown` is the number of the column without a pivot, -1 where it is not known."""

    def __init__(self, unknown: int = -1) -> None:
        super().__init__("iteration matrix is singular or not finite")
        self.unknown = unknown


class FactorsTable(ctypes.Structure):
    """The C struct `Factors` of sparse.h, with the same members in the same order."""

    _fields_ = (("n", Whole), ("nnz", Whole), ("complex", Whole), ("row_of", Pointer), ("column_of", Pointer),
                ("order", Pointer), ("surely", Whole), ("least", Number), ("accurate", Number),
                ("a", Pointer), ("lu", Pointer), ("w", Pointer),
                ("tops", Pointer), ("swaps", Pointer), ("getrf", Pointer), ("getrs", Pointer))


class MatrixTable(ctypes.Structure):
    """The C struct `Matrix` of sparse.h, with the same members in the same order."""

    _fields_ = (("n", Whole), ("nnz", Whole), ("reals", Whole), ("pairs", Whole), ("ready", Whole),
                *((name, Pointer) for name in ("row_of", "column_of", "scale", "power", "eigenvalues", "fy", "fyp", "row",
                                               "column", "w", "factors")))


#: function that opens the library and states the types of the functions of sparse.h for ctypes
functions = declared(
    ("lu_factor", Whole, (Pointer,)),
    ("lu_solve", None, (Pointer, Pointer)),
    ("lu_solve_each", None, (Pointer, Whole, Pointer)),
    ("lu_correct", None, (Pointer, Pointer, Pointer)),
    ("matrix_factor", Whole, (Pointer, Number, Whole)),
    ("matrix_correct", None, (Pointer, Pointer)),
    ("matrix_noise", None, (Pointer, Pointer, Pointer, Pointer)),
)


@cache
def lapack(name: str) -> int:
    """Address of a function of LAPACK in the library that SciPy brings."""
    capsule, api = cython_lapack.__pyx_capi__[name], ctypes.pythonapi
    api.PyCapsule_GetName.restype, api.PyCapsule_GetName.argtypes = ctypes.c_char_p, [ctypes.py_object]
    api.PyCapsule_GetPointer.restype, api.PyCapsule_GetPointer.argtypes = Pointer, [ctypes.py_object, ctypes.c_char_p]
    return int(api.PyCapsule_GetPointer(capsule, api.PyCapsule_GetName(capsule)))


class Factors:
    """LU factors of a matrix (n, n), real or complex; the caller writes its entries into `values` (nnz,)."""

    def __init__(self, orders: Orders, dtype: Any) -> None:
        entries, self.orders = orders.entries, orders
        self.order: Order | None = None
        self.dtype = np.dtype(dtype)
        self.values = np.zeros(entries.nnz, self.dtype)
        self._work, self._tops = np.zeros((2, entries.n), self.dtype), np.zeros(entries.n)
        self._swaps = np.zeros(entries.n, dtype=np.intc)
        self._lu = np.zeros(0, self.dtype)
        self.table = FactorsTable(
            entries.n, entries.nnz, self.dtype.kind == "c", address(entries.row_of), address(entries.column_of), None, 0, 0.0,
            ACCURATE, address(self.values), None, address(self._work), address(self._tops), address(self._swaps), None,
            None)
        self._at = ctypes.addressof(self.table)

    def factor(self) -> None:
        """Factorise the present values, in a new order of elimination where the pivots in the present one are too small."""
        if functions().lu_factor(self._at) >= 0:
            self.renew()

    def renew(self) -> None:
        """Find another order of elimination, with which the present values have large enough pivots, and factorise in it. Raises
        SingularMatrixError where there is none."""
        if not np.isfinite(self.values).all():
            raise SingularMatrixError
        orders, n = self.orders, self.orders.entries.n
        if orders.present is not None and orders.present is not self.order and self._begun(orders.present, False) < 0:
            return
        for search in orders.searches:
            order = search(orders.entries, self.values)
            surely = search is orders.searches[-1]
            if order is not None and (
                    self._begun(order, surely) < 0 or (n > SMALL and self._begun(order, surely, TOLERABLE) < 0)):
                orders.present = order
                return
        bad = self._begun(None, True) if n <= SMALL or not orders.searches else n
        if bad >= 0:
            self.table.lu = None
            raise SingularMatrixError(bad if bad < n else -1)

    def _begun(self, order: Order | None, surely: bool, accurate: float = ACCURATE) -> int:
        """Factorise the present values in an order. Returns -1 if that succeeds, else the number of the column without a pivot,
        or n where the factors are not accurate enough. surely: skip this check of accuracy now; accurate: largest relative error
        of a solution that it accepts, also for later values."""
        self._take(order)
        self.table.surely, self.table.accurate = surely, accurate
        bad = int(functions().lu_factor(self._at))
        self.table.surely = False  # so that the factors of later values are checked for accuracy
        return bad

    def _take(self, order: Order | None) -> None:
        """Use an order, or LAPACK's dense factors where it is None or sparse factors would cost more."""
        n = self.orders.entries.n
        self.order = order
        sparse = order is not None and order.work < max(FEW, DENSE * n**3 / 3)
        self.table.order = ctypes.addressof(order.table) if order is not None and sparse else None
        if not sparse and not self.table.getrf:
            letter = "z" if self.table.complex else "d"
            self.table.getrf, self.table.getrs = lapack(letter + "getrf"), lapack(letter + "getrs")
        size = order.size if order is not None and sparse else n * n
        if len(self._lu) != size:
            self._lu = np.zeros(size, self.dtype)
        self.table.lu = address(self._lu)

    def left_out(self, order: Order, least: float) -> NDArray[np.bool_]:
        """Factorise in an order and leave out the unknowns whose pivots are at most `least`; they are 0 in solutions. Returns
        which are left out, (n,) bool."""
        self.order, self.table.order, self.table.surely, self.table.least = order, ctypes.addressof(order.table), True, least
        self._lu = np.zeros(order.size, self.dtype)
        self.table.lu = address(self._lu)
        if functions().lu_factor(self._at) >= 0:
            raise SingularMatrixError
        out = np.empty(len(order.columns), dtype=bool)
        out[order.columns] = self._lu[order.up[1:]] == 0
        return out

    def snapshot(self) -> dict[str, Any]:
        """A copy of the factors, of the order in which they were made, and of the order that matrices of this pattern share, as
        plain values, for `go_back`."""
        arrays = (self.values, self._lu, self._swaps)
        return {"begun": bool(self.table.lu), "own": pivots(self.order), "shared": pivots(self.orders.present),
                "accurate": self.table.accurate, "arrays": [array.copy() for array in arrays]}

    def go_back(self, kept: dict[str, Any]) -> None:
        """Restore the factors and orders of a snapshot."""
        orders = self.orders
        if differ(pivots(orders.present), kept["shared"]):
            orders.present = Order(orders.entries, *kept["shared"]) if kept["shared"] else None
        self.table.accurate = kept["accurate"]
        if not kept["begun"]:
            return
        if kept["own"] is None or not differ(pivots(orders.present), kept["own"]):
            self._take(None if kept["own"] is None else orders.present)
        else:
            self._take(Order(orders.entries, *kept["own"]))
        for array, values in zip((self.values, self._lu, self._swaps), kept["arrays"], strict=True):
            array[:] = values

    def solve(self, b: NDArray[Any]) -> NDArray[Any]:
        """Solution (n,) for a right-hand side (n,), with one step of iterative refinement, because the factors may have lost
        digits (see ACCURATE)."""
        if not self.table.lu:
            raise internal("a linear system was to be solved while nothing is factorised")
        right = np.array(b, dtype=self.dtype)
        x = right.copy()
        if x.shape != (self.orders.entries.n,):
            raise internal(f"a linear system of {self.orders.entries.n} unknowns was given a right-hand side of shape {x.shape}")
        functions().lu_solve(self._at, address(x))
        functions().lu_correct(self._at, address(right), address(x))
        return x


class Matrix:
    """Iteration matrices dF/dy + (lambda / h) dF/dy' for real and complex lambda, scaled and factorised.

    fy, fyp (nnz,): entries of dF/dy and dF/dy', written by the caller; row, column (n,): factors by which equations and unknowns
    are scaled. To solve A x = b with `factors`: multiply b by `row`, solve, multiply the result by `column`.
    """

    def __init__(self, entries: Entries, scale: Any, power: Any, real: Any, pairs: Any, searches: Searches) -> None:
        """scale, power (n,): scale * h^-power is the unit in which an unknown is measured, h: step; real, pairs: the lambda, of a
        complex pair one; searches: see `Searches`."""
        n, nnz = entries.n, entries.nnz
        self.entries = entries
        self.scale, self.power = np.array(scale, dtype=float), np.array(power, dtype=float)
        self.real, self.pairs = np.array(real, dtype=float), np.array(pairs, dtype=complex)
        if self.scale.shape != (n,) or self.power.shape != (n,) or self.real.ndim != 1 or self.pairs.ndim != 1:
            raise internal(f"an iteration matrix of {n} unknowns needs scales and powers of the step of shape ({n},) and lists "
                           f"of eigenvalues: their shapes are {self.scale.shape}, {self.power.shape}, {self.real.shape} and "
                           f"{self.pairs.shape}")
        self._values = np.concatenate([self.real, self.pairs.view(float)])
        self.fy, self.fyp = np.zeros((2, nnz))
        self.row, self.column, self._work = np.ones(n), self.scale.copy(), np.zeros((3, n))
        self.orders = Orders(entries, searches)
        self.factors = [Factors(self.orders, kind) for kind in (*(float for _ in self.real), *(complex for _ in self.pairs))]
        if not self.factors:
            raise internal("an iteration matrix was given no eigenvalue lambda to be factorised for")
        self._addresses = (Pointer * len(self.factors))(*(ctypes.addressof(f.table) for f in self.factors))
        kept = (entries.row_of, entries.column_of, self.scale, self.power, self._values, self.fy, self.fyp, self.row, self.column,
                self._work)
        self.table = MatrixTable(n, nnz, len(self.real), len(self.pairs), 0, *map(address, kept),
                                 ctypes.addressof(self._addresses))
        self.address = ctypes.addressof(self.table)
        self._factor = functions().matrix_factor

    def factor(self, h: float) -> None:
        """Scale and factorise the iteration matrices of all lambda for a step of h (s)."""
        self.renewed(self._factor(self.address, h, 0), h)

    def renewed(self, bad: int, h: float) -> None:
        """Go on with the factors number `bad`, which need another order of elimination; -1: none do."""
        while bad >= 0:
            self.factors[bad].renew()
            bad = self._factor(self.address, h, bad + 1)

    def solved(self, right: Array) -> Array:
        """Solutions (k, n) for the right-hand sides (k, n), with the matrix of the first lambda, which has to be real."""
        if right.shape[1:] != (self.entries.n,) or not (len(self.real) and self.table.ready):
            raise internal(f"a linear system of {self.entries.n} unknowns was given right-hand sides of shape {right.shape}, or "
                           "nothing is factorised")
        x = np.ascontiguousarray(right * self.row)
        functions().lu_solve_each(ctypes.addressof(self.factors[0].table), len(x), address(x))
        return np.asarray(x * self.column)

    def noise(self, y: Array, yp: Array) -> Array:
        """Magnitudes (n,) of the corrections of the unknowns that round-off of the residual alone causes at (y, y')."""
        given, out = (self._vector(y), self._vector(yp)), np.empty(self.entries.n)
        functions().matrix_noise(self.address, *map(address, given), address(out))
        return out

    def _vector(self, x: Array) -> Array:
        found = np.ascontiguousarray(x, dtype=float)
        if found.shape != (self.entries.n,):
            raise internal(f"an iteration matrix of {self.entries.n} unknowns was given a vector of shape {found.shape}")
        return found


_stages = declared(
    ("stages_back", ctypes.c_int, (Pointer, Pointer, Pointer, Whole, *[Pointer] * 3)),
    ("stages_along", ctypes.c_int, (Pointer, Pointer, Pointer, *[Whole] * 3, *[Pointer] * 3)),
)


class StagesTable(ctypes.Structure):
    """The C struct `Stages` of adjoint.c, with the same members in the same order."""

    _fields_ = (*((name, Whole) for name in ("s", "n", "nnz", "transposed", "stage")),
                *((name, Pointer) for name in ("row_of", "column_of", "order", "A_inv", "T", "T_inv")), ("sign", Number),
                *((name, Pointer) for name in ("matrix", "r", "x", "mixed", "pair")))


class StepsTable(ctypes.Structure):
    """The C struct `Path` of adjoint.c, with the same members in the same order."""

    _fields_ = (*((name, Pointer) for name in ("h", "middles", "times", "Y", "Yp", "fy", "fyp")), ("own", Whole), ("of", Pointer),
                ("side", Pointer))


class Stages:
    """The linear equations of all stages of implicit steps by a collocation table. entries: the pattern of the Jacobian;
    transposed: those of the adjoint; kinds, searches: see `Searches`."""

    def __init__(self, table: Any, entries: Entries, transposed: bool, numbers: int, searches: Searches) -> None:
        s, n = len(table.c), entries.n
        rows, columns = (entries.column_of, entries.row_of) if transposed else (entries.row_of, entries.column_of)
        order = np.lexsort((rows, columns)).astype(np.int64)
        own = Entries(n, np.searchsorted(columns[order], np.arange(n + 1)), rows[order])
        self.matrix = Matrix(own, np.ones(n), np.zeros(n), table.real, table.pairs, searches)
        self._n, self._s = n, s
        real = len(table.real)
        sign = np.sign((table.T_inv @ table.A_inv @ table.T)[real + 1, real]) if len(table.pairs) else 1.0
        kept = [np.ascontiguousarray(x) for x in (entries.row_of, entries.column_of, order, table.A_inv, table.T, table.T_inv)]
        room = [np.zeros(size * n * numbers) for size in (s, 2 * s, s, 4)]
        self._kept = kept, room
        self.table = StagesTable(s, n, entries.nnz, int(transposed), s // 2, *(x.ctypes.data for x in kept), float(sign),
                                 self.matrix.address, *(x.ctypes.data for x in room))
        self._at = ctypes.addressof(self.table)

    def over(self, of: Twins, own: int, side: Array, *given: Array) -> None:
        """Choose the steps: derivatives of F by numbers, the number of unknowns of the run, which are the first of F, the array
        whose first number is the time at which conditions are read; and as `Path` in adjoint.c says h and middles (m,), times (m,
        s), Y, Y' (m, s, n), dF/dy and dF/dy' (m, s, nnz)."""
        self._given = [np.ascontiguousarray(x) for x in given]
        self._steps = StepsTable(*(x.ctypes.data for x in self._given), own, of.address, side.ctypes.data)
        self.times, self._own, self._columns = self._given[2], own, of.table.columns

    def _called(self, function: Callable[..., int], m: Any, back: int) -> None:
        """Call C until all steps are made; it returns where a matrix needs another order of elimination. SingularMatrixError
        where there is none, or a step has no solution; its `unknown` then is the step."""
        code, at = function(0), None
        while code < 0 and at != m.value:
            at = m.value
            self.matrix.factor(float(self._given[0][at - back]))
            code = function(1)
        if code:
            raise SingularMatrixError(m.value - back)

    def back(self, ends: Array, inner: Array, total: Array) -> None:
        """Take weights back, as `Path.back`."""
        m, given = Whole(len(ends)), [np.ascontiguousarray(x) for x in (ends, inner)]
        rest = *(x.ctypes.data for x in given), total.ctypes.data
        self._called(lambda ready: int(_stages().stages_back(self._at, ctypes.addressof(self._steps), ctypes.addressof(m),
                                                                ready, *rest)), m, 1)

    def along(self, S: Array) -> tuple[Array, Array]:
        """Derivatives (m + 1, n, P) at the ends of the steps, and of the increments (m, s - 1, n, P); S (n, P): at the first."""
        steps, P = len(self.times), self._columns
        out, inner = np.empty((steps + 1, self._own, P)), np.empty((steps, self._s - 1, self._own, P))
        out[0], room, m = S, np.zeros((self._s, self._n, P)), Whole(0)
        rest = P, out.ctypes.data, inner.ctypes.data, room.ctypes.data
        self._called(lambda ready: int(_stages().stages_along(self._at, ctypes.addressof(self._steps), ctypes.addressof(m),
                                                                 steps, ready, *rest)), m, 0)
        return out, inner
