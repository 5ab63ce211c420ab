"""What a claim is: a statement, cases that measure an error, and rows that say whether each is within its tolerance."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from mbdae.errors import AccuracyWarning


@dataclass(frozen=True)
class Claim:
    """What is claimed, its headline tolerance with its unit, and where the reference comes from."""

    name: str
    statement: str
    tolerance: float
    unit: str
    origin: str


@dataclass(frozen=True)
class Found:
    """One measured error; tolerance and unit default to those of the claim, `quantity` names one of several of a run."""

    error: float
    tolerance: float | None = None
    unit: str = ""
    quantity: str = ""
    note: str = ""


@dataclass(frozen=True)
class Case:
    """One run of a claim: `measure` does it. `slow` ones take more than a few seconds."""

    name: str
    solver: str
    measure: Callable[[], Found | Sequence[Found]]
    slow: bool = False


@dataclass(frozen=True)
class Row:
    """A measured error beside its tolerance; the error of a run that failed is nan, its reason in `note`."""

    case: str
    solver: str
    error: float
    tolerance: float
    unit: str
    met: bool
    cpu_s: float
    note: str = ""

    def to_dict(self) -> dict[str, object]:
        """For JSON, without nan."""
        return {**vars(self), "error": self.error if math.isfinite(self.error) else None}


def measure(claim: Claim, cases: Iterable[Case]) -> list[Row]:
    """All rows of some cases."""
    return [row for case in cases for row in _rows(claim, case)]


def _rows(claim: Claim, case: Case) -> list[Row]:
    begin = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)  # a claim judges them itself, from the result
            found = case.measure()
    except Exception as error:  # a failed run becomes a row, and the others are still measured
        found = Found(math.nan, note=f"failed: {type(error).__name__}: {error}")
    spent = time.process_time() - begin
    return [_row(claim, case, f, spent) for f in ([found] if isinstance(found, Found) else found)]


def _row(claim: Claim, case: Case, found: Found, cpu_s: float) -> Row:
    tolerance = claim.tolerance if found.tolerance is None else found.tolerance
    name = f"{case.name}: {found.quantity}" if found.quantity else case.name
    error = float(found.error)
    return Row(name, case.solver, error, tolerance, found.unit or claim.unit, error <= tolerance, cpu_s, found.note)
