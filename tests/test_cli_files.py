"""FILE may have any name, may import its neighbours and send its functions to processes; its mistakes are told with a line."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest

from mbdae.cli import main

FILE = """
from __future__ import annotations
import random
from dataclasses import dataclass
import mbdae as mb
from lengths import LENGTH

t_end = 0.05
measure = "hinge.angle"

@dataclass
class Mass:
    value: float = 1.0

def scene():
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (LENGTH + random.random(), 0), mass=Mass().value)
    s.revolute("hinge", s.ground, rod, at=(0, 0))
    return s
"""
NAMES = ["numpy.py", "json.py", "test.py", "my scene (1).py", "a.b.py", "without_ending", "größe.py", "-x.py", "__init__.py"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lengths.py").write_text("LENGTH = 1.0\n")
    return tmp_path


def said(capsys):
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    return out, err


@pytest.mark.parametrize("name", NAMES)
def test_any_name(name, folder, capsys):
    (folder / name).write_text(FILE)
    modules, path = dict(sys.modules), list(sys.path)
    assert main(["check", "--json", "--", name]) == 0
    assert json.loads(said(capsys)[0])["scene"] == "pendulum"
    assert sys.path == path
    assert {key for key, found in modules.items() if sys.modules.get(key) is not found} == set()
    assert "lengths" not in sys.modules
    assert {p.name for p in folder.iterdir()} <= {name, "lengths.py", "__pycache__"}


def test_a_link_and_a_folder_that_is_read_only(folder, capsys):
    inside = folder / "inside"
    inside.mkdir()
    (inside / "swing.py").write_text(FILE)
    (inside / "lengths.py").write_text("LENGTH = 2.0\n")
    (folder / "link.py").symlink_to(inside / "swing.py")
    inside.chmod(0o555)
    try:
        assert main(["run", "link.py", "--out", "out"]) == 0
    finally:
        inside.chmod(0o755)
    assert {p.name for p in (folder / "out").iterdir()} == {"link.npz", "link.png"}


def test_neighbours_replace_no_module_and_that_is_said(folder, capsys):
    for name in ("random.py", "numpy.py"):
        (folder / name).write_text("raise RuntimeError('a neighbour')\n")
    (folder / "swing.py").write_text(FILE)
    assert main(["check", "swing.py"]) == 0
    assert "`import random` in 'swing.py' takes the module that is installed, not 'random.py' beside it" in said(capsys)[1]


def test_functions_of_a_file_go_to_processes(folder, capsys):
    sweep = """
def job(number):
    return {"value": number * LENGTH, "module": __name__}

def scene():
    found = mb.sweep(job, {"number": [1, 2]}, workers=1)
    assert not found.failures, found.failures
    s = mb.Scene("swept", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (found.array("value")[1], 0), mass=1.0), at=(0, 0))
    return s
"""
    (folder / "random.py").write_text("raise RuntimeError('a neighbour')\n")  # the workers start in this folder
    (folder / "my sweep.py").write_text(FILE[: FILE.index("def scene")] + sweep)
    assert main(["check", "my sweep.py"]) == 0
    assert "swept" in said(capsys)[0]


MISTAKES = {
    "def scene(:\n": "is not a Python file: SyntaxError: invalid syntax (line 1 of swing.py)",
    "import absent\n": "ModuleNotFoundError: No module named 'absent' (line 1 of swing.py)",
    "import wrong\n": "ZeroDivisionError: division by zero (line 2 of wrong.py)",
    "def scene():\n    raise ValueError('no')\n": "fails: ValueError: no (line 2 of swing.py)",
    "import numpy as np\ndef scene():\n    return np.zeros(-1)\n": "negative dimensions are not allowed (line 3 of swing.py)",
    "import sys\nsys.exit(0)\n": "it ends the program by sys.exit(0) (line 2 of swing.py)",
    "def scene():\n    raise SystemExit\n": "it ends the program by sys.exit(None) (line 2 of swing.py)",
    "x = 1\n": "'swing.py' has no function scene(); add one",
    "scene = 3\n": "scene of 'swing.py' is int, no function scene()",
    "def scene(): pass\n": "returns nothing, not a mb.Scene; end it with `return s`",
    "def scene():\n    yield 1\n": "returns generator, not a mb.Scene",
    "def scene(length): pass\n": "cannot be called without arguments: missing a required argument: 'length'; give them defaults",
    "\x00": "is not a Python file",
    "def scene():\n    return scene()\n": "RecursionError",
    "import mbdae as mb\ndef scene():\n    return mb.Scene('a').link('b', 0, 1, colour=3)\n": "(line 3 of swing.py)",
}


@pytest.mark.parametrize("text", MISTAKES, ids=lambda text: ascii(text)[:30])
def test_mistakes_are_told_with_their_line(text, folder, capsys):
    (folder / "swing.py").write_text(text)
    (folder / "wrong.py").write_text("\n1 / 0\n")
    assert main(["check", "swing.py"]) == 2
    err = said(capsys)[1]
    assert "swing.py" in err
    assert MISTAKES[text] in err


@pytest.mark.parametrize(("line", "words"), [
    ("t_end = '2'", "t_end of 'swing.py' = '2' is not a number: give the end time in s"),
    ("t_end = -1.0", "t_end of 'swing.py' = -1.0 is not positive"),
    ("measure = 3", "measure = 3 in 'swing.py' is no sensor: give item.quantity"),
    ("measure = 'angle'", "measure = 'angle' in 'swing.py' is no sensor: give item.quantity"),
])
def test_what_a_file_states_is_checked_before_the_run(line, words, folder, capsys):
    (folder / "swing.py").write_text(FILE + line + "\n")
    assert main(["run", "swing.py"]) == 2
    assert words in said(capsys)[1]


def test_an_error_in_a_law_of_the_file_names_its_line(folder, capsys):
    law = """
class Bad(mb.Force):
    def energy(self, k, l):
        return k.nothing

def scene():
    s = mb.Scene("bad")
    s.add(Bad("bad", s.ground, s.point_mass("m", 1.0, at=(0, 0, 0)), at=(0, 0, 0)))
    return s
"""
    text = "import mbdae as mb\nt_end = 1.0\n" + law
    (folder / "swing.py").write_text(text)
    assert main(["run", "swing.py"]) in (1, 2)
    assert f"(line {text.splitlines().index('        return k.nothing') + 1} of swing.py)" in said(capsys)[1]


def test_debug_shows_the_way_to_an_error(folder, capsys):
    (folder / "swing.py").write_text("def scene():\n    raise ValueError('no')\n")
    assert main(["check", "swing.py", "--debug"]) == 2
    assert "Traceback" in capsys.readouterr()[1]


@pytest.mark.skipif(os.name != "posix", reason="names of files that are no text")
def test_a_name_that_is_no_text(folder, capsys):
    (folder / os.fsdecode(b"b\xff.py")).write_text(FILE)
    assert main(["check", os.fsdecode(b"b\xff.py")]) == 0
    assert main(["check", os.fsdecode(b"c\xff.py")]) == 2


@pytest.mark.parametrize("arguments", [["--out", "file"], ["--out", "file/below"], ["--out", "/proc/none"]])
def test_a_folder_that_cannot_be_written_is_refused_before_the_run(arguments, folder, capsys):
    (folder / "file").write_text("")
    (folder / "swing.py").write_text(FILE)
    assert main(["run", "swing.py", *arguments, "--json"]) == 2
    out, err = said(capsys)
    assert f"--out {arguments[1]}: " in err
    assert arguments[1] in json.loads(out)["error"]
    assert not Path("swing.npz").exists()
