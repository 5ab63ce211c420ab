"""`mbdae.export`: the equations of a scene or of a law as C, CasADi, JAX, SymPy or LaTeX, of a scene as a unit of FMI.

Exported functions of a single law: of x (unknowns of its frames, multipliers, states) and of its parameters p.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import OptionError, naming_arguments
from mbdae.export import fmi, for_jax, languages, text
from mbdae.export.program import RATES, Entry, Program, force_of, node_units, rate_of
from mbdae.export.scene import scene_program
from mbdae.files import write_file
from mbdae.formulations import form_of
from mbdae.kernels import Kernel
from mbdae.kernels.plan import linearised_plan, plan
from mbdae.laws.friction import Friction
from mbdae.laws.journal import JournalContact
from mbdae.native.program import Operations
from mbdae.notation import counted, rows, titled
from mbdae.reports.statement import OPTIONS, structure_of
from mbdae.reports.units import row_unit
from mbdae.results.sensors import power_outputs, reaction_outputs
from mbdae.scene.components import Connection
from mbdae.scene.scene import SceneData
from mbdae.symbolic import outputs as of
from mbdae.symbolic.derive import Derived, Side, derive
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.law import Element, Force, Law, Structure
from mbdae.symbolic.line import LineLaw, derive_line
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.part import Part, PartStructure
from mbdae.symbolic.tree_motion import Open
from mbdae.symbolic.vectors import Expr
from mbdae.values import option, sequence, shown, word
from mbdae.values import path as path_named

OutputTable = list[tuple[Target, Expr]]
MadeFunctions = dict[str, tuple[Any, Sequence[Entry], str]]  #: name of a function -> kernel, outputs, meaning


def _equations(d: Derived) -> OutputTable:
    return [*of.dynamics(d), *(of.kinematics(d) if isinstance(d.law, Element) else ()), *of.lowest(d), *of.state_rows(d)]


#: name of a function -> its outputs and their meaning
FUNCTIONS: dict[str, tuple[Callable[[Derived], OutputTable], str]] = {
    "forces": (of.dynamics, "generalised forces of the law on the velocities of its frames, left-hand side of M u' + ... = 0"),
    "energy": (lambda d: [(("energy",), d.energy)], "potential energy; of a body its kinetic energy"),
    "rows": (of.position, "constraint rows g = 0"),
    "row_rates": (of.velocity, "dg/dt = G u + g_t"),
    "row_accelerations": (lambda d: of.acceleration(d) if d.rows else [], "d2g/dt2 at zero accelerations"),
    "G": (of.jacobian_G, "entries of the constraint Jacobian by the velocities"),
    "states": (of.state_rows, "s' - rate = 0 of the internal states"),
    "kinematics": (lambda d: of.kinematics(d) if isinstance(d.law, Element) else [], "q' - H(q) u = 0"),
    "coordinates": (of.coordinate, "coordinates of the joint and their rates"),
    "joint_forces": (reaction_outputs, "force and torque (about the joint) on body l, inertial components"),
    "power": (power_outputs, "power that the law delivers to its bodies"),
}


def law_program(what: Any, frames: Any, options: Mapping[str, Any]) -> Program:
    """The functions of a law class, a law with values, or a friction or normal law (in the contact of a pin in its race)."""
    law, structure, values = _law(what, options)
    title = law.__name__
    if issubclass(law, LineLaw):
        kind = NodeKind.PLANAR if frames and "planar" in frames[0] else NodeKind.SPATIAL
        return _of_line(title, derive_line(law, structure, kind), values, law)
    d = derive(law, structure, _sides(law, structure, frames))
    found = {name: (plan(d, table), meaning) for name, (table, meaning) in FUNCTIONS.items()}
    made: MadeFunctions = {name: (p.kernel, _named(d, p.targets), meaning) for name, (p, meaning) in found.items()
                  if any(e != 0 for e in p.expressions)}
    derived, symbols = linearised_plan(d, _equations, Open.ALL), of.input_symbols(d)
    if derived.jacobian_places:
        stated, by = _named(d, derived.targets), dict(symbols)
        entries = [Entry(f"d {stated[row].name} / d {by[t]}", "") for row, t in derived.jacobian_places]
        meaning = "derivatives of forces, kinematics, rows and states by x, where they do not vanish"
        made["jacobian"] = derived.jacobian, entries, meaning
    units = _units(d)
    return _program(title, made, {str(s): units.get(t, "") for t, s in symbols}, d.law, values)


def _law(what: Any, options: Mapping[str, Any]) -> tuple[type[Law], Structure, Mapping[str, Any]]:
    if isinstance(what, Law):
        if options:
            name = next(iter(options))
            raise OptionError(f"{name}: a law with values takes no options, which only classes of laws do; leave it out")
        timed = frozenset(p for p in what.params if hasattr(getattr(what, p), "free_symbols"))
        return type(what), what.structure(timed), {p: getattr(what, p) for p in what.params}
    if isinstance(what, Part) or (isinstance(what, type) and issubclass(what, Part)):
        role = "friction" if issubclass(what if isinstance(what, type) else type(what), Friction) else "normal"
        typical = OPTIONS[role]  # of mbdae's own laws LuGre has options, without which it has no formulas: it gets typical ones
        part = typical if what is typical.cls else PartStructure(what, frozenset(), ()) if isinstance(what, type) else what
        return JournalContact, structure_of(JournalContact, {role: part, **options}), {}
    if isinstance(what, type) and issubclass(what, Law):
        return what, structure_of(what, options), {}
    raise OptionError(f"what = {shown(what)}: give a scene, a class of a law or part such as mb.Revolute, or one with values")


def _sides(law: type[Law], structure: Structure, frames: Any) -> tuple[Side, ...]:
    """Kinds of the nodes: as requested, else bodies in space, with the ground as k of an external force."""
    count = len(law.frames)
    ground = NodeKind.GROUND.value if issubclass(law, Force) and law.external else NodeKind.SPATIAL.value
    words = [kind.value for kind in NodeKind if not kind.of_joint]
    usual = [ground, *[NodeKind.SPATIAL.value] * (count - 1)][:count]
    asked = option("frames", frames if frames is not None else usual, sequence, f"give {count} words", each=word, words=words)
    if len(asked) != count:
        raise OptionError(f"frames = {shown(frames)}: {law.__name__} has {counted(count, 'frame')} ({', '.join(law.frames)}); "
                          f"give one word for each")
    kinds = [NodeKind(one) for one in asked]
    law_ = law.symbolic(structure)
    units = getattr(law_, "coordinates", {})
    own = [NodeKind.ROTATION if name in units and units[name].unit == "rotation" else NodeKind.COORDINATE
           for name in law_.own_coordinates]
    return tuple((kind, Axes.NORMAL if kind.flat else Axes.GENERAL) for kind in kinds) + tuple((k, Axes.GENERAL) for k in own)


def _named(d: Derived, targets: Sequence[Target]) -> list[Entry]:
    """Outputs with names and units."""
    rows = [row_unit(d, r) for r in range(len(d.rows))]
    found = []
    for head, *place in targets:
        if head in ("u", "q"):
            node = next(f.kind for f in d.frames if f.side == place[0])
            unit = node_units(node, "m")[head == "u"][place[1]]
            found.append(Entry(f"{place[0]}.{'force' if head == 'u' else 'kinematics'}[{place[1]}]",
                               force_of(unit) if head == "u" else rate_of(unit)))
        elif head in RATES:
            unit, word_ = rows[place[0]], {"g": "", "gd": " rate", "gdd": " acceleration"}[head]
            found.append(Entry(d.rows[place[0]] + word_, unit and unit + RATES[head]))
        elif head == "G":
            found.append(Entry(f"{d.rows[place[0]]} by {place[1]}[{place[2]}]", ""))
        elif head == "s":
            found.append(Entry(f"state {d.states[place[0]]}", rate_of(d.law.states[d.states[place[0]]].unit)))
        elif head == "reaction":
            found.append(Entry(f"{'force' if place[0] < 3 else 'torque'}[{place[0] % 3}]", "N" if place[0] < 3 else "N m"))
        else:
            words = [*map(str, place), {"cd": "rate", "c": ""}.get(str(head), str(head))]
            found.append(Entry(" ".join(words).strip(), {"energy": "J", "power": "W"}.get(head, "")))
    return found


def _units(d: Derived) -> dict[Target, str]:
    """Units of the unknowns of a law."""
    found: dict[Target, str] = {}
    for f in d.frames:
        for head, units in zip("qu", node_units(f.kind, "m"), strict=True):
            found |= {(head, f.side, i): unit for i, unit in enumerate(units)}
            found |= {(f"{head}p", f.side, i): rate_of(unit) for i, unit in enumerate(units)}
    found |= {("lambda", r): row_unit(d, r, effort=True) for r in range(len(d.rows))}
    for j, name in enumerate(d.states):
        unit = d.law.states[name].unit
        found |= {("s", j): unit, ("sp", j): rate_of(unit)}
    return found


def _of_line(title: str, d: Any, values: Mapping[str, Any], law: type[Law]) -> Program:
    """Functions of a law at a point of a line: generalised forces of the interpolated fields, rows of the stresses, energy."""
    tables: dict[str, tuple[str, list[Any]]] = {
        "forces": ("forces dual to the fields, times the weight of the point", [(f"dual of {f.symbol}", e) for f, e in d.duals]),
        "rows": ("rows of the stresses", [(f"row of {name}", e) for name, e in zip(d.stresses, d.rows, strict=True)]),
        "resultants": ("stress resultants", list(d.resultants)),
        "energy": ("elastic energy of the point", [("energy", d.energy)]),
        "dissipated": ("dissipated power", [("dissipated", d.dissipated)]),
        "mass": ("inertia per length between velocities", [(f"[{i}, {j}]", e) for (i, j), e in d.mass.items()]),
        "jacobian": ("derivatives of forces, then rows",
                     [(f"output {o} by {d.variables[i]}", e) for (o, i), e in d.derivatives.items()]),
    }
    made: MadeFunctions = {}
    for name, (meaning, table) in tables.items():
        if any(e != 0 for _, e in table):
            symbols = sorted(set().union(*(e.free_symbols for _, e in table)), key=str)
            made[name] = Kernel(symbols, [e for _, e in table]), [Entry(n, "") for n, _ in table], meaning
    return _program(title, made, {str(s): "" for s in d.variables}, law, values)


def _program(title: str, made: MadeFunctions, x: Mapping[str, str], law: Any, values: Mapping[str, Any]) -> Program:
    """A program with one kernel call for each function. x: units of the unknowns by name."""
    used = {str(s) for kernel, _, _ in made.values() for s in kernel.symbols}
    unknown = [name for name in x if name in used]
    parameters = sorted(used - set(unknown))
    slot = {name: i for i, name in enumerate((*unknown, *parameters))}
    units, entries = {"ds": "m", "weight": "m"} | {n: p.unit for n, p in law.params.items()}, []
    for name in parameters:
        stated, _, dots = re.sub(r"_(d?dot)$", r"|\1", name).partition("|")
        unit = units.get(stated, "m" if re.search(r"_p\d$", name) else "rad" if name.endswith("theta0") else "1")
        value = values.get(name)
        entries.append(Entry(name, unit + {"": "", "dot": "/s", "ddot": "/s^2"}[dots],
                             float(value) if isinstance(value, int | float) else float("nan")))
    slots = {"x": [(i, i) for i in range(len(unknown))], "p": [(i, len(unknown) + i) for i in range(len(parameters))]}
    program = Program(title, Operations(len(slot)), {"x": tuple(Entry(name, x[name]) for name in unknown), "p": tuple(entries)},
                      slots)
    for name, (kernel, outputs, meaning) in made.items():
        part = program.operations.part()
        at = kernel.emit(part, np.array([[slot[str(s)] for s in kernel.symbols]], dtype=np.intp).reshape(1, -1))
        program.add(name, meaning, ("x", "p"), outputs, at.ravel(), part)
    return program


__all__ = ["Entry", "Export", "export"]

#: format -> function that writes it, and suffix of its files
FORMATS: dict[str, tuple[Callable[[Program], str], str]] = {
    "sympy": (text.sympy_text, ".py"), "c": (languages.source, ".c"), "casadi": (text.casadi_text, ".py"),
    "latex": (text.latex_text, ".tex"), "jax": (for_jax.jax_text, ".py"), "fmi": (fmi.description, ".fmu")}


@dataclass(frozen=True, repr=False)
class Export:
    """Equations in the language of another system, made by `mb.export`.

    inputs      {name of an input vector: entries with name, unit and value}: of a scene "t" (s), "y", "yp" (at the start) and "p"
                (parameters, with the values of the scene), "signals" (those that are numbers, with these; empty where there are
                none); of a law "x" (unknowns of its frames, multipliers, states) and "p"
    outputs     {function: entries with name, unit and note}, in the order of its outputs; the note of a reaction says where it is
                not unique; arguments: {function: names of its inputs}
    pattern     rows and columns (nnz,) of the entries of the Jacobian, column by column; None for a law
    missing     {function: reason}, for those that the scene does not have in this form
    text        the whole file; header: the declarations in C, with all names and units

    `export["residual"]` is one function: in SymPy (steps, outputs) as `sympy.cse` returns them, a `casadi.Function`, a function
    of JAX arrays, in C and FMI the name by which it is called, in LaTeX its equations. The text of a unit is its description."""

    format: str
    program: Program
    inputs: Mapping[str, tuple[Entry, ...]]
    outputs: Mapping[str, tuple[Entry, ...]]
    arguments: Mapping[str, tuple[str, ...]]
    pattern: tuple[NDArray[np.int64], NDArray[np.int64]] | None
    missing: Mapping[str, str]

    def __repr__(self) -> str:
        functions = ", ".join(f"{name} ({len(entries)})" for name, entries in self.outputs.items())
        inputs = ", ".join(f"{name} ({len(entries)})" for name, entries in self.inputs.items())
        return f"Export({self.program.title!r}, format '{self.format}': functions {functions or 'none'}; inputs {inputs})"

    def _repr_html_(self) -> str:
        found = [(name, ", ".join(self.arguments[name]), len(entries)) for name, entries in self.outputs.items()]
        missing = [(name, "missing", why) for name, why in self.missing.items()]
        return titled(f"{self.program.title} as {self.format}", rows([*found, *missing], ("function", "of", "outputs")))

    @cached_property
    def text(self) -> str:
        """The whole file."""
        return FORMATS[self.format][0](self.program)

    @property
    def header(self) -> str:
        """The declarations in C."""
        return languages.header(self.program)

    def save(self, path: Any) -> Path:
        """Write the file, for C also the header next to it, with suffix .h; returns the path. Raises OptionError where the
        suffix is that of another format, the file cannot be written, or no C compiler works that a unit of FMI needs."""
        suffix = FORMATS[self.format][1]
        named: Path = option("path", path, path_named, f"give the name of a file that ends in {suffix}")
        if named.suffix != suffix:
            raise OptionError(f"path = '{named}': a file of format '{self.format}' ends in {suffix}; name it so")
        if self.format == "c":
            write_file(named.with_suffix(".h"), self.header)
        return write_file(named, self.text if self.format != "fmi" else fmi.unit_file(self.program))

    def __getitem__(self, name: str) -> Any:
        """One function by its name; OptionError where there is none, or where CasADi is not installed."""
        if not isinstance(name, str) or name not in self.program.functions:
            why_missing = self.missing.get(name) if isinstance(name, str) else None
            if why_missing:
                raise OptionError(f"name = {shown(name)}: the export of {self.program.title} lacks this function: {why_missing}")
            raise OptionError(f"name = {shown(name)}: the export of {self.program.title} has no such function; it has "
                              f"{', '.join(self.program.functions)}")
        if self.format in ("c", "fmi"):
            return f"{languages.identifier(self.program.title)}_{name}"
        if self.format == "latex":
            return text.latex_equations(self.program, self.program.functions[name])
        space = self._module(name)
        return (space[f"{name}_steps"], space[name]) if self.format == "sympy" else space[name]

    def _module(self, name: str) -> dict[str, Any]:
        """Names that the Python text of one function alone defines, with their values: formulas of a Jacobian take minutes to
        write, those of forces a second."""
        if name not in self._modules:
            alone = FORMATS[self.format][0](replace(self.program, functions={name: self.program.functions[name]}))
            space: dict[str, Any] = {}
            try:
                exec(compile(alone, f"<{self.program.title}>", "exec"), space)
            except ModuleNotFoundError as missing_package:
                raise OptionError(f"format = '{self.format}': {missing_package}; pip install 'mbdae[{self.format}]'") from None
            self._modules[name] = space
        return self._modules[name]

    @cached_property
    def _modules(self) -> dict[str, dict[str, Any]]:
        """`_module` of the functions that were asked for."""
        return {}


@naming_arguments
def export(what: Any, format: str = "sympy", form: Any = None, frames: Any = None, **options: Any) -> Export:
    """The equations of a scene, or the terms of a law, as text and functions of another system.

    what: a scene, an item of one (its joint), a class of a law (the user's own too), a law with values, or a friction or normal
    law (as a part of the contact of a pin in its race).
    format: "sympy", "c" (C99 and libm), "casadi" (`pip install mbdae[casadi]`), "jax" (`pip install mbdae[jax]`), "latex", or
    "fmi": a unit of FMI 3.0 of a scene without contacts, `.save("x.fmu")`, for which a C compiler is needed.
    form: of a scene, as in `Scene.system`. `mb.Index1(multipliers="eliminated")` gives y' = f(t, y), as units have it.
    frames: of a law, the kinds of its nodes: "spatial", "planar", "point", "ground", ...; by default bodies in space.
    options: of a class of a law, as in `mb.report`.

    Functions of a scene, in SI units and rad; signals are one more argument of each where the scene has some: residual F(t, y,
    y', p), jacobian (entries of dF/dy and dF/dy'), rates y' = f(t, y, p) where the form has it; mass_matrix M, bias h,
    constraint_matrix G and gamma of M u' + h + G^T lambda = 0, G u' + gamma = 0; sensors (coordinates of joints, motions of
    bodies), joint_forces (force on body l, N, and torque about the joint, N m, of every item).
    p: parameters of the laws by "item.name" and points of joints on their bodies; directions of axes, and all of beams, are
    numbers in the text. Switches of inputs of time are evaluated at t.
    Raises OptionError for what cannot be exported, SceneError for a scene with problems."""
    option("format", format, word, "give one of them", words=FORMATS)
    if isinstance(what, SceneData):
        if frames is not None or options:
            name = "frames" if frames is not None else next(iter(options))
            raise OptionError(f"{name} is an option for classes of laws, such as mb.Revolute; a scene takes form= instead")
        own = form_of(form) if form is not None else None
        if format == "fmi":
            program = fmi.unit_program(what, own)
        else:
            program, _ = scene_program(what, own)
            program.drop_parameters()
    elif form is not None:
        raise OptionError(f"form = {shown(form)}: only a scene has a form; leave it out for a law")
    elif format == "fmi":
        raise OptionError("format = 'fmi': only a scene moves by itself, as a unit has to; export a law as 'c'")
    else:
        program = law_program(what.joint if isinstance(what, Connection) else what, frames, options)
    # a unit has further functions and a direction of change, which its own C code alone calls
    functions = {name: f for name, f in program.functions.items() if format != "fmi" or name in fmi.FUNCTIONS}
    inputs = {name: entries for name, entries in program.inputs.items() if name != "change"}
    inputs |= {} if "x" in inputs else {"signals": inputs.get("signals", ())}
    return Export(format, program, inputs, {name: f.outputs for name, f in functions.items()},
                  {name: f.arguments for name, f in functions.items()}, program.pattern, program.missing)
