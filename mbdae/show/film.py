"""Data of an animation: times of the frames, geometry at these times, paths of places, curves of sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.scene.components import Array
from mbdae.show.geometry import Geometry
from mbdae.show.plots import COLOURS, strips, track
from mbdae.show.shapes import geometry

LARGEST = 600  #: largest number of frames
SMOOTH = 240  #: smallest number of frames of a player, which may run slowly, and of points of a line over time
#: s on the screen: shortest and longest duration shown in real time, and the duration aimed at otherwise
COMFORTABLE = (1.0, 60.0, 8.0)


@dataclass(frozen=True)
class Curve:
    """One panel of the strip chart: a sensor's name with its unit, its component names and values (nt, n)."""

    label: str
    components: tuple[str, ...]
    values: Array


@dataclass(frozen=True)
class Trail:
    """The path (nt, 3), m, of a place."""

    name: str
    colour: str
    points: Array


@dataclass(frozen=True)
class Film:
    """Data of an animation: geometry at the times of the frames; trails and curves with `fine` points per frame, at times (n,),
    s."""

    seen: Geometry
    fine: int
    times: Array
    trails: tuple[Trail, ...]
    curves: tuple[Curve, ...]
    speed: float  #: simulated s per s on the screen


def natural_speed(duration: float) -> float:
    """Simulated s per s on the screen: 1 where that gives a suitable duration, else 1, 2 or 5 times a power of ten."""
    least, most, aim = COMFORTABLE
    if duration <= 0 or least <= duration <= most:
        return 1.0
    wanted = duration / aim
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(f"{power * max(n for n in (1, 2, 5) if n <= wanted / power * (1 + 1e-9)):.3g}")


def frame_times(start: float, duration: float, step: float, least: int = 2) -> Array:
    """Times (nt,) of the frames, s, at most `LARGEST` and at least `least` of them."""
    n = int(np.clip(np.ceil(duration / step - 1e-9) + 1, least if duration > 0 else 1, LARGEST))
    return np.asarray(start + np.linspace(0.0, duration, n))


def filmed(result: Any, t: Array, sensors: Sequence[str], places: Sequence[Any], speed: float,
           hide: Sequence[str] = ()) -> Film:  # fmt: skip
    """The data of an animation with frames at times t (nt,), s."""
    fine = max(1, -(-SMOOTH // len(t))) if len(t) > 1 else 1
    times = np.interp(np.arange((len(t) - 1) * fine + 1) / fine, np.arange(len(t)), t)
    dense = result(times)
    tracks = [track(dense, place) for place in places]
    trails = tuple(Trail(name, COLOURS[(i + 1) % len(COLOURS)], points) for i, (name, points) in enumerate(tracks))
    curves = [Curve(label, tuple(c for c, _ in parts), np.stack([v for _, v in parts], axis=1))
              for sensor in sensors for label, parts in strips(dense, sensor)]  # fmt: skip
    return Film(geometry(result(t), hide), fine, times, trails, tuple(curves), speed)


def digits(t: Array) -> int:
    """Number of decimals that distinguishes the times of any two frames."""
    step = float(t[-1] - t[0]) / 200
    return int(np.clip(np.ceil(-np.log10(step)), 0, 9)) if step > 0 else 2
