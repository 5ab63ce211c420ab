"""The score of the mutants by area, written into docs/tests.md between two marks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mutation.areas import AREAS

BAR = 0.97  #: part of the mutants that has to be killed, of those that change anything
#: mutants that change nothing, and why
EQUIVALENT = json.loads((Path(__file__).parent / "equivalent.json").read_text(encoding="utf-8"))
BEGIN, END = "<!-- mutants: begin -->", "<!-- mutants: end -->"


def write(root: Path, kept: dict[str, Any]) -> int:
    """Write the table; 0 where the bar is met."""
    page = root / "docs" / "tests.md"
    text = page.read_text(encoding="utf-8")
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    tables = "\n".join(made for made in (table(kept["judged"], EQUIVALENT), stated(kept.get("stated", {}))) if made)
    page.write_text(f"{before}{BEGIN}\n{tables}{END}{after}", encoding="utf-8")
    killed, same, whole = _counts(kept["judged"], EQUIVALENT)
    return 0 if whole and killed >= BAR * (whole - same) else 1


def stated(verdicts: dict[str, str]) -> str:
    """Mistakes that were stated, and the test that saw each first."""
    if not verdicts:
        return ""
    seen = {name: f"`{said.removeprefix('FAILED ')}`" if said else "**none**" for name, said in verdicts.items()}
    lines = [f"| {name} | {by} |" for name, by in seen.items()]
    return "\n".join(["| mistake put in | seen by |", "|---|---|", *lines]) + "\n"


def table(judged: list[dict[str, Any]], equivalent: list[dict[str, str]]) -> str:
    """Mutants by area, and every survivor, with the reason where nothing can see it."""
    if not judged:
        return ""
    lines = ["| area | mutants | killed | equivalent | part of the others killed |", "|---|---|---|---|---|"]
    for name in (*(a.name for a in AREAS), "all"):
        killed, same, whole = _counts([one for one in judged if name in (one["area"], "all")], equivalent)
        lines += [f"| {name} | {whole} | {killed} | {same} | {100 * killed / max(whole - same, 1):.0f} % |"] if whole else []
    said = ((one["file"], one["code"], one["old"], one["new"], reason(one, equivalent)) for one in judged if not one["killed"])
    alive = sorted(set(said))
    lines += ["", "Survivors:", ""] if alive else []
    lines += [f"- `{file}`, `{_short(code)}`: `{_short(old)}` -> `{_short(new) or ' '}`{because and ': ' + because}"
              for file, code, old, new, because in alive]
    return "\n".join(lines) + "\n"


def reason(one: dict[str, Any], equivalent: list[dict[str, str]] = EQUIVALENT) -> str:
    """Why a mutant changes nothing; empty where that is not known."""
    keys = "file", "code", "old", "new"
    return next((known["why"] for known in equivalent if all(known[key] == one[key] for key in keys)), "")


def _short(text: str) -> str:
    one = " ".join(text.split()).replace("`", "'")
    return one if len(one) < 80 else one[:77] + "..."


def _counts(judged: list[dict[str, Any]], equivalent: list[dict[str, str]]) -> tuple[int, int, int]:
    """Killed; alive for a stated reason; all."""
    killed = sum(bool(one["killed"]) for one in judged)
    return killed, sum(bool(not one["killed"] and reason(one, equivalent)) for one in judged), len(judged)
