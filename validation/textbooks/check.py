"""Formulas of textbooks: none that is right is called a misprint; errors planted in them are found and nearly all mended."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from runner import Case, Claim, Found

from mbdae.audit.compare import ComparedStates
from mbdae.audit.evaluate import evaluate
from mbdae.audit.motion import RandomMotion
from mbdae.audit.notation import Node, Relation, TextReader
from mbdae.audit.phrases import Env
from mbdae.audit.reading import Printed, read
from mbdae.audit.verdicts import Row as Verdict
from mbdae.audit.verdicts import audit_equation

claim = Claim("textbooks", "formulas of textbooks are judged, errors planted in them found and mended", 0, "formulas",
              "Nikravesh, Haug, Shabana, Geradin and Cardona, Craig, Featherstone, Johnson, ...: see the files")
FILES = sorted(Path(__file__).parent.glob("*.audit"))
PLANTED = "#~"  #: begins the line with an error planted in the formula above it
LEAST = 120  #: formulas and planted errors


@lru_cache(maxsize=len(FILES))
def formulas(file: Path) -> list[tuple[Printed, Printed]]:
    """The equations of a file, each with the one that has an error."""
    plain, errors, last = [], dict[str, str](), ""
    inside = False
    for line in file.read_text(encoding="utf-8").splitlines():
        match = re.match(r"(\w+): ", line)
        last = match[1] if match else last
        inside = line.startswith(PLANTED) or (inside and line.startswith(" "))
        if inside:
            errors[last] = errors.get(last, "") + " " + line.removeprefix(PLANTED)
        plain.append("" if inside else line)
    found = list(read("\n".join(plain)).equations)
    return [(e, replace(e, statements=(TextReader(errors[e.number]).statement(),))) for e in found]


@lru_cache(maxsize=2 * len(FILES))
def verdicts(file: Path, planted: bool) -> list[tuple[Printed, Verdict]]:
    """The verdicts on the formulas of a file, or on those with an error, beside the formulas that are right."""
    shared: dict[tuple[str, int], RandomMotion] = {}
    return [(right, audit_equation(wrong if planted else right, shared)) for right, wrong in formulas(file)]


def _all(planted: bool) -> list[tuple[str, Printed, Verdict]]:
    return [(f"{file.stem} {right.number}", right, row) for file in FILES for right, row in verdicts(file, planted)]


def right() -> list[Found]:
    """Right formulas that are called misprints; those that cannot be judged; how many are lacking."""
    rows = _all(planted=False)
    wrong = [name for name, _, row in rows if row.verdict in ("MISPRINT", "AMBIGUOUS")]
    open_ = [name for name, _, row in rows if row.verdict == "CANNOT JUDGE"]
    partial = [name for name, _, row in rows if row.verdict == "INCOMPLETE"]
    return [Found(len(wrong), quantity="right, called wrong", note=", ".join(wrong)),
            Found(len(open_), len(rows) / 10, quantity="right, cannot be judged", note=", ".join(open_)),
            Found(max(0, LEAST - len(rows)), quantity="too few", note=f"{len(rows)} formulas; not defined where a length is 0: "
                  + ", ".join(partial))]


def domains() -> list[Found]:
    """Formulas that hold on a domain alone: those that are not called RIGHT there; errors planted in them that are called RIGHT,
    and those that are not mended."""
    file = FILES[[f.stem for f in FILES].index("domains")]
    open_ = [right.number for right, row in verdicts(file, False) if row.verdict != "RIGHT"]
    planted = verdicts(file, True)
    cleared = [right.number for right, row in planted if row.verdict == "RIGHT"]
    unmended = [right.number for right, row in planted if not _mended(right, row)]
    return [Found(len(open_), len(planted) / 10, quantity="right, not called so", note=", ".join(open_)),
            Found(len(cleared), quantity="errors called right", note=", ".join(cleared)),
            Found(len(unmended), len(planted) / 8, quantity="errors not mended", note=", ".join(unmended))]


def errors() -> list[Found]:
    """Planted errors that are not found; and those that no repair mends by the term that was right."""
    rows = _all(planted=True)
    missed = [name for name, _, row in rows if row.verdict != "MISPRINT"]
    unmended = [name for name, right, row in rows if not _mended(right, row)]
    return [Found(len(missed), quantity="not found", note=", ".join(missed)),
            Found(len(unmended), len(rows) / 6, quantity="not mended by the term that was right", note=", ".join(unmended))]


def _mended(right: Printed, row: Verdict) -> bool:
    """Whether the repaired formula has the terms of the right one, side by side."""
    if row.repaired is None:
        return False
    states = ComparedStates(right, right.inner or "l").joint[1], ComparedStates(row.repaired, right.inner or "l").joint[1]
    return _terms(right.statements[0], states[0]) == _terms(row.repaired.statements[0], states[1])


def _terms(statement: Relation, env: Env) -> list[list[str]]:
    return [sorted(str(np.round(np.ravel(v), 6) + 0.0) for v in _values(side, env, 1)) for side in statement.sides]


def _values(node: Node, env: Env, sign: int) -> list[Any]:
    """Values of the terms of a formula, its products expanded."""
    parts = node.parts
    if node.kind == "neg":
        return _values(parts[0], env, -sign)
    if node.kind in ("sum", "block", "row"):
        return [v for p in parts for v in _values(p, env, sign)]
    sums = [i for i, p in enumerate(parts) if p.kind == "sum"] if node.kind == "product" else []
    if sums:
        i = sums[0]
        return [v for p in parts[i].parts for v in _values(node.with_parts((*parts[:i], p, *parts[i + 1 :])), env, sign)]
    return [sign * np.asarray(evaluate(node, env))]


def cases() -> list[Case]:
    return [Case("right formulas", "none", right, slow=True), Case("planted errors", "none", errors, slow=True),
            Case("domains", "none", domains, slow=True)]
