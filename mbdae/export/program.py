"""Data of an export: named functions of named vectors, each a list of operations on one array of numbers.

The operations are those that run natively (`mbdae.native.program`), read as tables; for every function only those are kept on
which its outputs depend.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.inputs.sensed import path_of
from mbdae.native.program import CALL, CHOLESKY, LOAD, LOOKUP, LU, POSITIVE, READ, SET, SOLVE, Operations, Scene, Step, core
from mbdae.reports.units import parameter_unit, unit_of_row
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.rebuild import symbols_of
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.model.numbering import Numbering
from mbdae.values import Array

Index = NDArray[np.int64]


class Entry(NamedTuple):
    """One entry of an input or output vector: its name, unit and value, NaN where it has none. note: what a reader has to know of
    it, such as that a reaction is not unique; "" where that is nothing."""

    name: str
    unit: str
    value: float = float("nan")
    note: str = ""


@dataclass(frozen=True)
class Function:
    """An exported function as operations on one work array, whose places are called slots.

    outputs: entries; at: their slots; arguments: names of the input vectors; steps: operations, those that call a kernel with a
    field `used` (numbers of the kernel's values that matter); reads: slots whose initial numbers outputs depend on; shape: of a
    matrix, whose entries are stored row by row, else ()."""

    name: str
    meaning: str
    arguments: tuple[str, ...]
    outputs: tuple[Entry, ...]
    at: Index
    steps: tuple[Step, ...]
    reads: frozenset[int]
    shape: tuple[int, ...] = ()


@dataclass
class Program:
    """All exported functions of a scene or a law.

    title: what is exported; inputs: entries of the vectors by name ("t", "y", "yp", "p", "signals", of a law "x" and "p"); slots:
    pairs (entry, slot) by vector, where inputs are written; numbers: initial values of the work array, followed by zeros;
    pattern: rows and columns of the entries of the Jacobian; missing: {function that cannot be given: reason};
    nominal: typical magnitudes of y; span: a typical time of the scene, s."""

    title: str
    operations: Operations
    inputs: dict[str, tuple[Entry, ...]]
    slots: dict[str, Any]
    numbers: Array = field(default_factory=lambda: np.zeros(0))
    pattern: tuple[Index, Index] | None = None
    functions: dict[str, Function] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    nominal: Array = field(default_factory=lambda: np.zeros(0))
    span: float = 1.0

    def __post_init__(self) -> None:
        self.slots = {name: np.array(pairs, dtype=np.int64).reshape(-1, 2) for name, pairs in self.slots.items()}

    def add(self, name: str, meaning: str, arguments: Sequence[str], outputs: Sequence[Entry], at: Any,
            part: Operations, shape: tuple[int, ...] = ()) -> None:
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
                                        frozenset(np.flatnonzero(live).tolist()), shape)

    def given(self, vectors: Mapping[str, Any]) -> Array:
        """The array with the values of the inputs in their slots."""
        W = np.zeros(self.operations.size)
        for name, values in vectors.items():
            entries, slots = self.slots[name].T
            W[slots] = np.asarray(values, dtype=float)[entries]
        return W

    def read_by(self, f: Function) -> Iterator[tuple[str, Index]]:
        """Every argument of a function, with the pairs (entry, slot) that the function reads."""
        for vector in f.arguments:
            pairs = self.slots[vector]
            yield vector, pairs[[int(slot) in f.reads for slot in pairs[:, 1]]].reshape(-1, 2)

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
    kind = step.fields["kind"]
    slots = ("first", "outputs", *["inputs"] * (kind == LOOKUP)) if kind in (CHOLESKY, SOLVE, LU, LOOKUP) else ("first",)
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


_USED = {CALL: _of_call, LOAD: _of_load, POSITIVE: _of_check, CHOLESKY: _of_solve, LU: _of_solve, SOLVE: _of_solve,
         LOOKUP: _of_lookup}


# -- Names, units and values of the inputs and outputs of exported functions


OF_FORMS = {"baumgarte_velocity": "1/s", "baumgarte_position": "1/s^2"}
RATES = {"g": "", "gd": "/s", "gdd": "/s^2"}  #: what follows a row's unit, for the row and its first and second time derivative


def rate_of(unit: str) -> str:
    """Unit of a time derivative."""
    known = {"m": "m/s", "rad": "rad/s", "1": "1/s", "m/s": "m/s^2", "rad/s": "rad/s^2", "N s": "N", "N m s": "N m"}
    return known.get(unit, f"({unit})/s" if unit else "")


def node_units(kind: NodeKind, unit: str) -> tuple[list[str], list[str]]:
    """Units of the entries of q and u of a node. unit: that of a joint coordinate."""
    (nq, nu), n = kind.sizes, kind.translations
    if kind is NodeKind.COORDINATE:
        return [unit], [f"{unit}/s"]
    return ["m"] * n + ["1" if kind.by_quaternion else "rad"] * (nq - n), ["m/s"] * n + ["rad/s"] * (nu - n)


def force_of(unit: str) -> str:
    """Unit of the force that does work on a length, angle or cosine (or power on their rates) of this unit; "" for others."""
    return {"m": "N", "1": "N m", "rad": "N m"}.get(unit.partition("/")[0], "")


def unknown_units(nb: Numbering) -> list[str]:
    """Units (n,) of the unknowns of a numbering."""
    units = [""] * nb.n
    for node in nb.free:
        for head, entries in zip("qu", node_units(node.kind, node.unit), strict=True):
            for i, stated in enumerate(entries):
                if not nb.shares(node, i, head):
                    units[nb.node_place(head, node, i)] = stated
    for n, (g, i, j) in enumerate(nb.states):
        law = nb.model.groups[g].instances[i].law
        units[nb.start["s"] + n] = law.states[nb.model.groups[g].derived.states[j]].unit
    for n, name in enumerate(nb.stresses):
        units[nb.start["z"] + n] = "N" if name.rpartition(".")[2].startswith("N") else "N m"
    for block in ("lambda", "mu"):
        for n, row in enumerate(nb.rows):
            if nb.start[block] + n < nb.n:
                stated = unit_of_row(nb.model, row, effort=block == "lambda")
                ends = ("", " s") if block == "lambda" else ("/s", "")
                units[nb.start[block] + n] = stated and stated + ends[nb.derivatives]
    return units


def row_units(assembly: Assembly) -> list[str]:
    """Units (n,) of the rows of F: of q', of forces and torques, of s', and of the constraint rows or their rates."""
    nb = assembly.numbering
    units = [rate_of(unit) for unit in unknown_units(nb)]
    for at in range(nb.nq, nb.nq + nb.nu):
        units[at] = force_of(units[at])
    for head, block in assembly.spec.rows.items():
        for n, row in enumerate(nb.rows) if head in RATES else ():
            stated = unit_of_row(nb.model, row)
            units[nb.start[block] + n] = stated and stated + RATES[head]
    for n in range(len(nb.stresses)):
        units[nb.start["z"] + n] = ""
    return units


def parameter_entries(nb: Numbering, baked: set[tuple[str, str]]) -> tuple[list[Entry], list[tuple[int, int]]]:
    """Entries of the input vector "p": parameters of laws and of the formulation, and points of items on their bodies; with pairs
    (entry, slot) that say where each is written in the work array.

    Laws of one item that share a value, such as the mass of a body and of its weight, share an entry; where an item has several
    parameters of one name, such as dampers on two coordinates, the second and later ones end in #2, #3, ...
    baked: (item, name) of parameters that are no inputs."""
    entries: list[Entry] = []
    pairs: list[tuple[int, int]] = []
    seen: dict[tuple[str, float], tuple[int, set[type]]] = {}
    for g, i, one in nb.model.instances():
        for name, value in one.numbers.items():
            point = re.fullmatch(r"\w+_p[123]", name)
            if (one.item, name) in baked or not (point or name in one.law.params):
                continue
            at, owners = seen.get((f"{one.item}.{name}", value), (-1, set()))
            if at < 0 or (type(one.law) in owners and not point):
                taken = sum(e.name.split("#")[0] == f"{one.item}.{name}" for e in entries)
                label = f"{one.item}.{name}" + (f"#{taken + 1}" if taken else "")
                entries.append(Entry(label, "m" if point else parameter_unit(one, name), float(value)))
                at, owners = len(entries) - 1, set()
            seen[f"{one.item}.{name}", value] = at, owners | {type(one.law)}
            pairs.append((at, nb.slot(g, i, name)))
    for name, value in nb.form_numbers.items():
        if ("", name) in baked:
            continue
        entries.append(Entry(name, OF_FORMS.get(name, ""), float(value)))
        pairs.append((len(entries) - 1, nb.slot(-2, 0, name)))
    return entries, pairs


def signal_entries(nb: Numbering) -> tuple[list[Entry], list[tuple[int, int]]]:
    """Entries of the input vector "signals": every signal of the scene whose value is a number, with that value; and pairs
    (entry, slot) as of `parameter_entries`. The unit is that of the parameters that are the signal alone, "" where they have
    none or several."""
    stated = {one.name: one.value for one in nb.model.scene.signals if isinstance(one.value, float)}
    units: dict[str, set[str]] = {name: set() for name in stated}
    pairs: list[tuple[int, int]] = []
    for g, i, one in nb.model.instances():
        pairs += [(list(stated).index(name), nb.slot(g, i, symbol)) for symbol, name in one.signals.items()]
        for parameter in one.law.params if one.signals else ():
            if (name := path_of(getattr(one.law, parameter))) in stated:
                units[name].add(parameter_unit(one, parameter))
    return [Entry(name, min(units[name]) if len(units[name]) == 1 else "", value) for name, value in stated.items()], pairs
