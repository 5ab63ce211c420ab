"""Six scenes at extreme parameters: no run is wrong without a warning."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

from runner import Case, Claim, Found

import mbdae as mb
from mbdae.extremes.ways import asked_values

claim = Claim("extremes", "at extreme masses, stiffnesses, speeds, clearances, steps and near singular positions no run is "
              "silently wrong", 0.0, "silent misses",
              "two methods, each controlled far below the accuracy asked, that agree; else a run is not judged")
SCENES = Path(__file__).parent / "scenes"
#: scene -> what a quick map varies; `vary` of the file is the whole one
QUICK: dict[str, dict[str, Any]] = {
    "rigid": {"coupler.mass": [1e-9, 1e9], "A.speed": [1e4], "step": [1e-1, 1e-9]},
    "recursive": {"leaf.mass": [0.0, 1e-9], "hip.speed": [1e4]},
    "stiff_beam": {"rod.stiffness": [1e10]},
    "contact": {"B.clearance": [1e-8]},
    "near_singular": {"delta": [1e-8], "tilt": [1e-7]},
    "kicked": {"kick.width": [2e-6, 2e-3], "scene(bump=1).A.width": [2e-2]},
}
RUNS = (mb.Run(mb.IDA()), mb.Run(mb.RadauIIA(3)), mb.Run(mb.RadauIIA(3), model=mb.Recursive()))


def scene_file(name: str) -> ModuleType:
    """A file of scenes/."""
    spec = importlib.util.spec_from_file_location(f"extremes_{name}", SCENES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def silent(name: str, vary: dict[str, Any] | None = None, runs: Sequence[mb.Run] | None = None, max_wall: float = 10.0) -> Found:
    """Number of silent misses of a map."""
    file = scene_file(name)
    m = mb.extremes(file.scene, file.t_end, vary or file.vary, runs, accuracy=file.accuracy, max_wall=max_wall)
    worst = "; ".join(f"{cell.label} at {cell.value:g}: {cell.error}" for cell in m.silent)
    return Found(len(m.silent), note=m.verdict + (f" Silent: {worst}" if worst else ""))


def _places(name: str) -> dict[str, tuple[str, float]]:
    """Parameter and value of every place of the whole map of a scene, by name."""
    return {f"{parameter} = {value:g}": (parameter, value)
            for parameter, values in asked_values(scene_file(name).vary).items() for value in values}


def places(name: str, chosen: Iterable[str]) -> Found:
    """Silent misses at some places of the map of a scene."""
    vary: dict[str, list[float]] = {}
    for parameter, value in (_places(name)[place] for place in chosen):
        vary.setdefault(parameter, []).append(value)
    return silent(name, vary)


def cases() -> list[Case]:
    quick = [Case(f"{name}, some values", "IDA, RadauIIA(3)", lambda name=name: silent(name, QUICK[name], _runs(name)),  # type: ignore[misc]
                  name not in ("recursive", "contact")) for name in QUICK]
    whole = [Case(f"values of the map, {name}", "all", partial(places, name), slow=True, parts=list(_places(name)))
             for name in QUICK]
    return [*quick, *whole]


def _runs(name: str) -> Sequence[mb.Run]:
    """Joints with clearance keep their model; BDF takes long for what it follows in beams."""
    return {"contact": RUNS[:2], "stiff_beam": RUNS[1:2]}.get(name, RUNS)
