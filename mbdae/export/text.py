"""Exported functions as text: Python modules for SymPy and CasADi, and LaTeX."""

from __future__ import annotations

from typing import Any

import symengine as se

from mbdae.documents.blocks import Block, Equation, Paragraph, Section, Table
from mbdae.documents.document import Document
from mbdae.documents.formulas import escaped, extent
from mbdae.documents.latex import WIDEST, displayed
from mbdae.documents.tex import plain
from mbdae.export.languages import CASADI, SYMPY, described
from mbdae.export.program import Function, Program
from mbdae.export.symbolic import Derivation, derivation
from mbdae.reports.letters import unit_text
from mbdae.reports.vectors import Record
from mbdae.reports.writer import Writer
from mbdae.symbolic.rebuild import rebuilt
from mbdae.symbolic.source import Language, written


def _written(d: Derivation, language: Language) -> tuple[list[tuple[str, str]], list[str]]:
    """Steps and outputs of a function as text, with inputs y[0], ... and names w[0], ..."""
    names = {s: "t" if v == "t" else f"{v}[{i}]" for v, symbols in d.vectors.items() for i, s in enumerate(symbols)}
    names |= {name: f"w[{i}]" for i, (name, _) in enumerate(d.steps)}
    return [(names[name], written(e, names, language)) for name, e in d.steps], [written(e, names, language) for e in d.outputs]


def _head(program: Program, library: str) -> list[str]:
    """First lines of a Python module: docstring with all names and units, values of the inputs, pattern of the Jacobian."""
    about = [line for vector, entries in program.inputs.items() if vector != "t" for line in (f"{vector}:", *described(entries))]
    about += [line for f in program.functions.values() if f.name != "jacobian"
              for line in (f"{f.name}({', '.join(f.arguments)}): {f.meaning}", *described(f.outputs))]  # fmt: skip
    text = "\n".join([f"{program.title}. SI units, angles in rad. Written by mbdae.", "", *about])
    text = text.replace("\\", "/").replace('"""', "'''")
    lines = [f'"""{text}\n"""', "", f"from {library} import *", 'nan = float("nan")']
    lines += [f"{vector}_values = {[e.value for e in entries]!r}" for vector, entries in program.inputs.items()]
    if program.pattern is not None:
        lines += [f"{name} = {table.tolist()!r}" for name, table in zip(("rows", "columns"), program.pattern, strict=True)]
    return lines


def sympy_text(program: Program) -> str:
    """A module that defines for every function `<name>_steps`, pairs (symbol, expression), and `<name>`, the outputs, as
    sympy.cse returns them."""
    made = {f.name: _written(derivation(program, f), SYMPY) for f in program.functions.values()}
    lines = [*_head(program, "sympy"), 't = Symbol("t")']
    lines += [f'{v} = symbols("{v}:{len(entries)}")' for v, entries in program.inputs.items() if v != "t"]
    lines.append(f'w = symbols("w:{max((len(steps) for steps, _ in made.values()), default=0)}")')
    for name, (steps, outputs) in made.items():
        lines += ["", f"{name}_steps = [", *(f"({w}, {e})," for w, e in steps), "]", f"{name} = Matrix([",
                  *(f"{e}," for e in outputs), "])"]  # fmt: skip
    return "\n".join([*lines, ""])


def casadi_text(program: Program) -> str:
    """A module with a casadi.Function for every function; `jacobian` of a scene returns two sparse matrices."""
    lines = [*_head(program, "casadi"), 't = SX.sym("t")']
    lines += [f'{v} = SX.sym("{v}", {len(entries)})' for v, entries in program.inputs.items() if v != "t"]
    for f in program.functions.values():
        steps, outputs = _written(derivation(program, f), CASADI)
        lines += ["", "w = []", *(f"w.append({e})" for _, e in steps), "out = vertcat(", *(f"{e}," for e in outputs), ")"]
        results, names = "out", ["out"]
        if f.name == "jacobian" and program.pattern is not None:
            n, count = len(program.inputs["y"]), len(program.pattern[0])
            lines.append(f"pattern = Sparsity.triplet({n}, {n}, rows, columns)")
            results, names = f"SX(pattern, out[:{count}]), SX(pattern, out[{count}:])", ["fy", "fyp"]
        arguments = ", ".join(f.arguments)
        lines.append(f'{f.name} = Function("{f.name}", [{arguments}], [{results}], {list(f.arguments)!r}, {names!r})')
    return "\n".join([*lines, ""])


# -- LaTeX


def latex_text(program: Program) -> str:
    """A document with tables of the inputs and the equations of every function, long equations broken to the text width."""
    blocks: list[Block] = [Paragraph("SI units, angles in rad.")]
    for vector, entries in program.inputs.items():
        if vector != "t" and entries:
            rows = [[f"${_letter(vector, i)}$", _words(e.name), unit_text(e.unit) or "-"] for i, e in enumerate(entries)]
            blocks.append(Table(["symbol", "name", "unit"], rows))
    for f in program.functions.values():
        blocks.append(Section(_words(f"{f.name}: {f.meaning}"), [Equation(line) for line in _equations(program, f)]))
    return Document(_words(program.title), blocks).to_latex()


def latex_equations(program: Program, f: Function) -> list[str]:
    """The equations of a function, each in a display of its own."""
    return [f"\\[{displayed(line)}\\]" for line in _equations(program, f)]


def _equations(program: Program, f: Function) -> list[str]:
    """Equations of names and outputs. A sum inside a formula that would take half a line gets a name v of its own."""
    d, lines, parts = derivation(program, f), list[str](), dict[Any, Any]()
    names = {str(s): _letter(vector, i) for vector, symbols in d.vectors.items() for i, s in enumerate(symbols)}
    names |= {str(s): f"w_{{{i}}}" for i, (s, _) in enumerate(d.steps)}
    writer = Writer(Record(), names)
    left = [*(names[str(s)] for s, _ in d.steps), *(f"\\text{{{plain(e.name)}}}" for e in f.outputs)]

    def parted(whole: Any) -> Any:
        def rule(node: Any, args: list[Any]) -> Any:
            inside = se.Add(*args) if isinstance(node, se.Add) and node != whole else None
            if inside is None or extent(text := writer.scalar(inside)) < WIDEST / 2:
                return inside
            if inside not in parts:
                names[f"v{len(parts)}"] = f"v_{{{len(parts)}}}"
                parts[inside] = se.Symbol(f"v{len(parts)}")
                lines.append(f"{names[str(parts[inside])]} = {text}")
            return parts[inside]

        return rebuilt(whole, rule)

    for a, e in zip(left, (*(e for _, e in d.steps), *d.outputs), strict=True):
        short = parted(se.sympify(e))
        lines.append(f"{a} = {writer.scalar(short)}")
    return lines


def _words(text: str) -> str:
    """Text with dollar signs and backquotes escaped."""
    return escaped(text.replace("`", "'"))


def _letter(vector: str, i: int) -> str:
    letter = {"yp": r"\dot{y}", "signals": "u"}.get(vector, vector)
    return "t" if vector == "t" else f"{letter}_{{{i}}}"
