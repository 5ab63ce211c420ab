"""Runs of one scene from many starts, or with many values of its numbers, each with the estimate of its error."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import OptionError
from mbdae.formulations import system_for
from mbdae.integrators.base import Asked
from mbdae.integrators.runge_kutta.batch import Batch, solve_batch
from mbdae.integrators.runge_kutta.dop853 import DOP853
from mbdae.run.choice import choose, prepared_from, with_recursive_joints
from mbdae.run.control import ATTEMPTS, FINER, measure_of, plausible
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array

COMPARED = 32  #: times besides the outputs at which a run is compared with its companion


@dataclass(frozen=True, eq=False)
class Runs:
    """names (n,) of the unknowns; batch: the runs at the outputs; estimate (k,): estimated error of each, nan where it failed;
    warnings: a sentence per point whose accuracy is missed or that failed, by its number."""

    names: tuple[str, ...]
    batch: Batch
    estimate: Array
    warnings: dict[int, str]


def run_batch(scene: SceneData, t_end: float, accuracy: float = 1e-6, *, starts: Any = None,
              numbers: Mapping[str, Any] | None = None, outputs: Any = None, max_wall: float | None = None) -> Runs:  # fmt: skip
    """Every point twice, as `Scene.simulate` does: at ten times the tolerance and at the tolerance itself, by which its error is
    estimated; points that miss the accuracy again with a tighter one. Arguments as of `solve_batch`.

    Raises OptionError for scenes that simulate would not give to DOP853: stiff ones, with contact or friction, and so on."""
    accuracy, begin = plausible(accuracy), time.perf_counter()
    prepared = with_recursive_joints(scene, t_end=t_end) or prepared_from(scene, t_end=t_end)
    choice = choose(prepared, scene, accuracy)
    if not isinstance(choice.solver, DOP853):
        raise OptionError(f"scene '{scene.name}': a batch takes DOP853, this scene {choice}; use mb.sweep with scene.simulate")
    system = system_for(prepared, choice.form, 0)
    times = Asked.of(system, t_end, outputs).times
    times = np.array([float(t_end)]) if times is None else times
    every = np.union1d(times, np.linspace(system.t0, t_end, COMPARED + 1))
    measure = partial(measure_of(system, prepared), every)
    solver, limit = choice.solver.at_accuracy(accuracy, system.label), choice.solver.tightest[""]

    def solved(rtol: float, some: NDArray[np.intp] | None = None) -> Batch:
        """Some of the points at a tolerance."""
        left = None if max_wall is None else max(max_wall - (time.perf_counter() - begin), 1e-9)
        given = {name: _some(np.atleast_1d(v), some) for name, v in (numbers or {}).items()}
        own = None if starts is None else _some(np.atleast_2d(starts), some)
        return solve_batch(system, t_end, replace(solver, rtol=rtol), starts=own, numbers=given, outputs=every, max_wall=left)

    tight = solver.tolerance
    coarse, fine = solved(min(tight * solver.companion, 0.1)), solved(tight)
    made, estimate, cpu = fine, np.full(len(fine.errors), np.nan), coarse.cpu_s + fine.cpu_s
    some = np.arange(len(fine.errors))
    for _ in range(ATTEMPTS):
        # the whole distance: that a tighter run is nearer by the ratio of tolerances does not hold at every of a thousand points
        estimate[some] = [float(np.max(measure(a, b))) if fine.errors[i] is None else np.nan
                          for i, (a, b) in enumerate(zip(coarse.y, fine.y, strict=True))]  # fmt: skip
        made = fine if len(some) == len(estimate) else _with(made, fine, some)
        missed = np.flatnonzero(estimate[some] > accuracy)
        if not len(missed) or tight <= limit:
            break
        coarse, some = _rows(fine, missed), some[missed]
        tight = max(tight * float(np.clip((0.5 * accuracy / np.max(estimate[some])) ** (1 / 0.9), *FINER)), limit)
        fine = solved(tight, some)
        cpu += fine.cpu_s
    at = np.searchsorted(every, times)
    done = replace(made, t=times, y=made.y[:, at], cpu_s=cpu, wall_s=time.perf_counter() - begin)
    return Runs(system.names, done, estimate, _warnings(done, estimate, accuracy))


def _some(values: Any, some: NDArray[np.intp] | None) -> Any:
    return values if some is None or len(values) == 1 else values[some]


def _rows(batch: Batch, some: NDArray[np.intp]) -> Batch:
    """Some points of a batch."""
    rows = {name: getattr(batch, name)[some] for name in ("y", "last", "steps", "rejected", "evaluations")}
    return replace(batch, errors=tuple(batch.errors[i] for i in some), **rows)


def _with(batch: Batch, other: Batch, some: NDArray[np.intp]) -> Batch:
    """A batch with some points replaced by those of another."""
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
