"""Derivations as text: modules of Python for SymPy and CasADi, LaTeX."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import symengine as se

from mbdae.export.program import Entry, Function, Program
from mbdae.export.symbolic import Derivation, derivation
from mbdae.symbolic.source import Language, called, written
from mbdae.symbolic.vectors import Expr

PLAIN = ("sin", "cos", "tan", "sinh", "cosh", "tanh", "asin", "acos", "atan", "asinh", "acosh", "atanh", "atan2", "log", "floor",
         "sign", "erf")  # fmt: skip


def _number(e: Expr) -> str:
    return f"({e})" if isinstance(e, se.Integer) else repr(float(e))


def _rational(e: Expr) -> str:
    return f"Rational({e.p}, {e.q})" if isinstance(e, se.Rational) and not isinstance(e, se.Integer) else _named(e) or _number(e)


def _named(e: Expr) -> str:
    return {se.pi: "pi", se.E: "E"}.get(e, "")


def _power(base: Expr, text: str, exponent: Expr, power: str) -> str:
    if base == se.E:
        return f"exp({power})"
    half = exponent.is_Number and abs(exponent) == se.Rational(1, 2)
    return f"sqrt({text}) ** {'1' if exponent > 0 else '(-1)'}" if half else f"({text} ** {power})"


def _pairs(*args: str) -> str:
    return f"Piecewise({', '.join(f'({value}, {condition})' for value, condition in zip(args[::2], args[1::2], strict=True))})"


def _chosen(*args: str) -> str:
    return f"if_else({args[1]}, {args[0]}, {_chosen(*args[2:])})" if len(args) > 1 else "nan"


def _infix(operator: str) -> Any:
    return lambda a, b: f"({a} {operator} {b})"


def _folded(name: str) -> Any:
    def write(*args: str) -> str:
        return args[0] if len(args) == 1 else f"{name}({args[0]}, {write(*args[1:])})"

    return write


_BOTH: dict[str, Any] = {name: called(name) for name in PLAIN}
SYMPY = Language(_rational, lambda b, t, e, p: f"({_power(b, t, e, p)})", _BOTH | {
    **{name: called(name) for name in ("Abs", "ceiling", "erfc", "gamma", "loggamma", "Max", "Min", "And", "Or", "Not")},
    "Piecewise": _pairs, "StrictLessThan": _infix("<"), "LessThan": _infix("<="), "Equality": called("Eq"),
    "Unequality": called("Ne"), "BooleanTrue": lambda: "True", "BooleanFalse": lambda: "False",
})  # fmt: skip
CASADI = Language(_number, lambda b, t, e, p: f"({_power(b, t, e, p)})", _BOTH | {
    "Abs": called("fabs"), "ceiling": called("ceil"), "erfc": lambda a: f"(1 - erf({a}))", "Max": _folded("fmax"),
    "Min": _folded("fmin"), "And": _folded("logic_and"), "Or": _folded("logic_or"), "Not": called("logic_not"), "Piecewise": _chosen,
    "StrictLessThan": _infix("<"), "LessThan": _infix("<="), "Equality": _infix("=="), "Unequality": _infix("!="),
    "BooleanTrue": lambda: "1", "BooleanFalse": lambda: "0",
})  # fmt: skip


def described(entries: Sequence[Entry]) -> list[str]:
    """One line for each entry: number, name, unit, value."""
    return [f"[{i}] {e.name}{f', {e.unit}' if e.unit else ''}{'' if e.value != e.value else f' = {e.value!r}'}"
            for i, e in enumerate(entries)]  # fmt: skip


def _names(d: Derivation) -> dict[Expr, str]:
    names = {s: "t" if vector == "t" else f"{vector}[{i}]" for vector, symbols in d.vectors.items() for i, s in enumerate(symbols)}
    return names | {name: f"w[{i}]" for i, (name, _) in enumerate(d.steps)}


def _head(program: Program, library: str) -> list[str]:
    """Docstring with all names and units, and the values of the inputs."""
    about = [line for vector, entries in program.inputs.items() if vector != "t" for line in (f"{vector}:", *described(entries))]
    about += [line for f in program.functions.values() if f.name != "jacobian"
              for line in (f"{f.name}({', '.join(f.arguments)}): {f.meaning}", *described(f.outputs))]  # fmt: skip
    text = "\n".join([f"{program.title}. SI units, angles in rad. Written by mbdae.", "", *about]).replace("\\", "\\\\")
    lines = ['"""' + text.replace('"""', "'''") + '\n"""', "", f"from {library} import *", 'nan = float("nan")', ""]
    for vector, entries in program.inputs.items():
        lines.append(f"{vector}_values = {[e.value for e in entries]!r}")
    if program.pattern is not None:
        lines += [f"{name} = {table.tolist()!r}" for name, table in zip(("rows", "columns"), program.pattern, strict=True)]
    return lines


def sympy_text(program: Program) -> str:
    """A module that defines for every function `<name>_steps`, pairs of a symbol and its expression, and `<name>`, the outputs: as
    sympy.cse returns them."""
    made = {f.name: derivation(program, f) for f in program.functions.values()}
    lines = [*_head(program, "sympy"), 't = Symbol("t")']
    lines += [f'{v} = symbols("{v}:{len(entries)}")' for v, entries in program.inputs.items() if v != "t"]
    lines.append(f'w = symbols("w:{max((len(d.steps) for d in made.values()), default=0)}")')
    for name, d in made.items():
        names = _names(d)
        steps = [f"({names[s]}, {written(e, names, SYMPY)})," for s, e in d.steps]
        lines += ["", f"{name}_steps = [", *steps, "]", f"{name} = Matrix([", *(f"{written(e, names, SYMPY)}," for e in d.outputs), "])"]
    return "\n".join([*lines, ""])


def casadi_text(program: Program) -> str:
    """A module that defines a casadi.Function for every function; `jacobian` returns two sparse matrices."""
    lines = [*_head(program, "casadi"), 't = SX.sym("t")']
    lines += [f'{v} = SX.sym("{v}", {len(entries)})' for v, entries in program.inputs.items() if v != "t"]
    for f in program.functions.values():
        d = derivation(program, f)
        names = _names(d)
        lines += ["", "w = []", *(f"w.append({written(e, names, CASADI)})" for _, e in d.steps), "out = vertcat(",
                  *(f"{written(e, names, CASADI)}," for e in d.outputs), ")"]  # fmt: skip
        lines += _casadi_function(program, f)
    return "\n".join([*lines, ""])


def _casadi_function(program: Program, f: Function) -> list[str]:
    begin = f'{f.name} = Function("{f.name}", [{", ".join(f.arguments)}]'
    if f.name != "jacobian" or program.pattern is None:
        return [f'{begin}, [out], {list(f.arguments)!r}, ["out"])']
    n, count = len(program.inputs["y"]), len(program.pattern[0])
    return [f"pattern = Sparsity.triplet({n}, {n}, rows, columns)",
            f'{begin}, [SX(pattern, out[:{count}]), SX(pattern, out[{count}:])], {list(f.arguments)!r}, ["fy", "fyp"])']


# -- LaTeX


def latex_name(name: str) -> str:
    """A name of the scene as an upright symbol."""
    plain = name.replace("\\", r"\backslash ")
    for special in "_#%&$":
        plain = plain.replace(special, f"\\{special}")
    return f"\\mathrm{{{plain.replace(' ', chr(92) + ' ')}}}"


def latex_text(program: Program) -> str:
    """A document with a table of the inputs and the equations of every function, one a line."""
    lines = [r"\documentclass{article}", r"\usepackage{amsmath,longtable}", r"\begin{document}", f"\\section*{{{_plain(program.title)}}}",
             "SI units, angles in rad."]  # fmt: skip
    for vector, entries in program.inputs.items():
        if vector != "t":
            lines += [r"\begin{longtable}{lll}", *(f"${_letter(vector, i)}$ & {_plain(e.name)} & {_plain(e.unit)} \\\\"
                                                    for i, e in enumerate(entries)), r"\end{longtable}"]  # fmt: skip
    for f in program.functions.values():
        lines += [f"\\subsection*{{{_plain(f.name)}: {_plain(f.meaning)}}}", *latex_equations(program, f)]
    return "\n".join([*lines, r"\end{document}", ""])


def latex_equations(program: Program, f: Function) -> list[str]:
    """The equations of a function, each in displayed mathematics of its own."""
    import sympy

    d = derivation(program, f)
    names = {sympy.Symbol(str(s)): "t" if v == "t" else _letter(v, i) for v, symbols in d.vectors.items() for i, s in enumerate(symbols)}
    names |= {sympy.Symbol(str(s)): f"w_{{{i}}}" for i, (s, _) in enumerate(d.steps)}
    left = [f"w_{{{i}}}" for i in range(len(d.steps))] + [latex_name(e.name) for e in f.outputs]
    right = [sympy.latex(sympy.sympify(e), symbol_names=names) for e in (*(e for _, e in d.steps), *d.outputs)]
    return [f"\\[{a} = {b}\\]" for a, b in zip(left, right, strict=True)]


def _letter(vector: str, i: int) -> str:
    return f"\\dot{{y}}_{{{i}}}" if vector == "yp" else f"{vector}_{{{i}}}"


def _plain(text: str) -> str:
    """Text of a document."""
    for special in "\\_#%&$^{}":
        text = text.replace(special, {"\\": "/", "^": r"\^{}"}.get(special, f"\\{special}"))
    return text
