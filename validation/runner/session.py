"""Claims measured one after the other, or side by side in processes of their own, the longest first."""

from __future__ import annotations

import json
import math
import os
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mbdae.errors import OptionError
from mbdae.run.checkpoint import bar
from mbdae.values import shown
from runner.claim import Claim, Row
from runner.draw import Draw
from runner.folder import check_name, load
from runner.pages import Measured, text
from runner.record import Record

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")  #: of BLAS, in processes side by side
PAUSE = 0.05  #: s between two looks at the processes


@dataclass(frozen=True)
class Asked:
    """What is measured: claims of a folder, of suites a draw by `seed`, or `only` some parts, or with `whole` all; side by side
    in `jobs` processes; for some `hours` with the state in `out`; `keep` the results in the record."""

    folder: Path
    names: Sequence[str]
    seed: int
    whole: bool = False
    only: tuple[str, ...] = ()
    jobs: int = 1
    hours: float | None = None
    out: Path | None = None
    keep: bool = False

    @property
    def draw(self) -> Draw | None:
        """What is drawn; None for everything."""
        return None if self.whole else Draw(self.seed, self.only)

    @property
    def text(self) -> str:
        """What is drawn, in words."""
        if self.whole:
            return "all parts of all suites"
        if self.only:
            return f"parts {', '.join(self.only)} alone"
        return f"a tenth of every suite is drawn with seed {self.seed}: --seed {self.seed} repeats it, --full measures all"

    def again(self, names: Sequence[str]) -> str:
        """The command that measures the same of some claims."""
        what = "--full" if self.whole else f"--parts {shlex.join(self.only)}" if self.only else f"--seed {self.seed}"
        return f"mbdae validate {' '.join(names)} {what}"


def measured(asked: Asked, tell: Callable[[str], None]) -> list[Measured]:
    """What is found of every claim, in the order asked; `tell` takes what is drawn, and the text of each when it is there.

    A claim alone is measured in this process. KeyboardInterrupt says what was done; OptionError names a claim or a part that
    there is not."""
    for name in asked.names:
        check_name(asked.folder, name)
    if asked.only and len(asked.names) != 1:
        raise OptionError(f"--parts {shown(' '.join(asked.only))}: parts are those of one claim: name that claim too")
    tell(asked.text)
    record, done = Record(asked.folder), dict[str, Measured]()
    order = sorted(asked.names, key=lambda name: record.cost(name, asked.whole), reverse=True)
    session = _here if len(order) == 1 or asked.hours else _side_by_side
    running: dict[str, Any] = {}
    with closing(bar()) as drawn:

        def show() -> None:
            drawn.show(len(done) / len(order), "validate", ", ".join(running))

        def found(name: str, m: Measured) -> None:
            done[name] = m
            if asked.keep:
                record.keep(m, None if asked.whole else asked.seed)
            drawn.close()
            tell(text(m) + ("" if m.holds else f"  again: {asked.again([name])}\n"))

        try:
            session(asked, order, running, show, found)
        except KeyboardInterrupt as stop:
            stop.args = (_stopped(asked, order, done, list(running)),)
            raise
    return [done[name] for name in asked.names]


def _stopped(asked: Asked, order: Sequence[str], done: dict[str, Measured], running: Sequence[str]) -> str:
    """What was done of an interrupted session, and how to do the rest."""
    wrong = [name for name, m in done.items() if not m.holds]
    verdict = f"; {', '.join(wrong)} did not hold" if wrong else " and held" if done else ""
    left = [name for name in order if name not in done]
    return (f"interrupted in claim {', '.join(running) or left[0]}: {len(done)} of {len(order)} were measured{verdict}; no pages "
            f"are written; the rest: {asked.again(left)}")


def _here(asked: Asked, order: Sequence[str], running: dict[str, Any], show: Callable[[], None],
          found: Callable[[str, Measured], None]) -> None:
    checks = [load(asked.folder, name, asked.hours, asked.out) for name in order]
    for name, check in zip(order, checks, strict=True):
        running[name] = check
        show()
        found(name, Measured(check.claim, check.run(asked.draw)))
        del running[name]


def _side_by_side(asked: Asked, order: Sequence[str], running: dict[str, Any], show: Callable[[], None],
                  found: Callable[[str, Measured], None]) -> None:
    waiting = list(order)
    try:
        while waiting or running:
            while waiting and len(running) < asked.jobs:
                name = waiting.pop(0)
                running[name] = _Process(asked, name)
                show()
            ended = [name for name, process in running.items() if process.ended]
            for name in ended:
                found(name, running.pop(name).found())
            if not ended:
                time.sleep(PAUSE)
    finally:
        for process in running.values():
            process.stop()


class _Process:
    """A claim in a process of its own, whose crash is a row that fails; it has a session of its own, so that Ctrl-C ends it by
    `stop`, with all processes that it started."""

    def __init__(self, asked: Asked, name: str) -> None:
        self.name, self._folder = name, tempfile.TemporaryDirectory()
        self._found, said = Path(self._folder.name) / "found", Path(self._folder.name) / "said"
        words = [str(asked.folder), name, str(self._found), "" if asked.whole else str(asked.seed), *asked.only]
        path = os.pathsep.join(os.path.abspath(entry) for entry in sys.path)
        with said.open("wb") as self._said:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", "import sys; from runner.session import alone; alone(*sys.argv[1:])", *words],
                stdin=subprocess.DEVNULL, stdout=self._said, stderr=subprocess.STDOUT, start_new_session=True,
                env={**os.environ, **dict.fromkeys(ONE_THREAD, "1"), "PYTHONPATH": path})

    @property
    def ended(self) -> bool:
        """Whether it has ended."""
        return self._process.poll() is not None

    def found(self) -> Measured:
        """What it found; where it found nothing, a row with what it said last."""
        with self._folder:
            if self._process.returncode == 0:
                return Measured.of(json.loads(self._found.read_text(encoding="utf-8")))
            last = " ".join(Path(self._said.name).read_text(encoding="utf-8", errors="replace").split()[-60:])
            code = self._process.returncode
            how = f"ended with exit code {code}" if code >= 0 else f"was ended by {signal.Signals(-code).name}"
            claim = Claim(self.name, "its process measured nothing", 0.0, "", "")
            return Measured(claim, [Row("all", "", math.nan, 0.0, "", False, 0.0, f"its process {how}: {last}")])

    def stop(self) -> None:
        """End it, and what it started."""
        with suppress(OSError, AttributeError):  # a group that has ended; Windows has none
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.kill()
        self._process.wait()
        self._folder.cleanup()


def alone(folder: str, name: str, path: str, seed: str, *only: str) -> None:
    """Measure one claim, all of it where `seed` is empty, and write what was found to a file: the process of `_Process`."""
    check = load(Path(folder), name)
    found = Measured(check.claim, check.run(Draw(int(seed), only) if seed else None))
    Path(path).write_text(json.dumps(found.to_dict()), encoding="utf-8")
