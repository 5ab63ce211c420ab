"""Mistakes that were made or feared, put back one at a time: the tests that are named for each see it."""

from __future__ import annotations

import json
import math
import tempfile
from pathlib import Path

from oracles.check import ABSENT, has_pinocchio
from runner import Case, Claim, Found

from mutation.judge import Copy
from mutation.mutators import Mutant

claim = Claim("mutation", "every mistake of stated.json (terms of the equations of motion, failures of earlier versions) is seen "
              "by the tests that it names", 0.0, "mistakes", "the mistakes themselves, put into a copy of the package")
ROOT = Path(__file__).parents[2]
STATED = {one["name"]: one for one in json.loads(Path(__file__).with_name("stated.json").read_text(encoding="utf-8"))}


def survivors(names: list[str]) -> Found:
    """How many mistakes no test sees; nan where the reference that a test compares with is not installed."""
    if not has_pinocchio() and any(STATED[name]["suite"] == "oracles" for name in names):
        return Found(math.nan, note=ABSENT)
    unseen = []
    with tempfile.TemporaryDirectory(prefix="mbdae-mutants-") as folder:
        copy = Copy(ROOT, Path(folder))
        for one in (STATED[name] for name in names):
            file, tests = ROOT / one["file"], [f"tests/{name}" for name in one["tests"]]
            at = file.read_text(encoding="utf-8").index(one["old"])
            verdict = copy.judged(one["suite"], file, Mutant(at, at + len(one["old"]), one["old"], one["new"]), tests)
            unseen += [] if verdict.killed else [one["name"]]
    return Found(len(unseen), note=f"not seen: {', '.join(unseen) or 'none'} of {', '.join(names)}")


def cases() -> list[Case]:
    return [Case("mistakes", "pytest", survivors, slow=True, parts=list(STATED))]
