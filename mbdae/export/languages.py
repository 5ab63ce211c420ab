"""Expressions in the syntax of C, CasADi and SymPy, and descriptions of inputs and outputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import symengine as se

from mbdae.export.program import Entry
from mbdae.symbolic.source import Language, called
from mbdae.symbolic.vectors import Expr


def _infix(operator: str) -> Callable[..., str]:
    return lambda *args: f"({f' {operator} '.join(args)})"


def _calls(names: str) -> dict[str, Callable[..., str]]:
    """Writers of functions by name. names: separated by blanks, "Abs=fabs" where the language has another name than symengine."""
    pairs = (name.partition("=") for name in names.split())
    return {own: called(theirs or own) for own, _, theirs in pairs}


#: functions and relations with equal syntax in C, CasADi and SymPy (_EQUAL); with them those common to C and CasADi (_NUMERIC)
_EQUAL = _calls("sin cos tan sinh cosh tanh asin acos atan asinh acosh atanh atan2 log floor sign erf") | {
    "StrictLessThan": _infix("<"), "LessThan": _infix("<=")}  # fmt: skip
_NUMERIC = _EQUAL | {"Equality": _infix("=="), "Unequality": _infix("!="), "BooleanTrue": lambda: "1",
                     "BooleanFalse": lambda: "0"}  # fmt: skip


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
    "Piecewise": _chosen("({1} ? {0} : {2})", "NAN")})  # fmt: skip
CASADI = Language(lambda e: repr(float(e)), _power("1", "({0} ** {1})", False), _NUMERIC | _calls(
    "Abs=fabs ceiling=ceil Not=logic_not") | {
    "Max": _folded("fmax"), "Min": _folded("fmin"), "erfc": lambda a: f"(1 - erf({a}))", "And": _folded("logic_and"),
    "Or": _folded("logic_or"), "Piecewise": _chosen("if_else({1}, {0}, {2})", 'float("nan")')})  # fmt: skip
SYMPY = Language(_sympy_number, _power("1", "({0} ** {1})", False), _EQUAL | _calls(
    "Abs ceiling erfc gamma loggamma Max Min And Or Not Equality=Eq Unequality=Ne") | {
    "Piecewise": _pairs, "BooleanTrue": lambda: "True", "BooleanFalse": lambda: "False"})  # fmt: skip


def described(entries: Sequence[Entry]) -> list[str]:
    """One line for each entry: number, name, unit, value."""
    return [f"[{i}] {e.name}{f', {e.unit}' if e.unit else ''}{'' if np.isnan(e.value) else f' = {e.value!r}'}"
            for i, e in enumerate(entries)]  # fmt: skip
