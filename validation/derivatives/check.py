"""Derivatives of runs by every number of their scenes, against differences of exact runs: right, or refused."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from derivatives.drawn import DRAWN, END, counted, drawn, numbers
from derivatives.drawn import judge as judged
from derivatives.scenes import EXAMPLES, SCENES, Scene, example
from runner import Case, Claim, Found

import mbdae as mb
from mbdae.study.statements import changed

claim = Claim("derivatives", "the derivative of what is read at the end of a run, by every number of its scene, is right within "
              "ten times the accuracy, or refused by name; `.error` covers it, at the median at most 50 times", 0.0, "scenes",
              "differences of order 8 of runs by DOP853 at 1e-13 or Radau IIA(5) at 1e-12")
ACCURACY, DISTANCE = 1e-6, 2e-2
WEIGHTS = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
QUICK, FEW, WHOLE = ["pendulum"], (9, 53), range(100)


def difference(scene: Scene, base: Any, name: str, solver: Any) -> tuple[float, float]:
    """The derivative of the first quantity by a number, and how far it is from the one with half the distance."""
    stated: list[float] = []
    changed(base, name, lambda x: stated.append(x) or x, scene.end)  # type: ignore[func-returns-value]
    found = []
    for distance in (DISTANCE, DISTANCE / 2):
        by = distance * (abs(stated[0]) or 1.0)
        scenes = {k: changed(base, name, lambda x, k=k, by=by: x + k * by, scene.end)[0] for i in WEIGHTS for k in (i, -i)}
        runs = {k: one.simulate(scene.end, solver=solver, outputs=2) for k, one in scenes.items()}
        ends = {k: float(np.asarray(run.read(scene.read[0]))[-1]) for k, run in runs.items()}
        found.append(sum(w * (ends[i] - ends[-i]) for i, w in WEIGHTS.items()) / by)
    return found[1], abs(found[1] - found[0])


def judge(name: str, names: Sequence[str] = ()) -> list[Found]:
    """Counts of derivatives that are wrong, and of errors that do not cover."""
    scene, base = SCENES[name], SCENES[name].build()
    run = base.simulate(scene.end, accuracy=ACCURACY, **scene.options)
    explicit = isinstance(run.info.solver, mb.DOP853)
    solver: Any = mb.DOP853(rtol=1e-13) if explicit else mb.RadauIIA(5, rtol=1e-12)
    wrong, uncovered, refused, wide, right = [], [], [], [], 0
    for number in names or numbers(base):
        try:
            found = run.gradient(mb.at_end(scene.read[0]), to=number)[number]
        except mb.DerivativeError:
            refused.append(number)
            continue
        try:
            true, noise = difference(scene, base, number, solver)
        except mb.MbdaeError:  # a scene that cannot be made or run with another number there has no reference
            refused.append(number)
            continue
        off = max(abs(found.value - true) - 3 * noise, 0.0)
        right += 1
        if off > 10 * ACCURACY * max(abs(true), noise):
            wrong.append(f"{number} ({found.value:.9g} for {true:.9g})")
        if off > found.error:
            uncovered.append(number)
        if off > 0:
            wide.append(found.error / off)
    said = f"{right} derivatives, {len(refused)} refused ({', '.join(refused) or 'none'})"
    return [Found(len(wrong), 0, "derivatives", "wrong", note=f"{said}; wrong: {', '.join(wrong) or 'none'}"),
            Found(len(uncovered), max(0.01 * right, 1), "derivatives", "errors that do not cover", note=", ".join(uncovered)),
            Found(float(np.median(wide)) if wide else 0.0, 50, "errors", "median of errors over what is off")]


def no_silent_zero(seeds: Sequence[int]) -> list[Found]:
    """Numbers of drawn scenes."""
    return counted([judged(drawn(seed), END, DRAWN, seed) for seed in seeds])


def of_example(name: str) -> list[Found]:
    """All numbers of an example."""
    return counted([judged(example(name), END / 4)])


def cases() -> list[Case]:
    return [*(Case(name, "chosen", lambda name=name: judge(name, SCENES[name].to)) for name in QUICK),
            Case("every number", "chosen", judge, slow=True, parts=list(SCENES), each=True),
            Case("drawn scenes", "chosen", lambda: no_silent_zero(FEW)),
            Case("all drawn scenes", "chosen", no_silent_zero, slow=True, parts=list(WHOLE)),
            Case("examples", "chosen", of_example, slow=True, parts=sorted(p.stem for p in EXAMPLES.glob("*.py")), each=True)]
