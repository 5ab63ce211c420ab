"""Straight-line programs: small named steps, differentiated one by one.

Written out, the equations of a tree of bodies grow exponentially with its depth; as steps they grow linearly, and
forward differentiation of the steps gives the exact Jacobian (geometric terms included) without a formula of its own.

Expressions as source text of a language: every node with its own parentheses, common subexpressions once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from typing import Any

import symengine as se

from mbdae.errors import LawError
from mbdae.symbolic.rebuild import is_condition, substituted, symbols_of
from mbdae.symbolic.vectors import Expr, Vec

_ZERO = se.Integer(0)
STEPPED = ("floor", "ceiling")  #: functions that are constant between their jumps


class Program:
    """Steps name = expression of inputs and earlier names, in the order they are taken."""

    def __init__(self) -> None:
        self.steps: dict[Expr, Expr] = {}
        self._names: dict[Expr, Expr] = {}
        self._flattened: dict[Expr, Expr] = {}

    def copied(self) -> Program:
        """The same, to which steps can be added on their own."""
        made = Program()
        made.steps, made._names, made._flattened = dict(self.steps), dict(self._names), dict(self._flattened)
        return made

    def let(self, e: Any) -> Expr:
        """The name of an expression, which becomes a step if it has none yet; numbers and plain symbols are returned
        themselves."""
        e = se.sympify(e)
        return e if e.is_Number or isinstance(e, se.Symbol) else self._named(self._flat(e))

    def _named(self, e: Expr) -> Expr:
        if e not in self._names:
            self._names[e] = se.Symbol(f"step{len(self.steps)}")
            self.steps[self._names[e]] = e
        return self._names[e]

    def _flat(self, e: Expr) -> Expr:
        """The expression with names in place of the sums inside its products: kept nested, a few hundred of them would cost the
        search for common subexpressions seconds."""
        if e.is_Number or isinstance(e, se.Symbol) or not e.args:
            return e
        if e not in self._flattened:  # shared parts once: a tree's are shared in every level
            self._flattened[e] = self._flat_now(e)
        return self._flattened[e]

    def _flat_now(self, e: Expr) -> Expr:
        args = [self._flat(a) for a in e.args]
        if isinstance(e, se.UnevaluatedExpr):
            return self._named(args[0]) if args[0].args else args[0]
        if isinstance(e, se.Mul):
            args = [self._named(a) if isinstance(a, se.Add) else a for a in args]
        if type(e).__name__ in STEPPED:
            return self._named(e.func(*args))
        if isinstance(e, se.Piecewise):
            return se.Piecewise(*zip(args[::2], args[1::2], strict=True))
        return e.func(*args) if hasattr(e, "func") else e.subs(dict(zip(e.args, args, strict=True)))  # a comparison has no `func`

    def vec(self, v: Vec) -> Vec:
        """A vector of named components."""
        return Vec(*map(self.let, v))

    def axes(self, axes: tuple[Vec, Vec, Vec]) -> tuple[Vec, Vec, Vec]:
        """Three axes with names for their components."""
        x, y, z = map(self.vec, axes)
        return x, y, z

    def needed(self, outputs: Iterable[Expr]) -> list[Expr]:
        """Names the outputs depend on, in order."""
        wanted = symbols_of(outputs)
        found = []
        for name in reversed(self.steps):
            if name in wanted:
                wanted |= self.steps[name].free_symbols
                found.append(name)
        return found[::-1]

    def late(self, outputs: Sequence[Expr]) -> list[Expr]:
        """Names the outputs depend on, each as late as it may be: between two parts of this order few values are alive."""
        rank = {name: i for i, name in enumerate(self.needed(outputs))}
        done: dict[Expr, None] = {}
        for output in outputs:
            stack = sorted(output.free_symbols & rank.keys(), key=rank.__getitem__, reverse=True)
            while stack:
                missing = [s for s in self.steps[stack[-1]].free_symbols & rank.keys() if s not in done]
                stack.extend(sorted(missing, key=rank.__getitem__, reverse=True))
                if not missing:
                    done[stack.pop()] = None
        return list(done)

    def derivatives(self, outputs: Sequence[Expr], seeds: Sequence[Expr], limit: int | None = None) -> list[dict[Expr, Expr]]:
        """Partial derivatives of every output by the seeds (inputs), {seed: name of the derivative}, without those that are zero.

        limit: number of steps of the program above which it raises OverflowError."""
        tangent: dict[Expr, dict[Expr, Expr]] = {seed: {seed: se.Integer(1)} for seed in seeds}
        for name in self.needed(outputs):
            tangent[name] = self._tangent(self.steps[name], tangent)
            if limit is not None and len(self.steps) > limit:
                raise OverflowError(len(self.steps))
        return [self._tangent(e, tangent) for e in outputs]

    def along(self, outputs: Sequence[Expr], changes: Mapping[Expr, Expr]) -> list[Expr]:
        """First-order changes of outputs for changes of inputs, {input: change}: directional derivatives."""
        one = se.Integer(1)
        tangent: dict[Expr, dict[Expr, Expr]] = {x: {one: change} for x, change in changes.items()}
        for name in self.needed(outputs):
            tangent[name] = self._tangent(self.steps[name], tangent)
        return [self._tangent(e, tangent).get(one, _ZERO) for e in outputs]

    def back(self, outputs: Sequence[Expr], weights: Sequence[Expr], inputs: Sequence[Expr]) -> list[Expr]:
        """Weights of the inputs for weights of the outputs: the sums of weight * d output / d input, by reverse accumulation over
        the steps."""
        total: dict[Expr, Expr] = {}

        def give(e: Expr, weight: Expr) -> None:
            if type(e).__name__ in STEPPED or is_condition(e):
                return
            for x in sorted(e.free_symbols, key=str):
                if not is_condition(self.steps.get(x, x)) and (slope := se.diff(e, x)) != 0:
                    total[x] = self.let(total.get(x, _ZERO) + self.let(slope * weight))

        steps = self.needed(outputs)
        for e, weight in zip(outputs, weights, strict=True):
            give(se.sympify(e), weight)
        for name in reversed(steps):
            if name in total:
                give(self.steps[name], self.let(total[name]))
        return [self.let(total.get(x, _ZERO)) for x in inputs]

    def _tangent(self, e: Expr, tangent: dict[Expr, dict[Expr, Expr]]) -> dict[Expr, Expr]:
        if type(e).__name__ in STEPPED or is_condition(e):
            return {}
        total: dict[Expr, Expr] = {}
        for x in sorted(e.free_symbols & tangent.keys(), key=str):
            slope = se.diff(e, x) if tangent[x] else _ZERO
            for seed, value in tangent[x].items():
                total[seed] = total.get(seed, _ZERO) + slope * value
        return {seed: self.let(value) for seed, value in total.items() if value != 0}

    def at(self, values: dict[Expr, Expr], outputs: Sequence[Expr]) -> tuple[Program, list[Expr]]:
        """The part of the program that some outputs need, with inputs replaced by values, and these outputs in it."""
        made, table = Program(), dict(values)
        for name in self.needed(outputs):
            table[name] = made.let(substituted(self.steps[name], table))
        return made, [substituted(e, table) for e in map(se.sympify, outputs)]

    def solved(self, A: dict[tuple[int, int], Expr], b: Sequence[Expr]) -> tuple[list[Expr], list[Expr]]:
        """x of A x = b and the pivots of A = L D L^T, which are positive where A is positive definite. A: entries (i, j), j <= i,
        of a symmetric matrix; those that are left out are zero."""
        n, let = len(b), self.let
        L: dict[tuple[int, int], Expr] = {}
        scaled: dict[tuple[int, int], Expr] = {}  # entries of L D
        pivots, inverse, x = list[Expr](), list[Expr](), list(b)
        for i in range(n):
            for j in range(i + 1):
                value = A.get((i, j), _ZERO) - _sum(L[j, k] * scaled[i, k] for k in range(j) if (j, k) in L and (i, k) in scaled)
                if i == j:
                    pivots.append(let(value))
                    inverse.append(let(1 / pivots[i]))
                elif value != 0:
                    scaled[i, j] = let(value)
                    L[i, j] = let(scaled[i, j] * inverse[j])
            x[i] = let(x[i] - _sum(L[i, k] * x[k] for k in range(i) if (i, k) in L))
        for i in reversed(range(n)):
            x[i] = let(x[i] * inverse[i] - _sum(L[k, i] * x[k] for k in range(i + 1, n) if (k, i) in L))
        return x, pivots

    def closed(self, outputs: Sequence[Expr]) -> list[Expr]:
        """Outputs in terms of inputs alone. Every step stays one shared node (an unevaluated expression): otherwise sums are
        expanded wherever they are used, and the expressions grow exponentially."""
        table: dict[Expr, Expr] = {}
        for name in self.needed(outputs):
            table[name] = se.UnevaluatedExpr(substituted(self.steps[name], table))
        return [substituted(e, table) for e in map(se.sympify, outputs)]

    def by_pairs(self, outputs: Sequence[Expr]) -> list[Expr]:
        """Outputs in terms of inputs alone, every sum and product of two at a time, each a shared node. What appears more than
        once is then found by looking at whole nodes: the search of symengine among parts of sums and products grows with the
        square of their number, and did not end for some trees."""
        table: dict[Expr, Expr] = {}
        made: dict[tuple[Any, ...], Expr] = {}

        def node(kind: Any, *args: Expr) -> Expr:
            key = (kind, frozenset(args) if len(set(args)) == len(args) == 2 and kind in (se.Add, se.Mul) else args)
            if key not in made:
                made[key] = se.UnevaluatedExpr(kind(*args))
            return made[key]

        def lowered(e: Expr) -> Expr:
            if e in table or not e.args or not hasattr(e, "func"):  # a division by 0 has parts, and no function
                return table.get(e, e)
            args = [lowered(a) for a in e.args]
            if not isinstance(e, se.Add | se.Mul):
                return node(e.func, *args)
            return reduce(partial(node, type(e)), args)

        for name in self.needed(outputs):
            table[name] = lowered(self.steps[name])
        return [lowered(e) for e in map(se.sympify, outputs)]


def _sum(terms: Iterable[Expr]) -> Expr:
    return sum(terms, _ZERO)


_OPERATORS = {"Add": " + ", "Mul": " * "}


@dataclass(frozen=True)
class Language:
    """How a language writes numbers, powers (base, its text, exponent, its text) and functions, by the name of their class."""

    number: Callable[[Expr], str]
    power: Callable[[Expr, str, Expr, str], str]
    functions: Mapping[str, Callable[..., str]]


def called(name: str) -> Callable[..., str]:
    """Writer of a function as name(arguments)."""
    return lambda *args: f"{name}({', '.join(args)})"


def steps(expressions: Sequence[Expr], names: dict[Expr, str], language: Language) -> tuple[list[tuple[str, str]], list[str]]:
    """Names a0, a1, ... with the texts of common subexpressions, then the texts of the expressions; names: text of every symbol.

    Raises LawError for a function that the language does not know."""
    shared, reduced = se.cse(expressions)
    found, names = [], dict(names)
    for i, (symbol, value) in enumerate(reached(shared, reduced)):
        found.append((f"a{i}", written(value, names, language)))
        names[symbol] = f"a{i}"
    return found, [written(e, names, language) for e in reduced]


def reached(pairs: Sequence[tuple[Expr, Expr]], outputs: Sequence[Expr]) -> list[tuple[Expr, Expr]]:
    """The pairs (name, expression of earlier names) on which outputs depend."""
    live = set[Expr]().union(*(e.free_symbols for e in outputs))
    found = []
    for name, e in reversed(pairs):
        if name in live:
            live |= e.free_symbols
            found.append((name, e))
    return found[::-1]


def written(e: Expr, names: Mapping[Expr, str], language: Language) -> str:
    """An expression as text."""
    known = names.get(e)
    if known is not None:
        return known
    kind, args = type(e).__name__, e.args
    if e.is_Number or not (args or kind in language.functions):
        return language.number(e)
    texts = [written(a, names, language) for a in args]
    if kind in _OPERATORS:
        return f"({_OPERATORS[kind].join(texts)})"
    if kind == "Pow":
        return language.power(args[0], texts[0], args[1], texts[1])
    if kind not in language.functions:
        raise LawError(f"the function {kind} in {e} can be simulated, but not written as text or audited; use one of "
                       f"{', '.join(language.functions)}")
    return language.functions[kind](*texts)


def python_power(base: Expr, text: str, exponent: Expr, written: str) -> str:
    """A power in Python, with `_sqrt` and `_exp`."""
    if base == se.E:
        return f"_exp({written})"
    if abs(exponent) == se.Rational(1, 2):
        return f"_sqrt({text})" if exponent > 0 else f"(1 / _sqrt({text}))"
    return f"({text} ** {written})"


def python(functions: Sequence[str]) -> Language:
    """Python with functions of these names, and `_sqrt` and `_exp`."""
    return Language(lambda e: f"({e})" if isinstance(e, se.Integer) else repr(float(e)), python_power,
                    {name: called(name) for name in functions})


def python_function(symbols: Sequence[Expr], expressions: Sequence[Expr], space: Mapping[str, object]) -> Callable[..., list]:  # type: ignore[type-arg]
    """Expressions as a Python function: from the sequence of values of the symbols to the list of values. space: the functions
    that the expressions may call, by name."""
    found, outputs = steps(expressions, {s: f"x[{i}]" for i, s in enumerate(symbols)}, python(tuple(space)))
    return defined(found, outputs, space)


def defined(found: Sequence[tuple[str, str]], outputs: Sequence[str], space: Mapping[str, object]) -> Callable[..., list]:  # type: ignore[type-arg]
    """The Python function of x that takes steps (name, text) and returns the values of the outputs."""
    lines = ["def function(x):", *(f"    {name} = {text}" for name, text in found), f"    return [{', '.join(outputs)}]"]
    made = dict(space)
    exec("\n".join(lines), made)
    return made["function"]  # type: ignore[return-value]
