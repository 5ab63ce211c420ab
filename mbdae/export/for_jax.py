"""Exported functions as a module for JAX: kernels as levels of array operations, all other operations on one array.

XLA, which compiles what JAX traces, takes milliseconds for every operation that it sees: kernels of 20 000 operations, written
out, compile for 40 s. Here a kernel is a short list of loops over tables: in every turn of a loop a whole level of numbers is
computed from those of the levels before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.errors import LawError
from mbdae.export.languages import JAX, File, size_of
from mbdae.export.program import Function, Program, reach, weights
from mbdae.export.text import head, matrix_of
from mbdae.native.program import CALL, CHOLESKY, LOAD, LOOKUP, LU, POSITIVE, READ, SET, Step
from mbdae.symbolic.program import reached
from mbdae.symbolic.vectors import Expr

SUM = "{3} * {0} * {1} + {2}"  #: what a level of sums computes; {3}: a factor that is a number
#: levels are cut into pieces of this part of their mean size: fewer turns of the loop, or fewer idle places in its tables
WIDTH = 1.5


def jax_text(program: Program) -> str:
    """A module with a function of JAX arrays for every function; `jacobian` of a scene returns two full matrices."""
    return _Jax(program).text()


class _Node(NamedTuple):
    """A number that is computed. form: text with places for the numbers `args`; factor: of a sum."""

    form: str
    args: tuple[int, ...]
    factor: float = 1.0


class Levels:
    """Expressions of symbols as operations on one array of numbers: those of the symbols, then constants, then computed ones.

    constants: values; at: the numbers of the expressions; nodes: what is computed, by number."""

    def __init__(self, symbols: Sequence[Expr], expressions: Sequence[Expr]) -> None:
        self._known: dict[Expr, int] = {symbol: i for i, symbol in enumerate(symbols)}
        self._count, self._made = len(self._known), dict[_Node, int]()
        self.constants, self.nodes = dict[float, int](), dict[int, _Node]()
        self.zero, self.one = self._constant(0.0), self._constant(1.0)
        shared, reduced = se.cse(expressions)
        for symbol, value in reached(shared, reduced):
            self._known[symbol] = self._of(value)
        self.at = [self._of(e) for e in reduced]

    def _next(self) -> int:
        self._count += 1
        return self._count - 1

    def _constant(self, value: float) -> int:
        if value not in self.constants:
            self.constants[value] = self._next()
        return self.constants[value]

    def _node(self, node: _Node) -> int:
        if node not in self._made:
            self._made[node] = self._next()
            self.nodes[self._made[node]] = node
        return self._made[node]

    def _sum(self, factor: float, a: int, b: int, c: int) -> int:
        """Number of factor * a * b + c."""
        a, b = min(a, b), max(a, b)
        if factor == 1 and c == self.zero and self.one in (a, b):
            return b if a == self.one else a
        return self._node(_Node(SUM, (a, b, c), factor))

    def _of(self, e: Expr) -> int:
        if e not in self._known:
            self._known[e] = self._found(e, type(e).__name__, e.args)
        return self._known[e]

    def _found(self, e: Expr, kind: str, args: Sequence[Expr]) -> int:
        if kind in ("BooleanTrue", "BooleanFalse"):
            return self._constant(float(kind == "BooleanTrue"))
        if e.is_Number or not args:
            return self._constant(float(e))
        if kind == "UnevaluatedExpr":
            return self._of(args[0])
        if kind == "Mul":
            return self._sum(*self._product(e), self.zero)
        if kind == "Add":
            return self._added([self._product(a) for a in args])
        if kind == "Pow":
            base, power = args
            numbers = (self._of(base),) if power.is_Number and base != se.E else (self._of(base), self._of(power))
            if power == 2:
                return self._sum(1.0, numbers[0], numbers[0], self.zero)
            text = JAX.number(power) if len(numbers) == 1 else "{1}"
            return self._node(_Node(JAX.power(base, "{0}", power, text), numbers))
        if kind not in JAX.functions:
            raise LawError(f"the function {kind} in {e} can be simulated, but not written for JAX; use one of "
                           f"{', '.join(JAX.functions)}")
        return self._node(_Node(JAX.functions[kind](*(f"{{{i}}}" for i in range(len(args)))), tuple(map(self._of, args))))

    def _product(self, e: Expr) -> tuple[float, int, int]:
        """An expression as a factor and two numbers."""
        args = e.args if isinstance(e, se.Mul) else [e]
        factor, found = math.prod(float(a) for a in args if a.is_Number), [self._of(a) for a in args if not a.is_Number]
        while len(found) > 2:
            found = [self._sum(1.0, found[i], found[i + 1], self.zero) if i + 1 < len(found) else found[i]
                     for i in range(0, len(found), 2)]
        a, b = [*found, self.one, self.one][:2]
        return factor, a, b

    def _added(self, terms: list[tuple[float, int, int]]) -> int:
        """Number of a sum: half of its terms, plain numbers first, then the others added to them, then pairs of these."""
        terms = sorted(terms, key=lambda term: (term[0], term[2]) != (1.0, self.one))
        half = (len(terms) + 1) // 2
        found = [self._sum(*term, self.zero) for term in terms[:half]]
        found[: len(terms) - half] = [self._sum(*term, c) for term, c in zip(terms[half:], found, strict=False)]
        while len(found) > 1:
            found = [self._sum(1.0, found[i], self.one, found[i + 1]) if i + 1 < len(found) else found[i]
                     for i in range(0, len(found), 2)]
        return found[0]

    def parts(self) -> Iterator[tuple[str, list[list[int]]]]:
        """What is computed, in order: (form, levels), of sums as many levels as follow each other, of other functions one."""
        waiting = {n: {a for a in node.args if a in self.nodes} for n, node in self.nodes.items()}
        users, ready = dict[int, list[int]](), dict[str, list[int]]()
        for n, arguments in waiting.items():
            for a in arguments:
                users.setdefault(a, []).append(n)

        def let(numbers: Sequence[int]) -> None:
            for n in numbers:
                ready.setdefault(self.nodes[n].form, []).append(n)

        let([n for n, arguments in waiting.items() if not arguments])
        while ready:
            form = SUM if SUM in ready else next(iter(ready))
            levels = list[list[int]]()
            while form in ready and (form == SUM or not levels):
                levels.append(ready.pop(form))
                for a in levels[-1]:
                    for n in users.get(a, ()):
                        waiting[n].discard(a)
                    let([n for n in users.get(a, ()) if not waiting[n]])
            yield form, levels


class _Jax(File):
    """The same operations, each on whole arrays; out is NaN where C returns 1."""

    def text(self) -> str:
        bodies = [self._function(f) for f in self.program.functions.values()]
        top, names = head(self.program, ""), Path(__file__).with_name("jax.inc").read_text(encoding="utf-8")
        return "\n".join([top[0], names, *top[3:], *self.parts, *bodies])

    def _function(self, f: Function) -> str:
        lines = [f"W, sound = zeros({size_of(f)}), True"]
        for vector, pairs in self.program.read_by(f):
            if len(pairs):
                value = "t" if vector == "t" else f"asarray({vector}, dtype=float)[{self._table(pairs[:, 0])}]"
                lines.append(f"W = W.at[{self._table(pairs[:, 1])}].set({value})")
        for step in f.steps:
            lines += self._step(step)
        n, count = len(self.program.inputs.get("y", ())), 0 if self.program.pattern is None else len(self.program.pattern[0])
        matrix = f"zeros(({n}, {n})).at[array(rows), array(columns)].set"
        result = f"{matrix}(out[:{count}]), {matrix}(out[{count}:])" if f.name == "jacobian" and count else (
            f"out.reshape({f.shape})" if f.shape else "out")
        lines += [f"out = where(sound, W[{self._table(f.at)}], nan)", f"return {result}"]
        return "\n    ".join([f"\n\n@jax.jit\ndef {f.name}({', '.join(f.arguments)}):", f'"""{f.meaning}."""', *lines])

    def _step(self, step: Step) -> list[str]:
        f, kind, count = step.fields, step.fields["kind"], step.fields.get("count", 0)
        if kind == CALL:
            to = f["first"] + f["outputs"] * np.arange(f["times"]) + np.array(f["used"])[:, None]
            values = f"{self._kernel(f['kernel'], f['used'])}(W[{self._table(step.tables['from_'].T)}])"
            return [f"W = W.at[{self._table(to)}].set({values})"]
        if kind == LOAD:
            return [f"W = W.at[{f['first']}:{f['first'] + count}].set({self._table(step.tables['weight'])})"]
        if kind == LOOKUP:
            x, side = (f"W[{f['first'] + 4}] * W[{f[name]}] + W[{f['first'] + 5}]" for name in ("inputs", "outputs"))
            found = f"lookup({self._table(step.tables['weight'])}, {count}, {x}, {side})"
            return [f"W = W.at[{f['first']}:{f['first'] + READ}].set({found})"]
        if kind == POSITIVE:
            return [f"sound = sound & all(W[{self._table(step.tables['from_'])}] > 0)"]
        if kind in (CHOLESKY, LU):
            cells = np.array(matrix_of(step, lambda slot: slot, -1))
            return [f"W = solved(W, where({self._table(cells)} < 0, 0.0, W[{self._table(cells)}]), {f['outputs']}, {f['times']})"]
        return [self._mapped(step, slice(*part)) for part in _apart(step)]

    def _mapped(self, step: Step, part: slice) -> str:
        to, *rest = (self._table(reach(step, name).ravel()[part]) for name in ("to", "from_", "by") if name in step.tables)
        factors = np.broadcast_to(weights(step), reach(step, "to").shape).ravel()[part]
        terms = [f"W[{table}]" for table in rest] + ([self._table(factors)] if np.any(factors != 1) else [])
        return f"W = W.at[{to}].{'set' if step.fields['kind'] == SET else 'add'}({' * '.join(terms)})"

    def _formulas(self, name: str, kernel: Any, used: tuple[int, ...]) -> str:
        levels = Levels(kernel.symbols, [se.sympify(kernel.expressions[o]) for o in used])
        place = {n: n for n in range(len(kernel.symbols))}
        place |= {n: len(place) + i for i, n in enumerate(levels.constants.values())}
        lines, size, room = list[str](), len(place), len(place)
        for form, found in levels.parts():
            rows = _cut(found) if form == SUM else found
            starts = size + np.r_[0, np.cumsum([len(row) for row in rows])]
            place |= {n: int(start) + i for start, row in zip(starts, rows, strict=False) for i, n in enumerate(row)}
            width, nodes = max(map(len, rows)), [[levels.nodes[n] for n in row] for row in rows]
            tables = np.full((len(nodes[0][0].args), len(rows), width), place[levels.zero])
            for r, row in enumerate(nodes):
                tables[:, r, : len(row)] = np.array([[place[a] for a in node.args] for node in row]).T
            if form == SUM:
                factors = np.array([[*(node.factor for node in row), *[0.0] * (width - len(row))] for row in nodes])
                lines.append(f"W = sums(W, {self._table(starts[:-1])}, {self._table(tables)}, {self._table(factors)})")
            else:
                text = form.format(*(f"W[{self._table(table[0])}]" for table in tables))
                lines.append(f"W = put(W, {text}, {size})")
            size = int(starts[-1])
            room = max(room, int(starts[-2]) + width)
        begin = f"W = begun(x, {self._table(np.array(list(levels.constants)))}, {room})"
        out = self._table(np.array([place[n] for n in levels.at]))
        return "\n    ".join([f"\n\ndef {name}(x):", begin, *lines, f"return W[{out}]"])

    def _constant(self, name: str, values: Any) -> str:
        return f"{name} = np.array({values.tolist()!r})"


def _cut(levels: list[list[int]]) -> list[list[int]]:
    """Levels as pieces of about the same size."""
    most = math.ceil(WIDTH * sum(map(len, levels)) / len(levels))
    return [level[i : i + most] for level in levels for i in range(0, len(level), most)]


def _apart(step: Step) -> list[tuple[int, int]]:
    """Ranges of the entries of an operation, with repetitions written out, within which none is read after it was written."""
    to, read = reach(step, "to").ravel(), [reach(step, name).ravel() for name in ("from_", "by") if name in step.tables]
    found, begin, written = list[tuple[int, int]](), 0, set[int]()
    for k, slot in enumerate(to.tolist()):
        if any(int(table[k]) in written for table in read):
            found.append((begin, k))
            begin, written = k, set()
        written.add(slot)
    return [*found, (begin, len(to))]
