"""The operations of a function applied to symbols instead of numbers: a sequence of named expressions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.errors import OptionError
from mbdae.export.program import Function, Program, reach, run, weights
from mbdae.native.program import ADD, CALL, CHOLESKY, LOAD, LOOKUP, LU, MULTIPLY, SET, Step
from mbdae.symbolic.rebuild import rebuilt
from mbdae.symbolic.source import reached
from mbdae.symbolic.vectors import Expr

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
               for name in function.arguments}  # fmt: skip
    found = _Symbols(program, function, vectors)
    outputs = [se.sympify(found.at(slot)) for slot in function.at]
    return Derivation(reached(found.steps, outputs), outputs, vectors)


def _matrix(step: Step, at: Callable[[int], Any], zero: Any) -> list[list[Any]]:
    """The matrix of an operation that solves a linear system: full (LU), or symmetric and stored as its lower band (Cholesky).
    at: function that returns the number or expression in a slot; zero: entry outside of the band."""
    n, first, width = step.fields["count"], step.fields["first"], step.fields.get("inputs", 0)
    if step.fields["kind"] == LU:
        return [[at(first + i * n + j) for j in range(n)] for i in range(n)]
    return [[at(first + max(i, j) * width + width - 1 - abs(i - j)) if abs(i - j) < width else zero for j in range(n)]
            for i in range(n)]  # fmt: skip


def _pivots(program: Program, function: Function) -> Iterator[list[int]]:
    """The pivot rows of every matrix at the values of the inputs: diagonal entries unless they are small, else the largest entry
    of the column."""
    W = program.given({name: np.nan_to_num([e.value for e in program.inputs[name]]) for name in function.arguments})
    done = 0
    for number, step in enumerate(function.steps):
        if step.fields["kind"] in (CHOLESKY, LU):
            run(function.steps[done:number], W)
            A, order, done = np.array(_matrix(step, W.item, 0.0)), list[int](), number
            for k in range(len(A)):
                sizes = np.abs(A[k:, k])
                if not sizes.max() > 0:
                    raise OptionError("what: the masses or constraints of the scene are singular at its start, where its "
                                      "accelerations have no formula; export format='c', which chooses its pivots as it "
                                      "runs")  # fmt: skip
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
                raise OptionError("what: the scene has a table (mb.table), which is no formula; export format='c', which holds "
                                  "its points")  # fmt: skip
            elif kind == LOAD:
                self.W |= {f["first"] + i: _number(value) for i, value in enumerate(step.tables["weight"])}
            elif kind in (SET, ADD, MULTIPLY):
                self._map(step, kind)
            elif kind in (CHOLESKY, LU):
                self._solve(f, _matrix(step, self.at, ZERO), next(pivots))

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
