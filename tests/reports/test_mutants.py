"""Seeded edits of the package change a report, and a check or the stored numbers of the laws say so."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from mutants import MUTANTS, ROOT, judged
from values import all_values, differing

PLAIN: dict = {}


def test_equations_of_laws_are_those_stored():
    """A law that changes on purpose writes the file anew: python tests/reports/values.py."""
    assert differing(all_values()) == []


def test_there_are_sixty_mutants():
    assert len(MUTANTS) >= 60
    assert len({(file, old, new) for file, old, new, _ in MUTANTS}) == len(MUTANTS)
    assert [file for file, old, _, _ in MUTANTS if (ROOT / file).read_text(encoding="utf-8").count(old) != 1] == []


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(MUTANTS)))
def test_mutants_are_seen(number):
    changed, _, failed = judged(number, PLAIN)
    assert changed
    assert failed
