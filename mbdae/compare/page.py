"""A comparison as one HTML page that needs nothing else: picture, tables, verdict, where and with what it was made."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

from mbdae.compare.picture import inline_svg
from mbdae.compare.table import COLUMNS, cells, failure_lines, pairwise_cells

if TYPE_CHECKING:
    from mbdae.compare.comparison import Comparison

STYLE = """
:root { color-scheme: only light; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 84rem; padding: 1rem 1.25rem 2rem; color: #1a1a1a; background: #fff;
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Liberation Sans", sans-serif; overflow-wrap: anywhere; }
h1 { font-size: 1.5rem; line-height: 1.25; margin: .5rem 0; }
h2 { font-size: 1.15rem; margin: 2rem 0 .5rem; }
p, li { max-width: 46rem; }
ul { padding-left: 1.25rem; }
.scroll { overflow-x: auto; width: fit-content; max-width: 100%; border-bottom: 1px solid #999; }
.scroll:focus-visible, button:focus-visible { outline: 2px solid #0072b2; outline-offset: 2px; }
table { border-collapse: collapse; font-size: .875rem; font-variant-numeric: tabular-nums; white-space: nowrap; }
caption { text-align: left; padding-bottom: .4rem; color: #444; }
th, td { padding: .2rem .5rem; text-align: right; border-bottom: 1px solid #e2e2e2; }
th:first-child, td:first-child { text-align: left; padding-left: 0; }
thead th { border-bottom: 1px solid #999; font-weight: 600; vertical-align: bottom; }
tbody th { font-weight: 400; }
tr.front { background: #eef5fb; }
tr.failed td, tr.failed th { color: #8a2b06; }
th button { font: inherit; color: inherit; background: none; border: 0; padding: 0; cursor: pointer; min-height: 24px; }
th button:hover { text-decoration: underline; }
th[aria-sort=ascending] button::after { content: " \\2191"; }
th[aria-sort=descending] button::after { content: " \\2193"; }
figure { margin: 1rem 0; }
figure svg { display: block; width: 100%; height: auto; }
.narrow { display: none; max-width: 30rem; margin: 0 auto; }
.note { color: #444; font-size: .875rem; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .1rem 1rem; font-size: .875rem; }
dd { margin: 0; }
@media (max-width: 700px) { .wide { display: none; } .narrow { display: block; } body { padding: .5rem .9rem 2rem; } }
@media print {
  body { max-width: none; padding: 0; font-size: 10pt; }
  .scroll { overflow: visible; } table { font-size: 7pt; } th, td { padding: 1pt 3pt; }
  .wide { display: block; } .narrow { display: none; } figure, tr { break-inside: avoid; } h2 { break-after: avoid; }
}
"""
#: sorts a table by the column whose heading is pressed; numbers as numbers, what is unknown last
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


def page(w: Comparison) -> str:
    """The whole page."""
    title = f"Solvers compared: {w.scene}"
    parts = [_head(w, title), _verdict(w), _failures(w), _picture(w), _runs(w), _reference(w), _pairwise(w), _environment(w)]
    return (f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">\n'
            f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n"
            f"{''.join(part for part in parts if part)}</main>\n<script>{SCRIPT}</script>\n</body>\n</html>\n")  # fmt: skip


def _head(w: Comparison, title: str) -> str:
    labels = dict.fromkeys(row.label for row in w.runs)
    return (f"<h1>{escape(title)}</h1>\n<p>{len(labels)} methods, {len(w.runs)} runs to t = {w.t_end:g} s. "
            f"Error: {escape(w.what)}.</p>\n")  # fmt: skip


def _verdict(w: Comparison) -> str:
    return _section("verdict", "Reached at least cost", _list(w.choices))


def _failures(w: Comparison) -> str:
    if not w.failures:
        return ""
    told = [line.removeprefix("failed: ") for line in failure_lines(w.failures)]
    return _section("failures", "Failed runs", _list(told))


def _picture(w: Comparison) -> str:
    title = escape(f"Work and precision of {len(w.runs)} runs: error over CPU time and over residual evaluations, "
                   f"both logarithmic; the numbers are in the table of runs")  # fmt: skip
    return (f'<figure>\n<div class="wide">{inline_svg(w, False, title, "wide")}</div>\n'
            f'<div class="narrow">{inline_svg(w, True, title, "narrow")}</div>\n</figure>\n')  # fmt: skip


def _runs(w: Comparison) -> str:
    names = list(COLUMNS)
    names[-1] = "front"
    titles = zip(names, COLUMNS.values(), strict=True)
    head = "".join(f'<th scope="col" title="{escape(told)}"><button type="button">{escape(name)}</button></th>'
                   for name, told in titles)  # fmt: skip
    rows = []
    for row in w.runs:
        kind = ' class="failed"' if row.failure else ' class="front"' if row.pareto else ""
        rows.append(_row(cells(row), kind))
    meaning = "; ".join(f"{name}: {told}" for name, told in COLUMNS.items() if name not in ("run", ""))
    note = f"front: {COLUMNS['']}; {meaning}."
    table = _table("runs", head, rows, "Every run; a heading sorts")
    return _section("runs", "Runs", table + f'<p class="note">{escape(note)}</p>\n')


def _reference(w: Comparison) -> str:
    r = w.reference
    cost = f" ({r.steps} steps, {r.cpu_s:.2f} s of CPU time)" if r.steps is not None and r.cpu_s is not None else ""
    lines = [f"Measured against: {r.label}{cost}."]
    if r.difference is not None:
        lines.append(f"Confirmed by a second method: {r.confirmed_by}, which differs by {r.difference:.1e}.")
    if w.caution:
        lines.append(w.caution)
    if r.note:
        lines.append(f"Caution: {r.note}.")
    return _section("reference", "Reference", _list(lines))


def _pairwise(w: Comparison) -> str:
    lines = pairwise_cells(w)
    matrix = ""
    if lines:
        head = "".join(f'<th scope="col">{escape(text)}</th>' for text in lines[0])
        matrix = _table("pairs", head, [_row(line) for line in lines[1:]], "Largest differences between the tightest runs")
    return _section("pairs", "Cross-check", f"<p>{escape(str(w.pairwise))}</p>\n{matrix}")


def _environment(w: Comparison) -> str:
    facts = {"CPU time": f"{w.total_cpu_s:.1f} s, {w.cpu_s:.1f} s of it in solvers"} | w.environment
    entries = "".join(f"<dt>{escape(name)}</dt><dd>{escape(str(value))}</dd>" for name, value in facts.items())
    return _section("made", "Made with", f"<dl>{entries}</dl>\n")


def _section(name: str, title: str, content: str) -> str:
    return f'<section aria-labelledby="{name}"><h2 id="{name}">{title}</h2>\n{content}</section>\n'


def _list(lines: Sequence[str]) -> str:
    return "<ul>" + "".join(f"<li>{escape(line)}</li>\n" for line in lines) + "</ul>\n"


def _row(texts: Sequence[str], attributes: str = "") -> str:
    first, *others = (escape(text) for text in texts)
    return f'<tr{attributes}><th scope="row">{first}</th>{"".join(f"<td>{text}</td>" for text in others)}</tr>\n'


def _table(labelled_by: str, head: str, rows: Sequence[str], caption: str) -> str:
    """A table that scrolls in its own box, by keyboard too."""
    return (f'<div class="scroll" role="region" aria-labelledby="{labelled_by}" tabindex="0"><table>'
            f"<caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead>\n<tbody>\n{''.join(rows)}</tbody>"
            f"</table></div>\n")  # fmt: skip
