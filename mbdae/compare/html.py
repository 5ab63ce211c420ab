"""Parts of the HTML pages of comparisons and maps: a page loads no other file and has layouts for screens, phones and print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

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


def document(title: str, style: str, parts: Sequence[str], script: str = "") -> str:
    """The whole HTML page. parts: HTML of the sections under the heading; style: CSS in addition to STYLE; script: JavaScript."""
    scripts = f"<script>{script}</script>\n" if script else ""
    return (f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">\n'
            f"<title>{escape(title)}</title>\n<style>{STYLE}{style}</style>\n</head>\n<body>\n<main>\n"
            f"<h1>{escape(title)}</h1>\n{''.join(parts)}</main>\n{scripts}</body>\n</html>\n")  # fmt: skip


def section(name: str, title: str, content: str) -> str:
    """A section: `content` (HTML) under a heading with the id `name`."""
    return f'<section aria-labelledby="{name}"><h2 id="{name}">{escape(title)}</h2>\n{content}</section>\n'


def bullets(lines: Sequence[str]) -> str:
    """An HTML list of sentences."""
    return "<ul>" + "".join(f"<li>{escape(line)}</li>\n" for line in lines) + "</ul>\n"


def table(labelled_by: str, head: str, rows: Sequence[str], caption: str = "", attributes: str = "") -> str:
    """A table that scrolls in its own box, also by keyboard. labelled_by: id of the heading that names it; head, rows: HTML of
    the table rows; attributes: of the <table> element."""
    captions = f"<caption>{escape(caption)}</caption>" if caption else ""
    return (f'<div class="scroll" role="region" aria-labelledby="{labelled_by}" tabindex="0"><table{attributes}>'
            f"{captions}<thead><tr>{head}</tr></thead>\n<tbody>\n{''.join(rows)}</tbody></table></div>\n")  # fmt: skip


def row(label: str, cells: Sequence[str], attributes: str = "") -> str:
    """A table row with its label; cells: HTML."""
    return f'<tr{attributes}><th scope="row">{escape(label)}</th>{"".join(cells)}</tr>\n'


def headings(texts: Sequence[str]) -> str:
    """The heading row of a table."""
    return "".join(f'<th scope="col">{escape(text)}</th>' for text in texts)


def made_with(cpu: str, environment: Mapping[str, str | int]) -> str:
    """The section on the CPU time that was used, versions and machine; cpu: a sentence on the CPU time."""
    entries = "".join(f"<dt>{escape(name)}</dt><dd>{escape(str(value))}</dd>"
                      for name, value in {"CPU time": cpu, **environment}.items())  # fmt: skip
    return section("made", "Made with", f"<dl>{entries}</dl>\n")
