"""An explicit Runge-Kutta method with local error estimates and dense output: the Python side of explicit.c.

Derivatives of lists of operations, and along the steps of the method: that of the ends of evaluation.c and explicit.c.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import internal
from mbdae.native import address, declared
from mbdae.native.equations import SLICE, Equations, Number, Pointer, Stepping, Stretches, TwinTable, Whole
from mbdae.native.program import Part, Scene

Array = NDArray[np.float64]
Whole64 = NDArray[np.int64]
STAGES, ALL, ORDER = 12, 16, 7


class _Coefficients(ctypes.Structure):
    _fields_ = (("row", Pointer), ("column", Pointer), ("value", Pointer))


class CExplicit(ctypes.Structure):
    """The C struct `Explicit` of explicit.c, with the same members in the same order."""

    _fields_ = (("e", Pointer), *((name, _Coefficients) for name in ("stages", "errors", "dense")),
                *((name, Pointer) for name in ("c", "nodes", "atol")), ("inner", Whole),
                *((name, Number) for name in ("rtol", "h", "longest")), ("stretches", Stretches),
                *((name, Pointer) for name in ("K", "y", "next", "F")),
                *((name, Whole) for name in ("evaluations", "rejected", "after_rejection")))


class Batch:
    """k runs from `begin` to `end` (s) with the initial values starts (k, n). Of each run y at `times` and at the end, a return
    code and counts of steps are stored. numbers (k, m): the values that the m entries `slots` of the work array W have in each
    run. Raises ValueError where sizes do not fit, a slot is outside of W, or times do not increase from `begin` to `end`."""

    def __init__(self, begin: float, end: float, starts: Array, times: Array, W: Array, slots: Whole64, numbers: Array) -> None:
        k, n = starts.shape
        if numbers.shape != (k, len(slots)) or (len(slots) and not (slots.min() >= 0 and slots.max() < len(W))):
            raise internal(f"a batch of {k} runs was given values of shape {numbers.shape} for {len(slots)} numbers, or places "
                           f"of these, {slots.tolist()}, outside of the {len(W)} that the equations read")
        if not (begin < end and (np.diff(times, prepend=begin)[1:] > 0).all() and ((times >= begin) & (times <= end)).all()):
            raise internal(f"a batch was given output times {times} s that do not increase, or leave its time from {begin} to "
                           f"{end} s")
        self.y, self.last = np.full((k, len(times), n), np.nan), np.full((k, n), np.nan)
        self.code, self.counts = np.zeros(k, dtype=np.int64), np.zeros((3, k), dtype=np.int64)
        self.starts = np.array(starts, dtype=float, order="C")
        arrays = {"starts": self.starts, "numbers": np.array(numbers, dtype=float, order="C"),
                  "times": np.append(times, np.inf), "slots": np.array(slots, dtype=np.int64), "out": self.y, "last": self.last,
                  "code": self.code, **dict(zip(("steps", "rejected", "evaluations"), self.counts, strict=True))}
        self._kept, self.n = (arrays, W), n
        self.table = Runs(points=k, width=len(slots), outputs=len(times), from_=begin, end=end, W=W.ctypes.data,
                          **{name: a.ctypes.data for name, a in arrays.items()})

    def again(self, begin: float, end: float) -> None:
        """Let the same runs begin once more, from `starts` to another end (s)."""
        self.table.from_, self.table.end, self.table.point, self.table.begun = begin, end, 0, 0

    @property
    def done(self) -> int:
        """Number of runs that have ended."""
        return int(self.table.point)


Entries = Sequence[tuple[int, int, float]]


class Method:
    """Coefficients of an explicit Runge-Kutta method: of its stages, its two error estimates and its dense output, each a list of
    the nonzero entries (row, column, value) of a matrix, row by row.

    Raises ValueError where an entry is outside of its array or not in the order of rows."""

    def __init__(self, stages: Entries, errors: Entries, dense: Entries) -> None:
        self._kept: list[Any] = []
        self.stages, self.errors = self._rows(stages, ALL, ALL), self._rows(errors, 2, STAGES + 1)
        self.dense = self._rows(dense, 4, ALL)
        self._c = np.zeros(ALL)
        np.add.at(self._c, [i for i, _, _ in stages], [a for _, _, a in stages])
        self.c = self._c.ctypes.data

    def _rows(self, entries: Entries, rows: int, columns: int) -> _Coefficients:
        i, j = (np.array([entry[k] for entry in entries], dtype=np.int64) for k in (0, 1))
        if not (i.min() >= 0 and i.max() < rows and j.min() >= 0 and j.max() < columns and (np.diff(i) >= 0).all()):
            raise internal(f"the coefficients of a Runge-Kutta method lie outside of their table of {rows} rows and {columns} "
                           "columns, or are not sorted by rows")
        arrays = np.searchsorted(i, np.arange(rows + 1)).astype(np.int64), j, np.array([v for *_, v in entries])
        self._kept.append(arrays)
        return _Coefficients(*(array.ctypes.data for array in arrays))


class Steps(NamedTuple):
    """Accepted steps: times t (m,) at their ends, y and y' there (m, n), increments of y from the begin of the step to the nodes
    of dense output (m, inner, n); code: why the call ended."""

    t: Array
    y: Array
    yp: Array
    inner: Array
    code: int

    def then(self, more: Steps) -> Steps:
        """These steps followed by those in `more`, as one object."""
        t, y, yp, inner = (np.concatenate(both) for both in zip(self[:-1], more[:-1], strict=True))
        return Steps(t, y, yp, inner, more.code)


#: function that opens the library and states the types of the functions of explicit.c for ctypes
_functions = declared(
    ("explicit_steps", ctypes.c_int, (Pointer, *[Number] * 4, Whole, *[Pointer] * 5)),
    ("explicit_begin", ctypes.c_int, (Pointer, Number, Number)), ("explicit_batch", ctypes.c_int, (Pointer, Pointer, Number)),
)


class Runs(ctypes.Structure):
    """The C struct `Batch` of explicit.c, with the same members in the same order."""

    _fields_ = (*((name, Whole) for name in ("points", "width", "outputs", "point", "begun", "taken")),
                *((name, Number) for name in ("from_", "end", "t")),
                *((name, Pointer) for name in ("starts", "numbers", "times", "slots", "W", "out", "last")),
                *((name, Pointer) for name in ("code", "steps", "rejected", "evaluations")))


class Explicit(Stepping):
    """An integration by an explicit method; nodes: fractions of a step at which dense output is stored. rtol, atol (n,):
    tolerances."""

    def __init__(self, equations: Equations, method: Method, nodes: Array, rtol: float, atol: Array) -> None:
        n = int(equations.table.n)
        if not equations.table.rates or atol.shape != (n,):
            raise internal(f"DOP853 in C needs y' as a function and {n} absolute tolerances, one per unknown; the shape of those "
                           f"it was given is {atol.shape}")
        super().__init__(equations)
        self.n = n
        self._K, self._y, self._next, self._F = np.zeros((ALL, n)), np.zeros(n), np.zeros(n), np.zeros((ORDER + 1, n))
        self._kept = method, np.array(nodes, dtype=float), np.array(atol, dtype=float)
        self.table = CExplicit(
            equations.address, method.stages, method.errors, method.dense, method.c, *map(address, self._kept[1:]),
            len(nodes), rtol, 0.0, np.inf, Stretches(), *map(address, (self._K, self._y, self._next, self._F)), 0, 0,
            0)
        self.inner, self._at = len(nodes), ctypes.addressof(self.table)

    def fits(self, rtol: float, atol: Array) -> bool:
        """Whether it was made for these tolerances."""
        return bool(self.table.rtol == rtol) and self._kept[2].tolist() == atol.tolist()

    def anew(self) -> Self:
        """The same method, without bounds and steps of an earlier part of a run."""
        self.table.stretches, self.table.h, self.table.after_rejection = Stretches(), 0.0, 0
        return self

    def begin(self, y: Array, rate: Array, h: float) -> None:
        """Start from y (n,) with slope rate (n,) and a first step of h (s)."""
        self._y[:], self._K[0], self.table.h, self.table.after_rejection = y, rate, h, 0

    def start(self, t: float, y: Array, span: float, h: float | None = None) -> int:
        """Start from y (n,) at t; returns a code, 0 for success. h: first step (s); None: it is estimated from two evaluations
        of y', at most `span` (s)."""
        self._y[:] = y
        code = self.native(_functions().explicit_begin, self._at, t, span)
        if h is not None:
            self.table.h = h
        return code

    def advance(self, t: float, end: float, most: float, rows: int, longest: float = np.inf) -> Steps:
        """Make steps from t towards end, each no longer than `longest` (s); stop after `rows` steps, `most` evaluations of y', or
        SLICE seconds of wall time."""
        times, y, yp = np.empty(rows), np.empty((rows, self.n)), np.empty((rows, self.n))
        inner, made = np.empty((rows, self.inner, self.n)), Whole()
        self.table.longest = longest
        arrays = map(address, (times, y, yp, inner))
        code = self.native(_functions().explicit_steps, self._at, t, end, self.table.evaluations + most, SLICE, rows, *arrays,
                           ctypes.addressof(made))
        m = made.value
        return Steps(times[:m], y[:m], yp[:m], inner[:m], code)

    def go_on(self, batch: Batch) -> None:
        """Continue the runs of a batch for SLICE seconds of wall time; `Batch.done` counts those that have ended."""
        if batch.n != self.n:
            raise internal(f"the starts of a batch have {batch.n} unknowns, its equations {self.n}")
        self.table.longest = np.inf
        self.native(_functions().explicit_batch, self._at, ctypes.addressof(batch.table), SLICE)





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


_paths = declared(
    ("twins_value", ctypes.c_int, (Pointer, Whole, Number, Pointer, Pointer)),
    ("twins_along", ctypes.c_int, (Pointer, Whole, Pointer, Pointer)),
    ("twins_back", ctypes.c_int, (Pointer, Whole, Pointer, Pointer)),
    ("twins_states", ctypes.c_int, (Pointer, Whole, Whole, *[Pointer] * 5)), ("twins_run", ctypes.c_int, (Pointer, Pointer)),
    ("explicit_along", ctypes.c_int, (Pointer, Whole, *[Pointer] * 5)),
    ("explicit_back", ctypes.c_int, (Pointer, Whole, *[Pointer] * 6)),
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

    def by(self, seeds: list[tuple[Whole64, Array]], fixed: Any) -> None:
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
        _paths().twins_run(self.address, ctypes.byref(self._parts[name]))

    def states(self, t: Array, y: Array, yp: Array, weights: Array | None = None) -> Array:
        """At k states, t (k,), y and yp (k, n): the changes (k, count, P) by the numbers; with weights (k, count) of the results
        the weights (k, n) of y, while those of the inputs are added up."""
        t, y, yp = (np.ascontiguousarray(x, dtype=float) for x in (t, y, yp))
        given = None if weights is None else np.ascontiguousarray(weights, dtype=float)
        out = np.empty((len(t), self.count, self.table.columns) if given is None else (len(t), self.n))
        if _paths().twins_states(self.address, 0, len(t), t.ctypes.data, y.ctypes.data, yp.ctypes.data,
                                     None if given is None else given.ctypes.data, out.ctypes.data):
            raise FloatingPointError
        return out

    @property
    def twin(self) -> TwinTable:
        """The table by which steps of a method call these derivatives."""
        found = _paths()
        return TwinTable(self.address, self.n, self.table.columns, *(ctypes.cast(getattr(found, f"twins_{name}"), Pointer).value
                                                                     for name in ("value", "along", "back")))


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
        code = _paths().explicit_along(ctypes.addressof(self.table), m, t.ctypes.data, y.ctypes.data, reached.ctypes.data,
                                           out.ctypes.data, inner.ctypes.data)
        return int(code), reached, out, inner

    def back(self, t: Array, y: Array, ends: Array, inner: Array, total: Array) -> tuple[int, Array]:
        """A code and the ends of the repeated steps; total (n,), weights of y at the end, becomes those at the beginning. ends
        (m, n): weights of y at the beginnings of the steps; inner (m, inner, n): of the increments."""
        m, reached = len(t) - 1, np.zeros((len(t) - 1, self.n))
        given = [np.ascontiguousarray(x) for x in (t, y, ends, inner)]
        t, y, ends, inner = given
        code = _paths().explicit_back(ctypes.addressof(self.table), m, t.ctypes.data, y.ctypes.data, reached.ctypes.data,
                                          ends.ctypes.data, inner.ctypes.data, total.ctypes.data)
        return int(code), reached
