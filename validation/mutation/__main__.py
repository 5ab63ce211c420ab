"""Seeded mutants of the package, judged by the tests of their area::

    python validation/mutation --mutants 200 --keep mutants.json    # goes on where a run before was stopped
    python validation/mutation --keep mutants.json --page           # the tables of docs/tests.md anew, without judging
    python validation/mutation --stated oracles "old failures"      # the mistakes of stated.json instead
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "validation"))

from mutation.areas import AREAS, Area, area  # noqa: E402
from mutation.judge import Copy, drawn  # noqa: E402
from mutation.mutators import Mutant  # noqa: E402
from mutation.page import write  # noqa: E402

STATED = json.loads((Path(__file__).parent / "stated.json").read_text(encoding="utf-8"))


def main() -> int:
    """1 where fewer mutants than `page.BAR` of a hundred were killed."""
    p = argparse.ArgumentParser(description=__doc__)
    p.add_argument("--mutants", type=int, default=200)
    p.add_argument("--seed", type=int, default=0)
    p.add_argument("--area", choices=[a.name for a in AREAS], action="append", help="these areas alone")
    p.add_argument("--keep", type=Path, default=Path("mutants.json"), help="what was judged; a run goes on from there")
    p.add_argument("--again", action="store_true", help="judge the survivors among those kept once more")
    suites = sorted({one["suite"] for one in STATED})
    p.add_argument("--stated", nargs="*", choices=suites, help="judge the mistakes of stated.json instead")
    p.add_argument("--page", action="store_true", help="only write the tables of docs/tests.md")
    a = p.parse_args()
    kept = json.loads(a.keep.read_text(encoding="utf-8")) if a.keep.exists() else {"judged": []}
    if a.stated:
        judge_stated(a, kept)
    elif not a.page:
        judge(a, kept)
    return write(ROOT, kept)


def judge(a: argparse.Namespace, kept: dict[str, Any]) -> None:
    """Judge what is not judged yet; every verdict is kept at once."""
    areas = [area(name) for name in a.area] if a.area else list(AREAS)
    if a.again:
        kept["judged"] = [one for one in kept["judged"] if one["killed"]]
    seen = {_key(one) for one in kept["judged"]}
    with tempfile.TemporaryDirectory(prefix="mbdae-mutants-") as folder:
        copy = Copy(ROOT, Path(folder))
        for one, file, mutant in drawn(list(AREAS), ROOT, a.mutants, a.seed):
            said = {"file": str(file.relative_to(ROOT)), "line": mutant.line(file.read_text(encoding="utf-8")),
                    "old": mutant.old, "new": mutant.new, "area": one.name}  # fmt: skip
            if one not in areas or _key(said) in seen:
                continue
            verdict = copy.judged(one, file, mutant)
            kept["judged"].append(verdict.to_dict())
            a.keep.write_text(json.dumps(kept, indent=1), encoding="utf-8")
            print(f"{len(kept['judged']):4d} {one.name:12s} {verdict.file}:{verdict.line} {verdict.old!r} -> {verdict.new!r}: "
                  f"{verdict.killed or 'SURVIVED'} ({verdict.cpu_s:.0f} s)", flush=True)  # fmt: skip


def judge_stated(a: argparse.Namespace, kept: dict[str, Any]) -> None:
    """Judge mistakes that stated.json names, each by the tests that it names."""
    done = kept.setdefault("stated", {})
    with tempfile.TemporaryDirectory(prefix="mbdae-mutants-") as folder:
        copy = Copy(ROOT, Path(folder))
        for one in (one for one in STATED if one["suite"] in a.stated and not done.get(one["name"])):
            file = ROOT / one["file"]
            at = file.read_text(encoding="utf-8").index(one["old"])
            tests = Area(one["suite"], 0, (), tuple(one["tests"]))
            verdict = copy.judged(tests, file, Mutant(at, at + len(one["old"]), one["old"], one["new"]))
            done[one["name"]] = verdict.killed
            a.keep.write_text(json.dumps(kept, indent=1), encoding="utf-8")
            print(f"{one['suite']}: {one['name']}: {verdict.killed or 'SURVIVED'} ({verdict.cpu_s:.0f} s)", flush=True)


def _key(said: dict[str, Any]) -> tuple[Any, ...]:
    return said["file"], said["line"], said["old"], said["new"]


if __name__ == "__main__":
    sys.exit(main())
