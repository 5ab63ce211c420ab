"""Names, units and values of what exported functions take and return."""

from __future__ import annotations

import re

from mbdae.export.program import Entry
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.part import Parameter
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.model.numbering import Numbering

OF_FORMS = {"baumgarte_velocity": "1/s", "baumgarte_position": "1/s^2"}
RATES = {"g": "", "gd": "/s", "gdd": "/s^2"}  #: what the unit of a row is multiplied by in its rates
_POWER = re.compile(r"m(?:\^([0-9.]+))?(?:/rad)?")


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


def row_unit(d: Derived, row: int) -> str:
    """m, or 1 (an angle, a cosine), of a row by its value where all lengths are doubled; "" where that is neither."""
    e = d.g[row].subs(d.variation.insertion())
    values, long = {}, {}
    lengths = {s for f in d.frames if not f.kind.of_joint for s in f.q[: f.kind.translations]}
    specs = dict(getattr(d.law, "coordinates", {})) | dict(d.law.params)
    lengths |= {f.q[0] for name, f in zip(d.law.own_coordinates, d.frames[len(d.sides) :], strict=True)
                if f.kind is NodeKind.COORDINATE and specs.get(name, Parameter("rad")).unit == "m"}  # fmt: skip
    for n, s in enumerate(sorted(e.free_symbols, key=str)):
        found = _POWER.fullmatch(specs[str(s)].unit) if str(s) in specs else None
        power = 1.0 if s in lengths or re.fullmatch(r"\w+_p[123]", str(s)) else float(found[1] or 1) if found else 0.0
        values[s] = 0.4 + 0.37 * ((n * 0.618) % 1)
        long[s] = values[s] * 2**power
    try:
        once, twice = float(e.subs(values)), float(e.subs(long))
    except (RuntimeError, TypeError):
        return ""
    return "m" if abs(twice - 2 * once) < 1e-9 else "1" if abs(twice - once) < 1e-9 else ""


def force_of(unit: str) -> str:
    """Of the force whose product with a length, an angle or a cosine (or their rates) is an energy (or a power); "" of others."""
    return {"m": "N", "1": "N m", "rad": "N m"}.get(unit.partition("/")[0], "")


def unknown_units(nb: Numbering) -> list[str]:
    """(n,) units of the unknowns of a numbering."""
    units = [""] * nb.n
    for node in nb.free:
        for head, entries in zip("qu", node_units(node.kind, node.unit), strict=True):
            for i, unit in enumerate(entries):
                if not nb.shares(node, i, head):
                    units[nb.node_place(head, node, i)] = unit
    for n, (g, i, j) in enumerate(nb.states):
        law = nb.model.groups[g].instances[i].law
        units[nb.start["s"] + n] = law.states[nb.model.groups[g].derived.states[j]].unit
    for n, name in enumerate(nb.stresses):
        units[nb.start["z"] + n] = "N" if name.rpartition(".")[2].startswith("N") else "N m"
    for block in ("lambda", "mu"):
        for n, row in enumerate(nb.rows):
            if nb.start[block] + n < nb.n:
                unit = force_of(row_unit(nb.model.groups[row.group].derived, row.row)) if block == "lambda" else ""
                units[nb.start[block] + n] = f"{unit} s" if unit and nb.derivatives else unit
    return units


def row_units(assembly: Assembly) -> list[str]:
    """(n,) units of the rows of F: those of q', forces and torques, s', and of constraints those of the row or its rates."""
    nb = assembly.numbering
    units = [rate_of(unit) for unit in unknown_units(nb)]
    for at in range(nb.nq, nb.nq + nb.nu):
        units[at] = force_of(units[at])
    for head, block in assembly.spec.rows.items():
        for n, row in enumerate(nb.rows) if head in RATES else ():
            unit = row_unit(nb.model.groups[row.group].derived, row.row)
            units[nb.start[block] + n] = unit and unit + RATES[head]
    for n in range(len(nb.stresses)):
        units[nb.start["z"] + n] = ""
    return units


def parameter_entries(nb: Numbering, baked: set[tuple[str, str]]) -> tuple[list[Entry], list[tuple[int, int]]]:
    """Parameters of the laws and of the form, and points of items on their bodies, with pairs (entry, slot).

    Laws of one item that have a number in common, such as the mass of a body and of its weight, share an entry; numbers of the
    same law and name at several coordinates of an item are numbered. baked: (item, name) of numbers that are no inputs."""
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
                entries.append(Entry(label, "m" if point else one.law.params[name].unit, float(value)))
                at, owners = len(entries) - 1, set()
            seen[f"{one.item}.{name}", value] = at, owners | {type(one.law)}
            pairs.append((at, nb.slot(g, i, name)))
    for name, value in nb.form_numbers.items():
        if ("", name) in baked:
            continue
        entries.append(Entry(name, OF_FORMS.get(name, ""), float(value)))
        pairs.append((len(entries) - 1, nb.slot(-2, 0, name)))
    return entries, pairs
