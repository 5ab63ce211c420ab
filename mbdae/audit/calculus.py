"""Derivatives of formulas by the rules of calculus, where every quantity is a number or a function of time: exact however they
nest.

What the letters of a formula in TeX are, and which statements a display makes.

Derivatives of other quantities (axes of bodies, rows of laws, ...) are taken by complex steps and differences, see `evaluate`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from mbdae.audit.notation import Node, is_zero, made, negated, number, symbol
from mbdae.audit.tex_items import DOTS, NOT_READ, RELATIONS, Item, UnreadError, canonical

TIME = "time"  #: wording of the time itself
Key = tuple[str, ...]
ARGUMENTS = ("s", "x", "y", "z", "r", "\\xi", "\\eta", "\\zeta")  #: letters by which primes derive
ZERO, ONE, TWO = number(0), number(1), number(2)
MOVING = ("function of time", "vector function of time")
FIXED = ("number", "positive number", "angle", "vector", "matrix", "symmetric matrix")
_U = symbol("u")


def factors_of(node: Node) -> tuple[Node, ...]:
    """The factors of a product; a formula that is none alone."""
    return node.parts if node.kind == "product" else (node,)


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
            known[node] = expanded(node, scope)
    return known[node]  # type: ignore[no-any-return]


def chain(node: Node) -> tuple[str, int] | None:
    """The symbol and the order of `rate(rate(symbol))`; None for other formulas."""
    order = 0
    while node.kind == "call" and node.value == "rate":
        order, node = order + 1, node.parts[0]
    return (node.value, order) if node.kind == "symbol" else None


def expanded(node: Node, scope: Any) -> Node:
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
        return expanded(meaning.node, scope)
    if node.kind == "call" and node.value == "rate":
        return _derived(expanded(node.parts[0], scope), lambda name, order: _rate(name, order, scope))
    if node.kind == "call" and node.value == "diff":
        by = chain(node.parts[1])
        meaning = scope.symbols.get(by[0]) if by else None
        if meaning is None or meaning.phrase.wording not in ("function of time", "number", "positive number", "angle", TIME):
            raise NoRuleError
        return _derived(expanded(node.parts[0], scope), lambda name, order: ONE if (name, order) == by else ZERO)
    if node.kind == "call" and node.value in ("sum", "delta", "slope"):
        raise NoRuleError
    return node.with_parts(tuple(expanded(p, scope) for p in node.parts)) if node.parts else node


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


def expanded_or_none(node: Node, scope: Any) -> Node | None:
    """A formula with its definitions written out and its derivatives worked out; None where no rule gives them."""
    with suppress(NoRuleError, RecursionError):
        return expanded(node, scope)
    return None


def _within(node: Node, outer: Node = ZERO) -> Iterator[tuple[Node, Node]]:
    """All pieces of a formula, each with the piece around it."""
    yield node, outer
    for part in node.parts:
        yield from _within(part, node)


# -- letters and statements of TeX, of which formulas are read


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
    expanded: Callable[[Node], Node | None] = lambda node: None  #: a formula with its definitions written out; None where unknown
    written: dict[str, str] = field(default_factory=dict)  #: {formula in the notation: how the text prints it}

    def argument(self, node: Node) -> Node | None:
        """The letter by which a prime, or an order in brackets, derives a formula: of those that usually are such arguments the
        one that its definition contains; None where none or several do."""
        reached = frozenset[str]().union(*map(self.contains, node.free)) - {node.value}
        found = {name for letter in ARGUMENTS if (name := self.names.get((letter,))) in reached}
        return symbol(found.pop()) if len(found) == 1 else None

    def derived(self, node: Node, by: Node, partial: bool) -> Node:
        """The derivative of a formula by a letter: by the time the whole one, unless it is partial; so by what moves, of a
        formula that contains its rates alone, as in v dv/dx."""
        if by.kind == "symbol" and by.value in self.time:
            reached = frozenset[str]().union(*map(self.contains, node.free))
            if not partial or ((own := chain(node)) and own[0] in self.moving):
                return Node("call", "rate", (node,))
            if by.value not in reached and reached & self.moving:
                raise UnreadError(f"`\\partial` by {by} of what does not contain it in the table may be that of a field, or 0: "
                                  "print `d` for the whole derivative")
        whole = self.expanded(node) if by.kind == "symbol" and by.value in self.moving and not partial else None
        orders = {n[1] for piece, outer in _within(whole) if (n := chain(piece)) and n[0] == by.value and not chain(outer)
                  } if whole is not None else set()
        if orders and 0 not in orders:
            return made("product", Node("call", "rate", (node,)), made("inverse", Node("call", "rate", (by,))))
        if len(orders) > 1:
            raise UnreadError(f"`d` by {by} of what contains it and its rate may be the whole derivative or a partial one: for "
                              "that print `\\partial`")
        return Node("call", "diff", (node, by))

    def filled(self, cells: Sequence[Node]) -> Sequence[Node]:
        """A row of a matrix in which a number beside a vector or matrix of three rows stands for so many times the identity."""
        shapes = [self.shape(c) for c in cells]
        if not any(s is not None and len(s) == 2 and s[0] == 3 for s in shapes):
            return cells
        return [made("product", *factors_of(c), symbol("I")) if s == () and c.kind != "number" else c
                for c, s in zip(cells, shapes, strict=True)]

    def dotted(self, left: list[Node], right: list[Node]) -> list[Node]:
        """Factors with a dot between them: a column before it is a row, where what follows has as many rows."""
        rows = self.shape(made("product", *left))
        shapes = (self.shape(made("product", *right[:k])) for k in range(1, len(right) + 1))
        meet = rows is not None and rows[1:] == (1,) and any(s is not None and len(s) == 2 and s[0] == rows[0] for s in shapes)
        return [made("transposed", made("product", *left)), *right] if meet else [*left, *right]

    def inner(self, cells: Sequence[Node]) -> list[Node]:
        """The inner product of two vectors; nothing for other formulas."""
        shapes = [self.shape(c) for c in cells]
        fits = len(cells) == 2 and shapes[0] == shapes[1] and shapes[0] in ((2, 1), (3, 1))
        return [made("product", made("transposed", cells[0]), *factors_of(cells[1]))] if fits else []

    def whole(self, name: str, argument: str | None, present: frozenset[str]) -> bool:
        """Whether a letter with an argument is all of what it is defined as, as V(l), M(x), and no value at a place, as M(l):
        nothing that it depends on is missing in the statement, and its argument is the place where its definition has one."""
        own = self.contains(name)
        places = own & {n for letter in ARGUMENTS if (n := self.names.get((letter,)))}
        there = frozenset[str]().union(*map(self.contains, present - {name}))
        return not places - {argument} and {n for n in own if self.contains(n) == {n}} <= there

    def near(self, letter: str) -> str:
        """What to do about a letter without a line, where a name of the table differs from it by its TeX alone."""
        def plain(text: str) -> str:
            return re.sub(r"\\?mathrm|\W|_", "", text)

        names = sorted({n for n in self.names.values() if plain(n) == plain(letter)})
        return f": if it is {names[0]} of the table, give that its TeX, as {names[0]} [unit] ${letter}$" if names else ""


def related(items: Sequence[Item]) -> tuple[list[list[Item]], list[str]]:
    """The sides of a statement, and the relations between them."""
    parts, signs = [list[Item]()], list[str]()
    for item in items:
        if item.kind == "relation":
            if item.text in NOT_READ:
                raise UnreadError(f"`{item.text}` marks {NOT_READ[item.text]}")
            signs.append(RELATIONS[item.text])
            parts.append([])
        else:
            parts[-1].append(item)
    return parts, signs


def _indexed(items: Sequence[Item], letter: str, value: int) -> tuple[Item, ...]:
    """Items with a number in place of an index, whose sums with figures are worked out: with i = 2, x_{i-1} is x_1."""
    out = []
    for item in items:
        parts = tuple(tuple(_indexed(c, letter, value) for c in p) if p and isinstance(p[0], tuple) else
                      _indexed(p, letter, value) for p in item.parts)
        sub, sup = (_indexed(script, letter, value) for script in (item.sub, item.sup))
        if item.kind == "letter" and item.key("") == letter and not item.sub:
            item = Item("number", str(value))
        if len(sub) == 3 and sub[1].text in ("+", "-") and {sub[0].kind, sub[2].kind} == {"number"}:
            sub = (Item("number", str(int(sub[0].text) + int(sub[2].text) * (1 if sub[1].text == "+" else -1))),)
        out.append(replace(item, parts=parts, sub=sub, sup=sup))
    return tuple(out)


def counted(pieces: list[tuple[list[Item], bool]]) -> list[tuple[list[Item], bool]]:
    """The statements of a display; where it ends in an enumeration, as i = 1, 2, each statement with that index once for each."""
    for n, (piece, _) in enumerate(pieces):
        after = [p for p, _ in pieces[n + 1 :]]
        single = len(piece) == 3 and piece[0].kind == "letter" and piece[1].text == "=" and piece[2].kind == "number"
        dots = [p for p in after if len(p) == 1 and p[0].text in DOTS]
        if not n or not single or not after or not all(len(p) == 1 and p[0].kind in ("number", "letter") for p in after):
            continue
        if after[-1][0].kind != "number":
            raise UnreadError(f"it does not say how far {piece[0].key()} counts: print its equations one by one")
        ends = int(piece[2].text), int(after[-1][0].text)
        values = range(ends[0], ends[1] + 1) if dots else [ends[0], *(int(p[0].text) for p in after)]
        out = []
        for said, condition in pieces[:n]:
            many = [list(_indexed(said, piece[0].key(), value)) for value in values]
            out += [(one, condition) for one in (many if canonical(many[0]) != canonical(many[-1]) else many[:1])]
        return out
    return pieces
