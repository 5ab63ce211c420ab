"""Pages that are made before Sphinx reads the sources: theory from `mb.report`, the gallery from `examples/`, an arena.

    python docs/_ext/made.py img        the pictures of the README, into docs/img
    python docs/_ext/made.py            the pages, into docs/made, as the site does

A page is made again where the package or its example is newer than it.
"""

from __future__ import annotations

import ast
import contextlib
import html
import importlib
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, ClassVar

sys.path.insert(0, str(Path(__file__).parent))

from cards import CARDS, GALLERY, moving, said

from mbdae.notation import FITTING

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES, MADE, IMAGES = ROOT / "examples", ROOT / "docs" / "made", ROOT / "docs" / "img"
#: pages of theory: title, and what `mb.report` is asked for (an expression)
THEORY = {
    "revolute": "mb.Revolute", "prismatic": "mb.Prismatic", "spherical": "mb.Spherical", "universal": "mb.Universal",
    "classical": "mb.Classical()", "recursive": "mb.Recursive()",
    "clearance": "'clearance'", "hertz": "mb.Hertz", "coulomb": "mb.Coulomb", "lugre": "mb.LuGre", "beam": "'beam'",
    "rigid-body": "'rigidbody'", "gear": "'gear'", "four-bar": "__import__('four_bar').scene()",
}
#: the arena of the site, which programs of other environments join where EXUDYN_PYTHON or MUJOCO_PYTHON names their interpreter
ARENA: dict[str, Any] = {"count": 8, "seed": 1, "accuracies": [1e-3, 1e-5], "runs": ["RadauIIA(3)", "IDA"]}


def newest(*folders: Path) -> float:
    """When the last of the files in folders, or of files, was changed."""
    files = [file for folder in folders for file in (folder.rglob("*.py") if folder.is_dir() else [folder])]
    return max(file.stat().st_mtime for file in files)


def stale(page: Path, package: float, source: Path) -> bool:
    """Whether a page is absent or older than the package or its own source."""
    return not page.exists() or page.stat().st_mtime < max(package, source.stat().st_mtime)


def theory(name: str) -> None:
    """A report as a page with its pictures beside it."""
    import mbdae as mb

    mb.report(eval(THEORY[name], {"mb": mb})).save(MADE / f"{name}.md")


def example(name: str) -> None:
    """The page of an example: a player, its number, its docstring, its code and its plot; and the moving picture of its card."""
    module, card = importlib.import_module(name), CARDS[name]
    run = module.run()
    number = said(module, module.number(run))
    for folder in ("cards", "players"):
        (MADE / "site" / folder).mkdir(parents=True, exist_ok=True)
    module.picture(run).savefig(MADE / f"{name}.png", dpi=110)
    moving(card, run, MADE / "site" / "cards" / name)
    card.of(run).animate(MADE / "site" / "players" / f"{name}.html", trail=list(card.trail) or None, hide=list(card.hide))
    text = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    (MADE / f"{name}.md").write_text(f"""# {card.title}

{card.lesson}

```{{raw}} html
<iframe class="player" src="../players/{name}.html" title="{card.title} in motion" loading="lazy"{FITTING}></iframe>
```

**{number}.**

{paragraphs(ast.get_docstring(ast.parse(text)) or "")}

```{{literalinclude}} ../../examples/{name}.py
:language: python
:start-at: import
```

![{module.picture.__doc__}]({name}.png)
""", encoding="utf-8")


def arena(name: str) -> None:
    """A small arena as the folder that `mbdae arena` writes, which stands in the site as it is."""
    import mbdae as mb

    named = {program: os.environ.get(f"{program.upper()}_PYTHON") for program in ("exudyn", "mujoco")}
    others = {program: python for program, python in named.items() if python}
    mb.arena(engines={"scipy": None, **others}, **ARENA).save(MADE / "site" / name)


def page_of(kind: str, name: str) -> Path:
    """The file of a page."""
    return MADE / "site" / name / "index.html" if kind == "arena" else MADE / f"{name}.md"


def paragraphs(text: str) -> str:
    """A docstring as Markdown: what is indented stays as it is."""
    lines = text.splitlines()
    return "\n".join(line if line.startswith("    ") else line.strip().replace("*", r"\*") for line in lines)


def pictures() -> None:
    """The pictures of the README: the mechanism of its first block, the wing in motion, the rotor's comparison that the first
    command draws, and its motion."""
    import flapping_wing
    import ground_resonance
    from PIL import Image

    import mbdae as mb

    IMAGES.mkdir(exist_ok=True)
    first = re.search(r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    with contextlib.chdir(IMAGES):
        exec(first[1] if first else "")
    wing = flapping_wing.run()
    joints = [joint.name for joint in wing.prepared.model.scene.joints]
    wing.animate(IMAGES / "flapping_wing.gif", fps=16, speed=0.25, hide=joints)
    ground_resonance.picture(ground_resonance.run()).savefig(IMAGES / "ground_resonance.png", dpi=90)
    mb.compare(ground_resonance.scene(), ground_resonance.t_end, measure=ground_resonance.measure).plot(IMAGES / "compare.png")
    for file in IMAGES.glob("*.png"):
        with Image.open(file) as picture:
            picture.convert("RGB").quantize(64, dither=0).save(file, optimize=True)


def make(task: list[tuple[str, str]]) -> None:
    """Some pages, in a process of their own."""
    command = [sys.executable, str(Path(__file__)), *(f"{kind}:{name}" for kind, name in task)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "MPLBACKEND": "agg"})
    if done.returncode:
        raise RuntimeError(f"pages cannot be made:\n{done.stdout}{done.stderr}")


def pages() -> None:
    """All pages that are stale, in as many processes as there are processors."""
    MADE.mkdir(exist_ok=True)
    copied()
    sources = {("example", name): EXAMPLES / f"{name}.py" for name in CARDS} | {
        ("theory", name): EXAMPLES / "four_bar.py" for name in THEORY} | {("arena", "arena"): Path(__file__)}
    package = newest(ROOT / "mbdae", Path(__file__))
    wanted = [page for page, source in sources.items() if stale(page_of(*page), package, source)]
    count = os.cpu_count() or 1
    tasks = [task for task in (wanted[i::count] for i in range(count)) if task]
    with ThreadPoolExecutor(count) as pool:
        list(pool.map(make, tasks))


def copied() -> None:
    """The pages of the project that stand at its top; links from them and to them fit the site."""
    for name in ("CONTRIBUTING", "CHANGELOG"):
        text = (ROOT / f"{name}.md").read_text(encoding="utf-8")
        text = text.replace("](docs/", "](/").replace("](CHANGELOG.md", "](changelog.md")
        page = MADE / f"{name.lower()}.md"
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")


def relinked(app: Any, page: str, source: list[str]) -> None:
    """Links out of docs/: to pages of the project, which are copied, and to files, which are kept beside the site."""
    text = re.sub(r"\]\((?:\.\./)+(CONTRIBUTING|CHANGELOG)\.md", lambda m: f"](/made/{m[1].lower()}.md", source[0])
    source[0] = re.sub(r"\]\((\.\./[\w/]+\.md)\)", lambda m: m[0] if (ROOT / "docs" / page).parent.joinpath(m[1]).resolve()
                       .is_relative_to(ROOT / "docs") else f"](path:{m[1]})", text)


def gallery() -> Any:
    """The directive `gallery`: the cards of a group, or of the examples that are named; each picture moves under the pointer, or
    where it has the focus, as by a tap."""
    from docutils import nodes
    from docutils.parsers.rst import Directive

    class Grid(Directive):
        has_content = True
        option_spec: ClassVar[dict[str, Any]] = {"only": str.split}
        optional_arguments, final_argument_whitespace = 1, True

        def run(self) -> list[nodes.Node]:
            names = self.options["only"] if "only" in self.options else GALLERY[self.arguments[0]]
            return [nodes.raw("", f'<div class="cards">{"".join(map(card_of, names))}</div>', format="html")]

    return Grid


def card_of(name: str) -> str:
    """A card as HTML."""
    card = CARDS[name]
    number = re.search(r"^\*\*(.*)\*\*$", (MADE / f"{name}.md").read_text(encoding="utf-8"), re.MULTILINE)
    title, lesson, told = (html.escape(text) for text in (card.title, card.lesson, number[1] if number else ""))
    pictures = "".join(f'<img class="{kind}" src="cards/{name}.{suffix}" alt="" width="320" height="240" loading="lazy">'
                       for kind, suffix in (("still", "png"), ("moving", "gif")))
    return (f'<figure><div class="film" tabindex="0" role="img" aria-label="{title} in motion">{pictures}</div><figcaption>'
            f'<a href="made/{name}.html">{title}</a><p>{lesson}</p><p class="number">{told}</p></figcaption></figure>')


def setup(app: Any) -> dict[str, bool]:
    """As an extension of Sphinx."""
    app.connect("config-inited", lambda app, config: pages())
    app.connect("source-read", relinked)
    app.add_directive("gallery", gallery())
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def main(words: list[str]) -> None:
    """The command: nothing for all pages, img for pictures, or single pages as kind:name."""
    sys.path[:0] = [str(ROOT), str(EXAMPLES)]
    if words == ["img"]:
        return pictures()
    for word in words:
        kind, _, name = word.partition(":")
        {"theory": theory, "example": example, "arena": arena}[kind](name)
    return None if words else pages()


if __name__ == "__main__":
    main(sys.argv[1:])
