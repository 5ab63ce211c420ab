"""A map of extremes as one HTML page that loads no other file: for every parameter a grid of coloured cells with text."""

from __future__ import annotations

from html import escape

from mbdae.compare.html import document, headings, made_with, row, section, table
from mbdae.extremes.cell import FAILED, MET, NEAR, SILENT, TOLD, UNKNOWN, VERDICTS, Cell
from mbdae.extremes.data import Block, ExtremesData
from mbdae.extremes.table import MARKS, doubted, notes, text
from mbdae.notation import counted
from mbdae.run.environment import environment

#: background and text colours that differ in lightness and hue (Okabe and Ito's palette, lightened behind dark text)
COLOURS = {
    MET: ("#cfe5f5", "#10334d"), NEAR: ("#8fc1e3", "#0b2536"), TOLD: ("#f6dca6", "#4d3300"), SILENT: ("#8a0f3c", "#ffffff"),
    FAILED: ("#e08e45", "#2b1500"), UNKNOWN: ("#e6e6e6", "#333333"),
}  # fmt: skip
KINDS = {name: f"v{i}" for i, name in enumerate(VERDICTS)}
STYLE = "".join(
    f".{KINDS[name]} {{ background: {back}; color: {front}; }}\n" for name, (back, front) in COLOURS.items()
) + """
table.map td { text-align: center; border: 1px solid #fff; min-width: 4.2rem; }
table.map th { border-color: #fff; } table.map thead th { text-align: center; }
table.map thead th:first-child { text-align: left; }
table.map tbody th { position: sticky; left: 0; background: #fff; }
.legend { list-style: none; padding: 0; } .legend li { margin: .15rem 0; display: flex; gap: .6rem; align-items: baseline; }
.swatch { flex: none; min-width: 6.2rem; text-align: center; border-radius: 2px; padding: .1rem .4rem; font-size: .875rem; }
.holds { font-weight: 600; }
details { max-width: 60rem; } summary { cursor: pointer; min-height: 24px; }
@media (max-width: 700px) { table.map tbody th { white-space: normal; min-width: 8.5rem; max-width: 9rem; } }
@media print { td, .swatch { print-color-adjust: exact; -webkit-print-color-adjust: exact; } }
"""


def page(m: ExtremesData) -> str:
    """The whole page."""
    made = made_with(f"{m.cpu_s:.1f} s", environment())
    return document(f"Extremes: {m.scene}", STYLE, [_summary(m), _legend(m), *map(_block, range(len(m.blocks)), m.blocks), made])


def _summary(m: ExtremesData) -> str:
    verdict = "No run was silently wrong." if not m.silent else f"Silently wrong: {counted(len(m.silent), 'run')}."
    return (f'<p class="holds">{verdict}</p>\n<p>{counted(len(m.cells), "run")} to t = {m.t_end:g} s, accuracy '
            f"{m.accuracy:g} unless it is varied. Error: {escape(m.what)}.</p>\n")  # fmt: skip


def _legend(m: ExtremesData) -> str:
    lines = [f'<li><span class="swatch {KINDS[name]}">{MARKS[name]} {n}</span>'
             f"<span><b>{name}</b>: {escape(VERDICTS[name])}</span></li>\n" for name, n in m.counts.items()]  # fmt: skip
    note = ("A cell holds its mark and the largest error of the run; its other data show when it is pointed at, and "
            "are in the JSON file.")  # fmt: skip
    return section("legend", "Legend and counts", f'<ul class="legend">{"".join(lines)}</ul>\n<p class="note">{note}</p>')


def _block(i: int, block: Block) -> str:
    head = headings(["way \\ value", *(f"{value:g}" for value in block.values)])
    rows = [row(label, [_cell(block.at(label, value)) for value in block.values]) for label in block.labels]
    return section(f"b{i}", block.parameter, table(f"b{i}", head, rows, attributes=' class="map"') + _remarks(block))


def _cell(cell: Cell | None) -> str:
    if cell is None:
        return "<td></td>"
    return f'<td class="{KINDS[cell.verdict]}" title="{escape(_details(cell))}">{MARKS[cell.verdict]} {escape(text(cell))}</td>'


def _details(cell: Cell) -> str:
    """Text of a cell's data, shown where the pointer rests on it."""
    parts = [cell.verdict, f"{cell.solver} {cell.form}".strip()]
    for name, value, form in (("estimated", cell.estimated, ".1e"), ("CPU s", cell.cpu_s, ".2f")):
        parts += [f"{name} {value:{form}}"] if value is not None else []
    parts += [f"{cell.steps} steps"] if cell.steps else []
    return "; ".join([*(p for p in parts if p), *cell.warnings, *([cell.failure] if cell.failure else [])])


def _remarks(block: Block) -> str:
    """List of uncertain references, and of warnings and errors of runs."""
    told = [*(f"not judged at {value:g}: reference {reference}" for value, reference in doubted(block)), *notes(block)]
    if not told:
        return ""
    lines = "".join(f"<li>{escape(line)}</li>\n" for line in told)
    count = f"{len(told)} remark{'s' if len(told) > 1 else ''}"
    return f"<details><summary>What was said: {count}</summary><ul>{lines}</ul></details>\n"
