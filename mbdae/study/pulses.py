"""Pulses: loads and prescribed motions that change during one interval alone, of which begin, width and strength can be varied.

The pulse of the scene as stated is found by sampling its inputs, so it has to be wide enough for that. A varied pulse is the
same expression with its time and its values scaled, so that its edges are known however narrow it has become: a reference run
that restarts at the edges (`extremes/cell.py`) cannot step over it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import symengine as se

from mbdae.errors import OptionError
from mbdae.inputs import timed
from mbdae.inputs.sensed import paths, with_values
from mbdae.scene.record import encode, read

NUMBERS = ("begin", "width", "strength")  #: quantities of a pulse that can be varied
SAMPLES = 20001  #: number of times at which inputs are sampled to find pulses, evenly spaced over the run
CONSTANT = 1e-12  #: change of an input that counts as none, relative to its largest change
BISECTIONS = 60
PARTS = 8  #: number of parts of a pulse: a reference run restarts at each, so that it does not step over a smooth pulse


@dataclass(frozen=True)
class Pulse:
    """Inputs that change only between the times `begin` and `begin + width` (s); strength: their largest difference from their
    value before the pulse, in their own unit."""

    begin: float
    width: float
    strength: float

    @property
    def stops(self) -> list[float]:
        """Times at which a reference run restarts, s."""
        return [float(t) for t in self.begin + self.width * np.arange(PARTS + 1) / PARTS]


def pulse_of(inputs: Sequence[Any], t_end: float) -> Pulse | None:
    """The pulse that several expressions of time make together in a run from 0 to t_end (s); None where one of them changes at
    the start or the end of the run, or where none changes."""
    times = np.linspace(0.0, t_end, SAMPLES)
    seen = np.array([timed.values(e, times) for e in inputs])
    departure = np.abs(seen - seen[:, :1])
    small = CONSTANT * np.max(np.ptp(seen, axis=1), initial=0.0)
    if not np.isfinite(seen).all() or small == 0.0:
        return None
    early = np.flatnonzero(np.any(departure > small, axis=0))[0] - 1
    late = np.flatnonzero(np.any(np.abs(seen - seen[:, -1:]) > small, axis=0))[-1]
    if early < 1 or late > SAMPLES - 3:
        return None
    begin = _edge(inputs, seen[:, 0], small, times[early], times[early + 1])
    end = _edge(inputs, seen[:, -1], small, times[late + 1], times[late])
    return Pulse(begin, max(end - begin, 0.0), float(np.max(departure)))


def _edge(inputs: Sequence[Any], rest: Any, small: float, quiet: float, changed: float) -> float:
    """The time (s) at which inputs leave their constant values `rest`, by bisection between a time `quiet` with these values and
    a time `changed` with other ones: for a Piecewise its edge, else where an input differs from `rest` by `small`."""
    at = np.array([quiet])
    small = 0.0 if all(timed.values(e, at)[0] == value for e, value in zip(inputs, rest, strict=True)) else small
    for _ in range(BISECTIONS):
        middle = np.array([(quiet + changed) / 2])
        off = any(abs(timed.values(e, middle)[0] - value) > small for e, value in zip(inputs, rest, strict=True))
        quiet, changed = (quiet, float(middle[0])) if off else (float(middle[0]), changed)
    return (quiet + changed) / 2


@dataclass(frozen=True)
class Varying:
    """A pulse in the arguments of a statement, and which of its NUMBERS (`number`) is varied. keys: names of the argument, and of
    entries inside it, in which the expressions of the pulse are."""

    keys: tuple[str, ...]
    pulse: Pulse
    number: str

    def at(self, value: float) -> Pulse:
        """The pulse whose varied number has the given value."""
        return replace(self.pulse, **{self.number: value})

    def set(self, arguments: dict[str, Any], value: float) -> None:
        """Replace the expressions in the arguments of the statement by those of the pulse whose varied number has the given
        value."""
        def exact(number: float) -> Any:  # so that times that are shifted and scaled lose no digit
            return se.Rational(*float(number).as_integer_ratio())

        old, new = self.pulse, self.at(value)
        pace = old.width / new.width if self.number == "width" else 1.0
        time = exact(old.begin) + exact(pace) * (timed.TIME - exact(new.begin))
        size = exact(new.strength / old.strength)
        for holder, key in list(_places(arguments, self.keys)):
            e = timed.expression(with_values(read(holder[key])))
            before = exact(float(timed.values(e, np.zeros(1))[0]))
            holder[key] = encode(before + size * (e.subs({timed.TIME: time}) - before))


def varying(arguments: dict[str, Any], keys: Sequence[str], t_end: float, name: str) -> Varying | None:
    """The pulse in the arguments of a statement, in a run of t_end (s), of which `keys` name a number to vary: ("width",) or, for
    one of several inputs, ("value", "0", "width"). None where `keys` name another argument. name: as the user gave it, for
    messages."""
    *path, number = keys
    if number not in NUMBERS or number in arguments or number in arguments.get("law", {}).get("values", {}):
        return None
    inputs = [timed.expression(with_values(read(holder[key]))) for holder, key in _places(arguments, path)]
    if not inputs:
        return None
    found = pulse_of(inputs, t_end)
    if found is None or not (found.width or number != "width"):
        raise OptionError(f"vary: '{name}': only a pulse has this number, and what is stated there is none: between the start "
                          f"and t = {t_end:g} s it has to be constant, change for some time, and be constant again")
    return Varying(tuple(path), found, number)


def pulses(statements: Any, t_end: float) -> list[Pulse]:
    """The pulses of single expressions in statements, in a run of t_end (s)."""
    alone = [timed.expression(with_values(read(holder[key]))) for holder, key in _places(statements, ())]
    return [found for e in alone if (found := pulse_of([e], t_end)) is not None]


def _places(holder: Any, path: Sequence[str]) -> Iterator[tuple[Any, Any]]:
    """(list or mapping, key) of every expression that depends on time alone, in the nested data `holder` below a path of names
    and indices."""
    for key, value in enumerate(holder) if isinstance(holder, list) else holder.items():
        rest = path[1:] if path and str(key) == path[0] else path
        if isinstance(value, dict) and "expression" in value:
            if not rest and not paths(read(value)):
                yield holder, key
        elif isinstance(value, list | dict):
            yield from _places(value, rest)
