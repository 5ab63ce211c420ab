"""Numbers of many scenes: each derivative is right, refused by name, or 0 where nothing of the motion changes with the number."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from random_scenes import random_scene
from runner import Found

import mbdae as mb
from mbdae.derivatives import Refined
from mbdae.scene.record import item_name
from mbdae.study.statements import call_of, changed

ACCURACY, END = 1e-6, 0.2
DRAWN = 12  #: numbers of a scene that are compared; all where None is given
#: differences of order 4 of runs at 1e-13, at this share of a number (of 1 where it is 0), on one side where there is no other
DISTANCE = 4e-3
BOTH = {1: 2 / 3, -1: -2 / 3, 2: -1 / 12, -2: 1 / 12}
ABOVE = {0: -25 / 12, 1: 4.0, 2: -3.0, 3: 4 / 3, 4: -1 / 4}
NOTHING = 1e-10  #: a derivative below this share of the motion over the number counts as 0


def numbers(scene: Any) -> list[str]:
    """Names of all numbers in the statements of a scene, and its named numbers."""
    found = list(scene.numbers)
    for statement in scene.statements:
        item = item_name(statement)
        if isinstance(item, str):
            found += [f"{item}.{name}" for name in _inside(call_of(scene, scene.statements, item)[1])]
    return found


def _inside(data: Any) -> Iterator[str]:
    entries = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in entries:
        fields = value.get("fields", value.get("by", value)) if isinstance(value, dict) else value
        if isinstance(value, float | int) and not isinstance(value, bool):
            yield str(key)
        elif isinstance(fields, dict | list) and "expression" not in fields:
            yield from (f"{key}.{name}" for name in _inside(fields))


def drawn(seed: int) -> mb.Scene:
    """A random scene with masses of 1, -1 or 0 in some, a free body in some, and a number that two laws share in some."""
    rng, s = np.random.default_rng([seed, 43]), random_scene(seed)
    bodies = [name for name in (body.name for body in s.bodies) if f"{name}.mass" in numbers(s)]
    kind = seed % 5
    if kind < 3 and bodies:
        body = str(rng.choice(bodies))
        value = (1.0, -1.0, 0.0)[kind]
        try:
            s = changed(s, f"{body}.mass", value)[0]  # type: ignore[assignment]
            s.simulate(0.01)
        except mb.MbdaeError:  # no motion with this mass there
            s = changed(random_scene(seed), f"{body}.mass", 1.0)[0]  # type: ignore[assignment]
    elif kind == 3:
        free = s.rigid_body("free", 1.0, (0.1, 0.2, 0.15), at=(3, 1, 0), velocity=(0.3, 0.2, 0))
        s.spring("to free", s.ground, free, (3, 2, 0), (3.1, 1.2, 0), stiffness=mb.number("shared", 7.0),
                 damping=mb.number("shared", 7.0) / 20)
    else:
        one = s.rigid_body("one", 1.0, (0.1, 0.2, 0.15), at=(3.2, 1, 0))
        s.revolute("turns", s.ground, one, at=(3, 1, 0), axis=(0, 0, 1), spring=mb.number("shared", 2.0),
                   torque=mb.number("shared", 2.0) * mb.t - mb.number("drag", 0.1) * s.sensor("turns.rate"))
    return s


def motion(result: Any) -> Any:
    """(times, 6 x bodies) positions and velocities of all bodies of a result."""
    names = [b.name for b in result.prepared.model.scene.bodies]
    return np.hstack([np.asarray(result.value(f"{name}.{what}")) for name in names for what in ("position", "velocity")])


def at_end(result: Any) -> Any:
    """(6 x bodies,) the motion at the end."""
    return motion(result)[-1]


def difference(base: Any, name: str, end: float, solver: Any) -> tuple[Any, float, float]:
    """The derivative of the motion at the end by a number, how far it is from the one at twice the distance, and the size of the
    motion over the number."""
    stated: list[float] = []
    changed(base, name, lambda x: stated.append(x) or x, end)  # type: ignore[func-returns-value]
    runs: dict[float, Any] = {}

    def run(by: float) -> Any:
        if by not in runs:
            runs[by] = at_end(changed(base, name, lambda x: x + by, end)[0].simulate(end, solver=solver, outputs=2))
        return runs[by]

    by = DISTANCE * (abs(stated[0]) or 1.0)
    for weights in (BOTH, {-k: -w for k, w in ABOVE.items()}, ABOVE):
        try:
            near, far = (sum(w * run(k * d) for k, w in weights.items()) / d for d in (by, 2 * by))
        except mb.MbdaeError:
            if weights is ABOVE:
                raise
            continue
        break
    size = float(np.abs(next(iter(runs.values()))).max()) / (abs(stated[0]) or 1.0)
    return near, float(np.abs(near - far).max()), size


def judge(base: Any, end: float, names: Any = None, seed: int = 0, options: Any = None) -> dict[str, list[str]]:
    """Names of numbers by verdict: right, wrong, uncovered, refused."""
    found: dict[str, list[str]] = {"right": [], "zero": [], "wrong": [], "uncovered": [], "refused": [], "no reference": []}
    known = numbers(base)
    if names is not None and len(known) > names:
        known = [str(name) for name in np.random.default_rng(seed).choice(known, names, replace=False)]
    run = base.simulate(end, accuracy=ACCURACY, outputs=2, **(options or {}))
    explicit = isinstance(run.info.solver, mb.DOP853)
    solver: Any = mb.DOP853(rtol=1e-13) if explicit else mb.RadauIIA(5, rtol=1e-12)
    left = []
    for name in known:
        try:
            Refined(run, [name])
            left.append(name)
        except mb.DerivativeError as error:
            found["refused"].append(f"{name}: {error}")
    derivatives = run.sensitivity(motion, to=left) if left else {}
    for name in left:
        one = derivatives[motion, name]
        try:
            true, noise, size = difference(base, name, end, solver)
        except mb.MbdaeError as error:
            found["no reference"].append(f"{name}: {error}")
            continue
        off = max(float(np.abs(one.value[-1] - true).max()) - 3 * noise, 0.0)
        largest, nothing = float(np.abs(true).max()), NOTHING * size
        said = f"{name} ({np.abs(one.value[-1]).max():.9g} for {np.abs(true).max():.9g}, off {off:.1e}, error {one.error:.1e})"
        # beyond ten times the accuracy an error that covers is told by an AccuracyWarning
        allowed = max(10 * ACCURACY * largest, one.error) + nothing
        found["wrong" if off > allowed else "zero" if largest <= nothing else "right"].append(said)
        if off > one.error + nothing:
            found["uncovered"].append(said)
    return found


def counted(parts: list[dict[str, list[str]]]) -> list[Found]:
    """What the claim states of many scenes."""
    both = {kind: [one for part in parts for one in part[kind]] for kind in parts[0]}
    right = len(both["right"]) + len(both["zero"])
    said = f"{right} derivatives ({len(both['zero'])} of them 0), {len(both['refused'])} refused"
    return [Found(len(both["wrong"]), 0, "derivatives", "wrong", note=f"{said}; wrong: {', '.join(both['wrong']) or 'none'}"),
            Found(len(both["uncovered"]), max(0.01 * right, 1), "derivatives", "errors that do not cover",
                  note=", ".join(both["uncovered"]))]
