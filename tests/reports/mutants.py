"""Seeded edits of the package: kernels of joints and trees, laws, the calculus of reports, what writes them.

Each entry of mutants.json is a file, a piece of text that stands there once, what takes its place, and the reports that contain
what it changes. Run as a script it says of every edit whether the reports and their hashes change and which checks say so:

    python tests/reports/mutants.py [numbers]
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
FILE = Path(__file__).parent / "mutants.json"
MUTANTS = [(m["file"], m["old"], m["new"], m["reports"]) for m in json.loads(FILE.read_text(encoding="utf-8"))]
CODE = """
import json, re, runpy, sys
import mbdae as mb
sys.path.insert(0, "REPORTS")
from values import differing, of_law
from mbdae.reports import exported
laws = {"classical": ["revolute"], "kinematic": ["revolute"], "recursive": ["revolute", "prismatic"]}

class Bent(mb.Joint):
    "Amounts are functions of several coordinates."
    coordinates = mb.params(turn=("rad", "turn"), lift=("m", "lift"))

    def motion(self, from_k):
        return from_k.about("z", self.turn).along("x", self.lift**2).about("y", self.lift * self.turn).along("z", self.lift)

class Arm(mb.Joint):
    "A ball joint, then a rod that slides and turns."
    coordinates = mb.params(rotation=("rotation", "ball"), out=("m", "length"), spin=("rad", "turn of the rod"))

    def motion(self, from_k):
        return from_k.turned(self.rotation).along("x", self.out).about("x", self.spin)

class Vane(mb.Force):
    "An energy with a vector product."
    params = mb.params(stiffness=("N m", "stiffness"))

    def energy(self, k, l):
        return self.stiffness * (k.x.cross(l.y) @ l.x)

own = {"Bent": Bent, "Arm": Arm, "Vane": Vane}

def all_of(name):
    if name in own:
        return {}
    return {law: of_law(exported()[law]) for law in laws.get(name, [name])}

found = {}
for name in sys.argv[1].split():
    try:
        example = runpy.run_path("examples/four_bar.py")["scene"]() if name == "four_bar" else own.get(name, name)
        text = mb.report(example).to_markdown()
        checks = [f"the equations of {law} are not those stored" for law in differing(all_of(name))] if name != "four_bar" else []
        hashes = re.findall(r"`[0-9a-f]{32,64}…?`", text)
        found[name] = [text, hashes, re.findall(r"(NOT EQUAL: .*|NEGATIVE)", text) + checks]
    except Exception as error:
        found[name] = ["", [], [f"{type(error).__name__}: {error}"[:200]]]
print(json.dumps(found))
"""


CODE = CODE.replace("REPORTS", str(Path(__file__).parent))


def reports(names: str, root: Path) -> dict[str, list]:
    """Text, hashes and failed checks of some reports by the package in a folder, in a process of its own."""
    env = os.environ | {"PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}
    run = subprocess.run([sys.executable, "-c", CODE, names], cwd=root, env=env, capture_output=True, text=True, check=False)
    return json.loads(run.stdout) if run.returncode == 0 else {"": ["", [], [run.stderr[-300:]]]}


def copy(folder: Path) -> Path:
    """The package and its examples in a folder, everything but the edited file by reference."""
    for name in ("mbdae", "examples"):
        for path in (ROOT / name).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                place = folder / path.relative_to(ROOT)
                place.parent.mkdir(parents=True, exist_ok=True)
                place.symlink_to(path)
    return folder


def judged(number: int, plain: dict[str, dict[str, list]] | None = None) -> tuple[bool, bool, list[str]]:
    """Whether an edit changes a report, whether it changes a hash, and the checks that fail."""
    file, old, new, names = MUTANTS[number]
    with tempfile.TemporaryDirectory() as where:
        root = copy(Path(where))
        place = root / file
        text = place.read_text(encoding="utf-8")
        if text.count(old) != 1:
            raise ValueError(f"mutant {number}: {old!r} stands {text.count(old)} times in {file}")
        place.unlink()
        place.write_text(text.replace(old, new), encoding="utf-8")
        got = reports(names, root)
    wanted = (plain if plain is not None else {}).setdefault(names, {}) or reports(names, ROOT)
    if plain is not None:
        plain[names] = wanted
    failed = [f"{name}: {said}" for name, (_, _, checks) in got.items() for said in checks]
    changed = any(got.get(name, [""])[0] != text for name, (text, _, _) in wanted.items())
    return changed, any(got.get(name, ["", []])[1] != hashes for name, (_, hashes, _) in wanted.items()), failed


if __name__ == "__main__":
    known: dict[str, dict[str, list]] = {}
    survived = []
    for n in map(int, sys.argv[1:]) if sys.argv[1:] else range(len(MUTANTS)):
        changed_, hash_, failed_ = judged(n, known)
        survived += [] if changed_ and failed_ else [n]
        said = ("changed" if changed_ else "SAME", "hash changed" if hash_ else "-", len(failed_), str(failed_[:1])[:160])
        print(n, *said, flush=True)
    print(f"{len(survived)} survived: {survived}")
