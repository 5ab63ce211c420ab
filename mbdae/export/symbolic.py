"""The operations of a function carried out on symbols instead of numbers: names with expressions, one after the other."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.errors import OptionError
from mbdae.export.program import Function, Program, reach, weights
from mbdae.native.program import ADD, CALL, CHOLESKY, LOAD, LU, MULTIPLY, SET, Step
from mbdae.symbolic.rebuild import rebuilt
from mbdae.symbolic.source import reached
from mbdae.symbolic.vectors import Expr

DIAGONAL = 0.1  #: of the largest entry of a column: from here on the diagonal is the pivot, which keeps the pattern


class Derivation(NamedTuple):
    """steps: names with expressions of the inputs and of earlier names; outputs in these; vectors: symbols of the inputs."""

    steps: list[tuple[Expr, Expr]]
    outputs: list[Expr]
    vectors: dict[str, list[Expr]]


def derivation(program: Program, function: Function) -> Derivation:
    """A function in symbols t, y0, y1, ..., p0, ...; names w0, w1, ...

    Matrices are solved by elimination. Its pivots are those that the values of the inputs ask for."""
    vectors = {name: [se.Symbol("t" if name == "t" else f"{name}{i}") for i in range(len(program.inputs[name]))]
               for name in function.arguments}  # fmt: skip
    pivots: list[list[int]] = []
    if any(step.fields["kind"] in (CHOLESKY, LU) for step in function.steps):
        start = {name: [0.0 if np.isnan(e.value) else e.value for e in program.inputs[name]] for name in function.arguments}
        numbers = _Numbers()
        numbers.run(program, function, start)
        pivots = numbers.pivots
    symbols = _Symbols(pivots)
    outputs = [se.sympify(e) for e in symbols.run(program, function, vectors)]
    return Derivation(reached(symbols.steps, outputs), outputs, vectors)


class _Numbers:
    """The operations on floating point numbers: they find the pivots."""

    zero: Any = 0.0

    def __init__(self) -> None:
        self.pivots: list[list[int]] = []
        self.W: dict[int, Any] = {}

    def at(self, slot: Any) -> Any:
        """The value of a slot."""
        return self.W.get(int(slot), self.zero)

    def number(self, value: float) -> Any:
        """A number of a table."""
        return float(value)

    def name(self, value: Any) -> Any:
        """A value that is used more than once."""
        return value

    def call(self, kernel: Any, used: tuple[int, ...], x: list[Any]) -> list[Any]:
        """The values `used` of a kernel."""
        values = kernel.once(np.array(x, dtype=float))
        return [float(values[o]) for o in used]

    def run(self, program: Program, function: Function, vectors: dict[str, list[Any]]) -> list[Any]:
        """The outputs for values of the inputs."""
        for name in function.arguments:
            for entry, slot in program.slots[name].tolist():
                self.W[slot] = vectors[name][entry]
        for step in function.steps:
            self._step(step)
        return [self.at(slot) for slot in function.at]

    def _step(self, step: Step) -> None:
        f, kind = step.fields, step.fields["kind"]
        if kind == CALL:
            used = f["used"]
            for r, row in enumerate(step.tables["from_"].reshape(f["times"], -1)):
                found = self.call(f["kernel"], used, [self.at(slot) for slot in row])
                self.W |= {f["first"] + r * f["outputs"] + o: value for o, value in zip(used, found, strict=True)}
        elif kind == LOAD:
            self.W |= {f["first"] + i: self.number(value) for i, value in enumerate(step.tables["weight"])}
        elif kind in (SET, ADD, MULTIPLY):
            self._map(step, kind)
        elif kind in (CHOLESKY, LU):
            self._solve(f, self._matrix(f))

    def _map(self, step: Step, kind: int) -> None:
        to, from_ = reach(step, "to"), reach(step, "from_")
        factors = np.broadcast_to(weights(step), to.shape)
        by = reach(step, "by") if kind == MULTIPLY else None
        for place in np.ndindex(to.shape):
            value = self.at(from_[place])
            if kind == SET:
                self.W[int(to[place])] = value
                continue
            if by is not None:
                value = self.name(value) * self.name(self.at(by[place]))
            self.W[int(to[place])] = self.at(to[place]) + self.number(float(factors[place])) * value

    def _matrix(self, f: dict[str, Any]) -> list[list[Any]]:
        """The matrix of a solution: full, or symmetric and given by its band."""
        n, first = f["count"], f["first"]
        if f["kind"] == LU:
            return [[self.at(first + i * n + j) for j in range(n)] for i in range(n)]
        width = f["inputs"]
        return [[self.at(first + max(i, j) * width + width - 1 - abs(i - j)) if abs(i - j) < width else self.zero
                 for j in range(n)] for i in range(n)]  # fmt: skip

    def _solve(self, f: dict[str, Any], A: list[list[Any]]) -> None:
        """Gauss elimination with the right-hand sides."""
        n, times, zero = f["count"], f["times"], self.zero
        rows = [[*map(self.name, row), *(self.at(f["outputs"] + r * n + i) for r in range(times))] for i, row in enumerate(A)]
        order = self.order(n)
        for k in range(n):
            best = order(k, rows)
            rows[k], rows[best] = rows[best], rows[k]
            for row in rows[k + 1 :]:
                if row[k] != zero:
                    factor = self.name(row[k] / rows[k][k])
                    pairs = zip(row[k:], rows[k][k:], strict=True)
                    row[k:] = [self.name(a - factor * b) if b != zero else a for a, b in pairs]
        for r in range(n, n + times):
            for k in reversed(range(n)):
                rest = sum((rows[k][j] * rows[j][r] for j in range(k + 1, n) if rows[k][j] != zero and rows[j][r] != zero), zero)
                rows[k][r] = self.name((rows[k][r] - rest) / rows[k][k])
                self.W[f["outputs"] + (r - n) * n + k] = rows[k][r]

    def order(self, n: int) -> Any:
        """The choice of pivots: the diagonal where it is not small, else the largest entry of the column."""
        found: list[int] = []
        self.pivots.append(found)

        def choose(k: int, rows: list[list[float]]) -> int:
            sizes = [abs(row[k]) for row in rows[k:]]
            if not max(sizes) > 0:
                raise OptionError("what = a scene whose masses or constraints are singular at its start: its accelerations have "
                                  "no formula there; export C, which chooses its pivots as it runs")  # fmt: skip
            found.append(k if sizes[0] >= DIAGONAL * max(sizes) else k + int(np.argmax(sizes)))
            return found[-1]

        return choose


class _Symbols(_Numbers):
    """The operations on expressions, with names for everything that is used more than once."""

    zero = se.Integer(0)

    def __init__(self, pivots: list[list[int]]) -> None:
        super().__init__()
        self.left = list(pivots)
        self.steps: list[tuple[Expr, Expr]] = []
        self.known: dict[Expr, Expr] = {}

    def number(self, value: float) -> Any:
        return se.Integer(int(value)) if value == int(value) else se.RealDouble(float(value))

    def name(self, value: Any) -> Any:
        if value.is_Number or isinstance(value, se.Symbol):
            return value
        if value not in self.known:
            self.known[value] = se.Symbol(f"w{len(self.steps)}")
            self.steps.append((self.known[value], value))
        return self.known[value]

    def call(self, kernel: Any, used: tuple[int, ...], x: list[Any]) -> list[Any]:
        table = {symbol: self.name(value) for symbol, value in zip(kernel.symbols, x, strict=True)}
        shared, outputs = se.cse([se.sympify(kernel.expressions[o]) for o in used])
        for symbol, value in shared:
            table[symbol] = self.name(_bare(value, table))
        return [_bare(e, table) for e in outputs]

    def order(self, n: int) -> Any:
        found = self.left.pop(0)
        return lambda k, rows: found[k]


def _bare(e: Expr, table: dict[Expr, Expr]) -> Expr:
    """The expression in names, without the marks that keep subexpressions together."""
    return rebuilt(e, lambda node, args: args[0] if type(node).__name__ == "UnevaluatedExpr" else table.get(node))
