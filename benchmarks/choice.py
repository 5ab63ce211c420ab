"""What the automatic choice of `simulate` costs beside the best one known: CPU of the default run over CPU of the best.

Every scene is run to every accuracy by default, then as stated and with recursive joints (`s.recursive()`), by every solver
and form named in `METHODS`; all runs control their error, and count where the error measured against a tight reference is
at most what was asked. Runs that take more than `PATIENCE` times the default are stopped: they cannot be the best.

    python benchmarks/choice.py [--accuracies 1e-4 1e-6 1e-8] [--all] [scene ...]

One thread, process time, median of five runs below 0.1 s, after a short run that compiles. --all prints every run.
"""

# ruff: noqa: E402

from __future__ import annotations

import os

for library in ("OPENBLAS", "OMP", "MKL"):
    os.environ[f"{library}_NUM_THREADS"] = "1"  # read once, when numpy is imported

import argparse
import importlib
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import mbdae as mb
from mbdae.results.result import Result
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.sampling import motion_distance

ROOT = Path(__file__).parent.parent
sys.path[:0] = [str(ROOT / folder) for folder in ("validation", "examples", "benchmarks")]
import beam_scenes
import scenes
from recursive_joints import chain

EXAMPLES = sorted(path.stem for path in (ROOT / "examples").glob("*.py"))
PATIENCE = 1.5  #: wall time of a run over that of the default at which it is stopped
TIMES = 401
METHODS: dict[str, tuple[mb.Solver, mb.Form | None]] = {
    "IDA": (mb.IDA(), None),
    "IDA, order 2": (mb.IDA(max_order=2), None),
    "CVODE (Adams)": (mb.CVODE(), None),
    "CVODE (BDF)": (mb.CVODE(method="BDF"), None),
    "DOP853": (mb.DOP853(), None),
    "DOP853, Index1": (mb.DOP853(), mb.Index1()),
    "CVODE (Adams), Index1": (mb.CVODE(), mb.Index1()),
    "RadauIIA(3), Index1": (mb.RadauIIA(3), mb.Index1()),
    "RadauIIA(2)": (mb.RadauIIA(2), None),
    "RadauIIA(3)": (mb.RadauIIA(3), None),
    "RadauIIA(3), Index3": (mb.RadauIIA(3), mb.Index3()),
}


@dataclass
class Case:
    """A scene by name: how it is made, to what end, and the solver and rtol of its reference."""

    scene: Callable[[], Any]
    t_end: float
    reference: tuple[mb.Solver, bool] = (mb.RadauIIA(3, rtol=3e-12), False)  #: solver, whether on recursive joints
    accuracies: tuple[float, ...] = (1e-4, 1e-6, 1e-8)


BY_ADAMS = mb.CVODE(rtol=1e-13), True
ELASTIC: dict[str, Any] = {"reference": (mb.RadauIIA(3, rtol=1e-9), False), "accuracies": (1e-4, 1e-6)}


def example(name: str, **options: Any) -> Case:
    """An example as its file states it."""
    module = importlib.import_module(name)
    return Case(module.scene, module.t_end, **options)


def cases() -> dict[str, Case]:
    """All scenes: the examples first."""
    special: dict[str, dict[str, Any]] = {
        "pendulum": {"reference": BY_ADAMS}, "ground_resonance": {"reference": BY_ADAMS},
        "clearance_rotor": {"reference": (mb.RadauIIA(3, rtol=1e-8), False), "accuracies": (1e-4,)},
        "slider_crank_clearance": {"reference": (mb.RadauIIA(3, rtol=1e-11), False)},
    }
    found = {name: example(name, **special.get(name, {})) for name in EXAMPLES}
    rotor, adams = scenes.ground_resonance, {"reference": BY_ADAMS}
    found["ground_resonance, free"] = Case(partial(importlib.import_module("ground_resonance").scene, free=True), 2.0, **adams)
    found["ground_resonance, bushing"] = Case(partial(rotor, 2, True), 2.0)
    for n in (4, 16, 64):
        found[f"planar chain of {n}"] = Case(partial(chain, n, "planar", None), 1.0, **(adams if n < 64 else {}))
    for n in (4, 10):
        found[f"spatial chain of {n}"] = Case(partial(chain, n, "spatial", None), 1.0, **adams)
    found["10 points"] = Case(partial(scenes.n_points, 10), 1.0)
    found["heavy top, spinning"] = Case(scenes.heavy_top, 0.5)
    found["dzhanibekov"] = Case(scenes.dzhanibekov, 20.0)
    found["4-four-bar"] = Case(partial(scenes.n_four_bar, 4), 1.0)
    found["slider-crank, flexible"] = Case(partial(beam_scenes.slider_crank, 4, 2), 0.02, **ELASTIC)
    found["beam on a hub"] = Case(partial(beam_scenes.on_hub, beam_scenes.thin(1e-4), 6.0, 1.0, 4, 2), 0.5, **ELASTIC)
    return found


# -- errors


def of_bodies(scene: Prepared, r: Result, times: Any) -> tuple[Any, Any]:
    """q, u of the bodies' nodes of a run at `times`, in the order of `scene`, whatever its joint models."""
    q, u, _ = r.states(times)
    own = {node.name: node for node, _ in r.prepared.model.bodies}
    out = np.zeros((len(times), scene.model.nq)), np.zeros((len(times), scene.model.nu))
    for node, _ in scene.model.bodies:
        for whole, part, first, theirs, n in ((out[0], q, node.q, own[node.name].q, node.kind.sizes[0]),
                                              (out[1], u, node.u, own[node.name].u, node.kind.sizes[1])):
            whole[:, first : first + n] = part[:, theirs : theirs + n]
    return out


@dataclass
class Trial:
    """One way to run a scene: measured error and CPU s; text of a failure."""

    label: str
    error: float = float("nan")
    cpu: float = float("inf")
    wall: float = float("inf")
    failure: str = ""


class Bench:
    """A case with its reference."""

    def __init__(self, case: Case) -> None:
        self.case, self.prepared = case, prepare(case.scene())
        self.times = np.linspace(0.0, case.t_end, TIMES)
        solver, recursive = case.reference
        found = (case.scene().recursive() if recursive else case.scene()).simulate(case.t_end, solver=solver)
        self.exact = of_bodies(self.prepared, found, self.times)

    def error(self, r: Result) -> float:
        """Largest error over the run, in the measure of `accuracy`."""
        return float(np.max(motion_distance(self.prepared, of_bodies(self.prepared, r, self.times), self.exact)))

    def trial(self, label: str, scene: Any, accuracy: float, patience: float | None, **chosen: Any) -> Trial:
        """A way to run the scene, timed."""
        try:
            scene.simulate(1e-3 * self.case.t_end, accuracy, **chosen)
        except mb.MbdaeError as failure:
            return Trial(label, failure=str(failure))
        seconds: list[float] = []
        while len(seconds) < (1 if not seconds or seconds[0] > 0.1 else 5):
            begin, clock = time.process_time(), time.perf_counter()
            try:
                r = scene.simulate(self.case.t_end, accuracy, max_wall=patience, **chosen)
            except mb.MbdaeError as failure:
                return Trial(label, failure=str(failure))
            seconds.append(time.process_time() - begin)
            wall = time.perf_counter() - clock
        told = f"{label}: {r.info.choice}" if r.info.choice else label
        return Trial(told, self.error(r), float(np.median(seconds)), wall)

    def trials(self, accuracy: float) -> Iterator[Trial]:
        """The default run, then all others."""
        stated = self.case.scene()
        default = self.trial("default", stated, accuracy, None)
        yield default
        variants = {"": stated}
        if not any(c.recursive for c in stated.joints) and any(c.recursive for c in stated.recursive().joints):
            variants["recursive, "] = stated.recursive()
        for name, scene in variants.items():
            free = not prepare(scene).rows  # no constraints: every form is the same ordinary differential equation
            for label, (solver, form) in METHODS.items():
                if form is None or not free:
                    yield self.trial(name + label, scene, accuracy, PATIENCE * default.wall + 0.1, solver=solver, form=form)


def _short(label: str) -> str:
    """What was run, without the reason; a default run with what was chosen."""
    head, _, rest = label.partition(": ")
    return rest.split(":")[0] if head == "default" else head


def main() -> None:
    """Print the table and the median of the examples."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--accuracies", nargs="*", type=float)
    parser.add_argument("--all", action="store_true")
    wanted, known = parser.parse_args(), cases()
    warnings.simplefilter("ignore", mb.AccuracyWarning)
    print("| scene | accuracy | default | error | CPU s | best | error | CPU s | regret |\n" + "|---" * 9 + "|")
    regrets: dict[str, list[float]] = {}
    for name in wanted.scenes or known:
        bench = Bench(known[name])
        for accuracy in wanted.accuracies or known[name].accuracies:
            default, *others = bench.trials(accuracy)
            met = [trial for trial in (default, *others) if trial.error <= accuracy]
            best = min(met or [default], key=lambda trial: trial.cpu)
            regrets.setdefault(name, []).append(default.cpu / best.cpu)
            told = [text for t in (default, best) for text in (_short(t.label), f"{t.error:.0e}", f"{t.cpu:.3f}")]
            cells = (name, f"{accuracy:.0e}", *told, f"{default.cpu / best.cpu:.2f}")
            print("| " + " | ".join(cells) + " |", flush=True)
            for trial in others if wanted.all else ():
                print(f"    {trial.label}: error {trial.error:.1e}, {trial.cpu:.3f} s {trial.failure[:90]}", flush=True)
    for title, names in (("examples", set(EXAMPLES)), ("all scenes", set(regrets))):
        values = [value for name, own in regrets.items() if name in names for value in own]
        if values:
            print(f"\n{title}: median {np.median(values):.2f}, largest {max(values):.2f}, above 2: {sum(v > 2 for v in values)}")


if __name__ == "__main__":
    main()
