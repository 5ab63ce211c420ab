"""Rewriting of inputs in functions that kernels can compile: Piecewise for one-sided functions, floor for Mod, ceiling, frac.

Sensors in expressions: symbols that carry the path of a sensor, such as sensor("J.angle"). Named numbers: symbols that carry a
name and a value, number("amplitude", 2.0); statements record them, and use their values.
"""

from __future__ import annotations

import copy
import json
import sys
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import symengine as se

from mbdae.errors import OptionError
from mbdae.inputs import tables
from mbdae.inputs.text import FUNCTIONS
from mbdae.symbolic.rebuild import LOGIC, ONE_SIDED, is_condition, nodes, one_sided, rebuilt, without_overflow, without_powers
from mbdae.symbolic.vectors import Expr
from mbdae.values import BadValueError, option, shown, text
from mbdae.values import number as finite

#: functions that inputs may contain and that are rewritten with Piecewise or floor
REWRITTEN = ("Abs", "sign", "Heaviside", "Max", "Min", "Mod", "ceiling", "frac")
HUGE = 100.0  #: a number times an exponential is put into the exponent if the magnitude of ln|number| is larger, see `_exponents`


def rewritten(value: Any) -> Expr:
    """An expression in functions the kernels compile; refuses expressions without a value or a derivative."""
    if isinstance(value, se.Basic) and is_plain(value):
        return _with_powers(without_overflow(one_sided(value)))
    import sympy

    value = sympy.sympify(value)
    if value.has(sympy.zoo, sympy.nan, sympy.oo, -sympy.oo):
        raise BadValueError(f"{shown(value)} contains an infinite number or a division by zero: give finite numbers")
    used = {type(f).__name__ for f in value.atoms(sympy.core.function.Application)}
    unknown = sorted(name for name in used - {*FUNCTIONS, *REWRITTEN, *LOGIC, "ITE"} if tables.named(name) is None)
    if unknown:
        known = ", ".join(FUNCTIONS + REWRITTEN)
        raise BadValueError(f"{shown(value)} contains the function {unknown[0]}; expressions of mb.t may use {known}")
    for piecewise in value.atoms(sympy.Piecewise):
        if not _complete(piecewise):
            raise BadValueError(f"{shown(piecewise)} has no value where none of its conditions holds; end it with (value, True)")
    if value.has(sympy.I):
        raise BadValueError(f"{shown(value)} contains the imaginary unit: give a real expression")
    return _with_powers(without_overflow(_with_exponents(*_exponents(_without_steps(value)))))


def _with_powers(e: Expr) -> Expr:
    """The expression; refuses powers of 0 and of negative numbers with an exponent that varies."""
    for node in filter(without_powers, nodes(e)):
        raise BadValueError(f"{shown(node)} is a power of a number that is not positive: no real number for most exponents; "
                            "state it by cases")
    return e


def is_plain(e: Expr) -> bool:
    """Whether a symengine expression contains nothing that SymPy has to rewrite or to refuse."""
    parts = nodes(e)
    if not all(part.args[-1] == se.true for part in parts if isinstance(part, se.Piecewise)):
        return False
    numbers = {"Integer", "Rational", "RealDouble", "Zero", "One", "NegativeOne", "Half", "Pi", "Exp1"}
    names = {type(part).__name__ for part in parts if not is_condition(part) and tables.lookup_of(part) is None}
    return names <= {*FUNCTIONS, *ONE_SIDED, "Add", "Mul", "Pow", "Symbol", *numbers}


def _without_steps(e: Any) -> Any:
    """A SymPy expression with Heaviside, Mod, frac and ITE, which symengine does not have, rewritten."""
    import sympy as sp

    rules: dict[Any, Any] = {
        sp.Heaviside: lambda x, at_zero=None: (1 + sp.sign(x)) / 2,
        sp.Mod: lambda x, period: x - period * sp.floor(x / period), sp.frac: lambda x: x - sp.floor(x),
        sp.ITE: lambda c, a, b: sp.Or(sp.And(c, a), sp.And(sp.Not(c), b)),
    }
    for function, rule in rules.items():
        e = e.replace(function, rule)
    return e


def _exponents(e: Any) -> tuple[Any, dict[str, Any]]:
    """The expression with a symbol for every exponential that SymPy has split into a number and a rest, exp(x - 5000) into
    1e-2171 exp(x): neither fits into a double although their product does. Also returned: the exponents (rest, number) of these
    symbols."""
    import sympy as sp

    found: dict[str, Any] = {}

    def huge(x: Any) -> bool:
        number = x.as_coeff_Mul()[0] if x.is_Mul else sp.S.One
        return bool(number.is_Float and number != 0 and abs(sp.log(abs(number))) > HUGE and any(a.func is sp.exp for a in x.args))

    def merged(x: Any) -> Any:
        number, rest = x.as_coeff_Mul()
        power = next(a for a in rest.as_ordered_factors() if a.func is sp.exp)
        name = f"exponential_{len(found)}"
        found[name] = power.args[0], float(sp.log(abs(number)))
        return sp.sign(number) * sp.Symbol(name, real=True) * (rest / power)

    return e.replace(huge, merged), found


def _with_exponents(value: Any, exponents: dict[str, Any]) -> Expr:
    """The expression in symengine, with the exponentials put back for their symbols and Piecewise for one-sided functions."""

    def rule(node: Expr, _: list[Expr]) -> Expr | None:
        if isinstance(node, se.Symbol) and str(node) in exponents:
            rest, number = exponents[str(node)]
            return se.exp(_with_exponents(rest, exponents) + number)
        return None

    return one_sided(rebuilt(se.sympify(value), rule))


def _complete(piecewise: Any) -> bool:
    """Whether a Piecewise has a value everywhere: one of its conditions is always true."""
    import sympy

    conditions = [condition for _, condition in piecewise.args]
    return bool(conditions[-1] == True or sympy.simplify_logic(sympy.Or(*conditions)) == True  # noqa: E712
                or sympy.Or(*conditions).simplify() == True)  # fmt: skip  # noqa: E712


_HEAD = "sensor("


def symbol_name(path: str) -> str:
    """Name of the symbol of a sensor."""
    return f"{_HEAD}{json.dumps(path, ensure_ascii=False)})"


def symbol(path: str) -> Expr:
    """The symbol of a sensor, as symengine sees it."""
    return se.Symbol(symbol_name(path))


def path_of(name: Any) -> str:
    """The path of the sensor a symbol stands for; "" where it stands for none."""
    return _path(str(name))


@lru_cache(maxsize=4096)
def _path(text: str) -> str:
    if not (text.startswith(f'{_HEAD}"') and text.endswith('")')):
        return ""
    try:
        return str(json.loads(text[len(_HEAD) : -1]))
    except ValueError:
        return ""


def paths(value: Any) -> list[str]:
    """The sensors on which a number or expression depends, in the order of their paths."""
    return [] if type(value) is float else sorted({path for s in getattr(value, "free_symbols", ()) if (path := path_of(s))})


def number(name: str, value: float) -> Any:
    """A number with a name, for expressions and arguments of statements: 3*mb.number("amplitude", 2.0)*sympy.sin(mb.t). Its name
    stands for it in `vary` and `mb.sweep`, and in derivatives; where the same name occurs again, it is the same number."""
    import sympy

    name = option("name", name, text, "give the number a name, text such as 'amplitude'")
    if not name.strip() or any(c in name for c in '."\\\n'):
        raise OptionError(f"name = {shown(name)}: give a name without dots, quotation marks and backslashes")
    value = option("value", value, finite, "give a number")
    return sympy.Symbol(number_symbol(name, value), real=True)


def number_symbol(name: str, value: float) -> str:
    """Name of the symbol of a named number."""
    return f'number("{name}", {float(value)!r})'


PLAIN = frozenset({float, int, bool, str, type(None)})  #: types of values that contain no named numbers


def numbers_in(value: Any, known: dict[str, float] | None = None) -> dict[str, float]:
    """The named numbers in a value, an expression, a law or lists and mappings of these: name -> value. known: those found
    before, to which they are added; BadValueError where one has two values."""
    found, known = dict[str, float](), {} if known is None else known
    if type(value) in PLAIN or (type(value) is list and all(type(part) is float for part in value)):
        return found
    for part in _parts(value):
        for symbol_ in part.free_symbols:
            if (named := named_by(symbol_)) is not None:
                name, size = named
                if known.setdefault(name, size) != size:
                    raise BadValueError(f"the number '{name}' has two values, {known[name]:g} and {size:g}")
                found[name] = size
    return found


def named_by(symbol_: Any) -> tuple[str, float] | None:
    """Name and value of the number that a symbol stands for; None where it stands for none."""
    said = str(symbol_)
    if not (said.startswith('number("') and said.endswith(")")):
        return None
    name, _, size = said[len('number("') : -1].rpartition('", ')
    return name, float(size)


def _parts(value: Any) -> Iterator[Any]:
    """The expressions in a value."""
    if _is_law(value):
        value = [getattr(value, key) for key in (*value.params, *value.options)]
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.dtype == object):
        for part in value:
            yield from _parts(part)
    elif isinstance(value, se.Basic) or ("sympy" in sys.modules and isinstance(value, sys.modules["sympy"].Basic)):
        yield value


def _is_law(value: Any) -> bool:
    return hasattr(type(value), "compose") and hasattr(type(value), "params")


def with_values(value: Any) -> Any:
    """The same with the values of named numbers in their places; what contains none is returned as it is."""
    if not numbers_in(value):
        return value
    if _is_law(value):
        law = copy.copy(value)
        for key in (*law.params, *law.options):
            setattr(law, key, with_values(getattr(law, key)))
        law.compose()
        return law
    if isinstance(value, Mapping):
        return {key: with_values(part) for key, part in value.items()}
    if not hasattr(value, "free_symbols"):
        return [with_values(part) for part in value]
    put = value.subs({s: named[1] for s in value.free_symbols if (named := named_by(s)) is not None})
    return put if put.free_symbols else float(put)


def refuse_symbols(value: Any, symbols: set[Expr], sensors: bool) -> None:
    """Raise BadValueError where an expression contains a symbol of no sensor, or one of a sensor although `sensors` is false."""
    others = sorted(str(s) for s in symbols if not (sensors and path_of(s)))
    if not others:
        return
    said = tables.readable(shown(value))
    if path := path_of(others[0]):
        of = "sensor" if "." in path else "signal"  # of an item, or of the whole scene
        raise BadValueError(f"{said} depends on the {of} '{path}': it may depend on the time mb.t alone; loads, states and "
                            f"other signals may depend on sensors and signals")
    allowed = "mb.t and sensors, s.sensor(path)," if sensors else "mb.t"
    raise BadValueError(f"{said} contains the symbol {others[0]}; only {allowed} may appear: put a number in its place")
