"""Small changes of a formula: what a slip of the pen or of the press does, one at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from mbdae.errors import MbdaeError
from mbdae.reports.audit.evaluate import SizeError
from mbdae.reports.audit.meaning import Env, Scope
from mbdae.reports.audit.notation import Node, negated, number, symbol

Edited = tuple["Edit", Node]
_EXCHANGED = {"sin": "cos", "cos": "sin"}


@dataclass(frozen=True)
class Edit:
    """A change in words, and the pieces it replaces wherever they stand (empty where it is tied to its place)."""

    words: str
    table: tuple[tuple[Node, Node], ...] = ()
    resizes: bool = False  #: whether sizes may change


class Candidates:
    """Symbols that may stand for another: of the same unit and size; with dots more or fewer."""

    def __init__(self, scope: Scope, env: Env) -> None:
        self.scope, self.env = scope, env
        self.sizes: dict[str, tuple[int, ...]] = {}

    def _size(self, name: str) -> tuple[int, ...]:
        if name not in self.sizes:
            try:
                self.sizes[name] = np.shape(self.env.value(name))
            except (SizeError, MbdaeError):
                self.sizes[name] = (0,)
        return self.sizes[name]

    def of(self, name: str) -> Iterator[str]:
        """Names that may stand where `name` stands."""
        if name not in self.scope.symbols:
            return
        stem, dots = _dots(name)
        units = self.scope.symbols[name].units
        for other in self.scope.symbols:
            if other != name:
                near = _dots(other)
                family = near[0] == stem and near[1] != dots
                if (family or self.scope.symbols[other].units == units) and self._size(other) == self._size(name):
                    yield other


    def numbers(self) -> list[str]:
        """Symbols that are numbers."""
        return [name for name in self.scope.symbols if self._size(name) == ()]


def _dots(name: str) -> tuple[str, int]:
    for ending, dots in (("ddot", 2), ("dot", 1)):
        if name.endswith(ending):
            return name.removesuffix(ending), dots
    return name, 0


def edits(node: Node, candidates: Candidates) -> Iterator[Edited]:
    """The formula after every single change: first those of single places, then those of all places alike."""
    yield from _inside(node, candidates, lambda new: new)
    yield from everywhere(node, candidates)
    yield from _exchanges(node, candidates)


def _inside(node: Node, candidates: Candidates, rebuilt: Callable[[Node], Node]) -> Iterator[Edited]:
    for edit, new in _here(node, candidates):
        yield edit, rebuilt(new)
    for i, part in enumerate(node.parts):

        def outer(new: Node, i: int = i) -> Node:
            return rebuilt(node.with_parts((*node.parts[:i], new, *node.parts[i + 1 :])))

        yield from _inside(part, candidates, outer)


def _here(node: Node, candidates: Candidates) -> Iterator[Edited]:
    """Changes of one node."""
    kind, parts = node.kind, node.parts
    if kind == "symbol":
        for other in candidates.of(node.value):
            yield Edit(f"{node} -> {other}"), symbol(other)
    if kind in ("cross", "transposed", "power"):
        yield Edit(f"{node} -> {parts[0]}", resizes=True), parts[0]
    if kind == "neg":
        yield Edit(f"sign of {parts[0]}"), parts[0]
    if kind == "sum":
        yield from _in_sum(node)
    if kind == "product":
        yield from _in_product(node)
    if kind == "call":
        yield from _in_call(node)
    if kind == "number" and node.value not in (0.0, 1.0):
        yield Edit(f"{node} -> 1"), number(1.0)
    if kind == "number" and node.value == 1.0:
        yield Edit("1 -> 2"), number(2.0)


def _in_sum(node: Node) -> Iterator[Edited]:
    parts = node.parts
    for i, term in enumerate(parts):
        yield Edit(f"sign of {_bare(term)}"), node.with_parts((*parts[:i], negated(term), *parts[i + 1 :]))
        yield Edit(f"without the term {term}", resizes=True), node.with_parts((*parts[:i], *parts[i + 1 :]))
    for i, term in enumerate(parts):  # a (b) + c -> a (b + c)
        if term.kind == "product" and len(parts) > 1:
            for cut in range(1, len(term.parts)):
                inner = Node("sum", None, (term.with_parts(term.parts[cut:]), *parts[:i], *parts[i + 1 :]))
                words = f"bracket after {term.with_parts(term.parts[:cut])}"
                yield Edit(words, resizes=True), Node("product", None, (*term.parts[:cut], inner))


def _in_product(node: Node) -> Iterator[Edited]:
    parts = node.parts
    yield Edit(f"sign of {node}"), negated(node)
    for i, factor in enumerate(parts):
        yield Edit(f"without the factor {factor}", resizes=True), node.with_parts((*parts[:i], *parts[i + 1 :]))
        if factor.kind == "sum" and len(parts) > 1:  # a (b + c) -> a b + c
            head = node.with_parts((*parts[:i], factor.parts[0], *parts[i + 1 :]))
            yield Edit(f"no bracket around {factor}", resizes=True), Node("sum", None, (head, *factor.parts[1:]))
        if i + 1 < len(parts):
            swapped = (*parts[:i], parts[i + 1], factor, *parts[i + 2 :])
            words = f"{factor} and {parts[i + 1]} the other way round"
            yield Edit(words, resizes=True), node.with_parts(swapped)


def _in_call(node: Node) -> Iterator[Edited]:
    if node.value in ("abs",):
        yield Edit(f"{node} -> {node.parts[0]}"), node.parts[0]
    if node.value in _EXCHANGED:
        yield Edit(f"{node.value} -> {_EXCHANGED[node.value]}"), Node("call", _EXCHANGED[node.value], node.parts)
    if node.value == "atan2":
        yield Edit("arguments of atan2 exchanged"), Node("call", "atan2", node.parts[::-1])


def _bare(node: Node) -> Node:
    return node.parts[0] if node.kind == "neg" else node


def everywhere(node: Node, candidates: Candidates) -> Iterator[Edited]:
    """A change of all places where a piece stands more than once."""
    counts: dict[Node, int] = {}
    for piece in node.walk():
        counts[piece] = counts.get(piece, 0) + 1
    for piece, count in counts.items():
        if count < 2:
            continue
        news = [piece.parts[0]] if piece.kind in ("cross", "transposed") else []
        if piece.kind == "symbol":
            news = [symbol(other) for other in candidates.of(piece.value)]
        for new in news:
            words = f"{piece} -> {new} everywhere"
            yield Edit(words, ((piece, new),), piece.kind != "symbol"), node.replaced({piece: new})


def _exchanges(node: Node, candidates: Candidates) -> Iterator[Edited]:
    """Two symbols exchanged."""
    names = sorted(node.symbols())
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            if b in set(candidates.of(a)):
                table = {symbol(a): symbol(b), symbol(b): symbol(a)}
                yield Edit(f"{a} and {b} exchanged", tuple(table.items())), node.replaced(table)


def additions(node: Node, candidates: Candidates) -> Iterator[Edited]:
    """A factor, a tilde or a transposition more."""
    yield from _added(node, candidates, lambda new: new)


def _added(node: Node, candidates: Candidates, rebuilt: Callable[[Node], Node]) -> Iterator[Edited]:
    if node.kind in ("product", "symbol", "sum", "cross", "transposed"):
        factors = node.parts if node.kind == "product" else (node,)
        for name in candidates.numbers():
            for extra in (symbol(name), Node("inverse", None, (symbol(name),))):
                yield Edit(f"{node} times {extra}"), rebuilt(Node("product", None, (extra, *factors)))
    if node.kind in ("symbol", "cross"):
        for kind, words in (("cross", f"{node} -> ~{node}"), ("transposed", f"{node} -> {node}'")):
            yield Edit(words), rebuilt(Node(kind, None, (node,)))
    for i, part in enumerate(node.parts):

        def outer(new: Node, i: int = i) -> Node:
            return rebuilt(node.with_parts((*node.parts[:i], new, *node.parts[i + 1 :])))

        yield from _added(part, candidates, outer)


def applied(edit: Edit, node: Node) -> Node:
    """An edit of all places on another formula."""
    return node.replaced(dict(edit.table))
