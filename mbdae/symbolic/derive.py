"""From the statement of a law to its terms in the equations of motion, by one rule: delta a = delta psi x a.

Sign: residual = M u' + G^T lambda + (internal, gyroscopic) - applied.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import symengine as se

from mbdae.errors import LawError
from mbdae.process import made_once, spends
from mbdae.symbolic.derived import Derived as Derived
from mbdae.symbolic.derived import Facts, NotPlanarError, Pair, Terms, reaction_on_l, reactions
from mbdae.symbolic.frames import Axes, Frame, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Element, Force, Law, Structure
from mbdae.symbolic.motion import refuse_amounts, value_of
from mbdae.symbolic.rebuild import one_sided, without_overflow
from mbdae.symbolic.stated import Side as Side
from mbdae.symbolic.stated import Stated, unsteady
from mbdae.symbolic.statement import Feeds, LawStatement
from mbdae.symbolic.variation import Variation
from mbdae.symbolic.vectors import ZERO, Expr, Vec

_ZERO = se.Integer(0)


LOOKS = 4  #: how often a law that is derived is asked what it states: one that chooses between two answers by chance shows both


@spends("derive")
def derive(cls: type[Law], structure: Structure, sides: tuple[Side, ...]) -> Derived:
    """Derive a law class for given nodes, or find what was derived by what the law states now. sides has, for every frame of the
    law, the kind of its node and the structure of the axes on it. structure: options, absent parameters and those that depend on
    time."""
    stated = Stated(cls, structure, sides, _Derivation)
    return _derived(stated) if stated.key is None else _known(stated)


def digest_of(law: Law) -> str:
    """What a law states, as text: the same in every process for the same statement between bodies in space and in the plane."""
    named, structure = getattr(law, "coordinates", {}), law.structure()
    turns = [name in named and named[name].unit == "rotation" for name in law.own_coordinates]
    own = [(NodeKind.ROTATION if turn else NodeKind.COORDINATE, Axes.GENERAL) for turn in turns]
    found = [Stated(type(law), structure, (*[side] * len(law.frames), *own), _Derivation)
             for side in ((NodeKind.SPATIAL, Axes.GENERAL), (NodeKind.PLANAR, Axes.NORMAL))]
    return " ".join(stated.digest() for stated in found)


@made_once("derive", 512)
def _known(stated: Stated) -> Derived:
    return _derived(stated)


def _derived(stated: Stated) -> Derived:
    if stated.key is not None and any(stated.again() != stated for _ in range(LOOKS - 1)):
        stated.derivation()  # what is no number is no equal of itself either: the derivation says so
        raise unsteady(stated.asked[0])
    return Derived(stated, stated.entry_key(), stated.derivation)


FORCES = ("energy", "dissipation", "wrench", "thrust")  #: a force law states one of them at least


class _Stated(NamedTuple):
    """Forces as a law states them: potential energy, Rayleigh function, force and torque on l, generalised force on a
    coordinate."""

    energy: Expr
    rayleigh: Expr
    force: Vec
    torque: Vec
    thrust: tuple[Expr, Expr] | None

    def parts(self) -> dict[str, Any]:
        """The parts by their names in messages."""
        along, push = self.thrust or (_ZERO, _ZERO)
        return {"the energy": self.energy, "the dissipation": self.rayleigh, "the force": self.force, "the torque": self.torque,
                "the coordinate of its thrust": along, "the thrust": push}


class _Derivation(LawStatement):
    """Derives the terms of a law from its statement."""

    def __init__(self, law: Any, variation: Variation, feeds: Feeds) -> None:
        super().__init__(law, variation)
        self.feeds = feeds

    def fed(self) -> list[Any]:
        """The sensors that the law reads: every name with its statement on the frames that are read, and states of other laws."""
        return [[list(pair) for pair in self.feeds.stated(self.read_frames)], self.feeds.foreign]

    def by_reactions(self) -> list[Any] | None:
        """What a joint states by its own reactions; None where it states nothing by them."""
        if not self._reacts():
            return None
        rows, vanished, _, _, G, _ = self._constraints()
        return self._by(reactions(self.law, rows, vanished), reaction_on_l(self.law, self.frames, rows, G))

    def by_any_reactions(self) -> list[Any] | None:
        """The same with symbols for the reactions, which takes no derivatives."""
        if not self._reacts():
            return None
        x, y, z = se.symbols("reaction_1:4")
        return self._by(reactions(self.law, self.rows, ()), Vec(x, y, 0 if any(f.kind.flat for f in self.frames) else z))

    def _reacts(self) -> bool:
        law, cls = self.law, type(self.law)
        own = ("resistance", "rubbing", "pressing", "normal_force", "sliding", "lever")
        return isinstance(law, Joint) and (
            law.friction is not None or any(getattr(cls, name, None) is not getattr(Joint, name) for name in own))

    def _by(self, reactions: Mapping[str, Expr], force: Vec) -> list[Any]:
        law = self.law
        pressing = None if law.friction is None else law.pressing(self.sides[0], self.sides[1], force)
        return [law.resistance(*self.sides, reactions), law.rubbing(force, *self.sides), pressing]

    def run(self) -> tuple[Facts, Terms]:
        self.refuse_clashes()
        self.refuse_undefined()
        self._refuse_others()
        # define the names of the sensors that the law reads
        for name, statement in self.feeds.stated(self.read_frames):
            e = without_overflow(one_sided(statement))
            for frame, quantity in self.undefined(e):
                raise LawError(f"an expression given to a {type(self.law).__name__} reads a sensor that a {frame.kind.value} "
                               f"body does not have ({quantity} of its frame); use s.rigid_body for that body")
            self.variation.define(se.Symbol(name), e)
        if isinstance(self.law, Joint):
            refuse_amounts(self.law)
        rows, vanished, undefined, g, G, speeds = self._constraints()
        force_on_l = reaction_on_l(self.law, self.frames, rows, G)
        force, powers = self._forces(reactions(self.law, rows, vanished), force_on_l)
        energy, dissipated, work = map(self.variation.resolve, powers)
        states, rates, starts = self._states([*g, *speeds, energy, dissipated, work, *self.variation.values.values()])
        self.variation.release()
        by_rates = tuple(row for row in rows if row in self.of_velocities)
        facts = Facts(tuple(rows), tuple(vanished), tuple(undefined), states, bool(force), by_rates)
        known = energy, dissipated, work, self._coordinates(), rates, starts
        return facts, Terms(tuple(g), tuple(G), tuple(speeds), force, *known)

    def _refuse_others(self) -> None:
        """Raise LawError where an answer that no equation contains, or a kinetic energy, cannot be used."""
        law, sides = self.law, self.sides
        if isinstance(law, Element):
            self.refuse_unusable("the kinetic energy", law.kinetic_energy(*sides))
        if isinstance(law, Force):
            stated = [("the gaps", law.gaps(*sides)), ("the approach", law.approach(*sides)), ("the losses", law.losses(*sides)),
                      ("what is observed", law.observed(*sides))]
            for term, answer in stated:
                for e in _leaves(answer):
                    self.refuse_unusable(term, e)

    @property
    def read_frames(self) -> tuple[Frame, ...]:
        """The frames that are added for the sensors that the law reads."""
        return self.frames[len(self.frames) - len(self.feeds.sides) :]

    def _coordinates(self) -> dict[str, Expr]:
        stated = {name: e for name, e in self.law.read(*self.sides).items() if not self.undefined(e)}
        return {name: self.variation.resolve(self.variation.name(e)) for name, e in stated.items()}

    def _constraints(self) -> tuple[list[str], list[str], list[str], list[Expr], list[dict[str, Pair]], list[Expr]]:
        """Names of the rows that do not vanish for these frames, of those that vanish identically or are left out, of those left
        out because a mass point has no axes; of the first, their expressions of positions (0 of rows of velocities), their
        gradients by side, and their expressions of velocities (0 of rows of positions)."""
        v = self.variation
        rows: list[str] = []
        vanished: list[str] = []
        undefined: list[str] = []
        g: list[Expr] = []
        G: list[dict[str, Pair]] = []
        speeds: list[Expr] = []
        for name, statement in self.rows.items():
            missing = self.undefined(statement)
            if missing and not any(frame.kind.oriented for frame, _ in missing):
                vanished.append(name)
                undefined.append(name)
                continue
            self.refuse(f"row '{name}'", statement)
            of_speeds = name in self.of_velocities
            if not of_speeds:
                self.refuse_speeds(f"row '{name}'", statement)
            c = v.name(without_overflow(one_sided(statement)))
            stated, gradient = v.resolve(c), v.velocity_gradient if of_speeds else v.gradient
            if self._vanishes(stated):
                vanished.append(name)
                continue
            rows.append(name)
            g.append(_ZERO if of_speeds else stated)
            speeds.append(stated if of_speeds else _ZERO)
            G.append({f.side: self._in_plane(gradient(f, c), f, f"row '{name}'") for f in self.frames})
            if of_speeds:
                self._refuse_other_than_linear(name, G[-1])
        return rows, vanished, undefined, g, G, speeds

    def _refuse_other_than_linear(self, name: str, G: Mapping[str, Pair]) -> None:
        """Raise LawError where a row of velocities does not contain them, or is not linear in them."""
        v, law = self.variation, type(self.law).__name__
        parts = [c for pair in G.values() for vector in pair for c in vector if c != 0]
        if not parts:
            raise LawError(f"row '{name}' of {law} contains no velocity of a body that moves: state it in `constraints`, or use "
                           f"the velocities v, w of its frames or mb.rate(...) in it")
        again = (vector for c in parts for f in self.frames for vector in v.velocity_gradient(f, c))
        if any(v.resolve(e) != 0 for vector in again for e in vector):
            raise LawError(f"row '{name}' of {law} is not linear in the velocities: state it as a sum of velocities times "
                           f"expressions of positions")

    def _vanishes(self, e: Expr) -> bool:
        """Whether an expression is zero for every value of its symbols, tested at three random points."""
        if e == 0:
            return True
        if not any(f.kind.flat for f in self.frames):
            return False
        e = e.subs(self.variation.insertion())
        rng = random.Random(7)
        symbols = sorted(e.free_symbols, key=str)
        found = [value_of(e.subs({s: rng.uniform(0.3, 0.9) for s in symbols})) for _ in range(3)]
        return all(value is not None and abs(value) < 1e-12 for value in found)

    def _in_plane(self, pair: Pair, f: Frame, what: str) -> Pair:
        """The pair (force, moment) with the zeros and ones of the frames inserted. NotPlanarError where it has a component out of
        the plane of a planar node; what: the words for the pair in that error."""
        move, turn = (Vec(*map(self.variation.resolve, part)) for part in pair)
        if not f.kind.flat:
            return move, turn
        if not all(self._vanishes(e) for e in (move[2], turn[0], turn[1])):
            raise NotPlanarError.of(self.law, what)
        return Vec(move[0], move[1], 0), Vec(0, 0, turn[2])

    def _stated(self, reactions: Mapping[str, Expr], force_on_l: Vec) -> _Stated | None:
        """The forces that the law states; None where it states none."""
        law, sides = self.law, self.sides
        if isinstance(law, Force):
            if all(getattr(type(law), name) is getattr(Force, name) for name in FORCES):
                raise LawError(f"force law {type(law).__name__} states none of {', '.join(FORCES)}; state one of these "
                               f"methods, see mb.Force")
            wrench = law.wrench(*sides) or (ZERO, ZERO)
            if len(sides) > 2 and type(law).wrench is not Force.wrench:
                raise LawError(f"{type(law).__name__} acts on {len(sides)} bodies, but its wrench is force and torque between "
                               f"two, k and l; state energy, dissipation or thrust instead")
            return _Stated(law.energy(*sides), law.dissipation(*sides), *wrench, law.thrust(*sides))
        if not isinstance(law, Joint):
            return None
        stated, rubbing = law.resistance(*sides, reactions), law.rubbing(force_on_l, *sides)
        return None if stated is None and rubbing is None else _Stated(_ZERO, _ZERO, *(stated or (ZERO, ZERO)), rubbing)

    def _forces(self, reactions: Mapping[str, Expr], force_on_l: Vec) -> tuple[dict[str, Pair], tuple[Expr, Expr, Expr]]:
        """Generalised forces by side, as on the left-hand side; energy, dissipated power and power of applied loads."""
        law, v = self.law, self.variation
        if isinstance(law, Element):
            return {}, (v.name(law.kinetic_energy(self.frames[0])), _ZERO, _ZERO)
        stated = self._stated(reactions, force_on_l)
        if stated is None:
            return {}, (_ZERO, _ZERO, _ZERO)
        for what, part in stated.parts().items():
            self.refuse(what, part)
        self.refuse_speeds("the energy", stated.energy)
        energy, rayleigh = (v.name(without_overflow(one_sided(e))) for e in (stated.energy, stated.rayleigh))
        wrench = tuple(Vec(*(v.name(without_overflow(one_sided(c))) for c in part)) for part in (stated.force, stated.torque))
        along, push = (v.name(without_overflow(one_sided(e))) for e in stated.thrust or (_ZERO, _ZERO))
        force: dict[str, Pair] = {}
        dissipated, loads = _ZERO, _ZERO
        clocked = sum((v.diff(energy, p) * dp for p, dp in v.clock.items()), _ZERO)
        symbols = set().union(*(se.sympify(c).free_symbols for part in stated.parts().values()
                                for c in (part if isinstance(part, Vec) else (part,))))
        for f in self.frames:
            load = self._wrench_on(f, wrench)  # type: ignore[arg-type]
            # symengine gives no 0 for the derivative of a Piecewise by a symbol that it does not contain
            if not f.symbols & symbols:
                force[f.side] = self._in_plane(load, f, "its force")
                loads -= _power(load, f)
                continue
            drag = v.velocity_gradient(f, rayleigh)
            if push != 0:
                load = (load[0] + v.gradient(f, along)[0] * -push, load[1] + v.gradient(f, along)[1] * -push)
            dissipated += _power(drag, f)
            loads -= _power(load, f)
            total = (sum(p, ZERO) for p in zip(v.gradient(f, energy), drag, load, strict=True))
            force[f.side] = self._in_plane((next(total), next(total)), f, "its force")
        if self.feeds and energy != 0:  # its energy changes with what its sensors read: it is no potential
            return force, (_ZERO, dissipated, dissipated - sum((_power(force[f.side], f) for f in self.frames), _ZERO))
        resisting = law.dissipative or isinstance(law, Joint)
        return force, (energy, dissipated - loads, clocked) if resisting else (energy, dissipated, clocked + loads)

    def _wrench_on(self, f: Frame, wrench: tuple[Vec, Vec]) -> Pair:
        """Generalised force of the wrench at l.r on the node of one side: as on the left-hand side, the opposite of what is
        applied."""
        force, torque = wrench
        if f.side not in ("k", "l") or all(e == 0 for e in (*force, *torque)):
            return ZERO, ZERO
        sign = -1 if f.side == "l" else 1
        if not f.kind.turns:
            return sign * force, ZERO
        return sign * force, sign * (torque + (self.frames[1].r - f.center).cross(force))

    def _states(self, used_in: list[Expr]) -> tuple[tuple[str, ...], tuple[Expr, ...], tuple[Expr, ...]]:
        """Internal states that some of the expressions `used_in` contain, with their rates and start values."""
        used = set().union(*(e.free_symbols for e in used_in))
        names = tuple(n for n in self.law.states if self.law.keeps_states or se.Symbol(f"state_{n}") in used)
        rates, starts = (self.law.rates(*self.sides), self.law.initial(*self.sides)) if names else ({}, {})
        for rate_or_start, table in (("the rate", rates), ("the start", starts)):
            for n in names:
                if n not in table:
                    raise LawError(f"{type(self.law).__name__} states no value for {rate_or_start} of its state '{n}'; "
                                   f"return {{'{n}': expression}} from {'rates' if table is rates else 'initial'}(self, k, l)")
                self.refuse(f"{rate_or_start} of state '{n}'", table[n])
        ready = [tuple(self.variation.resolve(self.variation.name(without_overflow(one_sided(table[n])))) for n in names)
                 for table in (rates, starts)]
        return names, ready[0], ready[1]


def _leaves(answer: Any) -> Iterator[Expr]:
    """The expressions in lists, pairs and dictionaries."""
    parts = answer.values() if isinstance(answer, Mapping) else answer if isinstance(answer, tuple | list) else None
    if parts is None:
        yield answer
    for part in parts or ():
        yield from _leaves(part)


def _power(pair: Pair, f: Frame) -> Expr:
    return pair[0] @ f.center_velocity + pair[1] @ f.w
