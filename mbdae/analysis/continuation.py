"""Branches of states at rest and of periodic motions along a number of the scene, and where these turn, branch, lose stability.

A point is a start x and the number p, both over their scales, with R(x, p) = 0: the balance at rest, or the return after a
period. Newton's corrections are those of least norm (Moore and Penrose), so that a branch is followed around its folds. Between
two points an event is a change of sign of a function along the branch, which is located there by Brent's method.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.optimize import brentq

from mbdae.analysis.equilibrium import Equilibrium, equilibrium
from mbdae.analysis.followed import Along, Orbits, Place, Rests
from mbdae.analysis.multipliers import GAIN
from mbdae.analysis.periodic import Periodic
from mbdae.analysis.state import told
from mbdae.errors import MbdaeError, OptionError, SteadyError, naming_arguments, warn
from mbdae.run.verification import with_finer_beams
from mbdae.scene.scene import SceneData
from mbdae.scene.sensed import refuse_sampled
from mbdae.study.statements import stated_value
from mbdae.system.base import Array
from mbdae.threads import single_threaded
from mbdae.values import BadValueError, number, option, several, shown, text, whole

#: first, longest and shortest step along a branch, over the range of the number and the scale of the motion
FIRST, LONGEST, SHORTEST = 0.02, 0.1, 1e-7
BEND = 0.2  #: largest angle (rad) between the tangents at both ends of a step
#: corrections of a step, at most, and those up to which the next step is longer; residual below which a point is on the branch
CORRECTIONS, QUICK, CLOSE = 8, 3, 1e-10
LOOKS = 200  #: largest number of points between two, at which an event is sought
ROUNDED = 1e-14  #: rounding error of the number, relative
NEAR = 1e-7  #: distance from the end of the range, over it, that counts as none
KINDS = {"fold": "folds", "doubling": "doublings", "hopf": "hopf", "branching": "branchings"}
WHOLE = "the end of the range"
OF = "give a periodic motion (s.periodic), a state at rest (s.equilibrium), or None for the state at rest"


@dataclass(frozen=True)
class Located:
    """A place where a branch changes. kind: "fold", "doubling" (of the period), "hopf" (oscillations begin to grow; of a periodic
    motion, a second frequency), or "branching" (another branch crosses, as at a buckling load); value: of the number; error:
    estimate of its error, found again and with half the steps, without that of the mesh of beams; period (s), nan at rest;
    root: the multiplier, or the root in 1/s, that crosses."""

    kind: str
    value: float
    error: float
    period: float
    root: complex


class Branch:
    """Points of a branch in their order along it: `values` (k,) of the number, `periods` (k,) s (nan at rest), `stable` (k,)
    True, False or None where the errors leave it open, `roots`: multipliers, or roots in 1/s, of each. `folds`, `doublings`,
    `hopf` and `branchings` are lists of `Located`. `ends`: why the branch ends on either side."""

    _finer: Callable[[], Branch] | None = None
    _plane = ""  #: what a print says of a planar scene

    def __init__(self, name: str, places: list[Place], located: list[Located], ends: tuple[str, str]) -> None:
        self.name, self._places, self.located, self.ends = name, places, located, ends
        self.values = np.array([place.p for place in places])
        self.periods = np.array([place.period for place in places])
        self.stable = [place.stable for place in places]
        self.roots = [place.roots for place in places]

    def __getattr__(self, name: str) -> list[Located]:
        for kind, plural in KINDS.items():
            if name == plural:
                return [one for one in self.located if one.kind == kind]
        raise AttributeError(f"a branch has no attribute {name!r}")

    def __len__(self) -> int:
        return len(self._places)

    @cached_property
    def mesh_error(self) -> list[float]:
        """Errors that the mesh of beams causes in the values of `located`, in their order: their change on a mesh of one order
        more (nan where that has no such place, 0.0 without beams). The first reading follows the branch on that mesh."""
        if self._finer is None:
            return [0.0] * len(self.located)
        fine, found = self._finer(), []
        for kind, plural in KINDS.items():
            mine, theirs = getattr(self, plural), getattr(fine, plural)
            found += [(one, abs(theirs[i].value - one.value) if len(theirs) == len(mine) else np.nan)
                      for i, one in enumerate(mine) if one.kind == kind]
        return [next(error for other, error in found if other is one) for one in self.located]

    def result(self, i: int) -> Any:
        """The motion over one period, or the state at rest, of point i as a Result; the steps of the continuation, without an
        estimate of their error: `s.periodic` from this start gives one with it."""
        return self._places[option("i", i, whole, "give the number of a point")].result()

    def peaks(self, sensor: str) -> Array:
        """Largest magnitude (k,) of a sensor in each motion: over a frequency of excitation the frequency response."""
        return np.array([float(self.result(i).peak(sensor).value) for i in range(len(self))])

    def to_dataframe(self, *sensors: str) -> Any:
        """A pandas table with a row per point: the number, period, stable, and the peaks of the sensors named."""
        import pandas as pd

        columns = {self.name: self.values, "period": self.periods, "stable": self.stable}
        return pd.DataFrame(columns | {f"peak of {sensor}": self.peaks(sensor) for sensor in sensors})

    def plot(self, sensor: str | None = None, path: Any = None, ax: Any = None) -> Any:
        """The peaks of a sensor (default: the largest multiplier or root) over the number, solid where stable, with the places
        located; a matplotlib figure. path: .png, .svg or .pdf to write. ax: axes of matplotlib to draw in."""
        from mbdae.show.plots import plot_branch

        return plot_branch(self, sensor, path, ax)

    def __repr__(self) -> str:
        found = "".join(f", {one.kind} at {one.value:.9g} +- {one.error:.1g}" for one in self.located)
        over = f"{len(self)} points from {self.values[0]:.6g} to {self.values[-1]:.6g}"
        return f"<Branch along '{self.name}': {over}{self._plane}{found}>"


@naming_arguments
@single_threaded
def continuation(scene: SceneData, name: str, over: Any, of: Any = None, steps: int = 400) -> Branch:
    """The branch of periodic motions, or of states at rest, through `of` along the number `name` in the range `over`.

    name: of an argument of a statement, as in `mb.sweep` ("strut.stiffness"), or of `mb.number`, of which the period of the orbit
    may be an expression. over: (smallest, largest) value. of: an orbit from `s.periodic`, an equilibrium, or None for that of the
    scene. steps: largest number of points on either side. Raises SteadyError where no point follows the first, OptionError for a
    number that the scene does not have."""
    called = option("name", name, text, "give the name of a number, such as 'strut.stiffness'")
    low, high = option("over", over, _range, "give the smallest and the largest value, such as (10, 60)")
    most = option("steps", steps, whole, "give the largest number of points on either side", least=1)
    refuse_sampled(scene, "continuation")
    if of is not None and not isinstance(of, Periodic | Equilibrium):
        raise OptionError(f"of = {shown(of)} is neither a periodic motion nor a state at rest: {OF}")
    try:
        begin = float(stated_value(scene, called, 1.0))
    except OptionError as error:
        raise OptionError(f"name = {shown(name)}: {error}") from error
    if not low <= begin <= high:
        raise OptionError(f"over = ({low:g}, {high:g}) does not contain {called} = {begin:g}, the value of the scene, at which "
                          f"the branch begins")
    start = scene.equilibrium() if of is None else of  # type: ignore[attr-defined]
    kind = Orbits if isinstance(start, Periodic) else Rests
    branch = _branch(kind(scene, called, high - low, start), begin, (low, high), most)
    branch._plane = start._plane
    for end in branch.ends:
        if end != WHOLE:
            warn(f"the branch along {called} ends inside its range: {end}")
    for i, p in enumerate(branch.values):
        if told(branch.result(i), f"the branch along {called}, first at {p:.6g}: "):
            break
    if isinstance(start, Equilibrium) and start.prepared.model.lines:
        branch._finer = partial(_on_finer_beams, scene, called, begin, (low, high), most)
    return branch


def _on_finer_beams(scene: SceneData, name: str, begin: float, over: tuple[float, float], steps: int) -> Branch:
    rests = Rests(scene, name, over[1] - over[0], equilibrium(with_finer_beams(scene), out_of_plane=False))
    rests.fine = True
    return _branch(rests, begin, over, steps)


def _branch(along: Along, begin: float, over: tuple[float, float], most: int) -> Branch:
    """The branch on both sides of the point at which it begins."""
    walk = _Walk(along, over, most)
    first = walk.corrected(along.begin(begin), None)
    if first is None:
        raise SteadyError("the start of the branch does not return, or is not at rest, in the steps of the continuation")
    sides = [walk.side(first, way) for way in (-1.0, 1.0)]
    places = sides[0][0][:0:-1] + sides[1][0]
    if len(places) < 2:
        raise SteadyError(f"no point of the branch was found beside {along.name} = {begin:g}: {sides[0][1]}; {sides[1][1]}")
    located = sorted(sides[0][2] + sides[1][2], key=lambda one: one.value)
    return Branch(along.name, places, located, (sides[0][1], sides[1][1]))


def _range(value: Any) -> tuple[float, float]:
    try:
        low, high = [number(x) for x in (value if several(value) else [])]
    except (TypeError, ValueError, BadValueError):
        raise BadValueError(f"{shown(value)} is no pair of numbers") from None
    if not low < high:
        raise BadValueError(f"{shown(value)} is not a smaller and a larger number")
    return low, high


class _Walk:
    """Steps along a branch. Places hold the tangent (m + 1,): of the start, and last of the number over its range."""

    def __init__(self, along: Along, over: tuple[float, float], most: int) -> None:
        self.along, self.over, self.most = along, over, most

    def side(self, first: Place, way: float) -> tuple[list[Place], str, list[Located]]:
        """The points from the first on, to smaller (way -1) or larger (1) numbers at first; why they end; the places located."""
        tangent = first.tangent * np.sign(first.tangent[-1] or 1.0) * way
        place, step, places, located = replace(first, tangent=tangent), FIRST, [first], list[Located]()
        near = NEAR * (self.over[1] - self.over[0])
        if (place.p - self.over[0] if way < 0 else self.over[1] - place.p) < near:
            return places, WHOLE, located
        while len(places) <= self.most:
            if step < SHORTEST:
                return places, f"no further point was found beside {place.p:.9g}", located
            found = self.step(place, step)
            if found is None:
                step /= 2
                continue
            there, count = found
            ends = there.p - self.over[0] < near or self.over[1] - there.p < near
            if not self.over[0] - near <= there.p <= self.over[1] + near:
                end = self.over[0] if there.p < self.over[0] else self.over[1]
                step *= min(1.0, (end - place.p) / (there.p - place.p))
                continue
            located += list(self._events(place, there, step))
            places.append(there)
            if ends:
                return places, WHOLE, located
            step = min(LONGEST, step * (1.6 if count <= QUICK else 1.0))
            place = there
        return places, f"the number of steps, {self.most}", located

    def step(self, place: Place, step: float) -> tuple[Place, int] | None:
        """The next point in the direction of the tangent, and the number of corrections; None where the step is too long."""
        try:
            there = self.corrected(self.along.moved(place, step * place.tangent), place.tangent)
        except MbdaeError:
            return None
        if there is None or there.tangent @ place.tangent < np.cos(BEND):
            return None
        return there, there.corrections

    def corrected(self, place: Place, before: Array | None) -> Place | None:
        """The point on the branch near a place, by corrections of least norm; None where they do not converge."""
        last, slope = np.inf, None
        for i in range(CORRECTIONS):
            off = float(np.linalg.norm(place.residual))
            if i and off > 2 * last:
                return None
            slope = self.along.slope(place) if slope is None else slope  # near enough for all corrections of a step
            J = np.column_stack([place.J, slope])
            held = J if before is not None else place.J  # the first point keeps its number
            x = np.append(np.linalg.lstsq(held, -place.residual, rcond=1e-13)[0], np.zeros(J.shape[1] - held.shape[1]))
            if (off < CLOSE and np.linalg.norm(x) < 1e-8) or (i and off < 1e-6 and off > last / 4):
                return self._finished(place, J, before, i)
            place, last = self.along.moved(place, x), off
        return None

    def _finished(self, place: Place, J: Array, before: Array | None, count: int) -> Place:
        _, sizes, rows = np.linalg.svd(J)
        tangent = rows[-1]
        if before is not None:
            if J.shape[0] > 1:  # of several directions the one that goes on
                null = rows[np.r_[sizes <= 1e-9 * sizes[0], np.ones(J.shape[1] - len(sizes), dtype=bool)]]
                along = null.T @ (null @ before)
                tangent = along / np.linalg.norm(along) if np.linalg.norm(along) > 0 else tangent
            tangent = tangent * (np.sign(tangent @ before) or 1.0)
        return self.along.judged(replace(place, tangent=tangent, corrections=count))

    def _events(self, a: Place, b: Place, step: float) -> Iterator[Located]:
        """The places between two points at which a function of the branch changes its sign."""
        folds = a.tangent[-1] * b.tangent[-1] < 0
        for kind, function in self.along.functions(a, b).items():
            if (kind == "branching" and folds) or not function(a) * function(b) < 0:
                continue
            yield self._located(kind, self._root(a, b, step, function), a, b, step, function)
        if folds:
            yield self._located("fold", self._root(a, b, step, _turning), a, b, step, _turning)

    def _root(self, a: Place, b: Place, step: float, function: Callable[[Place], float]) -> Place | None:
        known = {0.0: a, 1.0: b}

        def at(share: float) -> float:
            if share not in known:
                found = self.corrected(self.along.moved(a, share * step * a.tangent), a.tangent)
                if found is None:
                    raise SteadyError("the branch is lost between two points")
                known[share] = found
            return function(known[share])

        try:
            share = brentq(at, 0.0, 1.0, xtol=1e-11, rtol=1e-13, maxiter=LOOKS)
            at(share)
            return known[share]
        except (MbdaeError, ValueError, RuntimeError):
            return None

    def _located(self, kind: str, place: Place | None, a: Place, b: Place, step: float,
                 function: Callable[[Place], float]) -> Located:
        """The place with its error. It is found once more, between points nearer to it, of periodic motions in half the steps of
        the period: the change counts, there over GAIN, and how far the number moves while the function changes by what it is off
        at both places and by the errors of roots. Where it was not found, the point after it with the distance of both points."""
        if place is None:
            return Located(kind, b.p, abs(b.p - a.p), b.period, b.crossing(kind))
        finer, value, error = self.along.finer(), place.p, abs(place.p)
        walk = _Walk(finer or self.along, self.over, self.most)
        try:
            near = walk.corrected(walk.along.again(place), place.tangent)
            sides = [walk.corrected(walk.along.moved(near, s * step * near.tangent), near.tangent) if near else None
                     for s in (-0.1, 0.1)]
            again = walk._root(sides[0], sides[1], 0.2 * step, function) if sides[0] and sides[1] else None
            if again is not None and sides[0] and sides[1]:
                over = abs((sides[1].p - sides[0].p) / (function(sides[1]) - function(sides[0])))
                off = abs(function(again)) + self.along.doubt(kind, again) + (abs(function(place)) if finer is None else 0.0)
                value, error = again.p, abs(again.p - place.p) / (GAIN if finer else 1.0) + over * off + ROUNDED * abs(again.p)
        except MbdaeError:
            pass
        return Located(kind, float(value), float(error), place.period, place.crossing(kind))


def _turning(place: Place) -> float:
    return float(place.tangent[-1])
