"""Single edits of what a report prints are caught by the report itself: it reads its equations back."""

from __future__ import annotations

import random
import re

import pytest

from mbdae.documents.blocks import Equation, Section, every, numbered
from mbdae.reports import page, report

EDITS = 18  # every kind twice
NAMES = ["revolute", "classical", "recursive", "universal", "screw", "spherical", "gear", "pointspring", "jointdamper", "hertz",
         "lugre", "beam", "rigidbody", "bushing"]
VECTOR = r"(\\(?:mathbf|boldsymbol)\{[^{}]*\}_[kl])"
#: edits of a line: a pattern and what takes its place
KINDS = {
    "sign of a term": (r" \+ ", " - "),
    "factors of a vector product": (rf"{VECTOR}\\times {VECTOR}", r"\2\\times \1"),
    "another body": (r"\}_k(?![a-z])", "}_l"),
    "another axis": (r"\\mathbf\{x\}", r"\\mathbf{y}"),
    "a factor": (r"= (?!0|\\mathbf\{0\})", "= 2\\\\,"),
    "a dropped term": (r" [+-] [^+]*$", ""),
    "a dropped rate": (r"\\dot\{", "{"),
    "sine for cosine": (r"\\cos ", r"\\sin "),
    "a power": (r"\^\{2\}", "^{3}"),
}


def edited(blocks, number, line):
    """The blocks with another line in place of the equation of a number."""
    out = []
    for block in blocks:
        if isinstance(block, Section):
            block = Section(block.title, edited(block.blocks, number, line), block.level)
        out.append(Equation(line, block.number, block.note) if isinstance(block, Equation) and block.number == number else block)
    return out


def with_edit(monkeypatch, name, edit):
    """The text of a report whose numbered blocks are changed by `edit` before they are read back."""
    with monkeypatch.context() as patch:
        patch.setattr(page, "numbered", lambda blocks: edit(numbered(blocks)))
        return report(name).to_markdown()


@pytest.fixture(scope="module")
def lines():
    """The equations of every report, by name."""
    found, patch = {}, pytest.MonkeyPatch()
    for name in NAMES:
        with_edit(patch, name, lambda blocks, name=name: found.setdefault(name, list(every(Equation, blocks))) and blocks)
    return found


@pytest.mark.parametrize("seed", range(EDITS))
def test_single_edits_of_the_print_are_caught(seed, lines, monkeypatch):
    rng, kind = random.Random(seed), list(KINDS)[seed % len(KINDS)]
    pattern, place = KINDS[kind]
    open_ = [(name, e) for name, found in lines.items() for e in found if re.search(pattern, e.latex)]
    name, e = rng.choice(open_)
    at = rng.choice(list(re.finditer(pattern, e.latex)))
    line = e.latex[: at.start()] + re.sub(pattern, place, at[0] if kind != "a dropped term" else "") + e.latex[at.end() :]
    line = line if kind != "a dropped term" else e.latex[: at.start()]
    text = with_edit(monkeypatch, name, lambda blocks: edited(blocks, e.number, line))
    assert "NOT EQUAL" in text, f"{kind} in {name} ({e.number}): {e.latex} -> {line}"


def test_a_line_that_is_missing_is_told(lines, monkeypatch):
    for name, found in lines.items():
        e = found[len(found) // 2]
        text = with_edit(monkeypatch, name, lambda blocks, e=e: without(blocks, e.number))
        if not e.latex.startswith("="):
            assert "NOT EQUAL" in text, f"{name} without {e.latex}"


def without(blocks, number):
    found = [Section(b.title, without(b.blocks, number), b.level) if isinstance(b, Section) else b for b in blocks]
    return [b for b in found if not (isinstance(b, Equation) and b.number == number)]


def test_all_that_is_displayed_is_compared(lines, monkeypatch):
    """Every number appears among the checks, or defines what a checked equation uses."""
    for name, found in lines.items():
        text = report(name).to_markdown()
        checked = {int(n) for n in re.findall(r"^\| \((\d+)\)", text, re.M)}
        rest = [e for e in found if e.number not in checked]
        for e in rest:
            symbol = e.latex.split("=")[0].strip()
            assert sum(symbol in other.latex for other in found) >= 2, f"{name}: {e.latex}"
