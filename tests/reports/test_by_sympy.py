"""Equations drawn from the reports of every law, of both levels, and judged by SymPy alone. A failure prints the seed that drew
equations and states; MBDAE_SEED repeats it."""

from __future__ import annotations

import json
import os
import random
import sys
from pathlib import Path

import pytest

import mbdae as mb
from mbdae.documents.blocks import Equation, every
from mbdae.reports import names

sys.path.insert(0, str(Path(__file__).parent))

from by_sympy import counts, judged, symbols_of

SEED = int(os.environ.get("MBDAE_SEED", random.SystemRandom().randrange(10**6)))
DRAWN = 30  #: of every law, or all that can be judged
#: laws of which the print leaves nothing to this judge: nodes without inertia, loads by elements, two trees in one report
WITHOUT = {"beamnode", "lineload", "recursive"}
#: by law and level: equations judged, only stated, not readable; a report that changes on purpose changes them here
COUNTS = json.loads((Path(__file__).parent / "judged.json").read_text(encoding="utf-8"))


def read(name, level):
    """Equations of a report with their verdicts; asserts that as many as ever are judged and read."""
    document = mb.report(name, level=level)
    found = list(judged(document, symbols_of(document), SEED))
    unread = [latex for latex, verdict in found if verdict is None]
    assert counts([verdict for _, verdict in found]) == COUNTS[name][level], f"cannot be read: {unread}"
    return found


def drawn(name, level, count=DRAWN):
    """Judged equations of a report: (LaTeX, whether it holds)."""
    found = [each for each in read(name, level) if each[1] in (True, False)]
    return random.Random(f"{SEED} {name}").sample(found, min(count, len(found)))


def test_the_counts_of_every_law_are_known():
    assert {*names()} == {*COUNTS}


@pytest.mark.parametrize(("name", "level", "least"), [
    ("revolute", "lecture", 6), ("cylindrical", "lecture", 10), ("spherical", "lecture", 4),
    ("screw", "lecture", 9), ("classical", "full", 30),
    ("pointspring", "full", 6), ("rigidbody", "full", 6), ("rolling", "lecture", 6), ("beam", "full", 5),
])
def test_equations_drawn_from_reports_hold(name, level, least):
    found = drawn(name, level)
    assert len(found) >= least
    assert [latex for latex, holds in found if not holds] == [], f"MBDAE_SEED={SEED}"


@pytest.mark.slow
@pytest.mark.parametrize("name", names())
def test_thirty_equations_of_every_law_hold(name):
    found = [(level, *each) for level in ("lecture", "full") for each in drawn(name, level, 10**6)]
    assert found or name in WITHOUT
    chosen = random.Random(f"{SEED} {name}").sample(found, min(DRAWN, len(found)))
    assert [(level, latex) for level, latex, holds in chosen if not holds] == [], f"MBDAE_SEED={SEED}"


@pytest.mark.parametrize(("name", "level", "left", "old", "new"), [
    ("pointspring", "full", r"\mathbf{f}_l", "k +", "k -"), ("cylindrical", "lecture", r"\mathbf{x}_l", r"\sin", r"\cos"),
    ("cylindrical", "lecture", r"\mathbf{f}_l", "_k", "_l"), ("rolling", "full", r"\mathbf{m}_l", r"\rho", r"2\,\rho"),
    ("rigidbody", "full", "m_x", "+ ", "- "), ("beam", "full", r"\mathbf{q}", " + ", " - "),
])
def test_a_wrong_equation_is_judged_wrong(name, level, left, old, new):
    document = mb.report(name, level=level)
    equation = next(e for e in every(Equation, document.blocks) if e.latex.startswith(f"{left} = "))
    assert old in equation.latex
    object.__setattr__(equation, "latex", f"{left} = " + equation.latex.removeprefix(f"{left} = ").replace(old, new, 1))
    assert False in [holds for _, holds in judged(document, symbols_of(document), SEED)]


@pytest.mark.parametrize(("name", "level", "left", "old", "new"), [
    ("pointspring", "full", r"\mathbf{f}_l", "k +", r"\text{stray} +"),  # a symbol without a meaning
    ("revolute", "lecture", r"\mathbf{f}_l", r"\boldsymbol{\lambda}", r"\boldsymbol{\mu}"),
    ("rolling", "full", r"\mathbf{b}", r"\rho", r"\rho^"),  # a part of others
])
def test_an_equation_that_cannot_be_read_is_counted(name, level, left, old, new):
    document = mb.report(name, level=level)
    equation = next(e for e in every(Equation, document.blocks) if e.latex.startswith(f"{left} = "))
    object.__setattr__(equation, "latex", f"{left} = " + equation.latex.removeprefix(f"{left} = ").replace(old, new, 1))
    found = counts([verdict for _, verdict in judged(document, symbols_of(document), SEED)])
    assert sum(found) == sum(COUNTS[name][level])
    assert found[2] > COUNTS[name][level][2]
