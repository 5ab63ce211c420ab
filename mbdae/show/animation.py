"""Animations of a result, as a GIF, as an HTML page with a player, or as a glTF file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.errors import OptionError
from mbdae.files import replacing, write_file
from mbdae.notation import framed, picture
from mbdae.scene.components import Body, Connection, Place
from mbdae.show import fitting
from mbdae.show.drawing import LETTERS, Picture, axes_for, entitled, figure_size, show_gravity
from mbdae.show.gltf import glb
from mbdae.show.player import page
from mbdae.show.plots import PLACE, checked, dress, names_of, numbers, steady, style, track
from mbdae.show.shapes import SMOOTH, Curve, Film, digits, filmed, frame_times, natural_speed
from mbdae.values import number, option, optional, sequence, text

NEARLY = 245  #: value of red, green and blue above which a colour is white
DPI = 80  #: resolution of a GIF, pixels per inch


class Animation:
    """An animation: `html` is its page (for a .gif the picture), which a notebook shows; path: its file, or None; left_out: names
    of the bodies whose deformed meshes a .glb leaves out."""

    def __init__(self, name: str, html: str, path: Path | None, left_out: Sequence[str] = ()) -> None:
        self.name, self.html, self.path, self.left_out = name, html, path, list(left_out)

    def __repr__(self) -> str:
        without = f", without the meshes of {', '.join(self.left_out)}" if self.left_out else ""
        return f"<Animation of '{self.name}'{'' if self.path is None else f', {self.path}'}{without}>"

    def _repr_html_(self) -> str:
        return self.html if self.path is not None and self.path.suffix.lower() == ".gif" else framed(self.html, fitting=True)


def animate(result: Any, path: Any, sensors: Sequence[str], fps: float, speed: float | None, trail: Any,
            hide: Any = ()) -> Animation:
    """Make an animation, and write it as .gif, .html or .glb where a path is given; see `Result.animate`."""
    file = None if path is None else checked(path, (".gif", ".html", ".glb"), "animate")
    given = [sensors] if isinstance(sensors, str) else sensors
    sensors = option("sensors", given, sequence, "give a sensor such as 'C.angle', or a list of them", each=text)
    fps = option("fps", fps, number, "give frames per second on the screen, up to 100", above=0, most=100)
    speed = optional("speed", speed, number, "give simulated seconds per second on the screen, or None", above=0)
    places, hidden = _listed(trail), names_of("hide", hide)
    for sensor in sensors:
        numbers(result, sensor)
    for place in places:
        track(result, place)
    if not len(result.t):
        raise OptionError("animate: this result has no times; ask for some with r(times)")
    duration = float(result.t[-1] - result.t[0])
    rate = natural_speed(duration) if speed is None else speed
    gif = file is not None and file.suffix.lower() == ".gif"
    delay = max(2, round(100 / fps)) / 100 if gif else 1 / fps  # a GIF counts time in hundredths of a second
    times = frame_times(float(result.t[0]), duration, rate * delay, 2 if gif else SMOOTH)
    film = filmed(result, times, sensors, places, rate, hidden)
    if file is not None and gif:
        write_gif(film, file, max(delay, duration / rate / max(len(times) - 1, 1)))
        return Animation(film.seen.name, picture(file.read_bytes(), "gif"), file)
    if file is not None and file.suffix.lower() == ".glb":
        left = frozenset(item.k.name for item in result.prepared.model.scene.connections
                         if len(getattr(getattr(item.joint, "reduced", None), "edges", ())))
        write_file(file, glb(film, left))
        return Animation(film.seen.name, page(film), file, sorted(left))
    text_ = page(film)
    if file is not None:
        write_file(file, text_)
    return Animation(film.seen.name, text_, file)


def _listed(trail: Any) -> list[Any]:
    if trail is None:
        return []
    alone = isinstance(trail, str | Place | Body | Connection)
    return option("trail", [trail] if alone else trail, sequence, f"{PLACE}, or a list of them", each=_place)


def _place(value: Any) -> Any:
    return value if isinstance(value, Place | Body | Connection) else text(value)


# ---- GIF ---------------------------------------------------------------------------------------------------------------


def write_gif(film: Film, file: Path, delay: float) -> None:
    """Draw every frame, `delay` s apart (rounded to 0.01 s); all frames use one palette, that of five of them: what is hidden in
    one is seen in another."""
    stage = _Stage(film)
    count = len(film.seen.t)
    palette = common_palette([stage.frame(i) for i in sorted({k * (count - 1) // 4 for k in range(5)})])
    frames = (stage.frame(i).quantize(palette=palette, dither=0) for i in range(count))
    shown = 10 * max(2, round(100 * delay))  # display time of a frame, ms
    with replacing(file) as part:
        next(frames).save(part, format="GIF", save_all=True, append_images=frames, duration=shown, loop=0)


def common_palette(frames: Sequence[Any], colours: int = 256) -> Any:
    """A picture of Pillow with a palette of the colours of several pictures of one size."""
    from PIL import Image

    stacked = Image.new("RGB", (frames[0].width, frames[0].height * len(frames)))
    for i, frame in enumerate(frames):
        stacked.paste(frame, (0, i * frame.height))
    made = stacked.quantize(colours)
    values = np.array(made.getpalette() or [], dtype=int).reshape(-1, 3)
    values[np.min(values, axis=1) > NEARLY] = 255  # the ground stays white where it is averaged with edges of lines
    made.putpalette(values.ravel().tolist())
    return made


class _Stage:
    """A figure of the mechanism with charts of sensors over time below it; what does not move is drawn once."""

    def __init__(self, film: Film) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.film, self.t = film, film.seen.t
        n = len(film.curves)
        width, height = figure_size(film.seen)
        figure = Figure(figsize=(width, height + 1.3 * n), dpi=DPI, layout="constrained" if film.seen.planar else None)
        self.canvas = FigureCanvasAgg(figure)
        sides = {"left": 0.09, "right": 0.97, "top": 0.94, "bottom": 0.1 / (1 + 0.3 * n), "hspace": 0.4}
        margins = {} if film.seen.planar else sides
        grid = figure.add_gridspec(1 + n, 1, height_ratios=[height, *[0.9] * n], **margins)
        self.figure, self.axes = figure, axes_for(figure, film.seen, grid[0])
        self.title = entitled(self.axes, film.seen, self._told(-1), family="monospace")
        self.picture = Picture(self.axes, film.seen)
        show_gravity(self.axes, film.seen)
        self.trails = [self.picture.trail(trail.points, trail.colour) for trail in film.trails]
        self.markers = [self._strip(figure.add_subplot(grid[1 + k]), curve, k == n - 1) for k, curve in enumerate(film.curves)]
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        self.moving = sorted([self.title, *self.picture.artists, *self.markers], key=lambda artist: artist.get_zorder())
        for artist in self.moving:
            artist.set_animated(True)
        self.canvas.draw()
        self.still = self.canvas.copy_from_bbox(figure.bbox)

    def frame(self, i: int) -> Any:
        """The i-th frame as a picture of Pillow."""
        from PIL import Image

        self.show(i)
        self.canvas.restore_region(self.still)
        for artist in self.moving:
            if hasattr(artist, "do_3d_projection"):
                artist.do_3d_projection()
            artist.draw(self.canvas.get_renderer())
        return Image.fromarray(np.array(self.canvas.buffer_rgba())[:, :, :3])

    def _strip(self, axis: Any, curve: Curve, last: bool) -> Any:
        dress(axis)
        for j, name in enumerate(curve.components):
            axis.plot(self.film.times, curve.values[:, j], label=name, **style(j))
        if len(curve.components) > 1:
            axis.legend(frameon=False, fontsize="x-small", ncols=3, loc="lower right", bbox_to_anchor=(1, 0.95))
        axis.set_title(curve.label, fontsize="small", loc="left")
        axis.margins(x=0.01)
        steady(axis)
        axis.tick_params(labelbottom=last)
        if last:
            axis.set_xlabel("time [s]")
        return axis.axvline(self.t[0], color="0.2", linewidth=1.2)

    def show(self, i: int) -> None:
        """Move everything that moves to its place in the i-th frame."""
        self.picture.show(i)
        for lengthen in self.trails:
            lengthen(i * self.film.fine)
        for marker in self.markers:
            marker.set_xdata([self.t[i]] * 2)
        self.title.set_text(fitting(self._told(i), LETTERS))

    def _told(self, i: int) -> str:
        """The title of the i-th frame."""
        pace = "" if self.film.speed == 1 else f"   (speed x {self.film.speed:g})"
        return f"{self.film.seen.name}   t = {self.t[i]:.{digits(self.t)}f} s{pace}"
