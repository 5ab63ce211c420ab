"""A map of extremes as data, as text, and as one HTML page: for every parameter a grid of coloured cells with text."""

from __future__ import annotations

import json
import re
from collections import Counter
from dataclasses import asdict, dataclass
from html import escape
from textwrap import shorten
from typing import Any

from mbdae.errors import NamesArguments
from mbdae.extremes.cell import FAILED, MET, NEAR, SILENT, TOLD, UNKNOWN, VERDICTS, Cell
from mbdae.notation import counted
from mbdae.run.checkpoint import environment
from mbdae.study import Study, document, grid, headings, html_row, html_table, made_with, section
from mbdae.values import number, option, text

#: matches numbers and details of failures: of several warnings or errors that are equal without these only the first is shown
NUMBERS = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?|\(resisting most: [^)]*\)+|; the iteration matrix is singular[^;(]*"
                     r"|Convergence tests failed too many times, or reached min step size"
                     r"|the step became smaller than the round-off of the time t")
#: mark of each verdict, also for readers who cannot tell the colours
MARKS = {MET: "=", NEAR: "~", TOLD: "!", SILENT: "SILENT", FAILED: "x", UNKNOWN: "?"}
#: background and text colours that differ in lightness and hue (Okabe and Ito's palette, lightened behind dark text)
COLOURS = {
    MET: ("#cfe5f5", "#10334d"), NEAR: ("#8fc1e3", "#0b2536"), TOLD: ("#f6dca6", "#4d3300"), SILENT: ("#8a0f3c", "#ffffff"),
    FAILED: ("#e08e45", "#2b1500"), UNKNOWN: ("#e6e6e6", "#333333"),
}
KINDS = {name: f"v{i}" for i, name in enumerate(VERDICTS)}
STYLE = "".join(
    f".{KINDS[name]} {{ background: {back}; color: {front}; }}\n" for name, (back, front) in COLOURS.items()
) + """
table.map td { text-align: center; border: 1px solid var(--ground); min-width: 4.2rem; }
table.map th { border-color: var(--ground); } table.map thead th { text-align: center; }
table.map thead th:first-child { text-align: left; }
table.map tbody th { position: sticky; left: 0; background: var(--ground); }
.legend { list-style: none; padding: 0; } .legend li { margin: .15rem 0; display: flex; gap: .6rem; align-items: baseline; }
.swatch { flex: none; min-width: 6.2rem; text-align: center; border-radius: 2px; padding: .1rem .4rem; font-size: .875rem; }
.holds { font-weight: 600; }
details { max-width: 60rem; } summary { cursor: pointer; min-height: 24px; }
@media screen and (max-width: 700px) {
  table.map td { padding-inline: .2rem; min-width: 0; } table.map:not(.many) td { white-space: nowrap; }
  table.map.many tbody tr { grid-template-columns: repeat(auto-fill, minmax(3.9rem, 1fr)); gap: .2rem; }
}
@media print { td, .swatch { print-color-adjust: exact; -webkit-print-color-adjust: exact; } }
"""


@dataclass(frozen=True)
class Block(NamesArguments):
    """One varied parameter: its values, a reference for each, and the cells."""

    parameter: str
    values: tuple[float, ...]
    references: tuple[str, ...]  #: for each value the methods of its reference, and their difference, in words
    cells: tuple[Cell, ...]

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the ways in which the scene was run (joint model, form and solver), in order."""
        return tuple(dict.fromkeys(cell.label for cell in self.cells))

    def at(self, label: str, value: float) -> Cell | None:
        """The cell with this label at a value of the parameter; None where the scene cannot be run in that way there."""
        label = option("label", label, text, "give the label of a way, one of `labels`")
        value = option("value", value, number, "give a value of the parameter, one of `values`")
        return next((cell for cell in self.cells if cell.label == label and cell.value == value), None)


@dataclass(frozen=True)
class Extremes(Study):
    """A map of extremes, made by `mb.extremes`, with table and page: all its cells. `silent`, the runs that missed the accuracy
    without a warning, should be empty. Cells may have end times of their own."""

    accuracy: float
    measure: str | None
    what: str  #: definition of the error, in words
    blocks: tuple[Block, ...]
    cpu_s: float
    left_out: tuple[str, ...] = ()  #: values that were not begun within the budget

    kind = "extremes"

    @property
    def cells(self) -> tuple[Cell, ...]:
        """All cells."""
        return tuple(cell for block in self.blocks for cell in block.cells)

    @property
    def counts(self) -> dict[str, int]:
        """Number of cells for every verdict, zeros included."""
        found = Counter(cell.verdict for cell in self.cells)
        return {name: found[name] for name in VERDICTS}

    @property
    def silent(self) -> tuple[Cell, ...]:
        """Runs that missed the accuracy without a warning."""
        return tuple(cell for cell in self.cells if cell.verdict == SILENT)

    @property
    def verdict(self) -> str:
        """One sentence with the number of runs for every verdict."""
        told = ", ".join(f"{n} {name}" for name, n in self.counts.items())
        return f"{counted(len(self.cells), 'run')}: {told}."

    def to_dict(self) -> dict[str, Any]:
        """All data as plain values."""
        return dict(json.loads(json.dumps({
            "scene": self.scene, "t_end": self.t_end, "accuracy": self.accuracy, "measure": self.measure, "error_is": self.what,
            "counts": self.counts, "blocks": [asdict(block) for block in self.blocks], "cpu_s": self.cpu_s,
            "left_out": list(self.left_out), "environment": environment(),
        })))

    def table(self) -> str:
        """A grid per parameter, the reasons of failures, and the counts, as plain text."""
        lines = [f"scene '{self.scene}' to t = {self.t_end:g} s, accuracy {self.accuracy:g} unless varied", f"error: {self.what}"]
        for block in self.blocks:
            cells = [[label, *(cell_text(block.at(label, value), True) for value in block.values)] for label in block.labels]
            lines += ["", block.parameter, *grid([["", *(f"{value:g}" for value in block.values)], *cells])]
            lines += [f"  {note}" for note in notes(block)]
        lines += ["", *(f"{MARKS[name]:>6}  {n:4d}  {name}: {VERDICTS[name]}" for name, n in self.counts.items())]
        lines += [self.unfinished] if self.left_out else []
        return "\n".join([*lines, f"{self.cpu_s:.1f} s of CPU time"])

    @property
    def unfinished(self) -> str:
        """What the budget left out, as a sentence."""
        return f"not begun within the budget: {', '.join(self.left_out)}; the same call with resume= goes on with them"

    def _page(self) -> str:
        wrong = "No run was silently wrong." if not self.silent else f"Silently wrong: {counted(len(self.silent), 'run')}."
        wrong += f" {escape(self.unfinished).capitalize()}." if self.left_out else ""
        summary = (f'<p class="holds">{wrong}</p>\n<p>{counted(len(self.cells), "run")} to t = {self.t_end:g} s, accuracy '
                   f"{self.accuracy:g} unless it is varied. Error: {escape(self.what)}.</p>\n")
        legend = "".join(f'<li><span class="swatch {KINDS[name]}">{MARKS[name]} {n}</span>'
                         f"<span><b>{name}</b>: {escape(VERDICTS[name])}</span></li>\n" for name, n in self.counts.items())
        note = ("A cell holds its mark and the largest error of the run; its other data show when it is pointed at, and "
                "are in the JSON file.")
        parts = [summary, section("legend", "Legend and counts", f'<ul class="legend">{legend}</ul>\n<p class="note">{note}</p>'),
                 *map(_block, range(len(self.blocks)), self.blocks), made_with(f"{self.cpu_s:.1f} s", environment())]
        return document(f"Extremes: {self.scene}", STYLE, parts)

    def __repr__(self) -> str:
        return f"<Extremes of '{self.scene}': {len(self.blocks)} parameters; print it for the table>"


def cell_text(cell: Cell | None, mark: bool = False) -> str:
    """Text of a cell: its error, "failed", or "-" where the error is not known."""
    if cell is None:
        return ""
    shown = "failed" if cell.verdict == FAILED else "-" if cell.error is None else f"{cell.error:.0e}"
    return f"{MARKS[cell.verdict]} {shown}" if mark else shown


def notes(block: Block) -> list[str]:
    """Warnings and errors of runs, each sentence once with the cells it concerns; silent misses first."""
    said: dict[tuple[str, str], list[str]] = {}
    first: dict[tuple[str, str], str] = {}
    for cell in sorted(block.cells, key=lambda c: c.verdict != SILENT):
        where = f"{cell.label} at {cell.value:g}"
        if cell.verdict == SILENT:
            reason = "error inf or nan" if cell.error is None else f"error {cell.error:.1e}, estimated {cell.estimated}"
            said.setdefault((SILENT, reason), []).append(where)
        for kind, sentence in (("failed", cell.failure), *(("said", w) for w in cell.warnings)):
            if sentence:
                alike = kind, NUMBERS.sub("#", sentence)
                first.setdefault(alike, shorten(sentence, 300, placeholder="..."))
                said.setdefault(alike, []).append(where)
    return [f"{kind}: {first.get((kind, sentence), sentence)} "
            f"({runs[0]}{' and ' + counted(len(runs) - 1, 'more run') if runs[1:] else ''})"
            for (kind, sentence), runs in said.items()]


def _block(i: int, block: Block) -> str:
    head = headings(["way \\ value", *(f"{value:g}" for value in block.values)])
    rows = [html_row(label, [_cell(block.at(label, value)) for value in block.values]) for label in block.labels]
    return section(f"b{i}", block.parameter, html_table(f"b{i}", head, rows, kind="map") + _remarks(block))


def _cell(cell: Cell | None) -> str:
    if cell is None:
        return "<td></td>"
    details = escape(_details(cell))
    return f'<td class="{KINDS[cell.verdict]}" title="{details}">{MARKS[cell.verdict]} {escape(cell_text(cell))}</td>'


def _details(cell: Cell) -> str:
    """Text of a cell's data, shown where the pointer rests on it."""
    parts = [cell.verdict, f"{cell.solver} {cell.form}".strip()]
    for name, value, form in (("estimated", cell.estimated, ".1e"), ("CPU s", cell.cpu_s, ".2f")):
        parts += [f"{name} {value:{form}}"] if value is not None else []
    parts += [f"{cell.steps} steps"] if cell.steps else []
    return "; ".join([*(p for p in parts if p), *cell.warnings, *([cell.failure] if cell.failure else [])])


def _remarks(block: Block) -> str:
    """List of uncertain references, and of warnings and errors of runs."""
    open_ = {cell.value for cell in block.cells if cell.verdict == UNKNOWN}  # at these values not all runs could be judged
    told = [f"not judged at {value:g}: reference {reference}"
            for value, reference in zip(block.values, block.references, strict=True) if value in open_]
    told += notes(block)
    if not told:
        return ""
    lines = "".join(f"<li>{escape(line)}</li>\n" for line in told)
    count = f"{len(told)} remark{'s' if len(told) > 1 else ''}"
    return f"<details><summary>What was said: {count}</summary><ul>{lines}</ul></details>\n"
