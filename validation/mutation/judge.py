"""A copy of the checkout in which mutants are judged by the tests of their area, one after the other."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from mutation.areas import Area
from mutation.mutators import Mutant, is_valid, mutants

COPIED = ("mbdae", "tests", "validation", "examples", "docs", "benchmarks", ".ci", "pyproject.toml", "README.md",
          "CONTRIBUTING.md", "CHANGELOG.md", "hatch_build.py", "LICENSE")  # fmt: skip
MOST_CPU, MOST_WALL = 600, 3600.0  #: s, of all tests of a mutant: more is a test that does not end


@dataclass(frozen=True)
class Verdict:
    """killed: by which test, or why; empty of a survivor."""

    area: str
    file: str
    line: int
    old: str
    new: str
    killed: str
    cpu_s: float

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def drawn(areas: list[Area], root: Path, count: int, seed: int) -> list[tuple[Area, Path, Mutant]]:
    """Mutants of all areas by their shares, the same for the same seed and sources; neighbours in the list are of different
    areas."""
    found, whole = [], sum(a.share for a in areas)
    for number, one in enumerate(areas):
        rng = np.random.default_rng([seed, number])
        files = [(path, m) for path in one.files(root) for m in mutants(path.read_text(encoding="utf-8"), path.name)]
        wanted = max(1, round(count * one.share / whole))
        order = (files[c] for c in rng.permutation(len(files)))
        chosen = islice((f for f in order if is_valid(f[1].applied(f[0].read_text(encoding="utf-8")), f[0].name)), wanted)
        found += [((i + 0.5) / wanted, one, *f) for i, f in enumerate(chosen)]
    return [one[1:] for one in sorted(found, key=lambda one: one[0])]


class Copy:
    """The checkout, copied to a folder in which one file at a time is changed."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.root, self.folder, self.passed = root, folder, set[str]()
        for name in COPIED:
            source, copied = root / name, folder / name
            if source.is_dir():
                shutil.copytree(source, copied, ignore=shutil.ignore_patterns("__pycache__", "*.png"))
            elif source.exists():
                shutil.copy(source, copied)

    def judged(self, area: Area, file: Path, mutant: Mutant) -> Verdict:
        """What the tests of the area say of a mutant. A test that kills passes without it, which is tried once of every test."""
        name, text = file.relative_to(self.root), file.read_text(encoding="utf-8")
        self._write(name, mutant.applied(text))
        try:
            said, spent = self.tested(area.test_files(self.folder))
        finally:
            self._write(name, text)
            if name.suffix != ".py":  # the library was compiled from the mutant
                shutil.copy(next(self.root.glob("mbdae/native/mbdae.core.*")), self.folder / "mbdae" / "native")
        test = said.partition(" ")[2] if said.startswith(("FAILED", "ERROR")) else ""
        if test and test not in self.passed:
            again, _ = self.tested([test])
            if again:
                raise RuntimeError(f"{test} fails without a mutant too: {again}")
            self.passed.add(test)
        return Verdict(area.name, str(name), mutant.line(text), mutant.old, mutant.new, said, spent)

    def _write(self, name: Path, text: str) -> None:
        """A file, without what Python keeps of the one before: two of one second and one size are the same to it."""
        place = self.folder / name
        place.write_text(text, encoding="utf-8")
        for kept in (place.parent / "__pycache__").glob(f"{place.stem}.*"):
            kept.unlink()

    def tested(self, tests: list[str]) -> tuple[str, float]:
        """The first of some tests that fails, or empty; CPU seconds."""
        env = os.environ | {"PYTHONPATH": str(self.folder), "MBDAE_CACHE": "off", "MPLBACKEND": "Agg"}
        env |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "pytest", "-x", "--tb=no", "-rfE", "-p", "no:cacheprovider", *tests]
        before = _children()
        with (self.folder / "said.txt").open("w+", encoding="utf-8") as out:
            process = subprocess.Popen(command, cwd=self.folder, env=env, stdin=subprocess.DEVNULL, stdout=out,
                                       stderr=subprocess.STDOUT, preexec_fn=_bounded, start_new_session=True)  # fmt: skip
            code = _waited(process)
            out.seek(0)
            text = out.read()
        if code in (4, 5):
            raise RuntimeError(f"pytest was not given what it needs: {text[-1000:]}")
        spent = _children() - before
        failed = [line for line in text.splitlines() if line.startswith(("FAILED", "ERROR"))]
        return ("" if code == 0 else failed[0].split(" - ")[0] if failed else f"ended with {code}: {text[-200:]}"), spent


def _bounded() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU, MOST_CPU + 10))


def _waited(process: subprocess.Popen[bytes]) -> int:
    try:
        return process.wait(MOST_WALL)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, 9)
        return process.wait()


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
