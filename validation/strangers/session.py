"""A session of drawn runs and checks: blocks from their seeds, resumable; failures are made smaller and written as scripts."""

from __future__ import annotations

import hashlib
import json
import random
import re
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, find, settings
from hypothesis.errors import NoSuchExample
from strangers.changes import WAYS, check, failed
from strangers.draw import FAMILIES, ways
from strangers.judge import Verdict, judge, text
from strangers.story import Story, script, stored

BLOCK = {"run": 6, "check": 6}  #: scenes of a block
RUNS, CHECKS = 5, 5  #: ways in which each is run; other ways to state it that are compared
SHRINKING = 30.0  #: CPU s for making a failing scene smaller
QUIET = settings(deadline=None, database=None, phases=[Phase.generate, Phase.shrink], suppress_health_check=list(HealthCheck))


@dataclass
class Counts:
    """What a session found: verdicts by kind and family (of checks "way: verdict"), scenes seen, blocks done, files of
    failures."""

    verdicts: dict[str, Counter[str]] = field(default_factory=dict)
    seen: set[str] = field(default_factory=set)
    done: set[str] = field(default_factory=set)
    failures: list[str] = field(default_factory=list)
    remarks: Counter[str] = field(default_factory=Counter)  #: of what told or was not judged, without its numbers
    examples: dict[str, str] = field(default_factory=dict)  #: a script for every remark

    def add(self, kind: str, family: str, verdict: str, note: str, story: Story) -> None:
        """Count one, and its remark."""
        self.verdicts.setdefault(f"{kind} {family}", Counter())[verdict] += 1
        if note:
            way = ", ".join(story.options.values()) or "default"
            remark = f"{kind} {family}: {verdict} ({way}): {re.sub(r'[0-9][0-9.e+-]*', '#', note)[:120]}"
            self.remarks[remark] += 1
            self.examples.setdefault(remark, script(story))

    def of(self, *verdicts: str) -> int:
        """How many had one of some verdicts, runs and checks together."""
        return sum(n for counts in self.verdicts.values() for name, n in counts.items() if name.split(": ")[-1] in verdicts)

    def scenes(self, kind: str) -> int:
        """Scenes that were run (kind "run") or checked ("check")."""
        return sum(c["scenes"] for name, c in self.verdicts.items() if name.split()[0] == kind)

    def write(self, path: Path) -> None:
        """For the next session."""
        data = {"verdicts": self.verdicts, "seen": sorted(self.seen), "done": sorted(self.done), "failures": self.failures,
                "remarks": self.remarks, "examples": self.examples}
        part = path.with_suffix(".part")
        part.write_text(json.dumps(data))
        part.replace(path)

    @classmethod
    def read(cls, path: Path) -> Counts:
        """Of an earlier session; empty where there was none."""
        if not path.is_file():
            return cls()
        data = json.loads(path.read_text())
        verdicts = {name: Counter(counts) for name, counts in data["verdicts"].items()}
        return cls(verdicts, set(data["seen"]), set(data["done"]), data["failures"], Counter(data["remarks"]), data["examples"])

    def __str__(self) -> str:
        lines = [f"  {name}: " + ", ".join(f"{n} {v}" for v, n in sorted(c.items())) for name, c in sorted(self.verdicts.items())]
        return "\n".join([f"{self.scenes('run')} runs, {self.scenes('check')} scenes checked", *lines, *self.failures])


def blocks(kinds: tuple[str, ...], families: tuple[str, ...], first: int) -> Iterator[tuple[str, str, int]]:
    """Kind, family and seed of every block, without end."""
    seed = first
    while True:
        yield from ((kind, family, seed) for family in families for kind in kinds)
        seed += 1


def session(hours: float, out: Path, kinds: tuple[str, ...] = ("run", "check"), families: tuple[str, ...] = tuple(FAMILIES),
            first: int = 0, say: Callable[[str], None] = lambda text: None, most: int | None = None) -> Counts:
    """Blocks until the time is over; `out` holds what was done, and a script of every failure."""
    out.mkdir(parents=True, exist_ok=True)
    state, end, made = out / "strangers.json", time.monotonic() + 3600 * hours, 0
    counts = Counts.read(state)
    for kind, family, seed in blocks(kinds, families, first):
        key = f"{kind} {family} {seed}"
        if time.monotonic() > end or (most is not None and made >= most):
            break
        if key not in counts.done:
            block(kind, family, seed, counts, out, end, say)
            counts.done.add(key)
            counts.write(state)
            made += 1
    say(str(counts))
    return counts


def block(kind: str, family: str, seed: int, counts: Counts, out: Path, end: float, say: Callable[[str], None]) -> None:
    """Draw scenes from a seed up to the first that fails, which is shrunk and written."""
    begun: list[Failure] = []

    def fails(story: Story) -> bool:
        mark = hashlib.sha256(f"{kind}{script(story)}".encode()).hexdigest()[:12]
        if begun or mark in counts.seen or time.monotonic() > end:
            return False
        counts.seen.add(mark)
        begun.extend(list(_failures(kind, family, story, counts))[:1])
        return False

    def draw(asked: Callable[[Story], bool]) -> None:
        drawn = settings(QUIET, max_examples=BLOCK[kind])
        with suppress(NoSuchExample):
            find(FAMILIES[family], asked, settings=drawn, random=random.Random(f"{kind} {family} {seed}"))

    draw(fails)
    for failure in begun:
        draw(failure.again)
        counts.failures.append(failure.write(out, f"{kind}_{family}_{seed}"))
        say(f"{counts.failures[-1]}: {failure.verdict}")


@dataclass
class Failure:
    """A scene that fails: the check ("run" or a way), its verdict, the way it is run, until when it is made smaller (CPU s)."""

    check: str
    story: Story
    verdict: Verdict
    way: dict[str, Any]
    until: float
    known: dict[str, bool] = field(default_factory=dict)  #: by script, whether it fails: hypothesis asks again

    def again(self, story: Story) -> bool:
        """Whether a smaller scene fails in the same way, which then replaces it; no new ones after the time for that."""
        smaller = story.but(**self.way)
        key = script(smaller)
        if key not in self.known:
            found = verdict_of(self.check, smaller) if time.process_time() < self.until else Verdict("not judged")
            self.known[key] = found.verdict == self.verdict.verdict
            if self.known[key]:
                self.story, self.verdict = smaller, found
        return self.known[key]

    def write(self, out: Path, name: str) -> str:
        """A script that runs by itself, and the file for tests/strangers/found; returns the name of the latter."""
        name, said = f"{name}_{self.check}", f"{self.check}: {self.verdict}"
        (out / f"{name}.script.py").write_text(script(self.story, said))
        (out / f"{name}.py").write_text(stored(self.story, self.check, said))
        return str(out / f"{name}.py")


def verdict_of(name: str, story: Story) -> Verdict:
    """The verdict on a run (name "run") or on one of the metamorphic checks."""
    return judge(story) if name == "run" else _checked(story, [name]).get(name, Verdict("claims nothing"))


def _checked(story: Story, names: list[str]) -> dict[str, Verdict]:
    try:
        return check(story, names)
    except Exception as error:  # of a result that is looked at
        return {name: Verdict("crashed", note=text(error)) for name in names[:1]}


def _failures(kind: str, family: str, story: Story, counts: Counts) -> Iterator[Failure]:
    """Count what becomes of a scene, and yield what fails."""
    other = random.Random(script(story)).sample(list(WAYS), CHECKS)
    for one in ways(story, RUNS - 1) if kind == "run" else [story]:
        found = {"run": judge(one)} if kind == "run" else _checked(one, other)
        counts.add(kind, family, "scenes" if found else "claims nothing", "", one)
        for name, verdict in found.items():
            said = verdict.note if verdict.verdict in ("told", "not judged") else ""
            counts.add(kind, family, verdict.verdict if kind == "run" else f"{name}: {verdict.verdict}", said, one)
            if verdict.wrong if kind == "run" else failed(verdict):
                way = {"options": one.options, "accuracy": one.accuracy, "model": one.model}
                yield Failure(name, one, verdict, way, time.process_time() + SHRINKING, {script(one): True})
