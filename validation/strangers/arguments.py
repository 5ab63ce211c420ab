"""What every argument of a drawn statement is: its unit as powers of mass, length and time, and how it turns with the whole."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from strangers.bodies import Array, three
from strangers.story import Along, Feed, Input, Made, Said, Story

Unit = tuple[float, float, float]
NONE, LENGTH, FORCE, MOMENT, RATE = (0, 0, 0), (0, 1, 0), (1, 1, -2), (1, 2, -2), (0, 0, -1)
LINE = {"value": LENGTH, "load": FORCE, "stiffness": (1, 0, -2), "damping": (1, 0, -1), "rate": (0, 1, -1)}
TURN = {"value": NONE, "load": MOMENT, "stiffness": MOMENT, "damping": (1, 2, -1), "rate": RATE}
POINTS = ("at", "at_k", "at_l")
SPOKEN = {"spring": "stiffness", "damper": "damping", "load": "load", "torque": "load", "force": "load", "angle": "value",
          "position": "value", "angle0": "value", "position0": "value", "rate0": "rate", "limits": "value"}
SLIDES = ("prismatic", "point_on_line")  #: joints whose axis is a direction of travel; that of others is one of turning
PLAIN: dict[str, Unit] = {
    "mass": (1, 0, 0), "inertia": (1, 2, 0), "velocity": (0, 1, -1), "angular_velocity": RATE, "radius": LENGTH, "lead": LENGTH,
    "normal_force": FORCE, "length": LENGTH, "every": (0, 0, 1), "v_c": (0, 1, -1), "EA": FORCE, "GA2": FORCE, "GA3": FORCE,
    "GJ": (1, 3, -2), "EI2": (1, 3, -2), "EI3": (1, 3, -2), "mass_per_length": (1, -1, 0), "rotary_inertia": (1, 1, 0),
    "outer": LENGTH, "inner": LENGTH}
LAWS: dict[str, dict[str, Unit]] = {"Hertz": {"stiffness": (1, -0.5, -2), "damping": (0, -1, 1)},
                                    "Section": {"damping": (0, 0, 1)}}


@dataclass(frozen=True)
class Change:
    """Another frame and other units: Q (3, 3) turns or mirrors, then all moves by `by` (m); new units of mass, length, time."""

    Q: Array = field(default_factory=lambda: np.eye(3))
    by: Array = field(default_factory=lambda: np.zeros(3))
    mass: float = 1.0
    length: float = 1.0
    time: float = 1.0

    def scale(self, unit: Unit) -> float:
        """Of numbers with a unit."""
        return float(self.mass ** unit[0] * self.length ** unit[1] * self.time ** unit[2])

    @property
    def sense(self) -> float:
        """-1 where it mirrors."""
        return float(np.sign(np.linalg.det(self.Q)))

    def point(self, p: Any) -> tuple[float, ...]:
        """A point, with as many coordinates."""
        return plain((self.Q @ three(p) + self.by) * self.length, len(p))

    def vector(self, v: Any, unit: Unit = NONE, axial: bool = False) -> tuple[float, ...]:
        """A direction or a vector quantity."""
        return plain((self.sense if axial else 1.0) * self.scale(unit) * (self.Q @ three(v)), len(v))


def plain(a: Array, n: int = 3) -> tuple[float, ...]:
    """Numbers without noise around 0."""
    return tuple(float(x) if abs(x) > 1e-15 else 0.0 for x in np.ravel(a)[:n])


def changed(story: Story, c: Change) -> Story:
    """The same story as seen in another frame and in other units."""
    kinds = {a.name: a.verb for a in story.statements}
    return story.but(gravity=c.vector(story.gravity, (0, 1, -2)), t_end=story.t_end * c.time,
                     statements=tuple(_said(a, c, kinds) for a in story.statements))


def _said(a: Said, c: Change, kinds: dict[str, str]) -> Said:
    a = Said(a.verb, {"axis": (0, 0, 1), **a.args}) if a.verb == "revolute" else a  # the axis where none is said
    return Said(a.verb, {key: _argument(a, key, value, c, kinds) for key, value in a.args.items()})


def _argument(a: Said, key: str, value: Any, c: Change, kinds: dict[str, str]) -> Any:
    if value is None or isinstance(value, str) or key in ("name", "elements", "order", "ratio", "reads", "sets", "of"):
        return value
    if key in POINTS:
        return c.point(value)
    if key == "points":
        return tuple(c.point(p) for p in value)
    if key == "axis2":
        return c.vector(value)
    if key in ("axis", "pin"):
        return c.vector(value, axial=a.verb not in SLIDES)
    if key == "rotation":
        return tuple(map(plain, c.Q @ np.array(value) @ c.Q.T))
    if key == "inertia" and np.ndim(value):
        J = np.diag(value) if np.ndim(value) == 1 else np.array(value)
        return tuple(map(plain, c.scale(PLAIN[key]) * (c.Q @ J @ c.Q.T)))
    if key in ("velocity", "angular_velocity"):
        return c.vector(value, PLAIN[key], axial=key == "angular_velocity")
    if isinstance(value, Along):
        axial, unit = a.verb == "torque", MOMENT if a.verb == "torque" else (1, 0, -2) if a.verb == "line_load" else FORCE
        return Along(_number(value.value, unit, c), plain((c.sense if axial else 1.0) * (c.Q @ np.array(value.direction))))
    if isinstance(value, Made) and key == "stop":
        words = _words(a.verb)
        return Made("Stop", {k: v * c.scale(words[k]) for k, v in value.args.items()})
    if isinstance(value, Made) and value.word == "Holding":
        return _held(value, c, kinds[a.args["reads"][0].split(".")[0]])
    if isinstance(value, Made):
        return _made(value, c)
    if isinstance(value, Feed):
        return _fed(value, c, _words(a.verb))
    return _plain(a, key, value, c)


def _plain(a: Said, key: str, value: Any, c: Change) -> Any:
    if isinstance(value, dict):
        return {name: _number(v, (TURN if name.startswith("angle") else LINE)[SPOKEN[key]], c) for name, v in value.items()}
    if a.verb == "own" and key == "stiffness":
        unit: Unit = (1, -2, -2)
    elif a.verb in ("spring", "bushing") and key in ("stiffness", "damping"):
        unit = LINE[key]
    elif key in SPOKEN:
        unit = _words(a.verb)[SPOKEN[key]]
    else:
        unit = PLAIN[key]
    factor = c.sense if key == "lead" else 1.0
    if isinstance(value, tuple):
        return tuple(factor * v * c.scale(unit) for v in value)
    return _number(value, unit, c) if factor == 1 else factor * value * c.scale(unit)


def _words(verb: str) -> dict[str, Unit]:
    return LINE if verb == "prismatic" else TURN


def _number(value: Any, unit: Unit, c: Change) -> Any:
    if isinstance(value, Input):
        return replace(value, scale=value.scale * c.scale(unit), pace=value.pace / c.time)
    return value * c.scale(unit) if isinstance(value, int | float) else value


def _made(value: Made, c: Change) -> Made:
    own = LAWS.get(value.word, {})
    found: dict[str, Any] = {}
    for key, v in value.args.items():
        if isinstance(v, Made):
            found[key] = _made(v, c)
        elif key == "at":
            found[key] = c.point(v)
        elif key == "normal" and isinstance(v, tuple):
            found[key] = c.vector(v)
        else:
            found[key] = v if v is None else v * c.scale(own.get(key, PLAIN.get(key, NONE)))
    return Made(value.word, found)


def _gains(words: dict[str, Unit]) -> tuple[Unit, Unit]:
    return words["stiffness"], words["damping"]


def _held(value: Made, c: Change, verb: str) -> Made:
    words = _words(verb)
    gain, rate_gain = _gains(words)
    a = value.args
    return Made(value.word, {"gain": a["gain"] * c.scale(gain), "rate_gain": a["rate_gain"] * c.scale(rate_gain),
                             "target": a["target"] * c.scale(words["value"])})


def _fed(value: Feed, c: Change, words: dict[str, Unit]) -> Feed:
    gain, rate_gain = _gains(words)
    limit = None if value.limit is None else value.limit * c.scale(words["load"])
    return replace(value, gain=value.gain * c.scale(gain), rate_gain=value.rate_gain * c.scale(rate_gain),
                   target=value.target * c.scale(words["value"]), limit=limit)


