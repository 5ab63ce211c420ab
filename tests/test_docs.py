"""The documentation is true: Python blocks and cells of notebooks run, links lead somewhere, no public name is left out."""

from __future__ import annotations

import ast
import importlib.util
import re
import shlex
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageSequence

import mbdae as mb

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = sorted(path for path in DOCS.rglob("*.md") if "made" not in path.relative_to(DOCS).parts)
BLOCK = re.compile(r"^```(\{code-cell\} python|python|bash)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(?<!`)\]\((?!https?:)([^)#\s]*)(#[^)\s]*)?\)")
FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)


def blocks(page: Path, language: str) -> list[tuple[str, int]]:
    """Text and line of every block in a language; cells of notebooks are Python."""
    text = page.read_text(encoding="utf-8")
    return [(m[2], text[: m.start()].count("\n") + 1) for m in BLOCK.finditer(text) if m[1].split()[-1] == language]


def name_of(page: Path) -> str:
    return page.relative_to(DOCS).with_suffix("").as_posix()


RUN = [page for page in PAGES if blocks(page, "python")]


@pytest.mark.parametrize("page", RUN, ids=name_of)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_every_block_of_a_page_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One after the other in one namespace, as a reader would type them; errors name the line of the page."""
    monkeypatch.chdir(tmp_path)
    space: dict[str, Any] = {"__name__": page.stem}
    for text, line in blocks(page, "python"):
        exec(compile("\n" * line + text, page.name, "exec"), space)


COMMANDS = sorted({line.split("  #")[0].strip() for page in PAGES for text, _ in blocks(page, "bash")
                   for line in text.splitlines() if line.startswith("mbdae ")})


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_is_understood(command: str) -> None:
    from mbdae.cli import make_parser

    with pytest.raises(SystemExit, match=r"^0$") if command == "mbdae --version" else nullcontext():  # which only prints
        make_parser().parse_args(shlex.split(command)[1:])


def headings(page: Path) -> set[str]:
    """The anchors of a page, as GitHub and MyST make them."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    found = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.strip().lower()).replace(" ", "-") for title in found}


@pytest.mark.parametrize("page", [*PAGES, *(ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "CHANGELOG"))],
                         ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page: Path) -> None:
    for target, anchor in LINK.findall(FENCE.sub("", page.read_text(encoding="utf-8"))):
        there = (page.parent / target).resolve() if target else page
        if "made" in there.parts:
            assert there.stem in made_pages(), f"{page.name} links to {target}"
            continue
        assert there.exists(), f"{page.name} links to {target}"
        if anchor:
            assert anchor[1:] in headings(there), f"{page.name} links to {target}{anchor}"


def made() -> Any:
    """The module that makes pages."""
    spec = importlib.util.spec_from_file_location("made", DOCS / "_ext" / "made.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["made"] = module
    spec.loader.exec_module(module)
    return module


def made_pages() -> set[str]:
    return {*made().THEORY, *made().CARDS, "contributing", "changelog"}


def test_every_public_name_is_in_the_reference() -> None:
    text = "\n".join(path.read_text(encoding="utf-8") for path in (DOCS / "reference").glob("*.md"))
    named = set(re.findall(r"^\.\. (?:auto\w+|py:data):: mbdae\.(\w+)$", text, re.MULTILINE))
    assert named == set(mb.__all__)


def code_of(file: Path) -> list[str]:
    """Lines of code: without docstrings, comments and empty lines."""
    text, said = file.read_text(encoding="utf-8"), set[int]()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef) and ast.get_docstring(node) is not None:
            said |= set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    return [line for i, line in enumerate(text.splitlines(), 1) if i not in said and line.strip() and line.strip()[0] != "#"]


def test_the_gallery_shows_all_cards_and_each_is_short() -> None:
    cards, text = made().CARDS, (DOCS / "gallery.md").read_text(encoding="utf-8")
    assert len(cards) >= 24
    assert re.findall(r"^made/(\w+)$", text, re.MULTILINE) == list(cards)
    assert re.findall(r"^```{gallery} (.*)$", text, re.MULTILINE) == list(made().GALLERY)
    assert [name for name in cards if len(code_of(ROOT / "examples" / f"{name}.py")) > 60] == []
    assert len({card.lesson for card in cards.values()}) == len(cards)


LONG = ("clearance_forces", "lightest_four_bar", "suspension_design")  #: derivatives of many runs, or at thousands of instants


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in sorted(made().CARDS)])
def test_an_example_of_the_gallery_gives_its_number_and_moves(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    try:
        example = importlib.import_module(name)
        run = example.run()
    except (ImportError, mb.MbdaeError) as error:
        if isinstance(error, ImportError) or "pip install" in str(error):
            pytest.skip(str(error))
        raise
    found, expected, *error = example.number(run)
    within = getattr(example, "WITHIN", None if error else 1e-4)
    assert within is None or found == pytest.approx(expected, rel=within)
    assert not error or abs(found - expected) <= error[0] + getattr(example, "KNOWN", 1e-9) * abs(expected)
    assert example.picture(run).axes
    made().moving(made().CARDS[name], run, tmp_path / name)
    with Image.open(tmp_path / f"{name}.gif") as picture:
        frames = [np.array(frame.convert("L"), dtype=float) for frame in ImageSequence.Iterator(picture)]
    assert len(frames) > 20
    assert max(np.mean(abs(frame - frames[0]) > 60) for frame in frames) > 1e-3  # share of the picture that changes
    assert (tmp_path / f"{name}.gif").stat().st_size < 400_000


def test_pictures_are_small_and_made_by_the_command() -> None:
    """docs/img holds what `python docs/_ext/made.py img` writes, and the README shows all of it."""
    source, readme = ((ROOT / name).read_text(encoding="utf-8") for name in ("docs/_ext/made.py", "README.md"))
    files = sorted((DOCS / "img").iterdir())
    assert files
    for file in files:
        assert f'IMAGES / "{file.name}"' in source or f'animate("{file.name}"' in readme  # by its first block
        assert f"docs/img/{file.name}" in readme
    assert sum(file.stat().st_size for file in files) < 500_000
