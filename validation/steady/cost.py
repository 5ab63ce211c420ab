"""CPU time of periodic motions by shooting beside that of runs until transients have died out, and the motions of both."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, log
from typing import Any

import numpy as np
import sympy as sp
from steady.draw import ACCURACY, slider

import mbdae as mb

MOST = 1500  #: number of periods after which a run until transients have died out is continued in proportion
TIMES = 101  #: of a period at which the motions are compared


def duffing(damping: float) -> tuple[mb.Scene, float]:
    """A mass on a stiffening spring under a harmonic force; damping over the critical one."""
    return slider(0.0, lambda x, v: -x - 0.2 * x**3 - 2 * damping * v + 0.3 * sp.cos(1.3 * mb.t)), 2 * np.pi / 1.3


def linear(damping: float) -> tuple[mb.Scene, float]:
    """A free mass on linear springs under a harmonic force: the scene whose run costs least; damping over the critical one."""
    s = mb.Scene("linear")
    m = s.point_mass("m", 1.0, (1, 0))
    x, y, u, v = (s.sensor(f"m.{name}") for name in ("position[0]", "position[1]", "velocity[0]", "velocity[1]"))
    s.force("F", m, (0.3 * sp.cos(1.3 * mb.t) - x - 2 * damping * u, -y - 2 * damping * v))
    return s, 2 * np.pi / 1.3


def four_bar(damping: float) -> tuple[mb.Scene, float]:
    """A driven four-bar with a pendulum on a spring and a damper (N m s) at its coupler."""
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    crank, coupler = s.link("crank", (0, 0), (0.1, 0), mass=0.5), s.link("coupler", (0.1, 0), (0.4, 0.3), mass=1.0)
    rocker, bob = s.link("rocker", (0.5, 0), (0.4, 0.3), mass=1.0), s.link("bob", (0.4, 0.3), (0.4, 0.1), mass=0.1)
    s.revolute("A", s.ground, crank, at=(0, 0), angle=10 * mb.t)
    s.revolute("B", crank, coupler, at=(0.1, 0))
    s.revolute("C", coupler, rocker, at=(0.4, 0.3))
    s.revolute("D", s.ground, rocker, at=(0.5, 0))
    s.revolute("E", rocker, bob, at=(0.4, 0.3), damper=damping, spring=0.5)
    return s, 2 * np.pi / 10


def rotor(damping: float) -> tuple[mb.Scene, float]:
    """A driven disc out of balance on a carrier in springs; damping over the critical one."""
    s, w = mb.Scene("rotor"), 100.0
    carrier, disc = s.rigid_body("carrier", 0.1, 1e-4, at=(0, 0)), s.rigid_body("disc", 1.0, 1e-3, at=(1e-3, 0))
    for name, at, k in (("x", (-1, 0), 1.1 * w**2), ("y", (0, -1), 1.21 * w**2)):
        s.spring(name, s.ground, carrier, at_k=at, at_l=(0, 0), stiffness=k, length=1.0, damping=2.2 * damping * w)
    s.fixed_orientation("O", s.ground, carrier)
    s.revolute("J", carrier, disc, at=(0, 0), angle=80 * mb.t)
    return s, 2 * np.pi / 80


@dataclass(frozen=True)
class Cost:
    """periods: number of them until a departure has fallen to the accuracy; ratio: CPU time of shooting over that of a run so
    long; off: difference of both motions over the last period, over the accuracy; None where the run was shorter."""

    periods: int
    ratio: float
    off: float | None


def cost(made: tuple[mb.Scene, float], sensor: str) -> Cost:
    """The cost of the periodic motion of a scene of a given period, and what a sensor shows of it and of a long run."""
    s, period = made
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        shooting, found = _timed(lambda: s.periodic(period, ACCURACY))
        periods = ceil(log(ACCURACY) / log(float(np.abs(found.multipliers).max())))
        end = min(periods, MOST) * period
        settling, run = _timed(lambda: s.simulate(end, ACCURACY))
        times = np.linspace(0, period, TIMES)
        both = found(times).value(sensor), run(np.minimum(times + end - period, end)).value(sensor)
    off = float(np.abs(both[0] - both[1]).max()) / ACCURACY
    return Cost(periods, shooting / (settling * periods / min(periods, MOST)), off if periods <= MOST else None)


def _timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """The least CPU time of three calls (s), and what the last one returned."""
    spent = list[float]()
    for _ in range(3):
        begin = time.process_time()
        found = call()
        spent.append(time.process_time() - begin)
    return min(spent), found


SCENES = {"Duffing, damping 0.1 %": (lambda: duffing(1e-3), "J.displacement"),
          "Duffing, damping 1 %": (lambda: duffing(1e-2), "J.displacement"),
          "linear, damping 0.1 %": (lambda: linear(1e-3), "m.position"),
          "linear, damping 1 %": (lambda: linear(1e-2), "m.position"),
          "four-bar, damper 1e-4": (lambda: four_bar(1e-4), "E.angle"),
          "four-bar, damper 1e-5": (lambda: four_bar(1e-5), "E.angle"),
          "rotor, damping 0.05 %": (lambda: rotor(5e-4), "carrier.position"),
          "rotor, damping 0.5 %": (lambda: rotor(5e-3), "carrier.position")}
