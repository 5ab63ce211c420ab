"""The result of an integration.

The distance of two runs, and the times at which runs are compared.

Runs that reject most of their steps say so.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from mbdae.deferred import distinct
from mbdae.errors import ListsAttributes, OptionError, warn
from mbdae.process import unchanging
from mbdae.system.base import Array, System
from mbdae.threads import check
from mbdae.values import array, option, shown


@dataclass
class Stats:
    """Work done by one integration.

    IDA and CVODE count failed Newton iterations among their `rejected` steps. CVODE factorises
    an old Jacobian again when its step changes and does not report that: its `factorisations` count new Jacobians only.
    Evaluations of a right-hand side count as `residuals`.
    h_min and h_max in s, over accepted steps, the last one (cut to the end) left out.
    shortened: number of shorter steps of a run with constant steps, where an input of time has a break or varies too fast.
    Where a system has contacts: contacts made, as seen at accepted steps; dips: steps repeated because they may hide a
    contact; missed_dips: contacts that closed and opened inside an accepted step; shortest_contact: fewest accepted steps that
    ended inside one complete contact (0: there was none).
    Where laws have kinks or narrow peaks: retaken: steps repeated because they passed over one; unresolved: by item, accepted
    steps that passed over one all the same; resolving_step: longest step (s) that would not have (0: none did).
    """

    steps: int = 0
    rejected: int = 0
    residuals: int = 0
    jacobians: int = 0
    factorisations: int = 0
    newton_iterations: int = 0
    newton_failures: int = 0
    cpu_s: float = 0.0
    wall_s: float = 0.0
    h_min: float = 0.0
    h_max: float = 0.0
    contacts: int = 0
    dips: int = 0
    missed_dips: int = 0
    shortest_contact: int = 0
    shortened: int = 0
    retaken: int = 0
    unresolved: dict[str, int] = field(default_factory=dict)
    resolving_step: float = 0.0


class Interpolant(Protocol):
    """Dense output: values between accepted steps."""

    def value(self, t: Array) -> Array:
        """y (k, n) at times (k,)."""

    def derivative(self, t: Array) -> Array:
        """dy/dt (k, n) at times (k,)."""


class Method(Protocol):
    """The interface of a solver that the loop of a run needs. (It cannot import `base.Solver`, whose module imports the loop.)"""

    @property
    def label(self) -> str:
        """Short name for messages."""

    @property
    def fixed(self) -> bool:
        """Whether its steps are constant."""

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """Interpolant over the accepted steps."""


@dataclass(frozen=True, eq=False)
class Outputs:
    """Values at the output times: t (k,), s, y (k, n), yp (k, n)."""

    t: Array
    y: Array
    yp: Array


@dataclass(frozen=True, eq=False)
class Solution(ListsAttributes):
    """Result of one integration.

    t (m+1,) start and accepted times; y, yp (m+1, n) unknowns and their derivatives there;
    outputs: values at the times asked for, or None; complete: False where it was stopped before its end.
    systems: (time, s, equations that were integrated from then on), in order; empty where that is not known.
    """

    t: Array
    y: Array
    yp: Array
    outputs: Outputs | None
    stats: Stats
    solver: Method
    names: tuple[str, ...]
    complete: bool
    interpolant: Interpolant
    systems: tuple[tuple[float, System], ...] = ()

    def __post_init__(self) -> None:
        for name in ("t", "y", "yp"):
            object.__setattr__(self, name, unchanging(np.asarray(getattr(self, name)).view()))

    def __getstate__(self) -> dict[str, Any]:
        """The state for a copy or pickle: everything but the equations (`systems`)."""
        return vars(self) | {"systems": ()}

    def __call__(self, t: float | Sequence[float] | Array) -> Array:
        """y at the time or times t, shape t.shape + (n,)."""
        return self._evaluate(t, self.interpolant.value)

    def derivative(self, t: float | Sequence[float] | Array) -> Array:
        """dy/dt at the time or times t, shape t.shape + (n,)."""
        return self._evaluate(t, self.interpolant.derivative)

    def times(self, t: Any) -> Array:
        """Times as an array; OptionError for a time outside the solution."""
        times: Array = option("t", t, array, "give a time in s, or an array of them")
        first, last = self.t[0], self.t[-1]
        slack = 4 * np.finfo(float).eps * max(abs(first), abs(last))
        outside = ~((times >= first - slack) & (times <= last + slack))
        if outside.any():
            value = times[outside].flat[0]
            raise OptionError(f"t = {shown(t)}: the time {value:.9g} s is outside the solution from {first:.9g} to {last:.9g} s; "
                              "ask for times inside it")
        return times

    def _evaluate(self, t: float | Sequence[float] | Array, function: Callable[[Array], Array]) -> Array:
        check("a run was evaluated at its outputs")
        times, first, last = self.times(t), self.t[0], self.t[-1]
        flat = function(np.clip(times.ravel(), first, last))
        return flat.reshape(*times.shape, flat.shape[-1])


def systems_at(run: Solution, t: Array, otherwise: System) -> list[System]:
    """The systems (k,) that were integrated at times t (k,) of a run; at the time of a change the later one. otherwise: the
    system of all steps where the run has no list of systems."""
    begins = np.array([begin for begin, _ in run.systems])
    if len(begins) < 2:
        return [otherwise] * len(t)
    return [run.systems[max(i, 0)][1] for i in np.searchsorted(begins, t, side="right") - 1]


BETWEEN = 3  #: number of points at which runs are compared between two neighbouring ends of steps of the coarser run
#: where the coarser run has more ends of steps than this, only every second, third, ... one of them is used for the comparison
MOST = 2000

Measure = Callable[[Array, Array, Array], Array]  #: times (nt,) and two trajectories (nt, n) -> their distance (nt,)


def scaled_distance(system: System, a: Array, b: Array, without: tuple[str, ...] = ("lambda", "mu")) -> Array:
    """(nt,) largest difference of an unknown of a and b (nt, n), relative to its scale; without: kinds of unknowns left out. Used
    for equations without a scene."""
    keep = np.array([kind not in without for kind in system.kinds])
    unit = np.maximum(system.scale, np.max(np.abs(b), axis=0))
    return np.asarray(np.max((np.abs(a - b) / unit)[:, keep], axis=1))


def check_times(coarse: Solution, outputs: Array | None = None) -> Array:
    """Times (s) at which a run is compared with the run `coarse`: outputs, ends of steps of `coarse`, and points inside its
    steps."""
    t = coarse.t
    if len(t) > MOST:
        t = np.append(t[:: len(t) // MOST + 1], t[-1])
    inner = (t[:-1, None] + np.diff(t)[:, None] * (np.arange(BETWEEN) + 0.5) / BETWEEN).ravel()
    asked = np.zeros(0) if outputs is None else outputs[outputs <= coarse.t[-1]]
    return distinct(np.concatenate([asked, t, inner]))


@dataclass(frozen=True, eq=False)
class Beside:
    """A run beside another one: a companion, a run of a second method, on a finer mesh, of a short window. Both are compared at
    `times` (k,) in a `measure`; the error of the other one counts as `margin` times their distance.

    better: whether this is the more accurate one of the two, to whose size the measure relates differences; ratio: its tolerance
    over that of the other one."""

    run: Solution
    times: Array
    measure: Measure
    margin: float = 1.0
    better: bool = False
    ratio: float = 1.0

    def distance(self, other: Solution) -> float:
        """Largest distance of the other run from this one."""
        a, b = (other, self.run) if self.better else (self.run, other)
        between = getattr(self.measure, "between", None)  # of two runs that are known between the times too
        found = self.measure(self.times, a(self.times), b(self.times)) if between is None else (
            between(self.times, a, b, self.ratio))
        return float(np.max(found))

    def error(self, other: Solution) -> float:
        """The error of the other run that the distance shows."""
        return self.margin * self.distance(other)


ALIKE = 0.02  #: two runs took the same steps where these end less than this part of the longest one apart


def in_the_same_steps(run: Solution, other: Solution) -> bool:
    """Whether two runs took the same steps, as where nothing but their growth from the first one bounds them: both then have the
    same error, which their difference does not show."""
    return len(run.t) == len(other.t) > 2 and bool(np.max(np.abs(run.t - other.t)[1:-1]) < ALIKE * np.max(np.diff(run.t)))


AT_REST = 1e-13  #: a run in which nothing changes by more, in the measure of its motion, shows nothing in other steps


def rests(run: Solution, measure: Measure) -> bool:
    """Whether nothing moves in a run."""
    return bool(np.max(measure(run.t, run.y, np.broadcast_to(run.y[0], run.y.shape))) < AT_REST)


SAMPLES = 200  #: largest number of steps whose speeds a comparison of motions relates to


def by_speeds(run: Solution, measure: Measure) -> Measure:
    """The measure with differences of velocities relative to the speeds of the whole `run`."""
    steps = run.t[:: len(run.t) // SAMPLES + 1]
    whole = run(steps)
    return lambda t, a, b: measure(np.r_[t, steps], np.concatenate([a, whole]), np.concatenate([b, whole]))


#: a run is said to reject too many steps where these are at least MANY times those accepted, and where FEW steps or more were
#: accepted. Measured: at most 0.51 times in the examples, with each of the default solver, IDA and Radau IIA, contacts included;
#: 0.87 times, at 20 times the cost, where IDA stays at short steps (transistor amplifier)
MANY, FEW = 0.75, 200


def rejecting(run: Solution) -> str:
    """The warning about a run that rejects most of its steps; "" where it does not. Steps that were repeated because of a contact
    or a kink do not count: that is how these are found; beside kinks error control repeats others, so that nothing is said."""
    stats = run.stats
    rejected = stats.rejected - stats.dips
    if stats.steps < FEW or rejected < MANY * stats.steps or stats.retaken:
        return ""
    return (f"{run.solver.label} rejected {rejected} attempts of steps and accepted {stats.steps}: it makes far shorter steps "
            "than the solution needs; see whether the Jacobian, the index and the scales of the unknowns are right, or take "
            "another solver")


def said(run: Solution) -> Solution:
    """The run itself, after the warning where it rejects most of its steps."""
    if text := rejecting(run):
        warn(text)
    return run
