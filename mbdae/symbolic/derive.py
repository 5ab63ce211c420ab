"""From the statement of a law to its terms in the equations of motion, by one rule: delta a = delta psi x a.

Sign: residual = M u' + G^T lambda + (internal, gyroscopic) - applied.
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import symengine as se

from mbdae.errors import LawError
from mbdae.symbolic.frames import Axes, Frame, NodeKind, make_frame
from mbdae.symbolic.law import Element, Force, Joint, Law, Structure
from mbdae.symbolic.rebuild import nodes, one_sided, without_overflow
from mbdae.symbolic.variation import Variation
from mbdae.symbolic.vectors import ZERO, Expr, Vec

Side = tuple[NodeKind, Axes]
_ZERO = se.Integer(0)
Pair = tuple[Vec, Vec]  #: (translational, rotational) part of a covector, inertial components


@dataclass(frozen=True, eq=False)
class Derived:
    """A law derived for given kinds of nodes. Expressions are in the symbols of its frames."""

    law: Any
    frames: tuple[Frame, ...]
    rows: tuple[str, ...]  #: constraint rows that do not vanish
    vanished: tuple[str, ...]  #: rows that vanish identically, or are undefined
    undefined: tuple[str, ...]  #: rows left out because they need axes that a point mass does not have
    g: tuple[Expr, ...]
    G: tuple[dict[str, Pair], ...]  #: per row and side
    force: dict[str, Pair]  #: left-hand side, without multipliers
    energy: Expr
    dissipated_power: Expr
    work_power: Expr
    coordinate: Expr
    states: tuple[str, ...]
    state_rates: tuple[Expr, ...]
    state_starts: tuple[Expr, ...]
    variation: Variation

    @property
    def multipliers(self) -> list[Expr]:
        """Symbols of the multipliers lambda."""
        return [se.Symbol(f"lambda_{row}") for row in self.rows]

    @property
    def sides(self) -> tuple[Frame, ...]:
        """The frames a law is stated on, without a joint coordinate."""
        return self.frames[:2]

    @property
    def row_forces(self) -> list[Expr]:
        """Factors of the rows' gradients: lambda, or scaling lambda + 2 penalty c (paper Eq. 2)."""
        forces = [self.scaled(s) for s in self.multipliers]
        penalty = getattr(self.law, "penalty", None)
        return forces if penalty is None else [f + 2 * penalty * c for f, c in zip(forces, self.g, strict=True)]

    @property
    def reaction_forces(self) -> list[Expr]:
        """The forces of the rows where the rows vanish: scaling lambda."""
        return [self.scaled(s) for s in self.multipliers]

    def scaled(self, e: Expr) -> Expr:
        """A row or multiplier times the scaling of the joint."""
        return _scaled(self.law, e)

    @property
    def reactions(self) -> dict[str, Expr]:
        """Force of every row by its name, on which `resistance` depends: scaling lambda, 0 where the row vanishes."""
        return _reactions(self.law, self.rows, self.vanished)

    @property
    def reactive(self) -> bool:
        """Whether a joint states forces that depend on its own reactions."""
        return isinstance(self.law, Joint) and bool(self.force)

    @property
    def stabilisers(self) -> list[Expr]:
        """Symbols of the stabilising multipliers mu."""
        return [se.Symbol(f"mu_{row}") for row in self.rows]


@lru_cache(maxsize=512)
def derive(cls: type[Law], structure: Structure, sides: tuple[Side, ...]) -> Derived:
    """Derive a law class for the kinds of its nodes (one side for an element, else k and l)."""
    frames = tuple(make_frame(s, *side) for s, side in zip("b" if len(sides) == 1 else "klc"[: len(sides)], sides, strict=True))
    if structure.timed and cls.timeless:
        raise LawError(f"{cls.__name__}: {min(structure.timed)} may not depend on time; give a number")
    law = cls.symbolic(structure)
    for name in law.own_coordinates:
        setattr(law, name, frames[2].q[0])
    return _Derivation(law, Variation(frames, _clock(structure.timed))).run()


FORCES = ("energy", "dissipation", "wrench")  #: a force law states one of them at least
_TIME = se.Symbol("t")


def _clock(timed: Iterable[str]) -> dict[Expr, Expr]:
    """Symbol -> symbol of its time derivative, for time-dependent parameters and their rates."""
    clock: dict[Expr, Expr] = {}
    for name in sorted(timed):
        p, d, dd = (se.Symbol(name + suffix) for suffix in ("", "_dot", "_ddot"))
        clock |= {p: d, d: dd}
    return clock


class _Derivation:
    """The steps from a statement to a `Derived`."""

    def __init__(self, law: Any, variation: Variation) -> None:
        self.law, self.variation, self.frames = law, variation, variation.frames

    def run(self) -> Derived:
        self._refuse_clashes()
        self._refuse_undefined()
        rows, vanished, undefined, g, G = self._constraints()
        force, powers = self._forces(_reactions(self.law, rows, vanished))
        resolve = self.variation.resolve
        energy, dissipated, work = map(resolve, powers)
        states, rates, starts = self._states([*g, energy, dissipated, work, *self.variation.values.values()])
        return Derived(
            self.law, self.frames, tuple(rows), tuple(vanished), tuple(undefined), tuple(g), tuple(G), force, energy, dissipated,
            work,
            resolve(self._coordinate()), states, rates, starts, self.variation,
        )  # fmt: skip

    def _coordinate(self) -> Expr:
        stated = self.law.coordinate(*self.frames[:2]) if isinstance(self.law, Joint) and self._oriented() else None
        return _ZERO if stated is None else self.variation.name(stated)

    def _oriented(self) -> bool:
        return all(f.kind.oriented for f in self.frames[:2])

    def _undefined(self, e: Any) -> list[tuple[Frame, str]]:
        """Quantities in an expression (or vector) that its node does not have, with the frames; frames with axes first."""
        symbols = set().union(*(se.sympify(c).free_symbols for c in (e if isinstance(e, Vec) else (e,))))
        frames = sorted(self.frames, key=lambda f: not f.kind.oriented)
        return [(f, f.undefined[s]) for f in frames for s in sorted(symbols & f.undefined.keys(), key=str)]

    def _refuse_speeds(self, what: str, e: Any) -> None:
        """Raise LawError where an expression that may depend on positions only contains a velocity."""
        speeds = _symbols(v for f in self.frames for v in (f.v, f.w, f.center_velocity, f.spin))
        places = _symbols(v for f in self.frames for v in (f.r, f.x, f.y, f.z, f.center, f.arm))
        found = se.sympify(e).free_symbols & (speeds - places)
        if found:
            raise LawError(f"{what} of {type(self.law).__name__} contains a velocity ({min(map(str, found))}): it may contain "
                           f"the points r and the axes x, y, z of its frames, not v and w")  # fmt: skip

    def _refuse(self, what: str, e: Any) -> None:
        """Raise LawError where an expression contains the time, an undeclared symbol, or a quantity its nodes do not have."""
        symbols = set().union(*(se.sympify(c).free_symbols for c in (e if isinstance(e, Vec) else (e,))))
        if _TIME in symbols and str(_TIME) not in self.law.params:
            raise LawError(f"{what} of {type(self.law).__name__} contains mb.t: state a parameter (params = mb.params(...)) and "
                           f"give that an expression of mb.t")  # fmt: skip
        unknown = symbols - self._known
        for symbol in sorted(map(str, unknown - _letters(e) if unknown else ())):
            raise LawError(f"{what} of {type(self.law).__name__} contains the symbol {symbol}, which it does not declare; write "
                           f"params = mb.params({symbol}=('unit', 'meaning')) and self.{symbol}")  # fmt: skip
        for frame, quantity in self._undefined(e):
            law = type(self.law).__name__
            if frame.kind.oriented:
                raise LawError(f"{what} of {law} needs the {quantity} of {frame.side}, which exists in the plane only; state it "
                               f"with self.angle(k, l), the angle about the axis, or the axes x, y, z, or use space='planar'")
            raise LawError(f"{law} needs axes on both sides; a point mass has none: {what} reads the {quantity} of {frame.side}; "
                           f"use s.rigid_body")  # fmt: skip

    @cached_property
    def _known(self) -> set[Expr]:
        """Every symbol a statement may contain."""
        law = self.law
        own = {se.Symbol(name) for name in law.params} | {se.Symbol(f"state_{name}") for name in law.states} | {_TIME}
        return own.union(*(f.symbols for f in self.frames), {se.Symbol(f"lambda_{row}") for row in self._rows})

    @cached_property
    def _rows(self) -> dict[str, Expr]:
        """The rows of a joint as stated."""
        return self.law.constraints(*self.frames[:2]) if isinstance(self.law, Joint) else {}

    def _refuse_clashes(self) -> None:
        """Raise LawError where a parameter has the name of a symbol of the frames, the rows or the states."""
        law, kind = self.law, type(self.law).__name__
        taken = dict.fromkeys(_names_of_frames(), "the frames")
        taken |= {f"{mark}_{row}": f"row '{row}'" for row in self._rows for mark in ("lambda", "mu")}
        taken |= {f"{mark}_{state}": f"state '{state}'" for state in law.states for mark in ("state", "statep")}
        taken |= {f"{name}_{dots}": f"the time derivative of '{name}'" for name in law.params for dots in ("dot", "ddot")}
        for name in law.params:
            if name in taken:
                raise LawError(f"{kind}: '{name}' in params is the symbol of {taken[name]} in derivations; choose another name")

    def _refuse_undefined(self) -> None:
        """Raise LawError where a joint between nodes with axes contains quantities that these nodes do not have."""
        law, sides = self.law, self.frames[:2]
        stated: list[tuple[str, Any]] = []
        if isinstance(law, Joint) and self._oriented():
            stated += [(f"row '{name}'", e) for name, e in self._rows.items()]
            stated += [("the coordinate", law.coordinate(*sides) or _ZERO)]
            stated += [(f"the branch '{name}'", e) for name, e in law.branches(*sides).items()]
        for what, e in stated:
            self._refuse(what, e)
            self._refuse_speeds(what, e)

    def _constraints(self) -> tuple[list[str], list[str], list[str], list[Expr], list[dict[str, Pair]]]:
        """Rows that remain for these frames, names of the others (and of those undefined), and the rows' gradients."""
        rows: list[str] = []
        vanished: list[str] = []
        undefined: list[str] = []
        g: list[Expr] = []
        G: list[dict[str, Pair]] = []
        for name, statement in self._rows.items():
            missing = self._undefined(statement)
            if missing and not any(frame.kind.oriented for frame, _ in missing):
                vanished.append(name)
                undefined.append(name)
                continue
            self._refuse(f"row '{name}'", statement)
            self._refuse_speeds(f"row '{name}'", statement)
            c = self.variation.name(without_overflow(one_sided(statement)))
            if self._vanishes(self.variation.resolve(c)):
                vanished.append(name)
                continue
            rows.append(name)
            g.append(self.variation.resolve(c))
            G.append({f.side: self._in_plane(self.variation.gradient(f, c), f, f"row '{name}'") for f in self.frames})
        return rows, vanished, undefined, g, G

    def _vanishes(self, e: Expr) -> bool:
        """Whether an expression is zero for every value of its symbols (three random points)."""
        if e == 0:
            return True
        if not any(f.kind.flat for f in self.frames):
            return False
        e = e.subs(self.variation.insertion())
        rng = random.Random(7)
        symbols = sorted(e.free_symbols, key=str)
        return max(abs(float(e.subs({s: rng.uniform(0.3, 0.9) for s in symbols}))) for _ in range(3)) < 1e-12

    def _in_plane(self, pair: Pair, f: Frame, what: str) -> Pair:
        """The pair with zeros and ones of the frames inserted; on a planar node it must have no component out of the plane."""
        move, turn = (Vec(*map(self.variation.resolve, part)) for part in pair)
        if not f.kind.flat:
            return move, turn
        if not all(self._vanishes(e) for e in (move[2], turn[0], turn[1])):
            raise LawError(f"{type(self.law).__name__} is not planar: {what} acts out of the plane")
        return Vec(move[0], move[1], 0), Vec(0, 0, turn[2])

    def _stated(self, reactions: Mapping[str, Expr]) -> tuple[Expr, Expr, Vec, Vec] | None:
        """Potential energy, Rayleigh function, force and torque as stated; None where the law states no force."""
        law, (k, l) = self.law, self.frames[:2]
        if isinstance(law, Force):
            if all(getattr(type(law), name) is getattr(Force, name) for name in FORCES):
                raise LawError(f"force law {type(law).__name__} states none of {', '.join(FORCES)}; see mb.Force")
            force, torque = law.wrench(k, l) or (ZERO, ZERO)
            parts = law.energy(k, l), law.dissipation(k, l), *force, *torque
            energy, rayleigh, *applied = (without_overflow(one_sided(part)) for part in parts)
            return energy, rayleigh, Vec(*applied[:3]), Vec(*applied[3:])
        wrench = law.resistance(k, l, reactions) if isinstance(law, Joint) else None
        return None if wrench is None else (_ZERO, _ZERO, *wrench)

    def _forces(self, reactions: Mapping[str, Expr]) -> tuple[dict[str, Pair], tuple[Expr, Expr, Expr]]:
        """Left-hand-side forces per side; energy, dissipated power and power of applied loads."""
        law, v = self.law, self.variation
        if isinstance(law, Element):
            return {}, (v.name(law.kinetic_energy(self.frames[0])), _ZERO, _ZERO)
        stated = self._stated(reactions)
        if stated is None:
            return {}, (_ZERO, _ZERO, _ZERO)
        for what, part in zip(("the energy", "the dissipation", "the force", "the torque"), stated, strict=True):
            self._refuse(what, part)
        self._refuse_speeds("the energy", stated[0])
        energy, rayleigh = v.name(stated[0]), v.name(stated[1])
        wrench = (Vec(*map(v.name, stated[2])), Vec(*map(v.name, stated[3])))
        force: dict[str, Pair] = {}
        dissipated, loads = _ZERO, _ZERO
        clocked = sum((v.diff(energy, p) * dp for p, dp in v.clock.items()), _ZERO)
        for f in self.frames:
            drag, load = v.velocity_gradient(f, rayleigh), self._wrench_on(f, wrench)
            dissipated += _power(drag, f)
            loads -= _power(load, f)
            total = (sum(p, ZERO) for p in zip(v.gradient(f, energy), drag, load, strict=True))
            force[f.side] = self._in_plane((next(total), next(total)), f, "its force")
        resisting = law.dissipative or isinstance(law, Joint)
        return force, (energy, dissipated - loads, clocked) if resisting else (energy, dissipated, clocked + loads)

    def _wrench_on(self, f: Frame, wrench: tuple[Vec, Vec]) -> Pair:
        """Covector of the wrench at l.r on one side (left-hand side: minus what is applied)."""
        force, torque = wrench
        if f.side == "c":
            return ZERO, ZERO
        sign = -1 if f.side == "l" else 1
        if not f.kind.turns:
            return sign * force, ZERO
        return sign * force, sign * (torque + (self.frames[1].r - f.center).cross(force))

    def _states(self, used_in: list[Expr]) -> tuple[tuple[str, ...], tuple[Expr, ...], tuple[Expr, ...]]:
        """Internal states on which the law depends for these frames, their rates and start values."""
        used = set().union(*(e.free_symbols for e in used_in))
        names = tuple(n for n in self.law.states if se.Symbol(f"state_{n}") in used)
        rates, starts = (self.law.rates(*self.frames[:2]), self.law.initial(*self.frames[:2])) if names else ({}, {})
        for what, table in (("the rate", rates), ("the start", starts)):
            for n in names:
                if n not in table:
                    raise LawError(f"{type(self.law).__name__} states no value for {what} of its state '{n}'; "
                                   f"return {{'{n}': expression}} from {'rates' if table is rates else 'initial'}(self, k, l)")
                self._refuse(f"{what} of state '{n}'", table[n])
        ready = [tuple(self.variation.resolve(self.variation.name(table[n])) for n in names) for table in (rates, starts)]
        return names, ready[0], ready[1]


@lru_cache(maxsize=1)
def _names_of_frames() -> tuple[str, ...]:
    """Names of the symbols of frames on every kind of node."""
    return tuple({str(s) for side in "bklc" for kind in NodeKind for s in make_frame(side, kind).symbols})


def _symbols(vectors: Iterable[Vec]) -> set[Expr]:
    return set().union(*(se.sympify(v[i]).free_symbols for v in vectors for i in range(3)))


def _letters(e: Any) -> set[Expr]:
    """Letters of intermediate results in reports: they are no symbols of the statement."""
    found = (node for part in (e if isinstance(e, Vec) else (e,)) for node in nodes(se.sympify(part)))
    return {n.args[1] for n in found if isinstance(n, se.FunctionSymbol) and n.get_name() == "let" and len(n.args) > 1}


def _scaled(law: Any, e: Expr) -> Expr:
    scaling = getattr(law, "scaling", None)
    return e if scaling is None else scaling * e


def _reactions(law: Any, rows: Iterable[str], vanished: Iterable[str]) -> dict[str, Expr]:
    return {row: _scaled(law, se.Symbol(f"lambda_{row}")) for row in rows} | dict.fromkeys(vanished, _ZERO)


def _power(pair: Pair, f: Frame) -> Expr:
    return pair[0] @ f.center_velocity + pair[1] @ f.w
