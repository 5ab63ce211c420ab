"""The runs beside a run in the file of a result: their unknowns at the times of the comparison."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mbdae.deferred import distinct
from mbdae.integrators.solution import Solution, Stats
from mbdae.results.accuracy import Accuracy
from mbdae.results.errors import Errors
from mbdae.results.header import MOST_OTHERS
from mbdae.results.reactions import KINDS, AtTimes, OtherRun
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared
from mbdae.values import BadValueError, shown

TIMES = 400  #: largest number of times at which each is stored


def header_of(errors: Errors | None) -> dict[str, Any]:
    """What the header says of them: names of unknowns, share and kind of each, and what was told about quantities. Runs on
    another mesh of beams are left out: their scene is not stored."""
    if errors is None:
        return {}
    kept = [{"names": list(other.run.names), "share": other.share, "kind": other.kind, "ratio": other.ratio}
            for other in _stored(errors)]
    return {"others": kept, "told": dict(errors.told)}


def arrays_of(errors: Errors | None) -> dict[str, Array]:
    """Times and unknowns of each."""
    found: dict[str, Array] = {}
    for i, other in enumerate(_stored(errors) if errors is not None else ()):
        times = other.times[distinct(np.linspace(0, len(other.times) - 1, TIMES).astype(int))]
        found |= {f"other{i}_t": times, f"other{i}_y": other.run(times)}
    return found


def _stored(errors: Errors) -> list[OtherRun]:
    return [other for other in errors.others if other.prepared is None and len(other.times)][:MOST_OTHERS]


def shapes_of(header: dict[str, Any], shapes: dict[str, tuple[int, ...]]) -> dict[str, tuple[int | None, ...]]:
    """The shapes that the arrays must have."""
    found: dict[str, tuple[int | None, ...]] = {}
    for i, other in enumerate(header.get("others", ())):
        count = (*shapes.get(f"other{i}_t", ()), 0)[0]
        found |= {f"other{i}_t": (count,), f"other{i}_y": (count, len(other["names"]))}
    return found


def with_errors(accuracy: Accuracy, header: dict[str, Any], arrays: dict[str, Array], prepared: Prepared,
                solution: Solution) -> Accuracy:  # fmt: skip
    """The accuracy of a loaded run with the errors of all quantities; with that of the reactions alone, a number, where the file
    has no runs beside it, as those of earlier versions."""
    if "others" not in header or accuracy.reactions is None:
        return accuracy
    others, least = [], prepared.all_bodies.numbering.n
    for i, other in enumerate(header["others"]):
        t, y = arrays[f"other{i}_t"], arrays[f"other{i}_y"]
        if other["kind"] not in KINDS or len(other["names"]) < least or not (t[1:] > t[:-1]).all():
            raise BadValueError(f"the file's run number {i} beside its run is none of this scene: {shown(other['kind'])}")
        run = Solution(t, y, y[:0], None, Stats(), solution.solver, tuple(other["names"]), True, AtTimes(t, y))
        others.append(OtherRun(run, t, other["share"], kind=other["kind"], ratio=other["ratio"]))
    errors = Errors(prepared, solution, tuple(others), accuracy.asked, dict(header["told"]), accuracy.reactions)
    return replace(accuracy, found_reactions=errors)
