"""Drawings of mechanisms: the shapes of a `Geometry` on matplotlib axes, in the plane or in space."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from mbdae.scene.components import Array
from mbdae.show.geometry import INK, Geometry, Shape, started
from mbdae.show.plots import dress, written
from mbdae.show.shapes import geometry
from mbdae.system.prepare import Prepared

PAD = 0.07  #: margin over the size of the drawing


@dataclass(frozen=True)
class Look:
    """How a kind of shape is drawn: line width and marker size in points, layer, dashes, opacity of its area (0..1), marker and
    its colour ("ink", "own" for that of the shape, or a name)."""

    width: float = 1.2
    layer: int = 4
    dash: tuple[float, ...] = ()
    fill: float = 0.0
    marker: str = ""
    size: float = 0.0
    face: str = ""
    casing: bool = False  #: a dark edge along the line


LOOKS: dict[str, Look] = {
    "ground": Look(1.1, 1),
    "guide": Look(1.0, 2, dash=(6, 3)),
    "plate": Look(2.4, 3, fill=0.3),
    "disc": Look(2.4, 3, fill=0.3),
    "ring": Look(1.4, 3),
    "bar": Look(5.0, 3, casing=True),
    "line": Look(1.2, 4),
    "thin": Look(1.3, 5),
    "dashed": Look(1.6, 4, dash=(5, 3)),
    "box": Look(1.6, 4, fill=0.15),
    "arrow": Look(1.7, 6),
    "pin": Look(1.6, 7, marker="o", size=7, face="white"),
    "ball": Look(1.6, 7, marker="o", size=8, face="ink"),
    "dot": Look(1.0, 7, marker="o", size=4, face="ink"),
    "weld": Look(1.6, 7, marker="s", size=7, face="ink"),
    "lock": Look(1.4, 6, marker="s", size=11),
    "mass": Look(1.6, 6, marker="o", size=13, face="own"),
    "centre": Look(1.4, 6, marker="+", size=8),
    "trail": Look(1.1, 2),
}  # fmt: skip


class Picture:
    """A geometry drawn on axes; `show(i)` moves it to its i-th time."""

    def __init__(self, axes: Any, seen: Geometry) -> None:
        self.axes, self.seen = axes, seen
        self._lines = [(self._line(shape), seen.polyline(shape)) for shape in seen.shapes]
        self._fills = [(self._patch(shape, line), line) for shape, (_, line) in zip(seen.shapes, self._lines, strict=True)
                       if LOOKS[shape.kind].fill and (seen.planar or shape.kind == "disc")]  # fmt: skip
        self.show(0)

    def show(self, i: int) -> None:
        """Move every line to the i-th time."""
        for artist, line in self._lines:
            self._place(artist, line[i])
        for patch, line in self._fills:
            if self.seen.planar:
                patch.set_xy(line[i][:, :2])
            else:
                patch.set_verts([line[i]])

    def _place(self, artist: Any, points: Array) -> None:
        if self.seen.planar:
            artist.set_data(points[:, 0], points[:, 1])
        else:
            artist.set_data_3d(*points.T)

    def _line(self, shape: Shape) -> Any:
        look = LOOKS[shape.kind]
        empty: Any = ([], []) if self.seen.planar else ([], [], [])
        (line,) = self.axes.plot(*empty, color=shape.colour, zorder=look.layer, clip_on=False, solid_capstyle="round",
                                 solid_joinstyle="round")  # fmt: skip
        if look.marker:
            face = {"ink": INK, "own": shape.colour, "": "none"}.get(look.face, look.face)
            line.set(marker=look.marker, markersize=look.size, markerfacecolor=face, markeredgewidth=look.width, linestyle="")
            line.set_markeredgecolor(INK if look.face == "own" else shape.colour)
            return line
        line.set(linewidth=look.width, linestyle=(0, look.dash) if look.dash else "-")
        if look.casing:
            from matplotlib import patheffects

            line.set_path_effects([patheffects.Stroke(linewidth=look.width + 1.6, foreground=INK), patheffects.Normal()])
        return line

    def _patch(self, shape: Shape, line: Array) -> Any:
        from matplotlib.patches import Polygon

        look = LOOKS[shape.kind]
        if not self.seen.planar:
            from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped,unused-ignore]

            return self.axes.add_collection3d(Poly3DCollection([line[0]], facecolor=shape.colour, alpha=look.fill))
        patch = Polygon(line[0][:, :2], closed=True, facecolor=shape.colour, alpha=look.fill, edgecolor="none", clip_on=False)
        patch.set_zorder(look.layer - 0.5)
        return self.axes.add_patch(patch)

    def trail(self, points: Array, colour: str) -> Any:
        """A function that draws the path up to the i-th of its points."""
        line = self._line(Shape("", "trail", colour, points[None]))
        return lambda i: self._place(line, points[: i + 1])


def axes_for(figure: Any, seen: Geometry, position: Any) -> Any:
    """Axes with equal scales, m, large enough for all times."""
    low, high = seen.bounds
    pad = PAD * float(np.max(high - low))
    if seen.planar:
        axes = figure.add_subplot(position)
        axes.set(xlim=(low[0] - pad, high[0] + pad), ylim=(low[1] - pad, high[1] + pad), xlabel="x [m]", ylabel="y [m]")
        axes.set_aspect("equal", "datalim" if figure.get_layout_engine() is None else "box")
        dress(axes)
        return axes
    from matplotlib.ticker import MaxNLocator

    axes = figure.add_subplot(position, projection="3d", computed_zorder=False)
    axes.set_proj_type("ortho")
    half = np.maximum((high - low) / 2 + pad, 0.3 * float(np.max(high - low)))
    for name, c, h in zip("xyz", (low + high) / 2, half, strict=True):
        axes.set(**{f"{name}lim": (c - h, c + h), f"{name}label": f"{name} [m]"})
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(4))
    axes.set_box_aspect(half, zoom=0.95)
    up = "xyz"[int(np.argmax(np.abs(seen.gravity)))] if np.any(seen.gravity) else "z"
    axes.view_init(elev=22, azim=-55, vertical_axis=up)
    return axes



def figure_size(seen: Geometry, width: float = 7.0) -> tuple[float, float]:
    """Width and height (inch) for the extent of a geometry."""
    if not seen.planar:
        return width, 6.0
    low, high = seen.bounds
    extent = high - low + 2 * PAD * float(np.max(high - low))
    return width, float(np.clip(0.6 + width * extent[1] / extent[0], 2.6, 7.5))


def draw(prepared: Prepared, path: Any = None) -> Any:
    """The scene as it starts: bodies, joints, forces, ground, names and gravity; a matplotlib figure."""
    from mbdae.show.figure import Figure

    seen = geometry(started(prepared))
    figure = Figure(figsize=figure_size(seen), layout="constrained" if seen.planar else None)
    margins = {} if seen.planar else {"left": 0.02, "right": 0.92, "bottom": 0.04, "top": 0.94}
    axes = axes_for(figure, seen, figure.add_gridspec(1, 1, **margins)[0])
    Picture(axes, seen)
    axes.set_title(f"{seen.name}, t = {seen.t[0]:g} s", fontsize="medium", loc="left")
    show_gravity(axes, seen)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    Namer(axes, seen).place()
    return written(figure, path, "draw")


def show_gravity(axes: Any, seen: Geometry) -> None:
    """An arrow along gravity in a corner (in the plane), or its direction in words."""
    g = float(np.linalg.norm(seen.gravity))
    if not g:
        return
    if not seen.planar:
        along = ", ".join(f"{x:g}" for x in seen.gravity)
        look = {"transform": axes.transAxes, "ha": "right", "va": "top", "fontsize": "small", "color": "0.25"}
        axes.text2D(1.0, 1.0, f"g = ({along}) m/s²", **look)
        return
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.transforms import ScaledTranslation

    inches = axes.figure.dpi_scale_trans + ScaledTranslation(1, 1, axes.transAxes)  # from the upper right corner
    middle, half = np.array([-0.14, 0.15]), 0.13 * seen.gravity[:2] / g
    ends = (tuple(middle - half), tuple(middle + half))
    look = {"arrowstyle": "-|>", "mutation_scale": 10, "shrinkA": 0, "shrinkB": 0, "color": "0.25", "clip_on": False}
    axes.add_artist(FancyArrowPatch(*ends, transform=inches, **look))
    axes.text(-0.34, 0.15, f"g = {g:.4g} m/s²", transform=inches, ha="right", va="center", fontsize="small", color="0.25")


class Namer:
    """Writes every name beside its item, where it covers little else."""

    WAYS = tuple((np.cos(a), np.sin(a)) for a in np.radians([45, 135, -45, -135, 90, 0, 180, -90]))
    HEIGHT = 8.0  #: of the letters, points

    def __init__(self, axes: Any, seen: Geometry) -> None:
        self.axes, self.seen, self.point = axes, seen, axes.figure.dpi / 72
        self.busy = np.vstack([self._dense(self._pixels(seen.polyline(s)[0])) for s in seen.shapes])
        self.boxes: list[tuple[float, float, float, float]] = []

    def _pixels(self, points: Array) -> Array:
        if not self.seen.planar:
            seen = np.c_[points, np.ones(len(points))] @ self.axes.get_proj().T
            points = seen[:, :2] / seen[:, 3:]
        return np.asarray(self.axes.transData.transform(points[:, :2]))

    @staticmethod
    def _dense(line: Array) -> Array:
        """Points every few pixels along a line (n, 2)."""
        parts = [line]
        for a, b in pairwise(line):
            n = int(np.hypot(*(b - a)) / 4)
            parts.append(a + (b - a) * (np.arange(1, n) / max(n, 1))[:, None])
        return np.vstack(parts)

    def place(self) -> None:
        """Write every name."""
        for label in sorted(self.seen.labels, key=lambda x: x.of_body):
            anchor = self._pixels(self.seen.place(label)[:1])[0]
            size = np.array([0.62 * self.HEIGHT * len(label.text) + 2, 1.3 * self.HEIGHT]) * self.point
            tries = [(anchor, way, reach) for reach in (7.0, 13.0, 21.0, 32.0) for way in self.WAYS]
            costs = [self._cost(self._box(*attempt, size), attempt[2]) for attempt in tries]
            self._write(label.text, self._box(*tries[int(np.argmin(costs))], size), label.of_body)

    def _box(self, anchor: Array, way: tuple[float, float], reach: float, size: Array) -> tuple[float, float, float, float]:
        """Left, bottom, right, top in pixels."""
        middle = anchor + np.array(way) * (reach * self.point + size / 2 * np.abs(way))
        low, high = middle - size / 2, middle + size / 2
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def _cost(self, box: tuple[float, float, float, float], reach: float) -> float:
        gap = 3 * self.point
        l, b, r, t = box[0] - gap, box[1] - gap, box[2] + gap, box[3] + gap
        inside = (self.busy[:, 0] > l) & (self.busy[:, 0] < r) & (self.busy[:, 1] > b) & (self.busy[:, 1] < t)
        lapped = sum(max(0.0, min(r, R) - max(l, L)) * max(0.0, min(t, T) - max(b, B)) for L, B, R, T in self.boxes)
        return float(np.count_nonzero(inside) + lapped + 0.1 * reach)

    def _write(self, text: str, box: tuple[float, float, float, float], of_body: bool) -> None:
        self.boxes.append(box)
        middle = self.axes.figure.transFigure.inverted().transform([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2])
        self.axes.figure.text(*middle, text, fontsize=self.HEIGHT, ha="center", va="center", color=INK if of_body else "#555555",
                              style="italic" if of_body else "normal", zorder=20)  # fmt: skip
