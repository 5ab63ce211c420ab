"""Rows of other programs: each engine states the scene, is checked at its start, and runs its ladders; what they converge to."""

from __future__ import annotations

import json
import math
import queue
import subprocess
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mbdae.compare.measures import BodiesMotion, quartiles
from mbdae.compare.problem import Problem
from mbdae.compare.rows import Known
from mbdae.compare.table import Row
from mbdae.engines import CANNOT, COLUMNS, INTERVALS, OTHER, RESOLVED, STARTS, Case, Method, Named, Statement, environment
from mbdae.errors import MbdaeError
from mbdae.integrators.solution import Solution, Stats
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared

GAVE_UP = "gave up after"  #: how the failure of a run begins that did not end
LONGEST = 2.0  #: CPU time of a run (s) after which a ladder of an engine ends
COUNTS = ("steps", "residuals", "jacobians", "newton_iterations")
#: how far the start of an engine may be from that of the scene, over the largest position, velocity, mass ... of the scene
SAME_START = 1e-7


class Session:
    """A scene that an engine runs: the process of its script in a temporary folder, which ends with this object's context."""

    def __init__(self, named: Named, case: Case) -> None:
        self.named, self.case = named, case
        self.statement = named.engine.state(case)
        self._process: subprocess.Popen[str] | None = None
        self._lines: queue.Queue[str | None] = queue.Queue()
        self._folder = tempfile.TemporaryDirectory(prefix="mbdae-engine-")
        write(self.statement, Path(self._folder.name))

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self._folder.cleanup()

    def stop(self) -> None:
        """End the process, whatever it does."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout, self._process.stderr):
                with suppress(OSError, AttributeError):
                    pipe.close()  # type: ignore[union-attr]
            self._process = None

    def _ask(self, question: dict[str, Any], longest: float | None) -> dict[str, Any]:
        """The answer of the script; a failure in words where there is none within so many seconds, or the process has ended."""
        if self._process is None:
            said = (Path(self._folder.name) / "messages").open("w", encoding="utf-8")
            with said:
                self._process = subprocess.Popen([self.named.python, "script.py"], cwd=self._folder.name, env=environment(),
                                                 stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said, text=True)
            self._lines = queue.Queue()
            threading.Thread(target=_read, args=(self._process.stdout, self._lines), daemon=True).start()
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(question) + "\n")
            self._process.stdin.flush()
            line = self._lines.get(timeout=longest)
        except queue.Empty:
            self.stop()
            return {"failure": f"{GAVE_UP} {longest:g} s of wall time"}
        except OSError:
            line = None
        if line is None:
            code = self._process.wait()
            self.stop()
            text = (Path(self._folder.name) / "messages").read_text(encoding="utf-8", errors="replace").strip()
            return {"failure": f"its process ended with code {code}: {(text.splitlines() or ['no message'])[-1][:300]}"}
        return dict(json.loads(line))

    def wrong(self) -> str:
        """Why the engine does not run the scene: its script fails, or how the start that it has differs from that of the scene;
        "" where it is the same."""
        found = self._ask({"do": "start"}, STARTS)
        if "failure" in found:
            return str(found["failure"])
        told = {name: np.array(value, dtype=float) for name, value in found.items()}
        apart = _differences(self.case, self.named.engine.start(self.case, told))
        return f"{OTHER}: {'; '.join(apart)}" if apart else ""

    def run(self, method: str, setting: float, longest: float | None) -> tuple[Array | None, dict[str, Any]]:
        """Motion (nt, nodes, COLUMNS) of a run, None where it failed, and what its script says of it."""
        out = Path(self._folder.name) / "motion.npy"
        begins = STARTS if self._process is None else 0.0
        found = self._ask({"do": "run", "method": method, "setting": setting, "out": str(out)},
                          None if longest is None else longest + begins)
        if "failure" in found:
            return None, found
        rows, nodes = self.named.engine.motion(self.case, np.load(out)), len(self.case.nodes)
        if rows.ndim != 3 or rows.shape[1:] != (nodes, COLUMNS) or len(rows) < 2 or INTERVALS % (len(rows) - 1):
            return None, {"failure": f"its motion is an array {rows.shape}, not (1 + {INTERVALS} / k, {nodes}, {COLUMNS})"}
        return rows, found


def write(statement: Statement, folder: Path) -> None:
    """Write the script of a statement, and its files, into a folder."""
    for name, content in {"script.py": statement.script.encode(), **statement.files}.items():
        (folder / name).write_bytes(content)


def _read(pipe: Any, to: queue.Queue[str | None]) -> None:
    with suppress(ValueError, OSError):  # the pipe was closed
        for line in pipe:
            to.put(line)
    to.put(None)


def _differences(case: Case, found: Mapping[str, Array]) -> Sequence[str]:
    """Sentences on what of an engine's start is not that of the scene."""
    own, said = case.start(), list[str]()
    parts = {"position": (slice(0, 3), "m"), "velocity": (slice(7, 10), "m/s"), "angular velocity": (slice(10, 13), "rad/s")}
    pairs = {name: (own["motion"][:, part], found["motion"][:, part], unit) for name, (part, unit) in parts.items()
             if "motion" in found}
    pairs |= {name: (own[name], found[name], unit) for name, unit in (("mass", "kg"), ("acceleration", "m/s^2")) if name in found}
    if "motion" in found:
        a, b = own["motion"][:, 3:7], found["motion"][:, 3:7]
        pairs["rotation"] = (a, np.where(np.sum(a * b, axis=1, keepdims=True) < 0, -b, b), "")
    length, time = case.prepared.length, case.prepared.time
    least = {"position": length, "velocity": length / time, "angular velocity": 1 / time, "acceleration": length / time**2}
    for name, (a, b, unit) in pairs.items():
        size = max(least.get(name, 0.0), float(np.nanmax(np.abs(a), initial=0.0)))
        apart = np.abs(b - a).reshape(len(a), -1).max(axis=1)
        apart[np.isnan(apart)] = 0.0
        if len(apart) and apart.max() > SAME_START * (size or 1.0):
            i = int(np.argmax(apart))
            said.append(f"{name} of '{case.nodes[i].name}' at the start differs by {apart[i]:.3g}{' ' + unit if unit else ''}")
    return said


# -- rows


@dataclass(frozen=True)
class Step:
    """One run of an engine: a method with a setting, None where the engine cannot state the scene; problem: why not."""

    named: Named
    method: Method | None = None
    setting: float | None = None
    problem: str = ""

    @property
    def label(self) -> str:
        """Of its row."""
        return self.named.label + (f" {self.method.name}" if self.method else "")


class Engines:
    """The engines of a comparison with the scene as each states it."""

    def __init__(self, problem: Problem, named: Sequence[Named]) -> None:
        self.problem, self.named, self.stack = problem, named, ExitStack()
        self.sessions: dict[str, Session] = {}
        self.refused: dict[str, str] = {}
        self.checked: dict[str, str] = {}
        prepared = problem.yardstick.prepared
        for one in named:
            if prepared is None:
                self.refused[one.label] = f"{CANNOT}: a System has equations alone, no bodies"
                continue
            try:
                self.sessions[one.label] = self.stack.enter_context(Session(one, Case(problem.scene, prepared, problem.times)))
            except MbdaeError as error:
                self.refused[one.label] = f"{CANNOT}: " + "; ".join(getattr(error, "problems", None) or [str(error)])

    def __enter__(self) -> Engines:
        return self

    def __exit__(self, *_: object) -> None:
        self.stack.close()

    @property
    def identity(self) -> list[dict[str, Any]]:
        """What their rows depend on, as plain data."""
        return [{"engine": one.label, "versions": one.versions, "says": self.sessions[one.label].statement.digest if
                 one.label in self.sessions else self.refused[one.label]} for one in self.named]

    @property
    def queue(self) -> list[Step]:
        """Every run, a ladder after the other, loose to tight."""
        return [step for one in self.named for step in self._of(one)]

    def _of(self, one: Named) -> Iterator[Step]:
        session = self.sessions.get(one.label)
        if session is None:
            yield Step(one, problem=self.refused[one.label])
            return
        for method in session.statement.methods:
            yield from (Step(one, method, setting) for setting in method.settings)

    def row(self, step: Step, reference: Known, before: Sequence[Row]) -> Row:
        """The row of a run. before: rows of the same ladder; one behind a long run, or one as exact as the reference, is not
        made."""
        facts: dict[str, Any] = {"label": step.label, "solver": step.method.name if step.method else "", "form": "",
                                 "model": None, "accuracy": None, "engine": step.named.label}
        if step.method is None:
            return Row(**facts, failure=step.problem)
        session = self.sessions[step.named.label]
        facts |= {"setting": f"{step.method.what} {step.setting:.1e}" + " s" * (step.method.what == "step"), "soft":
                  session.statement.soft, "order": step.method.order, "rtol": step.setting}
        if step.named.label not in self.checked:
            self.checked[step.named.label] = session.wrong()
        if self.checked[step.named.label]:
            return Row(**facts, failure=self.checked[step.named.label])
        if why := _enough(before, reference):
            return Row(**facts, skipped=why)
        assert step.setting is not None
        rows, found = session.run(step.method.name, step.setting, self.problem.max_wall)
        if rows is None:
            return Row(**facts, failure=found["failure"])
        middle, spread = quartiles(found["seconds"])
        self.problem.spend(sum(found["seconds"]))
        self.problem.elsewhere += sum(found["seconds"])
        facts |= {name: int(found[name]) for name in COUNTS if name in found}
        facts |= {"cpu_s": middle, "cpu_first_s": found["seconds"][0], "cpu_spread_s": spread + self.problem.tick
                  if len(found["seconds"]) > 1 else None}
        if not np.isfinite(rows).all():
            return Row(**facts, failure="the motion is not finite everywhere")
        errors = self._errors(rows, session.case, reference)
        return Row(**facts, error=errors.get(self.problem.measures[0].name), errors=errors)

    def _errors(self, rows: Array, case: Case, reference: Known) -> dict[str, float]:
        """Largest differences from the reference by measure, at the times that the engine gives; of those measures that follow
        from the motion."""
        every, prepared = INTERVALS // (len(rows) - 1), case.prepared
        q, u = case.motion(rows)
        run = given(prepared, case.times[::every], q, u)
        coordinates = any(node.body is None for node in prepared.model.nodes) or bool(prepared.mechanics.numbering.states)
        found = dict[str, float]()
        for measure, known in zip(self.problem.measures, reference[1], strict=True):
            if known is None or not measure.of_motion(self.problem) or (coordinates and not isinstance(measure, BodiesMotion)):
                continue
            step = math.lcm(measure.every, every)
            own = measure.read(self.problem, self.problem.yardstick, run, case.times[::step])
            found[measure.name] = measure.apart(self.problem, own, known[:: step // measure.every])
        return found


def _enough(before: Sequence[Row], reference: Known) -> str:
    """Why a ladder ends behind these rows; "" where it goes on."""
    last = before[-1] if before else None
    if last is None:
        return ""
    if last.failure:
        return f"not run: a run before {last.failure}" if last.failure.startswith(GAVE_UP) else ""
    if last.skipped:
        return last.skipped
    if (last.cpu_first_s or 0.0) > LONGEST:
        return f"not run: a run before took more than {LONGEST:g} s"
    exact = RESOLVED * (reference[0].difference or 0.0)
    return "not run: a run before is as exact as the reference" if last.error is not None and last.error <= exact else ""


def given(prepared: Prepared, t: Array, q: Array, u: Array) -> Solution:
    """A run of a scene with kinematic joints whose positions (nt, nq) and velocities (nt, nu) are given at times t (nt,), and
    which can be read at these times alone."""
    reduced = np.hstack(prepared.all_bodies.reduced(q, u))
    y = np.hstack([reduced, np.zeros((len(t), prepared.mechanics.numbering.n - reduced.shape[1]))])
    still = np.zeros_like(y)
    return Solution(t, y, still, None, Stats(), Foreign("engine"), (), True, AtTimes(t, y, still))


@dataclass(frozen=True, eq=False)
class AtTimes:
    """Interpolant of values that are known at some times alone."""

    t: Array
    y: Array
    yp: Array

    def value(self, t: Array) -> Array:
        """y (k, n) at times t (k,), which are among those that are known."""
        return np.asarray(self.y[np.argmin(np.abs(self.t - np.asarray(t)[:, None]), axis=1)])

    def derivative(self, t: Array) -> Array:
        """dy/dt (k, n)."""
        return np.zeros((len(t), self.y.shape[1]))


@dataclass(frozen=True)
class Foreign:
    """Stands in for the solver of a run of another program."""

    label: str
    fixed: ClassVar[bool] = True

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> AtTimes:
        """Interpolant over the accepted steps."""
        return AtTimes(t, y, yp)
