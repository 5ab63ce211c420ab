"""Every claim of validation/ holds; the command `validate` says so, and needs a checkout."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import runner
from runner import Case, Claim, Draw, Found, Parts, Row, allowed, measure

from mbdae.cli import main
from mbdae.cli.userfile import find

ROOT = Path(__file__).resolve().parent.parent
FOLDER = find(ROOT)
NAMES = runner.claims(FOLDER)
CHECKS = {name: runner.load(FOLDER, name) for name in NAMES}
CASES = [pytest.param(check.claim, case, id=f"{name}: {case.name}, {case.solver}", marks=[pytest.mark.slow] * case.slow)
         for name, check in CHECKS.items() for case in check.cases()]
STATED = """
from runner import Case, Claim, Found

claim = Claim("{name}", "a statement < with signs", 1e-3, "m", "made up | for the test")


def cases():
    return [Case("one", "none", lambda: [Found({error}, quantity="first", note="said"), Found(2.0, 3.0, "s", "second")])]
"""
SUITE = """
import os

from runner import Case, Claim, Found

claim = Claim("{name}", "a suite of forty parts", 0.0, "parts", "made up for the test")


def measured(parts):
    return Found(0, note=", ".join(str(part) for part in parts))


def single(part):
    return Found(0) if part != "b" else 1 / 0


def cases():
    return [Case("parts", "none", measured, parts=range(40)), Case("letters", "none", single, parts="ab", each=True)]
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
    rows = measure(claim, [case], Draw(0))  # of suites the tenth of this seed; `mbdae validate` draws others
    assert rows
    for row in rows:
        print(row)
        assert row.met, row


@pytest.mark.parametrize("name", NAMES)
def test_claim_says_what_it_is(name: str) -> None:
    claim = CHECKS[name].claim
    for suite in (case for case in CHECKS[name].cases() if case.parts):
        assert suite.slow
        assert len({str(part) for part in suite.parts}) == len(suite.parts)
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


@pytest.mark.parametrize("size", [1, 9, 10, 11, 25, 600])
def test_a_draw_is_a_tenth_at_least_and_repeats_by_its_seed(size: int) -> None:
    parts = [f"part {i}" for i in range(size)]
    drawn = Draw(17).of("claim: case", parts)
    assert list(drawn) == list(Draw(17).of("claim: case", parts)) == sorted(set(drawn), key=parts.index)
    assert size / 10 <= len(drawn) < size / 10 + 1
    assert drawn.whole == size
    if size == 600:
        assert list(drawn) != list(Draw(18).of("claim: case", parts)) != list(Draw(18).of("claim: another", parts))
        assert len({part for seed in range(100) for part in Draw(seed).of("claim: case", parts)}) == size  # 600 * 0.9^100 = 0.02


def test_a_share_of_a_draw_is_allowed_what_chance_makes_of_it_and_no_more():
    """18 of 600 are claimed: of 60 drawn of these, hardly ever more than is allowed; of a suite with 90 nearly always."""
    assert allowed(0.03, range(600)) == allowed(0.03, Parts(range(600), 600)) == 0.03
    most = allowed(0.03, Draw(0).of("s", range(600)))
    assert 0.03 < most < 0.15
    draws = [np.array(Draw(seed).of("s", range(600))) for seed in range(300)]
    shares = {bad: np.array([np.mean(drawn < bad) for drawn in draws]) for bad in (18, 150)}
    assert np.sum(shares[18] > most) <= 3  # at most 0.3 are expected: more than 3 by a chance of 3e-4
    assert np.mean(shares[150] > most) > 0.9


def test_a_part_that_fails_is_named_and_measured_alone():
    def one(parts: list[int]) -> Found:
        return Found(float(sum(1 / (part - 7) for part in parts)), 1e9)

    claim = Claim("c", "s", 1.0, "m", "o")
    case = Case("numbers", "x", one, parts=range(20))
    (row,) = measure(claim, [case])
    assert (row.met, row.case, row.note) == (False, "20 numbers", "failed at 7: ZeroDivisionError: division by zero")
    alone = measure(claim, [case, Case("other", "x", lambda: Found(0))], Draw(0, ("3", "4")))
    assert [row.case for row in alone] == ["2 of 20 numbers"]


@pytest.fixture
def suites(checkout):
    """The checkout, under git, with one more claim: a suite of which one part fails."""
    shutil.rmtree(checkout / "validation" / "wrong")
    (checkout / "validation" / "suite").mkdir()
    (checkout / "validation" / "suite" / "check.py").write_text(SUITE.format(name="suite"))
    for words in (["init", "-q"], ["add", "-A"], ["-c", "user.name=t", "-c", "user.email=t@t", "commit", "-qm", "t"]):
        subprocess.run(["git", *words], cwd=checkout, check=True)
    return checkout


def test_seeds_repeat_draws_and_parts_are_measured_alone(suites, capsys):
    drawn = []
    for words in (["--seed", "7"], ["suite", "--seed", "7"], ["suite", "--parts", "5", "a"], ["suite", "--full"]):
        code = main(["validate", *words])
        out = capsys.readouterr().out
        assert code == ("NO " in out)
        drawn.append(re.search(r"parts, none: (.*)", out)[1])
        assert ("again: mbdae validate suite" in out) == bool(code)
    assert drawn[0] == drawn[1]
    assert len(drawn[0].split(", ")) == 4
    assert drawn[2:] == ["5", ", ".join(map(str, range(40)))]
    assert "letters, b: failed" not in out
    assert "letters, b, none: failed: ZeroDivisionError" in out
    assert main(["validate", "suite", "--parts", "41"]) == 2
    assert "claim 'suite' has no part 41: its parts are 0, 1, 2, a, b, ..." in capsys.readouterr().err


def test_a_seed_that_nobody_gave_is_printed_and_repeats(suites, capsys):
    main(["validate", "suite"])
    first = capsys.readouterr().out
    seed = re.search(r"--seed (\d+) repeats it", first)[1]
    main(["validate", "suite", "--seed", seed])
    assert re.findall("parts, none: .*", capsys.readouterr().out) == re.findall("parts, none: .*", first)


def test_the_full_set_is_kept_with_its_commit_and_listed(suites, capsys):
    assert main(["validate", "--full"]) == 1
    assert main(["validate", "right", "--seed", "3"]) == 0
    commit = subprocess.run(["git", "rev-parse", "--short=12", "HEAD"], cwd=suites, check=True, capture_output=True, text=True)
    kept = json.loads((suites / "validation" / "record.json").read_text(encoding="utf-8"))
    assert {name: set(kinds) for name, kinds in kept.items()} == {"right": {"whole"}, "suite": {"whole"}}
    assert {name: kinds["whole"]["holds"] for name, kinds in kept.items()} == {"right": True, "suite": False}
    assert {kinds["whole"]["commit"] for kinds in kept.values()} == {commit.stdout.strip()}
    (suites / "validation" / "right" / "check.py").write_text(STATED.format(name="right", error=1e-5))
    assert main(["validate", "right", "--seed", "3", "--record"]) == 0
    capsys.readouterr()
    assert main(["validate", "--list"]) == 0
    out = capsys.readouterr().out
    assert f"whole sets: 2 of 2 measured, 1 of them hold, all on commit {commit.stdout.strip()}" in out
    assert re.search(r"holds, seed 3 +[0-9a-f]{12} with changes", out)


def test_a_process_that_crashes_does_not_end_the_others(suites, capsys):
    check = suites / "validation" / "suite" / "check.py"
    crash = "print('last words', flush=True)\n    os.abort()\n    return Found(0, n"
    check.write_text(check.read_text().replace("return Found(0, n", crash))
    assert main(["validate", "--jobs", "1"]) == 1
    out = capsys.readouterr().out
    assert "right: holds" in out
    assert "its process was ended by SIGABRT: last words" in out
    assert "1 of 2 do not hold: suite" in out


def test_ctrl_c_tells_what_was_done_and_ends_every_process(suites, capsys, monkeypatch):
    check = suites / "validation" / "suite" / "check.py"
    check.write_text("import time\n" + check.read_text().replace("return Found(0,", "time.sleep(100)\n    return Found(0,"))
    started = []

    class Popen(subprocess.Popen):
        def __init__(self, *args, **options):
            super().__init__(*args, **options)
            started.extend([self] if self.args[0] == sys.executable else [])

    def stop(seconds: float) -> None:
        if len(started) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(runner.session.subprocess, "Popen", Popen)
    monkeypatch.setattr(runner.session.time, "sleep", stop)
    assert main(["validate", "--jobs", "1", "--seed", "5"]) == 130
    said = capsys.readouterr()
    assert "right: holds" in said.out
    assert "in claim suite: 1 of 2 were measured and held; no pages are written" in said.err
    assert "the rest: mbdae validate suite --seed 5" in said.err
    assert all(process.poll() is not None for process in started)


def test_the_wheel_does_not_carry_or_need_validation():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert settings["packages"] == ["mbdae"]
    shared = {"runner", *(path.stem for path in FOLDER.glob("*.py"))}
    for path in (ROOT / "mbdae").rglob("*.py"):
        used = set(re.findall(r"^\s*(?:from|import) (\w+)", path.read_text(encoding="utf-8"), re.MULTILINE))
        assert not used & {"validation", *shared}, path
