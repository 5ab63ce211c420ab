"""`mbdae.arena`: many scenes, each by mbdae's methods and by other programs against a confirmed reference; a folder to cite.

Every scene is one comparison (`mbdae.compare`), kept in a file of its own as it goes, so that an arena that was stopped goes on.
The suites are scenes drawn by a seed: their sizes, masses, starts and axes; the same seed draws the same scenes.
"""

from __future__ import annotations

import hashlib
import json
import runpy
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import sympy

from mbdae.api import Scene
from mbdae.arena.page import Arena, Entry, file_name
from mbdae.compare import ACCURACIES, checked_accuracies, compare
from mbdae.compare.problem import SECONDS
from mbdae.compare.run import checked_runs, is_all, progress_of_runs
from mbdae.engines import engines_of
from mbdae.errors import MbdaeError, OptionError, naming_arguments
from mbdae.export import export
from mbdae.inputs import time_symbol
from mbdae.laws.contact import Hertz
from mbdae.notation import counted
from mbdae.run.checkpoint import environment
from mbdae.scene.components import Clearance
from mbdae.scene.shapes import Section
from mbdae.study.kept import ResumeFile, told_when_interrupted
from mbdae.study.workers import with_processes
from mbdae.values import number as positive
from mbdae.values import option, optional, path, shown, whole

__all__ = ["Arena", "arena"]

time = time_symbol()
MAX_WALL = 20.0  #: default of the largest wall time of a run, s
Drawn = tuple[str, Any, float]  #: name, scene, end time (s)


# -- suites: one scene of each class, drawn


def _rods(s: Any, rng: Any, n: int, axes: Sequence[Any], ground: Any = None) -> None:
    """A chain of rods with hinges about the axes in turn, released from rest."""
    before, at = ground or s.ground, np.zeros(3)
    for i in range(n):
        z = np.asarray(axes[i % len(axes)], dtype=float)
        way = rng.normal(size=3) * (1, 1, 0 if len(axes) == 1 else 1)
        way -= (way @ z) * z / (z @ z)
        end = at + way / np.linalg.norm(way) * rng.uniform(0.2, 0.6)
        rod = s.link(f"rod {i + 1}", at, end, mass=float(rng.uniform(0.5, 2)))
        s.revolute(f"J{i + 1}", before, rod, at=at, axis=z / np.linalg.norm(z), damper=float(rng.choice([0.0, 0.02])))
        before, at = rod, end


def _pendulum(rng: Any) -> Drawn:
    s = Scene("pendulum", gravity=(0, -9.81, 0))
    a, length = rng.uniform(0.3, 2.8), rng.uniform(0.3, 2)
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (length * np.sin(a), -length * np.cos(a)), mass=1.0), at=(0, 0))
    return "pendulum", s, 2.0


def _long(rng: Any) -> Drawn:
    _, s, _ = _pendulum(rng)
    return "long pendulum", s, 60.0


def _chain(rng: Any) -> Drawn:
    n = int(rng.integers(2, 6))
    s = Scene(f"planar chain of {n}", gravity=(0, -9.81, 0))
    _rods(s, rng, n, [(0, 0, 1)])
    return "planar chain", s, 1.0


def _spatial(rng: Any) -> Drawn:
    n = int(rng.integers(2, 6))
    s = Scene(f"spatial chain of {n}", gravity=(0, 0, -9.81))
    _rods(s, rng, n, [(0, 1, 0), (0, 1, 1), (1, 0, 0)])
    return "spatial chain", s, 0.8


def _bars(s: Any, rng: Any, drive: Any) -> Any:
    points = [(0.0, 0.0), (0.0, rng.uniform(0.2, 0.3)), (rng.uniform(0.45, 0.55), rng.uniform(0.5, 0.65)), (0.6, 0.0)]
    links = [s.link(name, points[i], points[i + 1], mass=float(rng.uniform(0.3, 1.0)))
             for i, name in enumerate(("crank", "coupler", "rocker"))]
    for name, k, l, at in zip("ABCD", (s.ground, *links), (*links, s.ground), points, strict=True):
        s.revolute(name, k, l, at=at, **({"angle": drive} if name == "A" and drive is not None else {}),
                   **({"spring": 2.0, "damper": 0.01} if name == "C" else {}))
    return links, points


def _four_bar(rng: Any) -> Drawn:
    s = Scene("four-bar, driven", gravity=(0, -9.81, 0))
    _bars(s, rng, float(rng.uniform(6, 14)) * time)
    return "four-bar of the paper", s, 1.0


def _free_bar(rng: Any) -> Drawn:
    s = Scene("four-bar, free", gravity=(0, -9.81, 0))
    _bars(s, rng, None)
    return "free four-bar", s, 1.0


def _six_bar(rng: Any) -> Drawn:
    s = Scene("six-bar", gravity=(0, -9.81, 0))
    (_, coupler, _), points = _bars(s, rng, None)
    tip, foot = (points[2][0] + 0.3, points[2][1] + 0.2), (points[2][0] + 0.5, -0.1)
    five, six = s.link("five", points[2], tip, mass=0.4), s.link("six", tip, foot, mass=0.4)
    s.revolute("E", coupler, five, at=points[2])
    s.revolute("F", five, six, at=tip)
    s.revolute("G", six, s.ground, at=foot)
    return "six-bar", s, 1.0


def _slider(rng: Any, model: Any = None) -> Scene:
    s = Scene("slider-crank", gravity=(0, -9.81, 0))
    r = float(rng.uniform(0.08, 0.15))
    crank, rod = s.link("crank", (0, 0), (0, r), mass=0.4), s.link("rod", (0, r), (0.5, 0), mass=0.8)
    block = s.rigid_body("block", 1.0, 0.01, at=(0.5, 0))
    s.revolute("A", s.ground, crank, at=(0, 0), rate0=float(rng.uniform(-20, -10)))
    s.revolute("B", crank, rod, at=(0, r))
    s.revolute("C", rod, block, at=(0.5, 0), **({"model": model} if model else {}))
    s.prismatic("D", s.ground, block, at=(0.5, 0), axis=(1, 0, 0), damper=float(rng.uniform(0, 2)))
    return s


def _slider_crank(rng: Any) -> Drawn:
    return "slider-crank", _slider(rng), 1.0


def _clearance(rng: Any) -> Drawn:
    play = float(rng.uniform(1e-4, 5e-4))
    model = Clearance(outer=0.01 + play, inner=0.01, normal=Hertz(float(10 ** rng.uniform(8, 9)), 0.5))
    return "slider-crank with play", _slider(rng, model), 0.2


def _stiff(rng: Any) -> Drawn:
    s = _slider(rng)
    s.name = "slider-crank on a stiff spring"
    stiffness, damping = float(10 ** rng.uniform(4, 6)), float(rng.uniform(1, 50))
    s.spring("S", s.ground, s["block"], (1.0, 0.0), (0.5, 0.0), stiffness=stiffness, damping=damping)
    return "stiff spring", s, 0.5


def _arm(rng: Any, driven: bool) -> Drawn:
    s = Scene("arm, driven" if driven else "arm, free", gravity=(0, 0, -9.81))
    before, at = s.ground, np.zeros(3)
    for i, (axis, way) in enumerate((((0, 0, 1), (0, 0, 0.3)), ((0, 1, 0), (0.4, 0, 0)), ((0, 1, 0), (0.3, 0, 0.1)))):
        end = at + np.array(way) * rng.uniform(0.8, 1.2)
        body = s.rigid_body(f"link {i + 1}", float(rng.uniform(1, 4)), rng.uniform(0.02, 0.03, 3), at=(at + end) / 2)
        rate = float(rng.uniform(-2, 2))
        law = {"angle": rate * time**2 / 2} if driven else {"rate0": rate, "damper": 0.05, "spring": float(rng.uniform(0, 20))}
        s.revolute(f"q{i + 1}", before, body, at=at, axis=axis, **law)
        before, at = body, end
    return s.name, s, 1.0


def _top(rng: Any) -> Drawn:
    s = Scene("heavy top", gravity=(0, 0, -9.81))
    tilt, spin = rng.uniform(0.2, 1.2), rng.uniform(30, 120)
    axis = np.array([0.0, np.sin(tilt), np.cos(tilt)])
    x = np.array([1.0, 0.0, 0.0])
    R = np.column_stack([x, np.cross(axis, x), axis])
    body = s.rigid_body("top", 1.5, (0.02, 0.02, 0.01), at=0.3 * axis, rotation=R, angular_velocity=spin * axis)
    s.spherical("tip", s.ground, body, at=(0, 0, 0))
    return "heavy top", s, 1.0


def _free(rng: Any) -> Drawn:
    s = Scene("free rotor", gravity=(0, 0, 0))
    s.rigid_body("rotor", 1.0, (0.01, 0.02, 0.025), at=(0, 0, 0), angular_velocity=(*rng.uniform(-0.1, 0.1, 1), 8.0, 0.05))
    return "free rotor about its middle axis", s, 5.0


def _beam(rng: Any) -> Drawn:
    s = Scene("flexible pendulum", gravity=(0, -9.81, 0))
    EI = float(rng.uniform(20, 200))
    section = Section(EA=1e4, GA2=5e3, GA3=5e3, GJ=EI, EI2=EI, EI3=EI, mass_per_length=1.0, rotary_inertia=0.01)
    s.revolute("root", s.ground, s.beam("beam", (0, 0), (1, 0), section=section, elements=4, order=1), at=(0, 0))
    return "flexible pendulum", s, 0.5


def _flying(rng: Any) -> Drawn:
    s = Scene("flying beam", gravity=(0, 0, 0))
    section = Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=500.0, EI2=500.0, EI3=500.0, mass_per_length=1.0, rotary_inertia=10.0)
    beam = s.beam("beam", (0, 0), (10, 0), section=section, elements=6, order=1)
    pulse = sympy.sin(sympy.pi * time / 2.5) ** 4
    s.force("push", beam, (float(rng.uniform(4, 12)) * pulse, 0, 0), at=(0, 0))
    s.torque("twist", beam.at((0, 0)), (0, 0, float(rng.uniform(-100, -40)) * pulse))
    return "flying beam", s, 2.0


#: classes of scenes, in the order in which they are drawn
SUITES: dict[str, Callable[[Any], Drawn]] = {
    "paper": _four_bar, "pendulum": _pendulum, "chain": _chain, "top": _top, "linkage": _free_bar, "beam": _flying,
    "robot": lambda rng: _arm(rng, True), "clearance": _clearance, "stiff": _stiff, "long": _long, "spatial": _spatial,
    "six-bar": _six_bar, "slider": _slider_crank, "free arm": lambda rng: _arm(rng, False), "rotor": _free, "flexible": _beam}


def drawn(count: int, seed: int) -> Iterator[tuple[str, Drawn]]:
    """`count` scenes: every class in turn, each with numbers of its own; (class, (name, scene, end time in s))."""
    for i in range(count):
        kind = list(SUITES)[i % len(SUITES)]
        yield kind, SUITES[kind](np.random.default_rng([seed, i]))


# -- what runs


def _compared(scene: Any, t_end: float, options: Mapping[str, Any], resume: Any) -> dict[str, Any]:
    """The job of one scene, in this or another process."""
    try:
        found, error = compare(scene, t_end, resume=resume, **options), ""
    except MbdaeError as refused:
        found, error = None, f"{type(refused).__name__}: {refused}"
    hashes = {"statements": hashlib.sha256(json.dumps(scene.statements, sort_keys=True, default=str).encode()).hexdigest()}
    with suppress(MbdaeError):  # not every law has C
        hashes["equations"] = hashlib.sha256(export(scene, format="c").text.encode()).hexdigest()
    return {"comparison": found, "error": error, "hashes": hashes}


class Asked(ResumeFile):
    """What an arena in progress was asked for; more scenes may be added to it."""

    kind, file_format = "arena", "mbdae arena in progress 1"


def _scenes(given: Any, count: int, seed: int) -> list[tuple[str, str, Any, float]]:
    """(name, suite, scene, end time) of every scene, names made different."""
    if given is None:
        found = [(name, kind, scene, t_end) for kind, (name, scene, t_end) in drawn(count, seed)]
    elif isinstance(given, Mapping):
        found = [(str(name), "given", *_pair(given, name, pair)) for name, pair in given.items()]
    elif isinstance(given, list | tuple):
        pairs = [_pair(given, n, pair) for n, pair in enumerate(given, 1)]
        found = [(scene.name, "given", scene, t_end) for scene, t_end in pairs]
    else:
        found = list(_of_folder(given))
    seen = dict[str, int]()
    named = []
    for name, suite, scene, t_end in found:
        seen[name] = seen.get(name, 0) + 1
        named.append((name if seen[name] == 1 else f"{name} {seen[name]}", suite, scene, t_end))
    if not named:
        raise OptionError(f"scenes = {shown(given)}: there is none; give a folder of files with scene() and t_end, or "
                          f"[(scene, t_end), ...]")
    return named


def _pair(given: Any, name: Any, pair: Any) -> tuple[Any, float]:
    both = isinstance(pair, list | tuple) and len(pair) == 2
    if not (both and isinstance(pair[0], Scene) and isinstance(pair[1], int | float)):
        raise OptionError(f"scenes = {shown(given)}: entry {name} = {shown(pair)}: give a scene with its end time in s, "
                          f"(scene, 2.0)")
    return pair[0], float(pair[1])


def _of_folder(folder: Any) -> Iterator[tuple[str, str, Any, float]]:
    """The scenes of the Python files in a folder that have scene() and t_end."""
    where = Path(option("scenes", folder, path, "give a folder, or [(scene, t_end), ...]"))
    files: list[Path] | None = None
    with suppress(OSError):  # a name that is too long
        files = sorted(where.glob("*.py")) if where.is_dir() else None
    if files is None:
        raise OptionError(f"scenes = {shown(folder)} is no folder; give one of Python files with scene() and t_end")
    for file in files:
        if "def scene(" not in file.read_text(encoding="utf-8", errors="replace"):
            continue
        space = runpy.run_path(str(file))
        if "t_end" in space:
            yield file.stem, where.name, space["scene"](), float(space["t_end"])


@naming_arguments
def arena(scenes: Any = None, engines: Any = None, accuracies: Sequence[float] = ACCURACIES, runs: Any = None, count: int = 30,
          seed: int = 0, workers: int = 1, max_wall: float | None = MAX_WALL,
          progress: Callable[[int, int, str], None] | None = None, resume: Any = None) -> Arena:
    """Compare many scenes, each by mbdae's methods and by other programs; returns an `Arena`, whose `.save(folder)` is a folder
    to cite.

    scenes: a folder of Python files with scene() and t_end, [(scene, t_end), ...] or {name: (scene, t_end)}; None: `count` scenes
    of the suites (the paper's, linkages, robots, tops, beams, clearances, stiff and long ones), drawn by `seed`. engines,
    accuracies, runs, max_wall: of each comparison, as in `mb.compare`. workers: number of processes that compare, each a scene at
    a time; more than processors spoil the CPU times. resume: a folder that keeps every finished run; the same call goes on from
    there. progress(done, total, name): called before every scene.
    """
    number = option("count", count, whole, "give a number of scenes from 1", least=1)
    many = option("workers", workers, whole, "give a number of processes from 1", least=1)
    seed = option("seed", seed, whole, "give a whole number from 0", least=0)
    runs = runs if runs is None or is_all(runs) else checked_runs(runs)
    max_wall = optional("max_wall", max_wall, positive, SECONDS, above=0)
    programs, accuracies = [one.label for one in engines_of(engines)], checked_accuracies(accuracies)
    tell, named = progress_of_runs(progress), _scenes(scenes, number, seed)
    options = {"engines": engines, "accuracies": accuracies, "runs": runs, "max_wall": max_wall}
    kept: Path | None = optional("resume", resume, path, "give a folder, or None")
    if kept is not None:
        try:
            kept.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OptionError(f"resume = {shown(resume)} cannot be made: {error.strerror or error}; name another one") from error
        same = Asked(kept / "_asked.json", {"engines": programs, "accuracies": list(accuracies), "max_wall": max_wall,
                                            "seed": seed if scenes is None else None})
        with same.stored():
            same.store({"rows": []})
    files = [kept / f"{file_name(name)}.json" if kept else None for name, *_ in named]
    points = {i: {"scene": scene, "t_end": t_end, "options": options, "resume": files[i]}
              for i, (_, _, scene, t_end) in enumerate(named)}
    done = dict[int, dict[str, Any]]()
    title = f"Arena: {counted(len(named), 'scene')}" + (f", seed {seed}" if scenes is None else "")
    asked = {"engines": programs, "accuracies": list(accuracies), "seed": seed if scenes is None else None,
             "count": len(named), "max_wall": max_wall, "scenes": [name for name, *_ in named]}

    def made() -> Arena:
        entries = tuple(Entry(named[i][0], named[i][1], one["comparison"], one["error"], one["hashes"])
                        for i, one in sorted(done.items()))
        return Arena(title, max(t_end for *_, t_end in named), entries, asked, environment())

    with told_when_interrupted(kept, "scenes", lambda: (len(done), len(named)), made):
        if many == 1:
            for i, point in points.items():
                tell(len(done), len(named), named[i][0])
                done[i] = _compared(**point)
        else:
            tell(0, len(named), named[0][0])
            for i, found in with_processes(_compared, points, many):
                done[i] = found.values or {"comparison": None, "error": found.error, "hashes": {}}
                tell(len(done), len(named), named[i][0])
    return made()
