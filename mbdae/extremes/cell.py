"""One cell of a map of extremes: a run at the accuracy asked, its error against a reference, and the verdict."""

from __future__ import annotations

import math
import time
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.compare.equations import Equations
from mbdae.compare.problem import Problem, with_models
from mbdae.errors import AccuracyWarning, MbdaeError
from mbdae.extremes.reference import SURE, Reference
from mbdae.extremes.ways import Way
from mbdae.results.result import Result

MET, NEAR, TOLD = "met", "within 3 times", "missed and said so"
SILENT, FAILED, UNKNOWN = "missed silently", "failed loudly", "not judged"
#: verdict -> its meaning, in the order of the legend
VERDICTS = {
    MET: "the error is at most what was asked",
    NEAR: "the error is 1 to 3 times what was asked, and the run did not say so",
    TOLD: "the error is above what was asked, and the run said so",
    SILENT: "the error is more than 3 times what was asked, without warning or error",
    FAILED: "the run stopped, or was refused, with its reason",
    UNKNOWN: "no trustworthy reference: the error of this run is not known",
}
#: ratio of error to accuracy above which a run without warning counts as missed silently; where the reference is uncertain,
#: MARGIN times its uncertainty is subtracted from the error first
SILENCE = 3.0
#: factor on the uncertainty of an uncertain reference, which is subtracted from the error before the comparison with SILENCE; a
#: run that this leaves open is not judged, unless error and uncertainty together are within the accuracy
MARGIN = 10.0


@dataclass(frozen=True)
class Cell:
    """A run at one value of the parameter. error: difference from the reference, in the unit of the measure; estimated: the run's
    own error estimate; cpu_s: CPU time of the run, with the runs that estimate its error, s."""

    value: float
    label: str
    solver: str
    form: str
    model: str | None
    accuracy: float
    t_end: float
    verdict: str
    error: float | None = None
    estimated: float | None = None
    cpu_s: float | None = None
    steps: int = 0
    residuals: int = 0
    warnings: tuple[str, ...] = ()
    failure: str | None = None

    @property
    def told(self) -> bool:
        """Whether the run gave a warning."""
        return bool(self.warnings)


def verdict(error: float, accuracy: float, told: bool, uncertainty: float | None) -> str:
    """The verdict on an error of a run that is known to within `uncertainty` (None: not known); UNKNOWN where it depends on this
    uncertainty. told: whether the run gave a warning."""
    if not math.isfinite(error):
        return TOLD if told else SILENT
    doubt = math.inf if uncertainty is None else uncertainty if uncertainty > SURE * accuracy else 0.0
    if error + doubt <= accuracy:
        return MET
    if error - MARGIN * doubt > SILENCE * accuracy:
        return TOLD if told else SILENT
    if doubt:
        return UNKNOWN
    return TOLD if told else NEAR


def cell(problem: Problem, way: Way, value: float, accuracy: float, reference: Reference) -> Cell:
    """Execute a run at a value and judge it. A run with its own tolerance or step has no error estimate, so it is verified by
    another method."""
    run, models, scene = way.run, way.run or way.models, problem.scene
    assert scene is not None
    facts: dict[str, Any] = {
        "value": value, "label": way.label, "solver": run.solver.label if run else "", "form": run.form.label if run and run.form
        else "", "model": models.model_label if models else None, "accuracy": accuracy,
        "t_end": problem.t_end,
    }  # fmt: skip
    begin = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)
            variant: Any = with_models(scene, models) if models is not None else scene
            r: Result = variant.simulate(problem.t_end, accuracy, solver=run.solver if run else None,
                                         form=run.form if run else None, max_wall=problem.max_wall,
                                         verify=run is not None and run.as_it_is)  # fmt: skip
    except (MbdaeError, np.linalg.LinAlgError, ArithmeticError) as stop:
        name = "" if isinstance(stop, MbdaeError) else f"{type(stop).__name__}: "
        return Cell(**facts, verdict=FAILED, cpu_s=time.process_time() - begin, failure=name + " ".join(str(stop).split()))
    cpu = time.process_time() - begin
    facts |= {"solver": r.info.solver.label, "form": r.info.form, "cpu_s": cpu}
    values = problem.values(r.solution, Equations(r.prepared))
    if reference.values is None:
        error, found = math.nan, UNKNOWN
    else:
        error = problem.error(values, reference.values)
        found = verdict(error, accuracy, bool(r.warnings), reference.uncertainty)
    best = r.accuracy.verified if r.accuracy.verified is not None else r.accuracy.estimated
    known = best if best is not None and math.isfinite(best) else None
    return Cell(**facts, verdict=found, error=error if math.isfinite(error) else None, estimated=known, steps=r.stats.steps,
                residuals=r.stats.residuals, warnings=tuple(" ".join(w.split()) for w in r.warnings))  # fmt: skip
