"""Derivatives of formulas by the rules of calculus, where every quantity is a number or a function of time: exact however they
nest.

What the letters of a formula are, what an equation defines, and whether it restricts a motion instead of holding for all.

Derivatives of other quantities (axes of bodies, rows of laws, ...) are taken by complex steps and differences, see `evaluate`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from mbdae.audit.notation import Node, is_zero, made, negated, number, symbol

TIME = "time"  #: wording of the time itself
Key = tuple[str, ...]
ARGUMENTS = ("s", "x", "y", "z", "r", "\\xi", "\\eta", "\\zeta")  #: letters by which primes derive
ZERO, ONE, TWO = number(0), number(1), number(2)
MOVING = ("function of time", "vector function of time")
FIXED = ("number", "positive number", "angle", "vector", "matrix", "symmetric matrix")
_U = symbol("u")


def _call(name: str, *parts: Node) -> Node:
    return Node("call", name, parts)


def _over(below: Node) -> Node:
    return made("product", ONE, made("inverse", below))


def _square(sign: int) -> Node:
    return made("sum", ONE, made("power", _U, TWO) if sign > 0 else negated(made("power", _U, TWO)))


#: derivatives of functions of u by u
_RULES = {
    "sin": _call("cos", _U), "cos": negated(_call("sin", _U)), "tan": _over(made("power", _call("cos", _U), TWO)),
    "sinh": _call("cosh", _U), "cosh": _call("sinh", _U), "tanh": _over(made("power", _call("cosh", _U), TWO)),
    "exp": _call("exp", _U), "log": _over(_U), "sqrt": _over(made("product", TWO, _call("sqrt", _U))), "abs": _call("sign", _U),
    "asin": _over(_call("sqrt", _square(-1))), "acos": negated(_over(_call("sqrt", _square(-1)))), "atan": _over(_square(1)),
    "asinh": _over(_call("sqrt", _square(1))), "atanh": _over(_square(-1)), "sign": ZERO,
}


class NoRuleError(Exception):
    """A formula without a rule for its derivative."""


def exact(node: Node, scope: Any) -> Node | None:
    """A derivative, `rate(e)` or `diff(e, x)`, as a formula in quantities and their rates; None where no rule gives it."""
    known = scope.derivatives
    if node not in known:
        known[node] = None  # while it is looked for: a definition that contains itself has none
        with suppress(NoRuleError, RecursionError):
            known[node] = _expanded(node, scope)
    return known[node]  # type: ignore[no-any-return]


def chain(node: Node) -> tuple[str, int] | None:
    """The symbol and the order of `rate(rate(symbol))`; None for other formulas."""
    order = 0
    while node.kind == "call" and node.value == "rate":
        order, node = order + 1, node.parts[0]
    return (node.value, order) if node.kind == "symbol" else None


def _expanded(node: Node, scope: Any) -> Node:
    """A formula without derivatives of anything but functions of time, its definitions written out."""
    if node.kind == "symbol":
        meaning = scope.symbols.get(node.value)
        if meaning is None or meaning.phrase.wording in (*MOVING, *FIXED, TIME):
            return node
        if getattr(meaning, "node", None) is None:
            raise NoRuleError
        reached = meaning.scope.reached(meaning.node.free)
        if any(scope.symbols.get(n) is not meaning.scope.symbols[n] for n in reached):  # it was declared anew since
            raise NoRuleError
        return _expanded(meaning.node, scope)
    if node.kind == "call" and node.value == "rate":
        return _derived(_expanded(node.parts[0], scope), lambda name, order: _rate(name, order, scope))
    if node.kind == "call" and node.value == "diff":
        by = chain(node.parts[1])
        meaning = scope.symbols.get(by[0]) if by else None
        if meaning is None or meaning.phrase.wording not in ("function of time", "number", "positive number", "angle", TIME):
            raise NoRuleError
        return _derived(_expanded(node.parts[0], scope), lambda name, order: ONE if (name, order) == by else ZERO)
    if node.kind == "call" and node.value in ("sum", "delta", "slope"):
        raise NoRuleError
    return node.with_parts(tuple(_expanded(p, scope) for p in node.parts)) if node.parts else node


def _rate(name: str, order: int, scope: Any) -> Node:
    meaning = scope.symbols.get(name)
    if meaning is None or meaning.phrase.wording in FIXED:
        return ZERO
    if meaning.phrase.wording == TIME:
        return ZERO if order else ONE
    found = symbol(name)
    for _ in range(order + 1):
        found = _call("rate", found)
    return found


def _derived(node: Node, leaf: Callable[[str, int], Node]) -> Node:
    """The derivative of an expanded formula; leaf: that of a symbol's rate of an order."""
    if node.kind == "number":
        return ZERO
    place = chain(node)
    if place is not None:
        return leaf(*place)
    if node.kind == "call" and node.value == "integral":
        return _of_integral(node, leaf)
    parts = [_derived(p, leaf) for p in node.parts]
    if all(map(is_zero, parts)):
        return ZERO
    if node.kind in ("cross", "transposed", "neg"):
        return negated(parts[0]) if node.kind == "neg" else made(node.kind, parts[0])
    if node.kind == "sum":
        return made("sum", *(p for p in parts if not is_zero(p)))
    if node.kind == "product":
        return made("sum", *(_times(*node.parts[:i], p, *node.parts[i + 1 :]) for i, p in enumerate(parts) if not is_zero(p)))
    if node.kind == "inverse":
        return negated(_times(parts[0], made("inverse", made("power", node.parts[0], TWO))))
    if node.kind == "power":
        return _power(node, parts)
    if node.kind in ("block", "row"):
        return node.with_parts(tuple(row.with_parts(tuple(_derived(p, leaf) for p in row.parts)) for row in node.parts))
    if node.kind == "call" and node.value == "norm":
        return _times(made("transposed", node.parts[0]), parts[0], made("inverse", node))
    if node.kind == "call" and node.value in _RULES:
        return _times(_RULES[node.value].replaced({_U: node.parts[0]}), parts[0])
    raise NoRuleError


def _of_integral(node: Node, leaf: Callable[[str, int], Node]) -> Node:
    """By Leibniz's rule: that of the integrand, and what the limits add by their change."""
    inside, over, *ends = node.parts
    body = _derived(inside, lambda name, order: ZERO if name == over.value else leaf(name, order))
    terms = [] if is_zero(body) else [Node("call", "integral", (body, over, *ends))]
    for end, sign in zip(ends, (-1, 1), strict=True):
        change = _derived(end, leaf)
        if not is_zero(change):
            term = _times(inside.replaced({over: end}), change)
            terms.append(term if sign > 0 else negated(term))
    return made("sum", *terms) if terms else ZERO


def unfolded(node: Node, name: str, scope: Any) -> Node:
    """A formula in which definitions that contain a symbol, over which it is summed or integrated, are written out."""
    table = {}
    for n in node.free - {name}:
        meaning = scope.symbols.get(n)
        formula = getattr(meaning, "node", None)
        if formula is not None and name in meaning.scope.reached(formula.free):
            table[symbol(n)] = unfolded(formula, name, scope)
    return node.replaced(table) if table else node


def _power(node: Node, parts: list[Node]) -> Node:
    base, exponent = node.parts
    if base.kind in ("block", "cross") or exponent == negated(ONE):
        raise NoRuleError
    if is_zero(parts[1]):
        less = number(exponent.value - 1) if exponent.kind == "number" else made("sum", exponent, negated(ONE))
        power = base if less == ONE else made("power", base, less)
        return _times(exponent, power, parts[0])
    terms = [_times(node, _call("log", base), parts[1])]
    if not is_zero(parts[0]):
        terms.append(_times(node, exponent, parts[0], made("inverse", base)))
    return made("sum", *terms)


def _times(*factors: Node) -> Node:
    kept = [f for f in factors if f != ONE]
    return made("product", *kept) if kept else ONE


# -- letters of TeX, of which a formula is read


@dataclass
class Letters:
    """What the letters of a formula are: {keys of the pieces of the letter: name}, and what is known of formulas of them."""

    names: Mapping[Key, str]
    shape: Callable[[Node], tuple[int, ...] | None] = lambda node: ()  #: size of a value; None where it has none
    angle: Callable[[Node], bool | None] = lambda node: None  #: whether a value has no unit; None where nothing says
    radian: Callable[[Node], bool] = lambda node: False  #: whether it is a letter in rad
    contains: Callable[[str], frozenset[str]] = lambda name: frozenset()  #: names in the definition of a letter
    moving: frozenset[str] = frozenset()  #: names of functions of time
    time: frozenset[str] = frozenset()  #: names of the time
    functions: frozenset[str] = frozenset()  #: names that are printed with their arguments, as in g(v)
    written: dict[str, str] = field(default_factory=dict)  #: {formula in the notation: how the text prints it}

    def argument(self, node: Node) -> Node | None:
        """The letter by which a prime, or an order in brackets, derives a formula: of those that usually are such arguments the
        one that its definition contains; None where none or several do."""
        reached = frozenset[str]().union(*map(self.contains, node.free)) - {node.value}
        found = {name for letter in ARGUMENTS if (name := self.names.get((letter,))) in reached}
        return symbol(found.pop()) if len(found) == 1 else None


# -- what an equation defines or restricts


def _given_numbers(names: Iterable[str], scope: Any) -> set[str]:
    known = {n: scope.symbols[n] for n in names if n in scope.symbols}
    return {n for n, m in known.items() if m.phrase.given and m.text.removesuffix(f" {n}") in ("number", "positive number")}


def defined_by(statement: Any, scope: Any) -> list[str]:
    """Symbols declared as mere numbers that are one side of the statement and appear on no other side: it defines them."""
    out = []
    for i, side in enumerate(statement.sides):
        others = scope.reached(set().union(*(s.free for j, s in enumerate(statement.sides) if j != i)))
        if side.kind == "symbol" and _given_numbers([side.value], scope) - others:
            out.append(side.value)
    return out


def law_of_motion(equation: Any) -> str:
    """Why an equation that does not hold for every motion may be right all the same: it says how free quantities move, and no
    side of it is a quantity that something else defines; empty where it has to hold for every motion, as all formulas that are
    not from a paper in TeX."""
    scope = equation.scope
    given = {n for n in equation.used if scope.symbols[n].phrase.given}
    if not equation.place or equation.quantity is not None or any(scope.symbols[n].letter == "0" for n in equation.used):
        return ""
    for statement in equation.statements:
        rates = [piece for side in statement.sides for piece in side.walk() if piece.kind == "call" and piece.value == "rate"]
        reached = scope.reached(set().union(*(r.free for r in rates)))
        moving = sorted(n for n in reached if scope.symbols[n].phrase.wording in MOVING)
        defined = [s for s in statement.sides if s.free & set(scope.symbols) and (
            not s.free & given or (s.kind in _WHOLE and s.free - given - {"pi", "I"}))]
        changes = [s for s in statement.sides if any(_changes(term, given, scope) for term in _terms(s))]
        named = any(s.kind == "symbol" and s in defined for s in statement.sides)  # M = ..., where the table says what M is
        if moving and not named and (changes or not defined) and not _worked_out(statement, changes, scope):
            return (f"it says how {moving[0]} moves, and nothing else does: tell in the table what its left-hand side less its "
                    f"right-hand side is, as `equation {equation.number} [unit]: formula`")
    return ""


def _terms(node: Node) -> list[Node]:
    return [t for p in node.parts for t in _terms(p)] if node.kind in ("sum", "neg") else [node]


def _changes(term: Node, given: set[str], scope: Any) -> bool:
    """Whether a term is the rate of a momentum or an energy."""
    names = term.free & set(scope.symbols)
    return term.kind == "call" and term.value == "rate" and bool(names - given) and any(
        u.powers[1] for n in names for u in scope.symbols[n].units)


def _worked_out(statement: Any, changes: list[Node], scope: Any) -> bool:
    """Whether a statement works out the rate of a quantity instead of saying how it changes: nothing stands on its other sides
    that does not appear in that rate, as a force would, and no accelerations are missing there, which a law of motion gives."""
    def known(node: Node) -> tuple[set[str], int]:
        chains = filter(None, (chain(n) for n in node.walk()))
        return set(node.free) - {"pi", "I"}, max((order for _, order in chains), default=0)

    for side in changes:
        worked = not any(n.kind == "call" and n.value == "diff" for n in side.walk())
        whole = exact(side, scope) if worked else None
        with suppress(NoRuleError, RecursionError):
            others = [_expanded(s, scope) for s in statement.sides if s is not side]
            if whole is None or any(is_zero(o) or o.kind == "number" for o in others):
                continue
            names, order = known(whole)
            if all(n <= names and o == order for n, o in map(known, others)):
                return True
    return False


_WHOLE = ("call", "power", "symbol", "transposed", "cross")  #: sides that are one quantity, if something else defines it


def may_define(statement: Any, scope: Any) -> list[tuple[str, list[Any]]]:
    """Symbols declared as mere numbers that a statement may define, as f in w = 2 pi f: some sides contain them, by nothing else
    that the side prints, and others do not. With each, the statements that have to hold then: of those, and of the others."""
    out = dict[str, list[Any]]()
    if any(map(is_zero, statement.sides)) or any(m.letter == "0" for n, m in scope.symbols.items() if n in statement.symbols()):
        return []
    for side in statement.sides:
        for name in _given_numbers(side.free, scope):
            parts = [tuple(s for s in statement.sides if (name in scope.reached(s.free)) == own) for own in (True, False)]
            if all(parts) and name not in scope.reached(side.free - {name}):
                out[name] = [replace(statement, sides=part) for part in parts]
    return sorted(out.items(), key=lambda found: (len(found[1][0].sides), found[0]))
