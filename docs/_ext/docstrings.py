"""Docstrings are plain text with `code` between backquotes; here they become what Sphinx reads."""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

PART = re.compile(r"(``[^`]+``|`[^`]+`)")
SPECIAL = re.compile(r"([\\*|_])")


def marked(text: str) -> str:
    """A line with its code marked and all else as it stands."""
    parts = PART.split(text)
    return "".join(f"``{part.strip('`')}``" if i % 2 else SPECIAL.sub(r"\\\1", part) for i, part in enumerate(parts))


def indent(line: str) -> int:
    """Blanks before a line."""
    return len(line) - len(line.lstrip())


def written(lines: list[str]) -> list[str]:
    """The docstring: indented blocks word for word, paragraphs as text, lines that begin with a dash as a list."""
    out: list[str] = []
    literal = False
    for line in lines:
        if not line.strip():
            out.append("")
        elif indent(line) >= 4 and (literal or not out or not out[-1]):
            out += [] if literal else ["::", ""]
            literal = True
            out.append(line)
        else:
            out += [""] if literal else []
            literal = False
            out.append(marked(line.strip()))
    return [*out, ""]


def rewrite(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """A listener of autodoc."""
    lines[:] = [] if lines[:1] and lines[0].startswith("Alias for field number") else written(lines)  # Python's own of tuples


def setup(app: Sphinx) -> dict[str, bool]:
    """Listen to autodoc."""
    app.connect("autodoc-process-docstring", rewrite)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
