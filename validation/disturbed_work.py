"""Work that writes while it goes on, disturbed at random: by Ctrl-C at any instant, and by a disk that is full after some bytes.

A disturbed call is made again until it comes to its end. What comes out then has to be what comes out of an undisturbed one, and
what a disturbed one hands out has to be the beginning of it."""

from __future__ import annotations

import contextlib
import hashlib
import resource
import signal
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import interrupted_scenes as scenes
import numpy as np

import mbdae as mb
from mbdae.integrators import kept_rows

SEED = 5
POINTS = [{"mass": 0.5 + 0.1 * i} for i in range(12)]
LITTLE = 2000  #: bytes of an array that stay in memory: the rest goes to the disk
MOST = 40_000  #: largest number of bytes after which a disk is full, where the work leaves no files


class WrongError(AssertionError):
    """What came out of a disturbed call is wrong."""


def job(mass: float) -> dict[str, Any]:
    """The end of a rod that falls."""
    s = mb.Scene("rod", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (1, 0), mass=mass), at=(0, 0), spring=3.0)
    return {"angle": float(s.simulate(0.2, 1e-4)["A"].angle[-1])}


def one_run(folder: Path) -> Any:
    """A run whose steps go to the disk."""
    return scenes.chain().simulate(6.0, solver=mb.RadauIIA(3, rtol=1e-7))


def saved(folder: Path) -> Any:
    """A run that is saved, several times over."""
    r = scenes.chain().simulate(1.0, solver=mb.RadauIIA(3, rtol=1e-7))
    for _ in range(8):
        r.save(folder / "run.npz")
    return r


def kept_run(folder: Path) -> Any:
    """A run with checkpoints."""
    return scenes.chain().simulate(6.0, solver=mb.RadauIIA(3, rtol=1e-7), checkpoint=folder / "kept", every=20)


def swept(folder: Path) -> Any:
    """A sweep of a function."""
    with ThreadPoolExecutor(1) as threads:
        return mb.sweep(job, POINTS, threads, resume=folder / "sweep.jsonl")


def swept_scene(folder: Path) -> Any:
    """A sweep of a scene, in parts of eight points."""
    grid = {"a.mass": list(np.linspace(0.5, 1.5, 24))}
    with ThreadPoolExecutor(1) as threads:
        return mb.sweep(scenes.chain(), grid, threads, resume=folder / "parts", t_end=0.2, accuracy=1e-3)


def compared(folder: Path) -> Any:
    """A comparison."""
    runs = [mb.Run(mb.RadauIIA(3), mb.GGL()), mb.Run(mb.RadauIIA(2), mb.GGL()), mb.Run(mb.DOP853(), mb.Index1())]
    return mb.compare(scenes.chain(), 0.3, runs, accuracies=(1e-2, 1e-3, 1e-4), resume=folder / "compared.json")


def mapped(folder: Path) -> Any:
    """A map of extremes."""
    return mb.extremes(scenes.chain(), 0.2, vary={"a.mass": [0.1, 1.0, 10.0]}, runs=[mb.Run(mb.RadauIIA(3), mb.GGL())],
                       accuracy=1e-3, resume=folder / "map.json")


#: name -> work in a folder
WORK: dict[str, Callable[[Path], Any]] = {
    "simulate": one_run, "save": saved, "checkpoint": kept_run, "sweep": swept, "sweep of a scene": swept_scene,
    "compare": compared, "extremes": mapped,
}


def told(found: Any) -> str:
    """A digest of what came out, but times of computing."""
    if hasattr(found, "solution"):
        run = found.solution
        values = [run.t, run.y, run.yp, run((run.t[:-1] + run.t[1:]) / 2)]
    elif hasattr(found, "blocks"):
        values = [[(c.label, c.verdict, c.error, c.steps) for c in found.cells]]
    elif hasattr(found, "estimate"):
        values = [found.array(name) for name in found.names] + [found.estimate, found.failures]
    elif hasattr(found, "reference"):
        # pivots that an earlier run of the same comparison found are used again: they change the last digits
        values = [[(row.label, row.accuracy, f"{row.error:.6e}", row.steps, row.failure) for row in found.runs]]
    else:
        values = [[(row.point, row.values, row.error) for row in found.rows]]
    digest = hashlib.sha256()
    for value in values:
        digest.update(np.ascontiguousarray(value).tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
    return digest.hexdigest()


def check_part(error: BaseException, whole: Any) -> None:
    """WrongError where what a disturbed call hands out is not the beginning of the whole."""
    part = getattr(error, "solution", None)
    if part is None or not hasattr(part, "prepared"):
        return
    t = part.solution.t
    if not (np.array_equal(t, whole.solution.t[: len(t)]) and np.array_equal(part.solution.y, whole.solution.y[: len(t)])):
        raise WrongError(f"the part until t = {t[-1]:g} s is not that of the whole run")
    if not np.isfinite(part["A"].angle).all():
        raise WrongError("the part cannot be read")


def disturbed(name: str, folder: Path, count: int, how: Callable[[np.random.Generator, float, int], Any]) -> int:
    """Do the work again and again, and disturb it `count` times by the context that `how` makes of random numbers, the time (s)
    that the work takes and the bytes of its largest file; the number of times that it was disturbed before its end."""
    before, kept_rows.IN_MEMORY = kept_rows.IN_MEMORY, LITTLE
    random, hits, places = np.random.default_rng(SEED + len(name)), 0, 0
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mb.AccuracyWarning)
            (folder / "whole").mkdir()
            WORK[name](folder / "whole")  # imported, derived
            begin = time.perf_counter()
            (folder / "again").mkdir()
            whole = WORK[name](folder / "again")
            length = time.perf_counter() - begin
            size = max((path.stat().st_size for path in (folder / "again").rglob("*") if path.is_file()), default=MOST)
            place = folder / "0"
            place.mkdir()
            for _ in range(count):
                try:
                    with how(random, length, size):
                        found = WORK[name](place)
                except (KeyboardInterrupt, mb.MbdaeError) as error:
                    check_part(error, whole)
                    hits += 1
                    continue
                if told(found) != told(whole):
                    raise WrongError("what came out after it went on is not what comes out at once")
                places += 1
                place = folder / str(places)
                place.mkdir()
            if told(WORK[name](place)) != told(whole):
                raise WrongError("what came out in the end is not what comes out at once")
    finally:
        kept_rows.IN_MEMORY = before
    return hits


@contextlib.contextmanager
def interrupting(random: np.random.Generator, length: float, size: int) -> Iterator[None]:
    """Ctrl-C after a random time, up to the length of the work (s)."""

    def stop(number: int, frame: Any) -> None:
        signal.setitimer(signal.ITIMER_REAL, 0)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, max(random.uniform(0, length), 1e-4))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@contextlib.contextmanager
def filling(random: np.random.Generator, length: float, size: int) -> Iterator[None]:
    """A disk with room for files of a random size: the system refuses to write more (EFBIG)."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(random.integers(0, size + size // 4)), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
