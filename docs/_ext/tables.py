"""Wide tables on telephones: every cell knows the head of its column, so that a row can stand as a list (site.css)."""

from __future__ import annotations

import html
import re
from itertools import count
from typing import Any

WIDE = 5  #: smallest number of columns of a table whose rows become lists in a narrow window


def labelled(table: re.Match[str]) -> str:
    """A table with the heads of its columns at its cells."""
    head, row, body = table[0].partition("</thead>")
    names = [html.escape(html.unescape(re.sub(r"<[^>]+>", "", cell)).strip(), quote=True)
             for cell in re.findall(r"<th\b[^>]*>(.*?)</th>", head, re.DOTALL)]
    if len(names) < WIDE or "colspan" in table[0] or "rowspan" in table[0]:
        return table[0]

    def cells(found: re.Match[str]) -> str:
        column = count()
        return re.sub(r"<td\b", lambda _: f'<td data-label="{names[next(column) % len(names)]}"', found[0])

    return head.replace('class="', 'class="many ', 1) + row + re.sub(r"<tr\b.*?</tr>", cells, body, flags=re.DOTALL)


def labels(app: Any, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """All tables of a page."""
    if "body" in context:
        context["body"] = re.sub(r"<table\b(?:(?!<table\b).)*?</table>", labelled, context["body"], flags=re.DOTALL)


def setup(app: Any) -> dict[str, bool]:
    """As an extension of Sphinx."""
    app.connect("html-page-context", labels)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
