"""The structure of the package: imports point downwards and make no circle, heavy packages stay where they belong, folders and
files stay small."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import mbdae

ROOT = Path(mbdae.__file__).parent
#: folders and files of the package from the top down: each imports from its own entry and from those behind it
LAYERS = [
    {"__main__"}, {"cli"}, {"__init__"}, {"arena"}, {"api"}, {"contracts", "extremes"}, {"audit", "compare"}, {"engines"},
    {"export"}, {"reports"},
    {"sweep", "documents", "fits"}, {"robots"}, {"analysis"}, {"show"}, {"derivatives"}, {"run"},
    {"study"}, {"results"}, {"integrators"}, {"formulations"},
    {"system"}, {"kernels"}, {"scene"}, {"laws"}, {"inputs"}, {"symbolic"}, {"values", "files"}, {"native"},
    {"deferred", "disk"}, {"threads"}, {"notation", "errors"},
    {"process"},
]
#: parts of `system` from the bottom up, as its docstring says
SYSTEM = ["base", "shown_index", "dae", "model", "motion", "changes", "start_of_beams", "positions", "nearest", "start",
          "start_with_contacts", "dependent_rows", "many_rows", "redundancy", "undetermined", "assembled",
          "prepare", "sampling", "scene_system", "without_multipliers"]
LEVEL = {name: len(LAYERS) - i for i, names in enumerate(LAYERS) for name in names}
#: the System interface is all an integrator sees; kernels are called by these alone
KERNELS_CALLED_BY = {"system", "results", "run", "contracts", "export", "robots"}
#: kernels with which reports and audits compare formulas
READ_BACK = {"mbdae.kernels.plan", "mbdae.kernels.tree_plan", "mbdae.kernels.line", "mbdae.kernels.line_nodes"}
ALONE: dict[str, set[str]] = {"sksundae": set(), "matplotlib": {"show", "compare", "reports"}}
MOST_FILES, MOST_LINES = 25, 350


def module_of(path: Path, root: Path) -> str:
    """Name of the module in a file."""
    parts = path.relative_to(root.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def imported(source: str, module: str, is_package: bool) -> tuple[str, ...]:
    """Names of everything a module imports: at its top, inside functions, under TYPE_CHECKING, and by import_module."""
    return tuple(_imported(source, module, is_package))


def _imported(source: str, module: str, is_package: bool) -> Iterator[str]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = module.split(".")[: -node.level or None] if not is_package else module.split(".")[: 1 - node.level or None]
            base = ".".join([*(above if node.level else []), *([node.module] if node.module else [])])
            yield from (f"{base}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and node.args and getattr(node.func, "id", getattr(node.func, "attr", "")) in (
                "import_module", "__import__"):
            first = node.args[0].values[0] if isinstance(node.args[0], ast.JoinedStr) else node.args[0]
            if isinstance(first, ast.Constant):
                yield str(first.value).rstrip(".")


def graph(root: Path) -> dict[str, set[str]]:
    """Module of the package -> modules of the package that it imports."""
    files = {module_of(path, root): path for path in root.rglob("*.py")}
    found: dict[str, set[str]] = {module: set() for module in files}
    for module, path in files.items():
        for name in imported(path.read_text(encoding="utf-8"), module, path.name == "__init__.py"):
            while name and name not in files:
                name = name.rpartition(".")[0]
            if name and name != module:
                found[module].add(name)
    return found


def circle(of: dict[str, set[str]]) -> list[str]:
    """One circle of imports, or nothing."""
    try:
        TopologicalSorter(of).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_the_page_on_the_architecture_has_these_layers() -> None:
    page = (Path(__file__).parent.parent / "docs" / "architecture.md").read_text(encoding="utf-8")
    lines = page.rpartition("```text\n")[2].partition("```")[0].splitlines()
    assert [set(line.partition("   ")[0].split(", ")) for line in lines] == [
        names for names in LAYERS if names not in ({"__main__"}, {"__init__"})]


def test_no_import_makes_a_circle() -> None:
    assert not circle(graph(ROOT))


@pytest.mark.parametrize("late", [
    "from p.a import f", "import p.a", "from p import a", "from .a import f", "from . import a",
    "def g():\n    from p.a import f", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from p.a import f",
    "class Late:\n    def g(self):\n        import p.a", "from importlib import import_module\nimport_module('p.a')",
    "import importlib\ndef g(n):\n    importlib.import_module(f'p.a.{n}')",
])
def test_every_kind_of_import_counts(late: str, tmp_path: Path) -> None:
    """The test of circles sees an import however it is written."""
    root = tmp_path / "p"
    root.mkdir()
    for name, source in {"__init__": "", "a": "from p.b import g\n", "b": late + "\n"}.items():
        (root / f"{name}.py").write_text(source, encoding="utf-8")
    assert set(circle(graph(root))) == {"p.a", "p.b"}
    (root / "b.py").write_text("from p.c import h\n", encoding="utf-8")
    assert not circle(graph(root))


def test_imports_point_downwards() -> None:
    wrong = []
    for module, names in sorted(graph(ROOT).items()):
        here = ([*module.split("."), "__init__"])[1]
        for name in sorted(names):
            there = ([*name.split("."), "__init__"])[1]
            assert {here, there} <= set(LEVEL), f"{module} imports {name}: give both a layer here"
            allowed = here == there or LEVEL[there] < LEVEL[here]
            if there == "kernels" != here:
                allowed &= here in KERNELS_CALLED_BY or name in READ_BACK
            if not allowed:
                wrong.append(f"{module} imports {name}")
    assert not wrong


def test_parts_of_the_system_stand_on_each_other() -> None:
    folder = ROOT / "system"
    found = {path.stem for path in folder.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()}
    assert found - {"__init__"} == set(SYSTEM)
    for module, names in graph(ROOT).items():
        if module.startswith("mbdae.system."):
            here = SYSTEM.index(module.split(".")[2])
            parts = {name.split(".")[2] for name in names if name.startswith("mbdae.system.")}
            assert all(SYSTEM.index(part) <= here for part in parts), f"{module} imports {sorted(parts)}"


def test_heavy_packages_stay_where_they_belong() -> None:
    for path in ROOT.rglob("*.py"):
        where = path.relative_to(ROOT)
        names = imported(path.read_text(encoding="utf-8"), module_of(path, ROOT), path.name == "__init__.py")
        for heavy in {name.split(".")[0] for name in names} & set(ALONE):
            assert {str(where), where.parts[0]} & ALONE[heavy], f"{where} imports {heavy}"


def test_folders_and_files_stay_small() -> None:
    folders = [ROOT, *(path for path in ROOT.rglob("*") if path.is_dir())]
    assert not {str(f.relative_to(ROOT)) for f in folders if len(list(f.glob("*.py"))) > MOST_FILES}
    lengths = {str(p.relative_to(ROOT)): len(p.read_text(encoding="utf-8").splitlines()) for p in ROOT.rglob("*.py")}
    assert not {name: n for name, n in lengths.items() if n > MOST_LINES}
