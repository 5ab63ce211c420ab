"""Engines: other programs that run the same scene, each in a Python environment that the user names.

An engine is a class in one file. It states a scene in the words of its program (`state`): a script that works by itself and the
files that the script reads; or it says what the program cannot state. The script is run as a process of that environment. It
first tells where its bodies are, how fast they move and what they weigh, which is compared with the scene before anything is
measured; then it runs the scene with one method and one setting after another (`Session`).

An engine of another package derives from `Engine` and is given as a class, `engines={MyEngine: "/path/to/python"}`, or by name,
where that package enters it in the group "mbdae.engines" of its entry points.
"""

from __future__ import annotations

import inspect
import json
import os
import subprocess
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from hashlib import sha256
from importlib import import_module
from importlib.metadata import entry_points
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from mbdae.errors import OptionError, meant
from mbdae.system.base import Array
from mbdae.system.model.nodes import Node, rotation_matrices
from mbdae.system.prepare import Prepared
from mbdae.values import shown

OWN = {"exudyn": "Exudyn", "mujoco": "MuJoCo", "scipy": "SciPy"}  #: engines of this package: module and class
GROUP = "mbdae.engines"  #: entry points of other packages
INTERVALS = 1024  #: of the times at which motions are compared; an engine gives its motion at all of them, or at every k-th
STARTS = 60.0  #: wall time (s) in which a program has to start and to state the scene
#: columns of a motion: position of the centre of mass (or of the node of a beam), m; quaternion, scalar part first; velocity,
#: m/s; angular velocity, rad/s; all of them in inertial axes
COLUMNS = 13
CANNOT, OTHER = "cannot state", "states another scene"  #: how the failures begin of a program that does not run a scene


@dataclass(frozen=True)
class Case:
    """What an engine states: a scene with kinematic joints (`prepared`) and its start; times: (INTERVALS + 1,) of the comparison,
    s; nodes: what moves in it, bodies and nodes of beams."""

    scene: Any
    prepared: Prepared
    times: Array

    @property
    def nodes(self) -> list[Node]:
        """Bodies and nodes of beams, in the order of the rows of a motion."""
        return [node for node in self.prepared.model.nodes if node.body is not None]

    @property
    def step(self) -> float:
        """A step (s) with which a method of second order begins to see the motion."""
        return self.prepared.time / 10

    def rows(self, q: Array, u: Array) -> Array:
        """Motion (nt, nodes, COLUMNS) from positions q (nt, nq) and velocities u (nt, nu)."""
        out = np.zeros((len(q), len(self.nodes), COLUMNS))
        out[..., 3] = 1.0
        for i, node in enumerate(self.nodes):
            n, (nq, nu) = node.kind.translations, node.kind.sizes
            a, b = q[:, node.q : node.q + nq], u[:, node.u : node.u + nu]
            out[:, i, :n], out[:, i, 7 : 7 + n] = a[:, :n], b[:, :n]
            if nq == 3 and node.kind.turns:
                half = a[:, 2] / 2
                out[:, i, 3], out[:, i, 6], out[:, i, 12] = np.cos(half), np.sin(half), b[:, 2]
            elif nq == 7:
                out[:, i, 3:7] = a[:, 3:] / np.linalg.norm(a[:, 3:], axis=1, keepdims=True)
                out[:, i, 10:13] = np.einsum("tij,tj->ti", rotation_matrices(a[:, 3:]), b[:, 3:])
        return out

    def motion(self, rows: Array) -> tuple[Array, Array]:
        """Positions (nt, nq) and velocities (nt, nu) from a motion; whole turns of angles are counted from the start on."""
        start, every = self.prepared.start, (len(self.times) - 1) // (len(rows) - 1)
        q, u = np.zeros((len(rows), len(start.q))), np.zeros((len(rows), len(start.u)))
        passed = np.diff(self.times[::every])
        for i, node in enumerate(self.nodes):
            n, (nq, nu), found = node.kind.translations, node.kind.sizes, rows[:, i]
            q[:, node.q : node.q + n], u[:, node.u : node.u + n] = found[:, :n], found[:, 7 : 7 + n]
            if nq == 3 and node.kind.turns:
                rate, angle = found[:, 12], 2 * np.arctan2(found[:, 6], found[:, 3])
                turn = start.q[node.q + 2] + np.r_[0.0, np.cumsum(passed * (rate[1:] + rate[:-1]) / 2)]
                q[:, node.q + 2], u[:, node.u + 2] = turn + np.remainder(angle - turn + np.pi, 2 * np.pi) - np.pi, rate
            elif nq == 7:
                q[:, node.q + 3 : node.q + 7] = found[:, 3:7]
                u[:, node.u + 3 : node.u + nu] = np.einsum("tji,tj->ti", rotation_matrices(found[:, 3:7]), found[:, 10:13])
        return q, u

    def start(self) -> dict[str, Array]:
        """The start of the scene as `Engine` scripts tell it: motion (nodes, COLUMNS), mass (nodes,), acceleration (nodes, 3)."""
        s = self.prepared.start
        acceleration = np.zeros((len(self.nodes), 3))
        for i, node in enumerate(self.nodes):
            n = node.kind.translations
            acceleration[i, :n] = s.acceleration[node.u : node.u + n]
        return {"motion": self.rows(s.q[None], s.u[None])[0], "acceleration": acceleration,
                "mass": np.array([np.nan if node.body is None else node.body.mass for node in self.nodes])}


@dataclass(frozen=True)
class Method:
    """A method of an engine, and its settings from loose to tight. what: "step" (s) or "rtol"; order: by which the error falls
    with the step as theory has it, None where nothing is promised."""

    name: str
    what: str
    settings: tuple[float, ...]
    order: float | None = None


@dataclass(frozen=True)
class Statement:
    """A scene as an engine states it. script: Python source that calls `serve`; files: what it reads, by name; soft: why the
    program cannot converge to the scene, "" where it can; told: what it states otherwise."""

    script: str
    files: Mapping[str, bytes]
    methods: tuple[Method, ...]
    soft: str = ""
    told: tuple[str, ...] = ()

    @property
    def digest(self) -> str:
        """Hash of the script; its files follow from the scene, in some to the last digit only."""
        return sha256(self.script.encode()).hexdigest()


class Engine(ABC):
    """A program that runs scenes. name: by which it is known; package: the module of it that its environment has to have."""

    name: ClassVar[str]
    package: ClassVar[str]

    @abstractmethod
    def state(self, case: Case) -> Statement:
        """The scene in the words of the program; SceneError with all that it cannot state."""

    def motion(self, case: Case, values: Array) -> Array:
        """Motion (nt, nodes, COLUMNS) from the values that the script wrote, by default the same."""
        return values

    def start(self, case: Case, told: Mapping[str, Array]) -> Mapping[str, Array]:
        """Motion (nodes, COLUMNS), mass (nodes,) in kg and acceleration (nodes, 3) in m/s^2 of a start as the script tells it, by
        default the same; what the program does not say may be left out."""
        return told


def fixed_steps(case: Case, levels: int = 8, finer: float = 1.0) -> tuple[float, ...]:
    """Constant steps, each half of the last, with which all or every k-th of the times of a comparison are met. finer: factor by
    which the first one is shorter than `Case.step`."""
    span = float(case.times[-1] - case.times[0])
    counts = [n for n in (16 * 2**k for k in range(24)) if n * case.step >= span * finer]
    return tuple(span / n for n in counts[:levels])


# -- the script: functions of this file whose source is written into it


def serve(start: Any, solve: Any) -> None:
    """Answer the questions on standard input, one JSON object a line: {"do": "start"}, or {"do": "run", "method": ..., "setting":
    ..., "out": "motion.npy"}. start(): the start of the scene as the program has it; solve(method, setting): a function that
    makes the run and returns (motion, numbers) when it is called: only this is timed."""
    import json
    import os
    import sys
    import time

    import numpy as np

    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what the program prints goes to standard error
    for line in sys.stdin:
        asked = json.loads(line)
        try:
            if asked["do"] == "start":
                found = {name: np.asarray(value).tolist() for name, value in start().items()}
            else:
                seconds: list[float] = []
                while not seconds or (sum(seconds) < 0.1 and len(seconds) < 15 and seconds[0] < 0.1):
                    run = solve(asked["method"], asked["setting"])
                    begin = time.process_time()
                    values = run()
                    seconds.append(time.process_time() - begin)
                values, found = values() if callable(values) else values
                np.save(asked["out"], np.asarray(values, dtype=float))
                found |= {"seconds": seconds}
        except Exception as error:
            found = {"failure": f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"}
        answers.write(json.dumps(found) + "\n")
        answers.flush()


def script(text: str, *functions: Any) -> str:
    """The source of a script: a line on what it is, functions, then text."""
    parts = [inspect.getsource(function) for function in (*functions, serve)]
    head = '"""Written by mbdae. Questions come on standard input, one JSON object a line: see `serve`."""'
    return "\n\n".join([head, "from __future__ import annotations", "from typing import Any", *parts, text, ""])


# -- engines that a user names


@dataclass(frozen=True)
class Named:
    """An engine in the environment of a user. python: its interpreter; versions: of the package and of Python there."""

    engine: Engine
    python: str
    versions: dict[str, str] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Its name with its version."""
        return f"{self.engine.name} {self.versions.get(self.engine.package, '')}".strip()


def known() -> dict[str, Callable[[], type[Engine]]]:
    """Engines by name: those of this package, and those that others enter."""
    found: dict[str, Callable[[], Any]] = {name: partial(_own, name) for name in OWN}
    return found | {entry.name: entry.load for entry in entry_points(group=GROUP)}


def _own(name: str) -> Any:
    return getattr(import_module(f"mbdae.engines.{name}"), OWN[name])


def engines_of(given: Any) -> list[Named]:
    """The engines that a user names, {name or class: interpreter, None for the running one} or a list of names or classes,
    started once to know their versions; OptionError where one is not known or does not run."""
    if given is None:
        return []
    named = {given: None} if isinstance(given, str | type) else given
    remedy = 'give {"exudyn": "/path/to/python", ...}, or a list of names such as ["scipy"] for the running Python'
    if not isinstance(named, Mapping | list | tuple):
        raise OptionError(f"engines = {shown(given)}: {remedy}")
    pairs = named.items() if isinstance(named, Mapping) else [(one, None) for i, one in enumerate(named) if one not in named[:i]]
    return [_named(f"engines = {shown(given)}", one, python, remedy) for one, python in pairs]


def _named(head: str, one: Any, python: Any, remedy: str) -> Named:
    if isinstance(one, str):
        there = known()
        if one not in there:
            raise OptionError(f"{head}: there is no engine {shown(one)}: {meant(one, tuple(there))}there are {', '.join(there)}")
        one = there[one]()
    if not (isinstance(one, type) and issubclass(one, Engine) and not inspect.isabstract(one)):
        raise OptionError(f"{head}: {shown(one)} is neither the name of an engine nor a class derived from "
                          f"mbdae.engines.Engine; {remedy}")
    where = sys.executable if python is None else python
    if not isinstance(where, str | os.PathLike):
        raise OptionError(f"{head}: {shown(python)} is no interpreter for '{one.name}': {remedy}")
    code = (f"import importlib.metadata as m, json, platform, {one.package}\n"
            f"print(json.dumps({{'{one.package}': m.version('{one.package}'), 'Python': platform.python_version()}}))")
    try:
        done = subprocess.run([os.fspath(where), "-c", code], capture_output=True, text=True, timeout=STARTS, check=False,
                              env=environment(), stdin=subprocess.DEVNULL)
        said = (done.stderr.strip().splitlines() or ["it is no Python"])[-1]
        versions = json.loads((done.stdout.strip().splitlines() or ["null"])[-1]) if done.returncode == 0 else None
    except (OSError, ValueError, subprocess.SubprocessError) as error:
        versions, said = None, str(error)
    if versions is None:
        stated = shown(f"{one.name}={os.fspath(where)}")
        raise OptionError(f"{head}: {stated} does not run: {said}; name an interpreter that has the package '{one.package}'")
    return Named(one(), os.fspath(where), versions)


def environment() -> dict[str, str]:
    """Variables of a process of an engine: one thread, and no modules of this process."""
    threads = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMEXPR")}
    return {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")} | threads


# -- what a ladder comes to

FALLS = 0.5  #: the error of a ladder falls where it does so with more than this power of the setting, else it stays
ROUNDING = 1e-6  #: an error that stays below this is that of a program's arithmetic
RESOLVED = 3.0  #: errors below so many times the uncertainty of the reference say no order


@dataclass(frozen=True)
class Converged:
    """What a ladder of another program comes to. error: the smallest; order: by which the errors fall with the step, None where
    runs have tolerances or too few are made; floor: the error that stays, None where there is none; text: a sentence without its
    stop; why: it does not converge, "" where it does."""

    label: str
    error: float | None
    order: float | None
    floor: float | None
    text: str
    why: str = ""


def ladders(rows: Sequence[Any], uncertainty: float) -> tuple[Converged, ...]:
    """What the ladder of every method of other programs comes to. uncertainty: of the errors of their rows."""
    found = dict[str, list[Any]]()
    for row in rows:
        found.setdefault(row.label, []).append(row)
    return tuple(converged(label, ladder, uncertainty, min((row.error for row in rows if row.engine == ladder[0].engine and
                 row.label != label and row.error is not None), default=np.inf)) for label, ladder in found.items())


def converged(label: str, ladder: Sequence[Any], uncertainty: float, others: float = np.inf) -> Converged:
    """What the rows of a ladder, loose to tight, come to. others: the smallest error of other methods of the same program."""
    runs = [(row.rtol, row.error) for row in ladder if row.measured is not None and row.rtol]
    if not runs:
        reason = next((row.failure for row in ladder if row.failure), "no run was made")
        return Converged(label, None, None, None, f"{label}: {reason}")
    best, known = min(error for _, error in runs), [run for run in runs if run[1] > RESOLVED * uncertainty]
    slopes = [_slope(before, after) for before, after in pairwise(known)]
    stays = bool(slopes) and known[-1] == runs[-1] and slopes[-1] <= FALLS and best * 2 > known[-1][1]
    above = [run for run in known if not stays or run[1] > RESOLVED * best]  # where an error stays bends the order
    falling = [slope for slope in map(_slope, above, above[1:]) if slope > FALLS]
    order = float(np.median(falling[-4:])) if falling and ladder[0].order is not None else None
    with_order = f" with order {order:.1f} ({ladder[0].order:g} in theory)" if order is not None else ""
    if not stays:
        return Converged(label, best, order, None, f"{label} converges{with_order} down to {best:.1e}")
    soft = ladder[0].soft
    if not soft and (best < ROUNDING or RESOLVED * others < best):
        ends = "its rounding begins" if best < ROUNDING else f"it stays; other methods of the program reach {others:.1e}"
        return Converged(label, best, order, best, f"{label} converges{with_order} down to {best:.1e}, where {ends}")
    why = soft or "though it should: it moves another scene"
    return Converged(label, best, order, best, f"{label} does not converge, {why}; its error stays at {best:.1e}", why)


def _slope(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Power of the setting with which the error falls between two runs, (setting, error) each."""
    return float(np.log(a[1] / b[1]) / np.log(a[0] / b[0]))
