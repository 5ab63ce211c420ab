"""Tests that a plain `pytest` leaves out because they take long."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from runner import Case, Claim, Found

TESTS = Path(__file__).parents[2] / "tests"
claim = Claim("slow_tests", "all tests with the marker `slow` pass", 0.0, "tests", "what each test compares with")
LISTED = {line.split("::")[0] for line in (TESTS / "slow.txt").read_text(encoding="utf-8").splitlines() if "::" in line}
MARKED = {path.relative_to(TESTS).as_posix() for path in TESTS.glob("**/test_*.py")
          if "mark.slow" in path.read_text(encoding="utf-8")}
FILES = sorted((LISTED | MARKED) - {"test_validate.py"})  # its slow tests are the cases of all claims, this one among them


def failed(files: Sequence[str]) -> Found:
    """Number of tests of some files that fail, with their names."""
    command = [sys.executable, "-m", "pytest", "-m", "slow", "-n", "0", "--tb=no", "-rfE", "-p", "no:cacheprovider"]
    said = subprocess.run([*command, *(f"tests/{name}" for name in files)], cwd=TESTS.parent, stdin=subprocess.DEVNULL,
                          capture_output=True, text=True, check=False, env=os.environ | {"MPLBACKEND": "Agg"})
    names = [line.split(" - ")[0] for line in said.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    if said.returncode not in (0, 1):
        names.append(f"pytest ended with {said.returncode}: {(said.stderr or said.stdout)[-300:]}")
    return Found(len(names), note=f"{', '.join(names) or 'none fails'}; {(said.stdout.splitlines() or ['?'])[-1]}")


def cases() -> list[Case]:
    return [Case("tests", "pytest", failed, slow=True, parts=FILES)]
