"""Which tests may see a mistake at a place: those that execute it, the cheapest first. Measured once, without mutants."""

from __future__ import annotations

import ast
import hashlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from pathlib import Path
from typing import Any

try:
    import coverage
except ImportError:  # of the extra `dev`; without it nothing is measured or ordered
    coverage = None

from mutation.areas import Area
from mutation.mutators import Mutant

TRACED = 600.0  #: s, most of a test file; the longest takes 90
HERE = Path(__file__).resolve().parent
ENV = {"MPLBACKEND": "Agg", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def measure(root: Path, folder: Path, files: Iterable[str], processes: int) -> None:
    """Run test files, each in a process of its own, for the lines that their tests execute; not those that the folder has."""
    folder.mkdir(parents=True, exist_ok=True)
    state = sources_digest(root)

    def one(name: str) -> None:
        place = place_of(root, folder, name, state)
        env = os.environ | ENV | {"PYTHONPATH": f"{root}{os.pathsep}{HERE.parent}", "MBDAE_COVERS": str(place)}
        command = [sys.executable, "-m", "pytest", "-q", "-p", "mutation.covering", "-p", "no:cacheprovider", "-n", "0", name]
        ran = partial(subprocess.run, command, cwd=root, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
        try:
            said = ran(env=env, timeout=TRACED)
        except subprocess.TimeoutExpired:  # interrupts in the tracer lock it
            said = ran(env=env | {"MBDAE_UNTRACED": "1"}, timeout=None)
        print(f"{name}: {(said.stdout.strip() or said.stderr.strip() or '?').splitlines()[-1]}", flush=True)

    with ThreadPoolExecutor(processes) as pool:
        list(pool.map(one, (name for name in files if not place_of(root, folder, name, state).with_suffix(".json").exists())))


def sources_digest(root: Path) -> str:
    """Changes with every source of the package."""
    read = hashlib.sha256()
    for path in sorted((root / "mbdae").rglob("*.py")):
        read.update(path.read_bytes())
    return read.hexdigest()


def place_of(root: Path, folder: Path, name: str, state: str) -> Path:
    """Where the data of a test file are; another one where it or the package has changed."""
    word = hashlib.sha256(state.encode() + (root / name).read_bytes()).hexdigest()[:12]
    return folder / f"{name.removesuffix('.py').replace('/', '-')}-{word}.covered"


class Covers:
    """What `measure` found."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.root, state = root, sources_digest(root)
        self.place = lambda name: place_of(root, folder, name, state)
        self.lines = cache(self._lines)
        self.tests = cache(self._tests)

    def order(self, area: Area, file: Path, mutant: Mutant) -> list[str]:
        """Tests of an area that may see a mutant: those that execute its statement (of a constant, the lines with its name; of C,
        the Python that calls the file), then those that execute anything of the file, those that start processes, and, where it
        is executed on import or by C, the others; in each part the cheapest first. The rest cannot differ."""
        known = {test: facts for name in area.test_files(self.root) for test, facts in self.tests(name).items()}
        near, far, everywhere = self._by_place(area, file, mutant)
        beside = {test.split("::")[0] for test in near}

        def rank(test: str) -> int:
            return 0 if test in near else 1 if test in far else 2 if known[test]["starts"] or test.split("::")[0] in beside else 3

        chosen = [test for test in known if everywhere or rank(test) < 3]
        return sorted(chosen, key=lambda test: (rank(test), known[test]["cpu"]))

    def cpu(self, test: str) -> float:
        """CPU seconds of a test."""
        return float(self.tests(test.split("::")[0])[test]["cpu"])

    def _by_place(self, area: Area, file: Path, mutant: Mutant) -> tuple[set[str], set[str], bool]:
        names = area.test_files(self.root)
        if file.suffix != ".py":
            within = [p for p in file.parent.glob("*.c") if f'"{file.name}"' in p.read_text(encoding="utf-8")]
            beside = [p.with_suffix(".py") for p in (file, *within)] + [file.with_name("program.py")]
            calls = next((p for p in beside if p.exists()), file)
            return {t for n in names for ran in self.lines(n, calls).values() for t in ran if t}, set(), True
        statement = Enclosing(file.read_text(encoding="utf-8"), mutant)
        near, far, on_import = set[str](), set[str](), False
        for name in names:
            ran = self.lines(name, file)
            here = {t for line in statement.lines for t in ran.get(line, ())}
            on_import |= "" in here
            near |= here
            far |= {t for tests in ran.values() for t in tests}
        if on_import:
            for path in self._sources() if statement.names else ():
                at = _lines_with(path, frozenset(statement.names))
                near |= {t for name in names if at for line, tests in self.lines(name, path).items() if line in at for t in tests}
        return near - {""}, far - {""} if on_import else set(), on_import

    def _sources(self) -> list[Path]:
        return sorted((self.root / "mbdae").rglob("*.py"))

    def _tests(self, name: str) -> dict[str, dict[str, Any]]:
        known = json.loads(self.place(name).with_suffix(".json").read_text(encoding="utf-8"))
        return {test: facts for test, facts in known.items() if facts.get("passed")}

    def _lines(self, name: str, file: Path) -> dict[int, list[str]]:
        return self._data(name).contexts_by_lineno(str(file))

    @cache  # noqa: B019
    def _data(self, name: str) -> coverage.CoverageData:
        data = coverage.CoverageData(basename=str(self.place(name)))
        data.read()
        return data


class Enclosing:
    """lines: of the innermost statement around a mutant, of a compound one other than a function without its body; names: what it
    assigns."""

    def __init__(self, text: str, mutant: Mutant) -> None:
        first, last = (text.count("\n", 0, at) + 1 for at in (mutant.start, max(mutant.start, mutant.end - 1)))
        every = [n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.stmt)]
        around = [n for n in every if n.lineno <= first and last <= (n.end_lineno or 0)]
        inner = max(around, key=lambda n: (n.lineno, -(n.end_lineno or 0)))
        whole = isinstance(inner, ast.FunctionDef)  # a default value is used where the function is
        body, end = None if whole else getattr(inner, "body", None), (inner.end_lineno or inner.lineno) + 1
        self.lines = range(inner.lineno, max(body[0].lineno, inner.lineno + 1) if body else end)
        targets = inner.targets if isinstance(inner, ast.Assign) else [inner.target] if isinstance(inner, ast.AnnAssign) else []
        self.names = {n.id for target in targets for n in ast.walk(target) if isinstance(n, ast.Name)}


@cache
def _lines_with(path: Path, names: frozenset[str]) -> set[int]:
    word = re.compile(rf"\b({'|'.join(sorted(map(re.escape, names)))})\b")
    return {n for n, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1) if word.search(line)}
