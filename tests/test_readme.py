"""The README is true: its Python blocks run, its commands exist, what it lists as public is."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path
from types import ModuleType

import pytest

import mbdae as mb
from mbdae.cli import main
from mbdae.symbolic.law import Law

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(document: str) -> list[tuple[str, str, int]]:
    """Language, text and line of every code block."""
    found = re.finditer(r"^```(\w+)\n(.*?)^```$", document, re.MULTILINE | re.DOTALL)
    return [(m.group(1), m.group(2), document[: m.start()].count("\n") + 1) for m in found]


BLOCKS = blocks(README)
PYTHON = [(text, line) for language, text, line in BLOCKS if language == "python"]
LINES = [line for language, text, _ in BLOCKS if language == "bash" for line in text.splitlines()]
COMMANDS = [command.removeprefix(".venv/bin/") for line in LINES for command in line.split(" && ")]


NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?")


def is_printed(said: str, printed: str) -> bool:
    """Whether numbers of a comment stand in this order in what is printed: to the last digit of the comment, those with an
    exponent, which are estimates of errors, within a factor of 3. A comment without numbers is what is printed."""
    found = iter(float(number) for number in NUMBER.findall(printed))
    for number in NUMBER.findall(said):
        value, digits = float(number), len(number.partition(".")[2])
        if not any(value / 3 < x < 3 * value if "e" in number else abs(x - value) < 10.0**-digits for x in found):
            return False
    return bool(NUMBER.search(said)) or said == printed


@pytest.mark.parametrize(("text", "line"), PYTHON, ids=[f"line {line}" for _, line in PYTHON])
def test_python_blocks_run_and_print_what_they_say(text, line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(compile("\n" * line + text, "README.md", "exec"), {"__name__": "readme"})  # errors name the line of the README
    assert sorted(file.name for file in tmp_path.iterdir()) == re.findall(r'animate\("(.*?)"', text)
    comments = [statement.split("  # ")[1] for statement in text.splitlines() if statement.startswith("print(")]
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == len(comments)
    for said, shown in zip(comments, printed, strict=True):
        assert is_printed(said, shown), f"{shown}, not {said}"


def test_laws_of_the_contributing_guide_work(monkeypatch):
    """Each block is a file; its laws are in its `__all__` and keep the contract, and the tests among the blocks pass. A law whose
    motion the tutorial states too keeps it there (`mb.selftest` in its first block)."""
    guide, tutorial = ((ROOT / name).read_text(encoding="utf-8") for name in ("CONTRIBUTING.md", "docs/tutorials/own-joint.md"))
    for text in (text for language, text, _ in blocks(guide) if language == "python"):
        head = text.splitlines()[0]
        own = head[2:-3].replace("/", ".") if head.startswith("# mbdae/") else "contributing"
        monkeypatch.setitem(sys.modules, own, module := ModuleType(own))
        space = vars(module)
        exec(compile(text, head, "exec"), space)
        for name, value in dict(space).items():
            if name.startswith("test_"):
                value()
            elif getattr(value, "__module__", "") == own and isinstance(value, type) and issubclass(value, Law):
                if f"{text.splitlines()[-1]}\n\n\nmb.selftest({name})\n" not in tutorial:
                    mb.selftest(value)
                assert name in space["__all__"]


@pytest.mark.parametrize("command", [c for c in COMMANDS if c.startswith("mbdae ")])
def test_commands_are_understood(command, monkeypatch, tmp_path):
    """Parsed and their files found; `check` runs, the others are run by `.ci/run` and tests/test_cli.py."""
    from mbdae.cli import make_parser

    if command == "mbdae --version":
        with pytest.raises(SystemExit, match=r"^0$"):
            main(["--version"])
        return
    arguments = make_parser().parse_args(shlex.split(command)[1:])
    if arguments.command.__name__ == "validate":
        assert all((ROOT / "validation" / name).is_dir() for name in arguments.claims)
        return
    if arguments.command.__name__ == "report":
        from mbdae.reports import names

        assert arguments.what in names() or (ROOT / arguments.what).is_file()
        return
    assert (ROOT / arguments.file).is_file()
    if arguments.command.__name__ == "check":
        monkeypatch.chdir(ROOT)
        assert main(shlex.split(command)[1:]) == 0


def test_first_screen_is_short_and_marked():
    lines = README.splitlines()
    shown = [i for i, text in enumerate(lines) if "![" in text]
    assert shown[0] < 12, "a moving mechanism before anything else"
    language, made, _ = BLOCKS[0]
    assert language == "python"
    assert "docs/img/" + re.findall(r'animate\("(.*?)"', made)[0] in lines[shown[0]], "the picture that the first block makes"
    assert len([line for line in made.splitlines() if line]) <= 10
    assert "](http" not in README, "no badges"
    assert [language for language, _, line in BLOCKS if line <= 60][:3] == ["python", "bash", "bash"]
    assert "| Simulate | Derive | Compare |" in lines[:45]
    for mark, command in (("<!-- ci: main -->", "python3 -m venv "), ("<!-- ci: test -->", ".venv/bin/python -m pip ")):
        at = [i for i, text in enumerate(lines) if text == mark]
        assert len(at) == 1
        assert lines[at[0] + 1] == "```bash"
        assert lines[at[0] + 2].startswith(command)
        assert lines[at[0] + 3] == "```"


def test_names_of_the_readme_are_public():
    features = (ROOT / "docs" / "features.md").read_text(encoding="utf-8")
    for name in set(re.findall(r"\bmb\.([A-Za-z]\w*)", README + features)):
        assert name in mb.__all__, f"README names mb.{name}"
    methods = {m for table in re.findall(r"^\| (?:Bodies|Joints|Forces) \|.*$", features, re.MULTILINE)
               for m in re.findall(r"`([a-z]\w*)`", table)}
    assert len(methods) > 15
    for method in methods:
        assert callable(getattr(mb.Scene, method)), f"README lists s.{method}"
