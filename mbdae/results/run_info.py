"""How a result was made, the events of its run, and how far its constraints are violated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from mbdae.integrators.solution import Stats
from mbdae.results.accuracy import Accuracy
from mbdae.system.base import Array


@dataclass(frozen=True)
class Drift:
    """Largest constraint violation at each of the result's times: g (m, rad) and G u + g_t (m/s, rad/s), (nt,)."""

    position: Array
    velocity: Array


class Event(NamedTuple):
    """A condition that was met: the time (s), the condition as it was given, and 1 where it began to hold (of an equation: where
    its left side rose through the right one), -1 where it ceased to (fell), 0 where it was only touched."""

    time: float
    name: str
    direction: int


@dataclass(frozen=True)
class RunInfo:
    """How a result was made."""

    solver: Any
    form: str
    accuracy: Accuracy
    stats: Stats
    runs: int = 1
    cpu_s: float = 0.0  #: CPU time of all runs made for this result, s: solvers tried, companions, verification, recheck
    warnings: tuple[str, ...] = ()
    choice: str = ""  #: why this solver, where mbdae chose it
    #: False where the energy balance, a damped contact, a joint that is off or a contact that steps missed speaks against it;
    #: `Result.reliable` also counts accuracy and completeness
    reliable: bool = True
    events: tuple[Event, ...] = ()
