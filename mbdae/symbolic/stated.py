"""What a law states at this moment, as a key of what was derived from it.

A law is Python code: it may read constants, closures, attributes, other functions and files, all of which may change while Python
runs. Whatever they are, they show in its statement. So laws are stated anew whenever a model is made, and what was derived is
found by the statement, never by the class.

Within a process nothing is remembered by the class of a law. Every model asks each of its laws once what it states (some 60
microseconds), and finds what was derived, planned and compiled by the answer (`stated.Stated`), which is compared expression by
expression. A law that is new is asked four times: one that answers otherwise each time is refused. `Derived` answers later
questions, such as those of sensors, from the statement that was derived, so that a result keeps its equations when the law
changes. Scenes that are sent to other processes carry a digest of what their own laws state (`scene/scene.py`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cached_property, lru_cache, partial
from typing import Any

import symengine as se

from mbdae.disk import store
from mbdae.disk.entries import Digests, key_of
from mbdae.errors import LawError
from mbdae.symbolic.frames import Axes, NodeKind, make_frame
from mbdae.symbolic.motion import Motion, Rotation, symbolic_steps
from mbdae.symbolic.rebuild import nodes
from mbdae.symbolic.statement import QUESTIONS
from mbdae.symbolic.variation import Variation
from mbdae.symbolic.vectors import Expr, Vec

Side = tuple[NodeKind, Axes]

#: plain values with their types, since 1, 1.0 and True are equal; expressions of symengine tell 1 from 1.0 themselves
_PLAIN = (type(None), bool, int, str, bytes)
CHANGED = "it states something else now than when the model was made: make the scene's run, report or result again"


def frozen(value: Any) -> Any:
    """An answer of a law as a key: equal for equal expressions and values. An error where it contains an object of
    another kind."""
    kind = type(value)
    if kind in _PLAIN:
        return kind, value
    if kind is Vec:
        return value.c
    if kind is dict:
        return tuple([(k, type(v), v) if type(v) in _PLAIN else (k, frozen(v)) for k, v in value.items()])
    if kind is tuple or kind is list:
        return tuple([frozen(v) for v in value])
    if isinstance(value, se.Basic | Enum):
        return value
    if isinstance(value, float):
        return float, value.hex()
    if isinstance(value, Motion):
        return frozen(value.steps)
    if isinstance(value, Mapping):
        return frozen(dict(value))
    if isinstance(value, frozenset | set):
        return frozenset(map(frozen, value))
    if is_dataclass(value) and not isinstance(value, type):
        return kind, *(frozen(getattr(value, f.name)) for f in fields(value))
    return se.sympify(value) if hasattr(value, "free_symbols") else frozen(tuple(value))


def zeros(key: Any) -> Iterator[str]:
    """The floating-point zeros in a key, with their signs."""
    for part in key if isinstance(key, tuple) else ():
        yield from zeros(part)
    for node in nodes(key) if isinstance(key, se.Basic) else ():
        if type(node).__name__ == "RealDouble" and float(node) == 0:
            yield float(node).hex()


def changed(law: type[Any]) -> LawError:
    """The error for a law whose later answers contradict those from which a model was made."""
    return LawError(f"{law.__name__}: {CHANGED}")


def unsteady(law: type[Any]) -> LawError:
    """The error for a law that states something else each time it is asked."""
    return LawError(f"{law.__name__} states something else each time it is asked: a law may use no random numbers, clocks or "
                    "counters, and nothing that it changes itself; give what varies as a parameter (params = mb.params(...))")


class Stated:
    """What a law states now on the frames of given nodes; equal where class and statement are equal.

    key: all that it states; None where it cannot be told, because the law fails or answers with objects of another kind."""

    def __init__(self, cls: type[Any], structure: Any, sides: tuple[Side, ...], derivation: Any) -> None:
        self.asked, self.feeds, self._made_by = (cls, structure, sides), structure.feeds, derivation
        self.law = law = cls.symbolic(structure)
        names = (*side_names(law), *structure.feeds.sides)
        self.frames = frames = tuple(make_frame(s, *side) for s, side in zip(names, sides, strict=True))
        if structure.timed and cls.timeless:
            raise LawError(f"{cls.__name__}: {min(structure.timed)} is a parameter that cannot depend on time, sensors or "
                           "controllers; give a number")
        for name, f in zip(law.own_coordinates, frames[len(law.frames) :], strict=False):
            setattr(law, name, f.q[0] if f.kind is NodeKind.COORDINATE else Rotation(tuple(f.q), f.body, f.spin))
        self.key: tuple[Any, ...] | None = None
        made = self._derivation()
        try:
            self.answers, self.by_reactions, self.fed = made.answers(), made.by_any_reactions(), made.fed()
            self.key = (cls, frozen(self.answers), frozen(self.by_reactions), frozen(self.fed))
            self._hash = hash(self.key)
        except Exception:  # a mistake in the law, which its derivation reports, or an answer that is no value or expression
            self.key = None
            return
        for name in self.answers.keys() & set(QUESTIONS):  # what is derived later follows from the same answers
            setattr(law, name, partial(_answer, self.answers[name]))

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Stated) or self.key != other.key:
            return False
        return not self.zeros or self.zeros == other.zeros

    def again(self) -> Stated:
        """What the law states now."""
        return Stated(*self.asked, self._made_by)

    @cached_property
    def zeros(self) -> tuple[str, ...]:
        """The floating-point zeros in what it states, with their signs, which equal expressions do not tell apart."""
        return tuple(zeros(self.key))

    def _derivation(self) -> Any:
        return self._made_by(self.law, Variation(self.frames, clock_of(self.asked[1].timed)), self.feeds)

    def derivation(self) -> tuple[Any, Any, Variation]:
        """Facts and terms of the law."""
        self.refuse_other_reactions()
        made = self._derivation()
        return (*made.run(), made.variation)

    def refuse_change(self) -> None:
        """Raise LawError where the law states something else than it did."""
        if self.key is not None and self.again() != self:
            raise changed(self.asked[0])

    def refuse_other_reactions(self) -> None:
        """The same, for a law that answers by its reactions, which are known in derivations only."""
        if self.key is not None and self.by_reactions is not None:
            self.refuse_change()

    def digest(self) -> str:
        """The same text for the same statement in every process; "" where it cannot be told."""
        try:
            return Digests().of([self.answers, self.by_reactions, self.fed]) if self.key is not None else ""
        except Exception:  # a value that has no digest
            return ""

    def entry_key(self) -> str | None:
        """Key of the law in the cache on disk, a digest of all that it states, forces by its own reactions included; None where
        it cannot be cached."""
        if not store().used or self.key is None:
            return None
        try:
            return key_of("law", Digests().of([self.answers, self._derivation().by_reactions(), self.fed]))
        except Exception:  # a value that has no digest
            return None


def own(law: Any) -> bool:
    """Whether a law is not only mbdae's: its class, a part of it, or a method put into one of these."""
    return any(map(own_class, (type(law), *map(type, law.parts))))


def own_class(cls: type[Any]) -> bool:
    """Whether a class is not only mbdae's."""
    return any(not (getattr(f, "__module__", None) or "mbdae.").startswith(("mbdae.", "typing", "abc"))
               for base in cls.__mro__[:-1] for f in (base, *vars(base).values()) if callable(f))


def _answer(answer: Any, *_: Any, **__: Any) -> Any:
    return answer


def side_names(law: Any) -> tuple[str, ...]:
    """Names of the frames of a law: those of bodies, then "c", "c2", ... of the coordinates that are its unknowns."""
    return (*law.frames, *("c" if n == 0 else f"c{n + 1}" for n in range(len(law.own_coordinates))))


def clock_of(timed: Iterable[str]) -> dict[Expr, Expr]:
    """Symbol -> symbol of its time derivative, for time-dependent parameters and their rates."""
    clock: dict[Expr, Expr] = {}
    for name in sorted(timed):
        p, d, dd = (se.Symbol(name + suffix) for suffix in ("", "_dot", "_ddot"))
        clock |= {p: d, d: dd}
    return clock


def motion_key(law: Any, structure: Any) -> object:
    """An object that stands for the motion that a joint states now: the same one for the same motion of one class."""
    try:
        steps = frozen(symbolic_steps(law.symbolic(structure)))
        return _one(law, tuple((name, entry.unit) for name, entry in law.coordinates.items()), tuple(law.params), steps)
    except Exception:  # a mistake in the law, which its derivation reports
        return object()


@lru_cache(maxsize=1024)
def _one(*_: Any) -> object:
    return object()
