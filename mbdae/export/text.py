"""Exported functions as text: Python modules for SymPy and CasADi, and LaTeX."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.documents import WIDEST, Document, displayed
from mbdae.documents.blocks import Block, Equation, Paragraph, Section, Table, escaped, extent
from mbdae.documents.mathml import plain
from mbdae.errors import OptionError
from mbdae.export.languages import CASADI, SYMPY, described
from mbdae.export.program import Function, Program, reach, run, weights
from mbdae.native.program import ADD, CALL, CHOLESKY, LOAD, LOOKUP, LU, MULTIPLY, SET, Step
from mbdae.reports.letters import unit_text
from mbdae.reports.vectors import NamedQuantities
from mbdae.reports.writer import Writer
from mbdae.symbolic.program import Language, reached, written
from mbdae.symbolic.rebuild import rebuilt
from mbdae.symbolic.vectors import Expr

# -- The operations of a function applied to symbols instead of numbers: a sequence of named expressions

ZERO = se.Integer(0)
#: the diagonal entry is the pivot if it has at least this part of the largest entry from it downwards in its column: fewer rows
#: change places
DIAGONAL = 0.1


class Derivation(NamedTuple):
    """A function in symbols. steps: (name, expression of inputs and earlier names); outputs: expressions of inputs and names;
    vectors: symbols of the inputs, by vector."""

    steps: list[tuple[Expr, Expr]]
    outputs: list[Expr]
    vectors: dict[str, list[Expr]]


def derivation(program: Program, function: Function) -> Derivation:
    """A function in symbols t, y0, y1, ..., p0, ..., with intermediate names w0, w1, ...

    Matrices are solved by Gauss elimination, with pivots chosen at the values of the inputs."""
    vectors = {name: [se.Symbol("t" if name == "t" else f"{name}{i}") for i in range(len(program.inputs[name]))]
               for name in function.arguments}
    found = _Symbols(program, function, vectors)
    outputs = [se.sympify(found.at(slot)) for slot in function.at]
    return Derivation(reached(found.steps, outputs), outputs, vectors)


def matrix_of(step: Step, at: Callable[[int], Any], zero: Any) -> list[list[Any]]:
    """The matrix of an operation that solves a linear system: full (LU), or symmetric and stored as its lower band (Cholesky).
    at: function that returns the number or expression in a slot; zero: entry outside of the band."""
    n, first, width = step.fields["count"], step.fields["first"], step.fields.get("inputs", 0)
    if step.fields["kind"] == LU:
        return [[at(first + i * n + j) for j in range(n)] for i in range(n)]
    return [[at(first + max(i, j) * width + width - 1 - abs(i - j)) if abs(i - j) < width else zero for j in range(n)]
            for i in range(n)]


def _pivots(program: Program, function: Function) -> Iterator[list[int]]:
    """The pivot rows of every matrix at the values of the inputs: diagonal entries unless they are small, else the largest entry
    of the column."""
    W = program.given({name: np.nan_to_num([e.value for e in program.inputs[name]]) for name in function.arguments})
    done = 0
    for number, step in enumerate(function.steps):
        if step.fields["kind"] in (CHOLESKY, LU):
            run(function.steps[done:number], W)
            A, order, done = np.array(matrix_of(step, W.item, 0.0)), list[int](), number
            for k in range(len(A)):
                sizes = np.abs(A[k:, k])
                if not sizes.max() > 0:
                    raise OptionError("what: the masses or constraints of the scene are singular at its start, where its "
                                      "accelerations have no formula; export format='c', which chooses its pivots as it "
                                      "runs")
                order.append(k if sizes[0] >= DIAGONAL * sizes.max() else k + int(np.argmax(sizes)))
                A[[k, order[-1]]] = A[[order[-1], k]]
                A[k + 1 :] -= np.outer(A[k + 1 :, k] / A[k, k], A[k])
            yield order


class _Symbols:
    """Applies the operations to expressions, with names (`steps`) for everything that is used more than once."""

    def __init__(self, program: Program, function: Function, vectors: dict[str, list[Expr]]) -> None:
        self.steps: list[tuple[Expr, Expr]] = []
        self.known: dict[Expr, Expr] = {}
        self.W = {slot: vectors[name][entry] for name in function.arguments for entry, slot in program.slots[name].tolist()}
        pivots = _pivots(program, function)
        for step in function.steps:
            f, kind = step.fields, step.fields["kind"]
            if kind == CALL:
                self._call(f, step.tables["from_"].reshape(f["times"], -1))
            elif kind == LOOKUP:
                raise OptionError("what: the scene has a table (mb.table), which is no formula; export format='c' or 'jax', "
                                  "which hold its points")
            elif kind == LOAD:
                self.W |= {f["first"] + i: _number(value) for i, value in enumerate(step.tables["weight"])}
            elif kind in (SET, ADD, MULTIPLY):
                self._map(step, kind)
            elif kind in (CHOLESKY, LU):
                self._solve(f, matrix_of(step, self.at, ZERO), next(pivots))

    def at(self, slot: Any) -> Expr:
        """The expression in a slot."""
        return self.W.get(int(slot), ZERO)

    def name(self, value: Expr) -> Expr:
        """A name for an expression that is used more than once; numbers and symbols are kept."""
        if value.is_Number or isinstance(value, se.Symbol):
            return value
        if value not in self.known:
            self.known[value] = se.Symbol(f"w{len(self.steps)}")
            self.steps.append((self.known[value], value))
        return self.known[value]

    def _call(self, f: dict[str, Any], gather: Any) -> None:
        for r, row in enumerate(gather):
            table = {symbol: self.name(self.at(slot)) for symbol, slot in zip(f["kernel"].symbols, row, strict=True)}
            shared, outputs = se.cse([se.sympify(f["kernel"].expressions[o]) for o in f["used"]])
            for symbol, value in shared:
                table[symbol] = self.name(_bare(value, table))
            first = f["first"] + r * f["outputs"]
            self.W |= {first + o: _bare(e, table) for o, e in zip(f["used"], outputs, strict=True)}

    def _map(self, step: Step, kind: int) -> None:
        to, from_ = reach(step, "to"), reach(step, "from_")
        factors = np.broadcast_to(weights(step), to.shape)
        by = reach(step, "by") if kind == MULTIPLY else None
        for place in np.ndindex(to.shape):
            value = self.at(from_[place])
            if by is not None:
                value = self.name(value) * self.name(self.at(by[place]))
            self.W[int(to[place])] = value if kind == SET else self.at(to[place]) + _number(factors.item(place)) * value

    def _solve(self, f: dict[str, Any], A: list[list[Expr]], order: list[int]) -> None:
        """Solve A x = b by Gauss elimination for all right-hand sides."""
        n, times = f["count"], f["times"]
        rows = [[*map(self.name, row), *(self.at(f["outputs"] + r * n + i) for r in range(times))] for i, row in enumerate(A)]
        for k, best in enumerate(order):
            rows[k], rows[best] = rows[best], rows[k]
            for row in rows[k + 1 :]:
                if row[k] != ZERO:
                    factor = self.name(row[k] / rows[k][k])
                    pairs = zip(row[k:], rows[k][k:], strict=True)
                    row[k:] = [self.name(a - factor * b) if b != ZERO else a for a, b in pairs]
        for r in range(n, n + times):
            for k in reversed(range(n)):
                rest = sum((rows[k][j] * rows[j][r] for j in range(k + 1, n) if rows[k][j] != ZERO and rows[j][r] != ZERO), ZERO)
                rows[k][r] = self.name((rows[k][r] - rest) / rows[k][k])
                self.W[f["outputs"] + (r - n) * n + k] = rows[k][r]


def _number(value: float) -> Expr:
    return se.Integer(int(value)) if value == int(value) else se.RealDouble(float(value))


def _bare(e: Expr, table: dict[Expr, Expr]) -> Expr:
    """The expression with symbols replaced by the names in `table`, without the UnevaluatedExpr around shared subexpressions."""
    return rebuilt(e, lambda node, args: args[0] if type(node).__name__ == "UnevaluatedExpr" else table.get(node))


def _written(d: Derivation, language: Language) -> tuple[list[tuple[str, str]], list[str]]:
    """Steps and outputs of a function as text, with inputs y[0], ... and names w[0], ..."""
    names = {s: "t" if v == "t" else f"{v}[{i}]" for v, symbols in d.vectors.items() for i, s in enumerate(symbols)}
    names |= {name: f"w[{i}]" for i, (name, _) in enumerate(d.steps)}
    return [(names[name], written(e, names, language)) for name, e in d.steps], [written(e, names, language) for e in d.outputs]


def head(program: Program, library: str) -> list[str]:
    """First lines of a Python module: docstring with all names and units, values of the inputs, pattern of the Jacobian."""
    about = [line for vector, entries in program.inputs.items() if vector != "t" for line in (f"{vector}:", *described(entries))]
    about += [line for f in program.functions.values() if f.name != "jacobian"
              for line in (f"{f.name}({', '.join(f.arguments)}): {f.meaning}", *described(f.outputs))]
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
    lines = [*head(program, "sympy"), 'gamma_function, t = gamma, Symbol("t")']
    lines += [f'{v} = symbols("{v}:{len(entries)}")' for v, entries in program.inputs.items() if v != "t"]
    lines.append(f'w = symbols("w:{max((len(steps) for steps, _ in made.values()), default=0)}")')
    for name, (steps, outputs) in made.items():
        size = "".join(f"{n}, " for n in program.functions[name].shape)
        lines += ["", f"{name}_steps = [", *(f"({w}, {e})," for w, e in steps), "]", f"{name} = Matrix({size}[",
                  *(f"{e}," for e in outputs), "])"]
    return "\n".join([*lines, ""])


def casadi_text(program: Program) -> str:
    """A module with a casadi.Function for every function; `jacobian` of a scene returns two sparse matrices."""
    lines = [*head(program, "casadi"), 't = SX.sym("t")']
    lines += [f'{v} = SX.sym("{v}", {len(entries)})' for v, entries in program.inputs.items() if v != "t"]
    for f in program.functions.values():
        steps, outputs = _written(derivation(program, f), CASADI)
        lines += ["", "w = []", *(f"w.append({e})" for _, e in steps), "out = vertcat(", *(f"{e}," for e in outputs), ")"]
        results, names = f"reshape(out, {f.shape[1]}, {f.shape[0]}).T" if f.shape else "out", ["out"]
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
        noted = [Paragraph(_words(f"{e.name}: {e.note}.")) for e in f.outputs if e.note]
        blocks.append(Section(_words(f"{f.name}: {f.meaning}"), [*noted, *map(Equation, _equations(program, f))]))
    return Document(_words(program.title), blocks).to_latex()


def latex_equations(program: Program, f: Function) -> list[str]:
    """The equations of a function, each in a display of its own."""
    return [f"\\[{displayed(line)}\\]" for line in _equations(program, f)]


def _equations(program: Program, f: Function) -> list[str]:
    """Equations of names and outputs. A sum inside a formula that would take half a line gets a name v of its own."""
    d, lines, parts = derivation(program, f), list[str](), dict[Any, Any]()
    names = {str(s): _letter(vector, i) for vector, symbols in d.vectors.items() for i, s in enumerate(symbols)}
    names |= {str(s): f"w_{{{i}}}" for i, (s, _) in enumerate(d.steps)}
    writer = Writer(NamedQuantities(), names)
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
        lines.append(f"{a} = {writer.scalar(parted(se.sympify(e)))}")
    return lines


def _words(text: str) -> str:
    """Text with dollar signs and backquotes escaped."""
    return escaped(text.replace("`", "'"))


def _letter(vector: str, i: int) -> str:
    letter = {"yp": r"\dot{y}", "signals": "u"}.get(vector, vector)
    return "t" if vector == "t" else f"{letter}_{{{i}}}"
