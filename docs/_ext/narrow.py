"""What fits windows of every width: lines of code that continue further in, names and numbers that break where a reader would,
and wide tables, of which every cell knows the head of its column, so that a row can stand as a list (site.css)."""

from __future__ import annotations

import html
import re
from typing import Any

from mbdae.notation import labelled, whole


def table(found: re.Match[str]) -> str:
    """A table whose names may break behind their marks; of many columns, with their heads at the cells."""
    def broken(name: re.Match[str]) -> str:
        return re.sub(r"([_/.,=(]+)(?=\w)|(?<=\b[0-9a-f]{16})(?=[0-9a-f]{16})", r"\g<0><wbr>", name[0])

    return labelled(re.sub(r'(?<=<span class="pre">)[^<]*', broken, found[0]))


def code(found: re.Match[str]) -> str:
    """A block of code, every line a box of its own, whose continuation stands two letters further in than its beginning."""
    lines = []
    for line in found[2].removesuffix("\n").split("\n"):
        plain = html.unescape(re.sub(r"<[^>]+>", "", line))
        lines.append(f'<span class="line" style="--in: {len(plain) - len(plain.lstrip()) + 2}ch">{line}\n</span>')
    return f"{found[1]}{''.join(lines)}</pre>"


def fitted(app: Any, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """All tables, blocks of code and numbers of a page."""
    if "body" in context:
        body = re.sub(r"<table\b(?:(?!<table\b).)*?</table>", table, context["body"], flags=re.DOTALL)
        body = re.sub(r'(<div class="highlight"><pre>(?:<span></span>)?)(.*?)</pre>', code, body, flags=re.DOTALL)
        context["body"] = whole(body)


def setup(app: Any) -> dict[str, bool]:
    """As an extension of Sphinx."""
    app.connect("html-page-context", fitted)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
