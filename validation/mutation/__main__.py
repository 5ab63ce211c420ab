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
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import accumulate
from math import inf
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "validation"))

from mutation.areas import AREAS, Area, area  # noqa: E402
from mutation.covers import Covers, measure  # noqa: E402
from mutation.judge import Copy, Verdict, drawn  # noqa: E402
from mutation.mutators import Mutant  # noqa: E402
from mutation.page import reason, write  # noqa: E402

STATED = json.loads((Path(__file__).parent / "stated.json").read_text(encoding="utf-8"))


def main() -> int:
    """1 where fewer mutants than `page.BAR` of a hundred were killed."""
    p = argparse.ArgumentParser(description=__doc__)
    p.add_argument("--mutants", type=int, default=200)
    p.add_argument("--seed", type=int, default=0)
    p.add_argument("--area", choices=[a.name for a in AREAS], action="append", help="these areas alone")
    p.add_argument("--keep", type=Path, default=Path("mutants.json"), help="what was judged; a run goes on from there")
    p.add_argument("--covers", type=Path, default=Path("mutants.covers"), help="folder of the lines that tests execute")
    p.add_argument("--processes", type=int, default=2, help="mutants side by side")
    p.add_argument("--at-most", type=float, default=inf, metavar="S",
                   help="CPU s of tests after which a mutant counts as a survivor until it is judged --again")
    p.add_argument("--again", action="store_true", help="judge the survivors once more for which no reason is stated")
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
    every = [(one, file, mutant, _key(one, file, mutant)) for one, file, mutant in drawn(list(AREAS), ROOT, a.mutants, a.seed)]
    keys = {key for *_, key in every}
    kept["judged"] = [one for one in kept["judged"] if _kept_key(one) in keys and (one["killed"] or not a.again or reason(one))]
    seen = {_kept_key(one) for one in kept["judged"]}
    left = [(one, file, mutant) for one, file, mutant, key in every if one in areas and key not in seen]
    measure(ROOT, a.covers, dict.fromkeys(name for one in areas for name in one.test_files(ROOT)), a.processes)
    covers = Covers(ROOT, a.covers)
    with ProcessPoolExecutor(a.processes, initializer=_begin) as pool:
        jobs = [pool.submit(_judged, one.name, file, mutant, *_chosen(covers, one, file, mutant, a.at_most))
                for one, file, mutant in left]
        for job in as_completed(jobs):
            try:
                v = job.result()
            except RuntimeError as error:  # it stays unjudged; the others are kept
                print(error, flush=True)
                continue
            kept["judged"].append(v.to_dict())
            a.keep.write_text(json.dumps(kept, indent=1), encoding="utf-8")
            place = f"{len(kept['judged']):4d} {v.area:12s} {v.file}:{v.line} {v.old!r} -> {v.new!r}"
            print(f"{place}: {v.killed or 'SURVIVED'} ({v.tests} tests, {v.cpu_s:.0f} s)", flush=True)


def _chosen(covers: Covers, one: Area, file: Path, mutant: Mutant, most: float) -> tuple[list[str], float]:
    """Tests of an area that may see a mutant, and CPU seconds after which they do not end."""
    tests = covers.order(one, file, mutant)
    spent = list(accumulate(map(covers.cpu, tests)))
    tests = tests[: sum(s <= most for s in spent)]
    return tests, 60 + 4 * sum(map(covers.cpu, tests))


_copy: list[Copy] = []  #: of this process


def _begin() -> None:
    folder = tempfile.TemporaryDirectory(prefix="mbdae-mutants-")
    _copy.append(Copy(ROOT, Path(folder.name)))
    _copy[0].ends_with = folder  # type: ignore[attr-defined]


def _judged(name: str, file: Path, mutant: Mutant, tests: list[str], cpu: float) -> Verdict:
    return _copy[0].judged(name, file, mutant, tests, cpu)


def judge_stated(a: argparse.Namespace, kept: dict[str, Any]) -> None:
    """Judge mistakes that stated.json names, each by the tests that it names."""
    done = kept.setdefault("stated", {})
    with tempfile.TemporaryDirectory(prefix="mbdae-mutants-") as folder:
        copy = Copy(ROOT, Path(folder))
        for one in (one for one in STATED if one["suite"] in a.stated and not done.get(one["name"])):
            file = ROOT / one["file"]
            at = file.read_text(encoding="utf-8").index(one["old"])
            tests = [f"tests/{name}" for name in one["tests"]]
            verdict = copy.judged(one["suite"], file, Mutant(at, at + len(one["old"]), one["old"], one["new"]), tests)
            done[one["name"]] = verdict.killed
            a.keep.write_text(json.dumps(kept, indent=1), encoding="utf-8")
            print(f"{one['suite']}: {one['name']}: {verdict.killed or 'SURVIVED'} ({verdict.cpu_s:.0f} s)", flush=True)


def _key(one: Area, file: Path, mutant: Mutant) -> tuple[Any, ...]:
    code = mutant.code(file.read_text(encoding="utf-8"))
    return one.name, file.relative_to(ROOT).as_posix(), *code, mutant.old, mutant.new


def _kept_key(said: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(said.get(name) for name in ("area", "file", "code", "column", "old", "new"))


if __name__ == "__main__":
    sys.exit(main())
