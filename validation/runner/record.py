"""The last result of every claim, whole and drawn, with its commit: a file of the repository."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mbdae.files import write_file
from runner.pages import Measured, made_with

NAME = "record.json"  #: in validation/


class Record:
    """By claim and kind ("whole" or "drawn"): whether it held, on which commit and day, with which seed, CPU s, versions."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.path = folder, folder / NAME
        self.results: dict[str, dict[str, dict[str, Any]]] = {}
        if self.path.is_file():
            self.results = json.loads(self.path.read_text(encoding="utf-8"))
        self.commit = _commit(folder)

    def keep(self, m: Measured, seed: int | None) -> None:
        """Write what was found of a claim: of all its parts where there is no seed."""
        kind, drawn = ("whole", {}) if seed is None else ("drawn", {"seed": seed})
        found = {"holds": m.holds, "commit": self.commit, "date": time.strftime("%Y-%m-%d"), **drawn, "cpu_s": round(m.cpu_s, 1),
                 "made_with": made_with()}
        self.results.setdefault(m.claim.name, {})[kind] = found
        write_file(self.path, json.dumps(self.results, indent=1, sort_keys=True) + "\n")

    def cost(self, name: str, whole: bool) -> float:
        """CPU s that a claim took when it was last measured so, or the other way; infinite where it never was."""
        kinds = ("whole", "drawn") if whole else ("drawn", "whole")
        found = self.results.get(name, {})
        return next((float(found[kind]["cpu_s"]) for kind in kinds if kind in found), float("inf"))

    def text(self, names: Sequence[str]) -> str:
        """The last results of some claims, and whether they are those of one tree."""
        columns = ("commit", "date", "CPU s")
        lines: list[tuple[str, ...]] = [("claim", "whole set", *columns, "suites drawn", *columns)]
        lines += [(name, *self._cells(name, "whole"), *self._cells(name, "drawn")) for name in names]
        widths = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))]
        table = ["  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines]
        return "\n".join([*table, self._verdict(names, "whole"), self._verdict(names, "drawn")])

    def _cells(self, name: str, kind: str) -> tuple[str, ...]:
        found = self.results.get(name, {}).get(kind)
        if found is None:
            return "-", "", "", ""
        holds = ("holds" if found["holds"] else "DOES NOT HOLD") + (f", seed {found['seed']}" if kind == "drawn" else "")
        return holds, found["commit"], found["date"], f"{found['cpu_s']:.0f}"

    def _verdict(self, names: Sequence[str], kind: str) -> str:
        what = "whole sets" if kind == "whole" else "claims, of suites a tenth"
        found = [self.results[name][kind] for name in names if kind in self.results.get(name, {})]
        held, commits = sum(one["holds"] for one in found), sorted({one["commit"] for one in found})
        trees = f"all on commit {commits[0]}" if len(commits) == 1 else f"on {len(commits)} commits"
        return f"{what}: {len(found)} of {len(names)} measured, {held} of them hold, {trees}"


def _commit(folder: Path) -> str:
    """The commit of the checkout, "with changes" where files differ from it but the record; "unknown" outside of git."""

    def git(*words: str) -> str:
        said = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, check=True)
        return said.stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no", "--", ":/", f":(exclude){NAME}")
        return git("rev-parse", "--short=12", "HEAD") + (" with changes" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
