"""A comparison as plain text, with the cells that its page shows too."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from mbdae.compare.data import ComparisonData
from mbdae.compare.rows import Row

#: largest number of characters in a line of sentences; lines with two neighbouring blanks, as of the table of runs, are not
#: wrapped
WIDTH = 128
MARKS = ("*", "failed")
PARTS = {"derive": "to derive the laws, in a new process", "compile": "to compile their kernels there",
         "start": "of start, rank and equations of the scene there", "compan.": "of the runs that would estimate its error",
         "judge": "of its warnings and the checks after the run"}  # fmt: skip
#: heading and meaning of each column
COLUMNS = {
    "run": "solver, form, joint model and options that differ from their defaults",
    "asked": "accuracy asked of the solver",
    "rtol": "relative tolerance the solver ran with",
    "error": "largest error over the run against the reference",
    "CPU s": "CPU time of the solver in s, the least of its repeats",
    "spread": "largest minus least CPU time of the repeats, s",
    **{name: f"CPU time in s {what}" for name, what in PARTS.items()},
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


def table(w: ComparisonData) -> str:
    """The comparison as text: heading, one line per run, failures with reasons, pairwise differences, verdict."""
    lines = [f"scene '{w.scene}' to t = {w.t_end:g} s", f"error: {w.what}", f"reference: {w.reference}", ""]
    lines += grid([tuple(COLUMNS), *(cells(row) for row in w.runs)])
    front = "* no other run is both cheaper and more accurate, and its error is above the uncertainty of the reference"
    lines += [front, *([w.caution] if w.caution else []), ""]
    lines += failure_lines(w.failures)
    lines += [str(w.pairwise), *grid(pairwise_cells(w)), "", w.verdict, environment_line(w)]
    return "\n".join(part for line in lines for part in _wrapped(line))


def _wrapped(line: str) -> list[str]:
    if len(line) <= WIDTH or "  " in line:
        return [line]
    return textwrap.wrap(line, WIDTH, break_long_words=False, break_on_hyphens=False)


def grid(rows: Sequence[Sequence[str]]) -> list[str]:
    """The lines of a text table from rows of cells; the first column is aligned left, the others right."""
    if not rows:
        return []
    widths = [max(len(row[j]) for row in rows) for j in range(len(rows[0]))]
    lines = []
    for row in rows:
        texts = [c.ljust(n) if j == 0 or c in MARKS else c.rjust(n) for j, (c, n) in enumerate(zip(row, widths, strict=True))]
        lines.append("  ".join(texts).rstrip())
    return lines


def failure_lines(failures: Sequence[Row]) -> list[str]:
    """One line for each different run and reason of failure, with the accuracies at which it failed."""
    reasons: dict[tuple[str, str], list[str]] = {}
    for row in failures:
        reasons.setdefault((row.label, " ".join((row.failure or "").split())), []).append(_number(row.accuracy, ".0e"))
    return [f"failed: {label} asked for {', '.join(asked)}: {reason}" for (label, reason), asked in reasons.items()]


def pairwise_cells(w: ComparisonData) -> list[tuple[str, ...]]:
    """Cells of the table of differences between the tightest runs: heading and lower triangle; empty for fewer than two runs."""
    p = w.pairwise
    if len(p.runs) < 2:
        return []
    lines = [("tightest runs", *(f"({j + 1})" for j in range(len(p.runs) - 1)))]
    for i, (label, asked) in enumerate(zip(p.runs, p.asked, strict=True)):
        shown = [f"{d:.1e}" if j < i else "" for j, d in enumerate(p.differences[i][: len(p.runs) - 1])]
        lines.append((f"({i + 1}) {label}, {asked}", *shown))
    return lines


def environment_line(w: ComparisonData) -> str:
    """A sentence on the CPU time that the comparison took, versions and machine."""
    versions = ", ".join(f"{name} {value}" for name, value in w.environment.items() if name not in ("machine", "cpus"))
    return (f"{w.total_cpu_s:.1f} s of CPU time, {w.cpu_s:.1f} s of it in solvers; {versions}; "
            f"{w.environment['machine']}, {w.environment['cpus']} CPUs")  # fmt: skip


def cells(row: Row) -> tuple[str, ...]:
    """The cells of one run, in the order of COLUMNS."""
    counts = (row.steps, row.rejected, row.residuals, row.jacobians, row.factorisations, row.newton_iterations)
    mark = "failed" if row.failure else "*" if row.pareto else ""
    parts = (row.derive_s, row.compile_s, row.start_s, row.companions_s, row.judgement_s)
    times = (_number(row.cpu_s, ".3f"), _number(row.cpu_spread_s, ".3f"), *(_number(part, ".3f") for part in parts))
    asked = (_number(row.accuracy, ".0e"), _number(row.rtol, ".0e"))
    size = None if row.stored_bytes is None else row.stored_bytes / 1000
    peak = None if row.peak_bytes is None else row.peak_bytes / 1e6
    memory = (_number(size, ".0f"), _number(peak, ".0f"))
    return (row.label, *asked, _number(row.error, ".1e"), *times, *(str(n) for n in counts), *memory, mark)


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)
