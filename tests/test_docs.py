"""The documentation is true: Python blocks and cells of notebooks run, links lead somewhere, no public name is left out."""

from __future__ import annotations

import importlib.util
import re
import shlex
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

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
    return {*made().THEORY, *made().GALLERY.values(), "contributing", "changelog"}


def test_every_public_name_is_in_the_reference() -> None:
    text = "\n".join(path.read_text(encoding="utf-8") for path in (DOCS / "reference").glob("*.md"))
    named = set(re.findall(r"^.. auto\w+:: mbdae\.(\w+)$", text, re.MULTILINE))
    assert named == set(mb.__all__)


def test_the_gallery_lists_its_examples() -> None:
    listed = made().GALLERY
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    assert re.findall(r"^made/(\w+)$", text, re.MULTILINE) == list(listed.values())


LONG = ("clearance_forces", "lightest_four_bar", "suspension_design")  #: derivatives of many runs, or at thousands of instants


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG))
                                  for name in sorted(made().GALLERY.values())])
def test_an_example_of_the_gallery_gives_its_number(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    example = importlib.import_module(name)
    run = example.run()
    found, expected, *error = example.number(run)
    assert found == pytest.approx(expected, rel=0 if error else getattr(example, "WITHIN", 1e-4), abs=error[0] if error else 0)
    assert example.picture(run).axes


def test_pictures_are_small_and_made_by_the_command() -> None:
    """docs/img holds what `python docs/_ext/made.py img` writes, and the README shows all of it."""
    source, readme = ((ROOT / name).read_text(encoding="utf-8") for name in ("docs/_ext/made.py", "README.md"))
    files = sorted((DOCS / "img").iterdir())
    assert files
    for file in files:
        assert f'IMAGES / "{file.name}"' in source
        assert f"docs/img/{file.name}" in readme
    assert sum(file.stat().st_size for file in files) < 500_000
