"""An HTML page that plays an animation in any browser; the data are JSON in the page, so that it loads nothing."""

from __future__ import annotations

import html
import json
from dataclasses import asdict
from typing import Any

import numpy as np

from mbdae.scene.components import Array
from mbdae.show.drawing import LOOKS
from mbdae.show.film import Film, digits
from mbdae.show.geometry import Geometry, Shape
from mbdae.show.names import WIDE, fitting
from mbdae.show.player_controls import CONTROLS
from mbdae.show.player_page import PAGE
from mbdae.show.player_view import VIEW
from mbdae.show.plots import COLOURS

GRAIN = 1e-4  #: resolution of stored coordinates over the scene's size, and of the entries of rotation matrices
SPEEDS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)


def page(film: Film) -> str:
    """The page as HTML text."""
    data = json.dumps(film_data(film), separators=(",", ":"), ensure_ascii=True).replace("<", "\\u003c")
    name = html.escape(film.seen.name)
    options = "".join(f'<option value="{s:g}"{" selected" if s == film.speed else ""}>&times; {s:g}</option>'
                      for s in sorted({*SPEEDS, film.speed}))  # fmt: skip
    fields = {"@SCRIPT@": VIEW + CONTROLS, "@NAME@": name, "@SPEEDS@": options, "@DATA@": data}
    text = PAGE
    for field, value in fields.items():
        text = text.replace(field, value)
    return text



def film_data(film: Film) -> dict[str, Any]:
    """Data of an animation for JSON: coordinates as whole multiples of `unit` m, rotations as multiples of `GRAIN`."""
    seen = film.seen
    unit, low_high = seen.size * GRAIN, np.array(seen.bounds)
    if film.trails:
        reached = np.vstack([trail.points for trail in film.trails])
        low_high = np.array([np.minimum(low_high[0], reached.min(axis=0)), np.maximum(low_high[1], reached.max(axis=0))])
    return {
        "name": seen.name, "planar": seen.planar, "unit": unit, "grain": GRAIN, "size": seen.size, "speed": film.speed,
        "t": _short(seen.t), "times": _short(film.times), "fine": film.fine, "digits": digits(seen.t),
        "gravity": seen.gravity.tolist(),
        "low": _short(low_high[0]), "high": _short(low_high[1]), "looks": {k: asdict(v) for k, v in LOOKS.items()},
        "colours": COLOURS, "bodies": {name: _pose(seen, name, unit) for name in seen.poses},
        "shapes": [_shape(shape, unit) for shape in seen.shapes],
        "labels": [{"lines": fitting(x.text, WIDE).split("\n"), "body": x.body, "at": _whole(x.points, unit), "strong": x.of_body}
                   for x in seen.labels],
        "trails": [{"name": x.name, "colour": x.colour, "points": _whole(x.points, unit)} for x in film.trails],
        "curves": [{"label": x.label, "parts": x.components, "values": _short(x.values.T)} for x in film.curves],
    }  # fmt: skip


def _whole(points: Array, unit: float) -> Any:
    return np.round(points / unit).astype(int).tolist()


def _short(values: Array) -> Any:
    """Values rounded to seven significant digits, as lists."""
    rounded = [float(f"{v:.7g}") for v in np.asarray(values).ravel()]
    return np.reshape(rounded, np.shape(values)).tolist()


def _pose(seen: Geometry, name: str, unit: float) -> dict[str, Any]:
    """Position (nt, 3) and entries of the rotation matrix (nt, 9), or (1, 9) where it never changes."""
    pose = seen.poses[name]
    turn = pose.rotation.reshape(-1, 9)
    still = bool(np.all(np.abs(turn - turn[0]) < GRAIN / 2))
    return {"r": _whole(pose.position, unit), "R": _whole(turn[:1] if still else turn, GRAIN)}


def _shape(shape: Shape, unit: float) -> dict[str, Any]:
    solid = {"faces": shape.faces, "shades": shape.shades} if shape.faces else {}
    return {"kind": shape.kind, "colour": shape.colour, "body": shape.body, "points": _whole(shape.points, unit), **solid}
