"""`mbdae.export`: the equations of a scene or of a law as C, CasADi, SymPy or LaTeX."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import OptionError, naming_arguments
from mbdae.export import languages, text
from mbdae.export.law import law_program
from mbdae.export.program import Entry, Program
from mbdae.export.scene import scene_program
from mbdae.files import write_file
from mbdae.formulations import form_of
from mbdae.notation import rows, titled
from mbdae.scene.components import Connection
from mbdae.scene.scene import SceneData
from mbdae.values import option, shown, word
from mbdae.values import path as path_named

__all__ = ["Entry", "Export", "export"]

#: format -> function that writes it, and suffix of its files
FORMATS = {"sympy": (text.sympy_text, ".py"), "c": (languages.source, ".c"), "casadi": (text.casadi_text, ".py"),
           "latex": (text.latex_text, ".tex")}


@dataclass(frozen=True, repr=False)
class Export:
    """Equations in the language of another system, made by `mb.export`.

    inputs      {name of an input vector: entries with name, unit and value}: of a scene "t" (s), "y", "yp" (at the start) and "p"
                (parameters, with the values of the scene), "signals" (those that are numbers, with these; empty where there are
                none); of a law "x" (unknowns of its frames, multipliers, states) and "p"
    outputs     {function: entries with name and unit}, in the order of its outputs; arguments: {function: names of its inputs}
    pattern     rows and columns (nnz,) of the entries of the Jacobian, column by column; None for a law
    missing     {function: reason}, for those that the scene does not have in this form
    text        the whole file; header: the declarations in C, with all names and units

    `export["residual"]` is one function: in SymPy (steps, outputs) as `sympy.cse` returns them, a `casadi.Function`, in C the
    name by which it is called, in LaTeX its equations."""

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
        suffix is that of another format or the file cannot be written."""
        suffix = FORMATS[self.format][1]
        named: Path = option("path", path, path_named, f"give the name of a file that ends in {suffix}")
        if named.suffix != suffix:
            raise OptionError(f"path = '{named}': a file of format '{self.format}' ends in {suffix}; name it so")
        if self.format == "c":
            write_file(named.with_suffix(".h"), self.header)
        return write_file(named, self.text)

    def __getitem__(self, name: str) -> Any:
        """One function by its name; OptionError where there is none, or where CasADi is not installed."""
        if not isinstance(name, str) or name not in self.program.functions:
            why_missing = self.missing.get(name) if isinstance(name, str) else None
            if why_missing:
                raise OptionError(f"name = {shown(name)}: the export of {self.program.title} lacks this function: {why_missing}")
            raise OptionError(f"name = {shown(name)}: the export of {self.program.title} has no such function; it has "
                              f"{', '.join(self.program.functions)}")
        if self.format == "c":
            return f"{languages.identifier(self.program.title)}_{name}"
        if self.format == "latex":
            return text.latex_equations(self.program, self.program.functions[name])
        return self._module[name] if self.format == "casadi" else (self._module[f"{name}_steps"], self._module[name])

    @cached_property
    def _module(self) -> dict[str, Any]:
        """Names that the exported Python text defines, with their values."""
        space: dict[str, Any] = {}
        try:
            exec(compile(self.text, f"<{self.program.title}>", "exec"), space)
        except ModuleNotFoundError as missing_package:
            raise OptionError(f"format = 'casadi': {missing_package}; pip install 'mbdae[casadi]'") from None
        return space


@naming_arguments
def export(what: Any, format: str = "sympy", form: Any = None, frames: Any = None, **options: Any) -> Export:
    """The equations of a scene, or the terms of a law, as text and functions of another system.

    what: a scene, an item of one (its joint), a class of a law (the user's own too), a law with values, or a friction or normal
    law (as a part of the contact of a pin in its race).
    format: "sympy", "c" (C99 and libm), "casadi" (`pip install mbdae[casadi]`) or "latex".
    form: of a scene, as in `Scene.system`. `mb.Index1(multipliers="eliminated")` gives y' = f(t, y).
    frames: of a law, the kinds of its nodes: "spatial", "planar", "point", "ground", ...; by default bodies in space.
    options: of a class of a law, as in `mb.report`.

    Functions of a scene, in SI units and rad; signals are one more argument of each where the scene has some: residual F(t, y,
    y', p), jacobian (entries of dF/dy and dF/dy'), rates
    y' = f(t, y, p) where the form has it, joint_forces (force on body l, N, and torque about the joint, N m, of every item).
    p: parameters of the laws by "item.name" and points of joints on their bodies; directions of axes, and all of beams, are
    numbers in the text. Switches of inputs of time are evaluated at t.
    Raises OptionError for what cannot be exported, SceneError for a scene with problems."""
    option("format", format, word, "give one of them", words=FORMATS)
    if isinstance(what, SceneData):
        if frames is not None or options:
            name = "frames" if frames is not None else next(iter(options))
            raise OptionError(f"{name} is an option for classes of laws, such as mb.Revolute; a scene takes form= instead")
        program = scene_program(what, form_of(form) if form is not None else None)
    elif form is not None:
        raise OptionError(f"form = {shown(form)}: only a scene has a form; leave it out for a law")
    else:
        program = law_program(what.joint if isinstance(what, Connection) else what, frames, options)
    functions = program.functions.items()
    inputs = program.inputs if "x" in program.inputs else {**program.inputs, "signals": program.inputs.get("signals", ())}
    return Export(format, program, inputs, {name: f.outputs for name, f in functions},
                  {name: f.arguments for name, f in functions}, program.pattern, program.missing)
