"""Hostile words for every option of every command: refused with exit code 2, the option and the word named, nothing written.

The options come from the parser itself, so that a new one is tried without being named here.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import itertools
import json
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mbdae.cli import main, make_parser

CHECKOUT = Path(__file__).parents[2]
FILE = """
import mbdae as mb

t_end = 0.01

def scene():
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    return s
"""
NO_NUMBERS = ["", " ", "abc", "1e-6,", ",", "1,2", "1e-6 m", "1..2", "1e", "--", "None", "True", "1+2j", "nan", "inf", "-inf",
              "0", "-1", "-1e-6", "1e400", "½", "[1]", "{}", "$HOME", "%s", "{0}", "a\nb",
              "é" * 50]
NO_LISTS = ["", " ", "abc", "1e-3,", ",1e-3", "1e-3,,1e-4", "1e-3 1e-4", "1e-3;1e-4", "nan", "1e-3,inf", "1e-3,-1e-4", "0",
            "[1e-3]"]
NO_WORDS = ["", " ", "euler", "1", "None", "id", "a\nb", "{0}"]
NO_FOLDERS = ["", " ", "file", "file/below", "/proc/none", "a\0b", "x" * 300]
NO_KEPT = ["", " ", "absent/file.json", "folder", "file/below", "x" * 300]
NO_FILES = ["", " ", "absent.py", "folder", "a\0b", "x" * 300, "~", "*", "nul\n", "http://x.py", "-", "file/below.py", "\udcff"]
#: words that mean something here: what each kind of option must refuse
HOSTILE = {"accuracy": NO_NUMBERS, "t_end": NO_NUMBERS, "max_wall": NO_NUMBERS, "hours": NO_NUMBERS, "budget": NO_NUMBERS,
           "accuracies": NO_LISTS, "engines": ["", ",", "=", "absent", "scipy=", "scipy=/absent/python", "scipy=file", "x" * 300],
           "out": NO_FOLDERS, "resume": NO_KEPT, "meanings": NO_FILES,
           "root": ["", " ", "absent", "file", "folder", "x" * 300], "file": NO_FILES,
           "solver": NO_WORDS, "form": NO_WORDS,
           "seed": [word for word in NO_NUMBERS if word != "0"], "jobs": NO_NUMBERS, "parts": ["", "absent", "7", "x" * 300],
           "what": [*NO_FILES, "Revolute()", "hinge"], "claims": ["", "absent", "..", "/", "x" * 300]}
SWITCHES = {"json", "debug", "help", "version", "full", "record", "list"}


def options() -> list[tuple[str, argparse.Action]]:
    """Every option and argument of every command."""
    (commands,) = (a for a in make_parser()._actions if isinstance(a, argparse._SubParsersAction))
    return [(name, action) for name, parser in commands.choices.items() for action in parser._actions
            if action.dest not in SWITCHES]


def words_for(command: str, action: argparse.Action, word: str) -> list[str]:
    given = {"report": ["revolute"], "validate": ["--root", str(CHECKOUT)]}.get(command, ["swing.py"])
    given = [] if action.dest == "root" else given
    if action.option_strings:
        return [command, f"{action.option_strings[0]}={word}", *given]
    return [command, *(given if command == "validate" else []), "--", word]


def test_every_option_is_tried() -> None:
    assert {action.dest for _, action in options() if action.choices is None} == set(HOSTILE)


@pytest.mark.parametrize(("command", "action"), options(), ids=lambda value: getattr(value, "dest", value))
def test_hostile_words_are_refused(command: str, action: argparse.Action, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "swing.py").write_text(FILE)
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    words = HOSTILE[action.dest] if action.choices is None else NO_WORDS
    for word, as_json in itertools.product(words, (False, True)):
        asked = words_for(command, action, word)
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                code = main([asked[0], *(["--json"] if as_json else []), *asked[1:]])
            except SystemExit as stop:  # what the parser refuses
                code = stop.code  # type: ignore[assignment]
        told = err.getvalue()
        assert code == 2, (asked, told)
        assert "Traceback" not in told
        assert action.dest.replace("_", "-").rstrip("s") in told.replace("claim '", "claims '") or not action.option_strings, told
        ways = (" ".join(word.split())[:40], ascii(word)[1:41], repr(word)[:40], repr(float_of(word)))
        assert any(way in told for way in ways), (asked, told)
        if as_json:
            assert json.loads(out.getvalue())["exit_code"] == 2
        else:
            assert out.getvalue() == ""
    assert {path.name for path in tmp_path.iterdir()} == {"swing.py", "file", "folder"}


def float_of(word: str) -> float | None:
    with contextlib.suppress(ValueError):
        return float(word)
    return None


@pytest.mark.parametrize("words", [[], ["compute"], ["Run"], ["run"], ["run", "swing.py", "--speed", "2"], ["--json"],
                                   ["run", "swing.py", "other.py"], ["run", "swing.py", "--acc", "1e-3"], ["check", "--out"]])
def test_wrong_commands_and_unknown_options(words: list[str], capsys) -> None:
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    told = capsys.readouterr().err
    assert "Traceback" not in told
    assert "usage: mbdae" in told
    assert words in ([], ["--json"]) or words[-1] in told or words[0] in told


def test_unknown_commands_and_claims_are_answered_by_the_known_ones(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["compute"])
    told = capsys.readouterr().err
    assert all(name in told for name in ("check", "run", "compare", "extremes", "report", "validate"))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_code_given_as_text_is_the_exit_code(number: int, tmp_path) -> None:
    """As while dataclasses are imported: Python notes a KeyboardInterrupt that leaves such code, and ends its process by it."""
    (tmp_path / "swing.py").write_text(f"exec('import os, time; os.kill(os.getpid(), {int(number)}); time.sleep(9)')")
    ended = subprocess.run([sys.executable, "-m", "mbdae", "run", "swing.py"], cwd=tmp_path, capture_output=True, text=True)
    assert ended.returncode == 128 + number
    assert ended.stderr.startswith("mbdae: ")
    assert "interrupted" in ended.stderr


#: contents of FILE that are wrong or odd; what a line of words may be made of
ODD_FILES = {"empty.py": "", "syntax.py": "def scene(:", "raises.py": "1/0", "quits.py": "import sys; sys.exit(7)",
             "swing.py": FILE, "none.py": "def scene(): pass", "number.py": "scene = 3",
             "list.py": "import mbdae as mb\nscene = [mb.Scene()]",
             "nul.py": "x = 0\0", "latin.py": "# \udce9", "late.py": FILE.replace("0.01", "'soon'"), "law.txt": "a = b",
             "asks.py": FILE + "\nmeasure = 'hinge.nothing'\n", "needs.py": "def scene(a, b): return a", "dict.py": "scene = {}",
             "runs.py": FILE + "\nruns = 3\n", "vary.py": FILE + "\nvary = {'hinge.nothing': [1]}\n",
             "bare.py": "import mbdae as mb\ndef scene(): return mb.Scene('s')", "loop.py": "from loop import scene"}


def lines(count: int, seed: int = 0) -> list[list[str]]:
    """Random command lines: a command, options with words of any kind, files of any kind, in any order."""
    rng, (commands,) = random.Random(seed), (a for a in make_parser()._actions if isinstance(a, argparse._SubParsersAction))
    anything = [*NO_NUMBERS, *NO_FILES, *NO_FOLDERS, *ODD_FILES, "1e-3", "0.01", "dop853", "ode", "revolute", "out",
                "/dev/null", "."]
    made = []
    for _ in range(count):
        name = rng.choice(sorted(commands.choices.keys() - {"validate"}))
        flags = [a.option_strings[0] for a in commands.choices[name]._actions if a.option_strings and a.dest != "help"]
        parts = [[rng.choice(list(ODD_FILES))], *([rng.choice(flags), rng.choice(anything)] for _ in range(rng.randrange(3))),
                 *([rng.choice(anything)] for _ in range(rng.random() < 0.2))]
        rng.shuffle(parts)
        made.append([name, *(word for part in parts for word in part)])
    return made


@pytest.mark.parametrize("count", [30, pytest.param(300, marks=pytest.mark.slow)])
def test_random_lines_are_answered_in_words(count: int, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("MBDAE_CACHE", str(tmp_path / "cache"))
    for name, text in ODD_FILES.items():
        (tmp_path / name).write_bytes(text.encode(errors="surrogateescape"))
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    for line in lines(count, seed=count):
        try:
            code = main(line)
        except SystemExit as stop:
            code = stop.code  # type: ignore[assignment]
        said = capsys.readouterr()
        assert code in (0, 1, 2), (line, code)
        assert "Traceback" not in said.err or "--debug" in line, (line, said.err)
        assert "this is an error in mbdae" not in said.err, (line, said.err)
        assert code == 0 or said.err or said.out, line
