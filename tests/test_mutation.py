"""The tool of `validation/mutation`: what it changes in a source, and that its lists fit this checkout."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from mutation.areas import AREAS, Area
from mutation.covers import Covers, Enclosing, measure
from mutation.judge import Copy, drawn
from mutation.mutators import Mutant, is_valid, mutants
from mutation.page import table

ROOT = Path(__file__).resolve().parent.parent
STATED = json.loads((ROOT / "validation" / "mutation" / "stated.json").read_text(encoding="utf-8"))
EQUIVALENT = json.loads((ROOT / "validation" / "mutation" / "equivalent.json").read_text(encoding="utf-8"))
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
        ("4.5", "5.5")}
    assert all(is_valid(m.applied(PYTHON), Path("f.py")) for m in mutants(PYTHON, "f.py"))


def test_what_changes_nothing_is_no_mutant():
    assert not changed("@d(1)\nclass Rod:\n    def __repr__(self):\n        return 1 + 2\n", "f.py")
    assert changed("for a, b in zip(c, d, strict=True):\n    pass\n", "f.py") == set()
    assert (">", ">=") not in changed("se.Piecewise((p, p > 0), (0, True))", "f.py")
    assert (">", ">=") not in changed("se.Piecewise((v, v > 0), (-v, True))", "f.py")
    assert (">", ">=") in changed("se.Piecewise((1, v > 0), (-1, True))", "f.py")


def test_c_that_does_not_compile_is_no_mutant():
    place = ROOT / "mbdae" / "native" / "version.c"
    assert is_valid(place.read_text(encoding="utf-8"), place)
    assert shutil.which("cc") is None or not is_valid("int f(double *x) { return *x", place)


def test_mutants_of_c_leave_comments_alone():
    operators = {(" < ", " <= "), (" && ", " || "), (" += ", " -= ")}
    assert changed(C, "f.c") == operators | {("x[0] += 2.5;", ";"), ("2.5", "3.5"), ("1", "2")}


def test_the_same_seed_draws_the_same_mutants_of_every_area():
    few = [area for area in AREAS if area.name in ("contact", "friction", "elements")]
    one, again = (drawn(few, ROOT, 30, 3) for _ in range(2))
    assert one == again
    assert {area.name for area, _, _ in one} == {area.name for area in few}


SOURCE = """LIMIT = 2


def f(x):
    if x > 1:
        return g(
            x + 1)
    return x


def h(x):
    return x < LIMIT
"""


@pytest.mark.parametrize(("old", "expected", "names"), [
    ("2", [1], {"LIMIT"}), ("> 1", [5], set()), ("x + 1", [6, 7], set()), ("return x\n", [8], set())])
def test_the_statement_around_a_mistake(old, expected, names):
    """Of a condition its head."""
    at = SOURCE.index(old)
    found = Enclosing(SOURCE, Mutant(at, at + len(old), old, ""))
    assert (list(found.lines), found.names) == (expected, names)


def test_tests_that_execute_a_mistake_come_first_the_cheapest_before(tmp_path):
    """Run once without mistakes; of a constant, those that execute a line with its name."""
    pytest.importorskip("coverage")
    tests = {"f": "assert f(3) == 4 and f(1) == 1", "g": "assert f(0) == 0", "h": "assert h(1)"}
    (tmp_path / "mbdae").mkdir()
    (tmp_path / "mbdae" / "__init__.py").touch()
    (tmp_path / "tests").mkdir()
    source = tmp_path / "mbdae" / "source.py"
    source.write_text(SOURCE.replace("g(", "abs("), encoding="utf-8")
    body = "".join(f"def test_{name}():\n    {line}\n\n\n" for name, line in tests.items())
    (tmp_path / "tests" / "test_it.py").write_text("from mbdae.source import f, h\n\n\n" + body, encoding="utf-8")
    measure(tmp_path, tmp_path / "covers", ["tests/test_it.py"], 1)
    covers, area = Covers(tmp_path, tmp_path / "covers"), Area("one", 1, ("source.py",), ("test_it.py",))

    def order(old):
        at = source.read_text(encoding="utf-8").index(old)
        return [test.split("::test_")[1] for test in covers.order(area, source, Mutant(at, at + len(old), old, ""))]

    assert order("x + 1")[0] == "f"
    assert set(order(" > ")[:2]) == {"f", "g"}
    assert order("2")[0] == "h"


@pytest.mark.parametrize("area", AREAS, ids=lambda area: area.name)
def test_areas_name_sources_and_tests_that_exist(area):
    assert area.files(ROOT)
    assert all((ROOT / name).is_file() for name in area.test_files(ROOT))


@pytest.mark.parametrize("one", STATED, ids=lambda one: one["name"])
def test_stated_mistakes_still_fit_the_package(one):
    """Whoever changes a line that one of them changes states it anew."""
    text = (ROOT / one["file"]).read_text(encoding="utf-8")
    assert text.count(one["old"]) == 1
    assert is_valid(text.replace(one["old"], one["new"]), ROOT / one["file"])
    assert all((ROOT / "tests" / name).is_file() for name in one["tests"])


def test_a_test_that_passes_and_one_that_fails(tmp_path):
    copy = Copy(tmp_path, tmp_path)
    (tmp_path / "test_it.py").write_text("import sys\n\n\ndef test_it():\n    assert 1 < 2\n", encoding="utf-8")
    assert copy.tested(["test_it.py"], 60)[0] == ""
    (tmp_path / "test_it.py").write_text("def test_it():\n    assert 1 > 2\n", encoding="utf-8")
    assert copy.tested(["test_it.py"], 60)[0] == "FAILED test_it.py::test_it"


def test_the_table_counts_and_names_survivors():
    said = {"area": "laws", "file": "mbdae/a.py", "line": 3, "code": "a < b", "old": "<", "new": "<="}
    known = {key: said[key] for key in ("file", "code", "old", "new")} | {"why": "a and b are never equal"}
    killed = said | {"killed": "FAILED tests/test_a.py::test"}
    found = table([killed, said | {"killed": ""}, said | {"killed": "", "new": ">"}], [known])
    assert "| laws | 3 | 1 | 1 | 50 % |" in found
    assert "- `mbdae/a.py`, `a < b`: `<` -> `<=`: a and b are never equal" in found
    assert "- `mbdae/a.py`, `a < b`: `<` -> `>`\n" in found


@pytest.mark.parametrize("one", EQUIVALENT, ids=lambda one: f"{one['code']}: {one['new']}")
def test_equivalent_mutants_still_fit_the_package(one):
    text = (ROOT / one["file"]).read_text(encoding="utf-8")
    found = [m for m in mutants(text, one["file"]) if (m.code(text)[0], m.old, m.new) == (one["code"], one["old"], one["new"])]
    assert found
