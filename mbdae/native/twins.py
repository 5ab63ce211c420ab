"""Derivatives of lists of operations, and of runs along their steps: the Python side of adjoint.c, and of the ends of
evaluation.c and explicit.c."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import internal
from mbdae.native import Entries, declared
from mbdae.native.equations import Number, Pointer, Whole
from mbdae.native.explicit import ALL
from mbdae.native.program import Part, Scene
from mbdae.native.sparse import Matrix, Searches, SingularMatrixError

Array = NDArray[np.float64]
Index = NDArray[np.int64]
VALUE = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Whole, Number, Pointer, Pointer)
ALONG = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Whole, Pointer, Pointer)
FAILED = -1  #: code of a callback that raised


class TwinTable(ctypes.Structure):
    """The C struct `Twin` of core.h, with the same members in the same order."""

    _fields_ = (("self", Pointer), ("n", Whole), ("columns", Whole), ("value", Pointer), ("along", Pointer), ("back", Pointer))


class TwinsTable(ctypes.Structure):
    """The C struct `Twins` of evaluation.c, with the same members in the same order."""

    _fields_ = (("scene", Pointer), *((name, Part) for name in ("value", "along", "back")),
                *((name, Whole) for name in ("first", "count", "width", "clock", "clocks", "columns", "by_rows", "known",
                                             "room")),
                *((name, Pointer) for name in ("column", "slot", "seed", "prescribed", "fixed", "J", "G", "kept", "of_clock")))


class PathTable(ctypes.Structure):
    """The C struct `Path` of explicit.c, with the same members in the same order."""

    _fields_ = (("f", Pointer), ("inner", Whole),
                *((name, Pointer) for name in ("A", "c", "B", "side", "K", "x", "dK", "dx")))


_functions = declared(
    ("twins_value", ctypes.c_int, (Pointer, Whole, Number, Pointer, Pointer)),
    ("twins_along", ctypes.c_int, (Pointer, Whole, Pointer, Pointer)),
    ("twins_back", ctypes.c_int, (Pointer, Whole, Pointer, Pointer)),
    ("twins_states", ctypes.c_int, (Pointer, Whole, Whole, *[Pointer] * 5)), ("twins_run", ctypes.c_int, (Pointer, Pointer)),
    ("explicit_along", ctypes.c_int, (Pointer, Whole, *[Pointer] * 5)),
    ("explicit_back", ctypes.c_int, (Pointer, Whole, *[Pointer] * 6)),
    ("stages_back", ctypes.c_int, (Pointer, Pointer, Pointer, Whole, *[Pointer] * 3)),
    ("stages_along", ctypes.c_int, (Pointer, Pointer, Pointer, *[Whole] * 3, *[Pointer] * 3)),
)


class Twins:
    """A list of operations with its tangent and pullback on the array W of a scene, see `Twins` in evaluation.c."""

    def __init__(self, scene: Scene, parts: dict[str, Part], W: Array, first: int, count: int, width: int, clock: int,
                 clocks: int) -> None:
        """parts: value, along, back; the others as in evaluation.c."""
        self._W, self._kept, self._parts = W, dict[str, Any](scene=scene), parts
        self.table = TwinsTable(ctypes.addressof(scene), *(parts[name] for name in ("value", "along", "back")), first, count,
                                width, clock, clocks, 0, 0, 0, 1)
        self.address, self.n = ctypes.addressof(self.table), int(scene.n)
        self.count, self.clocks, self.width = count, clocks, width

    def _give(self, **arrays: Any) -> None:
        for name, array in arrays.items():
            self._kept[name] = array
            setattr(self.table, name, None if array is None else array.ctypes.data)

    def clear(self) -> None:
        """Set the differentials of all slots, and the weights of all inputs, to 0."""
        self._W[self.width :] = 0.0

    def by(self, seeds: list[tuple[Index, Array]], fixed: Any) -> None:
        """Choose the numbers by which one differentiates: of each the slots of differentials and their values. fixed (count,):
        results whose derivatives are constants."""
        P = len(seeds)
        slots = np.concatenate([np.zeros(0, np.int64), *(slot for slot, _ in seeds)]).astype(np.int64)
        if slots.size and not (slots.min() >= self.width and slots.max() < len(self._W)):
            raise internal("a derivative by a number was asked for in places that are no differentials")
        self._give(column=np.cumsum([0, *(len(slot) for slot, _ in seeds)]).astype(np.int64), slot=slots,
                   seed=np.concatenate([np.zeros(0), *(value for _, value in seeds)]), fixed=np.array(fixed, dtype=np.int8),
                   J=np.zeros((self.count, self.n)), G=np.zeros((self.count, P)))
        self.table.columns, self.table.known, self.table.by_rows = P, 0, int(self.count - np.count_nonzero(fixed) < P)

    def at(self, prescribed: Array | None = None, of_clock: Array | None = None, room: int = 0) -> None:
        """Set, for the states that follow, the derivatives of the values of the clock by the numbers (states, P, clocks), or
        where the weights of these values go (states, clocks); room: number of states to which pullbacks may go back."""
        kept = self._kept.get("kept")
        self._give(prescribed=prescribed, of_clock=of_clock,
                   kept=None if not room else kept if kept is not None else np.zeros((room, self.width)))
        self.table.room = max(room, 1)

    def run(self, name: str) -> None:
        """Run the tangent or pullback alone."""
        _functions().twins_run(self.address, ctypes.byref(self._parts[name]))

    def states(self, t: Array, y: Array, yp: Array, weights: Array | None = None) -> Array:
        """At k states, t (k,), y and yp (k, n): the changes (k, count, P) by the numbers; with weights (k, count) of the results
        the weights (k, n) of y, while those of the inputs are added up."""
        t, y, yp = (np.ascontiguousarray(x, dtype=float) for x in (t, y, yp))
        given = None if weights is None else np.ascontiguousarray(weights, dtype=float)
        out = np.empty((len(t), self.count, self.table.columns) if given is None else (len(t), self.n))
        if _functions().twins_states(self.address, 0, len(t), t.ctypes.data, y.ctypes.data, yp.ctypes.data,
                                     None if given is None else given.ctypes.data, out.ctypes.data):
            raise FloatingPointError
        return out

    @property
    def twin(self) -> TwinTable:
        """The table by which steps of a method call these derivatives."""
        found = _functions()
        return TwinTable(self.address, self.n, self.table.columns, *(ctypes.cast(getattr(found, f"twins_{name}"), Pointer).value
                                                                     for name in ("value", "along", "back")))


class Called:
    """Derivatives of y' = f(t, y) in Python, `columns` at a time: an object with the functions value(at, t, y) -> y', along(at,
    dy) -> (n, P) and back(at, weight) -> (n,). error: the exception that one of them raised."""

    def __init__(self, of: Any, n: int, columns: int) -> None:
        self.error: BaseException | None = None

        def view(address: int, *shape: int) -> Array:
            return np.ctypeslib.as_array((ctypes.c_double * int(np.prod(shape))).from_address(address)).reshape(shape)

        def guarded(function: Callable[..., None]) -> Callable[..., int]:
            def call(_: Any, *args: Any) -> int:
                try:
                    function(*args)
                except BaseException as error:  # cannot pass through C
                    self.error = error
                    return FAILED
                return 0
            return call

        def value(at: int, t: float, y: int, out: int) -> None:
            view(out, n)[:] = of.value(at, t, view(y, n))

        def along(at: int, dy: int, out: int) -> None:
            view(out, n, columns)[:] = of.along(at, view(dy, n, columns))

        def back(at: int, weight: int, out: int) -> None:
            view(out, n)[:] = of.back(at, view(weight, n))

        self._kept = VALUE(guarded(value)), ALONG(guarded(along)), ALONG(guarded(back))
        self.twin = TwinTable(None, n, columns, *(ctypes.cast(call, Pointer).value for call in self._kept))


class Path:
    """Derivatives along steps of an explicit method. twin: the derivatives of y'; A (ALL, ALL), B (inner, ALL): stages, and
    increments at the inner nodes; side: array whose first number is the time at which conditions of inputs are read."""

    def __init__(self, twin: TwinTable, A: Array, B: Array, side: Array) -> None:
        n, width = int(twin.n), max(int(twin.columns), 1)
        arrays = (np.ascontiguousarray(A), A.sum(axis=1), np.ascontiguousarray(B), side, np.zeros((ALL, n)), np.zeros(n),
                  np.zeros((ALL, n * width)), np.zeros(n * width))
        self.n, self.columns, self.inner, self._kept = n, int(twin.columns), len(B), (twin, arrays)
        self.table = PathTable(ctypes.addressof(twin), len(B), *(array.ctypes.data for array in arrays))

    def along(self, t: Array, y: Array, S: Array) -> tuple[int, Array, Array, Array]:
        """A code, ends (m, n) of the repeated steps, derivatives (m + 1, n, P) of y and increments (m, inner, n, P); S (n, P):
        those at the beginning; t (m + 1,), y (m + 1, n): of the run."""
        m, out = len(t) - 1, np.empty((len(t), self.n, self.columns))
        out[0] = S
        inner, reached = np.empty((m, self.inner, self.n, self.columns)), np.zeros((m, self.n))
        t, y = np.ascontiguousarray(t), np.ascontiguousarray(y)
        code = _functions().explicit_along(ctypes.addressof(self.table), m, t.ctypes.data, y.ctypes.data, reached.ctypes.data,
                                           out.ctypes.data, inner.ctypes.data)
        return int(code), reached, out, inner

    def back(self, t: Array, y: Array, ends: Array, inner: Array, total: Array) -> tuple[int, Array]:
        """A code and the ends of the repeated steps; total (n,), weights of y at the end, becomes those at the beginning. ends
        (m, n): weights of y at the beginnings of the steps; inner (m, inner, n): of the increments."""
        m, reached = len(t) - 1, np.zeros((len(t) - 1, self.n))
        given = [np.ascontiguousarray(x) for x in (t, y, ends, inner)]
        t, y, ends, inner = given
        code = _functions().explicit_back(ctypes.addressof(self.table), m, t.ctypes.data, y.ctypes.data, reached.ctypes.data,
                                          ends.ctypes.data, inner.ctypes.data, total.ctypes.data)
        return int(code), reached


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
        self._order, self._stage, self._n, self._s = order, s // 2, n, s
        real = len(table.real)
        sign = np.sign((table.T_inv @ table.A_inv @ table.T)[real + 1, real]) if len(table.pairs) else 1.0
        kept = [np.ascontiguousarray(x) for x in (entries.row_of, entries.column_of, order, table.A_inv, table.T, table.T_inv)]
        room = [np.zeros(size * n * numbers) for size in (s, 2 * s, s, 4)]
        self._kept = kept, room
        self.table = StagesTable(s, n, entries.nnz, int(transposed), self._stage, *(x.ctypes.data for x in kept), float(sign),
                                 self.matrix.address, *(x.ctypes.data for x in room))
        self._at = ctypes.addressof(self.table)

    def over(self, of: Twins, own: int, side: Array, *given: Array) -> None:
        """Choose the steps: derivatives of F by numbers, the number of unknowns of the run, which are the first of F, the array
        whose first number is the time at which conditions are read; and as `Path` in adjoint.c says h and middles (m,), times (m,
        s), Y, Y' (m, s, n), dF/dy and dF/dy' (m, s, nnz). Unknowns are scaled by the first step."""
        self._given = [np.ascontiguousarray(x) for x in given]
        self._steps = StepsTable(*(x.ctypes.data for x in self._given), own, of.address, side.ctypes.data)
        h, fy, fyp = self._given[0], *self._given[-2:]
        self.times, self._own, self._columns = self._given[2], own, of.table.columns
        size = (np.abs(fy[0, self._stage]) + np.abs(fyp[0, self._stage]) / h[0])[self._order]
        largest = np.zeros(self._n)
        np.maximum.at(largest, self.matrix.entries.column_of, size)
        self.matrix.scale[:] = 1 / np.where(largest > 0, largest, 1.0)

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
        self._called(lambda ready: int(_functions().stages_back(self._at, ctypes.addressof(self._steps), ctypes.addressof(m),
                                                                ready, *rest)), m, 1)

    def along(self, S: Array) -> tuple[Array, Array]:
        """Derivatives (m + 1, n, P) at the ends of the steps, and of the increments (m, s - 1, n, P); S (n, P): at the first."""
        steps, P = len(self.times), self._columns
        out, inner = np.empty((steps + 1, self._own, P)), np.empty((steps, self._s - 1, self._own, P))
        out[0], room, m = S, np.zeros((self._s, self._n, P)), Whole(0)
        rest = P, out.ctypes.data, inner.ctypes.data, room.ctypes.data
        self._called(lambda ready: int(_functions().stages_along(self._at, ctypes.addressof(self._steps), ctypes.addressof(m),
                                                                 steps, ready, *rest)), m, 0)
        return out, inner
