"""Runs beside a run, with which it is compared, and the forces and torques of all joints and force elements at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbdae.deferred import distinct
from mbdae.errors import OptionError
from mbdae.integrators.solution import Solution
from mbdae.results.sensors import reaction_outputs
from mbdae.results.states import States
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared

#: largest number of unknowns at all steps of a run beside the one that is returned that is kept whole (16 MB, with its
#: derivatives and stages 50 MB); larger ones are kept at the times of the comparison alone
WHOLE = 2_000_000
#: number of times at which a run is compared with another; with contacts up to MOST, as far as all unknowns at them are at most
#: NUMBERS: impacts are short, and of 200 times of a run with 5000 steps one companion met them and another did not
FEWEST, MOST, NUMBERS = 200, 2000, 400_000
KINDS = ("companion", "window", "mesh", "closer")  #: see `OtherRun`


def some_of(times: Array, unknowns: int, contacts: bool) -> Array:
    """Those of the times of a comparison at which two runs are read: equally many between any two of them. contacts: whether
    their scene has some."""
    count = int(np.clip(NUMBERS // max(unknowns, 1), FEWEST, MOST if contacts else FEWEST))
    return np.asarray(times[distinct(np.linspace(0, len(times) - 1, count).astype(int))])


def wrenches(prepared: Prepared, at: States) -> Array:
    """(nt, items, 6) force (N) and torque (N m) of every joint and force element on its body l, as their sensors show them."""
    m, items = prepared.with_all_rows, [c.name for c in prepared.model.scene.connections]
    multipliers = m.accelerations(at.t, at.q, at.u, at.s, at.z)[1]
    total = np.zeros((len(at.t), len(items), 6))
    for g, _, values in m.evaluate(reaction_outputs, at.t, at.q, at.u, at.s, multipliers):
        for i, instance in enumerate(prepared.model.groups[g].instances):
            if instance.item in items:
                total[:, items.index(instance.item)] += values[:, i]
    return total


@dataclass(frozen=True, eq=False)
class AtTimes:
    """Dense output of a run of which the unknowns y (k, n) at the times t (k,) alone are kept."""

    t: Array
    y: Array

    def value(self, t: Array) -> Array:
        """y at times among those kept; OptionError for others."""
        i = np.clip(np.searchsorted(self.t, t), 0, len(self.t) - 1)
        if not np.array_equal(self.t[i], t):
            raise OptionError("a run that was kept at some times is not known at others")
        return self.y[i]

    def derivative(self, t: Array) -> Array:
        """y' is not kept: nan."""
        return np.full_like(self.value(t), np.nan)


def sampled(run: Solution, times: Array) -> Solution:
    """A run of which the unknowns at some times (k,) alone are kept."""
    y = run(times)
    return replace(run, t=times, y=y, yp=np.zeros((0, y.shape[1])), outputs=None, interpolant=AtTimes(times, y), systems=())


@dataclass(frozen=True, eq=False)
class OtherRun:
    """A run with which the returned run is compared at some times (k,): the error of the latter is `share` times the difference.

    kind: "companion" (the same method at a larger tolerance, or another method), "window" (a short run that resolves vibrations
    which the run may leave out), "mesh" (the run on a finer mesh of the beams) or "closer" (a run that is far more accurate, made
    when a quantity was read); prepared: its scene, where it has another mesh; ratio: its tolerance over that of the run (0: not
    known)."""

    run: Solution
    times: Array
    share: float
    prepared: Prepared | None = None
    kind: str = "companion"
    ratio: float = 0.0

    @classmethod
    def beside(cls, run: Solution, times: Array, share: float, prepared: Prepared | None = None, kind: str = "companion",
               ratio: float = 0.0) -> OtherRun:  # fmt: skip
        """The run, whole where it is small."""
        kept = replace(run, systems=(), outputs=None) if run.y.size <= WHOLE else sampled(run, times)
        return cls(kept, times, share, prepared, kind, ratio)

    def after(self, end: float) -> OtherRun:
        """The same run, compared after a time (s)."""
        return replace(self, times=self.times[self.times > end])

    def until(self, end: float) -> OtherRun:
        """The same run, compared up to a time (s)."""
        return replace(self, times=self.times[self.times <= end])
