"""Over-constrained mechanisms move as they do in the workshop: freedoms, redundant rows, full turns."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import replace
from functools import partial

import numpy as np
from overconstrained_scenes import MECHANISMS, SPEED
from runner import Case, Claim, Found

import mbdae as mb

claim = Claim("overconstrained", "over-constrained mechanisms have the right freedoms in every pose and keep their energy", 1e-5,
              "relative", "freedoms of the textbook mechanisms; the kinetic energy they start with")
POSES, ACCURACY = 20, 1e-6


def turned(name: str, seed: int) -> list[Found]:
    """Freedoms and redundant rows that are wrong, warnings, what the energy and the rows are off over the turn."""
    mechanism = MECHANISMS[name]
    s = mechanism.scene(seed)
    found = s.check()
    wrong = abs(found.degrees_of_freedom - mechanism.freedoms) + abs(len(found.redundant) - mechanism.redundant)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        r = s.simulate(mechanism.turn / SPEED, accuracy=ACCURACY)
    e = r.energy
    return [Found(wrong, 0, "", "freedoms and redundant rows that are wrong"), Found(len(r.warnings), 0, "", "warnings"),
            Found(float(np.max(np.abs(e.balance)) / np.max(e.kinetic)), quantity="energy"),
            Found(float(np.max(r.drift.position)) / r.prepared.length, quantity="violation of all rows")]


def poses(name: str, seeds: Iterable[int]) -> list[Found]:
    """The worst of some poses, each of a seed."""
    found = [[replace(one, note=f"pose {seed}" if one.error else "") for one in turned(name, seed)] for seed in seeds]
    return [max(of_one, key=lambda one: one.error) for of_one in zip(*found, strict=True)]


def cases() -> list[Case]:
    return [Case(f"poses, {name}", "default", partial(poses, name), slow=True, parts=range(POSES)) for name in MECHANISMS]
