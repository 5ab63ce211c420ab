"""Drawings of mechanisms: the shapes of a `Geometry` on matplotlib axes, in the plane or in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.results.stored_parts import started
from mbdae.show import Namer, fitting, symbols
from mbdae.show.geometry import INK, Geometry, Outline
from mbdae.show.plots import dress, written
from mbdae.show.shapes import geometry
from mbdae.system.prepare import Prepared
from mbdae.values import Array

PAD = 0.07  #: ratio of the margin to the size of the drawing
LIGHT = np.array([0.4, -0.8, 0.9])  #: direction towards the light, with z upright
LETTERS = 70  #: largest number of letters in a line of the title of a picture
DARKER = 0.3  #: reduction of brightness of every other sector of a ball or cylinder


@dataclass(frozen=True)
class Look:
    """Style of a kind of shape: line width and marker size in points, layer, dashes, opacity of its area (0 to 1), marker and its
    colour ("ink", "own" for the colour of the shape, or a colour name)."""

    width: float = 1.2
    layer: int = 4
    dash: tuple[float, ...] = ()
    fill: float = 0.0
    marker: str = ""
    size: float = 0.0
    face: str = ""
    casing: bool = False  #: whether the line has a dark edge
    rod: float = 0.0  #: radius as a rod, or of a marker as a ball, with light; over the size of symbols


LOOKS: dict[str, Look] = {
    "grid": Look(0.7, 0),
    "hatch": Look(1.0, 1, rod=0.06),
    "ground": Look(1.1, 1, rod=0.08),
    "guide": Look(1.0, 2, dash=(6, 3), rod=0.07),
    "plate": Look(2.4, 3, fill=0.3, rod=0.2),
    "disc": Look(2.4, 3, fill=0.3, rod=0.12),
    "ring": Look(1.4, 3, rod=0.12),
    "solid": Look(0.0, 3),
    "bar": Look(5.0, 3, casing=True, rod=0.36),
    "line": Look(1.2, 4, rod=0.1),
    "thin": Look(1.3, 5, rod=0.1),
    "dashed": Look(1.6, 4, dash=(5, 3), rod=0.08),
    "box": Look(1.6, 4, fill=0.15, rod=0.1),
    "arrow": Look(1.7, 6, rod=0.15),
    "push": Look(1.7, 6, rod=0.15),
    "pin": Look(1.6, 7, marker="o", size=7, face="white", rod=0.45),
    "ball": Look(1.6, 7, marker="o", size=8, face="ink", rod=0.55),
    "dot": Look(1.0, 7, marker="o", size=4, face="ink", rod=0.28),
    "weld": Look(1.6, 7, marker="s", size=7, face="ink", rod=0.5),
    "lock": Look(1.4, 6, marker="s", size=11, rod=0.5),
    "mass": Look(1.6, 6, marker="o", size=13, face="own", rod=0.85),
    "centre": Look(1.4, 6, marker="+", size=8, rod=0.24),
    "trail": Look(1.1, 2),
}


class Picture:
    """A geometry drawn on matplotlib axes; `show(i)` moves it to its i-th time."""

    def __init__(self, axes: Any, seen: Geometry) -> None:
        self.axes, self.seen = axes, seen
        lines = [shape for shape in seen.shapes if not shape.faces]
        self._lines = [(self._line(shape), seen.polyline(shape)) for shape in lines]
        self._fills = [(self._patch(shape, line), line) for shape, (_, line) in zip(lines, self._lines, strict=True)
                       if LOOKS[shape.kind].fill and (seen.planar or shape.kind == "disc")]
        solids = [shape for shape in seen.shapes if shape.faces]
        self._solids = Solids(axes, seen, solids) if solids else None
        self._trails: list[Any] = []
        self.show(0)

    @property
    def artists(self) -> list[Any]:
        """Artists that `show` and the functions returned by `trail` move."""
        drawn = [artist for artist, _ in self._lines + self._fills]
        return drawn + self._trails + ([] if self._solids is None else [self._solids.faces])

    def show(self, i: int) -> None:
        """Move every shape to the i-th time."""
        for artist, line in self._lines:
            self._place(artist, line[i])
        for patch, line in self._fills:
            if self.seen.planar:
                patch.set_xy(line[i][:, :2])
            else:
                patch.set_verts([line[i]])
        if self._solids is not None:
            self._solids.show(i)

    def _place(self, artist: Any, points: Array) -> None:
        if self.seen.planar:
            artist.set_data(points[:, 0], points[:, 1])
        else:
            artist.set_data_3d(*points.T)

    def _line(self, shape: Outline) -> Any:
        look = LOOKS[shape.kind]
        empty: Any = ([], []) if self.seen.planar else ([], [], [])
        (line,) = self.axes.plot(*empty, color=shape.colour, zorder=look.layer, clip_on=False, solid_capstyle="round",
                                 solid_joinstyle="round")
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

    def _patch(self, shape: Outline, line: Array) -> Any:
        from matplotlib.patches import Polygon

        look = LOOKS[shape.kind]
        if not self.seen.planar:
            from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped,unused-ignore]

            return self.axes.add_collection3d(Poly3DCollection([line[0]], facecolor=shape.colour, alpha=look.fill))
        patch = Polygon(line[0][:, :2], closed=True, facecolor=shape.colour, alpha=look.fill, edgecolor="none", clip_on=False)
        patch.set_zorder(look.layer - 0.5)
        return self.axes.add_patch(patch)

    def trail(self, points: Array, colour: str) -> Any:
        """A function of i that draws the path up to its i-th point."""
        line = self._line(Outline("", "trail", colour, points[None]))
        self._trails.append(line)
        return lambda i: self._place(line, points[: i + 1])


class Solids:
    """Faces of all solids in space in one collection, so that nearer faces hide those behind; those turned away are left out."""

    def __init__(self, axes: Any, seen: Geometry, shapes: list[Outline]) -> None:
        from matplotlib.colors import to_rgb
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped,unused-ignore]

        self.shapes = [(shape, seen.polyline(shape)) for shape in shapes]
        self.colours = np.array([np.array(to_rgb(x.colour)) * (1 - DARKER * shade) for x in shapes for shade in x.shades])
        k, down = upwards(seen)
        self.light = symbols.unit(np.roll(LIGHT, k - 2) * np.where([down and i != (k + 1) % 3 for i in range(3)], -1, 1))
        self.axes = axes
        self.faces = axes.add_collection3d(Poly3DCollection(self._corners(0)), autolim=False)
        self.faces.set(zorder=LOOKS["solid"].layer, linewidth=0.8)

    def _corners(self, i: int) -> list[Array]:
        return [points[i][list(face)] for shape, points in self.shapes for face in shape.faces]

    def show(self, i: int) -> None:
        """Move every face to the i-th time."""
        corners = self._corners(i)
        out = np.array([np.cross(c[2] - c[0], c[-1] - c[1]) for c in corners])
        seen = np.flatnonzero(out @ np.cross(*self.axes.get_proj()[:2, :3]) > 0)
        lit = out[seen] @ self.light / np.maximum(np.linalg.norm(out[seen], axis=1), 1e-300)
        colours = self.colours[seen] * (0.62 + 0.38 * np.clip(lit, 0, 1))[:, None]
        self.faces.set_verts([corners[k] for k in seen])
        self.faces.set_facecolor(colours)
        self.faces.set_edgecolor(colours)


def upwards(seen: Geometry) -> tuple[int, bool]:
    """Number of the axis that is drawn upright in space, and whether it points down, along gravity."""
    k = int(np.argmax(np.abs(seen.gravity))) if np.any(seen.gravity) else 2
    return k, bool(seen.gravity[k] > 0)


def axes_for(figure: Any, seen: Geometry, position: Any, axes: Any = None) -> Any:
    """Axes with equal scales, m, that contain the geometry at all times; axes: those to be used, None for new ones."""
    low, high = seen.bounds
    pad = PAD * float(np.max(high - low))
    if seen.planar:
        given, axes = axes is not None, axes or figure.add_subplot(position)
        axes.set(xlim=(low[0] - pad, high[0] + pad), ylim=(low[1] - pad, high[1] + pad), xlabel="x [m]", ylabel="y [m]")
        axes.set_aspect("equal", "datalim" if figure.get_layout_engine() is None and not given else "box")
        dress(axes)
        return axes
    from matplotlib.ticker import MaxNLocator

    axes = axes or figure.add_subplot(position, projection="3d")
    axes.computed_zorder = False
    axes.set_proj_type("ortho")
    half = np.maximum((high - low) / 2 + pad, 0.3 * float(np.max(high - low)))
    k, down = upwards(seen)
    for i, (name, c, h) in enumerate(zip("xyz", (low + high) / 2, half, strict=True)):
        h = -h if down and i != (k + 1) % 3 else h  # with the one that points down another axis is reversed: no mirror image
        axes.set(**{f"{name}lim": (c - h, c + h), f"{name}label": f"{name} [m]"})
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(4))
    axes.set_box_aspect(half, zoom=0.95)
    axes.view_init(elev=22, azim=-55, vertical_axis="xyz"[k])
    return axes


def figure_size(seen: Geometry, width: float = 7.0) -> tuple[float, float]:
    """Width and height (inch) of a figure for the extent of a geometry."""
    if not seen.planar:
        return width, 6.0
    low, high = seen.bounds
    extent = high - low + 2 * PAD * float(np.max(high - low))
    return width, float(np.clip(0.6 + width * extent[1] / extent[0], 2.6, 7.5))


def draw(prepared: Prepared, path: Any = None, hide: Sequence[str] = (), ax: Any = None) -> Any:
    """Drawing of the scene at its start, as a matplotlib figure: bodies, joints, forces, ground, names and gravity."""
    from mbdae.show import Figure

    seen = geometry(started(prepared), hide)
    if ax is None:
        figure = Figure(figsize=figure_size(seen), layout="constrained" if seen.planar else None)
        margins = {} if seen.planar else {"left": 0.02, "right": 0.92, "bottom": 0.04, "top": 0.94}
        axes = axes_for(figure, seen, figure.add_gridspec(1, 1, **margins)[0])
    else:
        figure, axes = ax.figure, axes_for(ax.figure, seen, None, ax)
    Picture(axes, seen)
    entitled(axes, seen, f"{seen.name}, t = {seen.t[0]:g} s", across=ax is None)
    show_gravity(axes, seen)
    figure.draw_without_rendering()
    if ax is None:
        figure.set_layout_engine("none")
    Namer(axes, seen).place()
    return written(figure, path, "draw")


def entitled(axes: Any, seen: Geometry, title: str, across: bool = True, **look: Any) -> Any:
    """The artist of a title: above the axes in space, across the whole figure in the plane, where the axes can be narrow."""
    text = fitting(title, LETTERS)
    if seen.planar and across:
        return axes.figure.suptitle(text, x=0.02, ha="left", fontsize="medium", **look)
    return axes.set_title(text, fontsize="medium", loc="left", **look)


def show_gravity(axes: Any, seen: Geometry) -> None:
    """Draw an arrow along gravity in a corner (in the plane), or write its direction in words."""
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

    # coordinates in inches from the upper right corner
    inches = axes.figure.dpi_scale_trans + ScaledTranslation(1, 1, axes.transAxes)
    middle, half = np.array([-0.14, 0.15]), 0.13 * seen.gravity[:2] / g
    ends = (tuple(middle - half), tuple(middle + half))
    look = {"arrowstyle": "-|>", "mutation_scale": 10, "shrinkA": 0, "shrinkB": 0, "color": "0.25", "clip_on": False}
    axes.add_artist(FancyArrowPatch(*ends, transform=inches, **look))
    axes.text(-0.34, 0.15, f"g = {g:.4g} m/s²", transform=inches, ha="right", va="center", fontsize="small", color="0.25")
