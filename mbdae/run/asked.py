"""Quantities that a run is asked for beside its motion, `simulate(of=...)`: read, compared between runs, and told.

In the measure by which runs are compared (`control`) each counts as the motion does, by its difference over its largest value. So
tolerance, method and, of beams, whether all vibrations are resolved follow from what was asked; what came of it is estimated like
everything that is read of a result (`results.errors`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mbdae.errors import MbdaeError, OptionError
from mbdae.inputs.sensed import path_of, paths
from mbdae.integrators.solution import Solution, Stats
from mbdae.results.accuracy import Accuracy
from mbdae.results.clearance import AtTimes, OtherRun, some_of
from mbdae.results.errors import Errors
from mbdae.results.quantities import NAME_A_QUANTITY, Quantity, named
from mbdae.results.result import Result
from mbdae.results.states import Instant
from mbdae.results.stored_parts import started
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared
from mbdae.system.sampling import distance
from mbdae.system.scene_system import SceneSystem
from mbdae.values import shown

Wanted = Mapping[Any, Quantity]  #: by the text or object that the user gave, or the name of an expression
_SENSOR = re.compile(r'sensor\("(?:[^"\\]|\\.)*"\)')


def wanted_of(of: Any, prepared: Prepared) -> Wanted:
    """The quantities of `simulate(of=...)`; OptionError, before anything is solved, where one is none."""
    if of is None:
        return {}
    given = of.items() if isinstance(of, Mapping) else [(one, one) for one in (of if isinstance(of, list | tuple) else [of])]
    try:
        found = {key: _read(one, started(prepared)) for key, one in given}
    except (MbdaeError, TypeError) as error:  # what cannot be a key is no quantity either
        raise OptionError(f"of = {shown(of)}: {error}") from error
    names = [named(key) for key in found]
    if not names or len(set(names)) < len(names) or not all(isinstance(key, str) for key in found if isinstance(of, Mapping)):
        raise OptionError(f"of = {shown(of)}: give a list of quantities, each once, or a dictionary of them by name; "
                          f"{NAME_A_QUANTITY}")
    return found


def _read(one: Any, start: Result) -> Quantity:
    """A quantity as results read it: symbols of sensors and expressions of them as text."""
    quantity = _SENSOR.sub(lambda found: path_of(found[0]), str(one)) if paths(one) else one
    start.value(quantity)
    return quantity


class AskedToo:
    """The distance (nt,) of two trajectories a, b (nt, n) of a scene at times t (nt,): that of their motions, at its largest time
    also the differences of the quantities `wanted` over their largest values in b, where these are more.

    motion: the largest distance of the motions at the last call."""

    def __init__(self, prepared: Prepared, system: SceneSystem, wanted: Wanted) -> None:
        self.prepared, self.names, self.wanted = prepared, system.names, wanted
        self.motion = 0.0

    def __call__(self, t: Array, a: Array, b: Array) -> Array:
        found = np.array(distance(self.prepared, t, a, b))
        self.motion = float(np.max(found, initial=0.0))
        times, first = np.unique(t, return_index=True)
        some = some_of(times, a.shape[1], bool(self.prepared.contacts))
        if len(some) > 1:
            of = first[np.searchsorted(times, some)]
            k = int(np.argmax(found))
            found[k] = max(found[k], self._apart(some, a[of], b[of]))
        return found

    def _apart(self, t: Array, a: Array, b: Array) -> float:
        """The largest difference of a quantity over its size; 0 where it is rounding."""
        own, other = self._run(t, b), self._run(t, a)
        errors = Errors(self.prepared, own, (OtherRun(other, t, 1.0),), wanted=tuple(self.wanted.values()))
        view = Result(self.prepared, own, None, t)  # type: ignore[arg-type]
        estimates = [errors.of(view, quantity) for quantity in self.wanted.values()]
        return max((one.relative for one in estimates if one is not None), default=0.0)

    def _run(self, t: Array, y: Array) -> Solution:
        return Solution(t, y, y[:0], None, Stats(), Instant("", y, y), self.names, True, AtTimes(t, y))

    def of_motion(self, run: Solution, others: tuple[OtherRun, ...], estimate: float) -> float:
        """The part of an estimate, made with this measure of a run and others, that speaks of the motion."""
        motion = both = 0.0
        for other in others:
            apart = float(np.max(self(other.times, other.run(other.times), run(other.times))))
            motion, both = max(motion, other.share * self.motion), max(both, other.share * apart)
        return estimate * motion / both if both > 0 and math.isfinite(estimate) else estimate


def told(result: Result, known: Accuracy, wanted: Wanted) -> tuple[Accuracy, list[str]]:
    """The accuracy of a run with the relative errors of the quantities it was asked for, and what is to be said of those that are
    not within it."""
    errors, asked = known.errors, known.asked
    if errors is None or asked is None:
        found = dict.fromkeys(wanted)
        return replace(known, of=found), [f"of: the error of {named(key)} is not known: {known.not_covered[named(key)]}"
                                          for known in [replace(known, of=found)] for key in wanted]
    errors.wanted = tuple(wanted.values())
    relative = dict[Any, float | None]()
    for key, quantity in wanted.items():
        estimate = errors.of(result, quantity)
        relative[key] = None if estimate is None else estimate.relative
        errors.tell(named(key), "", estimate, asked)
    return replace(known, of=relative), []
