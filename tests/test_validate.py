"""Every claim of validation/ holds; the command `validate` says so, and needs a checkout."""

from __future__ import annotations

import json
import math
import re
import shutil
import tomllib
from pathlib import Path

import pytest
import runner
from runner import Case, Claim, Found, Row, measure

from mbdae.cli import main
from mbdae.cli.userfile import find

ROOT = Path(__file__).resolve().parent.parent
FOLDER = find(ROOT)
NAMES = runner.claims(FOLDER)
CHECKS = {name: runner.load(FOLDER, name) for name in NAMES}
CASES = [pytest.param(check.claim, case, id=f"{name}: {case.name}, {case.solver}", marks=[pytest.mark.slow] * case.slow)
         for name, check in CHECKS.items() for case in check.cases()]  # fmt: skip
STATED = """
from runner import Case, Claim, Found, measure

claim = Claim("{name}", "a statement < with signs", 1e-3, "m", "made up | for the test")


def cases():
    return [Case("one", "none", lambda: [Found({error}, quantity="first", note="said"), Found(2.0, 3.0, "s", "second")])]


def run():
    return measure(claim, cases())
"""


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A checkout with the claims `right` and `wrong`; the test runs below it."""
    for name, error in (("right", 1e-4), ("wrong", math.pi)):
        folder = tmp_path / "validation" / name
        folder.mkdir(parents=True)
        (folder / "check.py").write_text(STATED.format(name=name, error=error))
    shutil.copytree(FOLDER / "runner", tmp_path / "validation" / "runner")
    (tmp_path / "below").mkdir()
    monkeypatch.chdir(tmp_path / "below")
    return tmp_path


@pytest.mark.parametrize(("claim", "case"), CASES)
def test_case_is_within_its_tolerance(claim: Claim, case: Case) -> None:
    rows = measure(claim, [case])
    assert rows
    for row in rows:
        print(row)
        assert row.met, row


@pytest.mark.parametrize("name", NAMES)
def test_claim_says_what_it_is(name: str) -> None:
    claim = CHECKS[name].claim
    assert all((claim.statement, claim.unit, claim.origin))
    assert claim.tolerance >= 0
    readme = (FOLDER / name / "README.md").read_text(encoding="utf-8")
    assert readme.startswith(f"# {name}\n")
    for heading in ("Problem", "Reference", "Tolerance", "How it is checked"):
        assert f"## {heading}\n" in readme, heading
    assert f"[{name}]({name}/README.md)" in (FOLDER / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*/reference.json")), ids=lambda path: path.parent.name)
def test_reference_says_where_it_comes_from(path: Path) -> None:
    assert {"title", "tolerance"} & set(json.loads(path.read_text(encoding="utf-8")))
    assert path.parent.name in NAMES


def test_a_claim_that_holds_ends_with_0(checkout, capsys):
    assert main(["validate", "right"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"one: first +none +1\.00e-04 +1e-03 +m +yes", out)
    assert re.search(r"one: second +none +2\.00e\+00 +3 +s +yes", out)
    assert "all 1 hold" in out


def test_all_claims_and_one_that_does_not_hold_end_with_1(checkout, capsys):
    assert main(["validate"]) == 1
    out = capsys.readouterr().out
    assert "right: holds" in out
    assert "wrong: DOES NOT HOLD" in out
    assert "1 of 2 do not hold: wrong" in out


def test_json_stands_alone(checkout, capsys):
    assert main(["validate", "wrong", "right", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert not data["holds"]
    assert [(entry["claim"], entry["holds"]) for entry in data["claims"]] == [("wrong", False), ("right", True)]
    assert set(data["claims"][0]["rows"][0]) == {"case", "solver", "error", "tolerance", "unit", "met", "cpu_s", "note"}


def test_pages_carry_everything_and_refer_to_nothing(checkout, capsys):
    assert main(["validate", "--out", "pages"]) == 1
    pages = checkout / "below" / "pages"
    markdown, html = ((pages / f"validation.{ending}").read_text(encoding="utf-8") for ending in ("md", "html"))
    for page in (markdown, html):
        assert "1 of 2 do not hold: wrong" in page
        assert "one: first" in page
        assert "said" in page
        assert "made up" in page
    assert "a statement &lt; with signs" in html
    assert not re.search(r"(src|href)=|https?:", html)
    assert {path.name for path in (checkout / "below").iterdir()} == {"pages"}


def test_unknown_claim_ends_with_2_and_names_the_known_ones(checkout, capsys):
    assert main(["validate", "right", "absent"]) == 2
    assert "there is no claim 'absent': choose from right, wrong" in capsys.readouterr().err


def test_outside_a_checkout_it_says_what_to_do(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["validate"]) == 2
    assert "run this in a clone of mbdae's repository, or name one by --root" in capsys.readouterr().err
    assert main(["validate", "--root", str(tmp_path)]) == 2
    assert f"no folder validation/ with claims in {tmp_path}" in capsys.readouterr().err


def test_claims_without_their_runner_are_told(checkout, capsys):
    shutil.rmtree(checkout / "validation" / "runner")
    assert main(["validate", "right"]) == 2
    assert f"{checkout / 'validation'} has claims, but no folder runner/" in capsys.readouterr().err


def test_root_names_another_checkout(checkout, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir("/")
    assert main(["validate", "right", "--root", str(checkout)]) == 0


def test_a_case_that_fails_is_a_row_with_its_reason():
    def fail() -> Found:
        raise ZeroDivisionError("no")

    claim = Claim("c", "s", 1.0, "m", "o")
    first, second = measure(claim, [Case("bad", "x", fail), Case("good", "x", lambda: Found(0.5))])
    assert (first.met, second.met) == (False, True)
    assert first.note == "failed: ZeroDivisionError: no"
    assert first.to_dict()["error"] is None
    assert runner.Measured(claim, [second]).holds
    assert not runner.Measured(claim, [first, second]).holds
    assert not runner.Measured(claim, []).holds
    assert isinstance(first, Row)


def test_the_wheel_does_not_carry_or_need_validation():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert settings["packages"] == ["mbdae"]
    shared = {"runner", *(path.stem for path in FOLDER.glob("*.py"))}
    for path in (ROOT / "mbdae").rglob("*.py"):
        used = set(re.findall(r"^\s*(?:from|import) (\w+)", path.read_text(encoding="utf-8"), re.MULTILINE))
        assert not used & {"validation", *shared}, path
