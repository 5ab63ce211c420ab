"""Expressions rebuilt with some of their parts replaced: one-sided functions, exponentials that would overflow."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import symengine as se

from mbdae.symbolic.vectors import Expr

LOGIC = ("And", "Or", "Not", "Xor")  #: connectives of conditions
#: name of a relation or connective -> function that makes it
CONDITIONS: dict[str, Any] = {"StrictLessThan": se.Lt, "LessThan": se.Le, "Equality": se.Eq, "Unequality": se.Ne,
                               **{name: getattr(se, name) for name in LOGIC}}  # fmt: skip
ONE_SIDED = ("Abs", "Max", "Min", "sign", "ceiling", "UnevaluatedExpr")  #: functions that are rewritten with Piecewise and floor
STEPPED = ("floor", "ceiling", "sign", "Piecewise")  #: functions that jump where their derivatives do not show it
LARGEST = 300.0  #: bound of exponents in denominators: exp(-300) = 5e-131 is as good as 0, and exp(300)^2 does not overflow


def nodes(e: Expr) -> list[Expr]:
    """Every subexpression once, after its own parts; conditions included."""
    found: dict[Expr, None] = {}

    def visit(node: Expr) -> None:
        if node not in found:
            for part in node.args:
                visit(part)
            found[node] = None

    visit(e)
    return list(found)


def symbols_of(expressions: Iterable[Any]) -> set[Expr]:
    """The symbols in some expressions, in one pass: much faster than one after the other where they share parts."""
    row = list(map(se.sympify, expressions))
    return set(se.Matrix(1, len(row), row).free_symbols) if row else set()


def substituted(e: Expr, table: dict[Expr, Expr]) -> Expr:
    """e with its symbols replaced by their values in a table, where they have one."""
    return e.subs({x: table[x] for x in e.free_symbols if x in table})


def rebuilt(e: Expr, rule: Callable[[Expr, list[Expr]], Expr | None]) -> Expr:
    """The expression with every part, from the inside out, replaced by what rule(part, its arguments) gives; None keeps it."""
    made: dict[Expr, Expr] = {}
    for node in nodes(e):
        args = [made[part] for part in node.args]
        found = rule(node, args)
        made[node] = found if found is not None else node if list(node.args) == args else joined(node, args)
    return made[e]


def joined(node: Expr, args: list[Expr]) -> Expr:
    """The function or condition of a node, with other arguments."""
    if isinstance(node, se.Piecewise):
        return se.Piecewise(*((args[i], args[i + 1]) for i in range(0, len(args), 2)))
    if isinstance(node, se.FunctionSymbol):
        return se.Function(node.get_name())(*args)
    make = CONDITIONS.get(type(node).__name__)
    return make(*args) if make is not None else node.func(*args)


def is_condition(node: Expr) -> bool:
    """Whether a node is a condition: a relation, relations joined by logic, True or False."""
    name = type(node).__name__
    return name in CONDITIONS or name in ("BooleanTrue", "BooleanFalse")


def jumps_with(e: Expr, symbols: set[Expr]) -> bool:
    """Whether an expression contains a function that jumps and is constant elsewhere, of an argument with some of the symbols."""
    return any(type(node).__name__ in STEPPED and node.free_symbols & symbols for node in nodes(e))


def one_sided(e: Expr) -> Expr:
    """The expression with Piecewise for Abs, sign, Max and Min, and floor for ceiling: functions that have derivatives. Brackets
    (UnevaluatedExpr) are left out."""

    def rule(node: Expr, args: list[Expr]) -> Expr | None:
        name = type(node).__name__
        if name in ("Max", "Min"):
            return _extreme(args, largest=name == "Max")
        if name == "Abs":
            return se.Piecewise((args[0], args[0] >= 0), (-args[0], True))
        if name == "sign":
            return se.Piecewise((se.Integer(1), args[0] > 0), (se.Integer(-1), args[0] < 0), (se.Integer(0), True))
        if name == "UnevaluatedExpr":
            return args[0]
        return -se.floor(-args[0]) if name == "ceiling" else None

    e = se.sympify(e)
    return rebuilt(e, rule) if any(type(node).__name__ in ONE_SIDED for node in nodes(e)) else e


def _extreme(args: list[Expr], largest: bool) -> Expr:
    found = args[0]
    for other in args[1:]:
        found = se.Piecewise((found, found >= other if largest else found <= other), (other, True))
    return found


def without_overflow(e: Expr) -> Expr:
    """The expression with bounded exponentials in its denominators.

    1/cosh(u) and 1/(1 + exp(u)) are small for large u, but their derivatives are then quotients of two numbers that overflow.
    Where |u| exceeds `LARGEST`, the exponential keeps its value at that limit."""
    e = se.sympify(e)
    if not any(_overflows(node) for node in nodes(e)):
        return e

    def bounded(node: Expr, args: list[Expr]) -> Expr | None:
        if isinstance(node, se.Piecewise) and se.RealDouble(LARGEST) in node.args[1].args:
            return node  # it is bounded already
        if not _overflows(node):
            return None
        u = args[1] if isinstance(node, se.Pow) else args[0]
        function = se.exp if isinstance(node, se.Pow) else node.func
        most, least = (function(se.RealDouble(end)) for end in (LARGEST, -LARGEST))
        return se.Piecewise((most, u > LARGEST), (least, u < -LARGEST), (function(u), True))

    def rule(node: Expr, args: list[Expr]) -> Expr | None:
        below = isinstance(node, se.Pow) and node.args[1].is_number and float(node.args[1]) < 0
        return rebuilt(args[0], bounded) ** args[1] if below else None

    return rebuilt(e, rule)


def _overflows(node: Expr) -> bool:
    """Whether a node is exp, cosh or sinh of something that varies; symengine's exp is a power of e."""
    exponential = isinstance(node, se.Pow) and node.args[0] == se.E and bool(node.args[1].free_symbols)
    return exponential or type(node).__name__ in ("cosh", "sinh")
