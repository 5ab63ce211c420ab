"""Expressions in the syntax of C, CasADi and SymPy, and descriptions of inputs and outputs; a program as C99."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import symengine as se

import mbdae.native
from mbdae.export.program import Entry, Function, Program, weights
from mbdae.native.program import CALL, CHOLESKY, LOAD, LOOKUP, LU, POSITIVE, SET, SOLVE, Step
from mbdae.symbolic.program import Language, called, steps
from mbdae.symbolic.vectors import Expr


def _infix(operator: str) -> Callable[..., str]:
    return lambda *args: f"({f' {operator} '.join(args)})"


def _calls(names: str) -> dict[str, Callable[..., str]]:
    """Writers of functions by name. names: separated by blanks, "Abs=fabs" where the language has another name than symengine."""
    return {own: called(theirs or own) for own, _, theirs in (name.partition("=") for name in names.split())}


#: functions and relations with equal syntax in C, CasADi and SymPy (_EQUAL); with them those common to C and CasADi (_NUMERIC)
_EQUAL = _calls("sin cos tan sinh cosh tanh asin acos atan asinh acosh atanh atan2 log floor sign erf") | {
    "StrictLessThan": _infix("<"), "LessThan": _infix("<=")}
_NUMERIC = _EQUAL | {"Equality": _infix("=="), "Unequality": _infix("!="), "BooleanTrue": lambda: "1",
                     "BooleanFalse": lambda: "0"}


def _folded(name: str) -> Callable[..., str]:
    """Writer of a function of many arguments, such as Max, by nested calls of the function `name` of two arguments."""

    def write(*args: str) -> str:
        return args[0] if len(args) == 1 else f"{name}({args[0]}, {write(*args[1:])})"

    return write


def _chosen(form: str, none: str) -> Callable[..., str]:
    """Writer of a Piecewise (value, condition, value, ...) by nested choices between two values. form: pattern of value,
    condition and other value; none: text of the value where no condition holds."""

    def write(*args: str) -> str:
        return form.format(args[0], args[1], write(*args[2:])) if args else none

    return write


def _pairs(*args: str) -> str:
    return f"Piecewise({', '.join(f'({value}, {condition})' for value, condition in zip(args[::2], args[1::2], strict=True))})"


def c_number(e: Any) -> str:
    """A number as a double of C."""
    text = repr(float(e))
    return {"inf": "INFINITY", "-inf": "(-INFINITY)", "nan": "NAN"}.get(text, f"({text})" if text.startswith("-") else text)


def _power(one: str, general: str, square: bool) -> Callable[[Expr, str, Expr, str], str]:
    """Writer of powers: square roots and exp by functions, all others by the pattern `general` of base and exponent. one: text of
    the number 1; square: whether squares are written as products and inverses as quotients."""

    def write(base: Expr, text: str, exponent: Expr, power: str) -> str:
        if base == se.E:
            return f"exp({power})"
        if exponent.is_Number and (abs(exponent) == se.Rational(1, 2) or (square and abs(exponent) == 1)):
            found = text if abs(exponent) == 1 else f"sqrt({text})"
            return found if exponent > 0 else f"({one} / {found})"
        plain = square and exponent == 2 and text.replace("[", "").replace("]", "").isidentifier()
        return f"({text} * {text})" if plain else general.format(text, power)

    return write


def _sympy_number(e: Expr) -> str:
    named = {se.pi: "pi", se.E: "E"}.get(e)
    whole = f"({e})" if isinstance(e, se.Integer) else f"Rational({e.p}, {e.q})" if isinstance(e, se.Rational) else ""
    return named or whole or repr(float(e))


C = Language(c_number, _power("1.0", "pow({0}, {1})", True), _NUMERIC | _calls(
    "Abs=fabs ceiling=ceil erfc gamma=tgamma loggamma=lgamma Not=!") | {
    "Max": _folded("fmax"), "Min": _folded("fmin"), "UnevaluatedExpr": lambda a: a, "And": _infix("&&"), "Or": _infix("||"),
    "Piecewise": _chosen("({1} ? {0} : {2})", "NAN")})
CASADI = Language(lambda e: repr(float(e)), _power("1", "({0} ** {1})", False), _NUMERIC | _calls(
    "Abs=fabs ceiling=ceil Not=logic_not") | {
    "Max": _folded("fmax"), "Min": _folded("fmin"), "erfc": lambda a: f"(1 - erf({a}))", "And": _folded("logic_and"),
    "Or": _folded("logic_or"), "Piecewise": _chosen("if_else({1}, {0}, {2})", 'float("nan")')})
SYMPY = Language(_sympy_number, _power("1", "({0} ** {1})", False), _EQUAL | _calls(
    "Abs ceiling erfc gamma=gamma_function loggamma Max Min And Or Not Equality=Eq Unequality=Ne") | {
    "Piecewise": _pairs, "BooleanTrue": lambda: "True", "BooleanFalse": lambda: "False"})

JAX = Language(lambda e: repr(float(e)), _power("1", "({0} ** {1})", True), _EQUAL | _calls(
    "Abs=abs ceiling=ceil erfc gamma=gamma_function loggamma Not=logical_not") | {
    "Max": _folded("maximum"), "Min": _folded("minimum"), "And": _folded("logical_and"), "Or": _folded("logical_or"),
    "Equality": _infix("=="), "Unequality": _infix("!="), "BooleanTrue": lambda: "True", "BooleanFalse": lambda: "False",
    "UnevaluatedExpr": lambda a: a, "Piecewise": _chosen("where({1}, {0}, {2})", "nan")})


def size_of(f: Function) -> int:
    """Size of the work array of a function."""
    return 1 + max([int(f.at.max(initial=0)), max(f.reads, default=0), *(step.slots[1] for step in f.steps)])


def described(entries: Sequence[Entry]) -> list[str]:
    """One line for each entry: number, name, unit, value, note."""
    return [f"[{i}] {e.name}{e.unit and f', {e.unit}'}{'' if np.isnan(e.value) else f' = {e.value!r}'}{e.note and f' ({e.note})'}"
            for i, e in enumerate(entries)]


# -- A program as C99 that needs only libm: kernels as functions, operations as loops over constant tables


#: an operation for a single instance with at most this many entries is written line by line, every other one as loops
AT_ONCE = 6
ON_STACK = 50_000  #: largest work array (numbers) on the stack; a larger one is static, and its function not thread-safe


SIGN = "static double sign(double x) { return (double)((x > 0.0) - (x < 0.0)); }\n"


def identifier(title: str) -> str:
    """A C identifier with which the names of all functions begin."""
    name = re.sub(r"\W+", "_", title.split(",")[0], flags=re.ASCII).strip("_").lower() or "scene"
    return f"_{name}" if name[0].isdigit() else name


def header(program: Program) -> str:
    """The declarations, with comments on every entry of every vector."""
    name = identifier(program.title)
    lines = [f"/* {_comment(program.title)}. SI units, angles in rad. Functions return 0, 1 where a matrix is singular. */", ""]
    for vector, entries in program.inputs.items():
        if vector != "t":
            lines += [f"#define {name.upper()}_{vector.upper()} {len(entries)}", f"/* {vector}:", *_listed(entries), "*/"]
    if program.pattern is not None:
        count = len(program.pattern[0])
        lines += [f"#define {name.upper()}_NNZ {count}", *(f"extern const int {name}_{w}[{count}];" for w in ("rows", "columns"))]
    lines += [f"extern const double {name}_{vector}_values[{len(entries)}]; /* the values above */"
              for vector, entries in program.inputs.items() if vector != "t" and _valued(entries)]
    for f in program.functions.values():
        places = [f"   entries at the places {name}_rows, {name}_columns, all of the one matrix, then all of the other"]
        told = places if f.name == "jacobian" and program.pattern is not None else _listed(f.outputs)
        told = [f"   {f.shape[0]} x {f.shape[1]}"] if f.shape else told
        lines += ["", f"/* {f.meaning}; out[{len(f.outputs)}]:", *told, "*/", f"{_signature(name, f)};"]
    return "\n".join([*lines, ""])


def _valued(entries: Sequence[Entry]) -> bool:
    return bool(entries) and not np.isnan([e.value for e in entries]).any()


def _listed(entries: Sequence[Entry]) -> list[str]:
    """One comment line for each entry."""
    return [f"   {_comment(line)}" for line in described(entries)]


def _comment(text: str) -> str:
    """Text without character pairs that end or begin a comment, and without trigraphs."""
    return text.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?").replace("\\", "/")


def _signature(name: str, f: Function) -> str:
    arguments = [f"{'double ' if a == 't' else 'const double *'}{a}" for a in f.arguments]
    return f"int {name}_{f.name}({', '.join(arguments)}, double *out)"


def source(program: Program) -> str:
    """The C file; it includes only math.h and string.h."""
    return File(program).text()


class File:
    """Collects the parts of a C file as they are needed."""

    def __init__(self, program: Program) -> None:
        self.program, self.name = program, identifier(program.title)
        self.kernels: dict[Any, str] = {}
        self.tables: dict[bytes, str] = {}
        self.parts: list[str] = []

    def text(self) -> str:
        """The whole file."""
        bodies = [self._function(f) for f in self.program.functions.values()]  # which appends to `parts`
        body = "\n".join([*self.parts, *bodies])
        place = Path(mbdae.native.__file__)
        known = "".join(place.with_name(f"{name}.inc").read_text(encoding="utf-8") for name in ("factors", "lookup"))
        helpers = [SIGN] * bool(re.search(r"\bsign\(", body))
        helpers += [re.sub(r"\bI\b", "int", found[0]) for found in re.finditer(r"^static \w+ (\w+)\(.*?^}\n", known, re.M | re.S)
                    if f"{found[1]}(" in body]
        return "\n".join([f"/* {_comment(self.program.title)}: see the header for the vectors. Written by mbdae. */",
                          "#include <math.h>", "#include <string.h>", "", *self._constants(), *helpers, body])

    def _constants(self) -> Iterator[str]:
        if self.program.pattern is not None:
            for what, table in zip(("rows", "columns"), self.program.pattern, strict=True):
                yield f"extern const int {self.name}_{what}[];\nconst int {self.name}_{what}[] = {_listing(table)};"
        for vector, entries in self.program.inputs.items():
            if vector != "t" and _valued(entries):
                whole = f"const double {self.name}_{vector}_values[]"
                yield f"extern {whole};\n{whole} = {_listing([e.value for e in entries])};"

    def _function(self, f: Function) -> str:
        """C text of one exported function."""
        lines = list[str]()
        for vector, pairs in self.program.read_by(f):
            if not len(pairs):
                lines.append(f"(void){vector};")
            elif vector == "t":
                lines += [f"W[{slot}] = t;" for _, slot in pairs]
            else:
                lines += self._each(f"W[{{}}] = {vector}[{{}}];", (pairs[:, 1], 0), (pairs[:, 0], 0))
        for step in f.steps:
            lines += self._step(step)
        lines += self._each("out[{}] = W[{}];", (np.arange(len(f.at)), 0), (f.at, 0))
        size = size_of(f)
        static = "static " if size > ON_STACK else ""
        widest = max((s.fields["inputs"] for s in f.steps if s.fields["kind"] == CALL), default=0)
        begin = [f"{static}double W[{size}]{f', X[{widest}]' if widest else ''};", "memset(W, 0, sizeof W);"]
        inner = "\n".join(f"  {line}" for line in [*begin, *lines, "return 0;"])
        return f"{_signature(self.name, f)};\n/* {f.meaning} */\n{_signature(self.name, f)} {{\n{inner}\n}}\n"

    def _step(self, step: Step) -> list[str]:
        f, kind = step.fields, step.fields["kind"]
        if kind == CALL:
            return self._call(step)
        if kind == LOAD:
            return self._each("W[{}] = {};", (f["first"] + np.arange(f["count"]), 0), (step.tables["weight"], 0))
        count = f["count"]
        if kind == LOOKUP:
            a, b = (f"W[{f['first'] + i}]" for i in (4, 5))
            at, side = (f"{a} * W[{f[name]}] + {b}" for name in ("inputs", "outputs"))
            return [f"lookup({self._table(step.tables['weight'])}, {count}, {at}, {side}, W + {f['first']});"]
        if kind == CHOLESKY:
            return [f"if (band_factors({count}, {f['inputs']}, W + {f['first']}) >= 0) return 1;",
                    f"band_solve({count}, {f['inputs']}, W + {f['first']}, W + {f['outputs']});"]
        if kind == SOLVE:
            return [f"band_solve({count}, {f['inputs']}, W + {f['first']}, W + {f['outputs'] + k * count});"
                    for k in range(f["times"])]
        if kind == LU:
            return [f"if (full_solve({count}, {f['times']}, W + {f['first']}, W + {f['outputs']}) >= 0) return 1;"]
        if kind == POSITIVE:
            return self._each("if (!(W[{}] > 0)) return 1;", (step.tables["from_"], 0))
        names, factors = [name for name in ("to", "from_", "by") if name in step.tables], weights(step)
        columns = [(step.tables[name], f.get(f"{name.rstrip('_')}_step", 0)) for name in names]
        terms = ["W[{}]"] * (len(names) - 1)
        if np.any(factors != 1):
            columns.append((factors.ravel(), count if len(factors) > 1 else 0))
            terms.append("{}")
        return self._each(f"W[{{}}] {'=' if kind == SET else '+='} {' * '.join(terms)};", *columns, times=f["times"])

    def _each(self, line: str, *columns: tuple[Any, int], times: int = 1) -> list[str]:
        """C statements for all entries of the columns, one by one or as loops. line: the statement, with {} for an entry of each
        column; columns: entries of the first of `times` instances (slots or numbers), and their increment to the next
        instance."""
        count = len(columns[0][0])
        if count <= AT_ONCE and times == 1:
            return [line.format(*(_entry(table[k]) for table, _ in columns)) for k in range(count)]
        places = [self._place(table, by if times > 1 else 0) for table, by in columns]
        loop = f"for (int k = 0; k < {count}; k++) {line.format(*places)}"
        return [f"for (int r = 0; r < {times}; r++) {loop}" if times > 1 else loop]

    def _place(self, table: Any, by: int) -> str:
        """C expression of entry k of a column in instance r; by: increment of the entries from one instance to the next."""
        shift = f" + r * {by}" if by else ""
        if table.dtype.kind == "f":
            return c_number(table[0]) if not by and np.all(table == table[0]) else f"{self._table(table)}[k{shift}]"
        return f"{table[0]} + k{shift}" if np.all(np.diff(table) == 1) else f"{self._table(table)}[k]{shift}"

    def _call(self, step: Step) -> list[str]:
        """C lines that call a kernel once for every law that it serves."""
        f, gather, times = step.fields, step.tables["from_"].ravel(), step.fields["times"]
        name, inputs = self._kernel(f["kernel"], f["used"]), f["inputs"]
        if times == 1:
            return [f"for (int k = 0; k < {inputs}; k++) X[k] = W[{self._place(gather, 0)}];", f"{name}(X, W + {f['first']});"]
        return [f"for (int r = 0; r < {times}; r++) {{",
                f"  for (int k = 0; k < {inputs}; k++) X[k] = W[{self._table(gather)}[r * {inputs} + k]];",
                f"  {name}(X, W + {f['first']} + r * {f['outputs']});", "}"]

    def _kernel(self, kernel: Any, used: tuple[int, ...]) -> str:
        """Name of the C function of a kernel that writes the values with the numbers `used`; it is written once, even where
        several exported functions call it."""
        key = (id(kernel), used)
        if key not in self.kernels:
            self.kernels[key] = name = f"kernel{len(self.kernels)}"
            self.parts.append(self._formulas(name, kernel, used))
        return self.kernels[key]

    def _formulas(self, name: str, kernel: Any, used: tuple[int, ...]) -> str:
        """The function of a kernel as text."""
        names = {s: f"x[{i}]" for i, s in enumerate(kernel.symbols)}
        shared, outputs = steps([se.sympify(kernel.expressions[o]) for o in used], names, C)
        lines = [f"  const double {a} = {text};" for a, text in shared]
        lines += [f"  out[{o}] = {text};" for o, text in zip(used, outputs, strict=True)]
        body = "\n".join(lines)
        return f"static void {name}(const double *x, double *out) {{\n{body}\n}}\n"

    def _table(self, values: Any) -> str:
        """Name of a constant table; equal tables are written once."""
        values = np.ascontiguousarray(values)
        key = f"{values.dtype.kind}{values.shape}".encode() + values.tobytes()
        if key not in self.tables:
            self.tables[key] = name = f"T{len(self.tables)}"
            self.parts.append(self._constant(name, values))
        return self.tables[key]

    def _constant(self, name: str, values: Any) -> str:
        return f"static const {'double' if values.dtype.kind == 'f' else 'int'} {name}[] = {_listing(values)};"


def _entry(value: Any) -> str:
    return c_number(value) if isinstance(value, float) else str(int(value))


def _listing(values: Any) -> str:
    """A C initialiser with at most 20 numbers a line."""
    texts = [_entry(v) for v in np.asarray(values).tolist()]
    return "{" + ",\n  ".join(", ".join(texts[i : i + 20]) for i in range(0, len(texts), 20)) + "}"
