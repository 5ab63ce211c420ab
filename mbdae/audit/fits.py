"""Factors and terms missing in a formula, found by solving for them: a number or powers of quantities at any place, or a term.

An unknown number @ is inserted at a place of the formula and solved for in every random state; its values are then fitted by
a product of powers of quantities of the text, times a simple number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import combinations
from math import prod
from typing import Any

import numpy as np

from mbdae.audit.evaluate import STEP, Value, attempt
from mbdae.audit.notation import BINDING, PLAIN, Node, made, negated, number, symbol
from mbdae.audit.phrases import Env

UNKNOWN = symbol("@")
_ONE = number(1)
EXACT = 1e-7  #: largest error of a fitted exponent, of the fitted logarithms and, relative, of the fitted constant
MANY = 6_000  #: the search for a missing term ends where there are more products of vectors and matrices than this
LARGE = 150  #: a missing numerical factor p/q counts as simple up to this product p q, with q up to 48
LONG = 6  #: largest number of nodes of a subexpression (its operations and symbols) that is tried as a base of a missing factor
MOST = 30  #: largest number of scalar quantities whose powers are tried as a missing factor; their pairs are tried too
Rebuilt = Callable[[Node], Node]
FormulaPlace = tuple[Node, Rebuilt, tuple[Node, ...]]


def places(node: Node, rebuilt: Rebuilt = lambda new: new, around: tuple[Node, ...] = ()) -> Iterator[FormulaPlace]:
    """Every piece of a formula, a function that puts another in its place, and the surrounding pieces from the inside out."""
    yield node, rebuilt, around
    for i, part in enumerate(node.parts):
        if not (node.kind == "call" and i == 1 and node.value in BINDING):  # the second argument is a bound name

            def outer(new: Node, i: int = i) -> Node:
                return rebuilt(node.with_parts((*node.parts[:i], new, *node.parts[i + 1 :])))

            yield from places(part, outer, (node, *around))


def _number(node: Node) -> Fraction | None:
    """The value of a number, or of 1 over a number, that stands in a formula as a small fraction; None for other pieces."""
    if node.kind == "inverse":
        below = _number(node.parts[0])
        return 1 / below if below else None
    value = Fraction(node.value).limit_denominator(1000) if node.kind == "number" else None
    return value if value is not None and abs(float(value) - node.value) < 1e-12 else None


def _ratio(value: Fraction) -> list[Node]:
    """A positive number as factors of a product."""
    below = [] if value.denominator == 1 else [made("inverse", number(value.denominator))]
    return [number(value.numerator), *below]


@dataclass(frozen=True)
class Monomial:
    """c times a product of powers, `powers` being pairs (subexpression, exponent)."""

    c: Fraction
    powers: tuple[tuple[Node, Fraction], ...] = ()

    @property
    def factors(self) -> list[Node]:
        """The factors of this monomial as pieces of a product."""
        out = _ratio(abs(self.c)) if abs(self.c) != 1 or not self.powers else []
        for piece, p in self.powers:
            shown = piece if abs(p) == 1 else made("power", piece, made("product", *_ratio(abs(p))))
            out.append(shown if p > 0 else made("inverse", shown))
        return out

    def times(self, node: Node | None = None) -> Node:
        """The formula times this monomial, its numbers in one."""
        inside = () if node is None or node == _ONE else node.parts if node.kind == "product" else (node,)
        whole = replace(self, c=self.c * prod((_number(f) or Fraction(1) for f in inside), start=Fraction(1)))
        factors = (*whole.factors, *(f for f in inside if _number(f) is None))
        factors = tuple(f for f in factors if f != _ONE) or (_ONE,)
        new = made("product", *((_ONE,) if factors[0].kind == "inverse" else ()), *factors)
        return negated(new) if self.c < 0 else new


class Fit:
    """Finds the missing factor with which a formula takes the wanted `values`, one in each of the states `envs`: a constant times
    powers of at most two of the scalar quantities `pieces`."""

    def __init__(self, envs: Sequence[Env], values: Sequence[Value], pieces: Sequence[Node]) -> None:
        self.envs, self.values, self.pieces = envs, values, pieces

    def lacking(self, probe: Node) -> Monomial | None:
        """The simplest monomial with which the formula `probe` takes the wanted values when it replaces @; None where there is
    none."""
        found = []
        for env, wanted in zip(self.envs, self.values, strict=True):
            r = _solved(probe, env, wanted)
            if r is None or abs(r) < 1e-9:
                return None
            found.append(r)
        return self.monomial(found)

    @cached_property
    def _scalars(self) -> list[tuple[Node, Any]]:
        found: list[tuple[Node, Any]] = []
        for piece in (p for p in self.pieces if sum(1 for _ in p.walk()) <= LONG):
            values = [attempt(piece, env) for env in self.envs]
            if all(v is not None and np.ndim(v) == 0 and np.isfinite(v) and abs(v) > 1e-9 for v in values):
                v = np.real(np.array(values, dtype=complex))
                size = np.abs(v)
                if np.ptp(size) > 1e-9 and not any(np.all(np.abs(size - np.abs(o)) <= 1e-8 + 1e-5 * np.abs(o)) for _, o in found):
                    found.append((piece, v))
        return found[:MOST]

    def monomial(self, values: Any) -> Monomial | None:
        """The simplest monomial that has these values, one in each state; None where there is none."""
        r = np.asarray(values)
        if not np.all(np.isfinite(r)) or np.max(np.abs(np.imag(r))) > 1e-9 or np.min(np.abs(r)) < 1e-12:
            return None
        r = np.real(r)
        if np.ptp(np.abs(r)) < EXACT * abs(r[0]) and np.ptp(np.sign(r)):
            return self._times_sign(r)
        wanted = np.log(np.abs(r))
        for subsets, A, solve in self._systems:
            close = np.max(np.abs(np.einsum("sij,sj->si", A, solve @ wanted) - wanted), axis=1) < EXACT
            found = [m for i in np.flatnonzero(close) if (m := self._of(r, subsets[i], solve[i] @ wanted)) is not None]
            if found:
                return min(found, key=lambda m: (sum(abs(p) for _, p in m.powers), m.c.denominator + abs(m.c.numerator)))
        return None

    def _times_sign(self, r: Any) -> Monomial | None:
        """The values r as a constant times the sign of a quantity; None where the signs of no quantity fit."""
        for piece, v in self._scalars:
            sense = np.sign(r) * np.sign(v)
            if not np.ptp(sense):
                c = Fraction(float(abs(r[0]))).limit_denominator(48)
                return Monomial(c * int(sense[0]), ((Node("call", "sign", (piece,)), Fraction(1)),))
        return None

    @cached_property
    def _systems(self) -> list[tuple[list[Any], Any, Any]]:
        """For sets of 0, 1 and 2 quantities: the sets, the matrices of the linear equations for the logarithm of the constant and
        the exponents, (sets, states, 1 + quantities), and their pseudo-inverses."""
        out = []
        for count in (0, 1, 2):
            subsets = list(combinations(self._scalars, count))
            if subsets:
                A = np.array([np.column_stack([np.ones(len(self.envs)), *(np.log(np.abs(v)) for _, v in s)]) for s in subsets])
                out.append((subsets, A, np.linalg.pinv(A)))
        return out

    def _of(self, r: Any, some: Sequence[tuple[Node, Any]], x: Any) -> Monomial | None:
        powers = [Fraction(round(2 * p), 2) for p in x[1:]]
        c = Fraction(float(np.exp(x[0]))).limit_denominator(48)
        exact = all(abs(p - f) < EXACT and f for p, f in zip(x[1:], powers, strict=True)) and c.numerator * c.denominator <= LARGE
        if not exact or abs(float(c) - np.exp(x[0])) > EXACT * float(c):
            return None
        signs = np.prod([np.sign(v) ** int(p) if p.denominator == 1 else np.where(v > 0, 1.0, np.nan)
                         for (_, v), p in zip(some, powers, strict=True)], axis=0) * np.sign(r)
        if np.any(np.isnan(signs)) or np.ptp(np.atleast_1d(signs)) != 0:
            return None
        return Monomial(c * int(np.ravel(signs)[0]), tuple((piece, p) for (piece, _), p in zip(some, powers, strict=True)))


def _solved(node: Node, env: Env, wanted: Value) -> complex | None:
    """The value of @ with which the formula has the wanted value: directly where @ enters linearly, else by Newton's method; None
    where none is found."""
    ends = [attempt(node, env.bound("@", x)) for x in (0j, 1 + 0j)]
    if any(e is None or np.shape(e) != np.shape(wanted) or not np.all(np.isfinite(e)) for e in ends[1:]):
        return None
    if ends[0] is not None and np.all(np.isfinite(ends[0])):
        slope, gap = np.ravel(ends[1] - ends[0]), np.ravel(wanted - ends[0])
        at = int(np.argmax(np.abs(slope)))
        if abs(slope[at]) > 1e-12:
            r = complex(gap[at] / slope[at])
            again = attempt(node, env.bound("@", r))
            if again is not None and np.max(np.abs(again - wanted)) < 1e-9 * max(1.0, float(np.max(np.abs(wanted)))):
                return r
    return None if np.shape(wanted) else _newton(node, env, wanted)


def _newton(node: Node, env: Env, wanted: Value) -> complex | None:
    x = 1.0
    for _ in range(40):
        v = attempt(node, env.bound("@", x + 1j * STEP)) if not env.stepped else None
        if v is None or not np.isfinite(v) or np.imag(v) == 0:
            return None
        step = float(np.real(wanted - v) / (np.imag(v) / STEP))
        x += max(-0.5 * abs(x) - 0.1, min(0.5 * abs(x) + 0.1, step))
        if abs(step) < 1e-13 * abs(x):
            return complex(x)
    return None


def factors(node: Node, fit: Fit) -> Iterator[tuple[Node, Monomial, Node]]:
    """Every piece at which a factor or an exponent is missing, with the factor and the formula that contains it."""
    for piece, rebuilt, _ in places(node):
        if piece.kind in ("block", "row", "neg"):
            continue
        inside = piece.parts if piece.kind == "product" else (piece,)
        found = fit.lacking(rebuilt(made("product", UNKNOWN, *inside)))
        if found is not None and found != Monomial(Fraction(1)) and piece not in (p for p, _ in found.powers):
            yield piece, found, rebuilt(_merged(found, piece))
        if not np.shape(fit.values[0]) and piece.kind in ("symbol", "call", "sum"):
            found = fit.lacking(rebuilt(made("power", piece, UNKNOWN)))
            if found is not None and found.powers:  # the missing exponent contains quantities of the text, and is no mere number
                power = made("power", piece, found.times())
                yield piece, Monomial(Fraction(1), ((power, Fraction(1)), (piece, Fraction(-1)))), rebuilt(power)


def _merged(found: Monomial, piece: Node) -> Node:
    """A piece times a missing factor; a piece that is a number is multiplied with the number of the factor."""
    if piece.kind == "number":
        return Monomial(found.c * Fraction(piece.value).limit_denominator(10**6), found.powers).times()
    return found.times(piece)


def terms(node: Node, fit: Fit, vectors: Sequence[Node]) -> Iterator[tuple[Node, Node]]:
    """Terms that are missing in the formula or in one of its sums, each with the formula that contains it."""
    for piece, rebuilt, _ in places(node):
        if (piece is not node and piece.kind not in ("sum", "symbol")) or piece.kind in ("block", "row"):
            continue
        inside = piece.parts if piece.kind == "sum" else (piece,)
        base = attempt(piece, fit.envs[0])
        longest = 3 if piece is node or piece.kind == "sum" else 1
        for shape in _shapes(np.shape(base), vectors, fit.envs[0], longest) if base is not None else ():
            term = UNKNOWN if shape == _ONE else made("product", UNKNOWN, shape)
            found = fit.lacking(rebuilt(made("sum", *inside, term)))
            more = found.times(shape) if found is not None else None
            if more is not None and negated(more) not in (piece, *inside):
                yield more, rebuilt(made("sum", *inside, more))


def _shapes(size: tuple[int, ...], vectors: Sequence[Node], env: Env, longest: int) -> Iterator[Node]:
    """Products of at most `longest` vectors and matrices of a text that have the wanted size."""
    if size == ():
        yield _ONE
    forms: list[Node] = []
    for v in vectors:
        known = np.shape(attempt(v, env))
        forms += [v, *([made("cross", v)] if known == (3, 1) else []), made("transposed", v)] if known else []
    shapes = {f: np.shape(attempt(f, env)) for f in forms}
    rows, width = size or (1, 1)
    chains: list[tuple[tuple[Node, ...], tuple[int, ...]]] = [((f,), s) for f, s in shapes.items() if s[0] == rows]
    for length in range(1, longest + 1):
        yield from (made("product", *c) for c, s in chains if s == (size or (1, 1)))
        last = length + 1 == longest
        chains = [((*c, f), (s[0], t[1])) for c, s in chains for f, t in shapes.items()
                  if s[1] == t[0] and (not last or t[1] == width)]
        if len(chains) > MANY:
            return


def wrapped(node: Node, env: Env) -> Iterator[tuple[Node, Node, Node]]:
    """The formula with one piece put into a tilde, transposition, absolute value, root or other function, or taken out of one."""
    for piece, rebuilt, _ in places(node):
        news = []
        if piece.kind in ("symbol", "cross", "sum", "product"):
            news += [made(kind, piece) for kind in ("cross", "transposed")]
        if piece.kind in ("symbol", "sum", "product", "call", "power"):
            news += [Node("call", name, (piece,)) for name in ("abs", "sqrt", "norm", "sign", "sin", "cos", "tanh", "rate")]
            news += [made("power", piece, e) for e in (number(2), number(-1))]
        if piece.kind == "call" and piece.value in PLAIN:
            news += [Node("call", name, piece.parts) for name in PLAIN if name != piece.value]
        for new in news:
            yield piece, new, rebuilt(new)
