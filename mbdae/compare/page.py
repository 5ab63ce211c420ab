"""A comparison as one HTML page that loads no other file: picture, tables, verdict, versions and machine."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Sequence
from html import escape
from typing import Any

from mbdae.compare.measures import amount
from mbdae.compare.table import COLUMNS, ComparisonData, Row, cells, failure_lines, pairwise_cells
from mbdae.documents.blocks import escaped
from mbdae.notation import counted, picture
from mbdae.show.plots import COLOURS, checked, given_axes, style, written
from mbdae.study import bullets, document, headings, html_row, html_table, made_with, section

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
    number = f"{counted(len({run.label for run in w.runs}), 'method')}, {counted(len(w.runs), 'run')}"
    failures = [line.removeprefix("failed: ") for line in failure_lines(w.failures)]
    title = escape(f"Work and precision of {counted(len(w.runs), 'run')}: error over CPU time and over residual evaluations, "
                   f"both logarithmic; the numbers are in the table of runs")
    parts = [
        section("decision", "Decision", f"<p>{escape(w.decision)}</p>\n"),
        f"<p>{number} to t = {w.t_end:g} s. Error: {escape(w.what)}.</p>\n",
        section("failures", "Failed runs", bullets(failures)) if failures else "",
        f'<figure>\n<div class="wide">{inline_svg(work_precision(w), title, "wide")}</div>\n'
        f'<div class="narrow">{inline_svg(work_precision(w, stacked=True), title, "narrow")}</div>\n</figure>\n',
        _runs(w), _models(w), _reference(w), _pairwise(w),
        made_with(f"{w.total_cpu_s:.1f} s, {w.cpu_s:.1f} s of it in solvers", w.environment),
    ]
    return document(f"Solvers compared: {w.scene}", "", parts, SCRIPT)


def _runs(w: ComparisonData) -> str:
    told = zip(COLUMNS, zip(*map(cells, w.runs), strict=True), strict=True)
    columns = {name: column for name, column in told if {*column} != {"-"}}
    head = "".join(f'<th scope="col" title="{escape(COLUMNS[name])}"><button type="button">{name or "front"}</button></th>'
                   for name in columns)
    kinds = [' class="failed"' if run.failure else ' class="front"' if run.pareto else "" for run in w.runs]
    rows = [_row(row, kind) for row, kind in zip(zip(*columns.values(), strict=True), kinds, strict=True)]
    meanings = "; ".join(f"{name}: {COLUMNS[name]}" for name in columns if name not in ("run", ""))
    note = escape(f"front: {COLUMNS['']}; {meanings}.")
    return section("runs", "Runs", html_table("runs", head, rows, "Every run; a heading sorts") + f'<p class="note">{note}</p>\n')


def _models(w: ComparisonData) -> str:
    """What other joint models change, each measure in its own unit: differences of models, no errors of methods."""
    if not w.models:
        return ""
    loose = {row.loose for row in w.runs}
    rows = [html_row(name, [f"<td>{amount(found[m], unit) if m in found else '-'}</td>" for m, unit in w.units.items()]
                     + [f"<td>{'another model' if name in loose else 'the same model'}</td>"])
            for name, found in w.models.items()]
    note = ("Largest differences from the scene as stated. Ideal joints model the same, so that their methods alone differ; for "
            "joints with clearance, references are compared.")
    return section("models", "Joint models", html_table("models", headings(("joints", *w.units, "")), rows)
                   + f'<p class="note">{note}</p>\n')


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
    matrix = ""
    if lines := pairwise_cells(w.pairwise):
        matrix = html_table("pairs", headings(lines[0]), [_row(line) for line in lines[1:]],
                            "Largest differences between the tightest runs")
    return section("pairs", "Cross-check", f"<p>{escape(str(w.pairwise))}</p>\n{matrix}")


def _row(texts: Sequence[str], attributes: str = "") -> str:
    return html_row(texts[0], [f"<td>{escape(text)}</td>" for text in texts[1:]], attributes)


# -- Work-precision diagram: error over CPU time and over residual evaluations, readable in grey, with reasons of failed runs


MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "h", "*", "d", "8")
#: colours added to those of other pictures, so that up to 14 methods have different ones
FURTHER = ("#882255", "#999933", "#44AA99", "#661100", "#6699CC", "#AA4499", "#777777")
PANELS = (("cpu_s", "CPU time [s]"), ("residuals", "residual evaluations"))
FRONT = "filled: no other run is both cheaper in CPU time and more accurate, and the error is above the reference's uncertainty"
BELOW = "below the reference's own uncertainty"
LETTERS = 13.5  #: number of characters of small text per inch, by which legend entries are wrapped


def work_precision(w: ComparisonData, path: Any = None, stacked: bool = False, ax: Any = None) -> Any:
    """Two panels, side by side, stacked, or axes that are given, one line per run; filled markers lie on the Pareto front of
    error and CPU time."""
    from mbdae.show import Figure

    labels = list(dict.fromkeys(row.label for row in w.runs))
    names = [_name(label, [row for row in w.runs if row.label == label]) for label in labels]
    width = 3.9 if stacked else 9.0
    columns, names = _legend_shape([*names, BELOW], width)
    entry_lines = sum(name.count("\n") + 1 for name in names) / columns
    if ax is None:
        figure = Figure(figsize=(width, (6.6 if stacked else 3.9) + 0.18 * entry_lines), layout="constrained")
        axes = figure.subplots(2, 1) if stacked else figure.subplots(1, 2, sharey=True)
    else:
        axes = given_axes(ax, 2)
        figure = axes[0].figure
    for axis, (work, title) in zip(axes, PANELS, strict=True):
        for i, label in enumerate(labels):
            _line(axis, [row for row in w.runs if row.label == label and not row.loose], work, i, names[i])
        ticks(axis)
        axis.set_xlabel(title)
        axis.grid(True, which="major", color="0.9")
        axis.spines[["top", "right"]].set_visible(False)
        if w.reference.difference:
            low = axis.get_ylim()[0]
            if w.reference.difference > low:
                axis.axhspan(low, w.reference.difference, color="0.94", zorder=0, label=BELOW)
                axis.set_ylim(bottom=low)
    told = escaped(f"error: {w.what}") if w.measure is not None else "error of the whole motion"
    for axis in axes if stacked else axes[:1]:
        axis.set_ylabel("\n".join(textwrap.wrap(told, 48)))
    head = escaped(f"{w.scene}, to t = {w.t_end:g} s")
    entitle = axes[0].set_title if ax is not None else figure.suptitle
    entitle("\n".join(textwrap.wrap(head, int(width * 11))), fontsize="medium")
    handles, texts = axes[0].get_legend_handles_labels()
    told = "\n".join(textwrap.wrap(FRONT, int(width * LETTERS)))
    look = {"frameon": False, "fontsize": "small", "title": told, "title_fontsize": "small"}
    if ax is None:
        figure.legend(handles, texts, loc="outside lower center", ncols=columns, **look)
    else:
        axes[1].legend(handles, texts, **look)
    return written(figure, path, "compare")


def inline_svg(figure: Any, title: str, name: str) -> str:
    """A figure as an <svg> element for a page. title: its text for screen readers; name: prefix of the ids in it, so that two
    diagrams on a page have different ones."""
    import matplotlib

    out = io.StringIO()
    nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    with matplotlib.rc_context({"svg.hashsalt": name}):
        figure.savefig(out, format="svg", metadata=nothing, transparent=True)
    text = out.getvalue()
    text = text[text.index("<svg") :].strip()
    ids = sorted(set(re.findall(r'\bid="([^"]+)"', text)), key=len, reverse=True)
    for found in ids:
        text = text.replace(f'id="{found}"', f'id="{name}-{found}"').replace(f'"#{found}"', f'"#{name}-{found}"')
        text = text.replace(f"url(#{found})", f"url(#{name}-{found})")
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1), count=1)
    return text.replace("<svg", f'<svg role="img" aria-labelledby="{name}-title"', 1).replace(
        ">", f'><title id="{name}-title">{title}</title>', 1
    )


def _name(label: str, rows: Sequence[Row]) -> str:
    """Legend entry of a run, with the reasons where it failed."""
    reasons = list(dict.fromkeys(" ".join(row.failure.split()) for row in rows if row.failure))
    failed = sum(row.failure is not None for row in rows)
    return escaped(label + (f" ({failed} of {len(rows)} failed: {'; '.join(reasons)})" if failed else ""))


def _legend_shape(names: list[str], width: float) -> tuple[int, list[str]]:
    """Number of columns of the legend, and its entries wrapped to lines that fit; width: of the figure, inch."""
    room = int(width * LETTERS)
    columns = max(1, min(4, room // (max(map(len, names)) + 7)))
    return columns, ["\n".join(textwrap.wrap(name, room - 8)) for name in names]


def _line(axis: Any, rows: list[Row], work: str, i: int, name: str) -> None:
    points = sorted((getattr(row, work), row.error, row.pareto) for row in rows if row.measured is not None and row.error)
    x, y = [p[0] for p in points], [p[1] for p in points]
    look, marker = own_look(i)
    axis.loglog(x, y, label=name, marker=marker, markerfacecolor="white", markersize=6, **look)
    best = [p for p in points if p[2]]
    axis.loglog([p[0] for p in best], [p[1] for p in best], marker, color=look["color"], markersize=6)


def own_look(i: int) -> tuple[dict[str, Any], str]:
    """Colour with line style, and marker, of method number i. Up to 14 methods have different colours and different markers;
    beyond these every method still has a combination of its own."""
    colours = (*COLOURS, *FURTHER)
    return style(i) | {"color": colours[i % len(colours)]}, MARKERS[(i + i // len(colours)) % len(MARKERS)]


def ticks(axis: Any) -> None:
    """Label the ticks with plain numbers: at 1, 2 and 5 times every power of ten, at the powers of ten where there are many,
    at even steps where there are few."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    low, high = axis.get_xlim()
    if high < 4 * low:  # no two of these ticks may lie in it
        axis.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    else:
        axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 200 * low else (1.0,)))
    axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())


class Comparison(ComparisonData):
    """A comparison of solvers, made by `mb.compare`, with its table, picture and page."""

    kind = "comparison"

    def plot(self, path: Any = None, ax: Any = None) -> Any:
        """Error over CPU time and over residual evaluations, as a matplotlib figure, saved where `path` (.png, .svg, .pdf)
        is given; OptionError for a path that cannot be used. ax: two axes of matplotlib to draw in."""
        return work_precision(self, checked(path, what="compare") if path is not None else None, ax=ax)

    def __repr__(self) -> str:
        return f"<Comparison of '{self.scene}': {counted(len(self.runs), 'run')}; print it for the table>"

    def _pictures(self) -> Sequence[str]:
        return [picture(self.plot()._repr_png_())]

    def _page(self) -> str:
        return page(self)
