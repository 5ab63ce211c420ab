"""Runs of one scene from many starts, or with many values of parameters of laws, each with an estimate of its error."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import distinct
from mbdae.errors import NotReadError, OptionError
from mbdae.formulations import system_for
from mbdae.integrators.base import Asked
from mbdae.integrators.batch import Batch, refuse_watched, solve_batch
from mbdae.integrators.dop853 import DOP853
from mbdae.run.choice import choose, prepared_from, with_recursive_joints
from mbdae.run.control import ATTEMPTS, FINER, measure_of, plausible
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array, System

LOOKED_AT = 5  #: number of states at which the rates of two systems of equations are compared
COMPARED = 32  #: number of equal parts of the run at whose ends, besides the outputs, a run is compared with its companion


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of k points. names (n,): of the unknowns; batch: values at the outputs; estimate (k,): estimated error of each run,
    nan where it failed; warnings: {number of a point: sentence} where the accuracy is missed or the run failed."""

    names: tuple[str, ...]
    batch: Batch
    estimate: Array
    warnings: dict[int, str]


def run_batch(scene: SceneData, t_end: float, accuracy: float = 1e-6, *, starts: Any = None,
              numbers: Mapping[str, Any] | None = None, outputs: Any = None, max_wall: float | None = None) -> Runs:
    """Run every point as `Scene.simulate` does: at ten times the tolerance and at the tolerance. Their difference gives the
    estimated error; where it is above the accuracy, the point is run again with a smaller tolerance. Arguments as in
    `solve_batch`.

    Raises OptionError for scenes for which `simulate` would not choose DOP853, such as stiff ones or those with contact."""
    return Batches(scene, t_end, accuracy, outputs, numbers or ()).run(starts, numbers, max_wall)


class Batches:
    """A scene prepared for several batches of runs, one after the other; arguments as in `run_batch`."""

    def __init__(self, scene: SceneData, t_end: float, accuracy: float = 1e-6, outputs: Any = None,
                 numbers: Iterable[str] = ()) -> None:
        """numbers: names of law parameters that will vary; some cannot, because the equations have them as constants."""
        self.accuracy, self.t_end = plausible(accuracy), t_end
        prepared = with_recursive_joints(scene, t_end=t_end) or prepared_from(scene, t_end=t_end)
        choice = choose(prepared, scene, self.accuracy)
        if not isinstance(choice.solver, DOP853):
            raise OptionError(f"scene '{scene.name}': a batch is solved by DOP853, but mbdae solves this scene by {choice}; run "
                              "its points one by one")
        self.system, self._known = system_for(prepared, choice.form, 0), dict[str, bool]()
        try:
            left = [name for name in numbers if not self._read(name)]
            written = prepared.all_bodies.moved.written(prepared.model) if left else ()
            fixed = any(f"{item}.{name}" in left for item, name in written)
        except OptionError:
            fixed = True
        if fixed:
            self.system, self._known = system_for(prepared, choice.form, 0, open=True), {}
        if numbers:
            refuse_watched(self.system, t_end)
        times = Asked.of(self.system, t_end, outputs).times
        self.times = np.array([float(t_end)]) if times is None else times
        self._every = distinct(np.r_[self.times, np.linspace(self.system.t0, t_end, COMPARED + 1)])
        self._measure = partial(measure_of(self.system, prepared), self._every)
        self._solver, self._limit = choice.solver.at_accuracy(self.accuracy, self.system.label), choice.solver.tightest[""]

    def read(self, numbers: Mapping[str, Any]) -> dict[str, Any]:
        """The given parameters of laws without those that the equations do not depend on; OptionError for one on which they
        depend but which cannot be varied."""
        return {name: values for name, values in numbers.items() if self._read(name)}

    def _read(self, name: str) -> bool:
        if name not in self._known:
            try:
                self.system.numbers([name])
                self._known[name] = True
            except NotReadError:
                self._known[name] = False
        return self._known[name]

    def rates_apart(self, own: System, numbers: Mapping[str, float]) -> float:
        """Largest difference between y' of this system with the parameters `numbers` of laws and y' of the system `own`, relative
        to the largest y', at LOOKED_AT states near the start."""
        read = self.read(numbers)
        at, rng, here, there = self.system.numbers(list(read)), np.random.default_rng(0), np.empty(own.n), np.empty(own.n)
        before, apart = at.W[at.slots].copy(), 0.0
        at.W[at.slots] = np.array(list(read.values()))[at.of]
        try:
            for _ in range(LOOKED_AT):
                y = own.y0 + own.scale * rng.uniform(-1, 1, own.n)
                self.system.rhs(own.t0, y, here)
                own.rhs(own.t0, y, there)
                apart = max(apart, float(np.max(np.abs(here - there)) / np.max(np.abs(there), initial=1e-300)))
        finally:
            at.W[at.slots] = before
        return apart

    def run(self, starts: Any = None, numbers: Mapping[str, Any] | None = None, max_wall: float | None = None) -> Runs:
        """Run a batch; see `run_batch`."""
        begin, accuracy = time.perf_counter(), self.accuracy

        def solved(rtol: float, some: NDArray[np.intp] | None = None) -> Batch:
            """Run the points `some` (None: all) at a tolerance."""
            left = None if max_wall is None else max(max_wall - (time.perf_counter() - begin), 1e-9)
            given = {name: _some(np.atleast_1d(v), some) for name, v in (numbers or {}).items()}
            own = None if starts is None else _some(np.atleast_2d(starts), some)
            return solve_batch(self.system, self.t_end, replace(self._solver, rtol=rtol), starts=own, numbers=given,
                               outputs=self._every, max_wall=left)

        tight = self._solver.tolerance
        coarse, fine = solved(min(tight * self._solver.companion, 0.1)), solved(tight)
        made, estimate, cpu = fine, np.full(len(fine.errors), np.nan), coarse.cpu_s + fine.cpu_s
        some = np.arange(len(fine.errors))
        for _ in range(ATTEMPTS):
            # the whole difference counts as the error: not at every point does it fall with the tolerance as it is assumed to
            estimate[some] = [float(np.max(self._measure(a, b))) if fine.errors[i] is None else np.nan
                              for i, (a, b) in enumerate(zip(coarse.y, fine.y, strict=True))]
            made = fine if len(some) == len(estimate) else _with(made, fine, some)
            missed = np.flatnonzero(estimate[some] > accuracy)
            if not len(missed) or tight <= self._limit:
                break
            coarse, some = _rows(fine, missed), some[missed]
            wanted = tight * float(np.clip((0.5 * accuracy / np.max(estimate[some])) ** (1 / 0.9), *FINER))
            tight = max(wanted, self._limit)
            fine = solved(tight, some)
            cpu += fine.cpu_s
        at = np.searchsorted(self._every, self.times)
        done = replace(made, t=self.times, y=made.y[:, at], cpu_s=cpu, wall_s=time.perf_counter() - begin)
        return Runs(self.system.names, done, estimate, _warnings(done, estimate, accuracy))


def _some(values: Any, some: NDArray[np.intp] | None) -> Any:
    return values if some is None or len(values) == 1 else values[some]


def _rows(batch: Batch, some: NDArray[np.intp]) -> Batch:
    """The points `some` (indices) of a batch."""
    rows = {name: getattr(batch, name)[some] for name in ("y", "last", "steps", "rejected", "evaluations")}
    return replace(batch, errors=tuple(batch.errors[i] for i in some), **rows)


def _with(batch: Batch, other: Batch, some: NDArray[np.intp]) -> Batch:
    """A batch whose points `some` (indices) are replaced by those of another batch, in their order."""
    rows = {name: getattr(batch, name).copy() for name in ("y", "last", "steps", "rejected", "evaluations")}
    errors = list(batch.errors)
    for j, i in enumerate(some):
        errors[i] = other.errors[j]
        for name, row in rows.items():
            row[i] = getattr(other, name)[j]
    return replace(batch, errors=tuple(errors), **rows)


def _warnings(batch: Batch, estimate: Array, accuracy: float) -> dict[int, str]:
    found = {i: str(error) for i, error in enumerate(batch.errors) if error is not None}
    missed = np.flatnonzero(estimate > accuracy)
    return found | {int(i): f"accuracy {accuracy:g} asked, estimated error {estimate[i]:.1e}" for i in missed}
