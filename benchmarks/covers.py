"""What the accuracy of a run covers: how near the estimates of reactions and of the mesh of beams are, and what they cost.

    python benchmarks/covers.py [examples] [reactions] [mesh]

examples: of the default run at 1e-6 of each example the error of its reactions, and the largest one of the peaks of its joint
forces, each over the peak, as they are told; the bar: within the accuracy in 90 % of the examples.
reactions: the examples of accuracy.py and scenes with beams, the error against Radau IIA at 1e-11 (beams: all vibrations
resolved, 1e-8). mesh: one order more on the same elements beside half the elements, against 16 elements of order 4.
"""

# ruff: noqa: E402

from __future__ import annotations

import os

for library in ("OPENBLAS", "OMP", "MKL"):
    os.environ[f"{library}_NUM_THREADS"] = "1"  # read once, when numpy is imported

import importlib
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp

import mbdae as mb
from mbdae.formulations import default_form, system_for
from mbdae.results.clearance import OtherRun
from mbdae.results.errors import Errors
from mbdae.run.verification import distance_of_meshes
from mbdae.system.prepare import Prepared, prepare

sys.path[:0] = [str(Path(__file__).parent.parent / "validation")]
from accuracy import SCENES, example
from beam_scenes import bend45, cantilever, flexible_rotor, on_hub, princeton, slider_crank, spin_up, steel_pendulum, thin
from price import EXAMPLES, NAMES, WALL
from recursive_joints import table

# -- reactions

ACCURACIES = (1e-3, 1e-5, 1e-7)
WAYS: dict[str, Any] = {"default": None, "IDA": mb.IDA(), "RadauIIA(3)": mb.RadauIIA(3)}
BEAMS: dict[str, tuple[Callable[[], mb.Scene], float]] = {
    "slider-crank, 4 quadratic": (lambda: slider_crank(4, 2), 0.05),
    "steel pendulum": (lambda: steel_pendulum(100), 0.3),
    "flexible rotor": (lambda: flexible_rotor(lag=0.02), 0.3),
    "spin-up, 4 cubic": (lambda: spin_up(4, 3), 5.0),
}


def reaction_rows() -> Iterator[dict[str, Any]]:
    """Error of the reactions over what was asked, and its estimate over the error."""
    for name, t_end in SCENES.items():
        for way, solver in WAYS.items():
            for accuracy in ACCURACIES:
                yield reaction_row(name, example(name), t_end, accuracy, way, solver)
    for name, (scene, t_end) in BEAMS.items():
        for accuracy in (1e-3, 1e-4):
            yield reaction_row(name, scene(), t_end, accuracy, "default", None)


def reaction_row(name: str, scene: mb.Scene, t_end: float, accuracy: float, way: str, solver: Any) -> dict[str, Any]:
    """One run."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        r = scene.simulate(t_end, accuracy, solver=solver)
    begin = time.process_time()
    estimate = r.accuracy.reactions
    seconds = time.process_time() - begin
    prepared = r.prepared
    form = default_form(prepared)
    form = replace(form, waves=True) if prepared.model.lines else form  # type: ignore[type-var]
    exact = mb.RadauIIA(3, rtol=1e-8 if prepared.model.lines else 1e-11).solve(system_for(prepared, form, 3), t_end)
    times = np.linspace(0, t_end, 501)
    error = Errors(prepared, r.solution, (OtherRun(exact, times, 1.0),))()
    return {"scene": name, "way": f"{way}: {r.info.solver.label}" if solver is None else way, "asked": f"{accuracy:.0e}",
            "motion, estimate / asked": r.accuracy.motion / accuracy, "reactions, error": error,
            "estimate / error": estimate / error, "covered": "yes" if "reactions" in r.accuracy.covers else "no",
            "run, CPU s": r.info.cpu_s, "estimate, CPU ms": 1e3 * seconds}


# -- the examples


def example_rows() -> Iterator[dict[str, Any]]:
    """Of every example with joints that a default run comes to the end of."""
    if str(EXAMPLES) not in sys.path:
        sys.path.insert(0, str(EXAMPLES))
    for name in NAMES:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mb.AccuracyWarning)
            try:
                made = importlib.import_module(name)
                scene = made.scene()
                r = scene.simulate(made.t_end, 1e-6, max_wall=WALL)
            except (mb.MbdaeError, ImportError):
                continue
            peaks = [errors.of_peak(r, f"{joint.name}.force", peak.value, peak.t) for joint in scene.joints
                     if (errors := r.accuracy.errors) is not None and (peak := r.peak(f"{joint.name}.force"))]
        known = [one.relative if one is not None else np.inf for one in peaks]
        if known:
            reactions = r.accuracy.reactions
            within = reactions is not None and max(reactions, *known) <= 1e-6
            yield {"example": name, "reactions": reactions, "peaks": max(known), "covered": "yes" if within else "no"}


# -- the mesh of beams

SOFT = mb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=50.0, EI2=50.0, EI3=80.0, mass_per_length=1.0, rotary_inertia=0.01)
ELEMENTS, ORDERS = (2, 4, 8, 16), (1, 2, 3)


def flying(elements: int, order: int) -> mb.Scene:
    """A free beam in space that turns about no principal axis."""
    s = mb.Scene("flying", space="spatial")
    s.beam("beam", (0, 0, 0), (1, 0, 0), section=SOFT, elements=elements, order=order, velocity=(1, 0.5, 0.2),
           angular_velocity=(1, 2, 3))
    return s


def shaken(elements: int, order: int) -> mb.Scene:
    """A free beam in the plane, shaken at one end."""
    s = mb.Scene("shaken")
    beam = s.beam("beam", (0, 0), (1, 0), section=SOFT, elements=elements, order=order, angular_velocity=(0, 0, 10))
    s.force("shaker", beam.at(0.0), (0, 30 * sp.sin(20 * mb.t)))
    return s


def dropped(elements: int, order: int) -> mb.Scene:
    """A cantilever released straight under its weight."""
    s = mb.Scene("dropped", gravity=(0, -9.81, 0))
    beam = s.beam("beam", (0, 0), (1, 0), section=SOFT, elements=elements, order=order)
    s.weld("clamp", s.ground, beam.at(0.0))
    return s


Maker = Callable[[int, int], mb.Scene]
AT_REST: dict[str, tuple[Maker, str | None]] = {
    "elastica, P L^2 / EI = 1": (lambda n, p: cantilever(thin(), n, p, force=(0, 1.0, 0)), None),
    "elastica, P L^2 / EI = 10": (lambda n, p: cantilever(thin(), n, p, force=(0, 10.0, 0)), None),
    "princeton, 13.345 N, 45 deg": (lambda n, p: princeton(13.345, 45, n, p), None),
    "45 degree bend, 600": (lambda n, p: bend45(600, n, p), None),
    "on a hub, 20 rad/s": (lambda n, p: on_hub(SOFT, 20.0, 1.0, n, p), "hub"),
}
MOVING: dict[str, tuple[Maker, float, float]] = {
    "spin-up, 5 s": (spin_up, 5.0, 1e-8), "flying in space": (flying, 0.5, 1e-8), "shaken in the plane": (shaken, 0.5, 1e-8),
    "cantilever, dropped": (dropped, 0.5, 1e-8), "steel slider-crank": (slider_crank, 0.05, 1e-6),
    "steel pendulum, 1/20": (lambda n, p: steel_pendulum(20, n, p), 0.3, 1e-7),
}


def positions_at_rest(make: Maker, frame: str | None, n: int, p: int) -> tuple[tuple[Prepared, Any], float]:
    """A state at rest, and its CPU seconds."""
    begin = time.process_time()
    e = make(n, p).equilibrium(frame=frame)
    return (e.prepared, e.q), time.process_time() - begin


def positions_in_motion(make: Maker, t_end: float, rtol: float, n: int, p: int) -> tuple[tuple[Prepared, Any], float]:
    """Positions at 201 times, and the CPU seconds of the run."""
    prepared, times = prepare(make(n, p)), np.linspace(0, t_end, 201)
    run = mb.RadauIIA(3, rtol=rtol).solve(system_for(prepared, None, 3), t_end)
    return (prepared, prepared.states(times, run(times))[0]), run.stats.cpu_s


def mesh_rows() -> Iterator[dict[str, Any]]:
    """Per order, over 2, 4, 8 and 16 elements: error, both estimates over it, and what they cost over the run."""
    at_rest = {name: (lambda n, p, a=a: positions_at_rest(*a, n, p)) for name, a in AT_REST.items()}
    in_motion = {name: (lambda n, p, a=a: positions_in_motion(*a, n, p)) for name, a in MOVING.items()}
    for name, solve in (at_rest | in_motion).items():
        run = cache(solve)
        exact, _ = run(16, 4)
        for p in ORDERS:
            found = np.array([of_mesh(run, exact, n, p) for n in ELEMENTS]).T
            titles = ("error", "order + 1: estimate / error", "its CPU / run", "half: estimate / error", "its CPU / run ")
            texts = [" ".join(f"{x:.1e}" for x in found[0])] + [f"{v.min():.2g} to {v.max():.2g}" for v in found[1:]]
            yield {"scene": name, "order": p} | dict(zip(titles, texts, strict=True))


def of_mesh(run: Any, exact: Any, n: int, p: int) -> list[float]:
    """Error of a mesh, both estimates over it, each with its CPU over that of the run."""
    (own, cost), (higher, dearer), (half, cheaper) = run(n, p), run(n, p + 1), run(n // 2, p)
    error = distance_of_meshes(own, exact)
    return [error, distance_of_meshes(own, higher) / error, dearer / cost,
            distance_of_meshes(half, own) / (4**p - 1) / error, cheaper / cost]


PARTS = {"examples": example_rows, "reactions": reaction_rows, "mesh": mesh_rows}


def main() -> None:
    """Print the tables asked for."""
    for part in sys.argv[1:] or PARTS:
        rows = PARTS[part]()
        first = next(rows)
        table(_again(first, rows), list(first))


def _again(first: dict[str, Any], rows: Iterator[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    yield first
    yield from rows


if __name__ == "__main__":
    main()
