"""Formulas of pages as MathML, by the writer that sets those of reports."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

from mbdae.documents.mathml import display, inline

TAG = re.compile(r"\\tag\{([^}]*)\}")


def visit_inline(writer: Any, node: nodes.math) -> None:
    """A formula in a line."""
    writer.body.append(f'<span class="formula">{inline(node.astext())}</span>')
    raise nodes.SkipNode


def visit_display(writer: Any, node: nodes.math_block) -> None:
    """A formula of its own, its number behind it."""
    text = node.astext()
    number = TAG.search(text)
    shown = f'<div class="number">({number[1]})</div>' if number else ""
    writer.body.append(f'<div class="equation"><div class="lines">{display(TAG.sub("", text).strip())}</div>{shown}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """For `html_math_renderer = "mathml"`."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
