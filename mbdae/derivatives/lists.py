"""Tangent and pullback of lists of operations, by EVERY number in them: of F(t, y, y'), or of y' = f(t, y).

A list of operations works on one array W (`native/program.py`). What its results depend on is y and y', the numbers of laws and
other constants in slots of W, the values that the clock prescribes, and the data of the operations themselves: constant terms of
LOAD and weights of ADD, such as constant masses. All of these are inputs here, in one order: slots first, then data. The tangent
(J v) and the pullback (J^T w) are again lists of operations on the same array, made from the list alone, so that they hold for
every law, element and form; of a kernel they take the kernels `tangent` and `pullback`, which are derived from its expressions.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from mbdae.errors import internal
from mbdae.native.explicit import Twins
from mbdae.native.program import ADD, CALL, CHOLESKY, LOAD, LU, MULTIPLY, PASS, POSITIVE, SET, SOLVE, Operations, Scene, Step
from mbdae.native.program import block as block
from mbdae.native.program import core as core
from mbdae.system.base import Array
from mbdae.system.motion.constrained import Index, Workspace

NONE = np.zeros(0, dtype=np.int64)


class Written(NamedTuple):
    """SET, ADD or MULTIPLY with its repetitions written out: slots to which numbers go, from which they come, by which they are
    multiplied; weights, and the place of each among those of the operation."""

    to: Index
    from_: Index
    by: Index
    weight: Array
    place: Index


def written_out(step: Step) -> Written:
    """An operation SET, ADD or MULTIPLY without repetitions."""
    fields, tables = step.fields, step.tables
    times, count = fields["times"], len(tables["from_"])
    each = np.arange(times)[:, None]

    def slots(name: str) -> Index:
        shift = each * fields.get(f"{name.rstrip('_')}_step", 0)
        return np.asarray(tables[name][None] + shift).ravel() if name in tables else NONE

    place = (np.arange(count)[None] + each * fields.get("weight_step", 0)).ravel()
    weight = tables["weight"][place] if "weight" in tables else np.ones(times * count)
    return Written(slots("to"), slots("from_"), slots("by"), weight, place)


def data_of(of: Operations) -> Iterator[tuple[int, Array]]:
    """The data of a list of operations: number of every LOAD and ADD, and its numbers."""
    for i, step in enumerate(of.steps):
        if step.fields["kind"] in (LOAD, ADD) and step.tables["weight"].size:
            yield i, np.asarray(step.tables["weight"], dtype=float)


def structure_of(of: Operations) -> list[Any]:
    """What two lists of operations have in common if they differ in their data alone."""
    found = []
    for step in of.steps:
        kernel = step.fields.get("kernel")
        own = None if kernel is None else kernel.key or (tuple(kernel.symbols), tuple(kernel.expressions))
        tables = [(name, table.shape, None if name == "weight" else table.tobytes()) for name, table in step.tables.items()]
        found.append(({name: value for name, value in step.fields.items() if name != "kernel"}, own, tables))
    return found


class Listed(NamedTuple):
    """A list of operations with `width` results in the slots from `first` on. of: the workspace to which it belongs; n: number of
    unknowns y, the first slots of W."""

    of: Workspace
    part: Operations
    first: int
    width: int
    n: int

    @classmethod
    def with_matrices(cls, of: Workspace, part: Operations, first: int, width: int, n: int) -> Listed:
        """The list with a copy of every matrix before LU overwrites it, because derivatives read it again."""
        kept = part.part()
        for step in part.steps:
            if step.fields["kind"] == LU:
                cells = np.arange(step.fields["count"] ** 2)
                kept.set(kept.slots(len(cells)) + cells, step.fields["first"] + cells)
            kept.steps.append(step)
        return cls(of, kept, first, width, n)

    def inputs(self) -> Array:
        """The numbers in all slots, and the data, in the order of `Lists`."""
        W, nb = np.zeros(self.of.operations.size), self.of.numbering
        W[: nb.width] = nb.workspace()
        self.of.operations.fill(W)
        return np.concatenate([W, *(values for _, values in data_of(self.part))])


class Lists:
    """A list with its tangent and pullback, on an array of their own. active (inputs,): which data may have derivatives, None:
    all.

    inputs: slots of W, then data (`data_of`), as one vector; width: number of slots, the differential of a slot is this many
    further on; places (inputs,): slot of the differential of every input, -1 for data that are not active."""

    def __init__(self, listed: Listed, active: Any = None) -> None:
        self.listed, operations = listed, listed.of.operations
        self.width, self.n = operations.size, listed.n
        self._zero = self.width + operations.slots(self.width + 1)
        given = self.width
        places = [self.width + np.arange(self.width)]
        self._data: dict[int, Index] = {}
        for i, values in data_of(listed.part):
            kept = np.ones(values.size, bool) if active is None else active[given : given + values.size]
            given += values.size
            slots = np.full(values.size, -1)
            slots[kept] = operations.slots(int(kept.sum())) + np.arange(kept.sum())
            self._data[i] = slots
            places.append(slots)
        self.places, self.inputs = np.concatenate(places), given
        self.tangent, self.pullback = operations.part(), operations.part()
        self._checked()
        for i, step in enumerate(listed.part.steps):
            self._along(i, step)
        for i, step in reversed(list(enumerate(listed.part.steps))):
            self._back(i, step)
        self._made()

    def _checked(self) -> None:
        """Tangent and pullback read the slots that the list has read again: none may be written to afterwards."""
        read = np.zeros(self.width, dtype=bool)
        for step in self.listed.part.steps:
            fields, kind = step.fields, step.fields["kind"]
            to: Any = NONE
            used: Any = NONE
            if kind == PASS:  # instance by instance: each reads what those before it have added up
                for r, (from_, sums) in enumerate(zip(step.tables["from_"], step.tables["to"], strict=True)):
                    written = np.r_[sums, fields["first"] + r * fields["outputs"] + np.arange(fields["outputs"])]
                    self._unread(read, written)
                    read[from_] = True
                continue
            if kind in (SET, ADD, MULTIPLY):
                w = written_out(step)
                to, used = w.to, np.concatenate([w.by, w.from_ if kind != SET else w.by])
            elif kind in (CALL, LOAD):
                count = fields["times"] * fields["outputs"] if kind == CALL else fields["count"]
                to, used = fields["first"] + np.arange(count), step.tables.get("from_", NONE).ravel()
            elif kind in (CHOLESKY, SOLVE, LU):
                to = fields["outputs"] + np.arange(fields["times"] * fields["count"])
            elif kind != POSITIVE:
                raise internal(f"the derivative of the compiled equations is not known for their operation number {kind}")
            self._unread(read, to)
            read[used] = True

    @staticmethod
    def _unread(read: Any, to: Any) -> None:
        if read[to].any():
            raise internal("the compiled equations write to a place that they have read before: its value is lost for their "
                           "derivative")

    @property
    def fixed(self) -> Any:
        """(count,) whether the derivatives of a result are constants: kinematics of coordinates that are rates."""
        varying, nb = np.zeros(self.width, dtype=bool), self.listed.of.numbering
        varying[nb.first_input : nb.first_input + len(nb.clock.expressions)] = True
        for i, step in enumerate(self.listed.part.steps):
            f, kind = step.fields, step.fields["kind"]
            if kind in (CALL, PASS, CHOLESKY, SOLVE, LU):
                first, count = (f["first"], f["outputs"]) if kind in (CALL, PASS) else (f["outputs"], f["count"])
                varying[first : first + f["times"] * count] = True
                varying[step.tables.get("to", NONE)] = True
            elif kind == LOAD:
                varying[f["first"] : f["first"] + f["count"]] = False
            elif kind != POSITIVE:
                w = written_out(step)
                other = kind == MULTIPLY or (kind == ADD and self._data[i][w.place] >= 0)
                for to, from_, product in zip(w.to, w.from_, np.broadcast_to(other, len(w.to)), strict=True):
                    varying[to] = varying[from_] | product | (varying[to] and kind != SET)
        return ~varying[self.listed.first : self.listed.first + self.listed.width]

    # -- the tangent

    def _along(self, i: int, step: Step) -> None:
        part, by, fields, kind = self.tangent, self.width, step.fields, step.fields["kind"]
        if kind == CALL:
            slots = step.tables["from_"]
            part.call(fields["kernel"].tangent, np.hstack([slots, slots + by]), fields["first"] + by)
        elif kind == PASS:
            slots, sums = step.tables["from_"], step.tables["to"]
            part.hand_on(fields["kernel"].tangent, np.hstack([slots, slots + by]), sums + by, fields["first"] + by)
        elif kind == LOAD:
            data = self._data.get(i, np.full(fields["count"], -1))
            part.set(fields["first"] + by + np.arange(fields["count"]), np.where(data >= 0, data, self._zero))
        elif kind in (SET, ADD, MULTIPLY):
            w = written_out(step)
            if kind == SET:
                part.set(w.to + by, w.from_ + by)
            elif kind == ADD:
                part.add(w.to + by, w.from_ + by, w.weight)
                data = self._data[i][w.place]
                part.multiply(w.to[data >= 0] + by, w.from_[data >= 0], data[data >= 0])
            else:
                part.multiply(w.to + by, w.from_ + by, w.by, w.weight)
                part.multiply(w.to + by, w.from_, w.by + by, w.weight)
        elif kind != POSITIVE:
            self._along_solution(i, step)

    def _along_solution(self, i: int, step: Step) -> None:
        """M dx = db - dM x."""
        part, by, f = self.tangent, self.width, step.fields
        for right in f["outputs"] + f["count"] * np.arange(f["times"]):
            cell, row, column = entries(step)
            part.multiply(right + row + by, cell + by, right + column, -1.0)
            self._solved(part, i, step, right + by)

    def _solved(self, part: Operations, i: int, step: Step, right: int, transposed: bool = False) -> None:
        f, n = step.fields, step.fields["count"]
        if f["kind"] != LU:
            part.solve(n, f["inputs"], f["first"], right, 1)
            return
        at, cells = part.slots(n * n), np.arange(n * n).reshape(n, n)
        kept = self.listed.part.steps[i - 1].tables["to"]
        part.set(at + cells.ravel(), kept[(cells.T if transposed else cells).ravel()])
        part.lu(n, at, right)

    # -- the pullback

    def _back(self, i: int, step: Step) -> None:
        part, by, fields, kind = self.pullback, self.width, step.fields, step.fields["kind"]
        if kind == CALL:
            own = step.tables["from_"] - fields["first"]
            if not np.any((own >= 0) & (own < fields["times"] * fields["outputs"])):
                self._back_call(part, step, slice(None), fields["first"] + by)
                return
            for r in reversed(range(fields["times"])):  # instances that read results of those before them
                self._back_call(part, step, slice(r, r + 1), fields["first"] + by + r * fields["outputs"])
        elif kind == PASS:
            sums = step.tables["to"]
            for r in reversed(range(len(sums))):
                first = fields["first"] + by + r * fields["outputs"]
                part.add(first + np.arange(sums.shape[1]), sums[r] + by)
                self._back_call(part, step, slice(r, r + 1), first)
        elif kind == LOAD:
            at, data = fields["first"] + by + np.arange(fields["count"]), self._data.get(i, np.full(fields["count"], -1))
            part.add(data[data >= 0], at[data >= 0])
            part.load(fields["first"] + by, np.zeros(fields["count"]))
        elif kind in (SET, ADD, MULTIPLY):
            self._back_map(i, step)
        elif kind != POSITIVE:  # b' = M^-T x', and M' = -b' x^T
            for right in fields["outputs"] + fields["count"] * np.arange(fields["times"]):
                self._solved(part, i, step, right + by, transposed=True)
                cell, row, column = entries(step)
                part.multiply(cell + by, right + row + by, right + column, -1.0)

    def _back_call(self, part: Operations, step: Step, some: slice, first: int) -> None:
        slots, kernel = step.tables["from_"][some], step.fields["kernel"]
        found = part.call(kernel.pullback, np.hstack([slots, block(first, len(slots), kernel.width)]))
        part.load(first, np.zeros(len(slots) * kernel.width))
        part.add((slots + self.width).ravel(), found.ravel())

    def _back_map(self, i: int, step: Step) -> None:
        part, by, kind, w = self.pullback, self.width, step.fields["kind"], written_out(step)
        if kind == SET:
            kept = part.slots(len(w.to)) + np.arange(len(w.to))
            part.set(kept, w.to + by)
            part.set(w.to + by, np.full(len(w.to), self._zero))
            part.add(w.from_ + by, kept)
        elif kind == ADD:
            part.add(w.from_ + by, w.to + by, w.weight)
            data = self._data[i][w.place]
            part.multiply(data[data >= 0], w.to[data >= 0] + by, w.from_[data >= 0])
        else:
            part.multiply(w.from_ + by, w.to + by, w.by, w.weight)
            part.multiply(w.by + by, w.to + by, w.from_, w.weight)

    # -- evaluation

    def _made(self) -> None:
        of, operations = self.listed.of, self.listed.of.operations
        self.W, nb = np.zeros(operations.size), of.numbering
        self.W[: nb.width] = nb.workspace()
        operations.fill(self.W)
        parts = {"clock": of.clock, "value": self.listed.part, "along": self.tangent, "back": self.pullback}
        tables = {name: part.table(len(self.W)) for name, part in parts.items()}
        self._x = np.zeros(max(part.widest for part in parts.values()) + 1)
        self._kept = tables, nb.model.conditions.read
        self.scene = Scene(W=self.W.ctypes.data, x=self._x.ctypes.data, n=self.n, dotted=of.n, at=of.at, bad=-1,
                           rows=self.listed.first, read=self._kept[1].ctypes.data, t=np.nan, side=np.nan,
                           clock=tables["clock"][0])
        self.twins = Twins(self.scene, {name: table for name, (table, _) in tables.items()}, self.W, self.listed.first,
                           self.listed.width, self.width, nb.first_input, len(nb.clock.expressions))

    def value(self, t: float, y: Array, yp: Array) -> Array:
        """The results (count,) at a state, to which `along` and `back` refer afterwards."""
        y, yp = (np.ascontiguousarray(x, dtype=float) for x in (y, yp))
        code = core().scene_part(ctypes.addressof(self.scene), ctypes.byref(self.twins.table.value), t, y.ctypes.data,
                                 yp.ctypes.data)
        if code:
            raise FloatingPointError
        return np.array(self.W[self.listed.first : self.listed.first + self.listed.width])

    def along(self, changes: Array) -> Array:
        """(k, count) changes of the results for changes (k, inputs) of the inputs, at the state evaluated last."""
        return self._run("along", np.atleast_2d(changes), self.places, self._results)

    def back(self, weights: Array) -> Array:
        """(k, inputs) weights of the inputs for weights (k, count) of the results, at the state evaluated last."""
        return self._run("back", np.atleast_2d(weights), self._results, self.places)

    @property
    def _results(self) -> Index:
        return self.width + self.listed.first + np.arange(self.listed.width)

    def _run(self, name: str, given: Array, to: Index, from_: Index) -> Array:
        out, own = np.empty((len(given), len(from_))), self.W[self.width :]
        kept = own.copy()
        for row, found in zip(given, out, strict=True):
            own[: self.width + 1] = 0.0
            self.W[self.places[self.places >= 0]] = 0.0
            self.W[to[to >= 0]] = row[to >= 0]
            self.twins.run(name)
            found[:] = np.where(from_ >= 0, self.W[from_], 0.0)
        own[:] = kept
        return out


def entries(step: Step) -> tuple[Index, Index, Index]:
    """Slots of the entries of the matrix of CHOLESKY, SOLVE or LU, with their rows and columns; of a band, which holds one half
    of a symmetric matrix, those beside the diagonal twice."""
    f, n = step.fields, step.fields["count"]
    width = n if f["kind"] == LU else f["inputs"]
    row, k = np.divmod(np.arange(n * width), width)
    column = k if f["kind"] == LU else row + k - width + 1
    cell, row, column = (x[column >= 0] for x in (f["first"] + np.arange(n * width), row, column))
    if f["kind"] == LU:
        return cell, row, column
    beside = row != column
    return np.r_[cell, cell[beside]], np.r_[row, column[beside]], np.r_[column, row[beside]]
