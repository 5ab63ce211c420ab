"""A copy of the checkout in which mutants are judged by the tests of their area, one after the other."""

from __future__ import annotations

import hashlib
import os
import resource
import shutil
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from mutation.areas import Area
from mutation.mutators import Mutant, is_valid, mutants
from mutation.page import reason

COPIED = ("mbdae", "tests", "validation", "examples", "docs", "benchmarks", ".ci", "pyproject.toml", "README.md",
          "CONTRIBUTING.md", "CHANGELOG.md", "hatch_build.py", "LICENSE")
MOST_CPU, MOST_WALL = 600.0, 3600.0  #: s, of all tests of a mutant: more is a test that does not end
MOST_BYTES = 8 * 2**30  #: of memory; more is asked for by mistakes in sizes
FIRST = 20  #: tests that are tried before the others are even collected


@dataclass(frozen=True)
class Verdict:
    """code: the line, column: where in it; killed: by which test, or why, empty of a survivor; tests: those that may see it."""

    area: str
    file: str
    line: int
    code: str
    column: int
    old: str
    new: str
    killed: str
    tests: int
    cpu_s: float

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def drawn(areas: list[Area], root: Path, count: int, seed: int) -> list[tuple[Area, Path, Mutant]]:
    """Mutants of all areas by their shares; neighbours in the list are of different areas. Whether one is drawn follows from the
    seed and its line, so that a change of the package elsewhere changes little. For every one that is known to change nothing
    (`equivalent.json`) one more is drawn."""
    found, whole = [], sum(a.share for a in areas)
    for one in areas:
        texts = {path: path.read_text(encoding="utf-8") for path in one.files(root)}
        every, seen = list[tuple[bytes, Path, Mutant]](), Counter[str]()
        for path, text in texts.items():
            for m in mutants(text, path.name):
                name = f"{seed} {path.relative_to(root).as_posix()} {m.code(text)} {m.old} {m.new}"
                every.append((hashlib.sha256(f"{name} {seen[name]}".encode()).digest(), path, m))
                seen[name] += 1
        wanted = max(1, round(count * one.share / whole))
        order = sorted(every, key=lambda e: e[0])
        taken = list[tuple[Path, Mutant]]()
        for _, path, m in order:
            if wanted and is_valid(m.applied(texts[path]), path):
                taken.append((path, m))
                file, code = path.relative_to(root).as_posix(), m.code(texts[path])[0]
                wanted -= not reason({"file": file, "code": code, "old": m.old, "new": m.new})
        found += [((i + 0.5) / len(taken), one, *f) for i, f in enumerate(taken)]
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

    def judged(self, area: str, file: Path, mutant: Mutant, tests: Sequence[str], cpu: float = MOST_CPU) -> Verdict:
        """What tests say of a mutant, of which the first ones are tried by themselves. A test that kills passes without the
        mutant, which is tried once of every test. cpu: s after which they do not end."""
        name, text = file.relative_to(self.root), file.read_text(encoding="utf-8")
        self._write(name, mutant.applied(text))
        said, spent = "", 0.0
        try:
            for part in (tests[:FIRST], tests[FIRST:]):
                if part and not said:
                    said, more = self.tested(part, cpu)
                    spent += more
        finally:
            self._write(name, text)
            if name.suffix != ".py":  # the library was compiled from the mutant
                shutil.copy(next(self.root.glob("mbdae/native/mbdae.core.*")), self.folder / "mbdae" / "native")
        test = said.partition(" ")[2] if said.startswith(("FAILED", "ERROR")) else ""
        if test and test not in self.passed:
            again, _ = self.tested([test], MOST_CPU)
            if again:
                raise RuntimeError(f"{test} fails without a mutant too: {again}")
            self.passed.add(test)
        place = name.as_posix(), mutant.line(text), *mutant.code(text)
        return Verdict(area, *place, mutant.old, mutant.new, said, len(tests), spent)

    def _write(self, name: Path, text: str) -> None:
        """A file, without what Python keeps of the one before: two of one second and one size are the same to it."""
        place = self.folder / name
        place.write_text(text, encoding="utf-8")
        for kept in (place.parent / "__pycache__").glob(f"{place.stem}.*"):
            kept.unlink()

    def tested(self, tests: Sequence[str], cpu: float) -> tuple[str, float]:
        """The first of some tests that fails, or empty; CPU seconds."""
        env = os.environ | {"PYTHONPATH": str(self.folder), "MPLBACKEND": "Agg"}
        env |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "pytest", "-x", "--tb=no", "-v", "-rfE", "-n", "0", "-p", "no:cacheprovider", *tests]
        before = _children()
        with (self.folder / "said.txt").open("w+", encoding="utf-8") as out:
            process = subprocess.Popen(command, cwd=self.folder, env=env, stdin=subprocess.DEVNULL, stdout=out,
                                       stderr=out, start_new_session=True, preexec_fn=partial(_bounded, cpu))
            code = _waited(process)
            out.seek(0)
            text = out.read()
        failed = [line for line in text.splitlines() if line.startswith(("FAILED", "ERROR"))]
        if code in (4, 5) and not failed:
            raise RuntimeError(f"pytest was not given what it needs: {text[-1000:]}")
        spent = _children() - before
        last = text.splitlines()[-1] if text else ""
        return ("" if code == 0 else failed[0].split(" - ")[0] if failed else f"ended with {code}: {last[-200:]}"), spent


def _bounded(cpu: float) -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # ignored in what a shell starts in the background; tests interrupt
    resource.setrlimit(resource.RLIMIT_CPU, (int(cpu), int(cpu) + 10))
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))


def _waited(process: subprocess.Popen[bytes]) -> int:
    try:
        return process.wait(MOST_WALL)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, 9)
        return process.wait()


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
