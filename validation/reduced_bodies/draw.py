"""Drawn bodies and loads: the error by the modes left out, as told and against a body with all of its modes."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp
from reduced_bodies.beam import beam_matrices

import mbdae as mb
from mbdae.run.verification import distance_of_meshes

END, ACCURACY = 0.05, 1e-5  #: s, and the accuracy of the runs in time
ELEMENTS = 6


@dataclass(frozen=True)
class Seen:
    """The error told and the true one, relative to the scene's length; floor: that of the runs in time."""

    seed: int
    told: float
    true: float
    floor: float

    @property
    def wrong(self) -> bool:
        """Whether they differ by more than the factor 3, beyond what the runs in time are off."""
        return not (self.told <= 3 * self.true + self.floor and self.true <= 3 * self.told + self.floor)


def scene(seed: int, modes: int | None) -> mb.Scene:
    """A drawn beam with an interface at either end, held or hinged, under a drawn force or thrown; modes: None for all."""
    rng = np.random.default_rng([seed, 51])
    M, K, nodes = beam_matrices(ELEMENTS, 2.1e11 * 10 ** rng.uniform(-2, -0.3))
    lumps = np.diag(np.repeat(rng.uniform(0, 0.3, ELEMENTS + 1), 6) * np.tile([1, 1, 1, 1e-3, 1e-3, 1e-3], ELEMENTS + 1))
    drawn = int(rng.integers(1, 5))
    body = mb.ReducedBody.craig_bampton(M + lumps, K, nodes, {"root": [0], "tip": [ELEMENTS]},
                                        6 * (ELEMENTS - 1) if modes is None else drawn, bool(rng.integers(2)))
    s = mb.Scene(f"drawn {seed}", gravity=(0, -9.81, 0))
    kind = rng.choice(["clamped", "hinged", "held at both ends", "thrown"])
    thrown = {"velocity": (0, 1, 0), "angular_velocity": rng.uniform(-3, 3, 3)} if kind == "thrown" else {}
    s.reduced_body("body", body, damping=rng.uniform(0.01, 0.05), **thrown)
    if kind == "hinged":
        s.revolute("root", s.ground, "body.root", at=(0, 0, 0), axis=(0, 0, 1))
    elif kind != "thrown":
        s.weld("root", s.ground, "body.root", at=(0, 0, 0))
    if kind == "held at both ends":
        s.weld("tip", s.ground, "body.tip", at=(1, 0, 0))
    rate, size = rng.uniform(30, 600), rng.uniform(1, 20)
    if kind != "held at both ends":
        s.force("F", "body.tip", (0, size * sp.sin(rate * mb.t), size * sp.cos(rate * mb.t)))
    else:
        s.torque("T", "body.tip", (0, 0, size))
    return s


def seen(seed: int) -> Seen:
    """The error told of a drawn body, and the true one."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        whole = scene(seed, None).simulate(END, ACCURACY)
        run = scene(seed, 0).simulate(END, ACCURACY, verify=True)
    t = np.linspace(0, END, 201)
    states: Any = [(r.prepared, r.prepared.states(t, r.solution(t))[0]) for r in (run, whole)]
    told = run.accuracy.mesh
    return Seen(seed, np.inf if told is None else told, distance_of_meshes(*states), 2 * ACCURACY)
