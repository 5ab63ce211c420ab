"""Differentiation along motions: the rule delta a = delta psi x a, with named intermediates.

A law may name an intermediate with `let(e)` and ask for a time derivative with `rate(e)`; angles (atan2) and turn
counts (floor) are named automatically. A name is a symbol in place of an expression. Names keep second derivatives
short (without them the stiffness of an angle is a thousand times longer), and reports print them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import symengine as se

from mbdae.errors import LawError
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.rebuild import jumps_with, substituted
from mbdae.symbolic.vectors import ZERO, Expr, Vec

_LET, _RATE = se.Function("let"), se.Function("rate")
_ZERO = se.Integer(0)


def let(e: Expr, name: str = "") -> Expr:
    """Name an intermediate result; `name` is its letter in a report (LaTeX)."""
    return _LET(se.sympify(e), se.Symbol(name)) if name else _LET(se.sympify(e))


def rate(e: Expr) -> Expr:
    """Time derivative of an expression in positions and in vectors fixed to the bodies, by the motion of all frames."""
    return _RATE(se.sympify(e))


def nearest_turn(principal: Expr, reference: Expr) -> Expr:
    """The angle principal + 2 pi n nearest to `reference`; the turn count n is constant in differentiation."""
    return principal + 2 * se.pi * se.floor((reference - principal) / (2 * se.pi) + se.Rational(1, 2))


class Variation:
    """Derivatives of the expressions of one law by the motion of its frames."""

    def __init__(self, frames: tuple[Frame, ...], clock: dict[Expr, Expr]) -> None:
        self.frames, self.clock = frames, clock
        self.values: dict[Expr, Expr] = {}  #: name -> value, after the names that the value contains
        self.constant: set[Expr] = set()  #: names that are not differentiated
        self._defined: list[Expr] = []
        self._names: dict[Expr, Expr] = {}
        self._rates: dict[Expr, Expr] = {}
        self._named: dict[Expr, Expr] = {}
        self._gradients: dict[tuple[str, str, Expr], tuple[Vec, Vec]] = {}
        self._partials: dict[tuple[Expr, Expr], Expr] = {}
        self._tables: dict[bool, dict[Expr, Expr]] = {}
        self._inserted = {False: 0, True: 0}
        self._structure = {symbol: value for f in frames for symbol, value in f.structure.items()}

    def resolve(self, e: Any) -> Expr:
        """The expression with those symbols of the frames replaced that are 0, 1 or -1 for the kinds of their nodes."""
        return se.sympify(e).subs(self._structure) if self._structure else se.sympify(e)

    # -- parameters that follow from sensors

    def define(self, symbol: Expr, statement: Any) -> None:
        """Make a symbol the name of a statement; it counts as a number until `release`."""
        self.values[symbol] = self.resolve(self.name(statement))
        self.constant.add(symbol)
        self._defined.append(symbol)

    def release(self) -> None:
        """Differentiate what was defined like all other names from now on."""
        self.constant -= set(self._defined)
        for table in (self._gradients, self._partials, self._rates) if self._defined else ():
            table.clear()

    # -- naming

    def name(self, statement: Any) -> Expr:
        """The statement with its intermediates replaced by names."""
        e = se.sympify(statement)
        for f in self.frames:
            if e in f.undefined:
                raise LawError(f"the {f.undefined[e]} of {f.side} is not defined for a {f.kind.value} node, "
                               f"which has no rotation: use a rigid body, or the point of the frame alone")
        if not e.args or e.is_Number:
            return e
        if e not in self._named:
            self._named[e] = self._with_names(e)
        return self._named[e]

    def _with_names(self, e: Expr) -> Expr:
        if isinstance(e, se.Piecewise):
            args = [self.name(a) for a in e.args]
            return se.Piecewise(*zip(args[::2], args[1::2], strict=True))
        if isinstance(e, se.UnevaluatedExpr):  # a bracket
            return self.name(e.args[0])
        if not hasattr(e, "func"):  # a comparison has none
            return e.subs({a: self.name(a) for a in e.args})
        function = se.Function(e.get_name()) if isinstance(e, se.FunctionSymbol) else e.func
        inner = function(*map(self.name, e.args))
        return self._name(inner) if isinstance(inner, se.FunctionSymbol | se.floor | se.atan2) else inner

    def _name(self, atom: Expr) -> Expr:
        if atom not in self._names:
            kind = atom.get_name() if isinstance(atom, se.FunctionSymbol) else type(atom).__name__
            if kind == "rate":
                value = self._rate_by_names(atom.args[0])
            elif kind == "let":
                value = atom.args[0]
            else:
                value = atom.func(*(self._symbol(arg) for arg in atom.args))
            symbol = self._symbol(value)
            self._names[atom] = symbol
            if isinstance(atom, se.floor):
                self.constant.add(symbol)
        return self._names[atom]

    def _symbol(self, value: Expr) -> Expr:
        if value.is_Number or isinstance(value, se.Symbol):
            return value
        symbol = se.Symbol(f"named{len(self.values) + 1}")
        self.values[symbol] = value
        return symbol

    def _symbols(self, v: Vec) -> Vec:
        """A vector of named components."""
        return Vec(*(self._symbol(self.resolve(c)) for c in v))

    def _rate_by_names(self, e: Expr) -> Expr:
        """`rate` with names for the rates of names too, which keeps the derivatives of a damper's force short."""
        by = _by(e)
        total = sum((by(p) * dp for p, dp in self.clock.items()), _ZERO)
        for f in self.frames:
            move, turn = self._direct_gradient(f, e)
            total += move @ f.center_velocity + turn @ f.w
        for factor, name in self._chain(e):
            if name not in self._rates:
                self._rates[name] = self._symbol(self.resolve(self._rate_by_names(self.values[name])))
            total += factor * self._rates[name]
        return total

    # -- differentiation

    def _chain(self, e: Expr) -> Iterable[tuple[Expr, Expr]]:
        """(de/dname, name) for every name in e that is not constant: the factors of the chain rule."""
        for name in sorted(e.free_symbols, key=str):
            if name in self.values and name not in self.constant:
                yield se.diff(e, name), name

    def diff(self, e: Expr, symbol: Expr) -> Expr:
        """Partial derivative by an unknown or a parameter, by the chain rule through names."""
        total = _by(e)(symbol)
        for factor, name in self._chain(e):
            if (name, symbol) not in self._partials:
                self._partials[name, symbol] = self._symbol(self.resolve(self.diff(self.values[name], symbol)))
            total += factor * self._partials[name, symbol]
        return total

    def gradient(self, f: Frame, e: Expr) -> tuple[Vec, Vec]:
        """Gradients of e by a displacement of the node, de/dr, and by its virtual rotation, the sum of a x de/da over the vectors
        a fixed to the body; inertial components."""
        if not f.kind.moves:
            return ZERO, ZERO
        return self._through_names("gradient", f, e, *self._direct_gradient(f, e))

    @staticmethod
    def _direct_gradient(f: Frame, e: Expr) -> tuple[Vec, Vec]:
        if not f.kind.moves:
            return ZERO, ZERO
        by, free = _by(e), e.free_symbols
        turn = Vec(0, 0, by(f.heading))
        for a in f.attached:
            if not free.isdisjoint(a):
                turn = turn + a.cross(Vec(*map(by, a)))
        return Vec(*map(by, f.center)), turn

    def velocity_gradient(self, f: Frame, e: Expr) -> tuple[Vec, Vec]:
        """Derivatives (de/dv, de/dw) by the velocity of a node and its angular velocity, inertial."""
        if not f.kind.moves:
            return ZERO, ZERO
        by = _by(e)
        return self._through_names("velocity_gradient", f, e, Vec(*map(by, f.center_velocity)), Vec(*map(by, f.w)))

    def _through_names(self, rule: str, f: Frame, e: Expr, move: Vec, turn: Vec) -> tuple[Vec, Vec]:
        for factor, name in self._chain(e):
            key = (rule, f.side, name)
            if key not in self._gradients:
                inner = getattr(self, rule)(f, self.values[name])
                self._gradients[key] = self._symbols(inner[0]), self._symbols(inner[1])
            dm, dt = self._gradients[key]
            move, turn = move + dm * factor, turn + dt * factor
        return move, turn

    def rate(self, e: Expr) -> Expr:
        """de/dt at constant velocities: motion of all frames and the clock of timed parameters."""
        total = sum((self.diff(e, p) * dp for p, dp in self.clock.items()), _ZERO)
        for f in self.frames:
            move, turn = self.gradient(f, e)
            total += move @ f.center_velocity + turn @ f.w
        return total

    def insertion(self, shared: bool = False) -> dict[Expr, Expr]:
        """Every name and frame symbol as a function of unknowns and parameters.

        shared: names stay one node each, an unevaluated expression: expanded wherever they are used, they would make the
        expressions of a large law grow exponentially."""
        table = self._tables.setdefault(shared, {})
        for f in self.frames if not table else ():
            for symbol, value in f.meaning.items():
                table[symbol] = value.subs(table)
        for name, value in list(self.values.items())[self._inserted[shared] :]:
            e = substituted(self.resolve(value), table)
            table[name] = se.UnevaluatedExpr(e) if shared and not e.is_Number and not isinstance(e, se.Symbol) else e
        self._inserted[shared] = len(self.values)
        return table

    def depending(self, symbols: set[Expr]) -> set[Expr]:
        """Some unknowns or parameters, with all names and frame symbols that depend on them."""
        return symbols | {name for name, e in self.insertion(shared=True).items() if e.free_symbols & symbols}

    def jumping(self, symbols: set[Expr]) -> set[Expr]:
        """Names whose values contain, directly or by other names, a function of some of the symbols that jumps."""
        found: set[Expr] = set()
        for name, value in self.values.items():
            e = self.resolve(value)
            if e.free_symbols & found or jumps_with(e, symbols):
                found.add(name)
        return found


def _by(e: Expr) -> Callable[[Expr], Expr]:
    """The function that differentiates an expression by a symbol; by a number, which stands for what is known, it gives 0."""
    free = e.free_symbols
    return lambda symbol: se.diff(e, symbol) if symbol in free else _ZERO
