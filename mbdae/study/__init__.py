"""What a study gives its user: text, data as JSON, and an HTML page, which loads no other file and has layouts for screens,
phones and print; and what users give to it: measurements, and ranges of numbers.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, ClassVar

import numpy as np

from mbdae.errors import ListsAttributes, OptionError
from mbdae.files import write_file
from mbdae.notation import counted, labelled, plain, titled, whole
from mbdae.values import Array, array, file_to_write, number, option, optional, sequence, shown, text

STYLE = """
:root { color-scheme: light dark; --ground: #fff; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 84rem; padding: 1rem 1.25rem 2rem; color: #1a1a1a; background: var(--ground);
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
.many { font-size: .75rem; } .many :is(th, td) { padding-inline: .3rem 0; } .many tbody th { white-space: normal; }
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
.kept { white-space: nowrap; }
@media (max-width: 700px) { .wide { display: none; } .narrow { display: block; } body { padding: .5rem .9rem 2rem; } }
@media screen and (max-width: 700px) {
  table { white-space: normal; overflow-wrap: normal; } th, td { padding-inline: .3rem; }
  /* a row of many columns is a block: its name, and below it each value under the head of its column; heads that sort stay */
  .many, .many caption, .many :is(thead, tbody) { display: block; } .many thead:not(:has(button)) { display: none; }
  .many thead tr { display: flex; flex-wrap: wrap; gap: 0 .9rem; } .many thead th { border: 0; padding: 0; }
  .many tbody tr { display: grid; grid-template-columns: repeat(auto-fill, minmax(5rem, 1fr)); gap: .2rem .6rem; align-items: end;
    padding: .45rem 0; border-bottom: 1px solid #999; }
  .scroll:has(.many) { width: auto; border: 0; } .many { font-size: .8rem; }
  .many tbody :is(th, td) { border: 0; padding: 0; text-align: left; line-height: 1.3; }
  .many td:empty { display: none; }
  .many tbody th { grid-column: 1 / -1; font-weight: 600; }
  .many td::before { content: attr(data-label); display: block; opacity: .75; }
}
@media screen and (prefers-color-scheme: dark) {
  :root { --ground: #16181b; } body { color: #e4e4e4; } a { color: #7cc0f5; } caption, .note { color: #b5b5b5; }
  th, td { border-bottom-color: #34383d; } .scroll, thead th { border-bottom-color: #777; }
  figure svg { filter: invert(1) hue-rotate(180deg); } tr.front { background: #1d2f3f; } tr.failed :is(td, th) { color: #ff9f7a; }
}
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
            f"<h1>{escape(title)}</h1>\n{whole(''.join(parts))}</main>\n{scripts}</body>\n</html>\n")


def section(name: str, title: str, content: str) -> str:
    """A section: `content` (HTML) under a heading with the id `name`."""
    return f'<section aria-labelledby="{name}"><h2 id="{name}">{escape(title)}</h2>\n{content}</section>\n'


def bullets(lines: Sequence[str]) -> str:
    """An HTML list of sentences."""
    return "<ul>" + "".join(f"<li>{escape(line)}</li>\n" for line in lines) + "</ul>\n"


def html_table(labelled_by: str, head: str, rows: Sequence[str], caption: str = "", kind: str = "") -> str:
    """A table that scrolls in its own box, also by keyboard. labelled_by: id of the heading that names it; head, rows: HTML of
    the table rows; kind: class of the <table> element."""
    captions = f"<caption>{escape(caption)}</caption>" if caption else ""
    table = f'<table class="{kind}">{captions}<thead><tr>{head}</tr></thead>\n<tbody>\n{"".join(rows)}</tbody></table>'
    return f'<div class="scroll" role="region" aria-labelledby="{labelled_by}" tabindex="0">{labelled(table)}</div>\n'


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


# -- measurements, and ranges of numbers, as users give them


def measurements(data: Any) -> dict[Any, tuple[Array, Array]]:
    """Measurements as a user gives them; OptionError for anything else."""
    remedy = "give a mapping of sensors to (times, values), such as {'D.angle': (t, measured)}"
    if not isinstance(data, Mapping) or not data:
        raise OptionError(f"data = {shown(data)}: {remedy}")
    found: dict[Any, tuple[Array, Array]] = {}
    for name, given in data.items():
        pair = option(f"data: {shown(name)}", given, sequence, remedy, each=lambda one: one)
        if len(pair) != 2:
            raise OptionError(f"data: {shown(name)} has {counted(len(pair), 'entry')}: {remedy}")
        plainly = "give an array of numbers, without what was not measured"
        t, values = (option(f"data: {what} of {shown(name)}", one, array, plainly)
                     for what, one in zip(("times", "values"), pair, strict=True))
        if t.ndim != 1 or t.shape != values.shape or not len(t):
            raise OptionError(f"data: {shown(name)} has times of shape {t.shape} and values of shape {values.shape}: give as "
                              "many values as times")
        if t.min() < 0:
            raise OptionError(f"data: {shown(name)} has a time of {t.min():g} s: runs begin at 0 s; count times from there on")
        found[name] = t, values
    if max(t.max() for t, _ in found.values()) <= 0:
        raise OptionError("data: all measurements are of t = 0 s, where the run begins, so that there is no run to fit: give one "
                          "or more of a later time")
    return found


def deviations(sigma: Any, data: Mapping[Any, tuple[Array, Array]]) -> dict[Any, Array]:
    """Standard deviations (n,) of the measurements by sensor; where none are given the root mean square of all measurements, so
    that their unit does not decide where a fit ends."""
    remedy = "give positive standard deviations: a number, an array with one for each measurement, or either by sensor"
    if isinstance(sigma, Mapping) and sigma.keys() != data.keys():
        raise OptionError(f"sigma is given for {', '.join(map(str, sigma))}: {remedy}, for {', '.join(map(str, data))}")
    found = {}
    size = float(np.sqrt(np.mean(np.concatenate([values for _, values in data.values()]) ** 2))) or 1.0
    for name, (t, _) in data.items():
        given = sigma[name] if isinstance(sigma, Mapping) else size if sigma is None else sigma
        one = option("sigma", given, array, remedy)
        if one.shape not in ((), t.shape):
            raise OptionError(f"sigma has shape {one.shape} for the {len(t)} measurements of {shown(name)}: {remedy}")
        if not np.all(one > 0):
            raise OptionError(f"sigma = {shown(given)}: {remedy}")
        found[name] = np.broadcast_to(one, t.shape).astype(float)
    return found


def limits(bounds: Any, names: Sequence[str]) -> tuple[Array, Array]:
    """Least and largest values (k,) of the numbers."""
    remedy = "give a mapping of names in `to` to (least, largest), None for none, such as {'C.spring': (0, None)}"
    given = {} if bounds is None else bounds
    if not isinstance(given, Mapping):
        raise OptionError(f"bounds = {shown(bounds)}: {remedy}")
    if others := [name for name in given if name not in names]:
        raise OptionError(f"bounds: {', '.join(map(shown, others))} is not in to = {shown(list(names))}: {remedy}")
    low, high = np.full(len(names), -np.inf), np.full(len(names), np.inf)
    for name, pair in given.items():
        both = option(f"bounds: '{name}'", pair, sequence, remedy, each=lambda one: None if one is None else number(one))
        if len(both) != 2:
            raise OptionError(f"bounds: '{name}' = {shown(pair)}: {remedy}")
        for ends, one in ((low, both[0]), (high, both[1])):
            if one is not None:
                ends[names.index(name)] = one
    if np.any(low >= high):
        name = names[int(np.argmax(low >= high))]
        raise OptionError(f"bounds: '{name}' = {shown(given[name])}: the least value is not below the largest one: {remedy}")
    return low, high


def ranges(to: Any) -> tuple[list[str], Array, Array]:
    """Names of numbers with their least and largest values."""
    remedy = "give a mapping of names of numbers to (least, largest), such as {'coupler.mass': (0.1, 2.0)}"
    if not isinstance(to, Mapping) or not to:
        raise OptionError(f"to = {shown(to)}: {remedy}")
    names = [option("to", name, text, remedy) for name in to]
    pairs = [option(f"to: '{name}'", to[name], sequence, remedy, each=number) for name in names]
    for name, pair in zip(names, pairs, strict=True):
        if len(pair) != 2 or pair[0] >= pair[1]:
            raise OptionError(f"to: '{name}' = {shown(to[name])}: {remedy}")
    low, high = np.array(pairs).T
    return names, low, high
