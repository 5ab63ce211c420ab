"""Parts of a law that may be exchanged: the normal law and the friction law of a contact.

A part is stated on scalars (penetration, sliding velocity), the law it belongs to says where they act. Parameters of a
part become parameters of the law, named "<option>_<parameter>"; a parameter left at None is absent from the statement.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Self

import symengine as se

from mbdae.errors import LawError


@dataclass(frozen=True)
class Parameter:
    """A parameter of a law: unit and meaning."""

    unit: str
    meaning: str = ""


def params(**units: str | tuple[str, str]) -> dict[str, Parameter]:
    """Declare parameters: `params(pitch="m/rad")` or `params(pitch=("m/rad", "travel per turn"))`."""
    return {name: Parameter(*((spec,) if isinstance(spec, str) else spec)) for name, spec in units.items()}


@dataclass(frozen=True)
class PartStructure:
    """What distinguishes two statements of one part beside numbers."""

    cls: type[Part]
    absent: frozenset[str]
    options: tuple[tuple[str, Any], ...]

    def symbolic(self, prefix: str) -> Part:
        """The part with symbols for its values."""
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
    #: whether bodies may stick by it, as by friction: equations are stiff there. None: not said, a part with states then may
    sticks: ClassVar[bool | None] = None

    def __init__(self, **values: Any) -> None:
        known = (*self.params, *self.options)
        unknown = sorted(set(values) - set(known))
        if unknown:
            raise LawError(f"{type(self).__name__}: unknown parameter {unknown[0]!r}; it has {list(known)}")
        for key in known:
            value = values.get(key)
            setattr(self, key, self._number(key, value) if key in self.params and value is not None else value)

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Parameters, options and states are attributes by name."""

    def _number(self, key: str, value: Any) -> float:
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = float("nan")
        if not abs(number) < float("inf"):
            unit = self.params[key].unit
            raise LawError(f"{type(self).__name__}: {key} = {value!r} is not a finite number; give {unit}")
        return number

    def refuse(self, key: str, why: str) -> LawError:
        """The error that names a parameter with its value and unit."""
        unit = self.params[key].unit.removesuffix("1")
        return LawError(f"{type(self).__name__}: {key} = {getattr(self, key):g}{' ' if unit else ''}{unit} {why}")

    def values(self) -> dict[str, Any]:
        """Parameters and options by name."""
        return {key: getattr(self, key) for key in (*self.params, *self.options)}

    def may_stick(self) -> bool:
        """Whether bodies may stick by this part; where it does not say, it may if it has internal states."""
        return bool(self.states) if self.sticks is None else self.sticks

    def state_scales(self) -> dict[str, float]:
        """Typical magnitude of an internal state, where it is not 1."""
        return {}

    def structure(self) -> PartStructure:
        """Which parameters are absent, and the options."""
        absent = frozenset(p for p in self.params if getattr(self, p) is None)
        return PartStructure(type(self), absent, tuple((key, getattr(self, key)) for key in self.options))

    def with_states(self, **symbols: Any) -> Self:
        """The same part reading other symbols as its states: where a law has it in two places."""
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
