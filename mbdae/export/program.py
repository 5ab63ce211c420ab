"""Data of an export: named functions of named vectors, each a list of operations on one array of numbers.

The operations are those that run natively (`mbdae.native.program`), read as tables; for every function only those are kept on
which its outputs depend.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.native.program import CALL, CHOLESKY, LOAD, LOOKUP, LU, POSITIVE, READ, SET, Operations, Scene, Step, core
from mbdae.symbolic.rebuild import symbols_of

Index = NDArray[np.int64]
Array = NDArray[np.float64]


class Entry(NamedTuple):
    """One entry of an input or output vector: its name, unit and value, NaN where it has none."""

    name: str
    unit: str
    value: float = float("nan")


@dataclass(frozen=True)
class Function:
    """An exported function as operations on one work array, whose places are called slots.

    outputs: entries; at: their slots; arguments: names of the input vectors; steps: operations, those that call a kernel with a
    field `used` (numbers of the kernel's values that matter); reads: slots whose initial numbers outputs depend on."""

    name: str
    meaning: str
    arguments: tuple[str, ...]
    outputs: tuple[Entry, ...]
    at: Index
    steps: tuple[Step, ...]
    reads: frozenset[int]


@dataclass
class Program:
    """All exported functions of a scene or a law.

    title: what is exported; inputs: entries of the vectors by name ("t", "y", "yp", "p", "signals", of a law "x" and "p"); slots:
    pairs (entry, slot) by vector, where inputs are written; numbers: initial values of the work array, followed by zeros;
    pattern: rows and columns of the entries of the Jacobian; missing: {function that cannot be given: reason}."""

    title: str
    operations: Operations
    inputs: dict[str, tuple[Entry, ...]]
    slots: dict[str, Any]
    numbers: Array = field(default_factory=lambda: np.zeros(0))
    pattern: tuple[Index, Index] | None = None
    functions: dict[str, Function] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.slots = {name: np.array(pairs, dtype=np.int64).reshape(-1, 2) for name, pairs in self.slots.items()}

    def add(self, name: str, meaning: str, arguments: Sequence[str], outputs: Sequence[Entry], at: Any,
            part: Operations) -> None:  # fmt: skip
        """Add a function. at: slots of its outputs; part: operations that compute them, of which those without influence on the
        outputs are left out. Signals, where there are any, are an argument of every function."""
        arguments = [*arguments, *(["signals"] if "signals" in self.inputs else [])]
        at, W = np.asarray(at, dtype=np.int64), filled(self.operations, self.numbers)
        steps, live = _needed(part.steps, at, len(W))
        for vector in arguments:
            W[self.slots[vector][:, 1]] = 0.0  # these slots are inputs, not constants
        fixed, begin = np.flatnonzero(live & (W != 0)), self.operations.part()
        for run in np.split(fixed, np.flatnonzero(np.diff(fixed) > 1) + 1):
            if len(run):
                begin.load(int(run[0]), W[run])
        self.functions[name] = Function(name, meaning, tuple(arguments), tuple(outputs), at, (*begin.steps, *steps),
                                        frozenset(np.flatnonzero(live).tolist()))  # fmt: skip

    def given(self, vectors: Mapping[str, Any]) -> Array:
        """The array with the values of the inputs in their slots."""
        W = np.zeros(self.operations.size)
        for name, values in vectors.items():
            entries, slots = self.slots[name].T
            W[slots] = np.asarray(values, dtype=float)[entries]
        return W

    def drop_parameters(self) -> None:
        """Remove from the input vector "p" the parameters that no function reads."""
        read = frozenset[int]().union(*(f.reads for f in self.functions.values()))
        pairs = self.slots["p"]
        kept = sorted({int(entry) for entry, slot in pairs if int(slot) in read})
        number = {entry: n for n, entry in enumerate(kept)}
        self.inputs["p"] = tuple(self.inputs["p"][entry] for entry in kept)
        self.slots["p"] = np.array([(number[e], s) for e, s in pairs.tolist() if e in number], dtype=np.int64).reshape(-1, 2)


def filled(operations: Operations, numbers: Array) -> Array:
    """The work array with its initial values, before any operation."""
    W = np.zeros(operations.size)
    W[: len(numbers)] = numbers
    operations.fill(W)
    return W


def reach(step: Step, name: str) -> Index:
    """Slots (times, count) that a table of an operation, "to", "from_" or "by", addresses in all of its instances."""
    table = np.asarray(step.tables[name], dtype=np.int64)
    return np.asarray(table + step.fields.get(f"{name.rstrip('_')}_step", 0) * np.arange(step.fields["times"])[:, None])


def shifted(step: Step, by: int) -> Step:
    """The operation on slots that are `by` places higher."""
    slots = {CHOLESKY: ("first", "outputs"), LU: ("first", "outputs"), LOOKUP: ("first", "inputs", "outputs")}.get(
        step.fields["kind"], ("first",))  # fmt: skip
    fields = {name: value + by if name in slots else value for name, value in step.fields.items()}
    tables = {name: table + by * (name != "weight") for name, table in step.tables.items()}
    return Step(fields, tables, (step.slots[0] + by, step.slots[1] + by))


def weights(step: Step) -> Array:
    """Factors of an operation, (times or 1, count); 1 where it has none."""
    return np.asarray(step.tables.get("weight", np.ones(step.fields["count"])), dtype=float).reshape(-1, step.fields["count"])


def run(steps: Sequence[Step], W: Array) -> None:
    """Execute operations natively on W, in place."""
    part = Operations(len(W))
    part.steps += steps
    (table, _kept), x = part.table(len(W)), np.zeros(part.widest + 1)
    core().scene_part(ctypes.byref(Scene(W=W.ctypes.data, x=x.ctypes.data)), ctypes.byref(table), 0.0, None, None)


def _needed(steps: Sequence[Step], outputs: Index, size: int) -> tuple[list[Step], NDArray[np.bool_]]:
    """Operations (and kernel values) on which the output slots depend, and the slots whose initial numbers they need."""
    live = np.zeros(size, dtype=bool)
    live[outputs] = True
    found = [_USED.get(step.fields["kind"], _of_slots)(step, live) for step in reversed(steps)]
    return [step for step in reversed(found) if step is not None], live


def _of_call(step: Step, live: NDArray[np.bool_]) -> Step | None:
    f, kernel = step.fields, step.fields["kernel"]
    values = slice(f["first"], f["first"] + f["times"] * f["outputs"])
    used = tuple(np.flatnonzero(live[values].reshape(f["times"], f["outputs"]).any(axis=0)).tolist())
    live[values] = False
    if not used:
        return None
    symbols = symbols_of(kernel.expressions[o] for o in used)
    columns = [j for j, s in enumerate(kernel.symbols) if s in symbols]
    live[step.tables["from_"].reshape(f["times"], f["inputs"])[:, columns]] = True
    return step._replace(fields=f | {"used": used})


def _of_load(step: Step, live: NDArray[np.bool_]) -> Step | None:
    place = slice(step.fields["first"], step.fields["first"] + step.fields["count"])
    needed = bool(live[place].any())
    live[place] = False
    return step if needed else None


def _of_slots(step: Step, live: NDArray[np.bool_]) -> Step | None:
    """An operation that copies, adds or multiplies slots, without the entries of which no instance is needed (`live`); None where
    none is left."""
    to = reach(step, "to")
    kept = live[to].any(axis=0)
    if not kept.any():
        return None
    if step.fields["kind"] == SET:
        live[to[:, kept]] = False
    tables = {name: table[kept] for name, table in step.tables.items() if name != "weight"}
    fields = step.fields | {"count": int(kept.sum())}
    if "weight" in step.tables:
        tables["weight"] = weights(step)[:, kept].ravel()
        fields["weight_step"] = fields["count"] if step.fields["weight_step"] else 0
    found = step._replace(fields=fields, tables=tables)
    for name in tables.keys() & {"from_", "by"}:
        live[reach(found, name)] = True
    return found


def _of_solve(step: Step, live: NDArray[np.bool_]) -> Step | None:
    f, n = step.fields, step.fields["count"]
    right = slice(f["outputs"], f["outputs"] + n * f["times"])
    if not live[right].any():
        return None
    live[right] = live[f["first"] : f["first"] + n * (n if f["kind"] == LU else f["inputs"])] = True
    return step


def _of_lookup(step: Step, live: NDArray[np.bool_]) -> Step | None:
    f = step.fields
    values = slice(f["first"], f["first"] + READ)
    if not live[values].any():
        return None
    live[values] = False
    live[[f["inputs"], f["outputs"], *range(f["first"] + READ, f["first"] + READ + 3)]] = True
    return step


def _of_check(step: Step, live: NDArray[np.bool_]) -> Step:
    live[reach(step, "from_")] = True
    return step


_USED = {CALL: _of_call, LOAD: _of_load, POSITIVE: _of_check, CHOLESKY: _of_solve, LU: _of_solve,
         LOOKUP: _of_lookup}  # fmt: skip
