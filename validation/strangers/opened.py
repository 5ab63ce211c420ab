"""Rigid loops drawn open: joints start elsewhere than drawn, and the start is compared in other statements of the same loop."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import suppress
from math import inf
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, find, settings
from hypothesis.errors import NoSuchExample
from strangers.changes import BODIES, backwards
from strangers.draw import FAMILIES
from strangers.story import Said, Story, build

from mbdae.errors import MbdaeError
from mbdae.results.stored_parts import started
from mbdae.system.base import Array
from mbdae.system.prepare import prepare

QUIET = settings(deadline=None, database=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck), max_examples=8)
HELD = {"revolute": ("angle0", 1.2, 4.0), "prismatic": ("position0", 0.3, 1.0)}  #: start, largest value (rad, m) and rate
PLAIN = ("name", "k", "l", "at", "axis", "pin", "at_k", "at_l")  #: arguments of joints that are kept
WAYS = ("kinematic", "classical", "recursive", "reversed")


def opened(seed: int) -> Iterator[Story]:
    """Loops of strangers' draws from a seed, each with one or two held starts that its drawing does not have, and rates."""
    rng, seen = random.Random(f"opened {seed}"), []

    def keep(story: Story) -> bool:
        seen.append(story)
        return False

    with suppress(NoSuchExample):
        find(FAMILIES["loop"], keep, settings=QUIET, random=rng)
    for story in seen:
        joints = [a for a in story.statements if a.verb not in (*BODIES, "force", "torque", "spring", "own")]
        can = [a.name for a in joints if a.verb in HELD]
        held = {name: rng.uniform(-1, 1) for name in rng.sample(can, min(len(can), rng.choice([1, 1, 1, 2])))}
        moves = rng.random() < 0.6
        said = [_held(a, held.get(a.name), moves) if a in joints else a for a in story.statements
                if a in joints or a.verb in BODIES]
        if held:
            yield story.but(statements=tuple(said), model="", options={})


def _held(a: Said, share: float | None, moves: bool) -> Said:
    plain = {key: v for key, v in a.args.items() if key in PLAIN}
    if share is None:
        return Said(a.verb, plain)
    word, most, rate = HELD[a.verb]
    return Said(a.verb, plain | {word: round(share * most, 3)} | ({"rate0": round(rate * share, 3)} if moves else {}))


def start_of(story: Story) -> dict[str, Array] | None:
    """Position, rotation matrix, velocity and angular velocity (m, s) of every body at the start; None where it is
    refused."""
    try:
        here = started(prepare(build(story)))
    except MbdaeError:
        return None
    found: dict[str, Array] = {}
    for a in story.of(*BODIES):
        body: Any = here[a.name]
        turning = () if a.verb == "point_mass" else (body.rotation, body.angular_velocity)
        found[a.name] = np.concatenate([np.ravel(part) for part in (body.position, body.velocity, *turning)])
    return found


def stated(story: Story, way: str) -> Story:
    """The same loop with all joints in one model, or with its statements in the opposite order."""
    return story.but(statements=backwards(story)) if way == "reversed" else story.but(model=way)


def differences(story: Story) -> dict[str, float]:
    """By way the largest difference of the start (m, rad, s) from that of the loop as it stands; infinite where one
    is refused."""
    base, found = start_of(story), {}
    for way in WAYS:
        other = start_of(stated(story, way))
        if base is None or other is None:
            found[way] = 0.0 if base is other else inf
        else:
            found[way] = max(float(np.max(np.abs(base[name] - other[name]))) for name in base)
    return found
