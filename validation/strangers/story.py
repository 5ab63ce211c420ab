"""A drawn scene as plain data: a list of statements, from which the scene is built, the script printed, the reference made."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import inf
from typing import Any

import numpy as np
import sympy as sp

import mbdae as mb

Pieces = tuple[tuple[float, str], ...]  #: from when on (s), an expression of t
WORDS = {name: getattr(sp, name) for name in ("sin", "cos", "exp", "tanh", "pi", "sqrt")}


@dataclass(frozen=True)
class Input:
    """A function of time. said: how the script states it, with {t}; pieces: the same, smooth between instants; fine: (from, to,
    largest step of the reference) of narrow features, s; scale multiplies it, the time is delay + pace t (s)."""

    kind: str
    said: str
    pieces: Pieces
    fine: tuple[tuple[float, float, float], ...] = ()
    scale: float = 1.0
    pace: float = 1.0
    delay: float = 0.0

    def __str__(self) -> str:
        plain = self.pace == 1 and self.delay == 0
        when = "mb.t" if plain else f"(({number(self.pace)}) * mb.t + ({number(self.delay)}))"
        if self.kind.startswith("table"):
            text = self.said if plain else f"{self.said}.subs(mb.t, {when})"
        else:
            text = self.said.replace("{t}", when)
        return text if self.scale == 1 else f"{number(self.scale)} * ({text})"

    def at(self, when: float) -> float:
        """The time (s) at which it reaches one of its own instants."""
        return (when - self.delay) / self.pace

    @property
    def breaks(self) -> list[float]:
        """Instants (s) at which it or a derivative jumps."""
        return [self.at(start) for start, _ in self.pieces if start > -inf]

    @property
    def narrow(self) -> list[tuple[float, float, float]]:
        """From, to and largest step (s) near narrow features."""
        return [(self.at(a), self.at(b), step / self.pace) for a, b, step in self.fine]

    def derivative(self, inside: float, order: int = 0) -> Any:
        """The function of t (s), or its derivative, on the piece that an instant lies inside of."""
        own = self.delay + self.pace * inside
        text = [e for start, e in self.pieces if start <= own][-1]
        f, factor = _numeric(text, order), self.scale * self.pace**order
        return lambda t: factor * f(self.delay + self.pace * t)


@lru_cache(maxsize=4096)
def _numeric(text: str, order: int) -> Any:
    t = sp.Symbol("t")
    e = sp.sympify(text, locals={**WORDS, "t": t})
    return sp.lambdify(t, sp.diff(e, t, order) if order else e, "math")


@dataclass(frozen=True)
class Along:
    """A vector load: an input (or number) times a fixed direction."""

    value: Any
    direction: tuple[float, ...]

    def __str__(self) -> str:
        return "(" + ", ".join(f"{number(d)} * {said(self.value)}" if d else "0" for d in self.direction) + ")"


@dataclass(frozen=True)
class Feed:
    """Feedback of a joint's coordinate: gain (target - value) - rate_gain rate, within `limit`."""

    joint: str
    coordinate: str
    rate: str
    gain: float
    rate_gain: float
    target: float
    limit: float | None = None

    def __str__(self) -> str:
        value = (f"{number(self.gain)} * ({number(self.target)} - s.sensor('{self.joint}.{self.coordinate}')) "
                 f"- {number(self.rate_gain)} * s.sensor('{self.joint}.{self.rate}')")
        return value if self.limit is None else f"sp.Max({number(-self.limit)}, sp.Min({number(self.limit)}, {value}))"

    def of(self, value: float, rate: float) -> float:
        """The load at a value and rate of the coordinate."""
        load = self.gain * (self.target - value) - self.rate_gain * rate
        return load if self.limit is None else max(-self.limit, min(self.limit, load))


@dataclass(frozen=True)
class Sampled:
    """The output of a sampled controller of the scene, by name."""

    name: str

    def __str__(self) -> str:
        return repr(self.name)


@dataclass(frozen=True)
class Made:
    """An object of mbdae with its arguments, such as mb.Hertz(1e5, 0.2)."""

    word: str
    args: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        args = ", ".join(f"{key}={said(value)}" for key, value in self.args.items())
        return f"{'' if self.word == 'Holding' else 'mb.'}{self.word}({args})"


@dataclass(frozen=True)
class Said:
    """One statement of the scene: a method of mb.Scene and its arguments."""

    verb: str
    args: dict[str, Any]

    @property
    def name(self) -> str:
        return str(self.args["name"])

    def __str__(self) -> str:
        rest = {key: value for key, value in self.args.items() if key != "points"}
        words = [repr(rest.pop("name")), *map(said, self.args.get("points", ()))]
        if self.verb == "own":  # a law of the user's own, added as an object
            law, bodies = rest.pop("law"), [_body(rest.pop(key)) for key in "kl"]
            return f"s.add({law}({', '.join([*words, *bodies, *(f'{key}={said(value)}' for key, value in rest.items())])}))"
        return f"s.{self.verb}({', '.join([*words, *(f'{key}={said(value)}' for key, value in rest.items())])})"

    def but(self, **args: Any) -> Said:
        """With other arguments."""
        return Said(self.verb, {**self.args, **args})


@dataclass(frozen=True)
class Story:
    """A scene and how it is run; options are those of simulate as source text, model is "" or one for all joints."""

    family: str
    statements: tuple[Said, ...]
    t_end: float
    accuracy: float
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    space: str = "auto"
    model: str = ""
    options: dict[str, str] = field(default_factory=dict)

    def but(self, **fields: Any) -> Story:
        """With other fields."""
        return replace(self, **fields)

    def of(self, *verbs: str) -> list[Said]:
        """The statements with some verbs."""
        return [a for a in self.statements if a.verb in verbs]

    @property
    def inputs(self) -> list[Input]:
        """All functions of time."""
        return [i for a in self.statements for i in _inputs(a.args)]

    @property
    def planar(self) -> bool:
        """Whether bodies have but one number for their inertia, or points in the plane z = 0."""
        return all(not np.ndim(a.args["inertia"]) for a in self.of("rigid_body")) and all(
            len(p) == 2 for a in self.statements for key in ("at", "points") for p in _points(a.args.get(key)))


def _body(name: str) -> str:
    return "s.ground" if name == "ground" else f"s[{name!r}]"


def _points(value: Any) -> list[Any]:
    if value is None:
        return []
    return list(value) if value and isinstance(value[0], tuple | list) else [value]


def _inputs(value: Any) -> list[Input]:
    if isinstance(value, Input):
        return [value]
    if isinstance(value, Along):
        return _inputs(value.value)
    if isinstance(value, dict):
        return [i for part in value.values() for i in _inputs(part)]
    return [i for part in value for i in _inputs(part)] if isinstance(value, tuple | list) else []


def number(value: float) -> str:
    """As short as it is exact."""
    return repr(float(value)) if value != int(value) or abs(value) > 1e15 else repr(int(value))


def said(value: Any) -> str:
    """Any argument as the script states it."""
    if isinstance(value, bool) or value is None or isinstance(value, str):
        return repr(value)
    if isinstance(value, int | float):
        return number(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key!r}: {said(part)}" for key, part in value.items()) + "}"
    if isinstance(value, tuple | list):
        return "(" + ", ".join(map(said, value)) + ("," if len(value) == 1 else "") + ")"
    return str(value)


MODELS = {"": "", "recursive": "    s = s.recursive()\n",
          "kinematic": "    s = s.replace(model=mb.Kinematic())\n",
          "classical": "    s = s.replace(model=mb.Classical())\n"}


def scene_text(story: Story) -> str:
    """The function scene() of the script."""
    space = "" if story.space == "auto" else f", space={story.space!r}"
    lines = "".join(f"    {a}\n" for a in story.statements)
    return (f"def scene():\n    s = mb.Scene({story.family!r}, gravity={said(story.gravity)}{space})\n"
            f"{lines}{MODELS[story.model]}    return s\n")


def arguments(story: Story) -> str:
    """Of simulate."""
    options = "".join(f", {key}={text}" for key, text in story.options.items())
    return f"{number(story.t_end)}, accuracy={story.accuracy!r}{options}"


def script(story: Story, remark: str = "") -> str:
    """A script that runs by itself, from a checkout where it uses laws of strangers."""
    own = "from strangers.laws import *  # PYTHONPATH=validation\n" if story.of("own", "controller") else ""
    about = "".join(f"# {line}\n" for line in remark.splitlines())
    return (f"{about}import sympy as sp\n\nimport mbdae as mb\n{own}\n\n{scene_text(story)}\n\n"
            f"if __name__ == \"__main__\":\n    print(scene().simulate({arguments(story)}))\n")


def build(story: Story) -> mb.Scene:
    """The scene, made by the text that is printed."""
    from strangers import laws

    names = {"mb": mb, "sp": sp, **{name: getattr(laws, name) for name in laws.__all__}}
    exec(compile(scene_text(story), "<drawn>", "exec"), names)
    return names["scene"]()  # type: ignore[no-any-return]


def options(story: Story) -> dict[str, Any]:
    """Arguments of simulate beside the end and the accuracy."""
    return {key: eval(text, {"mb": mb}) for key, text in story.options.items()}


def stored(story: Story, check: str, remark: str) -> str:
    """A file for tests/strangers/found: the statements and the check that failed."""
    about = " ".join(remark.split())[:400].replace('"""', "'''").replace("\\", "/")
    said_ = ",\n    ".join(f"Said({a.verb!r}, {a.args!r})" for a in story.statements)
    rest = ", ".join(f"{key}={getattr(story, key)!r}" for key in ("t_end", "accuracy", "gravity", "space", "model", "options"))
    return (f'"""{about}"""\n# ruff: noqa: E501, F401\n\nfrom math import inf\n\n'
            f"from strangers.story import Along, Feed, Input, Made, Said, Sampled, Story\n\nCHECK = {check!r}\n"
            f"STORY = Story({story.family!r}, (\n    {said_},\n), {rest})\n")
