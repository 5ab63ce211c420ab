"""Units of what sensors measure, and numbers of things in words."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")
UNITS: dict[str, str] = {}  #: quantity of sensors -> its SI unit, "" where it has none; `quantity` enters them
LOOPS: set[str] = {"drive"}  #: those that follow from accelerations and reactions, so that no load can read them


def quantity(unit: str, loop: bool = False) -> Callable[[T], T]:
    """Decorator of the function of a property of a sensor: its SI unit, by which tables, plots, sweeps, conditions and messages
    know it. loop: whether it follows from accelerations or reactions."""

    def entered(function: T) -> T:
        UNITS[name := getattr(function, "__name__", "")] = unit
        LOOPS.update({name} if loop else ())
        return function

    return entered


def counted(count: int, noun: str) -> str:
    """A number of things in words: "1 row", "2 rows", "1 degree of freedom", "3 bodies"."""
    first, *rest = noun.split(" of ")
    many = f"{first[:-1]}ies" if first.endswith("y") else f"{first}es" if first.endswith("s") else f"{first}s"
    return " of ".join([f"{count} {first if count == 1 else many}", *rest])
