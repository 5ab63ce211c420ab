"""Counts of verdicts: of all runs, and by scene, kind of input or law, decade of width, and solver."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from math import floor, log10

from runner import Found, allowed
from timed_inputs.judge import VERDICTS, Run

#: shares of runs that may warn though right, and of those with error control that may say that they are wrong
NEEDLESS, TOLD = 0.05, 0.1
WRONG = ("silent", "refused needlessly", "crashed")


def found(runs: Sequence[Run], seeds: Sequence[int]) -> list[Found]:
    """What a claim says of its runs, one of each seed; silent, refused and crashed ones are named by their seeds."""
    counts = Counter(run.verdict for run in runs)
    rows = [Found(counts[v], 0, "runs", v, note=_named(runs, v)) for v in WRONG]
    said = ", ".join(f"{counts[v]} {v}" for v in VERDICTS)
    steered = [run for run in runs if not run.equal_steps]
    undelivered = sum(run.verdict == "told" for run in steered) / max(1, len(steered))
    needless = counts["told needlessly"] / len(runs)
    rows.append(Found(needless, allowed(NEEDLESS, seeds), "share", "told needlessly", note=_named(runs, "told needlessly")))
    rows.append(Found(undelivered, allowed(TOLD, seeds), "share", "told instead of right, error control",
                      note=f"{len(runs)} runs: {said}"))
    return rows


def _named(runs: Sequence[Run], verdict: str) -> str:
    seeds = [str(run.seed) for run in runs if run.verdict == verdict]
    return f"seeds {', '.join(seeds)}" if seeds else ""


def text(runs: Sequence[Run]) -> str:
    """All tables, then every run that is wrong."""
    columns: dict[str, Callable[[Run], str]] = {
        "scene": lambda run: run.scene, "kind": lambda run: run.kind if "," not in run.kind else "several",
        "width over the whole": lambda run: f"1e{floor(log10(min(run.width, 0.999)))}", "way": lambda run: run.way}
    parts = [_table("all", runs, lambda run: "runs")]
    parts += [_table(name, runs, of) for name, of in columns.items()]
    return "\n".join([*parts, *(str(run) for run in runs if run.verdict in WRONG), f"{sum(run.wall for run in runs):.0f} s"])


def _table(name: str, runs: Sequence[Run], of: Callable[[Run], str]) -> str:
    lines = [f"{name:<24}{'runs':>6}" + "".join(f"{v:>20}" for v in VERDICTS)]
    for value in sorted({of(run) for run in runs}):
        counts = Counter(run.verdict for run in runs if of(run) == value)
        lines.append(f"{value:<24}{sum(counts.values()):>6}" + "".join(f"{counts[v] or '':>20}" for v in VERDICTS))
    return "\n".join(lines) + "\n"
