"""One row per solver run, from which table, picture and JSON are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Row:
    """One solver run. `error` in the unit of the measure, `cpu_s` and `cpu_spread_s` in s of CPU time; None where unknown.

    cpu_s: of the solver's call alone. For a scene there are also, measured in a process with empty caches: derive_s (laws and
    their derivatives), compile_s (kernels), start_s (start, rank and equations of the scene); companions_s: the runs by which
    `simulate` estimates the error of this one; judgement_s: warnings and checks after the run.
    accuracy, rtol: asked of the solver, None where its step is constant; stored_bytes: size of the stored accepted steps
    (t, y, y'), most of the memory of a finished run; peak_bytes: largest resident size of the whole process during the run,
    None where the system does not measure it; failure: why it did not finish; pareto: whether no other run was at least as
    accurate and as cheap, and the error is above the uncertainty of the reference.
    """

    label: str
    solver: str
    form: str
    model: str | None
    accuracy: float | None
    rtol: float | None = None
    error: float | None = None
    cpu_s: float | None = None
    cpu_spread_s: float | None = None
    steps: int = 0
    rejected: int = 0
    residuals: int = 0
    jacobians: int = 0
    factorisations: int = 0
    newton_iterations: int = 0
    stored_bytes: int | None = None
    peak_bytes: int | None = None
    failure: str | None = None
    pareto: bool = False
    derive_s: float | None = None
    compile_s: float | None = None
    start_s: float | None = None
    companions_s: float | None = None
    judgement_s: float | None = None

    @property
    def measured(self) -> tuple[float, float] | None:
        """Error and CPU time (s); None for a run that did not finish."""
        return (self.error, self.cpu_s) if self.error is not None and self.cpu_s is not None and not self.failure else None


def with_front(rows: Sequence[Row], uncertainty: float = 0.0) -> tuple[Row, ...]:
    """The rows with the Pareto front of error and CPU time marked; errors below the reference's uncertainty are not on it."""
    return tuple(replace(row, pareto=_undominated(row, rows, uncertainty)) for row in rows)


def _undominated(row: Row, rows: Sequence[Row], uncertainty: float) -> bool:
    if row.measured is None:
        return False
    error, cpu = row.measured
    if error <= uncertainty and uncertainty:
        return False
    others = [r.measured for r in rows if r is not row and r.measured is not None]
    return not any(e <= error and c <= cpu and (e, c) != (error, cpu) for e, c in others)


def cheapest(rows: Sequence[Row], wanted: float) -> Row | None:
    """The run with the least CPU time among those whose error is at most `wanted`; None where there is none."""
    reached = [(r.measured[1], i) for i, r in enumerate(rows) if r.measured is not None and r.measured[0] <= wanted]
    return rows[min(reached)[1]] if reached else None


def asked_for(accuracy: float | None) -> str:
    """The accuracy asked of a run, in words; None: the solver's own tolerance or step."""
    return "its own setting" if accuracy is None else f"{accuracy:.0e}"
