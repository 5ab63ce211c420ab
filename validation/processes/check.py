"""Forked processes, threads and clusters: equal bits, a refusal by name, and nothing that hangs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from interrupted_scenes import chain
from runner import Case, Claim, Found

import mbdae as mb

claim = Claim("processes", "forked processes, threads and clusters return the bits of one process, or are refused by name", 0.0,
              "wrong", "the same runs in one process and one thread")
LONG = 5.0  #: end of the runs of two threads (s): long enough that both run at once
PATIENCE = 60.0  #: time (s) after which a process counts as one that hangs
HERE = Path(__file__).parent
ELIMINATED = mb.Index1(multipliers="eliminated")
METHODS: dict[str, tuple[Any, Any]] = {
    "IDA": (mb.IDA(rtol=1e-8), mb.Index1()), "Radau IIA": (mb.RadauIIA(3, rtol=1e-8), mb.GGL()),
    "CVODE": (mb.CVODE(rtol=1e-8), ELIMINATED), "DOP853": (mb.DOP853(rtol=1e-9), ELIMINATED),
    "HHT": (mb.HHT(step=2e-3), mb.GGL(algebraic=True)),
}


def end_of(scene: mb.Scene) -> bytes:
    """The bits of a short run."""
    return scene.simulate(0.2, 1e-5).solution.y.tobytes()


def forked(forks: Sequence[int]) -> Found:
    """How many of the processes forked under load are wrong or hang."""
    stop, expected = threading.Event(), end_of(chain())

    def work(new: bool) -> None:
        scene = chain()
        while not stop.is_set():
            end_of(chain() if new else scene)

    threads = [threading.Thread(target=work, args=(new,)) for new in (False, True)]
    for thread in threads:
        thread.start()
    try:
        wrong = sum(_wrong_in_fork(expected) for _ in forks)
    finally:
        stop.set()
        for thread in threads:
            thread.join()
    return Found(float(wrong), note=f"of {len(forks)} forked processes")


def _wrong_in_fork(expected: bytes) -> bool:
    child = os.fork()
    if child == 0:
        try:
            os._exit(0 if end_of(chain()) == expected else 3)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(1)
    end = time.perf_counter() + PATIENCE
    while (ended := os.waitpid(child, os.WNOHANG))[0] == 0:
        if time.perf_counter() > end:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return True
        time.sleep(0.01)
    return ended[1] != 0


def cold(forks: Sequence[int]) -> Found:
    """How many processes are wrong or hang that are forked while another thread imports the package and derives, each fork a
    twentieth of a second later than the one before."""
    wrong = list[int]()
    for i in forks:
        said = subprocess.run([sys.executable, str(HERE / "cold_fork.py"), f"{0.05 * i:g}"], capture_output=True, text=True,
                              timeout=4 * PATIENCE, check=False, env=os.environ | {"MBDAE_CACHE": "off"})
        wrong += [i] if said.stdout.split() != ["0"] else []
    return Found(float(len(wrong)), note=f"of {len(forks)} forked processes: {', '.join(map(str, wrong)) or 'none'}")


def pairs(name: str, trials: Sequence[int]) -> Found:
    """How many pairs of threads that run one System get another result without a word."""
    solver, form = METHODS[name]
    system = chain().system(form)
    expected, before = solver.solve(system, LONG).y, sys.getswitchinterval()
    wrong, refused = 0, 0
    sys.setswitchinterval(1e-5)
    try:
        for _ in trials:
            found: list[Any] = []
            together = threading.Barrier(2)

            def run(found: list[Any] = found, together: threading.Barrier = together) -> None:
                together.wait()
                try:
                    found.append(np.array_equal(solver.solve(system, LONG).y, expected))
                except mb.OptionError as error:
                    found.append("is run by another thread" in str(error) and "refused")
                except Exception as error:
                    found.append(error)

            threads = [threading.Thread(target=run) for _ in range(2)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            wrong += any(one not in (True, "refused") for one in found)
            refused += "refused" in found
    finally:
        sys.setswitchinterval(before)
    return Found(float(wrong), note=f"of {len(trials)} pairs; in {refused} one thread was refused")


def notebook() -> Found:
    """How many cells of the notebook say that what came back is wrong."""
    said = subprocess.run([sys.executable, str(HERE / "notebook.py")], capture_output=True, text=True, timeout=600, check=False)
    lines = [line for line in said.stdout.splitlines() if line.startswith(("right:", "wrong:", "refused:"))]
    wrong = [line for line in lines if line.startswith("wrong:")]
    if said.returncode or not lines:
        raise RuntimeError(said.stderr[-2000:])
    return Found(float(len(wrong)), note="; ".join(wrong or lines))


def cases() -> list[Case]:
    return [Case("forks under load", "simulate", forked, slow=True, parts=range(50)),
            Case("3 forks under load", "simulate", lambda: forked(range(3))),
            Case("forks during imports", "simulate", cold, slow=True, parts=range(10)),
            *(Case("pairs of threads", name, partial(pairs, name), slow=True, parts=range(10)) for name in METHODS),
            Case("2 pairs of threads", "Radau IIA", lambda: pairs("Radau IIA", range(2))),
            Case("a notebook", "clusters", notebook, slow=True)]
