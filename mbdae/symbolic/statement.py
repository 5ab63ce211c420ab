"""What a law states, and checks that it can be derived: only symbols that it declares and quantities that its nodes have.

Feedback: a parameter that follows from sensors is a name for an expression of what is read (`Variation.define`). Forces follow by
virtual work as if it were a number; afterwards it depends on the motion like every other name, so that derivatives of the
equations are exact. What is read of bodies and joints is stated on frames of the law that are added for it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import symengine as se

from mbdae.errors import LawError
from mbdae.symbolic.frames import Frame, NodeKind, make_frame
from mbdae.symbolic.motion import symbolic_steps
from mbdae.symbolic.rebuild import nodes, unusable
from mbdae.symbolic.variation import Variation, rate
from mbdae.symbolic.vectors import Expr, Vec

_TIME = se.Symbol("t")
#: methods of a law that derivations call with its frames; of joints also `resistance`, `rubbing` and `pressing`
QUESTIONS = ("rows", "velocity_constraints", "read", "positives", "energy", "dissipation", "wrench", "thrust", "gaps", "approach",
             "observed", "losses", "rates", "initial", "kinetic_energy")


@dataclass(frozen=True)
class Reading:
    """A quantity that a feedback reads. symbol: its name in expressions; frames: number of frames from which it is computed;
    quantity: "state" (no frame), "coordinate" (of a joint that has it as an unknown), "joint" (the coordinate of a joint computed
    from its frames k, l), or of a body "position", "velocity", "angular_velocity", "rotation"; entry: which component of these;
    rated: whether its time derivative is read; joint: class and structure of the joint, name of the coordinate."""

    symbol: str
    quantity: str
    frames: int = 1
    entry: tuple[int, ...] = ()
    rated: bool = False
    joint: tuple[Any, Any, str] | None = None

    def stated(self, *frames: Frame) -> Expr:
        """The quantity, or its time derivative, as an expression of its frames."""
        found = self._quantity(*frames)
        return rate(found) if self.rated else found

    def _quantity(self, *frames: Frame) -> Expr:
        if self.quantity == "state":
            return se.Symbol(foreign(self.symbol))
        if self.quantity == "coordinate":
            return frames[0].r[0]
        if self.joint is not None:
            cls, structure, name = self.joint
            return cls.symbolic(structure).read(*frames)[name]
        (b,) = frames
        if self.quantity == "rotation":
            row, column = self.entry
            return (b.x, b.y, b.z)[column][row]
        return {"position": b.r, "velocity": b.v, "angular_velocity": b.w}[self.quantity][self.entry[0]]


def foreign(symbol: str) -> str:
    """Name of the symbol for an internal state of another law that is read under the name `symbol`."""
    return f"foreign_{symbol}"


@dataclass(frozen=True)
class Feeds:
    """The sensors that a law reads: readings, and names with their expressions in the symbols of readings, of earlier names, of
    numbers and of values prescribed in time. Names that are parameters of the law are the parameters that follow from sensors."""

    readings: tuple[Reading, ...] = ()
    names: tuple[tuple[str, Expr], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.names)

    @property
    def sides(self) -> tuple[str, ...]:
        """Names of the frames that are added for the readings."""
        return tuple(f"m{n + 1}" for n in range(sum(r.frames for r in self.readings)))

    def stated(self, frames: Sequence[Frame]) -> list[tuple[str, Expr]]:
        """Every name with its expression, first those of the readings; frames: those added for the readings."""
        found, first = [], 0
        for reading in self.readings:
            found.append((reading.symbol, reading.stated(*frames[first : first + reading.frames])))
            first += reading.frames
        return [*found, *self.names]

    @property
    def foreign(self) -> list[Expr]:
        """Symbols of internal states of other laws, in the order of their readings."""
        return [se.Symbol(foreign(r.symbol)) for r in self.readings if r.quantity == "state"]


NO_FEEDS = Feeds()


class LawStatement:
    """What a law states on its frames, with checks that name the law in a LawError."""

    def __init__(self, law: Any, variation: Variation) -> None:
        self.law, self.variation, self.frames = law, variation, variation.frames

    @property
    def sides(self) -> tuple[Frame, ...]:
        """Frames of bodies."""
        return self.frames[: len(self.law.frames)]

    def oriented(self) -> bool:
        """Whether the nodes of all frames have axes."""
        return all(f.kind.oriented for f in self.sides)

    @cached_property
    def _names(self) -> set[str]:
        return {f.side for f in self.frames}

    def undefined(self, e: Any) -> list[tuple[Frame, str]]:
        """Quantities in an expression (or vector) that its node does not have, with the frames; frames with axes first."""
        symbols = set().union(*(se.sympify(c).free_symbols for c in (e if isinstance(e, Vec) else (e,))))
        frames = sorted(self.frames, key=lambda f: not f.kind.oriented)
        return [(f, f.undefined[s]) for f in frames for s in sorted(symbols & f.undefined.keys(), key=str)]

    def refuse_speeds(self, term: str, e: Any) -> None:
        """Raise LawError where an expression contains a velocity. For expressions in which only positions are allowed."""
        speeds = _symbols(v for f in self.frames for v in (f.v, f.w, f.center_velocity, f.spin))
        places = _symbols(v for f in self.frames for v in (f.r, f.x, f.y, f.z, f.center, f.arm))
        found = se.sympify(e).free_symbols & (speeds - places)
        if found:
            raise LawError(f"{term} of {type(self.law).__name__} contains a velocity ({min(map(str, found))}): it may contain "
                           f"the points r and the axes x, y, z of its frames, not v and w")

    def refuse(self, term: str, e: Any) -> None:
        """Raise LawError where an expression contains the time, an undeclared symbol, a quantity its nodes do not have, or what
        cannot be differentiated or compiled."""
        self.refuse_unusable(term, e)
        symbols = set().union(*(se.sympify(c).free_symbols for c in (e if isinstance(e, Vec) else (e,))))
        if _TIME in symbols and str(_TIME) not in self.law.params:
            raise LawError(f"{term} of {type(self.law).__name__} contains mb.t: state a parameter (params = mb.params(...)) and "
                           f"give that an expression of mb.t")
        unknown = symbols - self._known
        for symbol in sorted(map(str, unknown - _letters(e) if unknown else ())):
            raise LawError(f"{term} of {type(self.law).__name__} contains the symbol {symbol}, which it does not declare; write "
                           f"params = mb.params({symbol}=('unit', 'meaning')) and self.{symbol}")
        for frame, quantity in self.undefined(e):
            law = type(self.law).__name__
            if frame.kind.oriented:
                raise LawError(f"{term} of {law} needs the {quantity} of {frame.side}, which exists in the plane only; state it "
                               f"with self.relative_angle(k, l), the angle about the axis, or the axes x, y, z, or use "
                               f"space='planar'")
            raise LawError(f"{law} needs axes on both sides; a point mass has none: {term} reads the {quantity} of {frame.side}; "
                           f"use s.rigid_body for that body")

    def refuse_unusable(self, term: str, e: Any) -> None:
        """Raise LawError where an expression (or vector) contains what cannot be differentiated or compiled."""
        fixed = {se.Symbol(name) for name in self.law.params} - self.variation.clock.keys()
        for part in e if isinstance(e, Vec) else (e,):
            if why := unusable(part, fixed):
                raise LawError(f"{term} of {type(self.law).__name__} contains {why}")

    def answers(self) -> dict[str, Any]:
        """All that the law says of itself and on its frames: two laws with the same answers have the same equations, but for
        forces that follow from a joint's own reactions."""
        law, cls = self.law, type(self.law)
        parameters = [{name: entry.unit for name, entry in table.items()}
                      for table in (law.params, law.states, getattr(law, "coordinates", {}))]
        return {
            "of the class": {name: value for name in dir(cls) if name[0] != "_" and _is_plain(value := getattr(cls, name))},
            "declared": [list(map(list, table.items())) for table in parameters],
            "present": [name for name in law.params if getattr(law, name) is not None],
            "chosen": {name: _chosen(getattr(law, name)) for name in law.options},
            "in time": [(p, rate) for p, rate in self.variation.clock.items()],
            "frames": [(f.side, f.kind.value, f.axes.value) for f in self.frames],
            "motion": symbolic_steps(law),
            **{name: getattr(law, name)(*self.sides) for name in QUESTIONS if hasattr(law, name)},
        }

    @cached_property
    def _known(self) -> set[Expr]:
        """Every symbol a statement may contain."""
        law = self.law
        own = {se.Symbol(name) for name in law.params} | {se.Symbol(f"state_{name}") for name in law.states} | {_TIME}
        return own.union(*(f.symbols for f in self.frames), {se.Symbol(f"lambda_{row}") for row in self.rows})

    @cached_property
    def rows(self) -> dict[str, Expr]:
        """The rows of a joint as stated: those of positions, then those of velocities."""
        rows = dict(self.law.rows(*self.sides))
        if twice := rows.keys() & self.of_velocities.keys():
            raise LawError(f"{type(self.law).__name__} states the row '{min(twice)}' twice, by positions and by velocities: "
                           f"choose another name for one of them")
        return rows | self.of_velocities

    @cached_property
    def of_velocities(self) -> dict[str, Expr]:
        """The rows that are stated by velocities."""
        return dict(self.law.velocity_constraints(*self.sides))

    def refuse_clashes(self) -> None:
        """Raise LawError where a parameter has the name of a symbol of the frames, the rows or the states."""
        law, kind = self.law, type(self.law).__name__
        taken = dict.fromkeys(_names_of_frames((*"bklc", *sorted(self._names - set("bklc")))), "the frames")
        taken |= {f"{mark}_{row}": f"row '{row}'" for row in self.rows for mark in ("lambda", "mu")}
        taken |= {f"{mark}_{state}": f"state '{state}'" for state in law.states for mark in ("state", "statep")}
        taken |= {f"{name}_{dots}": f"the time derivative of '{name}'" for name in law.params for dots in ("dot", "ddot")}
        for name in law.params:
            if name in taken:
                raise LawError(f"{kind}: '{name}' in params is the symbol of {taken[name]} in derivations; choose another name")

    def refuse_undefined(self) -> None:
        """Raise LawError where a joint between nodes with axes contains quantities that these nodes do not have."""
        law, sides = self.law, self.sides
        stated: list[tuple[str, Any]] = []
        if self.oriented():
            stated += [(f"row '{name}'", e) for name, e in self.rows.items()]
            stated += [(f"the coordinate '{name}'", e) for name, e in law.read(*sides).items()]
            stated += [(f"the branch '{name}'", e) for name, e in law.positives(*sides).items()]
        for what, e in stated:
            self.refuse(what, e)
            if what not in {f"row '{name}'" for name in self.of_velocities}:
                self.refuse_speeds(what, e)


_PLAIN = (bool, int, float, str, type(None))


def _is_plain(value: Any) -> bool:
    """Whether the value of a class attribute is plain data, which a derivation may depend on and a digest can contain."""
    return isinstance(value, _PLAIN) or (type(value) is tuple and all(isinstance(v, str) for v in value))


def _chosen(value: Any) -> Any:
    """The value of an option where it is plain data, else "given": what such an option does shows in the other answers."""
    return value if _is_plain(value) else "given"


@lru_cache(maxsize=64)
def _names_of_frames(sides: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the symbols of frames on every kind of node."""
    return tuple({str(s) for side in sides for kind in NodeKind for s in make_frame(side, kind).symbols})


def _symbols(vectors: Iterable[Vec]) -> set[Expr]:
    return set().union(*(se.sympify(v[i]).free_symbols for v in vectors for i in range(3)))


def _letters(e: Any) -> set[Expr]:
    """Symbols that only give intermediate results their letters in reports (second argument of `let`): no part of the
    statement."""
    found = (node for part in (e if isinstance(e, Vec) else (e,)) for node in nodes(se.sympify(part)))
    return {n.args[1] for n in found if isinstance(n, se.FunctionSymbol) and n.get_name() == "let" and len(n.args) > 1}
