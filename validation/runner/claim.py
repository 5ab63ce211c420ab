"""What a claim is: a statement, cases that measure an error, and rows that say whether each is within its tolerance."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from mbdae.errors import AccuracyWarning
from runner.draw import Draw, Parts


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
    """One run of a claim: `measure` does it. `slow` ones take more than a few seconds.

    With `parts` (seeds, names) it is a suite of like runs, of which `mbdae validate` draws a tenth: `measure` takes a list of
    parts, or where `each` is true one of them, which has rows of its own."""

    name: str
    solver: str
    measure: Callable[..., Found | Sequence[Found]]
    slow: bool = False
    parts: Sequence[Any] = ()
    each: bool = False


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

    @classmethod
    def of(cls, data: dict[str, Any]) -> Row:
        """What `to_dict` gave."""
        return cls(**{**data, "error": math.nan if data["error"] is None else data["error"]})


def measure(claim: Claim, cases: Iterable[Case], draw: Draw | None = None) -> list[Row]:
    """All rows of some cases; with `draw` those of the parts it takes of suites, and where it names parts of nothing else."""
    return [row for case in cases for row in (_suite(claim, case, draw) if case.parts else _others(claim, case, draw))]


def _others(claim: Claim, case: Case, draw: Draw | None) -> list[Row]:
    return [] if draw is not None and draw.only else _rows(claim, case)


def _suite(claim: Claim, case: Case, draw: Draw | None) -> list[Row]:
    suite, whole = f"{claim.name}: {case.name}, {case.solver}", Parts(case.parts, len(case.parts))
    parts = whole if draw is None else draw.of(suite, case.parts)
    if case.each:
        single = [Case(f"{case.name}, {part}", case.solver, partial(case.measure, part)) for part in parts]
        return [row for one in single for row in _rows(claim, one)]
    name = f"{len(parts)} {case.name}" if len(parts) == parts.whole else f"{len(parts)} of {parts.whole} {case.name}"
    return _rows(claim, Case(name, case.solver, partial(case.measure, parts)), parts) if parts else []


def _rows(claim: Claim, case: Case, parts: Parts | None = None) -> list[Row]:
    begin = _cpu()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)  # a claim judges them itself, from the result
            found = case.measure()
    except Exception as error:  # a failed run becomes a row, and the others are still measured
        at = "" if parts is None or parts.now is None else f" at {parts.now}"
        found = Found(math.nan, note=f"failed{at}: {type(error).__name__}: {error}")
    spent = _cpu() - begin
    return [_row(claim, case, f, spent) for f in ([found] if isinstance(found, Found) else found)]


def _cpu() -> float:
    """CPU s of this process, and of those it started that have ended."""
    return sum(os.times()[:4])


def _row(claim: Claim, case: Case, found: Found, cpu_s: float) -> Row:
    tolerance = claim.tolerance if found.tolerance is None else found.tolerance
    name = f"{case.name}: {found.quantity}" if found.quantity else case.name
    error = float(found.error)
    return Row(name, case.solver, error, tolerance, found.unit or claim.unit, error <= tolerance, cpu_s, found.note)
