"""What a branch consists of: periodic motions, or states at rest, with the derivatives of their equations by start and number."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Protocol

import numpy as np

from mbdae.analysis.linearization import linearized
from mbdae.analysis.multipliers import on_circle, prepared_from
from mbdae.analysis.orbit import halved
from mbdae.analysis.pencil import derivatives
from mbdae.analysis.shooting import Shooting, Shot, fast_motions
from mbdae.errors import MbdaeError, OptionError
from mbdae.formulations import system_for
from mbdae.inputs.sensed import named_by, number_symbol, numbers_in, with_values
from mbdae.results.accuracy import Accuracy, RunInfo
from mbdae.results.result import Result
from mbdae.results.stored_parts import started
from mbdae.run.verification import with_finer_beams
from mbdae.scene.scene import SceneData
from mbdae.study.statements import changed
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.scene_system import SceneSystem

DIFFERENCE = 1e-5  #: difference of the number to either side, over its range, for derivatives by it
SLACK = 1e-7  #: growth, over the largest root or in one period, that counts as none where roots lie on the border of stability
LARGEST = 600.0  #: logarithm of the largest ratio of two determinants
KNOWN = 1e-6  #: error of multipliers, relative, that the steps leave


@dataclass(frozen=True)
class Place:
    """A point on or near a branch: number p, period (s), residual (k,), J (k, m): by the start; tangent (m + 1,); roots and
    whether stable; made: what it was computed from."""

    p: float
    period: float
    residual: Array
    J: Array
    made: Any
    result: Callable[[], Any]
    tangent: Array = field(default_factory=lambda: np.zeros(0))
    corrections: int = 0
    roots: Any = field(default_factory=lambda: np.zeros(0, dtype=complex))
    stable: bool | None = None
    whole: float = 0.0  #: determinant that vanishes where another branch crosses
    errors: Array = field(default_factory=lambda: np.zeros(0))  #: of the roots

    def crossing(self, kind: str) -> complex:
        """The root that crosses the border of stability in an event."""
        if not len(self.roots):
            return complex(np.nan)
        aim = {"fold": 1.0, "branching": 1.0, "doubling": -1.0}.get(kind)
        if np.isnan(self.period):
            swings = np.abs(self.roots.imag) > self.errors
            off = np.abs(self.roots) if kind != "hopf" else np.where(swings, -self.roots.real, np.inf)
        else:
            off = np.abs(self.roots - aim) if aim is not None else np.abs(np.abs(self.roots) - 1) + (self.roots.imag <= 0)
        return complex(self.roots[int(np.argmin(off))])


class Along(Protocol):
    """Equations of a branch along the number `name`."""

    name: str

    def begin(self, p: float) -> Place:
        """The point that was given."""

    def moved(self, place: Place, z: Array) -> Place:
        """The place z (m + 1,) beside another."""

    def slope(self, place: Place) -> Array:
        """Derivative (k,) of the residual by the number over its range."""

    def judged(self, place: Place) -> Place:
        """The place with its roots."""

    def functions(self, a: Place, b: Place) -> dict[str, Callable[[Place], float]]:
        """Functions of places that change their signs at an event, by the kind of event."""

    def doubt(self, kind: str, place: Place) -> float:
        """Error of the function of an event at a place, beyond that which more steps show."""

    def finer(self) -> Along | None:
        """The same equations in half the steps; None where there are no steps, or this is the finer one."""

    def again(self, place: Place) -> Place:
        """A place of the coarser equations."""


class _Varied:
    """A scene with a number that varies; unit: its range; fine: whether its beams are of one order more."""

    fine = False

    def __init__(self, scene: SceneData, name: str, unit: float) -> None:
        self.scene, self.name, self.unit = scene, name, unit
        self._kept: dict[float, tuple[Prepared, SceneSystem]] = {}

    def at(self, p: float) -> tuple[Prepared, SceneSystem]:
        """The scene and its equations at a value of the number."""
        if p not in self._kept:
            if len(self._kept) > 8:
                self._kept.clear()
            scene = changed(self.scene, self.name, p)[0]
            scene = with_finer_beams(scene) if self.fine else scene
            prepared = self.prepared(scene)
            self._kept[p] = prepared, system_for(prepared, highest_index=3)
        return self._kept[p]

    def prepared(self, scene: SceneData) -> Prepared:
        return prepared_from(scene, None, 0.0)

    def unknowns(self, p: float, start: Any) -> Array:
        """Unknowns (n,) of the state of a start, at a value of the number."""
        prepared, system = self.at(p)
        y = system.y0.copy()
        parts = np.concatenate([*(x[0] for x in prepared.all_bodies.reduced(start.q[None], start.u[None])), start.s])
        y[: len(parts)] = parts
        return y


class Orbits(_Varied):
    """Periodic motions. Starts are departures from that of a place, and where the period is free its relative change."""

    def __init__(self, scene: SceneData, name: str, unit: float, orbit: Any, shares: Array | None = None) -> None:
        super().__init__(scene, name, unit)
        self.orbit, self.halved = orbit, shares is not None
        self.shares = orbit.shares if shares is None else shares
        self.free, self._slack = orbit.autonomous, 0.0

    def length(self, p: float) -> float:
        """The stated period (s) at a value of the number."""
        e = self.orbit.stated
        if e is None or not numbers_in(e):
            return float(self.orbit.period)
        own = {s: type(s)(number_symbol(self.name, p)) for s in e.free_symbols if (named_by(s) or ("",))[0] == self.name}
        return float(with_values(e.subs(own)))

    def begin(self, p: float) -> Place:
        return self._place(p, self.unknowns(p, self.orbit.prepared.start), self.orbit.period)

    def _place(self, p: float, y: Array, period: float) -> Place:
        shooting, shot = self._shot(p, y, period)
        J, right = shooting.matrix(shot)
        return Place(p, period, -right, J, shot, partial(self._result, shooting.prepared, shot))

    def _shot(self, p: float, y: Array, period: float) -> tuple[Shooting, Shot]:
        """The motion over a period (s) from unknowns y (n,), at a value of the number."""
        prepared, system = self.at(p)
        shooting, nb = Shooting(prepared, system, self.free), system.numbering
        shooting.acting = nb.nq + nb.nu + np.arange(len(nb.states))
        return shooting, shooting.shot(shooting.begun_at(system.t0, y), period, self.shares)

    def moved(self, place: Place, z: Array) -> Place:
        p, shot = place.p + self.unit * float(z[-1]), place.made
        k = shot.directions.Q.shape[1]
        period = place.period * (1 + float(z[k])) if self.free else self.length(p)
        y = shot.directions.closed(self.at(p)[1], shot.system.y0 + shot.directions.start @ z[:k])
        return self._place(p, y, period)

    def slope(self, place: Place) -> Array:
        shot, p = place.made, place.p + DIFFERENCE * self.unit  # one more scene: it costs more than the period that is followed
        y = shot.directions.closed(self.at(p)[1], shot.system.y0)
        beside = self._shot(p, y, place.period if self.free else self.length(p))[1]
        found = (beside.residual - shot.residual) / DIFFERENCE
        return np.append(found, 0.0) if self.free else np.asarray(found)

    def judged(self, place: Place) -> Place:
        k = place.made.directions.Q.shape[1]
        M = place.J[:k, :k] + np.eye(k)
        roots: Any = np.linalg.eigvals(M)
        along = int(np.argmin(np.abs(roots - 1))) if self.free and k else -1
        others = np.delete(roots, along) if along >= 0 else roots
        size = float(np.max(np.abs(others), initial=0.0))
        stable = False if size > 1 + KNOWN else True if size < 1 - KNOWN or np.all(
            (np.abs(others) < 1 - KNOWN) | on_circle(others + 0j, np.full(len(others), KNOWN))) else None
        if stable is not False:
            fast = self._fast(place.p, place.made)
            stable = stable if fast else fast
        ordered = others[np.argsort(-np.abs(others))]
        return replace(place, roots=ordered + 0j, stable=stable, whole=float(np.linalg.det(place.J)))

    def _fast(self, p: float, shot: Shot) -> bool | None:
        """Whether motions die out that the steps do not follow; None where that is open."""
        return fast_motions(self.at(p)[0], shot.system, shot.orbit, shot.directions, shot.returned).stable

    def functions(self, a: Place, b: Place) -> dict[str, Callable[[Place], float]]:
        def doubling(place: Place) -> float:
            return float(np.prod(1 + place.roots).real)

        def pair(place: Place) -> float:
            bent = place.roots[np.abs(place.roots.imag) > 1e-9]
            return float(np.max(np.abs(bent), initial=0.0)) - 1

        slack = self._slack = SLACK if min(pair(a), pair(b)) > -10 * SLACK else 0.0
        return {"doubling": doubling, "branching": lambda place: place.whole, "hopf": lambda place: pair(place) - slack}

    def doubt(self, kind: str, place: Place) -> float:
        return self._slack if kind == "hopf" else 0.0

    def finer(self) -> Orbits | None:
        return None if self.halved else Orbits(self.scene, self.name, self.unit, self.orbit, halved(self.shares))

    def again(self, place: Place) -> Place:
        return self._place(place.p, place.made.system.y0, place.period)

    def _result(self, prepared: Prepared, shot: Shot) -> Result:
        run = shot.orbit.run
        return Result(prepared, run, RunInfo(run, "Radau", Accuracy(None, None), run.stats), run.t)


class Rests(_Varied):
    """States at rest: all unknowns y with F(t, y, 0) = 0, over their scales."""

    def __init__(self, scene: SceneData, name: str, unit: float, rest: Any) -> None:
        super().__init__(scene, name, unit)
        if rest.frame != "ground":
            raise OptionError(f"of = {rest!r} rests in a body that turns: give the periodic motion of a turn, "
                              f"s.periodic(period, start=e)")
        self.rest = rest
        self._size: float | None = None  #: logarithm of the first determinant

    def prepared(self, scene: SceneData) -> Prepared:
        return prepare(scene)

    def begin(self, p: float) -> Place:
        system = self.at(p)[1]
        return self._place(p, system.restarted(system.t0, self.unknowns(p, self.rest.prepared.start))[0])

    def _place(self, p: float, y: Array) -> Place:
        system = self.at(p)[1]
        F, still = np.empty(system.n), np.zeros(system.n)
        system.residual(system.t0, y, still, F)
        J = derivatives(system, system.t0, y, still)[0].toarray() * system.scale
        rows = np.maximum(np.max(np.abs(J), axis=1), 1e-300)
        return Place(p, float("nan"), F / rows, J / rows[:, None], (y, rows), partial(self._result, p, y))

    def moved(self, place: Place, z: Array) -> Place:
        p = place.p + self.unit * float(z[-1])
        return self._place(p, place.made[0] + self.at(p)[1].scale * z[:-1])

    def slope(self, place: Place) -> Array:
        y, rows = place.made
        ends = []
        for way in (-1.0, 1.0):
            system = self.at(place.p + way * DIFFERENCE * self.unit)[1]
            F = np.empty(system.n)
            system.residual(system.t0, y, np.zeros(system.n), F)
            ends.append(F / rows)
        return np.asarray((ends[1] - ends[0]) / (2 * DIFFERENCE))

    def _result(self, p: float, y: Array) -> Result:
        prepared = self.at(p)[0]
        (q,), (u,), (s,) = prepared.states(np.array([prepared.start.t]), y[None])
        begin = replace(prepared.start, q=q, u=u, s=s)
        return started(replace(prepared, start=begin))

    def judged(self, place: Place) -> Place:
        at = self._result(place.p, place.made[0])
        try:
            found = linearized(at.prepared.model.scene, at, out_of_plane=False)
            sign, size = np.linalg.slogdet(found.K)
        except MbdaeError:
            return place
        self._size = size if self._size is None and np.isfinite(size) else self._size
        whole = float(sign * np.exp(min(size - (self._size or 0.0), LARGEST)))  # linear where it vanishes
        return replace(place, roots=found.eigenvalues, stable=found.stable, whole=whole, errors=found.errors)

    def functions(self, a: Place, b: Place) -> dict[str, Callable[[Place], float]]:
        size = max(float(np.max(np.abs(one.roots), initial=0.0)) for one in (a, b)) or 1.0

        def grows(place: Place) -> float:
            bent = np.abs(place.roots.imag) > place.errors
            return float(np.max((place.roots.real - place.errors)[bent], initial=-size)) / size

        return {"branching": lambda place: place.whole, "hopf": grows}

    def doubt(self, kind: str, place: Place) -> float:
        size = float(np.max(np.abs(place.roots), initial=0.0)) or 1.0
        return float(np.max(place.errors, initial=0.0)) / size if kind == "hopf" else 0.0

    def finer(self) -> None:
        return None

    def again(self, place: Place) -> Place:
        return place
