"""Pictures of results: plots, drawings, animations.

Figures that notebooks show with any backend; they are unknown to pyplot, so that no figure appears twice; the
names placed in them.
"""

from __future__ import annotations

import io
from itertools import pairwise, product
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as _Figure
from matplotlib.mathtext import MathTextParser
from matplotlib.text import Text

from mbdae.show.geometry import INK, Geometry, Label
from mbdae.values import Array

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
        for found in self.findobj(Text):
            readable(found)
        super().draw(renderer)

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        FigureCanvasAgg(self)

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png", dpi=100)
        return file.getvalue()


# -- Placement of names in pictures: beside their items, inside the picture, without overlap


WIDE = 26  #: largest number of letters in a line of a name
FAR = 22.0  #: distance (points) of the box of a name from its item above which a line connects them
#: cost of a square pixel of a name over another name, and of a pixel of length by which it is outside the picture
LAPPED, OUTSIDE = 1e4, 1e6

Box = tuple[float, float, float, float]  #: left, bottom, right, top in pixels


def fitting(text: str, letters: int) -> str:
    """A text in lines of at most `letters` letters, broken at blanks, or inside words that are longer than a line."""
    return "\n".join(wrap(text, letters, break_on_hyphens=False)) or text


class Namer:
    """Places every name beside its item, where it covers little else."""

    ANGLES = np.radians([45, 135, -45, -135, 90, 0, 180, -90, 22, 158, -22, -158])
    WAYS = tuple((float(np.cos(a)), float(np.sin(a))) for a in ANGLES)
    REACHES = (7.0, 13.0, 21.0, 32.0, 48.0, 70.0, 100.0, 140.0, 200.0)
    HEIGHTS = (8.0, 7.0, 6.0, 5.0, 4.0)  #: heights of the letters, points

    def __init__(self, axes: Any, seen: Geometry) -> None:
        self.axes, self.seen, self.figure = axes, seen, axes.figure
        self.point = self.figure.dpi / 72
        lines = [self._pixels(line) for s in seen.shapes if s.kind != "grid" for line in _lines(seen.polyline(s)[0], s.faces)]
        self.busy = np.vstack([self._dense(line) for line in lines] or [np.zeros((0, 2))])
        self.boxes: list[Box] = [self._extent(artist) for artist in self._written()]
        self.width, self.height = (float(x) for x in self.figure.get_size_inches() * self.figure.dpi)

    def _written(self) -> list[Any]:
        """Texts already in the picture: title, names and numbers of the axes, gravity."""
        axis = [self.axes.xaxis, self.axes.yaxis]
        found = [*self.figure.texts, self.axes._left_title, *self.axes.texts]
        if self.seen.planar:
            found += [a.label for a in axis] + [label for a in axis for label in a.get_ticklabels()]
        return [text for text in found if text.get_visible() and text.get_text()]

    def _extent(self, artist: Any) -> Box:
        box = artist.get_window_extent()
        return float(box.x0), float(box.y0), float(box.x1), float(box.y1)

    def _pixels(self, points: Array) -> Array:
        if not self.seen.planar:
            seen = np.c_[points, np.ones(len(points))] @ self.axes.get_proj().T
            points = seen[:, :2] / seen[:, 3:]
        return np.asarray(self.axes.transData.transform(points[:, :2]))

    @staticmethod
    def _dense(line: Array) -> Array:
        """Points (n, 2) every few pixels along a line."""
        parts = [line]
        for a, b in pairwise(line):
            n = int(np.hypot(*(b - a)) / 4)
            parts.append(a + (b - a) * (np.arange(1, n) / max(n, 1))[:, None])
        return np.vstack(parts)

    def place(self) -> None:
        """Place every name, with smaller letters where there is not room for all."""
        already = list(self.boxes)
        for height in self.HEIGHTS:
            self.boxes, texts = list(already), [self._text(label, height) for label in self.seen.labels]
            order = sorted(zip(self.seen.labels, texts, strict=True), key=lambda pair: pair[0].of_body)
            placed = [(text, *self._placed(label, text)) for label, text in order]
            if not any(lapped for *_, lapped in placed) or height == self.HEIGHTS[-1]:
                break
            for text in texts:
                text.remove()
        for text, anchor, box, _ in placed:
            middle = np.array([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2])
            text.set_position(self.figure.transFigure.inverted().transform(middle))
            # draw a thin line from a name to its item where they are far apart
            near = np.clip(anchor, box[:2], box[2:])
            if np.linalg.norm(near - anchor) > FAR * self.point:
                from matplotlib.lines import Line2D

                ends = self.figure.transFigure.inverted().transform(np.array([near, anchor]))
                self.figure.add_artist(Line2D(*ends.T, color="#999999", linewidth=0.6, zorder=19))

    def _text(self, label: Label, height: float) -> Any:
        from matplotlib.patheffects import withStroke

        from mbdae.show import readable

        look: dict[str, Any] = {"color": INK, "style": "italic"} if label.of_body else {"color": "#555555", "style": "normal"}
        look |= {"fontsize": height, "ha": "center", "va": "center"}
        text = readable(self.figure.text(0, 0, fitting(label.text, WIDE), zorder=20, **look))
        text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
        return text

    def _placed(self, label: Label, text: Any) -> tuple[Array, Box, bool]:
        """Point of the item and box of its name, in pixels, and whether the box covers another name."""
        anchor = self._pixels(self.seen.place(label)[:1])[0]
        l, b, r, t = self._extent(text)
        size = np.array([r - l, t - b]) + self.point
        tries = [(self._inside(self._box(anchor, way, reach, size)), reach) for reach, way in product(self.REACHES, self.WAYS)]
        costs = [self._cost(box, reach) for box, reach in tries]
        if min(costs) >= LAPPED:
            middles = product(*(np.arange(n / 2, whole, n / 2) for n, whole in zip(size, (self.width, self.height), strict=True)))
            free = [(self._inside((x - size[0] / 2, y - size[1] / 2, x + size[0] / 2, y + size[1] / 2)),
                     float(np.hypot(x - anchor[0], y - anchor[1])) / self.point) for x, y in middles]
            tries, costs = [*tries, *free], [*costs, *(self._cost(box, reach) for box, reach in free)]
        box = tries[int(np.argmin(costs))][0]
        lapped = self._lapped(box) > 0
        self.boxes.append(box)
        return anchor, box, lapped

    def _box(self, anchor: Array, way: tuple[float, float], reach: float, size: Array) -> Box:
        middle = anchor + np.array(way) * (reach * self.point + size / 2 * np.abs(way))
        low, high = middle - size / 2, middle + size / 2
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def _inside(self, box: Box) -> Box:
        """The box moved into the picture."""
        rim = 2 * self.point
        x = max(rim - box[0], 0.0) + min(self.width - rim - box[2], 0.0)
        y = max(rim - box[1], 0.0) + min(self.height - rim - box[3], 0.0)
        return box[0] + x, box[1] + y, box[2] + x, box[3] + y

    def _cost(self, box: Box, reach: float) -> float:
        gap = 3 * self.point
        l, b, r, t = box[0] - gap, box[1] - gap, box[2] + gap, box[3] + gap
        covered = (self.busy[:, 0] > l) & (self.busy[:, 0] < r) & (self.busy[:, 1] > b) & (self.busy[:, 1] < t)
        outside = max(0.0, r - gap - self.width) + max(0.0, t - gap - self.height)
        return float(np.count_nonzero(covered) + LAPPED * self._lapped(box) + OUTSIDE * outside + 0.4 * reach)

    def _lapped(self, box: Box) -> float:
        """Area of a box over other names, square pixels."""
        l, b, r, t = box
        return sum(max(0.0, min(r, R) - max(l, L)) * max(0.0, min(t, T) - max(b, B)) for L, B, R, T in self.boxes)


def _lines(points: Array, faces: tuple[tuple[int, ...], ...]) -> list[Array]:
    """Lines of a shape: the polyline, or both diagonals of each face."""
    return [points[[face[0], face[2], face[1], face[-1]]] for face in faces] or [points]
