"""Evaluations as lists of operations on one array of numbers, run natively; see `evaluation.c` for what an operation does.

A program is built once: `slots` gives room in the array, the other methods append operations to a part of it. `Compiled` checks
every slot against the size of the array and makes the tables; wrong ones raise ValueError and are never run.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbdae.native.equations import RAISED, Number, Pointer, Whole, seen
from mbdae.native.library import library

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CALL, CALL_BACK, LOAD, SET, ADD, MULTIPLY, CHOLESKY, SOLVE, LU = range(9)
CALLED = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Pointer, Pointer)


class Operation(ctypes.Structure):
    """`Operation` of evaluation.c."""

    _fields_ = (
        *((name, Whole) for name in ("kind", "times", "count", "first", "inputs", "outputs", "to_step", "from_step", "by_step",
                                     "weight_step")),
        *((name, Pointer) for name in ("to", "from_", "by", "weight", "function", "data")),
    )  # fmt: skip


class Part(ctypes.Structure):
    """`Part` of evaluation.c: operations one after the other."""

    _fields_ = (("first", Pointer), ("count", Whole))


class Step(NamedTuple):
    """One operation as it was stated. slots: the lowest it touches, and the one behind the highest; kernel: what a CALL
    evaluates, with its symbols and expressions, where that is known."""

    fields: dict[str, Any]
    tables: dict[str, Array | Index]
    slots: tuple[int, int]
    kernel: Any


class Operations:
    """Operations in the order in which they run, not yet bound to an array. size: slots they may use."""

    def __init__(self, size: int) -> None:
        self.size, self.steps = size, list[Step]()
        self._kept: list[Any] = []
        self.errors: list[BaseException] = []  #: what functions of Python raised

    def slots(self, count: int) -> int:
        """Room for so many numbers; the first slot."""
        first, self.size = self.size, self.size + int(count)
        return first

    def part(self, *others: Operations) -> Operations:
        """A further list on the same array, which begins with the operations of others."""
        return _Further(self, others)

    # -- operations

    def call(self, function: tuple[Any, Any], gather: ArrayLike, width: int, first: int | None = None,
             kernel: Any = None) -> int:  # fmt: skip
        """A compiled kernel (its function and data) at points with inputs at slots gather (points, inputs); the slot of the first
        value, which is `first` where the values have a place. kernel: its symbols and expressions, for those who read them."""
        table = np.asarray(gather, dtype=np.int64)
        points, inputs = table.shape
        first = self.slots(points * width) if first is None else first
        code, data = function
        self._kept.append(function)
        address = ctypes.cast(code, Pointer).value
        self._add(CALL, {"from_": table}, (first, points * width), kernel=kernel, times=points, inputs=inputs, outputs=width,
                  first=first, function=address, data=getattr(data, "value", data))  # fmt: skip
        return first

    def call_back(self, function: Callable[[Array, Array], None], gather: ArrayLike, width: int) -> int:
        """A function (x (points, inputs), out (points, width)) of Python; the slot of the first value. What it raises is kept in
        `errors`."""
        table = np.asarray(gather, dtype=np.int64)
        (points, inputs), first, errors = table.shape, self.slots(table.shape[0] * width), self._errors()

        def called(out: int, x: int, _: Any) -> int:
            try:
                function(seen(x, points * inputs).reshape(points, inputs), seen(out, points * width).reshape(points, width))
            except BaseException as error:
                errors.append(error)
                return RAISED
            return 0

        made = CALLED(called)
        self._kept.append(made)
        self._add(CALL_BACK, {"from_": table}, (first, points * width), times=points, inputs=inputs, outputs=width, first=first,
                  function=ctypes.cast(made, Pointer).value)  # fmt: skip
        return first

    def load(self, first: int, values: ArrayLike) -> None:
        """Numbers into slots one after the other."""
        numbers = np.asarray(values, dtype=float).ravel()
        self._add(LOAD, {"weight": numbers}, (first, len(numbers)), times=1, count=len(numbers), first=first)

    def set(self, to: ArrayLike, from_: ArrayLike, times: int = 1, to_step: int = 0, from_step: int = 0) -> None:
        """Copy slots; with `times`, once for every instance, whose slots are a step further."""
        self._map(SET, times, {"to": to, "from_": from_}, None, to_step=to_step, from_step=from_step)

    def add(self, to: ArrayLike, from_: ArrayLike, weight: ArrayLike, times: int = 1, to_step: int = 0,
            from_step: int = 0) -> None:  # fmt: skip
        """W[to] += weight * W[from]. weight (entries,), or (times, entries)."""
        self._map(ADD, times, {"to": to, "from_": from_}, weight, to_step=to_step, from_step=from_step)

    def multiply(self, to: ArrayLike, from_: ArrayLike, by: ArrayLike, weight: ArrayLike, times: int = 1, to_step: int = 0,
                 from_step: int = 0, by_step: int = 0) -> None:  # fmt: skip
        """W[to] += weight * W[from] * W[by]."""
        self._map(MULTIPLY, times, {"to": to, "from_": from_, "by": by}, weight, to_step=to_step, from_step=from_step,
                  by_step=by_step)  # fmt: skip

    def cholesky(self, n: int, width: int, matrix: int, right: int) -> None:
        """Solve with the symmetric band matrix at slot `matrix`, n rows of `width` entries that end on the diagonal, for the
        right side at slot `right`, in place."""
        self._add(CHOLESKY, {}, (matrix, n * width), (right, n), times=1, count=n, inputs=width, first=matrix, outputs=right)

    def solve(self, n: int, width: int, matrix: int, right: int, times: int) -> None:
        """Solve with the factors that `cholesky` left for further right-hand sides, one behind the other."""
        self._add(SOLVE, {}, (matrix, n * width), (right, n * times), times=times, count=n, inputs=width, first=matrix,
                  outputs=right)  # fmt: skip

    def lu(self, n: int, matrix: int, right: int, times: int = 1) -> None:
        """Solve with a full matrix, row by row at slot `matrix`, for right-hand sides one behind the other at slot `right`, in
        place."""
        self._add(LU, {}, (matrix, n * n), (right, n * times), times=times, count=n, first=matrix, outputs=right)

    # -- tables

    def _errors(self) -> list[BaseException]:
        return self.errors

    def _map(self, kind: int, times: int, slots: dict[str, ArrayLike], weight: ArrayLike | None, **steps: int) -> None:
        tables: dict[str, Any] = {name: np.asarray(values, dtype=np.int64).ravel() for name, values in slots.items()}
        count = len(tables["to"])
        if any(len(table) != count for table in tables.values()):
            raise ValueError(f"tables of different lengths: { {name: len(table) for name, table in tables.items()} }")
        if not count or not times:
            return
        if weight is not None:
            weights = np.asarray(weight, dtype=float)
            if weights.shape not in ((count,), (times, count)):
                raise ValueError(f"weights {weights.shape} for {times} instances of {count} entries")
            steps["weight_step"], tables["weight"] = (count if weights.ndim == 2 else 0), weights.ravel()
        self._add(kind, tables, times=times, count=count, **steps)

    def _add(self, kind: int, tables: dict[str, Any], *ranges: tuple[int, int], kernel: Any = None, **fields: Any) -> None:
        kept = {name: np.array(table, order="C") for name, table in tables.items()}  # copies: nobody changes them later
        for name, table in kept.items():
            if name != "weight" and table.size:
                last = max((fields["times"] - 1) * fields.get(f"{name.rstrip('_')}_step", 0), 0)
                ranges = (*ranges, (int(table.min()), int(table.max()) + last - int(table.min()) + 1))
        if fields["times"] < 0 or any(fields.get(name, 0) < 0 for name in ("to_step", "from_step", "by_step", "count", "inputs")):
            raise ValueError(f"negative sizes: {fields}")
        self.steps.append(Step({"kind": kind} | fields, kept, _whole(ranges), kernel))

    @property
    def widest(self) -> int:
        """Numbers that the inputs of a kernel take at most."""
        return max((f["inputs"] * (f["times"] if f["kind"] == CALL_BACK else 1) for f, *_ in self.steps
                    if f["kind"] in (CALL, CALL_BACK)), default=0)  # fmt: skip

    def table(self, size: int) -> tuple[Part, list[Any]]:
        """The operations as C reads them, and what has to be kept alive.

        Raises ValueError where one leaves an array of `size` numbers."""
        made = (Operation * max(len(self.steps), 1))()
        kept: list[Any] = [made, *self._kept]
        for operation, (fields, tables, (low, high), _) in zip(made, self.steps, strict=False):
            if low < 0 or high > size:
                raise ValueError(f"an operation on slots {low} to {high - 1} of an array of {size}")
            for name, value in fields.items():
                setattr(operation, name, value)
            for name, table in tables.items():
                setattr(operation, name, table.ctypes.data)
                kept.append(table)
        return Part(ctypes.addressof(made), len(self.steps)), kept


class _Further(Operations):
    """A list on the array of another one."""

    def __init__(self, base: Operations, others: Sequence[Operations]) -> None:
        self._base = base
        super().__init__(0)
        for other in others:
            self.steps += other.steps
            self._kept += other._kept

    @property
    def size(self) -> int:
        return self._base.size

    @size.setter
    def size(self, value: int) -> None:
        if value:
            self._base.size = value

    def _errors(self) -> list[BaseException]:
        return self._base._errors()


def _whole(ranges: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """The lowest slot and the one behind the highest of ranges (first, count)."""
    used = [(first, first + count) for first, count in ranges if count]
    return (min(first for first, _ in used), max(last for _, last in used)) if used else (0, 0)


class Scene(ctypes.Structure):
    """`Scene` of evaluation.c."""

    _fields_ = (
        ("W", Pointer), ("x", Pointer),
        *((name, Whole) for name in ("n", "dotted", "nnz", "rows", "fy", "fyp", "rates", "at", "bad")),
        ("read", Pointer), ("t", Number), ("side", Number),
        *((name, Part) for name in ("clock", "residual", "jacobian", "of_rates")),
    )  # fmt: skip


def core() -> Any:
    """The library with the functions of evaluation.c declared."""
    found = library()
    for name, arguments in (("scene_residual", (Pointer, Number, Pointer, Pointer, Pointer)),
                            ("scene_jacobian", (Pointer, Number, Pointer, Pointer, Pointer, Pointer)),
                            ("scene_rates", (Pointer, Number, Pointer, Pointer)),
                            ("scene_part", (Pointer, Pointer, Number, Pointer, Pointer)),
                            ("scene_values", (Pointer, Pointer, Whole, Pointer, Pointer, Whole, Whole, Whole, Pointer)),
                            ("scene_residuals", (Pointer, Whole, Pointer, Pointer, Pointer, Pointer))):  # fmt: skip
        function = getattr(found, name)
        function.argtypes, function.restype = arguments, ctypes.c_int
    return found


def address_of(name: str) -> int | None:
    """Address of a function of the library."""
    return ctypes.cast(getattr(core(), name), Pointer).value
