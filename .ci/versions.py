"""The tests in environments of their own: every Python found with the newest releases, and one with the lowest stated ones.

    python3 .ci/versions.py                   the quick part of the tests (marker `quick`), a minute or two per environment
    python3 .ci/versions.py --whole           all tests that a plain `pytest` runs
    python3 .ci/versions.py --smoke           no tests: comparison, report, run, save and load with the wheel alone, outside of a
                                              checkout, on the Pythons of SMOKED that are found; half a minute each
    python3 .ci/versions.py 3.13 lowest       these environments alone
    python3 .ci/versions.py --keep FOLDER     environments and logs stay there; else they are removed at the end

An environment is made as a user's would be: a source archive is built from this tree with hatchling, unpacked and installed as
a wheel, and the tests of the archive run against what is installed. In `lowest`, every requirement of pyproject.toml that names
a lowest release (hatchling and the extra `test` too) is installed in exactly that one, on the lowest Python stated. In `tools`
ruff and mypy, in their lowest releases beside the newest of all else, look at the archive instead. A Python that is not there is
named and left out. The exit code is 0 where all environments that ran passed and at least one ran, else 1; an
environment asked for by its name has to run.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
NEWEST = ("3.11", "3.12", "3.13", "3.14")
LOWEST, TOOLS = "lowest", "tools"
KNOWN = (*NEWEST, LOWEST, TOOLS)
SMOKED = ("3.11", "3.13")
REQUIREMENT = re.compile(r"(?P<name>[\w.-]+)(\[(?P<extras>[\w, -]+)\])?\s*(>=\s*(?P<lowest>[\w.]+))?\s*$")
LEFT_OUT = shutil.ignore_patterns(".git", ".venv*", "*.egg-info", "__pycache__", ".*_cache", "build", "dist", "out",
                                  "mbdae.core.*")
BUILD = "import sys; from hatchling import build; print(build.build_sdist(sys.argv[1]))"
COMPILER = "from hatchling import build; print(*build.get_requires_for_build_wheel())"  # ziglang where no compiler works
INSTALLED = """
import importlib.metadata as m, json, pathlib, sys
import mbdae
inside = pathlib.Path(sys.prefix).resolve() in pathlib.Path(mbdae.__file__).resolve().parents
print(json.dumps({"inside": inside, "versions": {name: m.version(name) for name in sys.argv[1:]}}))
"""


#: what a user does first, in a folder with nothing but a copy of one example
SMOKE = """
import pathlib, subprocess, sys
import mbdae as mb
said = subprocess.run([sys.executable, "-m", "mbdae", "--version"], capture_output=True, text=True, check=True).stdout
assert said.split() == ["mbdae", mb.__version__]
subprocess.run([sys.executable, "-m", "mbdae", "compare", "ground_resonance.py", "--t-end", "0.5", "--accuracies", "1e-3,1e-5",
                "--out", "out"], check=True, stdout=subprocess.DEVNULL)
assert len(list(pathlib.Path("out").iterdir())) == 4
mb.report(mb.Revolute).save("revolute.html")
s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
r = s.simulate(1.0)
r.save("run.npz")
again = mb.load("run.npz")
assert (again["hinge"].angle == r["hinge"].angle).all()
r.plot("hinge.angle", path="angle.png")
print(mb.__version__, "from", pathlib.Path(mb.__file__).parent)
"""


class FailedError(Exception):
    """A step that did not succeed; the text says which and what it printed last."""


@dataclass
class Outcome:
    """What became of one environment; `passed` is None where its Python is not there."""

    name: str
    passed: bool | None = None
    said: str = ""
    seconds: float = 0.0
    versions: dict[str, str] = field(default_factory=dict)


# -- what pyproject.toml states


def project() -> dict[str, object]:
    """pyproject.toml."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def requirements(stated: dict, extra: str = "test") -> dict[str, str | None]:
    """Lowest release of every requirement by its name, of an extra ("" for none) and of the extras it names too; None where none
    is stated."""
    own, listed = stated["project"]["name"], [*stated["project"]["dependencies"]]
    pending, seen = [extra] if extra else [], set()
    while pending:
        extra = pending.pop()
        seen.add(extra)
        for text in stated["project"]["optional-dependencies"][extra]:
            part = parsed(text)
            if part["name"] == own:
                pending += [e.strip() for e in part["extras"].split(",") if e.strip() not in seen]
            else:
                listed.append(text)
    found = {}
    for part in map(parsed, listed):
        found[part["name"]] = part["lowest"]
    return found


def parsed(text: str) -> dict[str, str]:
    """Name, extras and lowest release of one requirement."""
    found = REQUIREMENT.match(text)
    if found is None:
        raise FailedError(f"pyproject.toml: the requirement {text!r} is not a name with a lowest release (name>=1.2)")
    return found.groupdict()


def lowest_python(stated: dict) -> str:
    """The Python named by requires-python, such as 3.11."""
    return str(stated["project"]["requires-python"]).removeprefix(">=").strip()


# -- environments


def interpreter(version: str) -> str | None:
    """A Python of a version (3.12) with the module venv: the running one, python3.12 of the path, the launcher of Windows, or one
    that pyenv has installed and not activated."""
    installed = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    others = [[str(path)] for path in sorted(installed.glob(f"{version}.*/bin/python"), reverse=True)]
    ask = "import ensurepip, sys, venv; print(sys.executable, '%d.%d' % sys.version_info[:2], sep=chr(10))"
    for command in ([sys.executable], [f"python{version}"], ["py", f"-{version}"], *others):
        try:
            answer = subprocess.run([*command, "-c", ask], capture_output=True, text=True, check=True).stdout.splitlines()
        except (OSError, subprocess.CalledProcessError):
            continue
        if answer[1:] == [version]:
            return answer[0]
    return None


class Environment:
    """A folder with an environment, an unpacked source archive and a log of every command."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.log = folder, folder / "log.txt"
        self.python = folder / "env" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
        folder.mkdir(parents=True)

    def run(self, *command: str | Path, cwd: Path | None = None, check: bool = True) -> str:
        """Standard output of a command; all it says goes to the log."""
        clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "PYTEST_ADDOPTS")}
        clean |= {"MPLBACKEND": "Agg", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
        done = subprocess.run([str(c) for c in command], cwd=cwd or self.folder, env=clean, stdin=subprocess.DEVNULL,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
        with self.log.open("a", encoding="utf-8") as log:
            log.write(f"$ {' '.join(map(str, command))}\n{done.stdout}\n")
        if check and done.returncode:
            lines = [line for line in done.stdout.splitlines() if line.strip()]
            raise FailedError(f"{' '.join(map(str, command[1:5]))} ...: {lines[-1] if lines else 'no output'}")
        return done.stdout

    def install(self, base: str, stated: dict, extra: str, exact: set[str]) -> Path:
        """The environment with a wheel from a source archive of this tree; returns the folder of the unpacked archive.

        exact: names of what is installed in the lowest release stated, all else in the newest.
        """
        self.run(base, "-m", "venv", self.folder / "env")
        pip = (self.python, "-m", "pip", "install", "--quiet")
        build = [parsed(text) for text in stated["build-system"]["requires"]]
        self.run(*pip, *(pinned(part["name"], part["lowest"], part["name"] in exact) for part in build))
        if compiler := self.run(self.python, "-c", COMPILER, cwd=ROOT).split():
            self.run(*pip, *compiler)
        shutil.copytree(ROOT, self.folder / "tree", ignore=LEFT_OUT)
        archive = self.run(self.python, "-c", BUILD, self.folder, cwd=self.folder / "tree").split()[-1]
        shutil.rmtree(self.folder / "tree")
        with tarfile.open(self.folder / archive) as packed:
            packed.extractall(self.folder, filter="data")
        unpacked = self.folder / archive.removesuffix(".tar.gz")
        pins = [pinned(name, low, name in exact) for name, low in requirements(stated, extra).items()]
        self.run(*pip, "--no-build-isolation", f"{unpacked}[{extra}]" if extra else unpacked, *pins)
        return unpacked

    def versions(self, names: list[str]) -> dict[str, str]:
        """What is installed, asked outside of the archive's folder."""
        found = json.loads(self.run(self.python, "-c", INSTALLED, *names, cwd=self.folder / "env").splitlines()[-1])
        if not found["inside"]:
            raise FailedError("mbdae is imported from elsewhere, not from this environment")
        return dict(found["versions"])

    def tests(self, unpacked: Path, whole: bool) -> tuple[bool, str]:
        """Whether the tests of an unpacked archive pass, and their closing line with the names of those that fail."""
        # -P: the folder with the tests stays off the path, so that they see the installed wheel and not the sources beside them
        said = self.run(self.python, "-P", "-m", "pytest", *([] if whole else ["-m", "quick"]), cwd=unpacked, check=False)
        closing = [line.strip("= ") for line in said.splitlines() if re.search(r"\d+ (passed|failed|errors?)\b.* in ", line)]
        if not closing:
            return False, "\n    ".join(["no tests ran:", *said.splitlines()[-5:]])
        wrong = [line for line in said.splitlines() if line.startswith(("FAILED", "ERROR"))]
        return not re.search(r"failed|error", closing[-1]), "\n    ".join([closing[-1], *wrong])


    def smoke(self, unpacked: Path) -> tuple[bool, str]:
        """Whether the wheel does its first work in a folder of its own, and what it printed last."""
        place = self.folder / "elsewhere"
        place.mkdir()
        shutil.copy(unpacked / "examples" / "ground_resonance.py", place)
        return True, self.run(self.python, "-c", SMOKE, cwd=place).splitlines()[-1]


def pinned(name: str, lowest: str | None, exact: bool) -> str:
    """A requirement for pip: exactly the lowest release, or at least that one."""
    return name if lowest is None else f"{name}{'==' if exact else '>='}{lowest}"


def tried(name: str, folder: Path, whole: bool, smoke: bool = False) -> Outcome:
    """One environment: made, and the tests run in it."""
    stated, begin, outcome = project(), time.monotonic(), Outcome(name)
    base = interpreter(lowest_python(stated) if name in (LOWEST, TOOLS) else name)
    if base is None:
        outcome.said = "not found: no such Python, or without its module venv"
        return outcome
    if (folder / name).exists():
        shutil.rmtree(folder / name)
    environment = Environment(folder / name)
    try:
        extra, needed = "" if smoke else "dev" if name == TOOLS else "test", {*requirements(stated), "hatchling"}
        exact = {LOWEST: needed, TOOLS: set(requirements(stated, "dev")) - needed}.get(name, set())
        unpacked = environment.install(base, stated, extra, exact)
        outcome.versions = environment.versions([*requirements(stated, extra), "hatchling"])
        if name == TOOLS:
            for tool in (("ruff", "check", "."), ("mypy",)):
                environment.run(environment.python, "-P", "-m", *tool, cwd=unpacked)
            outcome.passed, outcome.said = True, "ruff and mypy find nothing"
        else:
            outcome.passed, outcome.said = environment.smoke(unpacked) if smoke else environment.tests(unpacked, whole)
    except FailedError as failure:
        outcome.passed, outcome.said = False, str(failure)
    outcome.seconds = time.monotonic() - begin
    return outcome


# -- the command


def table(outcomes: list[Outcome]) -> str:
    """Environments in columns with the release of every library, then a line of result for each."""
    ran = [o for o in outcomes if o.versions]
    names = list(dict.fromkeys(name for o in ran for name in o.versions))
    rows = [["", *(o.name for o in ran)], *([name, *(o.versions.get(name, "") for o in ran)] for name in names)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    words = {None: "-", True: "passed", False: "FAILED"}
    lines += ["", *(f"{o.name:8}{words[o.passed]:8}{o.seconds:6.0f} s  {o.said}" for o in outcomes)]
    return "\n".join(lines)


def main() -> int:
    """Try the environments asked for, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(KNOWN)}; all where none is given")
    parser.add_argument("--whole", action="store_true", help="all tests instead of the quick part")
    parser.add_argument("--smoke", action="store_true", help="no tests: the first work of a user, with the wheel alone")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="make environments and logs here, and leave them")
    a = parser.parse_args()
    if wrong := [name for name in a.names if name not in KNOWN]:
        parser.error(f"there is no environment {wrong[0]!r}: choose from {', '.join(KNOWN)}")
    folder = Path(a.keep or tempfile.mkdtemp(prefix="mbdae-versions-")).resolve()
    outcomes = []
    try:
        with ThreadPoolExecutor(2 if a.smoke else 1) as pool:  # tests take all processors by themselves
            for done in pool.map(lambda name: tried(name, folder, a.whole, a.smoke), a.names or (SMOKED if a.smoke else KNOWN)):
                outcomes.append(done)
                print(f"{done.name}: {done.said}", flush=True)
    finally:
        if a.keep is None:
            shutil.rmtree(folder, ignore_errors=True)
    print("\n" + table(outcomes))
    ran = [o for o in outcomes if o.passed is not None]
    missing = [o for o in outcomes if o.passed is None and a.names]
    return 0 if ran and all(o.passed for o in ran) and not missing else 1


if __name__ == "__main__":
    sys.exit(main())
