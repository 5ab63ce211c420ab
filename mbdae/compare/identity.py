"""The identity of a comparison as plain data: a stored comparison is continued only where its identity equals that of the
call."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from types import FunctionType
from typing import Any

import numpy as np

from mbdae.compare.problem import Problem
from mbdae.compare.run import Run
from mbdae.results.reads import own_classes, own_of, reads
from mbdae.results.storage import own_laws
from mbdae.run.environment import environment
from mbdae.scene.record import encode
from mbdae.system.base import Array, System

PROBES = 7  #: number of states at which the equations of a System are evaluated to recognise them


def identity(problem: Problem, runs: Sequence[Run], accuracies: Sequence[float], given: Array | None) -> dict[str, Any]:
    """The identity: scene or equations, end time, measure, runs, accuracies, values of a `given` reference, and versions."""
    return {
        "scene": _scene(problem), "t_end": problem.t_end, "measure": problem.measure, "accuracies": list(accuracies),
        "max_wall": problem.max_wall, "runs": [_run(run) for run in runs],
        "reference": "computed" if given is None else f"given, {_digest(given)}", "environment": environment(),
    }  # fmt: skip


def _scene(problem: Problem) -> dict[str, Any]:
    s = problem.scene
    if s is None:
        return _equations(problem.system(None), problem.t_end)
    return {"name": s.name, "gravity": s.gravity.tolist(), "space": s.space, "statements": s.statements,
            "laws": own_laws(problem.stated.prepared.model) if problem.stated.prepared else {}, "own": own_of(s)}  # fmt: skip


def _run(run: Run) -> dict[str, Any]:
    models = {name: encode(model) for name, model in run.models.items()}
    return {"solver": encode(run.solver), "form": encode(run.form), "model": models or None, "label": run.label,
            "own": own_classes(run.solver, run.form)}  # fmt: skip


def _equations(system: System, t_end: float) -> dict[str, Any]:
    """Values of the functions of a System at fixed states, by which it is recognised, since functions cannot be stored."""
    out, values = np.empty(system.n), []
    for k in range(PROBES):
        wave = np.sin((1 + k) * (1.0 + np.arange(system.n)))
        t = system.t0 + (t_end - system.t0) * k / PROBES
        system.residual(t, system.y0 + 1e-3 * k * system.scale * wave, system.yp0 + 1e-3 * k * wave[::-1], out)
        values.append(out.copy())
    start = {"t0": system.t0, "y0": system.y0.tolist(), "yp0": system.yp0.tolist()}
    index = np.asarray(system.index).tolist()
    own = {name: reads(thing) for name, thing in vars(system).items() if isinstance(thing, FunctionType)}
    return {"names": list(system.names), "index": index, **start, "residuals": _digest(np.array(values)), "functions": own}


def _digest(values: Array) -> str:
    return sha256(np.ascontiguousarray(values, dtype="<f8").tobytes()).hexdigest()
