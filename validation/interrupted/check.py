"""Runs that were killed twenty times and went on, against runs that were not."""

from __future__ import annotations

import signal
import tempfile
from functools import partial
from pathlib import Path

import interrupted_scenes as scenes
from runner import Case, Claim, Found, Row, measure

claim = Claim("interrupted", "a run that is kept in a folder and killed at random times returns the bits of one that was not",
              0.0, "runs", "the same run, kept too, without a kill")  # fmt: skip
KILLS, FEW = 20, 3
KEPT = ("DOP853, breaks and friction", "Radau IIA, rows in force", "Radau IIA, impacts", "generalised-alpha, index 3", "IDA")
QUICK = ("Radau IIA, impacts", "IDA")  #: the states the others keep: tests/integrators/test_checkpoints.py


def different(name: str, kills: int, how: int) -> Found:
    """1 where the bits differ."""
    with tempfile.TemporaryDirectory() as folder:
        whole = scenes.run(name, Path(folder) / "whole")
        hits, bits = scenes.killed(name, Path(folder) / "killed", kills, how)
    return Found(float(bits != whole), note=f"{hits} of {kills} signals came before its end")


def cases() -> list[Case]:
    every, kill = scenes.RUNS, signal.SIGKILL
    kinds = ((KILLS, kill, every), (FEW, signal.SIGTERM, every), (FEW, kill, KEPT))
    return [Case(f"{kills} {how.name}", name, partial(different, name, kills, how),
                 slow=not (kills == FEW and how == kill and name in QUICK))
            for kills, how, names in kinds for name in names]  # fmt: skip


def run() -> list[Row]:
    return measure(claim, cases())
