"""Figures that notebooks show with any backend; they are unknown to pyplot, so that no figure appears twice."""

from __future__ import annotations

import io
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as _Figure
from matplotlib.mathtext import MathTextParser
from matplotlib.text import Text

_TEX = MathTextParser("path")


def readable(text: Text) -> Text:
    """A text of a figure, which is written as it stands where it contains TeX (between dollar signs) that cannot be read, as
    names of items may."""
    try:
        for line in text.get_text().split("\n") if "$" in text.get_text() else ():
            _TEX.parse(line)
    except ValueError:
        text.set_parse_math(False)
    return text


class Figure(_Figure):
    """A matplotlib figure."""

    def draw(self, renderer: Any) -> None:
        """Draw it, with every text that can be read as TeX, or as it stands."""
        for text in self.findobj(Text):
            readable(text)
        super().draw(renderer)

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        FigureCanvasAgg(self)

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png", dpi=100)
        return file.getvalue()
