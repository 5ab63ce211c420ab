"""The compiled library of the native core, opened once; how that core works.

A wheel contains it. In a clone it was compiled at installation; where the C files or MBDAE_CFLAGS have changed since, it is
compiled again in place before it is opened.

Sparsity patterns of matrices, and orders of elimination with the pattern of L + U: the Python side of `Order` in sparse.h.

Sizes and indices are checked here, before C uses them; wrong ones raise ValueError.

Orders of elimination for sparse LU factors, chosen by the present values of a matrix, so that its pivots are large enough.

Laws stay symbolic and kernels are compiled by symengine; what runs between two kernels does not depend on a scene and is C,
compiled once when mbdae is installed (`native/`). Python makes tables and reads results; C allocates nothing.

`core.h`: `Equations`: residual, Jacobian, right-hand side and its Jacobian by address, which is all that a method of
    integration sees
`evaluation.c`: the equations of a scene: a list of operations on one array of numbers
`sundials.c`: what IDA and CVODE call, and the loop over their steps
`sparse.c`, `sparse.h`, `lu.h`: LU factors, real and complex, in a pattern that is found once
`radau.c`: Newton's iteration on the stages of a collocation step, its starting values and its error; steps of a run and their
    control
`contacts.c`, `contacts.h`: contacts between steps: how long the next one may be, and whether the last one needs a closer look
`explicit.c`: steps of the explicit method of order 8, batches of its runs, and derivatives along its steps
`adjoint.c`: linear equations of the stages of a collocation step, derivatives along such steps, and small disturbances carried
    along a run
`growth.c`, `eigen.h`: roots of the linearised equations at states of a run, and which disturbances are small in the motion

One array, a list of operations. The workspace of a numbering (y, y', motion of loaded nodes, prescribed values, constants) goes
on behind its last slot with the inputs and values of kernels, the rows of F, the entries of the Jacobian, the band of a mass
matrix. An operation calls a kernel at its points, copies slots, adds multiples of slots or products of two slots to others,
loads constants, or solves with a matrix. The lists are made from the same tables for every form; the kernels of a list are
compiled when a method first asks for it:

clock: one kernel: what is prescribed in time; skipped where the time is that of the last call
motion: passes over trees: motion of the bodies on which other laws act
residual: motion; rows := constants; kernels of laws, added to their rows; linear terms; passes over the trees with the forces
    on their bodies
Jacobian: (residual, where trees carry loads;) kernels of derivatives; entries := constants; values added to their entries;
    products with the trees' derivatives
passes over trees: kernels of single joints, or of a whole small tree, see below
right-hand side: residual at y' = 0; passes over the trees, and a look at the pivots of their mass matrix; of other velocities
    the mass matrix in a band, Cholesky
eliminated multipliers: kernels of laws; S = G M^-1 G^T by products; Cholesky in a band, or LU of the whole where masses are
    zero

An element of a beam is such a list too (`kernels/line_program.py`): section positions, their rates, the law at the points,
forces back on the nodes, and the same maps on both sides of the derivatives.

Many steps at a time. A method returns to Python after 256 steps, where a step needs a closer look, or where it needs another
order of elimination. Python then looks at the arguments of switching laws of all steps at once and keeps those up to the first
that may hide something; from there the run goes on one step at a time until a step hides nothing (`StepWatch.kept`). Contacts
of scenes are looked at in C after every step, by the rules of `ContactSteps`; contacts of a `mb.DAE` by Python, step by step.

Sizes are checked where tables are made. `Operations` refuses an operation that leaves the array; the tables of the factors, the
stages and the methods are checked in the same way. A wrong table raises ValueError and is never run.

Equations in Python (`mb.DAE`) enter by call back. What a call back raises is kept, C ends with a negative code, and Python
raises it again. Signals wait while C runs where Python may be called from it; runs return to Python after 50 ms of wall time at
most, so that Ctrl-C, `max_wall` and `progress` work.

Debugging. `MBDAE_CFLAGS="-O0 -g"` compiles the library of a clone for a debugger, `gdb --args python script.py` then stops in
lines of C; `scene.system("ggl").assembly.evaluation` holds the array (`W`), the slots (`rows`, `fy`, `rates`) and the lists.
The tests run under the sanitizers for addresses and undefined behaviour with the command in CONTRIBUTING.md.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import csc_matrix, distinct, splu
from mbdae.errors import LibraryError, internal
from mbdae.native import build
from mbdae.native.equations import Number, Pointer, Whole

#: version number of the interface between C and Python. It has to equal `mbdae_interface` of version.c, or the library is refused
INTERFACE = 17


@cache
def library() -> ctypes.CDLL:
    """The library, compiled again if its C files have changed; `declared` states the types of its functions."""
    if build.sources() and not build.is_current():
        rebuild()
    try:
        opened = ctypes.CDLL(str(build.LIBRARY))
        found = opened.mbdae_interface()
    except (OSError, AttributeError) as error:
        raise LibraryError(f"The native core of mbdae cannot be opened: {error}. Install mbdae again on this machine, as before "
                           "and with the options --force-reinstall --no-deps of pip") from error
    if found != INTERFACE:
        raise LibraryError(f"{build.LIBRARY} has interface {found}, the Python files beside it need {INTERFACE}: they are of "
                           "different versions. Install mbdae again")
    return opened


def declared(*functions: tuple[str, Any, tuple[Any, ...]]) -> Callable[[], Any]:
    """A function that opens the library and states the types of some of its functions for ctypes. functions: of each its name,
    the type of its result and those of its arguments."""

    @cache
    def opened() -> Any:
        found = library()
        for name, result, arguments in functions:
            function = getattr(found, name)
            function.restype, function.argtypes = result, arguments
        return found

    return opened


def rebuild() -> None:
    """Compile the library of a clone again; warnings of the compiler go to standard error."""
    try:
        said = build.compile_library(build.compiler())
    except build.BuildError as error:
        state = "is older than its C files" if build.LIBRARY.is_file() else "was not compiled yet"
        raise LibraryError(f"The native core of this clone of mbdae {state}, and compiling it failed.\n{error}") from error
    if said:
        print(said, file=sys.stderr, end="")


Array = NDArray[np.float64]
Index = NDArray[np.int64]


class OrderTable(ctypes.Structure):
    """The C struct `Order` of sparse.h, with the same members in the same order."""

    _fields_ = (("n", Whole), *((name, Pointer) for name in ("low", "up", "run", "first", "rows", "columns", "col", "origin",
                                                             "to")))


#: function that opens the library and states the types of the function for the fill-in, for ctypes
functions = declared(("lu_fill", Whole, (Whole, Pointer, Pointer, Whole, Pointer, Pointer, Pointer, Pointer)))


_NOTHING = ctypes.c_char * 0


def address(array: NDArray[Any]) -> int:
    """Address of the first number of an array; by its buffer, which takes a quarter of the time that NumPy takes."""
    try:
        return ctypes.addressof(_NOTHING.from_buffer(array))  # type: ignore[arg-type]
    except (TypeError, ValueError, BufferError):  # it cannot be written to, or has gaps
        return int(array.ctypes.data)


def whole(what: Any) -> Index:
    """An array of integers as C reads it: contiguous, 64 bits each."""
    return np.ascontiguousarray(what, dtype=np.int64)


class Entries:
    """Sparsity pattern of matrices (n, n) by columns: `indptr` (n + 1,) and row `indices` (nnz,) as in SciPy's csc_matrix."""

    def __init__(self, n: int, indptr: Any, indices: Any) -> None:
        self.n, self.indptr, self.row_of = int(n), whole(indptr), whole(indices)
        self.nnz = len(self.row_of)
        ends = 0, self.nnz
        if self.indptr.shape != (n + 1,) or (self.indptr[0], self.indptr[-1]) != ends or (np.diff(self.indptr) < 0).any():
            raise internal(f"the pattern of a sparse matrix has column pointers of shape {self.indptr.shape} that do not divide "
                           f"its {self.nnz} entries into {n} columns")
        if n < 1 or self.row_of.ndim != 1 or not ((self.row_of >= 0) & (self.row_of < n)).all():
            raise internal(f"the pattern of a sparse matrix ({n}, {n}) has no rows, entries in rows outside of it, or no list of "
                           "these rows")
        self.column_of = np.repeat(np.arange(n, dtype=np.int64), np.diff(self.indptr))
        if len(distinct(self.column_of * n + self.row_of)) != self.nnz:
            raise internal("the pattern of a sparse matrix names an entry (row and column) twice")

    @classmethod
    def full(cls, n: int) -> Entries:
        """The pattern of a full matrix (n, n), column by column."""
        return cls(n, np.arange(n + 1) * n, np.tile(np.arange(n), n))

    def matrix(self, values: NDArray[Any]) -> csc_matrix:
        """The matrix (n, n) with this pattern whose entries have the values (nnz,)."""
        return csc_matrix((values, self.row_of, self.indptr), shape=(self.n, self.n))


class Order:
    """An order of elimination: pivot i is in row rows[i] and column columns[i]; with the pattern of L + U for this order.

    work: number of multiplications of a factorisation; size: number of entries of L + U, fill-in included.
    """

    def __init__(self, entries: Entries, rows: Any, columns: Any) -> None:
        n = entries.n
        self.rows, self.columns = whole(rows), whole(columns)
        for order in (self.rows, self.columns):
            if order.shape != (n,) or not np.array_equal(np.sort(order), np.arange(n)):
                raise internal(f"an order of elimination does not name each of the {n} rows or columns of a sparse matrix once")
        row_of, column_of = np.empty((2, n), dtype=np.int64)
        row_of[self.rows] = column_of[self.columns] = np.arange(n)
        i, j = row_of[entries.row_of], column_of[entries.column_of]
        ptr, col, diag = filled(n, i, j)
        self.size = len(col)
        low, up = diag - ptr[:-1], ptr[1:] - diag  # number of entries in every row of L, and of U with its diagonal
        self.low = np.concatenate([[0], np.cumsum(low)])
        self.up = self.size - np.concatenate([[0], np.cumsum(up)])
        row = np.repeat(np.arange(n), low + up)
        place = np.arange(self.size) + np.where(col < row, (self.low[:-1] - ptr[:-1])[row], (self.up[1:] - diag)[row])
        breaks = np.where(np.diff(row * n + col, prepend=-2) != 1, np.arange(self.size), 0)
        self.run = self.up[1:] + np.maximum(np.maximum.reduceat(breaks, ptr[:-1]) - diag, 1)
        self.work = int(up[col[col < row]].sum())
        self.col = np.empty(self.size, dtype=np.int32)
        self.col[place] = col
        by_rows = np.lexsort((j, i))
        self.first = np.searchsorted(i[by_rows], np.arange(n + 1))
        self.origin, self.to = by_rows.astype(np.int32), j[by_rows].astype(np.int32)
        kept = [self.low, self.up, self.run, self.first, self.rows, self.columns, self.col, self.origin, self.to]
        self.table = OrderTable(n, *map(address, kept))


def filled(n: int, i: Index, j: Index) -> tuple[Index, Index, Index]:
    """The pattern of L + U, fill-in included, of a matrix with entries in rows i, columns j: where its rows begin (n + 1,), the
    columns of its entries in ascending order, and where its diagonal entries are (n,)."""
    cells = distinct(np.r_[i * n + j, np.arange(n) * (n + 1)])
    rows, columns = whole(np.searchsorted(cells, np.arange(n + 1) * n)), whole(cells % n)
    ptr, diag, work = np.zeros(n + 1, dtype=np.int64), np.zeros(n, dtype=np.int64), np.zeros(n + 2, dtype=np.int64)
    most, count = 4 * (len(i) + n), -1
    while count < 0:
        most *= 4
        col = np.empty(most, dtype=np.int64)
        count = functions().lu_fill(n, address(rows), address(columns), most, *map(address, (ptr, col, diag, work)))
    return ptr, col[:count].copy(), diag


choosing = declared(("lu_choose", Whole, (Whole, Whole, Number, *[Pointer] * 8)))


#: `largest_pivots` calls `by_counts` for up to MANY unknowns if the product of the numbers of unknowns and entries is up to MOST,
#: else SuperLU. `by_counts` takes 8 ms and 9 MB for 780 unknowns with 9000 entries; its memory grows with the square of the
#: number of unknowns
MANY, MOST = 1000, 20_000_000


def is_small(entries: Entries) -> bool:
    """Whether a matrix is small enough for `by_counts`. SuperLU suits any size, but importing SciPy for it takes 0.15 s."""
    return entries.n <= MANY and entries.n * entries.nnz <= MOST


def largest_pivots(entries: Entries, values: NDArray[Any]) -> Order | None:
    """The order in which every pivot is the largest entry of its column for the present values: partial pivoting."""
    if is_small(entries):
        return by_counts(entries, values)
    return pivoted(entries, entries.matrix(values), np.arange(entries.n), permc_spec="COLAMD")


def pivoted(entries: Entries, ordered: csc_matrix, order: NDArray[Any], **options: Any) -> Order | None:
    """The order with the pivots that SuperLU chooses in a matrix whose rows and columns were permuted by `order` (n,); None
    where SuperLU finds it singular."""
    try:
        factors = splu(ordered, **options)
    except RuntimeError:
        return None
    return Order(entries, order[np.argsort(factors.perm_r)], order[np.argsort(factors.perm_c)])


def by_counts(entries: Entries, values: NDArray[Any], share: float = 1.0) -> Order | None:
    """The order by Markowitz counts: in every step the pivot is the entry with the fewest other entries in its row and column,
    among those of at least `share` times the largest magnitude in their column. It needs memory for n^2 numbers; None where the
    matrix is singular."""
    n, complex_ = entries.n, values.dtype.kind == "c"
    if n > MANY:
        raise internal(f"the order of elimination of a matrix of {n} unknowns was to be found by a search that takes {MANY} "
                       "unknowns at most")
    d, at = np.zeros((n, n), complex if complex_ else float), np.zeros((n, n), dtype=np.int8)
    d[entries.row_of, entries.column_of], at[entries.row_of, entries.column_of] = values, 1
    rows, columns, top, lists = whole(np.arange(n)), whole(np.arange(n)), np.zeros(n), np.empty((2, n, n), dtype=np.int16)
    count, place = np.zeros((2, 2 * n), dtype=np.int64)
    found = choosing().lu_choose(n, complex_, share, address(d), address(at),
                                  *(address(array) for array in (rows, columns, count, place, lists, top)))
    return Order(entries, rows, columns) if found == n else None


#: functions that look for an order of elimination, tried one after the other. Each gets the pattern and the values of a matrix
#: (n, n), real or complex, and returns an order or None. The last function chooses the largest pivots. Empty: dense LU
Searches = tuple[Callable[[Entries, NDArray[Any]], Order | None], ...]


class Orders:
    """The order of elimination that all matrices with one pattern share; `present` is None until one is found."""

    def __init__(self, entries: Entries, searches: Searches) -> None:
        self.entries, self.searches = entries, searches
        self.present: Order | None = None


def pivots(order: Order | None) -> list[Index] | None:
    """The pivots of an order: rows and columns."""
    return None if order is None else [order.rows, order.columns]


def differ(some: list[Index] | None, others: list[Index] | None) -> bool:
    """Whether the pivots of two orders differ."""
    if some is None or others is None:
        return some is not others
    return not all(np.array_equal(a, b) for a, b in zip(some, others, strict=True))
