"""A document as one HTML page that loads no other file: formulas as MathML, a layout for screens, phones and print."""

from __future__ import annotations

import re
from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from html import escape

from mbdae.documents.blocks import Block, Code, Drawing, Equation, Paragraph, Picture, Point, Section, Table, split_text, tokens
from mbdae.documents.mathml import GREEK, FormulaError, display, inline
from mbdae.notation import whole

FONT = "system-ui, Liberation Sans, sans-serif"

# -- Meanings of the symbols in a formula as plain text, from the tables of symbols in its document


_DROPPED = re.compile(r"\\(mathbf|boldsymbol|mathrm|mathsf|text|left|right)|[{}$]|\\[,;! ]")
_MARKS = {r"\dot": "\u0307", r"\ddot": "\u0308", r"\tilde": "\u0303", r"\hat": "\u0302", r"\bar": "\u0304"}


def key_of(latex: str) -> tuple[str, ...]:
    """A formula as tokens without spaces."""
    return tuple(t for t in tokens(latex) if not t.isspace() and t not in (r"\,", r"\ ", r"\;"))


def _tables(blocks: Sequence[Block]) -> Iterator[Table]:
    for block in blocks:
        if isinstance(block, Section):
            yield from _tables(block.blocks)
        elif isinstance(block, Table) and [*block.head][:3] == ["symbol", "unit", "meaning"]:
            yield block


def symbols_of(blocks: Sequence[Block]) -> dict[tuple[str, ...], str]:
    """From tables of symbols: tokens of a symbol -> its letter, meaning and unit in plain text."""
    found = {}
    for table in _tables(blocks):
        for symbol, unit, meaning in table.rows:
            said = f", {plain(unit)}" if unit not in ("", "1") else ""
            found[key_of(symbol.strip("$"))] = f"{plain(symbol)}: {plain(meaning)}{said}"
    return found


def plain(latex: str) -> str:
    """A short formula, or text with formulas, in plain letters."""
    for command, mark in _MARKS.items():
        latex = re.sub(re.escape(command) + r"\{?(\\[a-z]+\{?[A-Za-z\\]+\}?|[A-Za-z])\}?", rf"\1{mark}", latex)
    latex = re.sub(r"\\([A-Za-z]+)", lambda m: GREEK.get(m[1], m[0]), latex)
    return _DROPPED.sub("", latex)


def explained(latex: str, symbols: Mapping[tuple[str, ...], str]) -> str:
    """The meanings of the symbols in a formula, one a line; at every place the longest known symbol is taken."""
    line, found, i = key_of(latex), dict[str, None](), 0
    beginning: dict[str, list[tuple[str, ...]]] = {}
    for key in symbols:
        beginning.setdefault("".join(key[:1]), []).append(key)
    while i < len(line):
        here = [key for key in beginning.get(line[i], ()) if line[i : i + len(key)] == key]
        best = max(here, key=len, default=())
        found |= {symbols[best]: None} if best else {}
        i += max(1, len(best))
    return "\n".join(found)


STYLE = """
:root { color-scheme: light dark; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 54rem; padding: 1rem 1.25rem 3rem; color: #1a1a1a; background: #fff;
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Liberation Sans", sans-serif; overflow-wrap: break-word; }
h1 { font-size: 1.6rem; line-height: 1.25; margin: .5rem 0 1rem; }
h2 { font-size: 1.2rem; line-height: 1.3; margin: 2.2rem 0 .5rem; padding-top: .6rem; border-top: 1px solid #ddd; }
h3 { font-size: 1rem; margin: 1.4rem 0 .4rem; }
h4 { font-size: .95rem; margin: 1rem 0 .3rem; color: #333; }
p { margin: .6rem 0; }
nav { font-size: .9rem; margin: 1rem 0; }
details { margin: .5rem 0; } summary { cursor: pointer; color: #0b5ea8; }
.tex { font-size: .7rem; color: #555; } .tex summary { color: #767676; text-align: right; }
.tex code { user-select: all; display: block; white-space: pre-wrap; background: #f6f7f8; padding: .3rem .5rem; }
.kept { white-space: nowrap; }
nav a { margin-right: .9rem; white-space: nowrap; display: inline-block; padding: .15rem 0; }
@media (min-width: 1240px) { body { margin-left: max(17rem, calc(50vw - 27rem)); }
  nav { position: fixed; top: 1rem; bottom: 1rem; left: max(1rem, calc(50vw - 43rem)); width: 14.5rem; overflow-y: auto; }
  nav a { display: block; white-space: normal; } }
a { color: #0b5ea8; }
math { font-family: "STIX Two Math", "Latin Modern Math", "Cambria Math", "DejaVu Math TeX Gyre", math, serif;
  font-size: 1.06em; }
math mi, math mn, math mtext { font-family: "STIX Two Text", "Latin Modern Roman", Cambria, "Times New Roman", "Liberation Serif",
  "DejaVu Serif", serif; }
math mi { text-transform: none; font-style: italic; }
math mi.n { font-style: normal; }
math mi.b, math mn.b { font-style: normal; font-weight: 700; }
math mi.bi { font-style: italic; font-weight: 700; }
mtable.cases mtd, mtable.aligned mtd { text-align: left; }
.equation { display: flex; flex-wrap: wrap; gap: 0 .8rem; align-items: baseline; margin: .35rem 0; padding: .15rem 0 .15rem 1rem;
  border-left: 3px solid #e3e8ee; }
.equation .tex { margin: 0; } .equation .tex[open] { flex-basis: 100%; }
.equation .lines { flex: 1 1 0; min-width: 0; overflow-x: auto; overflow-y: hidden; }
.equation .line { padding: .14rem 0 .14rem 1.4rem; text-indent: -1.4rem; line-height: 1.9; }
.equation .line math { text-indent: 0; margin: .2em 0; }
.equation .term { display: inline-block; max-width: 100%; padding-left: 1.4rem; text-indent: -1.4rem; }
.equation .number { color: #555; font-variant-numeric: tabular-nums; }
.note { color: #444; font-size: .9rem; margin-left: 1.2rem; }
.scroll { overflow-x: auto; max-width: 100%; margin: .8rem 0; }
.scroll:focus-visible { outline: 2px solid #0072b2; outline-offset: 2px; }
table { border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums; }
th, td { padding: .28rem .7rem .28rem 0; text-align: left; vertical-align: baseline; border-bottom: 1px solid #e2e2e2; }
thead th { border-bottom: 1px solid #888; font-weight: 600; vertical-align: bottom; }
tbody th { font-weight: 400; }
pre { font: .82rem/1.45 ui-monospace, "DejaVu Sans Mono", "Liberation Mono", monospace; background: #f6f7f8; padding: .6rem .8rem;
  overflow-x: auto; }
code { font: .88em ui-monospace, "DejaVu Sans Mono", "Liberation Mono", monospace; }
figure { margin: 1rem 0; }
figure svg, figure img { display: block; max-width: 100%; height: auto; }
figcaption { color: #444; font-size: .9rem; }
@media (max-width: 700px) { body { padding: .5rem .9rem 2rem; } .equation { padding-left: .6rem; gap: 0 .4rem; }
  .equation .tex:not([open]) { width: .7rem; height: 1.2rem; overflow: hidden; } }
@media screen and (prefers-color-scheme: dark) {
  body { color: #e4e4e4; background: #16181b; } h2 { border-color: #3a3e44; } h4, .note, figcaption { color: #c4c7cb; }
  a, details summary { color: #7db8f0; } .tex, .tex summary, .equation .number { color: #a4a8ad; }
  .tex code, pre { background: #23272c; } .equation { border-color: #3a4350; }
  th, td { border-color: #3a3e44; } thead th { border-color: #8a8e94; }
  figure svg, figure img { background: #fff; filter: invert(.92) hue-rotate(180deg); }
}
@media print {
  body { max-width: none; padding: 0; font-size: 10pt; } nav { display: none; }
  .scroll, .equation .lines, pre { overflow: visible; } pre { white-space: pre-wrap; }
  .tex { display: none; } .equation, figure, tr { break-inside: avoid; } h2, h3, h4, thead { break-after: avoid; }
}
"""


def html(title: str, blocks: Sequence[Block]) -> str:
    """HTML of the whole page."""
    writer = _Writer(symbols_of(blocks))
    body = "".join(writer.block(block, 2) for block in blocks)
    links = "".join(f'<a href="#{place}">{_text(title)}</a> ' for place, title in writer.places)
    contents = f'<nav aria-label="contents">{links}</nav>\n' if len(writer.places) > 3 else ""
    return (f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">\n'
            f"<title>{escape(_plain(title))}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n"
            f"<h1>{_text(title)}</h1>\n{contents}{whole(body)}</main>\n</body>\n</html>\n")


def _plain(text: str) -> str:
    return "".join(part for _, part in split_text(text))


def _text(text: str) -> str:
    """HTML of a text with mathematics, and with `code` between backquotes."""
    out = []
    for formula, part in split_text(text):
        try:
            out.append(inline(part) if formula else re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(part, quote=False)))
        except FormulaError:  # a name that only looks like a formula, such as "$\\frac{$"
            out.append(escape(f"${part}$", quote=False))
    # no line begins with a comma, which browsers would allow behind a formula
    return re.sub(r"(<math>(?:(?!<math>).)*</math>)([,.;:)]+)", r'<span class="kept">\1\2</span>', "".join(out))


class _Writer:
    """Writes blocks as HTML and collects the sections for the table of contents."""

    def __init__(self, symbols: Mapping[tuple[str, ...], str]) -> None:
        self.symbols = symbols
        self.places: list[tuple[str, str]] = []
        self.tables = 0
        self.ids: set[str] = set()

    def block(self, block: Block, level: int) -> str:
        """HTML of one block; level: heading level (h2, h3, ...) if it is a section."""
        if isinstance(block, Section):
            return self.section(block, block.level or level)
        if isinstance(block, Paragraph):
            return f"<p>{_text(block.text)}</p>\n"
        if isinstance(block, Equation):
            hint = explained(block.latex, self.symbols)
            number = f'<div class="number">({escape(str(block.number))})</div>' if block.number is not None else ""
            note = f'<div class="note">{_text(block.note)}</div>\n' if block.note else ""
            shown = f' title="{escape(hint)}"' if hint else ""
            tex = f'<details class="tex"><summary>TeX</summary><code>{escape(block.latex, quote=False)}</code></details>'
            return f'<div class="equation"{shown}><div class="lines">{display(block.latex)}</div>{number}{tex}</div>\n{note}'
        if isinstance(block, Table):
            return self.table(block)
        if isinstance(block, Code):
            return f"<pre>{escape(block.text, quote=False)}</pre>\n"
        return _picture(block)

    def section(self, section: Section, level: int) -> str:
        """HTML of a heading and its blocks."""
        plain = re.sub(r"[^a-z0-9]+", "-", _plain(section.title).lower()).strip("-") or "section"
        place, count = plain, 1
        while place in self.ids:
            count += 1
            place = f"{plain}-{count}"
        self.ids.add(place)
        if level == 2:
            self.places.append((place, section.title))
        inside = "".join(self.block(block, level + 1) for block in section.blocks)
        heading = f'<h{level} id="{place}">{_text(section.title)}</h{level}>'
        return f'<section aria-labelledby="{place}">{heading}\n{inside}</section>\n'

    def table(self, table: Table) -> str:
        """HTML of a table that scrolls in its own box, also by keyboard."""
        self.tables += 1
        caption = f'<p class="note">{_text(table.caption)}</p>\n' if table.caption else ""
        head = "".join(f'<th scope="col">{_text(cell)}</th>' for cell in table.head)
        rows = "".join(f'<tr><th scope="row">{_text(row[0])}</th>{"".join(f"<td>{_text(c)}</td>" for c in row[1:])}</tr>\n'
                       for row in table.rows)
        label = escape(_plain(table.caption) or f"table {self.tables}")
        if table.folded:
            inside = self.table(replace(table, caption="", folded=False))
            return f"<details><summary>{_text(table.caption)}</summary>{inside}</details>\n"
        return (f'{caption}<div class="scroll" role="region" aria-label="{label}" tabindex="0"><table><thead>'
                f"<tr>{head}</tr></thead>\n<tbody>\n{rows}</tbody></table></div>\n")


def file_of(picture: Picture) -> bytes | str:
    """Content of a file with a picture."""
    return svg(picture.content) if isinstance(picture.content, Drawing) else picture.content


def svg(drawing: Drawing) -> str:
    """A drawing as an SVG element."""
    body = "".join(_svg_line(*mark[1:]) if mark[0] == "line" else _svg_text(*mark[1:]) for mark in drawing.marks)
    size = f'viewBox="0 0 {drawing.width:g} {drawing.height:g}" width="{drawing.width:g}" font-family="{FONT}" font-size="13"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{escape(drawing.title)}" {size}>{body}</svg>'


def _svg_line(points: list[Point], colour: str, width: float, arrow: bool, fill: str) -> str:
    path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    shown = f'<path d="{path}" stroke="{colour}" stroke-width="{width:g}" fill="{fill or "none"}"/>'
    if not arrow:
        return shown
    (x0, y0), (x1, y1) = points[-2:]
    size = max(((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5, 1e-9)
    u, v = (x1 - x0) / size, (y1 - y0) / size
    tip = [(x1, y1), (x1 - 8 * u + 3 * v, y1 - 8 * v - 3 * u), (x1 - 8 * u - 3 * v, y1 - 8 * v + 3 * u)]
    return shown + f'<path d="M{"L".join(f"{x:.1f} {y:.1f}" for x, y in tip)}Z" fill="{colour}"/>'


def _svg_text(x: float, y: float, latex: str, anchor: str, colour: str) -> str:
    out = []
    for i, part in enumerate(latex.split("$")):
        if i % 2 == 0:
            out.append(escape(part))
            continue
        name, _, below = part.partition("_")
        bold = re.fullmatch(r"\\mathbf\{(.*)\}", name)
        style = "font-weight:700" if bold else "font-style:italic"
        letter = {r"\varphi": "φ"}.get(name, bold[1] if bold else name)
        out.append(f'<tspan style="{style}">{escape(letter)}</tspan>')
        if below:
            out.append(f'<tspan dy="4" font-size="10">{escape(below.strip("{}"))}</tspan><tspan dy="-4">\u200b</tspan>')
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}">{"".join(out)}</text>'


def _picture(picture: Picture) -> str:
    if isinstance(picture.content, bytes):
        data = b64encode(picture.content).decode()
        shown = f'<img alt="{escape(_plain(picture.caption))}" src="data:image/png;base64,{data}">'
    else:
        shown = re.sub(r"^\s*(<\?xml[^>]*>|<!DOCTYPE[^>]*>|\s)+", "", str(file_of(picture)))
    return f"<figure>{shown}<figcaption>{_text(picture.caption)}</figcaption></figure>\n"
