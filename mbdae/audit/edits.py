"""Single small changes of a formula, like misprints: a sign, a symbol instead of another, an extra or a missing factor."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mbdae.audit import carried, notation
from mbdae.audit.calculus import factors_of
from mbdae.audit.evaluate import SizeError, attempt, evaluate, size
from mbdae.audit.fits import places
from mbdae.audit.notation import BINDING, Node, Relation, bare, made, negated, symbol
from mbdae.audit.phrases import Definition, Env, Scope
from mbdae.reports.units import BASIC, powers_of, scales, shown

Edited = tuple["Edit", Node]
_EXCHANGED = {a: b for one, other in (("sin", "cos"), ("sinh", "cosh"), ("asin", "acos"), ("asinh", "acosh"))
              for a, b in ((one, other), (other, one))}

BELOW = "{} in the denominator"  #: the change of a divisor that takes in the factors after it


@dataclass(frozen=True)
class Edit:
    """A change of a formula. form: its description with {} for each of the pieces; table: for a change at all places of a piece,
    pairs (piece, what replaces it)."""

    form: str
    pieces: tuple[object, ...] = ()
    table: tuple[tuple[Node, Node], ...] = ()
    resizes: bool = False  #: whether the change may alter the size (rows, columns) of the formula
    #: the piece of the formula around the changed one, which is named where the changed one appears several times in the formula
    where: Node | None = None
    #: rank of the change: the lower, the likelier a misprint; of several repairs that with the lowest rank is taken
    size: float = 2.0

    @property
    def accent(self) -> bool:
        """Whether the change only adds or removes a tilde or a transposition."""
        marks = ("cross", "transposed")
        return len(self.pieces) == 2 and any(isinstance(a, Node) and a.kind in marks and a.parts == (b,)
                                             for a, b in (self.pieces, self.pieces[::-1]))

    @property
    def words(self) -> str:
        """The change in words."""
        return self.form.format(*self.pieces) + (f" in {self.where}" if self.where is not None else "")

    def tex(self, letters: Mapping[str, str]) -> str:
        """Description of the change with formulas in TeX."""
        shown = [f"${carried.formula(p, letters) if isinstance(p, Node) else carried.name(str(p), letters)}$"
                 for p in (*self.pieces, *filter(None, [self.where]))]
        form = self.form.replace("->", r"$\to$") + (" in {}" if self.where is not None else "")
        return form.format(*shown)


EXPONENTS = [notation.TextReader(text).expression() for text in ("2", "3", "4", "1/2", "3/2", "5/2")]
BRACKET = 1.5  #: rank of a bracket that holds more or less than was meant
PLAIN = dict.fromkeys(BASIC, 1.0)  #: sizes of the basic units; where there are sizes, functions need not be real


class Candidates:
    """Symbols that may replace another one: those of equal unit and size, and the same letter with more or fewer dots (phidot for
    phi)."""

    def __init__(self, scope: Scope, env: Env) -> None:
        self.scope, self.env = scope, env
        self.sizes: dict[str, tuple[int, ...]] = {}
        self.any_size = self.any_unit = False  #: whether symbols of another size, or unit, may replace a symbol

    def _size(self, name: str) -> tuple[int, ...]:
        if name not in self.sizes:
            value = attempt(symbol(name), self.env)
            self.sizes[name] = (0,) if value is None else np.shape(value)
        return self.sizes[name]

    def is_number(self, node: Node) -> bool:
        """Whether a piece has a value in this state that is a number."""
        value = attempt(node, self.env)
        return value is not None and np.ndim(value) == 0

    def of(self, name: str) -> Iterator[tuple[str, float]]:
        """Names that may replace `name`, each with its rank: lowest for the same letter, highest for another unit."""
        if name not in self.scope.symbols:
            return
        stem, dots = _dots(name)
        for other in (n for n in self.scope.symbols if n != name):
            near = _dots(other)
            alike = (near[0] == stem and near[1] != dots) or self.scope.symbols[name].units == self.scope.symbols[other].units
            if (alike or self.any_unit) and (self.any_size or self._size(other) == self._size(name)):
                yield other, (1.2 if name[0] == other[0] else 1.6) + 0.3 * (not alike)

    def known(self) -> list[str]:
        """Symbols that have a value in this state."""
        return [name for name in self.scope.symbols if self._size(name) != (0,)]

    def numbers(self) -> list[str]:
        """Symbols whose values are scalars."""
        return [name for name in self.scope.symbols if self._size(name) == ()]


def _dots(name: str) -> tuple[str, int]:
    for ending, dots in (("ddot", 2), ("dot", 1)):
        if name.endswith(ending):
            return name.removesuffix(ending), dots
    return name, 0


def edits(node: Node, candidates: Candidates) -> Iterator[Edited]:
    """The formula after every single change: first changes at one place, then changes at all places of a piece."""
    counts = Counter(node.walk())
    for piece, rebuilt, around in places(node):
        where = None if counts[piece] == 1 else next((a for a in around if a.kind != "row" and counts[a] == 1), None)
        for edit, new in _here(piece, candidates):
            yield replace(edit, where=where), rebuilt(new)
    yield from everywhere(node, candidates)
    yield from _exchanges(node, candidates)


def _here(node: Node, candidates: Candidates) -> Iterator[Edited]:
    kind, parts = node.kind, node.parts
    if kind == "symbol":
        for other, size in candidates.of(node.value):
            yield Edit("{} -> {}", (node, other), size=size), symbol(other)
    if kind in ("cross", "transposed", "power"):
        yield Edit("{} -> {}", (node, parts[0]), resizes=True, size=1.4), parts[0]
    if kind == "power" and not parts[1].free:
        for new in (made("power", parts[0], e) for e in EXPONENTS if e != parts[1]):
            yield Edit("{} -> {}", (node, new), size=1.35), new
    if kind == "neg":
        yield Edit("sign of {}", (parts[0],), size=1), parts[0]
    if kind == "sum":
        yield from _in_sum(node)
    if kind == "product":
        yield from _in_product(node)
    if kind == "call":
        yield from _in_call(node)
    if kind in ("sum", "product") and len(parts) == 2 and all(_plain(p) and candidates.is_number(p) for p in parts):  # a + b, a b
        new = made("sum" if kind == "product" else "product", *parts)
        yield Edit("{} -> {}", (node, new), size=1.9), new


def _plain(node: Node) -> bool:
    return node.kind in ("symbol", "power", "call")


def _in_sum(node: Node) -> Iterator[Edited]:
    parts = node.parts
    for i, term in enumerate(parts):
        edit = Edit("sign of {}", (bare(term),), size=1 if i else 1.01)  # the first term has hardly ever the wrong sign
        yield edit, node.with_parts((*parts[:i], negated(term), *parts[i + 1 :]))
        yield Edit("without the term {}", (term,), resizes=True, size=1.8), node.with_parts((*parts[:i], *parts[i + 1 :]))
    for i, (term, after) in enumerate(pairwise(parts)):  # a f(x) + y -> a f(x + y)
        whole = factors_of(bare(term))
        if _plain_call(whole[-1]):
            wider = Node("call", whole[-1].value, (made("sum", *_terms(whole[-1].parts[0]), after),))
            new = made("product", *whole[:-1], wider)
            edit = Edit("{} inside of the bracket of {}", (after, whole[-1]), resizes=True, size=BRACKET)
            yield edit, node.with_parts((*parts[:i], negated(new) if term.kind == "neg" else new, *parts[i + 2 :]))
    for i, term in enumerate(parts):  # a (b) + c -> a (b + c)
        if term.kind == "product" and len(parts) > 1:
            for cut in range(1, len(term.parts)):
                inner = made("sum", term.with_parts(term.parts[cut:]), *parts[:i], *parts[i + 1 :])
                edit = Edit("bracket after {}", (term.with_parts(term.parts[:cut]),), resizes=True)
                yield edit, made("product", *term.parts[:cut], inner)


def _in_product(node: Node) -> Iterator[Edited]:
    parts = node.parts
    yield Edit("sign of {}", (node,), size=1), negated(node)
    for i, factor in enumerate(parts):
        yield Edit("without the factor {}", (factor,), resizes=True, size=1.8), node.with_parts((*parts[:i], *parts[i + 1 :]))
        if factor.kind == "sum" and len(parts) > 1:  # a (b + c) -> a b + c
            head = node.with_parts((*parts[:i], factor.parts[0], *parts[i + 1 :]))
            yield Edit("no bracket around {}", (factor,), resizes=True), made("sum", head, *factor.parts[1:])
        yield from _brackets(node, i)
        if i + 1 < len(parts):
            swapped = (*parts[:i], parts[i + 1], factor, *parts[i + 2 :])
            edit = Edit("factors {} and {} exchanged", (factor, parts[i + 1]), resizes=True, size=1.3)
            yield edit, node.with_parts(swapped)


def _brackets(node: Node, i: int) -> Iterator[Edited]:
    """A product in which the bracket of the factor i, a function or a divisor, holds more factors, or of a divisor fewer."""
    parts, factor = node.parts, node.parts[i]
    below = factor.kind == "inverse"
    if not (below or _plain_call(factor)):
        return
    inside, last = factors_of(factor.parts[0]), len(parts)
    for end in range(i + 2, last + 1):  # P/2 pi -> P/(2 pi), f(x) y -> f(x y)
        moved = made("product", *parts[i + 1 : end])
        wider = replace(factor, parts=(made("product", *inside, *factors_of(moved)),))
        edit = Edit(BELOW if below else "{} inside of the bracket of {}", (moved, factor)[: 2 - below],
                    resizes=True, size=BRACKET)
        yield edit, node.with_parts((*parts[:i], wider, *parts[end:]))
    for cut in range(1, len(inside) if below else 0):  # P/(2 pi) -> P/2 pi
        fewer = made("inverse", made("product", *inside[:cut]))
        edit = Edit("{} not in the denominator", (made("product", *inside[cut:]),), resizes=True, size=BRACKET)
        yield edit, node.with_parts((*parts[:i], fewer, *inside[cut:], *parts[i + 1 :]))


def _plain_call(node: Node) -> bool:
    return node.kind == "call" and node.value in notation.PLAIN


def _terms(node: Node) -> tuple[Node, ...]:
    return node.parts if node.kind == "sum" else (node,)


def _in_call(node: Node) -> Iterator[Edited]:
    if node.value == "abs":
        yield Edit("{} -> {}", (node, node.parts[0]), size=1.4), node.parts[0]
    kind = node.parts[0].kind
    if _plain_call(node) and kind in ("sum", "product"):  # f(a + b) -> f(a) + b
        first, *rest = node.parts[0].parts
        edit = Edit("{} outside of the bracket of {}", (made(kind, *rest), node), resizes=True, size=BRACKET)
        yield edit, made(kind, Node("call", node.value, (first,)), *rest)
    for i, part in enumerate(node.parts if node.value not in BINDING else ()):
        if part.kind == "sum":  # f(a - b) -> f(b - a)
            turned = part.with_parts(tuple(sorted(map(negated, part.parts), key=lambda term: term.kind == "neg")))
            yield Edit("sign of {}", (part,), size=1), node.with_parts((*node.parts[:i], turned, *node.parts[i + 1 :]))
    if node.value in _EXCHANGED:
        yield Edit("{} -> {}", (node.value, _EXCHANGED[node.value]), size=1.1), Node("call", _EXCHANGED[node.value], node.parts)
    if node.value == "atan2":
        yield Edit("arguments of atan2 exchanged", size=1.1), Node("call", "atan2", node.parts[::-1])


def everywhere(node: Node, candidates: Candidates) -> Iterator[Edited]:
    """The formula after changes made at all places of a piece that appears more than once."""
    counts = Counter(node.walk())
    for piece, count in counts.items():
        if count < 2:
            continue
        news = [piece.parts[0]] if piece.kind in ("cross", "transposed") else []
        if piece.kind == "symbol":
            news = [symbol(other) for other, _ in candidates.of(piece.value)]
        for new in news:
            edit = Edit("{} -> {} everywhere", (piece, new), ((piece, new),), piece.kind != "symbol")
            yield edit, node.replaced({piece: new})


def _exchanges(node: Node, candidates: Candidates) -> Iterator[Edited]:
    names = sorted(node.free)
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            if b in dict(candidates.of(a)):
                table = {symbol(a): symbol(b), symbol(b): symbol(a)}
                yield Edit("{} and {} exchanged", (a, b), tuple(table.items())), node.replaced(table)


def supplements(node: Node, candidates: Candidates) -> Iterator[Edited]:
    """The formula with a vector or matrix added as a factor, as if the text had left it out."""
    numbers = set(candidates.numbers())
    columns = [symbol(name) for name in candidates.known() if name not in numbers]
    for piece, rebuilt, _ in places(node):
        if piece.kind in ("product", "symbol", "cross", "transposed", "sum"):
            factors = piece.parts if piece.kind == "product" else (piece,)
            for extra in (form for v in columns for form in (v, made("transposed", v), made("cross", v))):
                for i in range(len(factors) + 1):
                    new = made("product", *factors[:i], extra, *factors[i:])
                    yield Edit("{} -> {}", (piece, new)), rebuilt(new)


def applied(edit: Edit, node: Node) -> Node:
    """A change that acts at all places, applied to another formula."""
    return node.replaced(dict(edit.table))


# -- Units of formulas, found by scaling m, kg and s: a sum whose terms scale differently has no unit


def powers(node: Node, envs: Sequence[Env]) -> NDArray[np.float64] | None:
    """Exponents of m, kg and s of every entry (nan where it is 0); None where an entry has no unit."""
    with np.errstate(all="ignore"):
        before, *after = (np.array([np.ravel(evaluate(node, replace(env, scale=scale, store={}))) for env in envs])
                          for scale in (PLAIN, *scales()))
    return powers_of(before, after)


def united(node: Node, envs: Sequence[Env]) -> bool:
    """Whether a formula and every sum in it have a unit."""
    return powers(node, envs) is not None and not _culprit(node, envs)


def faults(statement: Relation, envs: Sequence[Env]) -> list[str]:
    """Errors in the units of a statement, in words; an empty list where the units agree."""
    envs = [replace(env, scale=PLAIN, store={}) for env in envs]
    try:
        found = [(side, powers(side, envs)) for side in statement.sides if not notation.is_zero(side)]
        sizes = dict.fromkeys(size(evaluate(side, envs[0])) for side, _ in found)
        if len(sizes) > 1:
            return [f"sizes do not fit: {' = '.join(sizes)}"]
    except SizeError as error:
        return [str(error)]
    known = []
    for side, p in found:
        culprit = _culprit(side, envs) if p is None or np.all(np.isnan(p)) else ""  # a sum that is 0 hides the units of its terms
        if p is None or culprit:
            return [culprit or f"{side} has no unit"]
        known.append((side, p))
    for side, q in known[1:]:
        first, p = known[0]
        if p.shape == q.shape and np.nanmax(np.abs(p - q), initial=0.0) > 1e-6:
            return [f"{first} has the unit {shown(p)}, {side} the unit {shown(q)}"]
    return []


def of_definitions(statement: Relation, envs: Sequence[Env]) -> list[str]:
    """Definitions of the text whose formula has another unit than the declared one."""
    scope, out = envs[0].scope, []
    for name in sorted(scope.reached(statement.symbols())):
        meaning = scope.symbols[name]
        if isinstance(meaning, Definition) and meaning.units:
            inside = [replace(env, scope=meaning.scope, store={}) for env in envs]
            p, declared = powers(meaning.node, inside), np.array([u.powers for u in meaning.units]).T
            if p is None:
                return [_culprit(meaning.node, inside) or f"the definition of {name} has no unit"]
            rows = np.repeat(declared, max(1, p.shape[1] // declared.shape[1]), axis=1)
            if rows.shape == p.shape and np.nanmax(np.abs(p - rows), initial=0.0) > 1e-6:
                out.append(f"{name} is defined with the unit {shown(p)} and declared with {', '.join(map(str, meaning.units))}")
    return out


def _culprit(node: Node, envs: Sequence[Env]) -> str:
    """The innermost sum whose terms have different units, in words; empty where there is none."""
    for part in node.parts:
        inner = _culprit(part, envs)
        if inner:
            return inner
    if node.kind != "sum" or not node.free <= {*envs[0].scope.symbols, "I", "pi"}:  # or it has a name that an integral binds
        return ""
    units = [(term, powers(term, envs)) for term in node.parts]
    known = [(term, p) for term, p in units if p is not None]
    for term, p in known[1:]:
        if np.nanmax(np.abs(p - known[0][1]), initial=0.0) > 1e-6:
            return f"in a sum {bare(known[0][0])} has the unit {shown(known[0][1])}, {bare(term)} the unit {shown(p)}"
    return ""
