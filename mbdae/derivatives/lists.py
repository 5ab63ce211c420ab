"""Tangent and pullback of the operations of a scene's residual F(t, y, y') = 0, by EVERY number in them.

F is a list of operations on one array W (`native/program.py`). What it depends on is y and y', the numbers of laws and other
constants in slots of W, the values that the clock prescribes, and the data of the operations themselves: constant terms of LOAD
and weights of ADD, such as constant masses. All of these are inputs here, in one order: slots first, then data. The tangent (J v)
and the pullback (J^T w) are again lists of operations on the same array, made from the list alone, so that they hold for every
law, element and form; of a kernel they take the kernels `tangent` and `pullback`, which are derived from its expressions.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from mbdae.errors import internal
from mbdae.native.program import ADD, CALL, LOAD, MULTIPLY, SET, Operations, Step, block, core
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.base import Array
from mbdae.system.motion.constrained import Index


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
    each, none = np.arange(times)[:, None], np.zeros(0, dtype=np.int64)

    def slots(name: str) -> Index:
        shift = each * fields.get(f"{name.rstrip('_')}_step", 0)
        return np.asarray(tables[name][None] + shift).ravel() if name in tables else none

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


class Lists:
    """The residual of an assembly with its tangent and pullback. inputs: slots of W, then data (`data_of`), as one vector.

    Its evaluation is its own: nothing of the run's equations is changed."""

    def __init__(self, assembly: Assembly) -> None:
        self.assembly, self.n, self.ev = assembly, assembly.n, assembly.operations()
        self._of = self.ev.residual_part
        operations = self.ev.operations
        self.width = operations.size  #: number of slots; the differential of a slot is this many further on
        operations.slots(self.width + 1)
        self._zero = operations.size - 1
        self._data = {i: (operations.slots(values.size), values.size) for i, values in data_of(self._of)}
        self.inputs = self.width + sum(size for _, size in self._data.values())
        self._first = self.ev.rows
        self.tangent, self.pullback = operations.part(), operations.part()
        self._checked()
        for i, step in enumerate(self._of.steps):
            self._along(i, step)
        for i, step in reversed(list(enumerate(self._of.steps))):
            self._back(i, step)
        self.ev.compile()
        self._parts = {name: self._runner(part) for name, part in (("tangent", self.tangent), ("pullback", self.pullback))}
        assembly.__dict__["evaluation"] = self.ev  # its Jacobian is evaluated on the same array

    def _checked(self) -> None:
        """Tangent and pullback read the slots that the list has read again: none may be written to afterwards."""
        read = np.zeros(self.width, dtype=bool)
        for step in self._of.steps:
            fields, kind = step.fields, step.fields["kind"]
            if kind in (SET, ADD, MULTIPLY):
                w = written_out(step)
                to, used = w.to, np.concatenate([w.by, w.from_ if kind != SET else w.by])
            elif kind in (CALL, LOAD):
                count = fields["times"] * fields["outputs"] if kind == CALL else fields["count"]
                to, used = fields["first"] + np.arange(count), step.tables.get("from_", np.zeros(0, dtype=np.int64)).ravel()
            else:
                raise internal(f"the derivative of the compiled equations is not known for their operation number {kind}")
            if read[to].any():
                raise internal("the compiled equations write to a place that they have read before: its value is lost for their "
                               "derivative")
            read[used] = True

    def _along(self, i: int, step: Step) -> None:
        part, by, fields, kind = self.tangent, self.width, step.fields, step.fields["kind"]
        if kind == CALL:
            slots = step.tables["from_"]
            part.call(fields["kernel"].tangent, np.hstack([slots, slots + by]), fields["first"] + by)
        elif kind == LOAD:
            count = fields["count"]
            part.set(fields["first"] + by + np.arange(count), self._data[i][0] + np.arange(count) if i in self._data else
                     np.full(count, self._zero))
        else:
            w = written_out(step)
            if kind == SET:
                part.set(w.to + by, w.from_ + by)
            elif kind == ADD:
                part.add(w.to + by, w.from_ + by, w.weight)
                part.multiply(w.to + by, w.from_, self._data[i][0] + w.place)
            else:
                part.multiply(w.to + by, w.from_ + by, w.by, w.weight)
                part.multiply(w.to + by, w.from_, w.by + by, w.weight)

    def _back(self, i: int, step: Step) -> None:
        part, by, fields, kind = self.pullback, self.width, step.fields, step.fields["kind"]
        if kind == CALL:
            slots, width, first = step.tables["from_"], fields["kernel"].width, fields["first"] + by
            found = part.call(fields["kernel"].pullback, np.hstack([slots, block(first, len(slots), width)]))
            part.load(first, np.zeros(len(slots) * width))
            part.add((slots + by).ravel(), found.ravel())
        elif kind == LOAD:
            at = fields["first"] + by + np.arange(fields["count"])
            if i in self._data:
                part.add(self._data[i][0] + np.arange(fields["count"]), at)
            part.load(fields["first"] + by, np.zeros(fields["count"]))
        else:
            w = written_out(step)
            if kind == SET:
                kept = self.ev.operations.slots(len(w.to)) + np.arange(len(w.to))
                part.set(kept, w.to + by)
                part.set(w.to + by, np.full(len(w.to), self._zero))
                part.add(w.from_ + by, kept)
            elif kind == ADD:
                part.add(w.from_ + by, w.to + by, w.weight)
                part.multiply(self._data[i][0] + w.place, w.to + by, w.from_)
            else:
                part.multiply(w.from_ + by, w.to + by, w.by, w.weight)
                part.multiply(w.by + by, w.to + by, w.from_, w.weight)

    # -- evaluation

    def _runner(self, part: Operations) -> Callable[[float, Array, Array], int]:
        """A function (t, y (n,), y' (n,)) that fills in a state and runs operations of these lists."""
        ev, (table, kept) = self.ev, part.table(len(self.ev.W))
        ev._kept.append((table, kept))
        if part.widest > len(ev._x):
            ev._x = np.zeros(part.widest)
            ev.scene.x = ev._x.ctypes.data
        run, own = core().scene_part, ctypes.byref(table)
        return lambda t, y, yp: int(run(ev.address, own, t, y.ctypes.data, yp.ctypes.data))

    def residual(self, t: float, y: Array, yp: Array) -> Array:
        """F (n,) at a state, which `along` and `back` refer to afterwards."""
        out = np.empty(self.n)
        self._at = t, np.ascontiguousarray(y, dtype=float), np.ascontiguousarray(yp, dtype=float)
        self.ev.residual(*self._at, out)
        return out

    def jacobian(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        """dF/dy and dF/dy' (n, n)."""
        fy, fyp = self.assembly.dense_stages(np.array([t]), y[None], yp[None])
        return fy[0], fyp[0]

    def along(self, changes: Array) -> Array:
        """(k, n) changes of F for changes (k, inputs) of the inputs, at the state evaluated last."""
        return self._run("tangent", np.atleast_2d(changes), self._inputs, self.width + self._first + np.arange(self.n))

    def back(self, weights: Array) -> Array:
        """(k, inputs) weights of the inputs for weights (k, n) of F, at the state evaluated last."""
        return self._run("pullback", np.atleast_2d(weights), self.width + self._first + np.arange(self.n), self._inputs)

    @property
    def _inputs(self) -> Index:
        data = [np.arange(first, first + size) for first, size in self._data.values()]
        return np.concatenate([self.width + np.arange(self.width), *data])

    def _run(self, name: str, given: Array, to: Index, from_: Index) -> Array:
        W, out = self.ev.W, np.empty((len(given), len(from_)))
        for row, found in zip(given, out, strict=True):
            W[self.width : 2 * self.width] = 0.0
            for first, size in self._data.values():
                W[first : first + size] = 0.0
            W[to] = row
            self._parts[name](*self._at)
            found[:] = W[from_]
        return out

