"""Units of what sensors measure, and numbers of things in words.

HTML that notebooks show for objects: tables, pictures and whole pages.

The arguments of calls by name.
"""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from inspect import Parameter, Signature
from itertools import count, groupby
from typing import Any, TypeVar

T = TypeVar("T")
UNITS: dict[str, str] = {}  #: quantity of sensors -> its SI unit, "" where it has none; `quantity` enters them
LOOPS: set[str] = {"drive"}  #: those that follow from accelerations and reactions, so that no load can read them


def quantity(unit: str, loop: bool = False) -> Callable[[T], T]:
    """Decorator of the function of a property of a sensor: its SI unit, by which tables, plots, sweeps, conditions and messages
    know it. loop: whether it follows from accelerations or reactions."""

    def entered(function: T) -> T:
        UNITS[name := getattr(function, "__name__", "")] = unit
        LOOPS.update({name} if loop else ())
        return function

    return entered


def counted(count: int, noun: str) -> str:
    """A number of things in words: "1 row", "2 rows", "1 degree of freedom", "3 bodies"."""
    first, *rest = noun.split(" of ")
    many = f"{first[:-1]}ies" if first.endswith("y") else f"{first}es" if first.endswith("s") else f"{first}s"
    return " of ".join([f"{count} {first if count == 1 else many}", *rest])


def together(parts: Sequence[str]) -> str:
    """Parts of a sentence in a row: "a", "a and b", "a, b and c"."""
    return " and ".join([", ".join(parts[:-1])] * (len(parts) > 1) + list(parts[-1:]))


STYLE = "text-align:left;vertical-align:top;padding:2px 12px 2px 0"
WIDE = 4  #: smallest number of columns of a table whose rows become lists in a narrow window
PLAYER_HEIGHT = 660  #: height of a page inside of a notebook, px
#: of a frame that becomes as high as its page, where the browser lets it be read
FITTING = ' onload="const d = this.contentDocument; if (d) this.style.height = d.documentElement.offsetHeight + 2 + \'px\'"'


def titled(title: str, *parts: str) -> str:
    """Parts of HTML under a title."""
    return f"<div><b>{html.escape(title)}</b>{''.join(parts)}</div>"


def rows(table: Iterable[Sequence[Any]], head: Sequence[str] = ()) -> str:
    """A table; texts are escaped."""
    top = f"<thead><tr>{_cells('th', head)}</tr></thead>" if head else ""
    body = "".join(f"<tr>{_cells('td', row)}</tr>" for row in table)
    return f"<table>{top}<tbody>{body}</tbody></table>"


def _cells(tag: str, row: Sequence[Any]) -> str:
    return "".join(f'<{tag} style="{STYLE}">{html.escape(str(cell))}</{tag}>' for cell in row)


def lines(text: str) -> str:
    """Lines "name: value" as a table of two columns; a line without a name continues the one before."""
    found: list[list[str]] = []
    for line in text.splitlines():
        name, colon, rest = line.strip().partition(": ")
        if colon:
            found.append([name, rest])
        elif line.strip():
            found.append(["", line.strip()])
    return rows(found)


def labelled(table: str) -> str:
    """HTML of a table. Of many columns it gets the class `many`, and every cell the head of its column, so that a style can show
    a row as a list in a narrow window."""
    head, row, body = table.partition("</thead>")
    names = [html.escape(html.unescape(re.sub(r"<[^>]+>", "", cell)).strip(), quote=True)
             for cell in re.findall(r"<th\b[^>]*>(.*?)</th>", head, re.DOTALL)]
    if len(names) < WIDE or "colspan" in table or "rowspan" in table:
        return table

    def cells(found: re.Match[str]) -> str:
        column = count()
        return re.sub(r"<t[dh]\b", lambda cell: f'{cell[0]} data-label="{names[next(column) % len(names)]}"', found[0])

    return head.replace('class="', 'class="many ', 1) + row + re.sub(r"<tr\b.*?</tr>", cells, body, flags=re.DOTALL)


def whole(page: str) -> str:
    """HTML whose numbers, such as 1e-6, stay on one line, by the class `kept`."""
    elsewhere = "span|code|pre|text|tspan|title|style|script|m[a-z]+"  # elements that keep what they hold
    return re.sub(rf"(?<![\w.])(-?[\d.]+e-\d+)(?!\w)(?=[^<>]*<(?!/(?:{elsewhere})>))", r'<span class="kept">\1</span>', page)


def plain(text: str) -> str:
    """Text with its line breaks; columns stay side by side and scroll where they are wider than their box, sentences break."""
    shown = {True: "pre-wrap", False: "pre;overflow-x:auto"}
    blocks = groupby(text.splitlines(), lambda line: "  " not in line.strip())
    return "".join(f'<pre style="margin:0;white-space:{shown[said]}">{html.escape(chr(10).join(block))}</pre>'
                   for said, block in blocks)


def picture(file: bytes, kind: str = "png") -> str:
    """An image inside of the page, its bytes as text (base64)."""
    return f'<img style="max-width:100%" src="data:image/{kind};base64,{base64.b64encode(file).decode("ascii")}">'


def framed(page: str, fitting: bool = False) -> str:
    """A whole page in a frame, so that its scripts and styles do not mix with those around it; fitting: of its own height."""
    return (f'<iframe srcdoc="{html.escape(page)}" style="width:100%;height:{PLAYER_HEIGHT}px;border:0"'
            f"{FITTING if fitting else ''}></iframe>")


class Arguments:
    """The arguments of calls of one method, without the object itself, by name: as `Signature.bind` has them, which takes longer
    than to read most arguments."""

    def __init__(self, signature: Signature) -> None:
        self.signature, own = signature, list(signature.parameters.values())[1:]
        kinds = {kind: [p.name for p in own if p.kind is kind] for kind in {p.kind for p in own}}
        self.names = tuple(p.name for p in own)
        self.placed = tuple(kinds.get(Parameter.POSITIONAL_OR_KEYWORD, ()))  #: those that may be given by their place
        self.rest = next(iter(kinds.get(Parameter.VAR_POSITIONAL, ())), "")  #: name of *rest
        self._free = bool(kinds.get(Parameter.VAR_KEYWORD))
        self._known = {*self.placed, *kinds.get(Parameter.KEYWORD_ONLY, ())}
        self._needed = {p.name for p in own if p.name in self._known and p.default is Parameter.empty}

    def by_name(self, args: Sequence[Any], given: Mapping[str, Any]) -> dict[str, Any]:
        """The arguments in the order of the method; TypeError as a call with them raises."""
        found = dict(zip(self.placed, args, strict=False))
        if len(args) > len(found) and self.rest:
            found[self.rest] = tuple(args[len(self.placed) :])
        plain = self.rest in found or len(args) <= len(self.placed)
        if not plain or self._free or not (given.keys() <= self._known) or given.keys() & found.keys():
            return dict([*self.signature.bind(None, *args, **given).arguments.items()][1:])
        found.update(given)
        if not (self._needed <= found.keys()):
            self.signature.bind(None, *args, **given)
        return {name: found[name] for name in self.names if name in found}

    def as_call(self, found: Mapping[str, Any]) -> tuple[list[Any], dict[str, Any]]:
        """Arguments by name as those of a call, by their places as far as these go."""
        first = next((i for i, name in enumerate(self.placed) if name not in found), len(self.placed))
        args = [found[name] for name in self.placed[:first]]
        if first == len(self.placed) and self.rest:
            args += found.get(self.rest, ())
        left = {name: value for name, value in found.items() if name not in (*self.placed[:first], self.rest)}
        return args, left | left.pop("further", {}) if self._free else left
