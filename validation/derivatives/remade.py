"""A scene in which a number is changed is made again by what the number touches: equal to the same scene made from nothing."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from derivatives.drawn import drawn, numbers
from derivatives.scenes import example
from runner import Found

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.run.choice import choose, prepared_from
from mbdae.scene.components import Beam
from mbdae.study.statements import changed
from mbdae.system.model import model
from mbdae.system.model.nodes import Shape

CHANGES: tuple[Callable[[float], float], ...] = (lambda x: 1.01 * x + 1e-3, lambda x: 0.0)  #: by which each number is replaced
SAME = 1e-11  #: difference over the largest entry: velocities of a start are projected with other round-off


def made(scene: Any, choice: Any) -> Any:
    """Unknowns, rates and scales at the start, the residual and its Jacobian there, the numbers in the tables, and unknowns,
    rates and scales where multipliers are unknowns too; or the text of what is refused."""
    try:
        prepared = prepared_from(scene, None, 1.0)
        system, full = system_for(prepared, choice.form, choice.solver.highest_index), system_for(prepared)
    except mb.MbdaeError as error:
        return str(error)
    F = np.empty(system.n)
    system.residual(system.t0, system.y0, system.yp0, F)
    parts = system.jacobian_parts(system.t0, system.y0, system.yp0)
    whole = [part.toarray() if hasattr(part, "toarray") else np.asarray(part, dtype=float) for part in parts]
    tables = [part for one in (system.assembly, full.assembly) for part in (one.numbering.workspace(), one.offset, one.weights)]
    return [system.y0, system.yp0, np.asarray(system.scale), F, *whole, *tables, full.y0, full.yp0, np.asarray(full.scale)]


def from_nothing(scene: Any, choice: Any) -> Any:
    """The same of a scene with the same statements, of which nothing is known from before."""
    known, model.shape_of = model.shape_of, lambda key: Shape()  # type: ignore[assignment]
    try:
        return made(scene._copied(), choice)
    finally:
        model.shape_of = known


def apart(a: Any, b: Any) -> float:
    """The largest difference of two scenes that were made, over the largest entry of its kind; infinite where one is refused."""
    if isinstance(a, str) or isinstance(b, str):
        return 0.0 if isinstance(a, str) and a == b else np.inf
    if [x.shape for x in a] != [x.shape for x in b]:
        return np.inf
    return max((float(np.max(np.abs(x - y), initial=0.0) / max(1.0, np.max(np.abs(y), initial=0.0)))
                for x, y in zip(a, b, strict=True) if not np.array_equal(x, y, equal_nan=True)), default=0.0)


def of(label: str, base: Any) -> tuple[int, int, list[str]]:
    """(changed scenes, those that share items with the one they come from, what differs) of all numbers of a scene."""
    count, shared, differ = 0, 0, list[str]()
    if any(isinstance(body, Beam) for body in base.bodies) or len(base.bodies) > 20:  # with beams a scene is always made whole
        return 0, 0, []
    choice = choose(prepared_from(base, None, 1.0), base, 1e-6)
    items = {id(item) for item in (*base.bodies, *base.connections)}
    for name in numbers(base):
        for change in CHANGES:
            try:
                scene = changed(base, name, change)[0]
            except mb.MbdaeError:  # a number that may not be this
                continue
            if scene.problems:
                continue
            off = apart(made(scene, choice), from_nothing(scene, choice))
            count += 1
            shared += any(id(item) in items for item in (*scene.bodies, *scene.connections))
            if not off <= SAME:
                differ.append(f"{label}: {name} = {change(1.0):g} at 1: {off:.1e}")
    return count, shared, differ


def of_scenes(names: Sequence[str | int]) -> list[Found]:
    """Examples by name and drawn scenes by number."""
    parts = []
    for name in names:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            base = drawn(name) if isinstance(name, int) else example(name)
            parts.append(of(str(name), base))
    differ = [text for part in parts for text in part[2]]
    count, shared = (sum(part[i] for part in parts) for i in (0, 1))
    said = f"{count} changed scenes, {shared} of them made by what changed; {'; '.join(differ)}"
    return [Found(len(differ), 0, "scenes", "made again, not as from nothing", note=said)]
