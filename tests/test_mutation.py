"""The tool of `validation/mutation`: what it changes in a source, and that its lists fit this checkout."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from mutation.areas import AREAS
from mutation.judge import Copy, drawn
from mutation.mutators import is_valid, mutants
from mutation.page import table

ROOT = Path(__file__).resolve().parent.parent
STATED = json.loads((ROOT / "validation" / "mutation" / "stated.json").read_text(encoding="utf-8"))
PYTHON = '''"""a + b < 1"""


def f(a: int = 1) -> float:
    """a < 1"""
    if a < 2 and not g(a):
        h(a)
        a -= -3
    x[0] = f"{a + 1}"
    return a * "é" + a / 4.5
'''
C = "/* a < b */\nint f(double *x) {\n    x[0] += 2.5;\n    return x[0] < 1 && g(x); // a < b\n}\n"


def changed(text: str, name: str) -> set[tuple[str, str]]:
    """The pieces that mutants change, with what takes their place."""
    return {(m.old, m.new) for m in mutants(text, name)}


def test_mutants_of_python():
    condition = "a < 2 and not g(a)"
    assert changed(PYTHON, "f.py") == {
        ("1", "2"), ("<", "<="), ("and", "or"), ("not ", ""), ("2", "3"), (condition, f"not ({condition})"), ("h(a)", "pass"),
        ("a -= -3", "pass"), ("-", ""), ("3", "4"), ('x[0] = f"{a + 1}"', "pass"), ("0", "1"), ("+", "-"), ("/", "*"),
        ("4.5", "5.5")}  # fmt: skip
    assert all(is_valid(m.applied(PYTHON), "f.py") for m in mutants(PYTHON, "f.py"))


def test_mutants_of_c_leave_comments_alone():
    operators = {(" < ", " <= "), (" && ", " || "), (" += ", " -= ")}
    assert changed(C, "f.c") == operators | {("x[0] += 2.5;", ";"), ("2.5", "3.5"), ("1", "2")}


def test_the_same_seed_draws_the_same_mutants_of_every_area():
    one, again = (drawn(list(AREAS), ROOT, 30, 3) for _ in range(2))
    assert one == again
    assert {area.name for area, _, _ in one} == {area.name for area in AREAS}


@pytest.mark.parametrize("area", AREAS, ids=lambda area: area.name)
def test_areas_name_sources_and_tests_that_exist(area):
    assert area.files(ROOT)
    assert all((ROOT / name).is_file() for name in area.test_files(ROOT))


@pytest.mark.parametrize("one", STATED, ids=lambda one: one["name"])
def test_stated_mistakes_still_fit_the_package(one):
    """Whoever changes a line that one of them changes states it anew."""
    text = (ROOT / one["file"]).read_text(encoding="utf-8")
    assert text.count(one["old"]) == 1
    assert is_valid(text.replace(one["old"], one["new"]), one["file"])
    assert all((ROOT / "tests" / name).is_file() for name in one["tests"])


def test_a_test_that_passes_and_one_that_fails(tmp_path):
    copy = Copy(tmp_path, tmp_path)
    (tmp_path / "test_it.py").write_text("import sys\n\n\ndef test_it():\n    assert 1 < 2\n", encoding="utf-8")
    assert copy.tested(["test_it.py"])[0] == ""
    (tmp_path / "test_it.py").write_text("def test_it():\n    assert 1 > 2\n", encoding="utf-8")
    assert copy.tested(["test_it.py"])[0] == "FAILED test_it.py::test_it"


def test_the_table_counts_and_names_survivors():
    said = {"area": "laws", "file": "mbdae/a.py", "line": 3, "old": "<", "new": "<="}
    found = table([said | {"killed": "FAILED tests/test_a.py::test"}, said | {"killed": ""}])
    assert "| laws | 2 | 1 | 50 % |" in found
    assert "- `mbdae/a.py`: `<` -> `<=`" in found
