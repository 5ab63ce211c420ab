"""Steps around what switches or is local in the equations: nothing that a law does within a width is stepped over.

An argument u of a steep function is stretched to PHI(u), whose change by one means about one width of the function: flat where
the function is flat, the logarithm of a power. A step over which PHI varies by more than `LIMIT` is taken back; one that crosses a
kink ends there. Arguments are looked at on the polynomial of the step. Nothing of this exists where a system has no switches.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any, NamedTuple

import numpy as np

from mbdae.integrators.solution import Stats
from mbdae.system.base import Array, System

#: largest variation of PHI over a step that is kept, over the next step as its rate tells it, and over a step taken anew
LIMIT, REACH, AGAIN = 2.5, 1.0, 1.25
#: beyond these arguments a function is flat: exp(-25) = 1e-11; sinh and exp grow up to e^40
FLAT, STEEP, SATURATED = 25.0, 40.0, 9.0
#: powers are followed between these logarithms of their base
LOGARITHMS = (-90.0, 40.0)
#: steps taken back at one place before what is found is taken as it is
RETRIES = 10
#: part of a step at its end within which the only kink counts as met, and at its start the kink the step before was to end at
MET = 1e-2
#: an extremum nearer to a kink than this part of the argument's change over the step may cross it
MARGIN = 1e-2
#: an extremum between two points may be beyond the nearest of them by this part of the difference of its neighbours
BEYOND = 0.5
#: change of PHI that makes an extremum worth a search
MATTERS = 0.25
#: changes of an argument below so many times what the tolerance means for it are none
NOISE = 3.0
#: a step shorter than ROUND times the time is none
ROUND = 1e3 * float(np.finfo(float).eps)
TINY = 1e-9  #: shortest part of a step that is worth a step of its own
SECTIONS, ROUNDS = 9, 14  #: points of one round of a search in an interval, most rounds

STRETCHES: dict[str, Callable[[Any], Any]] = {
    "kink": lambda u: 0.0 * u,
    "decaying": lambda u: np.clip(u, -FLAT, STEEP),
    "saturating": lambda u: np.clip(u, -SATURATED, SATURATED),
    "growing": lambda u: np.clip(u, -STEEP, STEEP),
    "arc": np.arcsinh,
    "periodic": lambda u: u,
    "power": lambda u: np.clip(np.log(np.maximum(np.abs(u), 1e-300)), *LOGARITHMS),
}

Inside = Callable[[Array], Array]  #: y (k, n) on the polynomial of a step after parts (k,) of it


def _nodes(count: int) -> Array:
    """Chebyshev's points of [0, 1], both ends included."""
    return np.asarray(0.5 * (1 - np.cos(np.pi * np.arange(count) / (count - 1))))


def _interpolation(nodes: Array, at: Array) -> Array:
    """(k, nodes) weights of the values at nodes in those of their polynomial at points (k,)."""
    V = np.polynomial.chebyshev.chebvander
    return np.asarray(np.linalg.solve(V(2 * nodes - 1, len(nodes) - 1).T, V(2 * at - 1, len(nodes) - 1).T).T)


NODES, FINE = _nodes(8), np.linspace(0.0, 1.0, 33)
TO_FINE = _interpolation(NODES, FINE)
#: weights of the slope at the end: exact for polynomials of degree 7
TO_SLOPE = (_interpolation(NODES, np.array([1.0])) - _interpolation(NODES, np.array([1.0 - 1e-6])))[0] * 1e6
SMALL = 1e-3  #: part of the step over which the rate of PHI is taken


class Course(NamedTuple):
    """One argument over a step: parts of it (m,) and values (m,), monotone between them; the extremum nearest to a kink."""

    s: Array
    u: Array


class SwitchingSteps:
    """The switches of one run: how far the next step may go, and where the step just made should have ended."""

    def __init__(self, system: System, stats: Stats, tolerance: Callable[[Array], Array]) -> None:
        """tolerance: y (n,) -> what the solver leaves undecided of every unknown (n,)."""
        assert system.switches is not None
        self.switches, self.stats, self.tolerance = system.switches, stats, tolerance
        kinds = np.array(self.switches.kinds)
        self._by_kind = [(STRETCHES[kind], np.flatnonzero(kinds == kind)) for kind in dict.fromkeys(kinds.tolist())]
        self._kinks, self._weights = kinds == "kink", np.asarray(self.switches.weights, dtype=float)
        self._near = np.isin(kinds, ("kink", "power"))
        self._retries, self._bound, self._crossed = 0, inf, False
        self._goal = self._reached = -1  # kink at which the step is to end, and the one before did

    def _stretched(self, U: Array) -> Array:
        """PHI (k, na) of arguments (k, na)."""
        out = np.empty_like(U)
        for stretch, columns in self._by_kind:
            out[:, columns] = stretch(U[:, columns])
        return out * self._weights

    def _stretch(self, i: int, u: Any) -> Any:
        return STRETCHES[self.switches.kinds[i]](u) * self._weights[i]

    def bound(self) -> float:
        """Largest step from the last accepted point, s."""
        return self._bound

    def look(self, t: float, h: float, inside: Inside) -> None:
        """Take a step of h from t that was just made."""
        self._t, self._h, self._inside = t, h, inside
        self._U = self._arguments(NODES)
        self._F = TO_FINE @ self._U
        self._V = np.abs(np.diff(self._stretched(self._F), axis=0)).sum(axis=0)

    def _arguments(self, parts: Array) -> Array:
        return self.switches.arguments(self._t + parts * self._h, self._inside(parts))

    def shorter(self) -> float | None:
        """Width (s) the step should have had; None: keep it."""
        found = self._found()
        if found is None:
            return None
        part, i, surely = found
        self._goal = i if self._kinks[i] else -1
        if self._retries >= RETRIES or part * self._h <= ROUND * abs(self._t):
            if surely:
                self._count(i, part)
            return None
        self._retries += 1
        self.stats.retaken += 1
        return part * self._h

    def keep(self) -> None:
        """The step is accepted: how far may the next one go?"""
        self._retries, self._reached, self._goal = 0, self._goal, -1
        slope, end = TO_SLOPE @ self._U, self._U[-1]
        ahead, back = self._stretched(np.array([end + SMALL * slope, end - SMALL * slope]))
        rate = float(np.max(np.abs(ahead - back))) / (2 * SMALL * self._h)
        self._bound = REACH / rate if rate > 0 else inf
        self._crossed = bool(np.any((self._U[0] < 0) != (self._U[-1] < 0), where=self._kinks))

    def count_hidden(self) -> None:
        """Count what came and went inside a constant step."""
        found = self._found(both=True)
        if found is not None and found[2]:
            self._count(found[1], found[0])

    def crossed(self) -> bool:
        """Whether the last accepted step ended beyond a kink before which it began: the Jacobian in use is of the other side."""
        return self._crossed

    def _count(self, i: int, part: float) -> None:
        name = self.switches.names[i]
        self.stats.unresolved[name] = self.stats.unresolved.get(name, 0) + 1
        wanted = part * self._h
        self.stats.resolving_step = min(wanted, self.stats.resolving_step or wanted)

    # -- what a step hides

    def _found(self, both: bool = False) -> tuple[float, int, bool] | None:
        """First part of the step after which it should end, the argument that asks for it, and whether it surely hides something.

        both: only what comes and goes, not kinks that are crossed once.
        """
        asked = (self._V > LIMIT) | self._suspects()
        if not asked.any():
            return None
        scales = [(i, self._scale(i)) for i in np.flatnonzero(asked & ~self._kinks).tolist()]
        found = [(place[0], i, place[1]) for i, place in scales if place is not None]
        kinks = [(part, i, how) for i in np.flatnonzero(asked & self._kinks).tolist() for part, how in self._crossings(i)]
        crossed = [part for part, _, how in kinks if how]
        if len(crossed) == 1 and (both or crossed[0] > 1 - MET):
            kinks = [kink for kink in kinks if not kink[2]]
        if both:
            kinks = [kink for kink in kinks if kink[2]]
        return min(found + [(part, i, len(crossed) > 1) for part, i, _ in kinks], default=None)

    def _suspects(self) -> Any:
        """(na,) whether an argument crosses a kink, or has an extremum that may matter."""
        F = self._F
        negative = F < 0
        crosses = self._kinks & np.any(negative[1:] != negative[:-1], axis=0)
        rise = np.diff(F, axis=0)
        turns = rise[:-1] * rise[1:] < 0
        if not turns.any():
            return crosses
        middle, height = F[1:-1], np.maximum(np.abs(rise[:-1]), np.abs(rise[1:]))
        farther = middle + BEYOND * height * np.sign(rise[:-1])
        reach = np.abs(self._stretched(farther) - self._stretched(middle)) > MATTERS
        margin = MARGIN * np.ptp(F, axis=0)
        reach |= self._near & (((farther < 0) != (middle < 0)) | (self._kinks & (np.abs(middle) < margin)))
        return crosses | np.any(turns & reach, axis=0)

    def _course(self, i: int) -> Course:
        """Argument i at the fine points and its extrema between them."""
        u = self._F[:, i]
        s, values = list(FINE), list(u)
        rise = np.diff(u)
        for j in reversed(np.flatnonzero(rise[:-1] * rise[1:] < 0) + 1):
            part, value = self._extremum(i, FINE[j - 1], FINE[j + 1], 1.0 if rise[j - 1] > 0 else -1.0)
            if part != FINE[j]:
                at = j if part < FINE[j] else j + 1
                s.insert(at, part)
                values.insert(at, value)
        return Course(np.array(s), np.array(values))

    def _extremum(self, i: int, a: float, b: float, sign: float) -> tuple[float, float]:
        """Part and value of the largest (sign 1) or smallest (-1) argument in an interval."""
        part, value = 0.5 * (a + b), 0.0
        for _ in range(ROUNDS):
            s = np.linspace(a, b, SECTIONS)
            u = self._arguments(s)[:, i]
            best = int(np.argmax(sign * u))
            part, value = float(s[best]), float(u[best])
            a, b = float(s[max(best - 1, 0)]), float(s[min(best + 1, SECTIONS - 1)])
            change = np.ptp(u[max(best - 1, 0) : best + 2])
            farther = value + sign * BEYOND * change
            if self._near[i] and (farther < 0) != (value < 0):
                continue
            if change <= MARGIN * abs(value) if self._kinks[i] else np.ptp(self._stretch(i, np.array([value, farther]))) < MATTERS:
                break
        return part, value

    def _scale(self, i: int) -> tuple[float, bool] | None:
        """Part of the step after which PHI of argument i has varied by AGAIN, where it varies by more than LIMIT."""
        s, u = self._course(i)
        if self.switches.kinds[i] == "power":
            s, u = self._with_zeros(i, s, u)
        change = np.abs(np.diff(self._stretch(i, u)))
        if not change.sum() > LIMIT:
            return None
        before = np.cumsum(change)
        k = int(np.searchsorted(before, AGAIN))
        left = AGAIN - (before[k] - change[k])
        start = self._stretch(i, u[k])
        part = self._section(i, float(s[k]), float(s[k + 1]), lambda v: np.abs(self._stretch(i, v) - start) > left)[1]
        return part, bool(self._noise(i) < 1)

    def _with_zeros(self, i: int, s: Array, u: Array) -> Course:
        """With the places where argument i vanishes, whose logarithm falls towards them."""
        for k in reversed(np.flatnonzero((u[1:] < 0) != (u[:-1] < 0))):
            low = self._section(i, float(s[k]), float(s[k + 1]), lambda v, first=u[k] < 0: (v < 0) != first)[0]
            s, u = np.insert(s, k + 1, low), np.insert(u, k + 1, 0.0)
        return Course(s, u)

    def _crossings(self, i: int) -> list[tuple[float, bool]]:
        """Parts of the step after which argument i crosses 0 (True), or turns so near to it that it may (False)."""
        s, u = self._course(i)
        if np.max(np.abs(u)) < NOISE * self._noise(i, False):
            return []
        found = []
        for k in np.flatnonzero((u[1:] < 0) != (u[:-1] < 0)):
            part = self._section(i, float(s[k]), float(s[k + 1]), lambda v, first=u[k] < 0: (v < 0) != first)[0]
            found.append((max(part, TINY), True))
        if found and self._reached == i and found[0][0] < MET:
            del found[0]
        if not found and (u[0] < 0) == (u[-1] < 0):
            rise = np.diff(u)
            turns = np.flatnonzero(rise[:-1] * rise[1:] < 0) + 1
            found = [(float(s[j]), False) for j in turns
                     if MET < s[j] < 1 - MET and rise[j - 1] * u[j] < 0 and abs(u[j]) < MARGIN * np.ptp(u)]  # fmt: skip
        return found

    def _section(self, i: int, a: float, b: float, beyond: Callable[[Any], Any]) -> tuple[float, float]:
        """The interval in which an argument first goes beyond something."""
        for _ in range(ROUNDS // 2):
            s = np.linspace(a, b, SECTIONS)
            over = np.flatnonzero(beyond(self._arguments(s)[:, i]))
            first = int(over[0]) if len(over) else SECTIONS - 1
            a, b = float(s[max(first - 1, 0)]), float(s[first])
            if b - a < 1e-3 * b:
                break
        return a, b

    def _noise(self, i: int, stretched: bool = True) -> float:
        """How far the tolerance of the solver moves argument i, or PHI of it, at the end of the step."""
        y = self._inside(np.ones(1))[0]
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (4, len(y)))
        t = np.full(5, self._t + self._h)
        u = self.switches.arguments(t, np.vstack([y, y + signs * self.tolerance(y)]))[:, i]
        return float(np.max(np.abs(np.diff(self._stretch(i, u) if stretched else u, axis=0))))
