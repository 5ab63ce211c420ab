"""Scenes as functional mock-up units (FMI 3.0): model exchange and co-simulation in one file, with sources and a compiled binary.

The unit holds y' = f(t, y) of the scene with its multipliers eliminated and Baumgarte's terms, directional derivatives by the
tangent of the operations, and Newton's method back to the joints, by which states are closed at the start and after every step
of co-simulation.
"""

from __future__ import annotations

import io
import json
import platform
import re
import sys
import tempfile
import uuid
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.derivatives.lists import entries
from mbdae.errors import OptionError
from mbdae.export.languages import c_number, identifier, source
from mbdae.export.program import OF_FORMS, Entry, Program, shifted
from mbdae.export.scene import STATE, beside, loose, scene_program
from mbdae.formulations import ODE, Form, Index1
from mbdae.kernels.plan import plan
from mbdae.native import build
from mbdae.native.program import CHOLESKY, LOOKUP, LU, READ, Operations, Step
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.outputs import Target, position, scaled, velocity
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembled.evaluation import Tangent
from mbdae.system.prepare import prepare

#: functions of a unit, by the number that fmi3.inc gives them
FUNCTIONS = ("rates", "sensors", "joint_forces")


def unit_program(scene: Any, form: Form | None) -> Program:
    """The functions of the unit of a scene; OptionError for a scene with contacts, which are events."""
    prepared = prepare(scene)
    if prepared.contacts:
        named = ", ".join(dict.fromkeys(repr(one.item) for one in prepared.contacts))
        raise OptionError(f"format = 'fmi': the contacts of {named} are impacts, at which a step has to end, and the unit has no "
                          "events: leave them out (joints without clearance and limits), or export format='c'")
    groups = [group for group in prepared.model.groups if group.derived.reactive]
    if groups:
        named = ", ".join(dict.fromkeys(repr(one.item) for group in groups for one in group.instances))
        raise OptionError(f"format = 'fmi': the friction of {named} follows from the joint forces, so that there is no formula "
                          "for the y' = f(t, y) of a unit: export format='c' with its residual and Jacobian")
    given = form if form is not None else Index1(multipliers="eliminated") if prepared.rows else ODE()
    program, made = scene_program(scene, given)
    if "rates" not in program.functions:
        raise OptionError("form: a unit of FMI has y' = f(t, y): leave it out, or give mb.Index1(multipliers='eliminated')")
    kept = {name: program.functions[name] for name in FUNCTIONS if name in program.functions}
    unit = replace(program, pattern=None, functions=dict(kept))
    if made.numbering.m:
        _closing(unit, made)
        unit.functions["constraint_matrix"] = program.functions["constraint_matrix"]
        slopes, count, part = program.functions["jacobian"], made.n**2, unit.operations.part()
        part.steps += slopes.steps
        unit.add("slopes", "-dy'/dy, column by column", STATE, slopes.outputs[:count], slopes.at[:count], part)
    unit.drop_parameters()
    tangent, first = _Along(unit.operations), 0
    pairs: list[Any] = []
    for vector in ("t", "y", "p", "signals"):
        if vector in unit.inputs:
            pairs += (unit.slots[vector] + np.array([first, tangent.distance])).tolist()
            first += len(unit.inputs[vector])
    unit.inputs = {**{v: e for v, e in unit.inputs.items() if v != "yp"}, "change": (Entry("change", ""),) * first}
    unit.slots["change"] = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    for name, f in kept.items():
        own = [a for a in f.arguments if a != "signals"]
        unit.add(f"{name}_along", f"directional derivatives of {name} for changes of (t, y, p, signals)", [*own, "change"],
                 f.outputs, f.at + tangent.distance, tangent.following(f.steps))
    return unit


class _Along(Tangent):
    """Tangent of a function, whose matrices may vary, each of its operations followed by that of the differentials."""

    def following(self, steps: Sequence[Step]) -> Operations:
        """The operations, each followed by those of its differentials, because slots may be written to again."""
        part = self._of.part()
        for step in steps:
            f = step.fields
            if f["kind"] != LU:
                part.steps.append(step)
                self._add(part, step)
                continue
            n = f["count"]
            kept = part.slots(n * n)  # LU overwrites the matrix
            part.set(kept + np.arange(n * n), f["first"] + np.arange(n * n))
            part.steps.append(step)
            self._right(part, step)
            part.lu(n, kept, f["outputs"] + self.distance, f["times"])
        return part

    def _add(self, part: Operations, step: Step) -> None:
        f, by = step.fields, self.distance
        if f["kind"] == LOOKUP:  # the third derivative of a table, which no equation contains, is left out
            slope = part.zeros(1)
            part.load(f["first"] + by, np.zeros(READ))
            part.multiply([slope], [f["first"] + READ + 1], [f["inputs"] + by])
            at = f["first"] + np.arange(READ - 1)
            part.multiply(at + by, at + 1, np.full(READ - 1, slope))
            return
        if f["kind"] == CHOLESKY:
            self._right(part, step)
        super()._add(part, step)

    def _right(self, part: Operations, step: Step) -> None:
        """db - dA x of A x = b, in the slots of dx."""
        (cell, row, column), by, f = entries(step), self.distance, step.fields
        for right in f["outputs"] + f["count"] * np.arange(f["times"]):
            part.multiply(right + row + by, cell + by, right + column, -1.0)


def _rows(d: Derived) -> list[tuple[Target, Expr]]:
    return scaled(d, [*position(d), *velocity(d)]) if d.rows else []


def _closing(unit: Program, made: Any) -> None:
    """Add one step of Newton's method to the joints: du and dv, the smallest in the sense of the masses, with G du = -g and
    G dv = -(G u + g_t), as changes of y."""
    other = loose(made, made.assembly.model, made.assembly.numbering.rows, made.assembly.moved)
    nb, e = other.numbering, other.e
    steps = other.part(*(() if other.assembly.motion() else (e.residual_part,)), e.jacobian_part)
    unknown, _, x = other.matrix(steps, 2)
    row = nb.nu + np.arange(nb.m)
    for g, group in enumerate(nb.model.groups):
        p = plan(group.derived, _rows)
        found = [(i, [nb.row(g, i, t[1]) for t in p.targets]) for i in range(len(group.instances))] if p.targets else []
        if active := [i for i, rows in found if any(r is not None for r in rows)]:
            values = p.kernel.emit(steps, nb.gather(g, p.all_inputs, active))
            for slots, (_, rows) in zip(values, (one for one in found if one[0] in active), strict=True):
                for slot, (head, *_), r in zip(slots.tolist(), p.targets, rows, strict=True):
                    if r is not None:
                        steps.add([x + (head == "gd") * len(unknown) + row[r]], [slot], -1.0)
    steps.lu(len(unknown), x - len(unknown) ** 2, x, 2)
    out = steps.zeros(made.n)
    turn = np.flatnonzero((other.rows < nb.nq) & (other.columns >= nb.nq) & (other.columns < nb.nq + nb.nu))
    steps.multiply(out + other.rows[turn], e.fy + turn, x + other.columns[turn] - nb.nq, -1.0)  # q' - H(q) u: dq = H du
    speeds = np.arange(nb.nu)
    steps.add(out + nb.nq + speeds, x + len(unknown) + speeds)
    part, base = beside(made, unit, other)
    same = np.arange(nb.start["lambda"])
    part.set(base + same, same)
    part.steps += [shifted(step, base) for step in steps.steps]
    unit.add("closing", "changes of y that close the joints, to first order", STATE, unit.inputs["y"],
             base + out + np.arange(made.n), part)


# -- the files of the unit


def unit_source(unit: Program, functions: str | None = None) -> str:
    """The one C file of the unit; it needs the C library alone. functions: the text of its functions, where that is known."""
    name, functions = identifier(unit.title), functions or source(unit)
    sizes = {"NY": len(unit.inputs["y"]), "NP": len(unit.inputs["p"]), "NU": len(unit.inputs.get("signals", ()))}
    for size, function in ("NS", "sensors"), ("NF", "joint_forces"):
        sizes[size] = len(unit.functions[function].outputs) if function in unit.functions else 0
    sizes["CLOSES"] = int("closing" in unit.functions)
    starts = {"Y": "y", "P": "p", "U": "signals"}
    least = ["0" if _least(e) == 0 else "-INFINITY" for e in unit.inputs["p"]]
    sizes["NR"], sizes["NV"] = unit.functions["constraint_matrix"].shape if sizes["CLOSES"] else (0, 0)
    lines = [f"#define {n} {size}" for n, size in sizes.items()]
    lines += [f"#define START_{n} {f'{name}_{v}_values' if sizes[f'N{n}'] else 'NOMINAL'}" for n, v in starts.items()]
    lines += [f'#define TOKEN "{_token(functions)}"', f"#define SPAN {c_number(unit.span)}",
              f"static const double LEAST[] = {{{', '.join(least) or '0'}}};",
              f"static const double NOMINAL[] = {{{', '.join(c_number(v) for v in unit.nominal) or '0'}}};"]
    values = {"t": "x[0]", "y": "x + 1", "p": "x + 1 + NY", "signals": "x + 1 + NY + NP", "change": "change"}

    def call(function: str) -> str:
        return f"{name}_{function}({', '.join(values[a] for a in unit.functions[function].arguments)}, out)"

    if sizes["CLOSES"]:
        named = [e.name.split(" by ")[0] for e in unit.functions["constraint_matrix"].outputs[:: sizes["NV"]]]
        lines.append(f"static const char *const ROWS[] = {{{', '.join(json.dumps(name) for name in named)}}};")
        lines += [f"static int {f}(const double *x, double *out) {{ return {call(of)}; }}"
                  for f, of in (("closing", "closing"), ("slopes", "slopes"), ("rows", "constraint_matrix"))]
    cases = [f"  if (which == {i}) return change ? {call(f'{f}_along')} : {call(f)};" for i, f in enumerate(FUNCTIONS)
             if f in unit.functions]
    around = Path(__file__).with_name("fmi3.inc").read_text(encoding="utf-8")
    head = "static int function(int which, const double *x, const double *change, double *out) {"
    return "\n".join([functions, *lines, around, head, *cases, "  return 0;", "}", ""])


def _least(parameter: Entry) -> float:
    """The least value of a parameter: 0 of gains of a form and of inertia, whose unit has kg and no time, but for products of
    inertia; else none."""
    if parameter.name in OF_FORMS:
        return 0.0
    inertia = "kg" in parameter.unit and not re.search(r"\bs\b", parameter.unit)
    return 0.0 if inertia and not re.search(r"\.J(xy|xz|yz)\b", parameter.name) else -np.inf


def _token(functions: str) -> str:
    """Of two units the same where their equations are."""
    return f"{{{uuid.uuid5(uuid.NAMESPACE_URL, functions)}}}"


def _variables(unit: Program) -> Iterator[dict[str, Any]]:
    """Attributes of every variable, in the order of the value references."""
    names, taken, reference = [e.name for e in unit.inputs["y"]], {"time"}, 0
    sensed = [e for f in FUNCTIONS[1:] if f in unit.functions for e in unit.functions[f].outputs]
    own = {e.name for e in sensed}

    def unique(name: str) -> str:
        while name in taken:
            name += "_"
        taken.add(name)
        return name

    yield {"name": "time", "causality": "independent", "variability": "continuous", "unit": "s"}
    for e, size in zip(unit.inputs["y"], unit.nominal, strict=True):
        yield {"name": unique(e.name), "causality": "output" if e.name in own else "local", "variability": "continuous",
               "initial": "exact", "start": e.value, "unit": e.unit, "nominal": size}
    for e in unit.inputs["p"]:
        yield {"name": unique(e.name), "causality": "parameter", "variability": "tunable", "initial": "exact", "start": e.value,
               "unit": e.unit, **({"min": 0.0} if _least(e) == 0 else {})}
    for e in unit.inputs.get("signals", ()):
        yield {"name": unique(e.name), "causality": "input", "variability": "continuous", "start": e.value, "unit": e.unit}
    for reference, (name, e) in enumerate(zip(names, unit.functions["rates"].outputs, strict=True), start=1):
        yield {"name": unique(f"der({name})"), "causality": "local", "variability": "continuous", "initial": "calculated",
               "unit": e.unit, "derivative": reference}
    for e in sensed:  # of a joint whose coordinate is a state this is the output
        yield {} if e.name in names else {"name": unique(e.name), "causality": "output", "variability": "continuous",
                                          "initial": "calculated", "unit": e.unit, "description": e.note}


def description(unit: Program, functions: str | None = None) -> str:
    """modelDescription.xml. functions: as `unit_source` takes them."""
    name, title = identifier(unit.title), unit.title.split(",")[0]
    root = ET.Element("fmiModelDescription", fmiVersion="3.0", modelName=title,
                      instantiationToken=_token(functions or source(unit)), generationTool="mbdae",
                      description=f"{unit.title}; SI units, angles in rad")
    able = {"modelIdentifier": name, "canGetAndSetFMUState": "true", "canSerializeFMUState": "true",
            "providesDirectionalDerivatives": "true"}
    ET.SubElement(root, "ModelExchange", able)
    ET.SubElement(root, "CoSimulation", able | {"canHandleVariableCommunicationStepSize": "true"})
    units, variables = ET.SubElement(root, "UnitDefinitions"), list(_variables(unit))
    for text in sorted({v["unit"] for v in variables if v.get("unit")}):
        powers = base_units(text)
        stated = ET.SubElement(units, "Unit", name=text)
        if powers is not None:
            ET.SubElement(stated, "BaseUnit", {base: str(power) for base, power in powers.items() if power})
    ET.SubElement(root, "DefaultExperiment", startTime="0", tolerance="1e-6")
    listed, structure = ET.SubElement(root, "ModelVariables"), ET.SubElement(root, "ModelStructure")
    for reference, v in enumerate(variables):
        if v:
            ET.SubElement(listed, "Float64", {"name": v["name"], "valueReference": str(reference)}
                          | {k: value if isinstance(value, str) else repr(value if k == "derivative" else float(value))
                             for k, value in v.items() if k != "name" and value != ""})
    calculated = [(i, v) for i, v in enumerate(variables) if v.get("initial") == "calculated"]
    for tag, found in (("Output", [i for i, v in enumerate(variables) if v.get("causality") == "output"]),
                       ("ContinuousStateDerivative", [i for i, v in calculated if "derivative" in v]),
                       ("InitialUnknown", [i for i, _ in calculated])):
        for reference in found:
            ET.SubElement(structure, tag, valueReference=str(reference))
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


#: exponents of kg, m, s, rad in the units of this package
BASES: dict[str, dict[str, int]] = {
    "kg": {"kg": 1}, "m": {"m": 1}, "s": {"s": 1}, "rad": {"rad": 1}, "1": {}, "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2}, "W": {"kg": 1, "m": 2, "s": -3}, "Pa": {"kg": 1, "m": -1, "s": -2}}


def base_units(text: str) -> dict[str, int] | None:
    """Exponents of the base units in a unit such as "N m/rad" or "(kg m)/s^2"; None for one that is not known."""
    found, sign = dict[str, int](), 1
    for token in re.findall(r"/|[^\s/()]+", text):
        base, _, power = token.partition("^")
        if token == "/":
            sign = -1
        elif base not in BASES or not re.fullmatch(r"-?\d*", power):
            return None
        else:
            for name, exponent in BASES[base].items():
                found[name] = found.get(name, 0) + sign * exponent * int(power or 1)
    return found


def unit_file(unit: Program) -> bytes:
    """The whole unit as a zip archive; OptionError where no C compiler works."""
    name, functions = identifier(unit.title), source(unit)
    text = unit_source(unit, functions)
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    system = {"win32": "windows"}.get(sys.platform, sys.platform)
    files = {"modelDescription.xml": description(unit, functions).encode(), f"sources/{name}.c": text.encode(),
             "sources/buildDescription.xml": BUILT.format(name).encode(),
             f"binaries/{machine}-{system}/{name}{build.SUFFIX}": compiled(name, text)}
    found = io.BytesIO()
    with zipfile.ZipFile(found, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, content in files.items():
            archive.writestr(zipfile.ZipInfo(path), content, zipfile.ZIP_DEFLATED)
    return found.getvalue()


#: kernels are long and have no loops: -O3 compiles a four-bar in 1.45 s, -O1 in 0.55 s
OPTIMISED = "-O1"
BUILT = """<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{0}">
    <SourceFileSet language="C99"><SourceFile name="{0}.c"/></SourceFileSet>
  </BuildConfiguration>
</fmiBuildDescription>
"""


def compiled(name: str, text: str, what: str = "format = 'fmi': the unit holds", *flags: str) -> bytes:
    """The shared library of a C file for this machine. what: needs it, for messages; flags: further ones of the compiler."""
    with tempfile.TemporaryDirectory(prefix="mbdae-") as folder:
        (Path(folder) / f"{name}.c").write_text(text, encoding="utf-8")
        try:
            command = build.compiler()
            whole = [*command, *build.flags(command), OPTIMISED, *flags, f"{name}.c", "-o", f"{name}{build.SUFFIX}", "-lm"]
            done = build.run(whole, Path(folder))
        except build.BuildError as error:
            raise OptionError(f"{what} a compiled library. {error}") from None
        if done.returncode:
            raise OptionError(f"{what} a compiled library, and the C compiler refuses it: {done.stdout.strip()[:2000]}")
        return (Path(folder) / f"{name}{build.SUFFIX}").read_bytes()
