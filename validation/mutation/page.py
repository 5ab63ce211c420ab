"""The score of the mutants by area, written into docs/tests.md between two marks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mutation.areas import AREAS

BAR = 0.97  #: part of the mutants that has to be killed
BEGIN, END = "<!-- mutants: begin -->", "<!-- mutants: end -->"


def write(root: Path, kept: dict[str, Any]) -> int:
    """Write the table; 0 where the bar is met."""
    page = root / "docs" / "tests.md"
    text = page.read_text(encoding="utf-8")
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    tables = "\n".join(made for made in (table(kept["judged"]), stated(kept.get("stated", {}))) if made)
    page.write_text(f"{before}{BEGIN}\n{tables}{END}{after}", encoding="utf-8")
    killed, whole = _counts(kept["judged"])
    return 0 if whole and killed >= BAR * whole else 1


def stated(verdicts: dict[str, str]) -> str:
    """Mistakes that were stated, and the test that saw each first."""
    if not verdicts:
        return ""
    seen = {name: f"`{said.removeprefix('FAILED ')}`" if said else "**none**" for name, said in verdicts.items()}
    lines = [f"| {name} | {by} |" for name, by in seen.items()]
    return "\n".join(["| mistake put in | seen by |", "|---|---|", *lines]) + "\n"


def table(judged: list[dict[str, Any]]) -> str:
    """Mutants by area, and every survivor."""
    if not judged:
        return ""
    lines = ["| area | mutants | killed | part |", "|---|---|---|---|"]
    for name in (*(a.name for a in AREAS), "all"):
        killed, whole = _counts([one for one in judged if name in (one["area"], "all")])
        lines += [f"| {name} | {whole} | {killed} | {100 * killed / whole:.0f} % |"] if whole else []
    alive = sorted((one["file"], one["line"], one["old"], one["new"]) for one in judged if not one["killed"])
    lines += ["", "Survivors:", ""] if alive else []
    lines += [f"- `{file}`: `{_short(old)}` -> `{_short(new) or ' '}`" for file, line, old, new in alive]
    return "\n".join(lines) + "\n"


def _short(text: str) -> str:
    one = " ".join(text.split()).replace("`", "'")
    return one if len(one) < 80 else one[:77] + "..."


def _counts(judged: list[dict[str, Any]]) -> tuple[int, int]:
    return sum(bool(one["killed"]) for one in judged), len(judged)
