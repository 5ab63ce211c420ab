"""The roots of the linearised equations at states of a run, with frozen coefficients: which disturbances grow, and which of them
are too small to be seen by the error test of a solver; and whether what decays held the steps short. The Python side of
native/growth.c."""

from __future__ import annotations

import ctypes
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import distinct, median
from mbdae.errors import WallClockError
from mbdae.integrators.base import Solver
from mbdae.integrators.solution import Solution, systems_at
from mbdae.native import address, declared
from mbdae.native.equations import Number, Pointer, Whole
from mbdae.native.sparse import SingularMatrixError
from mbdae.run.amplification import SMALL, entries_of, in_pattern, kept, matrix_of, spread
from mbdae.system.base import Array, System

#: growth (natural logarithm of the factor) over the whole run below which steps are not bounded: a disturbance below a third of
#: the accuracy does not reach three times the accuracy by it
HARMLESS = 2.0
#: the steps follow what varies visibly, and that shakes vibrations of up to EXCITED / step (1/s) into growth: those of half its
#: frequency most, and of few multiples of that. Measured: a cantilever of which the stiffest vibration, 2300 / step, was followed
#: took 57 662 steps where 12 do
EXCITED = 10.0
#: largest number of unknowns for which all roots are computed; above SMALL only where `rising` of growth.c finds that something
#: grows: with fewer, too, that would miss what vibrates within a step and grows slowly (van der Pol's oscillator beside others)
MOST = 300
#: roots are found best near SHIFT over the step; those beyond RESOLVED times that are left out: constraints have infinite roots,
#: which are inexact in a computer
SHIFT, RESOLVED = 3.0, 1e3
BEYOND = 1e-4  #: factor on the step with which growth among those is sought, at the first and the last look
CLOSED = 2  #: eigenvalues of matrices up to this size are computed by growth.c
#: number of multiplications by which growth is sought among many roots, and the ratio by which it then shows from their middle to
#: their end: the largest that vibrations alone gave was 1.1. What moves freely grows by 2 there, as a number proportional to the
#: time does, and by 2 again in as many multiplications more as there were; what grows at a rate does by the square of the ratio
ROUNDS, GROWS, FASTER = 20, 1.5, 1.5


class Looks(NamedTuple):
    """States of a run at which roots are sought: the equations (k,) there, times (k,), s, y and y' (k, n), steps of the run (k,),
    s, and the length of the run (s)."""

    systems: list[System]
    t: Array
    y: Array
    yp: Array
    h: Array
    span: float

    @classmethod
    def of(cls, system: System, run: Solution, t: Array) -> Looks:
        """Looks at times t (k,), s, of a run, in increasing order."""
        step = np.clip(run.t.searchsorted(t, side="right") - 1, 0, len(run.t) - 2)
        return cls(systems_at(run, t, system), t, run(t), run.derivative(t), np.diff(run.t)[step], float(run.t[-1] - run.t[0]))


class GrowthFound(NamedTuple):
    """What a look finds. rate: the largest real part of a root, 1/s; unseen: the largest magnitude (1/s) of one that grows and
    whose disturbance is not seen, 0: there is none; parts (positions, k), roots (k,): these disturbances in the motion, over the
    scales of the positions, and their roots."""

    rate: float = 0.0
    unseen: float = 0.0
    parts: NDArray[np.complex128] = np.zeros((0, 0), complex)
    roots: NDArray[np.complex128] = np.zeros(0, complex)

    @property
    def size(self) -> float:
        """Size of all disturbances together, over the scales of the positions."""
        return float(np.max(np.abs(np.sum(self.parts, axis=1)), initial=0.0))

    def after(self, time: float, faster: float) -> float:
        """Their size after a time (s), with the roots times `faster`; beyond e^600, which is more than any motion, it is that."""
        powers = self.roots * (time * faster)
        return float(np.max(np.abs(self.parts @ np.exp(np.minimum(powers.real, 600.0) + 1j * powers.imag)), initial=0.0))


class LooksTable(ctypes.Structure):
    """The C struct `Looks` of growth.c, with the same members in the same order."""

    _fields_ = (("matrix", Pointer), *((name, Whole) for name in ("looks", "n", "most", "places", "many", "dense", "rounds")),
                *((name, Number) for name in ("shift", "resolved", "grows", "faster")),
                *((name, Pointer) for name in ("first", "place", "h", "motion", "fy", "fyp", "core", "moved", "unknowns", "kind",
                                               "taken", "solved", "H", "beta", "value", "root", "rate", "room", "rises")))


#: function that opens the library and states the types of the functions of growth.c for ctypes
growth = declared(
    ("growth_spectra", Whole, (Pointer, Whole, Whole)),
    ("growth_rates", None, (Pointer,)),
    ("growth_unseen", None, (Pointer, Whole, *[Number] * 4, *[Pointer] * 4)),
)


class Reader:
    """What finding roots of a system needs at all states alike: the iteration matrix of its linearised equations."""

    def __init__(self, system: System, equations: Any) -> None:
        self.entries, self.matrix = entries_of(equations), matrix_of(system, equations, np.ones(1), np.zeros(0, complex))
        self.many, self.dense = system.n > SMALL, system.n <= MOST
        self.place = np.flatnonzero(positions(system))
        self.first_at, self.place_at = address(self.entries.indptr), address(self.place)


def positions(system: System) -> NDArray[np.bool_]:
    """Which unknowns are positions, or, where none are, are differential."""
    kinds = np.array(system.kinds)
    return kinds == "q" if np.any(kinds == "q") else ~np.isin(kinds, ("lambda", "mu", "z"))


class Spectrum:
    """The roots at states (k,) of one system."""

    def __init__(self, looks: Looks) -> None:
        system, k = looks.systems[0], len(looks.t)
        equations, *parts = system.linear_stages(looks.t, looks.y, looks.yp)
        self.looks, self.by = looks, kept(system, "roots", partial(Reader, system, equations))
        values = in_pattern(parts, k, self.by.entries)
        by, entries, most = self.by, self.by.entries, system.n if self.by.dense else 1
        n, places = entries.n, len(by.place)
        motion = np.zeros((k, n))
        motion[:, : system.n] = looks.yp / system.scale
        room = max(n * most, 6 * n, 8 * n + 4 * most * (n + most) + 2 * most)
        whole, self.rate = np.empty((3 + n) * k + 2 * n, dtype=np.int64), np.empty(k)
        sizes = (k * n * most, k * most * most, k * most, 2 * k * most, room) if by.dense else (0, 0, 0, 0, room)
        numbers, self.values = np.empty(sum(sizes)), np.empty((k, most), complex)
        self._kept = motion, values, whole, numbers, np.ascontiguousarray(looks.h)
        core = address(whole)
        moved, rises, unknowns = core + 8 * k, core + 16 * k, core + 24 * k
        at = [address(numbers)]
        for size in sizes:
            at.append(at[-1] + 8 * size)
        self.table = LooksTable(
            by.matrix.address, k, n, most, places, by.many, by.dense, ROUNDS, SHIFT, RESOLVED, GROWS, FASTER,
            by.first_at, by.place_at, address(self._kept[-1]), address(motion), address(values[0]),
            address(values[1]), core, moved, unknowns, unknowns + 8 * k * n, unknowns + 8 * (k + 1) * n, *at[:3],
            address(self.values), at[3], address(self.rate), at[4], rises)
        system.owner.waiting(self._reduce)  # other threads share the matrix
        if by.dense:
            cores = numbers[sizes[0] : sizes[0] + k * most * most].reshape(k, -1)
            for c, these in _alike(whole[:k].tolist()):
                if c > CLOSED:
                    self.values[these, :c] = np.linalg.eigvals(cores[these, : c * c].reshape(-1, c, c))
            growth().growth_rates(ctypes.addressof(self.table))

    def _reduce(self) -> None:
        """Find the matrices whose eigenvalues belong to the roots."""
        matrix, spectra, here = self.by.matrix, growth().growth_spectra, ctypes.addressof(self.table)
        at = spectra(here, 0, False)
        while at < self.table.looks:
            try:
                matrix.renewed(0, float(self.looks.h[at] / SHIFT))
                at = spectra(here, at, True)
            except SingularMatrixError:
                at = spectra(here, at + 1, False)

    def unseen(self, idle: bool, seen: float) -> list[GrowthFound]:
        """What is found at every state; seen: size of a disturbance that is seen, over the scales of the positions; idle: of
        disturbances that neither grow nor decay, else of those that grow."""
        rates, k, span = self.rate.tolist(), self.table.looks, self.looks.span
        if not self.by.dense:
            return [GrowthFound(rate, rate * (not idle)) for rate in rates]
        if not idle and max(rates) * span <= HARMLESS:
            return [GrowthFound(rate) for rate in rates]
        places, most = self.table.places, self.table.most
        magnitude, count = np.empty(k), np.empty(k, dtype=np.int64)
        roots, parts = np.empty((k, most), complex), np.empty((k, most, places), complex)
        growth().growth_unseen(ctypes.addressof(self.table), idle, span, HARMLESS, EXCITED, seen,
                               *map(address, (magnitude, count, roots, parts)))
        found = [GrowthFound(rate) for rate in rates]
        for i in np.flatnonzero(count).tolist():
            found[i] = GrowthFound(rates[i], float(magnitude[i]), parts[i, : count[i]].T, roots[i, : count[i]])
        return found


def _alike(sizes: list[int]) -> list[tuple[int, Any]]:
    """The different sizes, each with the places that it has in the list."""
    if len(set(sizes)) == 1:
        return [(sizes[0], slice(None))]
    return [(size, [i for i, one in enumerate(sizes) if one == size]) for size in set(sizes)]


class Spectra(NamedTuple):
    """The roots at the states of looks: one Spectrum for every system, with the numbers of its looks."""

    looks: Looks
    parts: list[tuple[list[int], Spectrum]]

    @property
    def rates(self) -> Array:
        """The largest real part of a root at every state (k,), 1/s, at least 0."""
        if len(self.parts) == 1:
            return self.parts[0][1].rate
        found = np.zeros(len(self.looks.t))
        for these, spectrum in self.parts:
            found[these] = spectrum.rate
        return found

    def found(self, seen: float) -> list[GrowthFound]:
        """What is found at every state of disturbances that grow; seen: size of a disturbance that is seen, over the scales of
        the positions."""
        return self._unseen(False, seen)

    def idle(self, seen: float) -> list[GrowthFound]:
        """Of disturbances that neither grow nor decay with frozen coefficients, and that the equations may shake into growth as
        they vary, what `found` finds of growing ones."""
        return self._unseen(True, seen)

    def _unseen(self, idle: bool, seen: float) -> list[GrowthFound]:
        if len(self.parts) == 1:
            return self.parts[0][1].unseen(idle, seen)
        found = [GrowthFound()] * len(self.looks.t)
        for these, spectrum in self.parts:
            for i, one in zip(these, spectrum.unseen(idle, seen), strict=True):
                found[i] = one
        return found


def roots_at(looks: Looks) -> Spectra:
    """The roots at some states of a run."""
    systems = list(dict.fromkeys(looks.systems))
    if len(systems) == 1:
        return Spectra(looks, [(list(range(len(looks.t))), Spectrum(looks))])
    found = []
    for system in systems:
        these = [i for i, one in enumerate(looks.systems) if one is system]
        t, y, yp, h = (part[these] for part in (looks.t, looks.y, looks.yp, looks.h))
        found.append((these, Spectrum(Looks([system] * len(these), t, y, yp, h, looks.span))))
    return Spectra(looks, found)


def growing_beyond(looks: Looks, found: list[GrowthFound], seen: float) -> None:
    """Put into what is `found` at looks, at the first and the last of them, what grows faster than `roots_at` looks for: a step
    that is very long beside growth takes it for rest."""
    ends = sorted({0, len(looks.t) - 1}) if looks.systems[0].n <= MOST else []
    t, y, yp, h = (part[ends] for part in looks[1:5])
    closely = Looks([looks.systems[i] for i in ends], t, y, yp, h * BEYOND, looks.span)
    for i, one in zip(ends, roots_at(closely).found(seen) if ends else [], strict=True):
        if one.unseen > RESOLVED * SHIFT / looks.h[i]:
            found[i] = one


#: numbers of times spread over a run, and not over its steps, at which the residual of unknowns displaced by DISPLACED of their
#: scales is evaluated. Suspect are at most SUSPECTS of them: those at which the residual of an equation is beyond its USUAL
#: quantiles by more than STANDS_OUT times their distance and what a disturbance that grows by HARMLESS over the run adds; the
#: largest of every equation in each of some parts of the run counts, whose middles are STRETCHES of its length
PROBES, DISPLACED, SUSPECTS, USUAL, STANDS_OUT = 128, 1e-3, 6, (0.1, 0.9), 2.0
STRETCHES = (np.arange(8) + 0.5) / 8
#: fractions of the time of a run, or between two looks, at which equations are compared with those at its begin or at the looks
BETWEEN = (0.17, 0.37, 0.59, 0.71, 0.88)
CHANGED = 1e-6  #: equations vary with the time where what displaced unknowns change in them differs by this part


def evenly(system: System, run: Solution, count: int) -> Array:
    """Times (s) spread over a run, and as many in steps, where switches shorten these."""
    times: Array = run.t[0] + (run.t[-1] - run.t[0]) * (np.arange(count) + 0.5) / count
    if system.switches is None:
        return times
    steps = distinct(np.linspace(0, len(run.t) - 2, count).astype(int))
    return distinct(np.append(times, (run.t[steps] + run.t[steps + 1]) / 2))


def displaced(system: System, t: Array, y: Array, yp: Array, span: float = np.inf, size: float = DISPLACED) -> Array | None:
    """The residual (k, n) at times t (k,), s, of unknowns y (k, n) displaced by `size` of their scales, each by another share,
    and of yp (k, n) displaced by as much in the time `span` (s); None where a function of the user does not take them."""
    shift, out = size * system.scale * (1 + spread((1, system.n))[0] / 2), np.empty(y.shape)
    try:
        system.residual_stages(t, y + shift, yp + shift / span, out)
    except WallClockError:
        raise
    except Exception:
        return None
    return out


def suspects(system: System, run: Solution) -> Array:
    """Times (s) at which the residual of slightly displaced unknowns stands out of what it is elsewhere in a run, a few for all
    equations together: where the linearised equations are others for a short time, it does. One evaluation tells at a time, and
    not as many as there are unknowns."""
    t, span = evenly(system, run, PROBES), float(run.t[-1] - run.t[0])
    y, yp, some = run(t), run.derivative(t), (STRETCHES * len(t)).astype(int)
    found, moving = displaced(system, t, y, yp), displaced(system, t[some], y[some], yp[some], span)
    if found is None or moving is None:
        return t
    low, high = np.quantile(found, USUAL, axis=0)
    usual = high - low + HARMLESS * np.max(np.abs(moving - found[some]), axis=0)
    out = np.maximum(found - high, low - found) / np.where(usual > 0, usual, np.inf)
    tops = [(float(top), float(t[part[i]])) for part in np.array_split(np.arange(len(t)), len(STRETCHES))
            for i, top in zip(np.argmax(out[part], axis=0).tolist(), np.max(out[part], axis=0).tolist(), strict=True)]
    return distinct([time for top, time in sorted(tops)[-SUSPECTS:] if top > STANDS_OUT])


def varies(system: System, run: Solution) -> bool:
    """Whether the equations vary with the time within a run, so that disturbances may grow that no frozen equation shows. Of a
    System that does not know its inputs, what displaced unknowns change is compared at one state and several times."""
    t0, t1 = float(run.t[0]), float(run.t[-1])
    if system.timeline is not None:
        return system.timeline(t0, t1) is not None
    t = t0 + (t1 - t0) * np.array([0.0, *BETWEEN])
    y, yp = (np.tile(part[0], (len(t), 1)) for part in (run.y, run.yp))
    moved, there = displaced(system, t, y, yp, t1 - t0), displaced(system, t, y, yp, size=0.0)
    if moved is None or there is None:
        return True
    changes = moved - there
    return bool(np.max(np.ptp(changes, axis=0)) > CHANGED * np.max(np.abs(changes)))


def rates_at(system: System, run: Solution, t: Array, seen: float) -> tuple[Array, Array]:
    """At times t (k,), s, of a run the largest real parts (k,) of roots, and the largest magnitudes (k,) of those whose
    disturbances grow and are smaller than `seen`, over the scales of the positions, 1/s; 0 where functions fail between the
    steps."""
    try:
        spectra = roots_at(Looks.of(system, run, t))
    except WallClockError:
        raise
    except Exception:  # of the user, at a state that the run only interpolates
        return np.zeros(len(t)), np.zeros(len(t))
    return spectra.rates, np.array([one.unseen for one in spectra.found(seen)])


#: HELD: decay within a step (rate times step, median over some steps of the run) from which on stability and not the error test
#: held the steps, where MANY_STEPS or more were made. Measured with CVODE (Adams) and DOP853 at 1e-3 to 1e-9: 4.5 to 150 on
#: Robertson's reaction, HIRES, the Oregonator and a decay at 1e4 1/s; at most 1.9 where the decay is not faster than ten times
#: what drives it
HELD, MANY_STEPS, SOME, LARGE_MATRIX = 3.0, 1000, 8, 100


def held_by_stability(solver: Solver, solution: Solution) -> str:
    """The hint that a method for equations that are not stiff was stepped through stiff ones; "" where it was not."""
    if solver.highest_index or solver.bdf_order or solution.stats.steps < MANY_STEPS or not solution.systems:
        return ""
    at = solution.t[np.linspace(0, len(solution.t) - 1, SOME + 1).astype(int)[1:] - 1]
    h, decays = solution.t[np.searchsorted(solution.t, at) + 1] - at, []
    for system, t, y, yp in zip(systems_at(solution, at, solution.systems[0][1]), at, solution(at), solution.derivative(at),
                                strict=True):
        if system.n > LARGE_MATRIX or system.guards is not None or system.sampled is not None:
            return ""
        A, E = system.dense_parts(float(t), y, yp)
        rates = np.linalg.eigvals(-np.linalg.solve(E, A))
        decays.append(float(np.max(-rates.real, where=np.abs(rates.real) > np.abs(rates.imag), initial=0.0)))
    if not median(h * decays) > HELD:
        return ""
    return (f"the equations are stiff: what decays within a fraction of a step held the {solution.stats.steps} steps of "
            f"{solver.label} short, and not its error; mb.RadauIIA(3), or mb.CVODE(method='BDF'), takes far fewer")
