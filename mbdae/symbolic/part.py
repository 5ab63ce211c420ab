"""Parts: exchangeable pieces of a law, namely the normal law and the friction law of a contact or joint.

A part is stated on scalars (penetration, sliding velocity), the law it belongs to says where they act. Parameters of a
part become parameters of the law, named "<option>_<parameter>"; a parameter left at None is absent from the statement.
"""

from __future__ import annotations

import keyword
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar

import symengine as se

from mbdae.errors import LawError, unknown_name
from mbdae.symbolic.class_checks import check_class
from mbdae.values import BadValueError, number, shown

T = TypeVar("T")


@dataclass(frozen=True)
class Parameter:
    """A parameter of a law: unit and meaning."""

    unit: str
    meaning: str = ""


def params(**units: str | tuple[str, str]) -> dict[str, Parameter]:
    """Declare parameters: `params(pitch="m/rad")` or `params(pitch=("m/rad", "travel per turn"))`."""
    return {name: _parameter(name, spec) for name, spec in units.items()}


def _parameter(name: str, spec: Any) -> Parameter:
    words = (spec,) if isinstance(spec, str) else spec
    if not (isinstance(words, tuple | list) and len(words) in (1, 2) and all(isinstance(w, str) for w in words)):
        raise LawError(f"params: {name} = {shown(spec)} is neither a unit nor a pair (unit, meaning); write "
                       f"{name}=('m', 'what it is')")
    if not words[0].strip():
        raise LawError(f"params: {name} = {shown(spec)} has no unit; give one, '1' for a pure number")
    if not name.isidentifier() or keyword.iskeyword(name):
        raise LawError(f"params: {name} = {shown(spec)}: '{name}' cannot be the name of an attribute; use letters, digits and _")
    return Parameter(*map(str, words))


def checked_value(item: str, key: str, value: Any, read: Callable[..., T], remedy: str, **bounds: Any) -> T:
    """A value of a law or part as `read(value, **bounds)` returns it (`mbdae.values`). Where it is refused, LawError names the
    item, the key, the value and the remedy."""
    try:
        return read(value, **bounds)
    except BadValueError as value_and_fault:
        if any(str(one).startswith('number("') for one in getattr(value, "free_symbols", ())):
            raise LawError(f"{item}: {key} = {shown(value)} is a named number, and laws take plain ones: give its value, and "
                           f"vary, fit or derive by its name in the scene, as 'floor.normal.{key}'") from None
        raise LawError(f"{item}: {key} = {value_and_fault}; {remedy}") from None


class Identity:
    """An object that is equal to itself alone, whatever it says of its equality."""

    __slots__ = ("value",)

    def __init__(self, value: Any) -> None:
        self.value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Identity) and self.value is other.value

    def __hash__(self) -> int:
        return id(self.value)


def exact(value: Any) -> Any:
    """A value as a key: plain values by type and value, because 1, 1.0 and True are equal, other objects by identity, because
    what they say of their equality need not be all that a law reads of them."""
    if value is None or isinstance(value, str | Exactly):
        return value
    if isinstance(value, bool | int | float):
        return type(value), repr(value)
    return tuple(map(exact, value)) if type(value) is tuple else Identity(value)


class Exactly:
    """Base of structures, which are equal where all that distinguishes statements is equal as `exact` tells."""

    @cached_property
    def key(self) -> tuple[Any, ...]:
        """What distinguishes it from others."""
        raise NotImplementedError

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Exactly) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


@dataclass(frozen=True, eq=False)
class PartStructure(Exactly):
    """What distinguishes two statements of one part apart from numbers."""

    cls: type[Part]
    absent: frozenset[str]
    options: tuple[tuple[str, Any], ...]

    @cached_property
    def key(self) -> tuple[Any, ...]:
        """Its class, absent parameters, options."""
        return self.cls, self.absent, exact(self.options)

    def symbolic(self, prefix: str) -> Part:
        """The part with symbols for its values; prefix: name of the law's option, with which the symbols of parameters begin."""
        part = object.__new__(self.cls)
        for p in self.cls.params:
            setattr(part, p, None if p in self.absent else se.Symbol(f"{prefix}_{p}"))
        for key, value in self.options:
            setattr(part, key, value)
        for state in self.cls.states:
            setattr(part, state, se.Symbol(f"state_{state}"))
        return part

    @property
    def __name__(self) -> str:
        return self.cls.__name__ + "".join(f" without {p}" for p in sorted(self.absent))


class Part:
    """A part with its values as attributes; equal where class and values are."""

    params: ClassVar[Mapping[str, Parameter]] = MappingProxyType({})
    options: ClassVar[tuple[str, ...]] = ()  #: attributes that change the statement itself
    states: ClassVar[Mapping[str, Parameter]] = MappingProxyType({})
    #: whether bodies may stick by the part, as by friction (the equations are then stiff); None: they may where the part has
    #: states
    sticks: ClassVar[bool | None] = None

    def __init__(self, **values: Any) -> None:
        known, kind = (*self.params, *self.options), type(self).__name__
        unknown = sorted(set(values) - set(known))
        if unknown:
            raise LawError(f"{kind}: unknown parameter {unknown_name(unknown[0], known)} it has {', '.join(known) or 'none'}")
        for key in known:
            value = values.get(key)
            setattr(self, key, self._number(key, value) if key in self.params and value is not None else value)
        try:
            hash(tuple(values[key] for key in self.options if key in values))
        except Exception as error:  # a hash of the user's own may raise anything
            given = {key: shown(values[key]) for key in self.options if key in values}
            raise LawError(f"{kind}: the options {given} cannot be hashed; give numbers, text or tuples of them") from error

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        check_class(cls, ())

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Parameters, options and states are attributes by name."""

    def _number(self, key: str, value: Any) -> float:
        unit = self.params[key].unit
        return checked_value(type(self).__name__, key, value, number, f"give a number{f' in {unit}' if unit != '1' else ''}")

    def number(self, key: str, bound: str = "from 0", why: str = "") -> float:
        """The value of the parameter `key`; LawError where it is absent or not within its bound, "from 0" or "above 0".

        why: what a value out of bounds would cause, for the message."""
        found = getattr(self, key)
        if found is None:
            return self._number(key, found)
        if found < 0 or (found == 0 and bound == "above 0"):
            negative_or_0 = "negative" if found < 0 else "not positive"
            raise self.refuse(key, f"is {negative_or_0}{why and f': {why}'}; give a value {bound}")
        return float(found)

    def refuse(self, key: str, fault_and_remedy: str) -> LawError:
        """The error that names the parameter `key` with its value and unit; fault_and_remedy: the rest of the sentence."""
        unit = self.params[key].unit.removesuffix("1")
        return LawError(f"{type(self).__name__}: {key} = {getattr(self, key):g}{' ' if unit else ''}{unit} {fault_and_remedy}")

    def values(self) -> dict[str, Any]:
        """Parameters and options by name."""
        return {key: getattr(self, key) for key in (*self.params, *self.options)}

    def may_stick(self) -> bool:
        """Whether bodies may stick by this part; by default where it has internal states."""
        return bool(self.states) if self.sticks is None else self.sticks

    def state_scales(self) -> dict[str, float]:
        """Typical magnitude of an internal state, where it is not 1."""
        return {}

    def structure(self) -> PartStructure:
        """Which parameters are absent, and the options."""
        absent = frozenset(p for p in self.params if getattr(self, p) is None)
        return PartStructure(type(self), absent, tuple((key, getattr(self, key)) for key in self.options))

    def with_states(self, **symbols: Any) -> Self:
        """The same part with other symbols for its states: for a contact in which it acts at two places."""
        part = object.__new__(type(self))
        vars(part).update(vars(self) | symbols)
        return part

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self.values() == other.values()

    def __hash__(self) -> int:
        return hash((type(self), *self.values().values()))

    def __repr__(self) -> str:
        given = ", ".join(f"{key}={value!r}" for key, value in self.values().items() if value is not None)
        return f"{type(self).__name__}({given})"
