"""A comparison as one HTML page that loads no other file: picture, tables, verdict, versions and machine."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from mbdae.compare.data import ComparisonData
from mbdae.compare.html import bullets, document, headings, made_with, row, section, table
from mbdae.compare.picture import inline_svg
from mbdae.compare.table import COLUMNS, cells, failure_lines, pairwise_cells
from mbdae.notation import counted

#: sorts a table by the column whose heading is clicked, numbers by value and unknown ones last
SCRIPT = """
for (const button of document.querySelectorAll("th button")) {
  button.addEventListener("click", () => {
    const head = button.parentElement, body = head.closest("table").tBodies[0];
    const up = head.getAttribute("aria-sort") !== "ascending", column = head.cellIndex;
    const value = (row) => row.cells[column].textContent;
    const number = (text) => text === "*" ? 0 : Number.isNaN(parseFloat(text)) ? Infinity : parseFloat(text);
    const key = (row) => number(value(row));
    const order = (a, b) => column === 0 ? value(a).localeCompare(value(b)) : key(a) === key(b) ? 0 : key(a) - key(b);
    const rows = [...body.rows].sort((a, b) => up ? order(a, b) : order(b, a));
    for (const other of head.parentElement.cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    body.append(...rows);
  });
}
"""


def page(w: ComparisonData) -> str:
    """The HTML page of a comparison."""
    failures = [line.removeprefix("failed: ") for line in failure_lines(w.failures)]
    parts = [
        _summary(w), section("verdict", "Reached at least cost", bullets(w.choices)),
        section("failures", "Failed runs", bullets(failures)) if failures else "", _picture(w), _runs(w), _reference(w),
        _pairwise(w), made_with(f"{w.total_cpu_s:.1f} s, {w.cpu_s:.1f} s of it in solvers", w.environment),
    ]  # fmt: skip
    return document(f"Solvers compared: {w.scene}", "", parts, SCRIPT)


def _summary(w: ComparisonData) -> str:
    labels = {run.label for run in w.runs}
    number = f"{counted(len(labels), 'method')}, {counted(len(w.runs), 'run')}"
    return f"<p>{number} to t = {w.t_end:g} s. Error: {escape(w.what)}.</p>\n"


def _picture(w: ComparisonData) -> str:
    title = escape(f"Work and precision of {counted(len(w.runs), 'run')}: error over CPU time and over residual evaluations, "
                   f"both logarithmic; the numbers are in the table of runs")  # fmt: skip
    return (f'<figure>\n<div class="wide">{inline_svg(w, False, title, "wide")}</div>\n'
            f'<div class="narrow">{inline_svg(w, True, title, "narrow")}</div>\n</figure>\n')  # fmt: skip


def _runs(w: ComparisonData) -> str:
    names = [*list(COLUMNS)[:-1], "front"]
    head = "".join(f'<th scope="col" title="{escape(meaning)}"><button type="button">{escape(name)}</button></th>'
                   for name, meaning in zip(names, COLUMNS.values(), strict=True))  # fmt: skip
    kinds = [' class="failed"' if run.failure else ' class="front"' if run.pareto else "" for run in w.runs]
    rows = [_row(cells(run), kind) for run, kind in zip(w.runs, kinds, strict=True)]
    meanings = "; ".join(f"{name}: {meaning}" for name, meaning in COLUMNS.items() if name not in ("run", ""))
    note = escape(f"front: {COLUMNS['']}; {meanings}.")
    return section("runs", "Runs", table("runs", head, rows, "Every run; a heading sorts") + f'<p class="note">{note}</p>\n')


def _reference(w: ComparisonData) -> str:
    r = w.reference
    cost = f" ({r.steps} steps, {r.cpu_s:.2f} s of CPU time)" if r.steps is not None and r.cpu_s is not None else ""
    lines = [f"Measured against: {r.label}{cost}."]
    if r.difference is not None:
        lines.append(f"Confirmed by a second method: {r.confirmed_by}, which differs by {r.difference:.1e}.")
    if w.caution:
        lines.append(w.caution)
    if r.note:
        lines.append(f"Caution: {r.note}.")
    return section("reference", "Reference", bullets(lines))


def _pairwise(w: ComparisonData) -> str:
    lines = pairwise_cells(w)
    matrix = ""
    if lines:
        rows = [_row(line) for line in lines[1:]]
        matrix = table("pairs", headings(lines[0]), rows, "Largest differences between the tightest runs")
    return section("pairs", "Cross-check", f"<p>{escape(str(w.pairwise))}</p>\n{matrix}")


def _row(texts: Sequence[str], attributes: str = "") -> str:
    return row(texts[0], [f"<td>{escape(text)}</td>" for text in texts[1:]], attributes)
