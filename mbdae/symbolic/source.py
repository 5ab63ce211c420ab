"""Expressions as source text of a language: every node with its own parentheses, common subexpressions once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import symengine as se

from mbdae.errors import LawError
from mbdae.symbolic.vectors import Expr

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
                       f"{', '.join(language.functions)}")  # fmt: skip
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
                    {name: called(name) for name in functions})  # fmt: skip


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
