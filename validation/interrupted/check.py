"""Runs that were killed twenty times and went on, and work that Ctrl-C or a full disk disturbed, against what was not."""

from __future__ import annotations

import signal
import tempfile
from functools import partial
from pathlib import Path

import disturbed_work as work
import interrupted_scenes as scenes
from runner import Case, Claim, Found

claim = Claim("interrupted", "a run that is kept in a folder and killed at random times returns the bits of one that was not",
              0.0, "runs", "the same run, kept too, without a kill")
KILLS, FEW = 20, 3
KEPT = ("DOP853, breaks and friction", "Radau IIA, rows in force", "Radau IIA, impacts", "generalised-alpha, index 3", "IDA")
QUICK = ("Radau IIA, impacts", "IDA")  #: the states the others keep: tests/integrators/test_checkpoints.py


def different(name: str, kills: int, how: int) -> Found:
    """1 where the bits differ."""
    with tempfile.TemporaryDirectory() as folder:
        whole = scenes.run(name, Path(folder) / "whole")
        hits, bits = scenes.killed(name, Path(folder) / "killed", kills, how)
    return Found(float(bits != whole), note=f"{hits} of {kills} signals came before its end")


SIGNALS, DISKS, SOME = 30, 4, 3


def disturbed(name: str, count: int, full: bool) -> Found:
    """1 where what comes out is wrong; count: signals, or full disks."""
    with tempfile.TemporaryDirectory() as folder:
        how = work.filling if full else work.interrupting
        try:
            hits = work.disturbed(name, Path(folder), count, how)
        except work.WrongError as error:
            return Found(1.0, note=str(error))
    return Found(0.0, note=f"{hits} of {count} came in the middle")


def cases() -> list[Case]:
    every, kill = list(scenes.RUNS), signal.SIGKILL
    kinds = ((KILLS, kill, every), (FEW, signal.SIGTERM, every), (FEW, kill, KEPT))
    return [*(Case(f"{FEW} SIGKILL", name, partial(different, name, FEW, kill)) for name in QUICK),
            *(Case(f"{SOME} Ctrl-C", name, partial(disturbed, name, SOME, False)) for name in ("simulate", "sweep")),
            *(Case(f"{kills} {how.name}", "all", partial(different, kills=kills, how=how), slow=True, parts=names, each=True)
              for kills, how, names in kinds),
            *(Case(f"{count} {'full disks' if full else 'Ctrl-C'}", "all", partial(disturbed, count=count, full=full), slow=True,
                   parts=list(work.WORK), each=True) for count, full in ((SIGNALS, False), (DISKS, True)))]
