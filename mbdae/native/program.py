"""Equations as lists of operations on one array W of numbers, run in C; see `evaluation.c` for what an operation does.

A slot is the index of an entry of W. A list is built once: `Operations.slots` reserves slots, other methods append operations.
`table` checks every slot against the size of W and builds the table that C reads; wrong slots raise ValueError.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbdae.deferred import sp
from mbdae.errors import internal
from mbdae.native import declared
from mbdae.native.equations import Number, Pointer, Whole

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CALL, LOAD, SET, ADD, MULTIPLY, CHOLESKY, SOLVE, LU, POSITIVE, PASS, LOOKUP = range(11)
READ = 3  #: number of results of LOOKUP: the value of a table and its first two derivatives


class Operation(ctypes.Structure):
    """The C struct `Operation` of evaluation.c, with the same members in the same order."""

    _fields_ = (
        *((name, Whole) for name in ("kind", "times", "count", "first", "inputs", "outputs", "to_step", "from_step", "by_step",
                                     "weight_step")),
        *((name, Pointer) for name in ("to", "from_", "by", "weight", "function", "data")),
    )


class Part(ctypes.Structure):
    """The C struct `Part` of evaluation.c: operations that are run one after the other."""

    _fields_ = (("first", Pointer), ("count", Whole))


Made = Callable[[Any], ArrayLike]  #: of the equations of a model: makes numbers of an operation from those of its laws


class Step(NamedTuple):
    """One operation. fields: values for the members of `Operation`, and the kernel of a CALL or PASS; tables: its arrays of slots
    and weights; slots: the lowest slot that it uses, and the one after the highest; made: what makes the weights, or None."""

    fields: dict[str, Any]
    tables: dict[str, Array | Index]
    slots: tuple[int, int]
    made: Made | None = None


@dataclass
class _Room:
    """The array that several lists of operations share: its size, and the constants in it, each with its first slot."""

    size: int
    constants: list[tuple[int, Array | Made]] = field(default_factory=list)


class Operations:
    """A list of operations in the order in which they run; the array is made later. size: number of slots reserved before, by the
    caller; base: another list, with which this one shares the array; source: what functions that make numbers are given."""

    def __init__(self, size: int = 0, base: Operations | None = None, source: Any = None) -> None:
        self._room: _Room = _Room(size) if base is None else base._room
        self.source: Any = source if base is None else base.source
        self.steps = list[Step]()
        self._first: Operations | None = None
        self._table: tuple[Part, list[Any]] | None = None

    def again(self, source: Any) -> Operations:
        """The same operations with the numbers that another model makes of them."""
        made = Operations(base=self)
        made.source, made._first = source, self._first or self
        for step in self.steps:
            tables = dict(step.tables) if step.made is None else {**step.tables, "weight": self._numbers(step.made, source)}
            made.steps.append(step if step.made is None else step._replace(tables=tables))
        return made

    @staticmethod
    def _numbers(values: ArrayLike | Made, source: Any) -> Array:
        return np.asarray(values(source) if callable(values) else values, dtype=float).ravel()

    @property
    def size(self) -> int:
        """Number of slots of the array."""
        return self._room.size

    def slots(self, count: int) -> int:
        """Reserve `count` consecutive entries (slots) of the array; returns the index of the first."""
        first, self._room.size = self.size, self.size + int(count)
        return first

    def zeros(self, count: int) -> int:
        """Reserve `count` slots that are set to 0 whenever the operations run; returns the index of the first."""
        first = self.slots(count)
        self.load(first, np.zeros(count))
        return first

    def constant(self, values: ArrayLike | Made) -> int:
        """Reserve slots for constants, which `fill` writes once into the array; returns the first slot."""
        numbers = self._numbers(values, self.source).copy()
        first = self.slots(len(numbers))
        self._room.constants.append((first, values if callable(values) else numbers))
        return first

    def fill(self, W: Array) -> None:
        """Write the constants, for which `constant` reserved slots, into the array W."""
        for first, values in self._room.constants:
            numbers = self._numbers(values, self.source)
            W[first : first + len(numbers)] = numbers

    def part(self, *others: Operations) -> Operations:
        """A new list on the same array, which begins with a copy of the operations of other lists."""
        made = Operations(base=self)
        for other in others:
            made.steps += other.steps
        return made

    # -- operations

    def call(self, kernel: Any, gather: ArrayLike, first: int | None = None) -> Index:
        """Evaluate a kernel (`mbdae.kernels.Kernel`) at points, with inputs from slots gather (points, inputs); returns the slots
        (points, width) of its values, the first of which is `first` if given. `table` compiles the kernel."""
        slots, width = np.asarray(gather, dtype=np.int64), kernel.width
        points, inputs = slots.shape
        first = self.slots(points * width) if first is None else first
        self._add(CALL, {"from_": slots}, (first, points * width), times=points, inputs=inputs, outputs=width, first=first,
                  kernel=kernel)
        return block(first, points, width)

    def hand_on(self, kernel: Any, gather: ArrayLike, to: ArrayLike, first: int | None = None) -> Index:
        """Like `call`, but the points are evaluated one after the other: the first `count` values of a point are added to the
        slots `to` (points, count) before the inputs of the next point are read, so that a point can use results of those before
        it (a recursion along a tree)."""
        slots, sums = np.asarray(gather, dtype=np.int64), np.asarray(to, dtype=np.int64)
        (points, inputs), width, count = slots.shape, kernel.width, sums.shape[-1] if sums.ndim == 2 else -1
        if sums.shape != (points, count) or count > width:
            raise internal(f"a compiled function with {width} outputs at {points} points was given places of shape {sums.shape} "
                           f"to add them to: ({points}, {width} or fewer) is needed")
        first = self.slots(points * width) if first is None else first
        self._add(PASS, {"from_": slots, "to": sums}, (first, points * width), times=points, inputs=inputs, outputs=width,
                  count=count, first=first, kernel=kernel)
        return block(first, points, width)

    def load(self, first: int, values: ArrayLike | Made) -> None:
        """Append an operation that writes these constants into consecutive slots from `first` on whenever the operations run."""
        numbers = self._numbers(values, self.source)
        self._add(LOAD, {"weight": numbers}, (first, len(numbers)), made=values, times=1, count=len(numbers), first=first)

    def set(self, to: ArrayLike, from_: ArrayLike, times: int = 1, to_step: int = 0, from_step: int = 0) -> None:
        """W[to] = W[from_], `times` times: in each repetition the slots lie to_step and from_step further on."""
        self._map(SET, times, {"to": to, "from_": from_}, None, to_step=to_step, from_step=from_step)

    def add(self, to: ArrayLike, from_: ArrayLike, weight: ArrayLike | Made = 1.0, times: int = 1, to_step: int = 0,
            from_step: int = 0) -> None:
        """W[to] += weight * W[from_], repeated as in `set`. weight: one number, (len(to),), or (times, len(to))."""
        self._map(ADD, times, {"to": to, "from_": from_}, weight, to_step=to_step, from_step=from_step)

    def multiply(self, to: ArrayLike, from_: ArrayLike, by: ArrayLike, weight: ArrayLike = 1.0, times: int = 1,
                 to_step: int = 0, from_step: int = 0, by_step: int = 0) -> None:
        """W[to] += weight * W[from_] * W[by], repeated as in `set`."""
        self._map(MULTIPLY, times, {"to": to, "from_": from_, "by": by}, weight, to_step=to_step, from_step=from_step,
                  by_step=by_step)

    def cholesky(self, n: int, width: int, matrix: int, right: int) -> None:
        """Factorise a symmetric band matrix in place by Cholesky and solve for one right-hand side, in whose slots the solution
        is written. matrix: first slot of its n rows of `width` entries each, the last of which is on the diagonal; right: first
        slot of the right-hand side (n,)."""
        self._add(CHOLESKY, {}, (matrix, n * width), (right, n), times=1, count=n, inputs=width, first=matrix, outputs=right)

    def solve(self, n: int, width: int, matrix: int, right: int, times: int) -> None:
        """Solve for `times` further right-hand sides, stored one after the other from slot `right` on, with the factors that
        `cholesky` left at slot `matrix`."""
        self._add(SOLVE, {}, (matrix, n * width), (right, n * times), times=times, count=n, inputs=width, first=matrix,
                  outputs=right)

    def lu(self, n: int, matrix: int, right: int, times: int = 1) -> None:
        """Solve with a full matrix, stored by rows at slot `matrix`, for right-hand sides stored one after the other at slot
        `right`, in place."""
        self._add(LU, {}, (matrix, n * n), (right, n * times), times=times, count=n, first=matrix, outputs=right)

    def positive(self, at: ArrayLike) -> None:
        """Stop the run with the code SINGULAR unless all slots `at` hold positive numbers; `Scene.bad` then is the index in `at`
        of the first that does not."""
        self._map(POSITIVE, 1, {"from_": at}, None)

    def lookup(self, packed: Array, at: int, side: int, a: float, b: float) -> int:
        """Read a table (`inputs.tables.Table.packed`) at a x + b, where x is in slot `at`. Where this is exactly a point of the
        table, at which its derivatives may jump, the slot `side` holds another x, and a x + b tells on which side of the point to
        read. Returns the first of three slots: the value of the table and its first two derivatives."""
        first, points = self.slots(READ + 3), (len(packed) - 9) // 6
        self._room.constants.append((first + READ, np.array([0.0, a, b])))  # segment of the table read last, a, b
        if len(packed) != 9 + 6 * points or points < 2:
            raise internal(f"a table of an input of time was stored in {len(packed)} numbers: 9, and 6 for each of two or more "
                           "points, are needed")
        self._add(LOOKUP, {"weight": packed}, (first, READ + 3), (at, 1), (side, 1), times=1, count=points, first=first,
                  inputs=at, outputs=side)
        return first

    # -- tables

    def _map(self, kind: int, times: int, slots: dict[str, ArrayLike], weight: ArrayLike | Made | None, **steps: int) -> None:
        made, weight = weight, weight(self.source) if callable(weight) else weight
        tables: dict[str, Any] = {name: np.asarray(values, dtype=np.int64).ravel() for name, values in slots.items()}
        count = len(tables["from_"])
        if any(len(table) != count for table in tables.values()):
            raise internal("an operation of the compiled equations was given lists of places of different lengths: "
                           f"{ {name.rstrip('_'): len(table) for name, table in tables.items()} }")
        if not count or not times:
            return
        if weight is not None:
            weights = np.asarray(weight, dtype=float)
            weights = np.full(count, weights) if weights.ndim == 0 else weights
            if weights.shape not in ((count,), (times, count)):
                raise internal(f"an operation of the compiled equations was given factors of shape {weights.shape}: a number, "
                               f"({count},) or ({times}, {count}) is needed")
            steps["weight_step"], tables["weight"] = (count if weights.ndim == 2 else 0), weights.ravel()
        self._add(kind, tables, made=made, times=times, count=count, **steps)

    def _add(self, kind: int, tables: dict[str, Any], *ranges: tuple[int, int], made: Any = None, **fields: Any) -> None:
        kept = {name: np.array(table, order="C") if table.flags.writeable else table for name, table in tables.items()}
        for name, table in kept.items():
            if name != "weight" and table.size:
                last = max((fields["times"] - 1) * fields.get(f"{name.rstrip('_')}_step", 0), 0)
                ranges = (*ranges, (int(table.min()), int(table.max()) + last - int(table.min()) + 1))
        if fields["times"] < 0 or any(fields.get(name, 0) < 0 for name in ("to_step", "from_step", "by_step", "count", "inputs")):
            raise internal(f"an operation of the compiled equations has a negative size: {fields}")
        self.steps.append(Step({"kind": kind} | fields, kept, _whole(ranges), made if callable(made) else None))

    @property
    def widest(self) -> int:
        """Largest number of inputs of a kernel in this list, for which C needs room."""
        return max((f["inputs"] for f, *_ in self.steps if f["kind"] in (CALL, PASS)), default=0)

    @property
    def reads(self) -> frozenset[int]:
        """All slots from which the operations take numbers, except the matrices of CHOLESKY, SOLVE and LU."""
        tables = [tables[name] for _, tables, *_ in self.steps for name in ("from_", "by") if name in tables]
        return frozenset(int(i) for table in tables for i in table.flat)

    def table(self, size: int) -> tuple[Part, list[Any]]:
        """The operations as C reads them, and the objects to be kept alive for it. Kernels are compiled here.

        Raises ValueError where an operation uses a slot outside of an array of `size` numbers."""
        if self._first is not None:  # of another model of the same shape, but for its numbers
            _, (table, *more) = self._first.table(size)
            own = type(table).from_buffer_copy(table)
            for k, step in enumerate(self.steps):
                if step.made is not None:
                    own[k].weight = step.tables["weight"].ctypes.data
            return Part(ctypes.addressof(own), len(self.steps)), [own, *more, self.steps]
        if self._table is not None and len(self._table[1][0]) == max(len(self.steps), 1):
            return self._table
        made = (Operation * max(len(self.steps), 1))()
        kept: list[Any] = [made]
        for operation, (fields, tables, (low, high), _) in zip(made, self.steps, strict=False):
            if low < 0 or high > size:
                raise internal(f"an operation of the compiled equations reads or writes numbers {low} to {high - 1}, beyond the "
                               f"{size} of its array")
            for name, value in fields.items():
                if name == "kernel":
                    code, data = value.compiled.as_ctypes()
                    operation.function, operation.data = ctypes.cast(code, Pointer).value, getattr(data, "value", data)
                    kept += code, data, value
                else:
                    setattr(operation, name, value)
            for name, table in tables.items():
                setattr(operation, name, table.ctypes.data)
                kept.append(table)
        self._table = Part(ctypes.addressof(made), len(self.steps)), kept
        return self._table


def block(first: int, points: int, width: int) -> Index:
    """Consecutive slots from `first` on, shape (points, width)."""
    return np.arange(first, first + points * width, dtype=np.int64).reshape(points, width)


def _whole(ranges: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """The lowest slot of ranges (first, count), and the one after the highest."""
    used = [(first, first + count) for first, count in ranges if count]
    return (min(first for first, _ in used), max(last for _, last in used)) if used else (0, 0)


class Scene(ctypes.Structure):
    """The C struct `Scene` of evaluation.c, with the same members in the same order."""

    _fields_ = (
        ("W", Pointer), ("x", Pointer),
        *((name, Whole) for name in ("n", "dotted", "nnz", "rows", "fy", "fyp", "rates", "at", "bad", "distance", "explicit")),
        ("read", Pointer), ("t", Number), ("side", Number),
        *((name, Part) for name in ("clock", "residual", "jacobian", "of_rates", "changes")),
    )


#: function that opens the library and states the types of the functions of evaluation.c for ctypes
core = declared(
    ("scene_residual", ctypes.c_int, (Pointer, Number, Pointer, Pointer, Pointer)),
    ("scene_jacobian", ctypes.c_int, (Pointer, Number, Pointer, Pointer, Pointer, Pointer)),
    ("scene_rates", ctypes.c_int, (Pointer, Number, Pointer, Pointer)),
    ("scene_part", ctypes.c_int, (Pointer, Pointer, Number, Pointer, Pointer)),
    ("scene_values", ctypes.c_int, (Pointer, Whole, Pointer, Pointer, Pointer, Whole, Whole, Pointer)),
    ("scene_residuals", ctypes.c_int, (Pointer, Whole, Pointer, Pointer, Pointer, Pointer)),
    ("scene_jacobians", ctypes.c_int, (Pointer, Whole, Pointer, Pointer, Pointer, Pointer, Pointer)),
)


def address_of(name: str) -> int | None:
    """Address of a function of the compiled library; never None, which ctypes returns for a null pointer."""
    return ctypes.cast(getattr(core(), name), Pointer).value


BANDED_FROM = 64  #: number of rows from which `narrow_order` reorders them; with fewer it does not pay


class Columns(NamedTuple):
    """Sparsity pattern of a matrix (n, n), column by column: first (n + 1,) where each column begins, rows (nnz,) of the
    entries."""

    first: Index
    rows: Index


def narrow_order(n: int, i: Index, j: Index) -> tuple[Index, Index]:
    """An order of n rows and columns in which a symmetric matrix with entries at (i, j) has a narrow band, and the position of
    each row in it."""
    order = np.arange(n)
    if n >= BANDED_FROM:
        from scipy.sparse.csgraph import reverse_cuthill_mckee  # imported here because small scenes do not need it

        graph = sp.csr_matrix((np.ones(len(i)), (i, j)), shape=(n, n))
        order = reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.intp)
    place = np.empty(n, dtype=np.intp)
    place[order] = np.arange(n)
    return order, place
