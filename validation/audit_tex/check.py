"""Papers of mechanics in TeX and Markdown: their displays are read, right ones are not blamed, planted errors are not cleared."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from runner import Case, Claim, Found

import mbdae as mb
from mbdae.audit import Audit
from mbdae.audit.compare import ComparedStates, difference
from mbdae.audit.evaluate import attempt
from mbdae.audit.meanings import Paper
from mbdae.audit.reading import Printed
from mbdae.audit.verdicts import Row, audit_equation
from mbdae.documents.blocks import tokens
from mbdae.documents.displays import Display, displays

claim = Claim("audit_tex", "papers in TeX: displays are read, right ones not blamed, planted errors not cleared", 0, "formulas",
              "the paper on revolute joints, a double pendulum, a slider-crank, an elastic beam that is struck")
FOLDER = Path(__file__).parent
PAPERS = ("paper.tex", "pendulum.tex", "crank.md", "contact.tex")
PLANTED = 30  #: errors planted in each paper
SWAPS = {r"\sin": r"\cos", r"\cos": r"\sin"}


@lru_cache(maxsize=len(PAPERS))
def audited(name: str) -> Audit:
    """The audit of a paper as it is printed."""
    return mb.audit(FOLDER / name)


@lru_cache(maxsize=len(PAPERS))
def shown(name: str) -> list[Display]:
    """The displays of a paper."""
    return displays((FOLDER / name).read_text(encoding="utf-8"), markdown=name.endswith(".md"))


def equations(name: str, changed: dict[int, str]) -> list[Printed]:
    """The equations of a paper in which some displays, by their place, have another TeX."""
    table = (FOLDER / name).with_suffix(".meanings")
    found = [replace(d, latex=changed.get(i, d.latex)) for i, d in enumerate(shown(name))]
    return list(Paper(found, name, table.read_text(encoding="utf-8"), table.name).read_paper().equations)


# -- errors planted in TeX


def errors(latex: str) -> Iterator[tuple[str, str]]:
    """Errors of one place of a display: the kind and the TeX with it."""
    parts, depth = tokens(latex), 0
    scripts = list[bool]()  # whether a token stands in an index or an exponent
    for i, token in enumerate(parts):
        before = parts[i - 1] if i else ""
        if token == "{":
            scripts.append(before in ("_", "^"))
        elif token == "}" and scripts:
            scripts.pop()
        depth = sum(scripts)

        def put(new: str, count: int = 1, at: int = i) -> str:
            return "".join([*parts[:at], new, *parts[at + count :]])

        if token in "+-" and not depth and before not in ("_", "^"):
            yield "sign", put("-" if token == "+" else "+")
        if token in SWAPS:
            yield "sin for cos", put(SWAPS[token])
        if token == "_" and parts[i + 1 : i + 2] and parts[i + 1] in "12":
            yield "index", put("12"["21".index(parts[i + 1])], at=i + 1)
        if token == "^" and parts[i + 1 : i + 2] and parts[i + 1] in ("k", r"\ell"):
            yield "index", put("k" if parts[i + 1] == r"\ell" else r"\ell ", at=i + 1)
        if token == "^" and parts[i + 1 : i + 2] and parts[i + 1] in "23":
            yield "power", put("5", at=i + 1)
            yield "power", put("", 2)
        if token in "2346" and not depth and before not in ("_", "^"):
            yield "factor", put("5")
        if token == "=" and not depth and parts[i + 1 : i + 2] != ["0"] and "0" not in "".join(parts[i + 1 :]).strip()[:1]:
            sign = re.match(r"\s*&?\s*[-+]", "".join(parts[i + 1 :]))
            if sign is None:
                yield "factor", put("= 2")
    yield from without_terms(latex)


def without_terms(latex: str) -> Iterator[tuple[str, str]]:
    """A display without one of its terms."""
    parts, depth, starts = tokens(latex), 0, list[int]()
    levels = list[int]()
    for token in parts:
        depth -= token in ("}", ")", "]", r"\right", r"\end")
        levels.append(depth)
        depth += token in ("{", "(", "[", r"\left", r"\begin")
    starts = [i for i, t in enumerate(parts) if t in "+-" and not any(p in ("_", "^") for p in parts[max(0, i - 2) : i])]
    for i in starts:
        end = next((j for j in range(i + 1, len(parts)) if levels[j] < levels[i] or (levels[j] == levels[i] and parts[j] in (
            "+", "-", "=", ",", r"\\", "&", r"\quad", r"\qquad", r"\end"))), len(parts))
        before = "".join(parts[:i]).rstrip(" &\n")
        if before and before[-1] not in "=({[" and not before.endswith((r"\left", r"\\")):
            yield "missing term", "".join([*parts[:i], *parts[end:]])


def changes(right: Printed, wrong: Printed) -> bool:
    """Whether an error changes the value of a side in states of motion in which the joint of the text holds. One that does not,
    such as one of two coinciding axes for the other, is none."""
    for a, b in zip(right.statements, wrong.statements, strict=True):
        for x, y in zip(a.sides, b.sides, strict=True):
            for env in ComparedStates(right, right.inner or "l").joint:
                before, after = attempt(x, env), attempt(y, replace(env, scope=wrong.scope, store={}))
                if after is None or before is None or np.shape(after) != np.shape(before) or difference(before, after) > 1e-6:
                    return True
    return False


def plants(name: str, count: int, seed: int = 1) -> Iterator[tuple[str, Printed, Printed]]:
    """Errors planted in displays that are right, each with its kind and the right equation; every kind as often as it can be.
    An index that makes a letter which the paper does not have is none: it is said that nothing tells what that is."""
    rng = np.random.default_rng(seed)
    right = {e.number: e for e in equations(name, {})}
    fine = {row.equation for row in audited(name).equations if row.verdict == "RIGHT"}
    kinds: dict[str, list[tuple[int, str]]] = {}
    for i, display in enumerate(shown(name)):
        for kind, latex in errors(display.latex):
            kinds.setdefault(kind, []).append((i, latex))
    for places in kinds.values():
        rng.shuffle(places)
    while count and any(kinds.values()):
        for kind in sorted(kinds):
            if not kinds[kind] or not count:
                continue
            i, latex = kinds[kind].pop()
            wrong = [e for e in equations(name, {i: latex}) if e.place == f"{name}:{shown(name)[i].line}"]
            pairs = [(right[e.number], e) for e in wrong if e.number in right and e.number in fine]
            pairs = [(a, b) for a, b in pairs if (b.statements or kind != "index") and a.text != b.text and (
                not b.statements or changes(a, b))]
            if pairs:
                count -= 1
                yield kind, *pairs[0]


@lru_cache(maxsize=len(PAPERS))
def judged(name: str) -> list[tuple[str, Printed, Row]]:
    """The verdicts on the planted errors of a paper."""
    shared: dict[tuple[str, int, str], object] = {}
    return [(kind, right, audit_equation(wrong, shared)) for kind, right, wrong in plants(name, PLANTED)]  # type: ignore[arg-type]


# -- cases


def read() -> list[Found]:
    """Displays that cannot be read, at most a tenth of each paper."""
    found = []
    for name in PAPERS:
        rows = audited(name).equations
        unread = [row.printed.place for row in rows if not row.printed.statements]
        found.append(Found(len(unread), len(rows) / 10, quantity=f"{name}: not read of {len(rows)}", note=", ".join(unread)))
    return found


def right() -> list[Found]:
    """Right displays that are called wrong or cannot be judged."""
    found = []
    for name in PAPERS[1:]:
        rows = audited(name).equations
        other = [f"({row.equation}) {row.verdict}" for row in rows if row.verdict != "RIGHT"]
        found.append(Found(len(other), quantity=f"{name}: right, not called so", note=", ".join(other)))
    return found


def as_in_the_notation() -> list[Found]:
    """Verdicts and repairs of the paper in TeX that differ from those of its formulas in the notation of audits."""
    notation, tex = mb.audit(FOLDER.parent / "paper" / "paper.audit"), audited("paper.tex")
    verdicts = [row.equation for row in tex.equations if row.verdict != notation[row.equation].verdict]
    repairs = [row.equation for row in tex.equations if (row.repaired is None) != (notation[row.equation].repaired is None)]
    return [Found(len(verdicts), quantity="verdicts", note=", ".join(verdicts)),
            Found(len(repairs), quantity="repairs", note=", ".join(repairs))]


def planted() -> list[Found]:
    """Planted errors that are called right; that cannot be judged, at most a tenth; that are not mended by the term that was
    right, at most a quarter."""
    found = []
    for name in PAPERS:
        rows = judged(name)
        cleared = [f"({row.equation}) {kind}: {row.printed.tex}" for kind, _, row in rows if row.verdict == "RIGHT"]
        undecided = [f"({row.equation}) {kind}: {row.remark}" for kind, _, row in rows if row.verdict == "CANNOT JUDGE"]
        unmended = [f"({row.equation}) {kind}" for kind, a, row in rows if row.repaired is None or changes(a, row.repaired)]
        found += [Found(len(cleared), quantity=f"{name}: cleared of {len(rows)}", note="; ".join(cleared)),
                  Found(max(0, PLANTED - len(rows)), quantity=f"{name}: too few planted"),
                  Found(len(undecided), PLANTED / 10, quantity=f"{name}: undecided", note="; ".join(undecided)),
                  Found(len(unmended), PLANTED / 4, quantity=f"{name}: not mended", note=", ".join(unmended))]
    return found


def cases() -> list[Case]:
    return [Case("displays read", "none", read, slow=True), Case("right displays", "none", right, slow=True),
            Case("the paper", "none", as_in_the_notation, slow=True), Case("planted errors", "none", planted, slow=True)]
