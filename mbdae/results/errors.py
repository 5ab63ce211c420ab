"""The error of everything that a result shows, from the runs that were made beside the one that is returned.

A quantity is read from the run and from each of the others at the same times; the difference, times the share of it that is the
error of the run, is the estimate. It is computed when the quantity is read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.errors import MbdaeError, warn
from mbdae.integrators.solution import Solution
from mbdae.results.clearance import FURTHER, AtTimes, OtherRun, at_the_same_times
from mbdae.results.contacts import averaged, fallen, largest
from mbdae.results.quantities import Estimate, Quantity, absent, difference, differences, magnitudes, moves, named, unit_of, value
from mbdae.results.sensors import forces_apart
from mbdae.results.states import RunStates, inside
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared

#: rounding error of forces, relative to the force that moves the heaviest body by the scene's length in the motion's
#: characteristic time
NO_FORCE = 1e-9
#: a quantity that is smaller than this fraction of what the scene has of its kind (force, torque, power, acceleration) counts as
#: that large: what is left of a sum that vanishes has no digits of its own
LEAST = 1e-6
#: the same for powers: ideal joints have none, and show what they are off times their force
IDLE = 0.1
#: rounding error of forces and what follows from them, relative to the largest force of the run
ROUNDED = 1e-11
#: of a peak inside a window in which another run shows vibrations that this one leaves out counts the largest difference within
#: NEAR (a fraction of the window) of it; of any that no closer run follows at least MEETING times the error over time
NEAR, MEETING = 0.05, 0.3
#: fraction of the accuracy below which the estimate of a run that leaves out vibrations stands without a closer one. Measured:
#: peaks of a wing 5.5 times as far off as run and companion differ, where vibrations begin in mid-run; the tension of a rope that
#: tightens 7 times, where both end a step in the same moment
FAR = 0.15
NEARLY = 5.0  #: the closer run is made for the error of all reactions too where that is up to so many times the accuracy
AGAINST_MESH = "give beams more elements or a higher order, and reduced bodies more modes"
#: errors of functions that read what other runs do not have
UNREADABLE = (MbdaeError, ArithmeticError, LookupError, TypeError, ValueError, AttributeError)


@dataclass(eq=False)
class Errors:
    """The errors of a run, from its differences to other runs; called, it returns that of all reactions.

    asked: the accuracy; closer: makes a far more accurate run, or None: once, where the estimate by the others is above it."""

    prepared: Prepared
    solution: Solution
    others: tuple[OtherRun, ...]
    asked: float | None = None
    told: dict[str, str] = field(default_factory=dict)  #: by quantity: what its reader was told
    reactions: float | None = None  #: error of all reactions where it is known from a file
    closer: Callable[[], OtherRun | None] | None = field(default=None, repr=False)
    wanted: tuple[Quantity, ...] = ()  #: those that the run was asked for, which are relative to their own size
    _known: dict[Any, Estimate | None] = field(default_factory=dict, repr=False)
    endless: dict[str, float] = field(default_factory=dict, repr=False)  #: quantity that is not finite at a time, s: no error
    remedy: str = ""  #: where a smaller accuracy is none: against the error of round-off
    against_mesh: str = AGAINST_MESH

    def __post_init__(self) -> None:
        self.others = at_the_same_times(self.others)

    def __getstate__(self) -> dict[str, Any]:
        """What `pickle` keeps: runs and what was told; errors are computed again when they are read."""
        return {name: vars(self)[name] for name in ("prepared", "solution", "others", "asked", "told", "reactions", "remedy",
                                               "against_mesh")} | {"closer": None, "_known": {}, "endless": {}}

    # -- reactions

    def __call__(self) -> float:
        """Error of all forces and torques over the largest force of the run (torques are divided by the length)."""
        if self.reactions is None:
            self.reactions = self._of_reactions().error
            asked = self.asked or 0.0
            if asked < self.reactions <= NEARLY * asked and (found := self._closely(self._of_reactions)):
                self.reactions = found.error
        return self.reactions

    def _of_reactions(self) -> Estimate:
        """The error of all reactions over the largest force."""
        closer = any(other.kind == "closer" for other in self.others)
        compared = [(other, self._forces(other)) for other in self._shown] if closer else self._reactions
        return Estimate(together((other, apart / self._largest_force) for other, (_, apart) in compared), 1.0)

    @cached_property
    def _reactions(self) -> list[tuple[OtherRun, tuple[float, float]]]:
        """Every other run with the largest force at the times of its comparison, and the largest difference, N."""
        return [(other, self._forces(other)) for other in self.others if len(other.times)]

    def _forces(self, other: OtherRun) -> tuple[float, float]:
        """Largest force at the times of a comparison, and the largest difference there, N."""
        own, beside = self._both(other)
        meshes = beside.prepared is not own.prepared  # the inertia of reduced bodies with more modes is at other points
        items = [c.name for c in own.prepared.model.scene.connections if not (meshes and c.kind == "inertia")]
        return forces_apart(own, beside, items, self.asked, other.ratio)

    @cached_property
    def _largest_force(self) -> float:
        """Largest force of the run, N; at least that below which forces are rounding errors."""
        m = self.prepared.mechanics
        mass = float(np.max(m.mass.diagonal()[~m.rotational], initial=0.0))
        least = max(NO_FORCE * mass * self.prepared.length / self.prepared.time**2, 1e-300)
        return max([least, *(size for _, (size, _) in self._reactions)])

    # -- any quantity

    def of(self, result: Any, quantity: Quantity) -> Estimate | None:
        """The error of a quantity over the run; None where no other run can be read. result: the run as users see it."""
        return self._once(quantity, (), lambda: self._estimated(result, quantity))

    def of_peak(self, result: Any, quantity: Quantity, size: float, t: float) -> Estimate | None:
        """The error of the largest magnitude `size` of a quantity, which it has at the time t (s), between the first and the last
        of the result's times. Where the error over time is above the accuracy, the peak is not trusted to runs that may all damp
        what makes it: a closer run is asked first."""
        return self._once(quantity, (size, t, *result.t[[0, -1]]), lambda: self._estimated_peak(result, quantity, size, t))

    def of_mean(self, result: Any, quantity: Quantity, size: float, power: int) -> Estimate | None:
        """The error of the mean (power 1), or of the root mean square (2), of a quantity between the first and the last of
        the result's times, over the largest value `size` there. Of a mean counts the largest integral of the difference up to any
        time, as what swings may end at 0 by chance; of a root mean square its own. Beside a closer run others count after it."""
        def mean(other: OtherRun, t: Array, own: Array, beside: Array) -> float:
            apart = difference(own, beside, unit_of(result, quantity)).reshape(len(t), -1)
            apart = apart if power == 1 else np.sum(apart**2, axis=1, keepdims=True)
            end = max((one.times[-1] for one in self.others if one.kind == "closer"), default=t[0])
            whole = other.kind != "window"  # what a window shows goes on
            begin, length = (min(max(end, result.t[0]), t[0]), result.t[-1] - result.t[0]) if whole else (t[0], 0.0)
            return float(averaged(t, apart, begin, length) ** (1 / power))

        return self._once(quantity, (size, power, *result.t[[0, -1]]), lambda: self._estimated(result, quantity, mean, size))

    def _once(self, quantity: Quantity, further: tuple[float, ...], estimate: Callable[[], Estimate | None]) -> Estimate | None:
        """An estimate, kept where the quantity is a text."""
        if not isinstance(quantity, str):
            return self._closely(estimate)
        key = (quantity, *further)
        if key not in self._known:
            self._known[key] = self._closely(estimate)
        return self._known[key]

    def _closely(self, estimate: Callable[[], Estimate | None]) -> Estimate | None:
        """An estimate; where it is above the accuracy, or not far below it in a run that leaves vibrations out or meets kinks of
        laws, as its companions do, again with the closer run."""
        found, near = estimate(), FAR if self._leaves_out or self.solution.stats.retaken else 1.0
        if found is None or self.asked is None or self.closer is None or not found.beyond(self.asked * near):
            return found
        make, self.closer = self.closer, None
        if (other := make()) is None:
            return found
        self.others = *self.others, other
        return estimate()

    def _estimated(self, result: Any, quantity: Quantity, part: Callable[..., float] | None = None,
                   size: float | None = None) -> Estimate | None:
        """From the differences over time: the largest of the run, with np.max that between the first and the last of the result's
        times, else what `part` makes of times and values of both runs there, relative to `size` (default: the largest value)."""
        unit, found, known, others = unit_of(result, quantity), [], size or 0.0, self._shown
        asked, (first, last) = self.asked or 0.0, (-np.inf, np.inf) if part is None else result.t[[0, -1]]
        alone = sum(other.kind == "companion" for other in others) == 1  # of two the differences are taken together
        try:
            for other in others:
                both = self._both(other, result)
                own, beside = (value(one, quantity) for one in both)
                if (at_time := absent(result, quantity, [(other.times, one) for one in (own, beside)])) is not None:
                    self.endless.setdefault(named(quantity), at_time)
                    return None
                top = float(np.max(magnitudes(own), initial=0.0))
                known = max(known, top) if size is None else size
                at = other.between(first, last)
                if part is None or part is np.max:
                    least = asked * top / ((alone and other.share) or 1.0)
                    shown = differences(*both, quantity, unit, asked, other.ratio, least)
                    found.append((other, float(np.max(shown[at]))))
                else:
                    found.append((other, part(other, other.times[at], own[at], beside[at])))
        except UNREADABLE:
            return None
        size, limit = max(known, self._scale(result, quantity, unit)), ROUNDED * self._typical(unit)
        return Estimate(max(together(found), limit), size, limit, by_mesh(found)) if found else None

    def _estimated_peak(self, result: Any, quantity: Quantity, size: float, t: float) -> Estimate | None:
        """Of a peak counts how much another run's peak differs, and both runs at the times of both peaks; where all may leave out
        vibrations, and no closer run follows it, the error over time too, as a crest of them may meet it."""
        unit = unit_of(result, quantity)
        try:
            found = [(other, self._at_peak(result, quantity, size, t, other)) for other in self._shown]
        except UNREADABLE:
            return None
        over_time = self._estimated(result, quantity, np.max)
        if not found or over_time is None:
            return None
        followed = any(other.kind == "closer" and other.times[-1] >= t for other in self.others)
        error, mesh, limit = together(found), by_mesh(found), ROUNDED * self._typical(unit)
        if not followed:
            meeting = 1.0 if self._leaves_out else MEETING
            error, mesh = max(error, meeting * over_time.error), max(mesh, meeting * over_time.mesh)
        return Estimate(max(error, limit), max(size, self._scale(result, quantity, unit)), limit, mesh)

    def _at_peak(self, result: Any, quantity: Quantity, size: float, t: float, other: OtherRun) -> float:
        """The difference of another run that counts for the peak of this one."""
        begin, end = float(other.times[0]), float(other.times[-1])
        own, beside = self._both(other, result)
        if other.kind == "window" and not begin <= t <= end:
            asked = (other.times >= result.t[0]) & (other.times <= result.t[-1])
            return float(np.max(magnitudes(value(beside, quantity))[asked] - size, initial=0.0))
        first, last = max(begin, float(result.t[0])), min(end, float(result.t[-1]))
        if first > last:
            return 0.0
        last = inside(first, last, self.solution)
        if sampled := isinstance(other.run.interpolant, AtTimes):
            within = (other.times >= first) & (other.times <= last)
            both = np.array([np.where(within, magnitudes(value(one, quantity)), 0.0) for one in (own, beside)])
            k, apart = int(np.argmax(both[1])), np.abs(both[1] - both[0])
            there, when = float(both[1, k]), float(other.times[k])
        else:
            there, when = largest(beside, quantity, first, last)
        if not first <= t <= last:
            return max(there - size, 0.0)
        if other.kind == "closer":
            return float(max(abs(there - np.max(both[0])), *apart[np.argmax(both, axis=1)])) if sampled else abs(there - size)
        if other.kind in ("window", "start"):
            near = np.abs(other.times - t) <= NEAR * (end - begin)
            apart = magnitudes(value(beside, quantity) - value(own, quantity))
            return max(there - size, float(np.max(apart[near], initial=0.0)))
        at = other.times[[int(np.argmin(np.abs(other.times - t)))]] if sampled else np.array([t])
        at = np.sort(np.r_[at, when])
        return max(abs(there - size), float(np.max(magnitudes(value(beside(at), quantity) - value(own(at), quantity)))))

    @property
    def _shown(self) -> list[OtherRun]:
        """The runs that count: where there is a closer one, it, those of FURTHER errors, and from its end on the others."""
        given = [other for other in self.others if len(other.times)]
        end = max((other.times[-1] for other in given if other.kind == "closer"), default=-np.inf)
        return [cut for other in given if len((cut := other if other.kind in ("closer", *FURTHER) else other.after(end)).times)]

    def _both(self, other: OtherRun, result: Any = None) -> tuple[Any, Any]:
        """The run and another one at the times of their comparison, to be read without telling anything. result: the run, read
        itself where it tells nothing and has these times."""
        key, kind = (id(other.run), len(other.times)), type(result) if result is not None else RunStates
        if not isinstance(self._views.get(key, (None,))[0], kind):
            runs = (self.prepared, self.solution), (other.prepared or self.prepared, other.run)
            own, beside = (type(result)(*run, None, other.times) if result is not None else RunStates(*run, other.times)
                           for run in runs)
            same = result is not None and result.info is None and np.array_equal(result.t, other.times)
            self._views[key] = (result if same else own), beside
        return self._views[key]

    @cached_property
    def _views(self) -> dict[tuple[int, int], tuple[Any, Any]]:
        return {}

    def _scale(self, result: Any, quantity: Quantity, unit: str) -> float:
        """Least size of a quantity: motion is relative to length and characteristic time, as its accuracy is."""
        share = LEAST if quantity in self.wanted else 1.0 if moves(result, quantity) else IDLE if unit == "W" else LEAST
        return share * self._typical(unit)

    def _typical(self, unit: str) -> float:
        """What the scene has of a quantity of some unit; 0 where that is not known."""
        L, T = self.prepared.length, self.prepared.time
        motion = {"m": L, "rad": 1.0, "m/s": L / T, "rad/s": 1 / T, "m/s^2": L / T**2, "rad/s^2": 1 / T**2}
        F = 0.0 if unit in motion or not unit else self._largest_force
        return (motion | {"N": F, "N m": F * L, "N, N m": F, "W": F * L / T}).get(unit, 0.0)

    # -- telling

    def judge(self, result: Any, quantity: Quantity) -> None:
        """Tell where a quantity that was read is not within the accuracy; of the motion the run itself tells."""
        unit, name = unit_of(result, quantity), named(quantity)
        if self.asked is not None and name not in self.told and not self._covered(result, quantity, unit):
            self.tell(name, unit, self.of(result, quantity), self.asked)

    def judge_part(self, result: Any, quantity: Quantity, found: Estimate | None, read: str) -> float | None:
        """The error `found` of what was `read` of a quantity, as its "largest value"; told where it is above the accuracy."""
        if not result._silent and self.asked is not None and not self._covered(result, quantity, unit_of(result, quantity)):
            self.tell(named(quantity), unit_of(result, quantity), found, self.asked, read)
        return None if found is None else found.error

    def _covered(self, result: Any, quantity: Quantity, unit: str) -> bool:
        """Whether the accuracy of the motion speaks of a quantity: with elastic bodies it leaves velocities out."""
        return moves(result, quantity) and not (self.prepared.model.elastic and unit in ("m/s", "rad/s"))

    def tell(self, name: str, unit: str, found: Estimate | None, asked: float, read: str = "") -> None:
        """Warn once about a quantity whose error is above the accuracy asked; read: "" for its values over time, or what was read
        of them, of which nothing is said after the values, whose error contains it."""
        key = f"{name}, its {read}" if read else name
        if name in self.told or key in self.told or (found is not None and not found.beyond(asked)):
            return
        error = "an error that is not known"
        if found is not None and np.isfinite(found.error):
            share, of = f"{100 * found.error / found.size:.2g} % of ", f"{found.error:.2g}{f' {unit}' if unit else ''}"
            error = f"an error of about {of} in its {read}, {share}its largest value there" if read else (
                f"an error of about {of}, {share}its largest value")
        remedy = self._remedy(asked, found)
        if found is None and name in self.endless:
            remedy = f"it is infinite or no number at t = {self.endless[name]:.6g} s; read a quantity that is finite all along"
        self.told[key] = f"{name} has {error}, where the accuracy {asked:g} was asked: {remedy}"
        warn(f"scene '{self.prepared.model.scene.name}': {self.told[key]}")

    @property
    def _leaves_out(self) -> bool:  # whether the run may leave out vibrations
        return any(other.kind == "window" for other in self.others)

    def _remedy(self, asked: float, found: Estimate | None) -> str:
        """What lessens an error: what is against its larger part, that of the mesh or that in time, and against the other too
        where that alone is above the accuracy."""
        smaller, meshes = f"ask for accuracy={asked / 10:.0e}", found is not None and found.mesh > found.error / 2
        if found is not None and meshes:
            rest = found._replace(error=found.error - found.mesh).beyond(asked)
            smaller = f"{self.against_mesh}{f'; and {smaller}' if rest else ''}"
        elif self.remedy:
            return self.remedy
        elif found is not None and found._replace(error=found.mesh).beyond(asked):
            smaller = f"{smaller}; and {self.against_mesh}"
        if self.prepared.contacts:
            return f"a small shift of the time of an impact changes forces much; rely on peaks and averages, or {smaller}"
        if self._leaves_out and not meshes:
            if not self.prepared.model.elastic:
                return (f"the run leaves out fast vibrations of stiff springs, which hardly move anything and carry forces; name "
                        f"it in of=[...], with which steps follow them where that takes less than a second, or {smaller}")
            return (f"the run leaves out fast elastic vibrations, which hardly move them and carry forces; {smaller}, or take "
                    "form=mb.GGL(waves=True) with solver=mb.RadauIIA(3): it follows them all")
        return smaller


def by_mesh(found: Iterable[tuple[OtherRun, float]]) -> float:
    """The part of the error of a run that the one on a finer mesh shows."""
    return float(max((other.share * apart for other, apart in found if other.kind == "mesh"), default=0.0))


def together(found: Iterable[tuple[OtherRun, float]]) -> float:
    """The error of a run from its differences to others: those of one kind show the same error, of which the largest counts;
    errors of several kinds add."""
    differences = list(found)
    kinds: dict[str, float] = {}
    companions = [(other, apart) for other, apart in differences if other.kind == "companion"]
    if len(companions) == 2 and all(other.ratio > 1 for other, _ in companions):
        kinds["companion"] = fallen(*((apart, other.ratio) for other, apart in companions))
        differences = [(other, apart) for other, apart in differences if other.kind != "companion"]
    for other, apart in differences:
        kinds[other.kind] = max(kinds.get(other.kind, 0.0), other.share * apart)
    closer, further = kinds.pop("closer", 0.0), sum(kinds.pop(kind, 0.0) for kind in FURTHER)
    return float(max(closer, sum(kinds.values())) + further)  # beside a closer run the others count after its end alone
