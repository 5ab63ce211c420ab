"""What a study gives its user: text, data as JSON, and an HTML page, which loads no other file and has layouts for screens,
phones and print.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, ClassVar

from mbdae.errors import ListsAttributes
from mbdae.files import write_file
from mbdae.notation import plain, titled
from mbdae.values import file_to_write, optional

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
            f"<h1>{escape(title)}</h1>\n{''.join(parts)}</main>\n{scripts}</body>\n</html>\n")


def section(name: str, title: str, content: str) -> str:
    """A section: `content` (HTML) under a heading with the id `name`."""
    return f'<section aria-labelledby="{name}"><h2 id="{name}">{escape(title)}</h2>\n{content}</section>\n'


def bullets(lines: Sequence[str]) -> str:
    """An HTML list of sentences."""
    return "<ul>" + "".join(f"<li>{escape(line)}</li>\n" for line in lines) + "</ul>\n"


def html_table(labelled_by: str, head: str, rows: Sequence[str], caption: str = "", attributes: str = "") -> str:
    """A table that scrolls in its own box, also by keyboard. labelled_by: id of the heading that names it; head, rows: HTML of
    the table rows; attributes: of the <table> element."""
    captions = f"<caption>{escape(caption)}</caption>" if caption else ""
    return (f'<div class="scroll" role="region" aria-labelledby="{labelled_by}" tabindex="0"><table{attributes}>'
            f"{captions}<thead><tr>{head}</tr></thead>\n<tbody>\n{''.join(rows)}</tbody></table></div>\n")


def html_row(label: str, cells: Sequence[str], attributes: str = "") -> str:
    """A table row with its label; cells: HTML."""
    return f'<tr{attributes}><th scope="row">{escape(label)}</th>{"".join(cells)}</tr>\n'


def headings(texts: Sequence[str]) -> str:
    """The heading row of a table."""
    return "".join(f'<th scope="col">{escape(text)}</th>' for text in texts)


def made_with(cpu: str, environment: Mapping[str, str | int]) -> str:
    """The section on the CPU time that was used, versions and machine; cpu: a sentence on the CPU time."""
    entries = "".join(f"<dt>{escape(name)}</dt><dd>{escape(str(value))}</dd>"
                      for name, value in {"CPU time": cpu, **environment}.items())
    return section("made", "Made with", f"<dl>{entries}</dl>\n")


def written(make: Callable[[], str], path: Any) -> str:
    """The text that `make` returns, written to `path` where one is given; a path that cannot be written to is refused first."""
    place = optional("path", path, file_to_write, "give the path of a file in a folder that exists, or None")
    text = make()
    if place is not None:
        write_file(place, text)
    return text


def as_json(data: Any, path: Any) -> str:
    """Plain data as JSON text, written to `path` where one is given."""
    return written(lambda: json.dumps(data, indent=1, allow_nan=False) + "\n", path)


@dataclass(frozen=True)
class Study(ListsAttributes, ABC):
    """Many runs of a scene, as plain text, JSON and HTML page; a kind of study states `to_dict`, `table` and `_page`."""

    scene: str
    t_end: float  #: end time of the scene as stated, s

    kind: ClassVar[str]  #: word for the study, in titles

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """All data as dictionaries, lists, texts and numbers; values that are not known are None."""

    @abstractmethod
    def table(self) -> str:
        """The study as plain text."""

    @abstractmethod
    def _page(self) -> str:
        """The study as one HTML page."""

    def _pictures(self) -> Sequence[str]:
        """Pictures that a notebook shows above the text, as HTML."""
        return ()

    def to_json(self, path: Any = None) -> str:
        """The data as JSON text, also written to `path` where one is given."""
        return as_json(self.to_dict(), path)

    def to_html(self, path: Any = None) -> str:
        """One self-contained HTML page, with a picture where the study has one, tables and verdicts, also written to `path` where
        one is given."""
        return written(self._page, path)

    def __str__(self) -> str:
        return self.table()

    def _repr_html_(self) -> str:
        return titled(f"{self.kind} of '{self.scene}'", *self._pictures(), plain(self.table()))


def grid(rows: Sequence[Sequence[str]], left: Sequence[str] = ()) -> list[str]:
    """The lines of a text table from rows of cells; the first column, and the texts in `left`, are aligned left, the others
    right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(n) if j == 0 or cell in left else cell.rjust(n)
                      for j, (cell, n) in enumerate(zip(row, widths, strict=True))).rstrip() for row in rows]
