"""Names, units and values of the inputs and outputs of exported functions."""

from __future__ import annotations

import re

from mbdae.export.program import Entry
from mbdae.inputs.sensed import path_of
from mbdae.reports.scenes.units import parameter_unit, unit_of_row
from mbdae.symbolic.frames import NodeKind
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.model.numbering import Numbering

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
