"""The notation of printed formulas: text read into trees, trees written as text.

    a + b, a - b, a*b, a/b, a^2     sums, (matrix) products, quotients, powers
    ~b                              the matrix with ~b c = b x c
    b'                              transposed
    [a, b; c, d]                    blocks; a 0 takes the size of its row and column, I is 3 x 3
    M^-1                            inverse, of a matrix too
    norm(u) abs(v) sign sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh exp log sqrt atan2(y, x) trace(M) det(M)
    delta(e)                        change of e by a virtual displacement
    rate(e)                         time derivative of e, rate(rate(e)) the second one
    slope(e)                        derivative of e by the length of a line
    diff(e, x)                      derivative of e by the number or column x (a column: of width 1 by every entry)
    sum(e, i, a, b)                 sum of e over i = a, a + 1, ..., b
    integral(e, x, a, b)            integral of e over x from a to b

A statement is `side = side`, `side = side = 0` or `side <= side`; an assumption `a < b`, `a < b < c`, `a != b`, `a in (b, c)`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from mbdae.errors import MbdaeError

PLAIN = ("abs", "sign", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh",
         "atanh", "exp", "log", "sqrt")
FUNCTIONS = dict.fromkeys((*PLAIN, "norm", "trace", "det", "delta", "rate", "slope"), 1) | {
    "atan2": 2, "diff": 2, "sum": 4, "integral": 4}
BINDING = ("sum", "integral")  #: functions whose second argument is a bound name
_TOKEN, _COMPARED = (re.compile(rf"\s*(?:(\d+\.?\d*(?:[eE][+-]?\d+)?)|([^\W\d]\w*)|({signs}[-+*/^'~()\[\],;=]))")
                     for signs in ("<=|", "<=|>=|!=|<|>|"))

GIVE_OWN_CLASS = "give a class of your own as mb.audit(..., laws={{'{0}': {0}}})"  #: what to do where a law is not known


class AuditError(MbdaeError):
    """A file of printed formulas that cannot be read; the message names the line and its text."""


@dataclass(frozen=True)
class Node:
    """A node of the tree of a formula: kind, name or number, parts.

    kinds: number, symbol, sum (terms), neg, product (factors), inverse, power, cross (~), transposed, call, block (rows), row.
    """

    kind: str
    value: Any = None
    parts: tuple[Node, ...] = ()

    def __hash__(self) -> int:
        known = self.__dict__.get("hashed")
        if known is None:
            known = hash((self.kind, self.value, self.parts))
            object.__setattr__(self, "hashed", known)
        return int(known)

    def walk(self) -> Iterator[Node]:
        """This node and all nodes below it."""
        yield self
        for part in self.parts:
            yield from part.walk()

    @cached_property
    def free(self) -> frozenset[str]:
        """Names that appear, without those bound by a sum or an integral."""
        if self.kind == "symbol":
            return frozenset((self.value,))
        if self.kind == "call" and self.value in BINDING:
            body, name, *ends = self.parts
            return (body.free - {name.value}).union(*(e.free for e in ends))
        return frozenset().union(*(p.free for p in self.parts))

    def with_parts(self, parts: tuple[Node, ...]) -> Node:
        """This node with other parts; a sum or product of a single part becomes that part."""
        return made(self.kind, *parts) if self.value is None else Node(self.kind, self.value, parts)

    def replaced(self, table: Mapping[Node, Node]) -> Node:
        """This formula with the pieces in the table replaced, wherever they appear."""
        if self in table:
            return table[self]
        return self.with_parts(tuple(p.replaced(table) for p in self.parts)) if self.parts else self

    def __str__(self) -> str:
        return _text(self, 0)


Comparison = tuple[Node, str, Node]  #: the sides of an assumption with the sign between them


@dataclass(frozen=True)
class Relation:
    """Sides joined by `=` or `<=`, and the line of the file they stand in."""

    sides: tuple[Node, ...]
    relation: str = "="
    line: int = 0

    @property
    def compared(self) -> tuple[Node, ...]:
        """The sides whose values are compared: of an equation all but the literal 0, of a bound all."""
        return self.sides if self.relation == "<=" else tuple(side for side in self.sides if not is_zero(side))

    @property
    def ends_at_zero(self) -> bool:
        """Whether the statement is an equation with the side 0, so that its other sides must vanish."""
        return self.relation == "=" and any(map(is_zero, self.sides))

    @property
    def subject(self) -> Node:
        """The side that says what the statement is about: the first that is not the literal 0."""
        return next((side for side in self.sides if not is_zero(side)), self.sides[0])

    def symbols(self) -> set[str]:
        """Names that appear."""
        return set().union(*(side.free for side in self.sides))

    def __str__(self) -> str:
        return f" {self.relation} ".join(map(str, self.sides))


def number(value: float) -> Node:
    """A number as a piece of a formula."""
    return Node("number", float(value))


def symbol(name: str) -> Node:
    """A symbol as a piece of a formula."""
    return Node("symbol", name)


def made(kind: str, *parts: Node) -> Node:
    """A piece made of parts; a sum or product of a single part becomes that part."""
    return parts[0] if kind in ("sum", "product") and len(parts) == 1 else Node(kind, None, parts)


ZERO = number(0)


def is_zero(node: Node) -> bool:
    """Whether a side is the literal 0."""
    return bare(node) == ZERO


def bare(node: Node) -> Node:
    """The piece without a leading minus sign."""
    return node.parts[0] if node.kind == "neg" else node


def negated(node: Node) -> Node:
    """The piece with the opposite sign."""
    return node.parts[0] if node.kind == "neg" else made("neg", node)


# -- reading


class TextReader:
    """Reads one statement."""

    def __init__(self, text: str, line: int = 0, relations: bool = False) -> None:
        self.text, self.line, self.at = text, line, 0
        self.tokens = _tokens(text, line, _COMPARED if relations else _TOKEN)

    def statement(self) -> Relation:
        """The whole text as a statement; AuditError where it is none."""
        sides, relation = [self._sum()], "="
        while found := self._accept("=", "<="):
            if len(sides) > 1 and found != relation:
                raise self._error("'=' and '<=' stand in one statement: write two statements")
            relation = found
            sides.append(self._sum())
        self._end()
        if len(sides) == 1:
            raise self._error("a statement needs '=' or '<=' between two sides")
        return Relation(tuple(sides), relation, self.line)

    def assumption(self) -> tuple[Comparison, ...]:
        """The whole text as comparisons; AuditError where it is none."""
        sides, signs = [self._sum()], list[str]()
        while sign := self._accept("<", ">", "<=", ">=", "!="):
            signs.append(sign)
            sides.append(self._sum())
        if not signs and self._accept("in") and self._accept("(", "["):
            low, *high = self._list()
            if len(high) == 1 and self._accept(")", "]"):
                sides, signs = [low, sides[0], high[0]], ["<", "<"]
        self._end()
        if not signs:
            raise self._error("an assumption needs '<', '>', '<=', '>=' or '!=' between two sides, or is `x in (a, b)`")
        return tuple(zip(sides, signs, sides[1:], strict=False))

    def expression(self) -> Node:
        """A formula without a relation."""
        found = self._sum()
        self._end()
        return found

    def _error(self, problem: str) -> AuditError:
        return AuditError(f"line {self.line}: {problem} (in '{self.text.strip()}')")

    def _next(self) -> str | None:
        return self.tokens[self.at] if self.at < len(self.tokens) else None

    def _accept(self, *wanted: str) -> str:
        """Consume the next token if it is one of those wanted and return it; else return an empty string."""
        token = self._next()
        self.at += token in wanted
        return token if token is not None and token in wanted else ""

    def _end(self) -> None:
        if self._next() is not None:
            raise self._error(f"'{self._next()}' follows a complete formula: put an operator before it, or leave it out")

    def _demand(self, wanted: str) -> None:
        if not self._accept(wanted):
            raise self._error(f"'{wanted}' is missing" + (f" before '{self._next()}'" if self._next() else ""))

    def _sum(self) -> Node:
        terms = [self._term(self._accept("-", "+"))]
        while sign := self._accept("-", "+"):
            terms.append(self._term(sign))
        return made("sum", *terms)

    def _term(self, sign: str) -> Node:
        factors = [self._prefixed()]
        while relation := self._accept("*", "/"):
            factor = self._prefixed()
            factors.append(made("inverse", factor) if relation == "/" else factor)
        term = made("product", *factors)
        return negated(term) if sign == "-" else term

    def _prefixed(self) -> Node:
        if self._accept("-"):
            return negated(self._prefixed())
        base = self._postfixed()
        if not self._accept("^"):
            return base
        sign, exponent = self._accept("-"), self._postfixed()
        return made("power", base, negated(exponent) if sign else exponent)

    def _postfixed(self) -> Node:
        node = self._atom()
        while self._accept("'"):
            node = made("transposed", node)
        return node

    def _atom(self) -> Node:
        if self._accept("~"):
            return made("cross", self._atom())
        if self._accept("("):
            inner = self._sum()
            self._demand(")")
            return inner
        if self._accept("["):
            return self._block()
        token = self._next()
        if token is None:
            raise self._error("the formula ends where a number, a name or a bracket should follow")
        self.at += 1
        if token[0].isdigit():
            return number(float(token))
        if token.isidentifier():
            return self._call(token) if self._accept("(") else symbol(token)
        raise self._error(f"'{token}' stands where a number, a name or a bracket should stand")

    def _list(self) -> tuple[Node, ...]:
        parts = [self._sum()]
        while self._accept(","):
            parts.append(self._sum())
        return tuple(parts)

    def _call(self, name: str) -> Node:
        if name not in FUNCTIONS:
            raise self._error(f"'{name}' is no function of the notation; there are {', '.join(sorted(FUNCTIONS))}")
        parts = self._list()
        self._demand(")")
        if len(parts) != FUNCTIONS[name]:
            raise self._error(f"'{name}' takes {FUNCTIONS[name]} argument{'s' * (FUNCTIONS[name] > 1)}, not {len(parts)}")
        if name in BINDING and parts[1].kind != "symbol":
            raise self._error(f"the second argument of '{name}' must be the name of its variable, as in {name}(e, i, a, b)")
        return Node("call", name, parts)

    def _block(self) -> Node:
        rows = [made("row", *self._list())]
        while self._accept(";"):
            rows.append(made("row", *self._list()))
        self._demand("]")
        if len({len(row.parts) for row in rows}) > 1:
            raise self._error("the rows of a block differ in length: give each the same number of entries")
        return made("block", *rows)


def _tokens(text: str, line: int, pattern: re.Pattern[str]) -> list[str]:
    found, at = [], 0
    while text[at:].strip():
        match = pattern.match(text, at)
        if text[at:].strip().startswith((">", "<")) and match is None:
            raise AuditError(f"line {line}: write a bound as `smaller <= larger`, not with '<', '>', '>=' (in '{text.strip()}')")
        if match is None:
            raise AuditError(f"line {line}: '{text[at:].strip()[0]}' is not in the notation, which has names, numbers and "
                             f"+ - * / ^ ~ ' ( ) [ ] , ; = <= (in '{text.strip()}')")
        found.append(match.group().strip())
        at = match.end()
    return found


# -- writing


def _text(node: Node, level: int) -> str:
    """Text of a node; level 0: in a sum, 1: in a product, 2: under a power, a prime or a tilde."""
    kind, parts = node.kind, node.parts
    if kind == "number":
        return f"{node.value:g}"
    if kind == "symbol":
        return str(node.value)
    if kind == "call":
        return f"{node.value}({', '.join(_text(p, 0) for p in parts)})"
    if kind == "block":
        return "[" + "; ".join(", ".join(_text(p, 0) for p in row.parts) for row in parts) + "]"
    if kind == "cross":
        return "~" + _text(parts[0], 2)
    if kind == "transposed":
        return _text(parts[0], 2) + "'"
    if kind == "power":
        return _text(parts[0], 2) + ("^-" if parts[1].kind == "neg" else "^") + _text(bare(parts[1]), 2)
    text, own = _compound(node)
    return f"({text})" if level > own else text


def _compound(node: Node) -> tuple[str, int]:
    """Text of a sum, a product, a sign or an inverse, and the highest level at which it needs no brackets."""
    if node.kind == "neg":
        return "-" + _text(node.parts[0], 1), 0
    if node.kind == "inverse":
        return "1/" + _text(node.parts[0], 2), 1
    if node.kind == "sum":
        text = _text(node.parts[0], 0)
        for term in node.parts[1:]:
            text += f" - {_text(term.parts[0], 1)}" if term.kind == "neg" else f" + {_text(term, 1)}"
        return text, 0
    text = _text(node.parts[0], 1)
    for factor in node.parts[1:]:
        text += "/" + _text(factor.parts[0], 2) if factor.kind == "inverse" else "*" + _text(factor, 1)
    return text, 1
