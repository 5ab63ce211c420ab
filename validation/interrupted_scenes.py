"""Runs that are killed and go on: one for each family of solvers and each thing that a run remembers, and how to kill them."""

from __future__ import annotations

import contextlib
import hashlib
import os
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp
from clearance_scenes import free_pair, slider_crank
from overconstrained_scenes import MECHANISMS
from own_methods import Gauss, Midpoint

import mbdae as mb
from mbdae.integrators import dop853, radau, stored_runs

EVERY, ANEW, CALL = 10, 200, 16  #: steps between two checkpoints; of methods that begin anew there; of one call of C, at most
SEED = 3


def chain(model: Any = None) -> mb.Scene:
    """Two rods that fall."""
    s = mb.Scene("two rods", gravity=(0, -9.81, 0))
    a, b = s.link("a", (0, 0), (1, 0), mass=1.0), s.link("b", (1, 0), (2, 0.1), mass=0.7)
    s.revolute("A", s.ground, a, at=(0, 0), model=model)
    s.revolute("B", a, b, at=(1, 0), model=model)
    return s


def pushed() -> mb.Scene:
    """A rod that a force pushes for a time, held by a spring that is dry at its hinge."""
    s = mb.Scene("pushed rod", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("A", s.ground, rod, at=(0, 0), friction=mb.Coulomb(0.2, 0.05), radius=0.02)
    s.force("push", rod, (0, sp.Piecewise((15, (mb.t > 0.4) & (mb.t < 0.7)), (0, True)), 0), at=(1, 0))
    return s


def redundant() -> mb.Scene:
    """An over-constrained mechanism in space whose rows in force change along its turn."""
    return MECHANISMS["platform on three cranks"].scene(0)


def stick_slip() -> mb.Scene:
    """A mass that sticks and slips on a rail: Coulomb's law, whose argument turns its sign."""
    s = mb.Scene("stick-slip")
    mass, hand = s.rigid_body("mass", 1.0, 0.1, at=(0, 0)), s.rigid_body("hand", 1.0, 0.1, at=(1, 0))
    s.prismatic("rail", s.ground, mass, at=(0, 0), axis=(1, 0, 0), friction=mb.Coulomb(1.0, 1e-3), normal_force=1.0)
    s.prismatic("guide", s.ground, hand, at=(1, 0), axis=(1, 0, 0), position=0.5 * mb.t)
    s.spring("spring", mass, hand, at_k=(0, 0), at_l=(1, 0), stiffness=20.0)
    return s


def limited() -> mb.Scene:
    """Two rods whose joints hit stops: the mass that hits depends on the other joint."""
    s = mb.Scene("two rods with stops", gravity=(0, -9.81, 0))
    a, b, stop = s.link("a", (0, 0), (1, 0), mass=1.0), s.link("b", (1, 0), (2, 0.1), mass=0.7), mb.Stop(3e3, 0.1)
    s.revolute("A", s.ground, a, at=(0, 0), limits=(-1.2, 1.2), stop=stop)
    s.revolute("B", a, b, at=(1, 0), limits=(-0.8, 0.8), stop=stop)
    return s


def swinging_beam() -> mb.Scene:
    """A flexible pendulum."""
    s = mb.Scene("flexible pendulum", gravity=(0, -9.81, 0))
    beam = s.beam("beam", (0, 0), (1, 0), section=mb.Section(2e6, 8e5, 8e5, 20.0, 60.0, 60.0, 1.0, 1e-4), elements=2)
    s.revolute("A", s.ground, beam, at=(0, 0))
    return s


def spring() -> mb.Scene:
    """A point on a spring, which a solver of one's own may follow."""
    s = mb.Scene("spring", gravity=(0, -9.81, 0))
    bob = s.point_mass("bob", 1.0, at=(1, 0))
    s.spring("S", s.ground, bob, (0, 0), (1, 0), stiffness=50.0)
    return s


BY_ELIMINATION = mb.Index1(multipliers="eliminated")
#: name -> scene, end (s), options of `simulate`
RUNS: dict[str, tuple[Callable[[], mb.Scene], float, dict[str, Any]]] = {
    "Radau IIA": (chain, 4.0, {"solver": mb.RadauIIA(3)}),
    "Radau IIA, index 3, 5 stages": (chain, 4.0, {"solver": mb.RadauIIA(5), "form": mb.Index3()}),
    "Radau IIA, constant steps": (chain, 1.0, {"solver": mb.RadauIIA(2, step=2e-3)}),
    "Radau IIA, clearance": (lambda: slider_crank("B"), 0.02, {"solver": mb.RadauIIA(3), "accuracy": 1e-4}),
    "Radau IIA, impacts": (free_pair, 0.05, {"solver": mb.RadauIIA(2), "accuracy": 1e-4}),
    "Radau IIA, stops": (limited, 1.0, {"solver": mb.RadauIIA(3), "accuracy": 1e-4}),
    "Radau IIA, breaks and friction": (pushed, 2.0, {"solver": mb.RadauIIA(3)}),
    "Radau IIA, rows in force": (redundant, 4.0, {"solver": mb.RadauIIA(3), "accuracy": 1e-5}),
    "Radau IIA, beam": (swinging_beam, 0.5, {"solver": mb.RadauIIA(3), "accuracy": 1e-4}),
    "DOP853": (lambda: chain(mb.Recursive()), 10.0, {"solver": mb.DOP853()}),
    "DOP853, eliminated": (chain, 6.0, {"solver": mb.DOP853(), "form": BY_ELIMINATION}),
    "DOP853, breaks and friction": (pushed, 2.0, {"solver": mb.DOP853(), "form": BY_ELIMINATION}),
    "Radau IIA, stick-slip": (stick_slip, 2.0, {"solver": mb.RadauIIA(3), "accuracy": 1e-4}),
    "DOP853, rows in force": (redundant, 4.0, {"solver": mb.DOP853(), "form": BY_ELIMINATION, "accuracy": 1e-4}),
    "HHT": (chain, 1.0, {"solver": mb.HHT(step=2e-3)}),
    "generalised-alpha": (chain, 0.5, {"solver": mb.GeneralizedAlpha(), "accuracy": 1e-3}),
    "generalised-alpha, index 3": (redundant, 1.0, {"solver": mb.GeneralizedAlpha(step=2e-3), "form": mb.Index3()}),
    "IDA, rows in force": (redundant, 0.5, {"solver": mb.IDA(), "accuracy": 1e-3}),
    "IDA": (chain, 2.0, {"solver": mb.IDA(), "accuracy": 1e-5}),
    "IDA, clearance": (free_pair, 0.02, {"solver": mb.IDA(), "accuracy": 1e-3}),
    "CVODE": (lambda: chain(mb.Recursive()), 4.0, {"solver": mb.CVODE()}),
    "CVODE, BDF": (lambda: chain(mb.Recursive()), 2.0, {"solver": mb.CVODE(method="BDF"), "accuracy": 1e-5}),
    "a method of one's own": (spring, 1.0, {"solver": Midpoint(step=2e-3)}),
    "collocation of one's own": (spring, 1.0, {"solver": Gauss(2), "accuracy": 1e-6}),
    "chosen, verified": (chain, 3.0, {"verify": True}),
}


def bits(r: mb.Result) -> str:
    """A digest of all that a result tells, but times of computing."""
    told, run = hashlib.sha256(), r.solution
    inside = (run.t[:-1] + run.t[1:]) / 2  # the last step before a break among them
    for values in (run.t, run.y, run.yp, run(inside), run.derivative(inside), r.u, r.multipliers):
        told.update(np.ascontiguousarray(values).tobytes())
    counts = {name: value for name, value in vars(r.stats).items() if name not in ("cpu_s", "wall_s")}
    told.update(repr((counts, r.warnings, r.accuracy.as_data(), r.reliable, r.info.runs, r.info.choice)).encode())
    return told.hexdigest()


def run(name: str, folder: Path | None) -> str:
    """The bits of a run that is looked at after few steps, and kept in a folder, if one is given: written to the disk at every
    checkpoint."""
    make, end, options = RUNS[name]
    before = stored_runs.PAUSE, radau.ROWS, dop853.ROWS
    stored_runs.PAUSE, radau.ROWS, dop853.ROWS = 0.0, CALL, CALL
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            every = ANEW if "solver" in options and options["solver"].restarts else EVERY
            kept = {} if folder is None else {"checkpoint": folder, "every": every}
            return bits(make().simulate(end, **kept, **options))
    finally:
        stored_runs.PAUSE, radau.ROWS, dop853.ROWS = before


def killed(name: str, folder: Path, kills: int, how: int = signal.SIGKILL) -> tuple[int, str]:
    """How many of the signals came before the end of the run in a folder, each after a random number of files and a random time,
    and its bits in the end."""
    rng, hits = np.random.default_rng(SEED), 0
    whole = folder.with_name(folder.name + " counted")
    run(name, whole)
    files = 2 * len(list(whole.iterdir()))  # about: every file of steps has its state
    for _ in range(kills):
        hits += _killed_after(int(rng.integers(0, 2 + 2 * files // kills)), rng.exponential(0.002), name, folder, how)
    return hits, run(name, folder)


def _killed_after(changes: int, seconds: float, name: str, folder: Path, how: int) -> bool:
    """Whether a process that goes on with the run was ended before its own end, after so many files and a time."""
    child = os.fork()
    if child == 0:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)  # as in a script: `mbdae validate` has a handler of its own
        try:
            run(name, folder)
            os._exit(0)
        except mb.StoppedError:
            os._exit(3)
        except BaseException:
            traceback.print_exc()
            sys.stderr.flush()
        finally:
            os._exit(1)
    seen, status = _signature(folder), 0
    while changes > 0 and (status := os.waitpid(child, os.WNOHANG)[0]) == 0:
        now = _signature(folder)
        changes, seen = changes - (now != seen), now
        time.sleep(1e-4)
    if status:
        return False
    time.sleep(seconds)
    os.kill(child, how)
    ended = os.waitpid(child, 0)[1]
    if os.WIFEXITED(ended) and os.WEXITSTATUS(ended) == 1:
        raise RuntimeError(f"the run '{name}' failed")
    return os.WIFSIGNALED(ended) or os.WEXITSTATUS(ended) == 3


def _signature(folder: Path) -> tuple[int, int]:
    """Changes with every file that is written."""
    times = []
    for entry in os.scandir(folder) if folder.exists() else ():
        with contextlib.suppress(FileNotFoundError):
            times.append(entry.stat().st_mtime_ns)
    return len(times), max(times, default=0)
