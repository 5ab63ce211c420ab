"""Switches of a law: the conditions of its Piecewise and the arguments of its steep functions, found in its statement.

A barrier exp(-(x/w)^2) acts within its width w only, a Piecewise changes where its conditions do. A solver that knows these
arguments takes no step across which a function of them changes unnoticed.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import symengine as se

from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Force
from mbdae.symbolic.outputs import Target, input_symbols, insert
from mbdae.symbolic.rebuild import KINDS, nodes
from mbdae.symbolic.vectors import Expr, Vec

EQUAL = 1e-12  #: relative difference up to which two branches of a Piecewise count as the same function
NEARBY = (-1e-2, 0.0, 1e-2)  #: where branches are compared, relative to the place where the condition changes
ONE = se.Integer(1)
#: a power with at least this exponent is taken to be noticeable only near the largest values of its base, as cos(x)^2000 is
LOCAL_POWER = 8
TINIEST = se.RealDouble(1e-300)  #: added to arguments of logarithms, which keeps them finite


class Switch(NamedTuple):
    """An argument in the symbols of a statement: its kind, expression, and the exponent of a power (else 1)."""

    kind: str
    argument: Expr
    exponent: Expr = ONE


def switches_of(d: Derived) -> list[Switch]:
    """The switches of a law whose arguments depend on the motion or on time, each once."""
    found = list(dict.fromkeys(s for e, damps in _statements(d) for s in _Search(d, damps).inside(e)))
    if not found:
        return []
    resolve, name = d.variation.resolve, d.variation.name
    arguments = insert(d, [resolve(name(s.argument)) for s in found])
    of_motion = {symbol for target, symbol in input_symbols(d) if target[0] in ("q", "u", "s", "foreign")}
    of_motion |= set(d.variation.clock)
    reactions = {*d.multipliers, *d.stabilisers}  # without values in forms that eliminate multipliers
    out: dict[tuple[str, Expr], Switch] = {}
    for switch, e in zip(found, arguments, strict=True):
        free = e.free_symbols
        if free & of_motion and not free & reactions and (switch.kind, -e) not in out:
            out.setdefault((switch.kind, e), switch)
    return list(out.values())


def switch_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Arguments of the switches of a law as outputs ("argument", i), in names of intermediate results and unknowns."""
    resolve, name = d.variation.resolve, d.variation.name
    return [(("argument", i), resolve(name(s.argument))) for i, s in enumerate(known_switches(d))]


@lru_cache(maxsize=512)
def known_switches(d: Derived) -> tuple[Switch, ...]:
    """`switches_of`, once per derived law."""
    return tuple(switches_of(d))


@lru_cache(maxsize=512)
def switch_kinds(d: Derived) -> list[tuple[str, Expr]]:
    """Kind and exponent of every switch of a law."""
    found: list[tuple[str, Expr]] = d.noted("switches", lambda: [(s.kind, s.exponent) for s in known_switches(d)])
    return found


def _statements(d: Derived) -> Iterator[tuple[Any, bool]]:
    """The expressions of a law as stated, and whether they are a Rayleigh function."""
    law, sides = d.law, d.sides
    yield from ((e, False) for _, e in d.feeds.stated(d.frames[len(d.frames) - len(d.feeds.sides) :]))
    if not isinstance(law, Force | Joint):
        return
    if isinstance(law, Force):
        if law.gaps(*sides):
            return  # a contact: its gaps are watched
        yield law.energy(*sides), False
        yield law.dissipation(*sides), True
        yield from ((part, False) for part in (*(law.wrench(*sides) or ()), *(law.thrust(*sides) or ())))
    else:
        yield from ((e, False) for row, e in {**law.rows(*sides), **law.velocity_constraints(*sides)}.items() if row in d.rows)
        yield from ((part, False) for part in law.resistance(*sides, d.reactions) or ())
        yield from ((part, False) for part in d.rubbing or ())
    if d.states:
        yield from ((e, False) for e in law.rates(*sides).values())


class _Search:
    """Search for the arguments in one statement."""

    def __init__(self, d: Derived, damps: bool) -> None:
        self.damps, self.seen = damps, set[Any]()
        self.own = {se.Symbol(name) for name in d.law.params}
        self.undefined = frozenset().union(*(f.undefined for f in d.frames))
        self.angles = {f.heading for f in d.frames} | {f.q[0] for f in d.frames if f.kind is NodeKind.COORDINATE}
        self.of_frames = set[Any]().union(*(f.symbols for f in d.frames))
        self.points = {c for f in d.frames for v in (f.center, f.arm) for c in v if c.free_symbols}

    def inside(self, e: Any) -> Iterator[Switch]:
        """The switches of e and of every part of it."""
        for part in e if isinstance(e, Vec) else (se.sympify(e),):
            if part in self.seen:
                continue
            self.seen.add(part)
            yield from (s for s in self._of(part) if not s.argument.free_symbols & self.undefined)
            for inner in part.args:
                yield from self.inside(inner)

    def _of(self, e: Expr) -> Iterator[Switch]:
        kind = type(e).__name__
        if isinstance(e, se.Piecewise):
            yield from _conditions(e)
        elif isinstance(e, se.Pow):
            yield from self._power(*e.args)
        elif isinstance(e, se.atan2):
            if e.free_symbols & self.points:  # an angle between axes has no scale of its own
                yield Switch("power", e.args[0] ** 2 + e.args[1] ** 2, se.Rational(1, 2))
            elif not e.free_symbols & self.of_frames:  # an angle of sensors: it jumps by a turn where its first argument is 0
                yield Switch("kink", e.args[0])
        elif kind in ("Max", "Min"):
            yield from (Switch("kink", a - b) for i, a in enumerate(e.args) for b in e.args[:i])
        elif kind in ("floor", "ceiling"):
            yield from () if _counts_turns(e.args[0]) else _integers(e.args[0])
        elif kind in KINDS and e.args[0].free_symbols and not (kind in ("sin", "cos") and self._is_angle(e.args[0])):
            yield Switch(KINDS[kind], e.args[0])

    def _is_angle(self, e: Expr) -> bool:
        """Whether e is an angle of the motion, or a sum of angles. Then sin(e) varies over a turn, no faster, and is no
        switch."""
        if isinstance(e, se.FunctionSymbol) and e.get_name() == "let":
            return self._is_angle(e.args[0])
        if isinstance(e, se.Add):
            return all(map(self._is_angle, e.args))
        return e.is_Number or isinstance(e, se.atan2) or e in self.angles or (-e) in self.angles or isinstance(-e, se.atan2)

    def _power(self, base: Expr, exponent: Expr) -> Iterator[Switch]:
        if not base.free_symbols:  # such as exp(u) or 2^u
            if exponent.free_symbols:
                yield Switch("decaying", exponent * (ONE if base == se.E else se.log(base)))
            return
        if base.free_symbols and exponent.is_number and float(exponent) >= LOCAL_POWER:  # u^n = exp(n ln|u|)
            yield Switch("decaying", exponent / 2 * se.log(base**2 + TINIEST))
            return
        whole = isinstance(exponent, se.Integer)
        if exponent.free_symbols or not whole or int(exponent) < 0:
            falls = not exponent.free_symbols and float(exponent) < 0
            # a base without parameters is a distance, which has no width: only its negative powers are steep
            if (falls and not self.damps) or base.free_symbols & self.own:
                yield Switch("power", base, exponent)


def _integers(u: Expr) -> Iterator[Switch]:
    """Switches of floor(u), which jumps where u passes an integer: sin(pi u) changes its sign there, and pi u as a periodic
    argument keeps a step from passing several integers."""
    if u.free_symbols:
        yield Switch("kink", se.sin(se.pi * u))
        yield Switch("periodic", se.pi * u)


def _counts_turns(u: Expr) -> bool:
    """Whether floor(u) counts the turns of an angle (`variation.nearest_turn`): it jumps where the angle between axes does, so
    that their sum does not."""
    angles = [node for node in nodes(u) if isinstance(node, se.atan2)]
    plain = {angle: se.Dummy() for angle in angles}
    flat = u.subs(plain)
    return any(se.expand(se.diff(flat, symbol) * 2 * se.pi) == -1 for symbol in plain.values())


def _conditions(e: Expr) -> Iterator[Switch]:
    """Switches of a Piecewise: where its conditions change, except where the branches on both sides agree up to round-off."""
    branches = list(zip(e.args[::2], e.args[1::2], strict=True))
    for i, (value, condition) in enumerate(branches):
        rest = branches[i + 1 :]
        for c in _comparisons(condition):
            if not (rest and _is_comparison(condition) and _joins_smoothly(c, value, se.Piecewise(*rest))):
                yield Switch("kink", c)


def _is_comparison(condition: Any) -> bool:
    return type(condition).__name__ in ("StrictLessThan", "LessThan", "Equality", "Unequality")


def _comparisons(condition: Any) -> Iterator[Expr]:
    """Differences of both sides of every comparison in a condition."""
    if _is_comparison(condition):
        yield condition.args[0] - condition.args[1]
        return
    for part in condition.args:
        yield from _comparisons(part)


def _joins_smoothly(c: Expr, value: Expr, rest: Expr) -> bool:
    """Whether two branches agree where c = 0 and nearby: tanh(x) and 1 beyond x = 20. Tried at random values of the symbols."""
    symbols = sorted(c.free_symbols | se.sympify(value).free_symbols | rest.free_symbols, key=str)
    rng = random.Random(3)
    for x in sorted(c.free_symbols, key=str):
        slope = se.diff(c, x)
        if slope == 0 or x in slope.free_symbols:
            continue
        for _ in range(3):
            at = {s: rng.uniform(0.3, 0.9) for s in symbols}
            root = at[x] - float(c.subs(at)) / float(slope.subs(at))
            for off in NEARBY:
                here = at | {x: root * (1 + off)}
                try:
                    a, b = float(se.sympify(value).subs(here)), float(rest.subs(here))
                except (RuntimeError, TypeError, ValueError):  # not a real number there
                    return False
                if not abs(a - b) <= EQUAL * max(abs(a), abs(b)):
                    return False
        return True
    return False
