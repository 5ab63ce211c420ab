"""A comparison as data: its rows, their pairwise differences, what follows from both, and its text."""

from __future__ import annotations

import itertools
import json
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from mbdae.compare.measures import Reference, decision, reaches, seconds
from mbdae.engines import Converged, ladders
from mbdae.study import Study, grid
from mbdae.system.base import Array
from mbdae.values import flag, number, option

# -- One row per solver run, from which table, picture and JSON are made


@dataclass(frozen=True)
class Row:
    """One solver run. `error` in the unit of the first measure, `errors` by the name of every measure; None where unknown.

    cpu_s: CPU time of the solver's call alone, s, the median of its repeats; cpu_spread_s: distance of their quartiles, and what
    the clock does not resolve; cpu_first_s: of the first of them; call_s: of a whole call of `simulate` in a process that knows
    the kernels. For a scene there are also, measured in a process with empty caches: derive_s (laws and
    their derivatives), compile_s (kernels), start_s (start, rank and equations of the scene); companions_s: the runs by which
    `simulate` estimates the error of this one; judgement_s: warnings and checks after the run.
    accuracy, rtol: asked of the solver, None where its step is constant; stored_bytes: size of the stored accepted steps
    (t, y, y'), most of the memory of a finished run; peak_bytes: largest resident size of the whole process during the run,
    None where the system does not measure it; failure: why it did not finish; pareto: whether no other run was at least as
    accurate and as cheap, and the error is above the uncertainty of the reference; loose: joint models in words where they model
    something else than the scene as stated, whose error is that against a reference of their own; estimates: by the name of every
    quantity that was asked for what its run estimates its error to be, over its largest value; chosen: whether `simulate`
    chose the solver, whose whole call was measured; told: its warnings.

    Of another program: engine: its name and version; setting: what the run was asked for, whose value is rtol too; order: by
    which the error falls with the step as theory has it; soft: why it cannot converge to the scene; skipped: why the run was not
    made.
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
    call_s: float | None = None
    cpu_first_s: float | None = None
    errors: dict[str, float] = field(default_factory=dict)
    loose: str = ""
    chosen: bool = False
    told: str = ""
    engine: str = ""
    setting: str = ""
    order: float | None = None
    soft: str = ""
    skipped: str = ""
    estimates: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        parts = (self.start_s, self.cpu_s, self.companions_s, self.judgement_s)
        if self.start_s is not None and self.failure is None:
            object.__setattr__(self, "call_s", sum(part or 0.0 for part in parts))

    @property
    def measured(self) -> tuple[float, float] | None:
        """Error and CPU time (s); None for a run that did not finish."""
        return (self.error, self.cpu_s) if self.error is not None and self.cpu_s is not None and not self.failure else None


def with_front(rows: Sequence[Row], uncertainty: float = 0.0) -> tuple[Row, ...]:
    """The rows with the Pareto front of error and CPU time marked; errors below the reference's uncertainty are not on it."""
    known = [row.measured for row in rows if row.measured is not None and not row.loose]
    front = {(error, cpu) for error, cpu in known if (error > uncertainty or not uncertainty)
             and not any(e <= error and c <= cpu and (e, c) != (error, cpu) for e, c in known)}
    return tuple(replace(row, pareto=row.measured in front and not row.loose) for row in rows)


def asked_for(accuracy: float | None, setting: str = "") -> str:
    """The accuracy asked of a run, in words; None: its setting, or the solver's own tolerance or step."""
    return setting or "its own setting" if accuracy is None else f"{accuracy:.0e}"


# -- Differences between all pairs of runs, each at its tightest accuracy; they do not depend on the reference


@dataclass(frozen=True)
class TightestRun:
    """Of the runs with the same label (solver, form, model) that have finished so far, the one with the smallest tolerance: its
    label, accuracy asked, rtol, and values that are compared."""

    label: str
    asked: str
    rtol: float | None
    values: Array  #: values (nt, ...) of the run that are compared


@dataclass(frozen=True)
class Pairwise:
    """Largest difference over time of every pair of runs, in the unit of the measure; `differences` is symmetric."""

    runs: tuple[str, ...]  #: label of each run
    asked: tuple[str, ...]  #: accuracy that each run was asked for
    differences: tuple[tuple[float, ...], ...]

    @property
    def largest(self) -> tuple[float, str, str] | None:
        """The largest difference and the labels of its two runs; None where fewer than two runs finished."""
        pairs = [(d, self.runs[i], self.runs[j]) for i, row in enumerate(self.differences) for j, d in enumerate(row[:i])]
        return max(pairs) if pairs else None

    def __str__(self) -> str:
        if self.largest is None:
            return "Fewer than two runs of mbdae finished: there is nothing to cross-check."
        d, a, b = self.largest
        return f"At the tightest accuracy no two runs differ by more than {d:.1e}, in the unit of the error ({b} and {a})."


def tightest(tightest_runs: dict[str, TightestRun], row: Row, values: Array) -> None:
    """Store the values of a run in `tightest_runs`, unless it holds a run with the same label and a smaller tolerance."""
    before = tightest_runs.get(row.label)
    if before is None or before.rtol is None or row.rtol is None or row.rtol <= before.rtol:
        tightest_runs[row.label] = TightestRun(row.label, asked_for(row.accuracy), row.rtol, values)


def pairwise(tightest_runs: Sequence[TightestRun], error: Callable[[Array, Array], float]) -> Pairwise:
    """Differences of all pairs of runs; error: function of the values of two runs that returns their largest difference."""
    n = len(tightest_runs)
    table = np.zeros((n, n))
    for i in range(n):
        for j in range(i):
            table[i, j] = table[j, i] = error(tightest_runs[i].values, tightest_runs[j].values)
    differences = tuple(tuple(float(d) for d in row) for row in table)
    return Pairwise(tuple(f.label for f in tightest_runs), tuple(f.asked for f in tightest_runs), differences)


# -- Data of a comparison: its rows, the reference of their errors, and what follows from both


#: largest number of characters in a line of sentences; lines with two neighbouring blanks, as of the table of runs, are not
#: wrapped
WIDTH = 128


@dataclass(frozen=True)
class ComparisonData(Study):
    """Rows (one per solver run), the reference they were measured against, and differences between the runs."""

    measure: str | None
    what: str  #: definition of the error, in words
    reference: Reference
    accuracies: tuple[float, ...]
    runs: tuple[Row, ...]
    pairwise: Pairwise
    units: dict[str, str]  #: unit of the error by the name of every measure, "" for a ratio; runs are ranked by the first
    models: dict[str, dict[str, float]]  #: what other joint models change, by their label and the name of every measure
    tick: float  #: resolution of the clock of CPU time, s
    cpu_s: float  #: CPU time in all solver calls, s, repeats and reference included
    total_cpu_s: float  #: CPU time of the whole comparison, s
    environment: dict[str, str | int]

    @property
    def failures(self) -> tuple[Row, ...]:
        """Runs that did not finish."""
        return tuple(row for row in self.runs if row.failure)

    def cheapest(self, accuracy: float) -> Row | None:
        """The run with an error of at most `accuracy` (unit of the measure) in the least CPU time; None where there is none."""
        wanted = option("accuracy", accuracy, number, "give a positive number such as 1e-6", above=0)
        reached = [row for row in self.runs if reaches(row, wanted) and not row.chosen]
        return min(reached, key=lambda row: row.cpu_s or 0.0, default=None)

    @property
    def decision(self) -> str:
        """A paragraph: which run for which accuracy, at what cost, beside which the clock does not tell it apart; what joint
        models change; which methods lose digits of a quantity."""
        return decision(self)

    @property
    def converged(self) -> tuple[Converged, ...]:
        """What the ladder of every method of other programs comes to."""
        return ladders([row for row in self.runs if row.engine], self.reference.difference or 0.0)

    @property
    def caution(self) -> str | None:
        """A sentence where errors are smaller than the uncertainty of the reference; else None."""
        known = self.reference.difference
        if known is None or not any(row.error is not None and row.error < known for row in self.runs):
            return None
        return f"Errors below {known:.1e} are within the reference's own uncertainty."

    def to_dict(self) -> dict[str, Any]:
        """All data as dictionaries, lists, texts and numbers; values that are not known are None."""
        best = [{"accuracy": a, "run": row.label if (row := self.cheapest(a)) else None} for a in self.accuracies]
        data = {
            "scene": self.scene, "t_end": self.t_end, "measure": self.measure, "error_is": self.what,
            "reference": asdict(self.reference), "accuracies": list(self.accuracies),
            "runs": [asdict(row) for row in self.runs], "cheapest": best, "pairwise": asdict(self.pairwise),
            "decision": self.decision, "converged": [asdict(one) for one in self.converged],
            "measures": self.units, "models": self.models, "tick_s": self.tick,
            "cpu_s": self.cpu_s, "total_cpu_s": self.total_cpu_s, "environment": self.environment,
        }
        return dict(json.loads(json.dumps(data)))

    def table(self, all_columns: bool = False) -> str:
        """The decision and the rows as plain text, with reference, failures and pairwise differences; all_columns: of the rows
        also where their CPU time goes, evaluations and memory."""
        whole = option("all_columns", all_columns, flag, "give True or False")
        lines = [f"scene '{self.scene}' to t = {self.t_end:g} s", self.decision, ""]
        lines += grid([tuple(COLUMNS), *(cells(row) for row in self.runs)] if whole else self.short(), MARKS)
        lines += [f"{name}: {meaning}" for name, meaning in (COLUMNS if whole else self.legend).items() if name]
        lines += [f"reference: {self.reference}", *([self.caution] if self.caution else []), "", *failure_lines(self.failures),
                  str(self.pairwise), *grid(pairwise_cells(self.pairwise)), ""]
        versions = ", ".join(f"{name} {value}" for name, value in self.environment.items() if name not in ("machine", "cpus"))
        lines.append(f"{self.total_cpu_s:.1f} s of CPU time, {self.cpu_s:.1f} s of it in solvers; {versions}; "
                     f"{self.environment['machine']}, {self.environment['cpus']} CPUs")
        wrapped = [[line] if len(line) <= WIDTH or "  " in line else
                   textwrap.wrap(line, WIDTH, break_long_words=False, break_on_hyphens=False) for line in lines]
        return "\n".join(itertools.chain(*wrapped))

    def short(self) -> list[tuple[str, ...]]:
        """The table of a terminal: heading and rows, with the columns that decide."""
        more = list(self.units)[1:]
        head = ("run", "asked", "error", *more, "solver", "+-", "call", "steps", "")
        rows = []
        for row in self.runs:
            errors = [_with_estimate(row, name, row.errors.get(name)) for name in more]
            times = (seconds(row.cpu_s), seconds(row.cpu_spread_s), seconds(row.call_s))
            error = _with_estimate(row, next(iter(self.units)), row.error)
            first = (row.label, row.setting or _number(row.accuracy, ".0e"), error)
            rows.append((*first, *errors, *times, str(row.steps or "-"), mark(row)))
        return [head, *rows]

    @property
    def legend(self) -> dict[str, str]:
        """Meanings of the columns of `short`."""
        more = {name: f"largest difference of {name}" + (f", {unit}" if unit else "")
                for name, unit in list(self.units.items())[1:]}
        found = {"error": self.what, **more, "solver": COLUMNS["CPU"], "+-": COLUMNS["spread"], "call": COLUMNS["call"],
                 "*": "no other run is both cheaper and more accurate, and its error is above the uncertainty of the reference"}
        if any(row.estimates for row in self.runs):
            found["(...)"] = "what the run itself estimates this error to be"
        if any(row.loose for row in self.runs):
            found["model"] = "it models something else than the scene; errors are those against a reference of its own"
        return found


MARKS = ("*", "failed", "model", "not run")


def mark(row: Row) -> str:
    """The mark of a run in the last column."""
    return "failed" if row.failure else "not run" if row.skipped else "*" if row.pareto else "model" if row.loose else ""


PARTS = {"derive": "to derive the laws, in a new process", "compile": "to compile their kernels there",
         "start": "of start, rank and equations of the scene there", "compan.": "of the runs that would estimate its error",
         "judge": "of its warnings and the checks after the run"}
#: heading and meaning of each column
COLUMNS = {
    "run": "solver, form, joint model and options that differ from their defaults",
    "asked": "accuracy asked of the solver",
    "rtol": "relative tolerance the solver ran with",
    "error": "largest error over the run against the reference",
    "estimate": "what the run estimates the errors of the quantities asked for to be, the largest",
    "CPU": "CPU time of the solver, the median of its repeats",
    "spread": "distance of the quartiles of the repeats, and what the clock does not resolve",
    "call": "CPU time of a whole call in a process that knows the kernels: start, solver, companions, checks",
    **{name: f"CPU time {what}" for name, what in PARTS.items()},
    "steps": "accepted steps",
    "rejected": "rejected steps",
    "residuals": "evaluations of the equations",
    "Jacobians": "evaluations of the Jacobian",
    "factoris.": "factorisations",
    "Newton": "Newton iterations",
    "kB": "memory of the accepted steps (t, y, y')",
    "MB": "peak memory of the whole process during the run",
    "": "* no other run is both cheaper in CPU time and more accurate, and its error is known",
}


def failure_lines(failures: Sequence[Row]) -> list[str]:
    """One line for each different run and reason of failure, with the accuracies at which it failed."""
    reasons: dict[tuple[str, str], list[str]] = {}
    for row in failures:
        reasons.setdefault((row.label, " ".join((row.failure or "").split())), []).append(
            row.setting or _number(row.accuracy, ".0e"))
    return [f"failed: {label}{' asked for ' * (asked != ['-'])}{', '.join(a for a in asked if a != '-')}: {reason}"
            for (label, reason), asked in reasons.items()]


def pairwise_cells(p: Pairwise) -> list[tuple[str, ...]]:
    """Cells of the table of differences between the tightest runs: heading and lower triangle; empty for fewer than two runs."""
    if len(p.runs) < 2:
        return []
    lines = [("tightest runs", *(f"({j + 1})" for j in range(len(p.runs) - 1)))]
    for i, (label, asked) in enumerate(zip(p.runs, p.asked, strict=True)):
        shown = [f"{d:.1e}" if j < i else "" for j, d in enumerate(p.differences[i][: len(p.runs) - 1])]
        lines.append((f"({i + 1}) {label}, {asked}", *shown))
    return lines


def cells(row: Row) -> tuple[str, ...]:
    """The cells of one run, in the order of COLUMNS."""
    counts = (row.steps, row.rejected, row.residuals, row.jacobians, row.factorisations, row.newton_iterations)
    parts = (row.derive_s, row.compile_s, row.start_s, row.companions_s, row.judgement_s)
    times = tuple(map(seconds, (row.cpu_s, row.cpu_spread_s, row.call_s, *parts)))
    asked = (row.setting or _number(row.accuracy, ".0e"), _number(row.rtol, ".0e"))
    size = None if row.stored_bytes is None else row.stored_bytes / 1000
    peak = None if row.peak_bytes is None else row.peak_bytes / 1e6
    estimate = max(row.estimates.values(), default=None)
    memory = (_number(size, ".0f"), _number(peak, ".0f"))
    errors = (_number(row.error, ".1e"), _number(estimate, ".1e"))
    return (row.label, *asked, *errors, *times, *(str(n) for n in counts), *memory, mark(row))


def _with_estimate(row: Row, name: str, error: float | None) -> str:
    """The error of a measure and, in brackets, what the run estimates of it where it was asked for."""
    return _number(error, ".1e") + (f" ({_number(row.estimates[name], '.1e')})" if name in row.estimates else "")


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)
