"""What a formula lacks, found by solving for it: a factor (number, powers of quantities) at any place, or a whole term.

At a place of the formula an unknown number @ is put in, and solved for in every random state; its values are then fitted by a
product of powers of quantities of the text, times a simple number.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from mbdae.audit.evaluate import STEP, SizeError, Value, evaluate
from mbdae.audit.notation import PLAIN, Node, negated, number, symbol
from mbdae.audit.phrases import Env
from mbdae.errors import MbdaeError

UNKNOWN = symbol("@")
_ONE = number(1)
EXACT = 1e-7  #: of fitted exponents and logarithms
MANY = 6_000  #: products of vectors and matrices that are tried as terms
MOST = 30  #: quantities among which powers are sought


def attempt(node: Node, env: Env) -> Any:
    """The value of a formula; None where it has none."""
    try:
        with np.errstate(all="ignore"):
            return evaluate(node, env)
    except (SizeError, MbdaeError, ArithmeticError, np.linalg.LinAlgError):
        return None


def places(node: Node, rebuilt: Any = lambda new: new) -> Iterator[tuple[Node, Any]]:
    """Every piece of a formula with the function that puts another in its place."""
    yield node, rebuilt
    for i, part in enumerate(node.parts):
        if node.kind == "call" and i and node.value in ("diff", "sum", "integral"):
            continue
        yield from places(part, lambda new, i=i: rebuilt(node.with_parts((*node.parts[:i], new, *node.parts[i + 1 :]))))


@dataclass(frozen=True)
class Monomial:
    """c times a product of powers of pieces of formulas."""

    c: Fraction
    powers: tuple[tuple[Node, Fraction], ...] = ()

    @property
    def factors(self) -> list[Node]:
        """Its factors as pieces of a product."""
        out = []
        if abs(self.c) != 1 or not self.powers:
            top, bottom = abs(self.c.numerator), self.c.denominator
            out = [number(top)] + ([Node("inverse", None, (number(bottom),))] if bottom != 1 else [])
        for piece, p in self.powers:
            size = abs(p)
            exponent = number(size.numerator) if size.denominator == 1 else Node(
                "product", None, (number(size.numerator), Node("inverse", None, (number(size.denominator),))))  # fmt: skip
            shown = piece if size == 1 else Node("power", None, (piece, exponent))
            out.append(shown if p > 0 else Node("inverse", None, (shown,)))
        return out

    def times(self, node: Node | None = None) -> Node:
        """The formula times this."""
        inside = () if node is None or node == _ONE else node.parts if node.kind == "product" else (node,)
        factors = [f for f in (*self.factors, *inside) if not (f == _ONE and (inside or len(self.factors) > 1))]
        new = factors[0] if len(factors) == 1 else Node("product", None, tuple(factors))
        return negated(new) if self.c < 0 else new


class Fit:
    """Numbers in some states as powers of the scalar quantities of a text."""

    def __init__(self, envs: Sequence[Env], pieces: Sequence[Node]) -> None:
        self.envs, self.pieces = envs, pieces

    @cached_property
    def _scalars(self) -> list[tuple[Node, Any]]:
        found: list[tuple[Node, Any]] = []
        for piece in self.pieces:
            values = [attempt(piece, env) for env in self.envs]
            if all(v is not None and np.ndim(v) == 0 and np.isfinite(v) and abs(v) > 1e-9 for v in values):
                v = np.real(np.array(values, dtype=complex))
                if np.ptp(np.abs(v)) > 1e-9 and not any(np.allclose(np.abs(v), np.abs(o)) for _, o in found):
                    found.append((piece, v))
        return found[:MOST]

    def monomial(self, values: Any) -> Monomial | None:
        """The simplest product of powers with these values."""
        r = np.asarray(values)
        if not np.all(np.isfinite(r)) or np.max(np.abs(np.imag(r))) > 1e-9 or np.min(np.abs(r)) < 1e-12:
            return None
        r = np.real(r)
        if np.ptp(np.abs(r)) < EXACT * abs(r[0]) and np.ptp(np.sign(r)):
            return self._sense(r)
        wanted = np.log(np.abs(r))
        for subsets, A, solve in self._systems:
            close = np.max(np.abs(np.einsum("sij,sj->si", A, solve @ wanted) - wanted), axis=1) < EXACT
            found = [m for i in np.flatnonzero(close) if (m := self._of(r, subsets[i], solve[i] @ wanted)) is not None]
            if found:
                return min(found, key=lambda m: (sum(abs(p) for _, p in m.powers), m.c.denominator + abs(m.c.numerator)))
        return None

    def _sense(self, r: Any) -> Monomial | None:
        """A number whose sign is that of a quantity."""
        for piece, v in self._scalars:
            sense = np.sign(r) * np.sign(v)
            if not np.ptp(sense):
                c = Fraction(float(abs(r[0]))).limit_denominator(48)
                return Monomial(c * int(sense[0]), ((Node("call", "sign", (piece,)), Fraction(1)),))
        return None

    @cached_property
    def _systems(self) -> list[tuple[list[Any], Any, Any]]:
        """Sets of no, one and two quantities, the equations of their exponents (sets, states, exponents), the solutions."""
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
        exact = all(abs(p - f) < EXACT and f for p, f in zip(x[1:], powers, strict=True)) and c.numerator <= 64
        if not exact or abs(float(c) - np.exp(x[0])) > EXACT * float(c):
            return None
        signs = np.prod([np.sign(v) ** int(p) if p.denominator == 1 else np.where(v > 0, 1.0, np.nan)
                         for (_, v), p in zip(some, powers, strict=True)], axis=0) * np.sign(r)  # fmt: skip
        if np.any(np.isnan(signs)) or np.ptp(np.atleast_1d(signs)) != 0:
            return None
        return Monomial(c * int(np.ravel(signs)[0]), tuple((piece, p) for (piece, _), p in zip(some, powers, strict=True)))


def solved(node: Node, envs: Sequence[Env], values: Sequence[Value]) -> list[complex] | None:
    """The number @ in every state for which the formula has the values; None where there is none."""
    out = []
    for env, wanted in zip(envs, values, strict=True):
        r = _solved(node, env, wanted)
        if r is None or abs(r) < 1e-9:
            return None
        out.append(r)
    return out


def _solved(node: Node, env: Env, wanted: Value) -> complex | None:
    """Linear in @ for most places; else by Newton's method, of a formula that is a number."""
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


def factors(node: Node, envs: Sequence[Env], values: Sequence[Value], fit: Fit) -> Iterator[tuple[Node, Monomial, Node]]:
    """Pieces with a factor that is missing there, and the formula with it."""
    for piece, rebuilt in places(node):
        if piece.kind in ("block", "row", "neg"):
            continue
        factors_ = piece.parts if piece.kind == "product" else (piece,)
        probe = rebuilt(Node("product", None, (UNKNOWN, *factors_)))
        r = _first_two(probe, envs, values)
        found = fit.monomial(r) if r is not None else None
        if found is not None and found != Monomial(Fraction(1)) and piece not in (p for p, _ in found.powers):
            yield piece, found, rebuilt(_merged(found, piece))
        if not np.shape(values[0]) and piece.kind in ("symbol", "call", "sum"):
            yield from _powers(piece, rebuilt, envs, values, fit)


def _powers(piece: Node, rebuilt: Any, envs: Sequence[Env], values: Sequence[Value], fit: Fit) -> Iterator[
        tuple[Node, Monomial, Node]]:  # fmt: skip
    """A piece with an exponent that is missing: a quantity of the text."""
    r = _first_two(rebuilt(Node("power", None, (piece, UNKNOWN))), envs, values)
    found = fit.monomial(r) if r is not None else None
    if found is not None and found.powers:
        power = Node("power", None, (piece, found.times()))
        yield piece, Monomial(Fraction(1), ((power, Fraction(1)), (piece, Fraction(-1)))), rebuilt(power)


def _first_two(probe: Node, envs: Sequence[Env], values: Sequence[Value]) -> list[complex] | None:
    first = solved(probe, envs[:1], values[:1])
    rest = solved(probe, envs[1:], values[1:]) if first else None
    return [*first, *rest] if first and rest else None


def _merged(found: Monomial, piece: Node) -> Node:
    """A piece times a factor: numbers multiplied, equal powers joined."""
    if piece.kind == "number":
        return Monomial(found.c * Fraction(piece.value).limit_denominator(10**6), found.powers).times()
    return found.times(piece)


def terms(node: Node, envs: Sequence[Env], values: Sequence[Value], fit: Fit, vectors: Sequence[Node]) -> Iterator[
        tuple[Node, Node]]:  # fmt: skip
    """Terms that are missing in the formula or in one of its sums, and the formula with them."""
    for piece, rebuilt in places(node):
        if (piece is not node and piece.kind not in ("sum", "symbol")) or piece.kind in ("block", "row"):
            continue
        inside = piece.parts if piece.kind == "sum" else (piece,)
        base = attempt(piece, envs[0])
        longest = 3 if piece is node or piece.kind == "sum" else 1
        for shape in _shapes(np.shape(base), vectors, envs[0], longest) if base is not None else ():
            term = UNKNOWN if shape == _ONE else Node("product", None, (UNKNOWN, shape))
            r = _first_two(rebuilt(Node("sum", None, (*inside, term))), envs, values)
            found = fit.monomial(r) if r is not None else None
            if found is not None:
                more = found.times(shape)
                yield more, rebuilt(Node("sum", None, (*inside, more)))


def _shapes(size: tuple[int, ...], vectors: Sequence[Node], env: Env, longest: int) -> Iterator[Node]:
    """Products of up to so many vectors and matrices of a text that have a size."""
    if size == ():
        yield _ONE
    forms: list[Node] = []
    for v in vectors:
        known = np.shape(attempt(v, env))
        if known == (3, 1):
            forms += [v, Node("cross", None, (v,)), Node("transposed", None, (v,))]
        elif known:
            forms += [v, Node("transposed", None, (v,))]
    shapes = {f: np.shape(attempt(f, env)) for f in forms}
    chains: list[tuple[tuple[Node, ...], tuple[int, ...]]] = [((f,), s) for f, s in shapes.items()]
    rows, width = size or (1, 1)
    chains = [(c, s) for c, s in chains if s[0] == rows]
    for length in range(1, longest + 1):
        yield from (_product(c) for c, s in chains if _fits(s, size))
        last = length + 1 == longest
        chains = [((*c, f), (s[0], t[1])) for c, s in chains for f, t in shapes.items()
                  if s[1] == t[0] and (not last or t[1] == width)]  # fmt: skip
        if len(chains) > MANY:
            return


def _fits(shape: tuple[int, ...], wanted: tuple[int, ...]) -> bool:
    return shape == wanted or (wanted == () and shape == (1, 1))


def _product(chain: tuple[Node, ...]) -> Node:
    return chain[0] if len(chain) == 1 else Node("product", None, chain)


def wrapped(node: Node) -> Iterator[tuple[Node, Node, Node]]:
    """Pieces put into a tilde, a transposition, an absolute value, a root or another function; or out of one."""
    for piece, rebuilt in places(node):
        news = []
        if piece.kind in ("symbol", "cross", "sum", "product"):
            news += [Node(kind, None, (piece,)) for kind in ("cross", "transposed")]
        if piece.kind in ("symbol", "sum", "product", "call", "power"):
            news += [Node("call", name, (piece,)) for name in ("abs", "sqrt", "norm", "sign", "sin", "cos", "tanh", "rate")]
            news += [Node("power", None, (piece, e)) for e in (number(2), number(-1))]
        if piece.kind == "call" and piece.value in PLAIN:
            news += [Node("call", name, piece.parts) for name in PLAIN if name != piece.value]
        for new in news:
            yield piece, new, rebuilt(new)
