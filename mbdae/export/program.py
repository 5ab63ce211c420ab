"""What is exported: named functions of named vectors, each a list of operations on one array of numbers.

The operations are those that run natively (`mbdae.native.program`), read as tables; of every function only those stay on which
its outputs depend.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.errors import OptionError
from mbdae.native.program import ADD, CALL, CALL_BACK, CHOLESKY, LOAD, LU, MULTIPLY, SET, Operations, Step

Index = NDArray[np.int64]


class Entry(NamedTuple):
    """One number of an input or output: its name, unit, and a value, NaN where there is none."""

    name: str
    unit: str
    value: float = float("nan")


@dataclass(frozen=True)
class Function:
    """outputs: entries; at: their slots; arguments: names of the inputs; steps: the operations; calls: of those that call a
    kernel, which of its values are used; reads: the slots of the inputs that have an influence."""

    name: str
    meaning: str
    arguments: tuple[str, ...]
    outputs: tuple[Entry, ...]
    at: Index
    steps: tuple[Step, ...]
    calls: tuple[tuple[int, ...], ...]
    reads: frozenset[int]


@dataclass
class Program:
    """title: what is exported; inputs: entries of the vectors by their names ("t", "y", "yp", "p", or "x" and "p" of a law);
    slots: where they are written, pairs (entry, slot); pattern: rows and columns of the entries of the Jacobian."""

    title: str
    operations: Operations
    inputs: dict[str, tuple[Entry, ...]]
    slots: dict[str, Index]
    pattern: tuple[Index, Index] | None = None
    functions: dict[str, Function] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)  #: functions that cannot be given, and why

    def add(self, name: str, meaning: str, arguments: Sequence[str], outputs: Sequence[Entry], at: Any,
            part: Operations) -> None:  # fmt: skip
        """A function by its operations, of which those without influence on its outputs are left out."""
        at = np.asarray(at, dtype=np.int64)
        steps, live = _needed(part.steps, at, self.operations.size)
        calls = tuple(kept for _, kept in steps)
        self.functions[name] = Function(name, meaning, tuple(arguments), tuple(outputs), at, tuple(s for s, _ in steps), calls,
                                        frozenset(np.flatnonzero(live).tolist()))  # fmt: skip

    def drop_parameters(self) -> None:
        """Leave out the parameters that no function reads."""
        read = frozenset[int]().union(*(f.reads for f in self.functions.values()))
        pairs = self.slots["p"]
        kept = sorted({int(entry) for entry, slot in pairs if int(slot) in read})
        number = {entry: n for n, entry in enumerate(kept)}
        self.inputs["p"] = tuple(self.inputs["p"][entry] for entry in kept)
        self.slots["p"] = np.array([(number[e], s) for e, s in pairs.tolist() if e in number], dtype=np.int64).reshape(-1, 2)


def reach(step: Step, name: str) -> Index:
    """Slots (times, count) of a table of an operation on slots."""
    table = np.asarray(step.tables[name], dtype=np.int64)
    return np.asarray(table + step.fields.get(f"{name.rstrip('_')}_step", 0) * np.arange(step.fields["times"])[:, None])


def shifted(step: Step, by: int) -> Step:
    """The same operation on slots that stand further behind."""
    slots = ("first", "outputs") if step.fields["kind"] in (CHOLESKY, LU) else ("first",)
    fields = {name: value + by * (name in slots) for name, value in step.fields.items()}
    tables = {name: table + by * (name != "weight") for name, table in step.tables.items()}
    return Step(fields, tables, (step.slots[0] + by, step.slots[1] + by), step.kernel)


def weights(step: Step) -> NDArray[np.float64]:
    """(times or 1, count) factors of an operation."""
    return np.asarray(step.tables["weight"], dtype=float).reshape(-1, step.fields["count"])


def _needed(steps: Sequence[Step], outputs: Index, size: int) -> tuple[list[tuple[Step, tuple[int, ...]]], NDArray[np.bool_]]:
    """Operations, with the values of kernels, on which slots depend, and the slots that must be given."""
    live = np.zeros(size, dtype=bool)
    live[outputs] = True
    found: list[tuple[Step, tuple[int, ...]]] = []
    for step in reversed(steps):
        kept, used = _USED[step.fields["kind"]](step, live)
        if kept is not None:
            found.append((kept, used))
    return found[::-1], live


def _of_call(step: Step, live: NDArray[np.bool_]) -> tuple[Step | None, tuple[int, ...]]:
    f, kernel = step.fields, step.kernel
    values = slice(f["first"], f["first"] + f["times"] * f["outputs"])
    used = tuple(np.flatnonzero(live[values].reshape(f["times"], f["outputs"]).any(axis=0)).tolist())
    live[values] = False
    if not used:
        return None, ()
    symbols = set().union(*(se.sympify(kernel.expressions[o]).free_symbols for o in used))
    columns = [j for j, s in enumerate(kernel.symbols) if s in symbols]
    live[step.tables["from_"].reshape(f["times"], f["inputs"])[:, columns]] = True
    return step, used


def _of_load(step: Step, live: NDArray[np.bool_]) -> tuple[Step | None, tuple[int, ...]]:
    place = slice(step.fields["first"], step.fields["first"] + step.fields["count"])
    needed = bool(live[place].any())
    live[place] = False
    return (step if needed else None), ()


def _of_slots(step: Step, live: NDArray[np.bool_]) -> tuple[Step | None, tuple[int, ...]]:
    """Copies, sums and products: entries that no instance needs are left out."""
    to = reach(step, "to")
    kept = live[to].any(axis=0)
    if not kept.any():
        return None, ()
    if step.fields["kind"] == SET:
        live[to[:, kept]] = False
    tables = {name: t[kept] for name, t in step.tables.items() if name != "weight"}
    if "weight" in step.tables:
        tables["weight"] = weights(step)[:, kept].ravel()
    fields = step.fields | {"count": int(kept.sum())}
    fields["weight_step"] = fields["count"] if step.fields.get("weight_step") else 0
    found = Step(fields, tables, step.slots, None)
    for name in tables.keys() & {"from_", "by"}:
        live[reach(found, name)] = True
    return found, ()


def _of_solve(step: Step, live: NDArray[np.bool_]) -> tuple[Step | None, tuple[int, ...]]:
    f = step.fields
    n = f["count"]
    right = slice(f["outputs"], f["outputs"] + n * f["times"])
    if not live[right].any():
        return None, ()
    live[right] = live[f["first"] : f["first"] + n * (n if f["kind"] == LU else f["inputs"])] = True
    return step, ()


def _refused(step: Step, live: NDArray[np.bool_]) -> tuple[Step | None, tuple[int, ...]]:
    raise OptionError("what = a scene with an element that is evaluated in Python: it has no operations that could be exported")


_USED = {CALL: _of_call, CALL_BACK: _refused, LOAD: _of_load, SET: _of_slots, ADD: _of_slots, MULTIPLY: _of_slots,
         CHOLESKY: _of_solve, LU: _of_solve}  # fmt: skip
