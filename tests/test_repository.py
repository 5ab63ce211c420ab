"""Facts about the repository itself: small text files, short functions, documented names, nothing of one machine."""

from __future__ import annotations

import ast
import importlib.util
import re
import subprocess
import sys
import tomllib
from collections import Counter
from pathlib import Path

import pytest

import mbdae as mb
from mbdae.cli import main

ROOT = Path(__file__).resolve().parent.parent
MODULES = sorted((ROOT / "mbdae").rglob("*.py"))
PICTURES = ROOT / "docs" / "img"  #: of the README, made by a command; tests/test_docs.py holds them to it
THREE = ROOT / "mbdae" / "show" / "three.min.js"  #: a library of others, made by .ci/three
LARGEST, FILE_LINES, FUNCTION_LINES = 200_000, 400, 60  # bytes, lines, lines
GENERATED = re.compile(r"(^|/)(__pycache__|build|dist|out|\.venv[^/]*|[^/]*\.egg-info|\.(pytest|mypy|ruff)_cache)/|"
                       r"\.(pyc|so|dll|dylib|o|png|svg|gif|npz|whl|html|pdf)$")
#: absolute paths of a home, a scratch or a work directory
MACHINE = re.compile(r"(?<![\w.~/-])/(?:home|root|Users|work|tmp|mnt|var)/[\w.-]+|\b[A-Z]:\\\\?\w")


def kept_files() -> list[Path]:
    """Files under version control, and those that would be with the next `git add`."""
    listed = ["git", "-C", str(ROOT), "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    try:
        names = subprocess.run(listed, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    return [ROOT / name for name in names.split("\0") if name and (ROOT / name).is_file()]


def test_files_are_small_text() -> None:
    for path in kept_files():
        content = path.read_bytes()
        assert len(content) <= (3 if path == THREE else 1) * LARGEST, f"{path} has {len(content)} bytes"
        if path.parent == PICTURES:
            continue
        assert b"\0" not in content, f"{path} is binary"
        content.decode("utf-8")


def test_nothing_generated_is_kept() -> None:
    kept = (str(path.relative_to(ROOT)) for path in kept_files() if path.parent != PICTURES)
    wrong = [name for name in kept if GENERATED.search(name)]
    assert not wrong


def test_no_paths_of_one_machine() -> None:
    wrong = [f"{path.relative_to(ROOT)}:{i + 1}: {line.strip()[:100]}"
             for path in kept_files() if path != Path(__file__).resolve() and path.parent != PICTURES
             for i, line in enumerate(path.read_text(encoding="utf-8").splitlines()) if MACHINE.search(line)]
    assert not wrong


def functions(path: Path) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


def test_files_and_functions_are_short() -> None:
    wrong = []
    for path in MODULES:
        length = len(path.read_text(encoding="utf-8").splitlines())
        wrong += [f"{path.relative_to(ROOT)}: {length} lines"] if length > FILE_LINES else []
        for node in functions(path):
            size = (node.end_lineno or node.lineno) - node.lineno + 1
            wrong += [f"{path.relative_to(ROOT)}: {node.name} has {size} lines"] if size > FUNCTION_LINES else []
    assert not wrong


def undocumented(tree: ast.Module) -> list[str]:
    """Public classes, functions and methods without a docstring; methods that fill in a base's may inherit it."""
    found = [] if ast.get_docstring(tree) or not tree.body else ["the module"]
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            found += [node.name] if not ast.get_docstring(node) else []
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_") and not node.bases:
            found += [f"{node.name}.{method.name}" for method in node.body
                      if isinstance(method, ast.FunctionDef) and not method.name.startswith("_")
                      and not ast.get_docstring(method)]
    return found


def test_a_name_of_a_module_has_one_meaning() -> None:
    """A constant that is stated a second time, farther down, changes what the code above it does."""
    twice = []
    for file in MODULES:
        names = Counter(name.id for node in ast.parse(file.read_text(encoding="utf-8")).body if isinstance(node, ast.Assign)
                        for target in node.targets for name in ast.walk(target) if isinstance(name, ast.Name)
                        and isinstance(name.ctx, ast.Store))
        twice += [f"{file.name}: {name}" for name, count in names.items() if count > 1]
    assert twice == []


def test_public_names_are_documented() -> None:
    wrong = [f"{path.relative_to(ROOT)}: {name}" for path in MODULES
             for name in undocumented(ast.parse(path.read_text(encoding="utf-8")))]
    assert not wrong


def test_continuous_integration_runs_what_the_readme_says() -> None:
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert "set -euo pipefail" in script
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o111
    for mark in ("main", "test"):
        assert f"readme_command {mark}" in script


def test_one_version_and_its_date_everywhere(capsys: pytest.CaptureFixture[str]) -> None:
    """The first section of CHANGELOG.md is this version, the first with a date the release that is cited."""
    texts = {name: (ROOT / name).read_text(encoding="utf-8") for name in ("CHANGELOG.md", "CITATION.cff", "pyproject.toml")}
    sections = re.findall(r"^## (\S+) \((\d{4}-\d\d-\d\d|unreleased)\)$", texts["CHANGELOG.md"], re.MULTILINE)
    assert len(sections) == len(re.findall("^## ", texts["CHANGELOG.md"], re.MULTILINE))
    numbers = [tuple(map(int, version.split("."))) for version, _ in sections]
    assert numbers == sorted(set(numbers), reverse=True)
    assert mb.__version__ == sections[0][0] == tomllib.loads(texts["pyproject.toml"])["project"]["version"]
    with pytest.raises(SystemExit, match=r"^0$"):
        main(["--version"])
    assert capsys.readouterr().out == f"mbdae {mb.__version__}\n"
    cited = dict(re.findall(r'^(version|date-released): "?([^"\n]+)"?$', texts["CITATION.cff"], re.MULTILINE))
    released = next(section for section in sections if section[1] != "unreleased")
    assert (cited["version"], cited["date-released"]) == released


def test_source_archives_hold_everything() -> None:
    """hatchling takes some files by itself; pyproject.toml names the others."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]["sdist"]
    by_itself = {"pyproject.toml", "hatch_build.py", "README.md", "LICENSE", ".gitignore"}
    assert {path.relative_to(ROOT).parts[0] for path in kept_files()} == by_itself | set(settings["only-include"])


def test_the_recipe_for_conda_asks_for_what_the_project_asks_for() -> None:
    """conda-forge has other names for three packages; the version is that of the package."""
    recipe = (ROOT / ".ci" / "recipe.yaml").read_text(encoding="utf-8")
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    other = {"python-symengine": "symengine", "matplotlib-base": "matplotlib"}
    run = re.findall(r"^    - ([\w-]+) (>=[\w.]+)$", recipe.split("  run:\n")[1], re.MULTILINE)
    assert [other.get(name, name) + low for name, low in run] == [f"python{stated['requires-python']}", *stated["dependencies"]]
    assert f'version: "{stated["version"]}"' in recipe


def test_the_quick_part_names_tests_that_exist() -> None:
    lines = (ROOT / "tests" / "quick.txt").read_text(encoding="utf-8").splitlines()
    listed = [line for line in lines if line and not line.startswith("#")]
    assert len(set(listed)) == len(listed)
    absent = [line for line in listed if line.split("::")[1] not in
              {f.name for f in functions(ROOT / "tests" / line.split("::")[0])}]
    assert not absent
    covered = {line.split("/")[0] for line in listed if "/" in line}
    assert covered == {path.parent.name for path in (ROOT / "tests").glob("*/test_*.py")} - {"reference", "fuzz", "oracles"}


def test_the_slow_part_names_tests_that_exist() -> None:
    """And none is left out of every run: what a plain pytest does not run, the claim does."""
    lines = (ROOT / "tests" / "slow.txt").read_text(encoding="utf-8").splitlines()
    listed = [line.split("[")[0].split("::") for line in lines if not line.startswith("#")]
    absent = [name for name in listed if name[1] not in {f.name for f in functions(ROOT / "tests" / name[0])}]
    assert not absent
    sys.path.insert(0, str(ROOT / "validation"))
    from slow_tests.check import FILES

    assert {file for file, _ in listed} - {"test_validate.py"} <= set(FILES)


def test_lowest_releases_are_those_of_the_project(monkeypatch: pytest.MonkeyPatch) -> None:
    """The script that tests them reads them from pyproject.toml, of every extra, and refuses what it cannot pin."""
    spec = importlib.util.spec_from_file_location("versions", ROOT / ".ci" / "versions.py")
    assert spec is not None
    assert spec.loader is not None
    versions = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "versions", versions)  # dataclasses look their module up
    spec.loader.exec_module(versions)
    stated = versions.project()
    found = versions.requirements(stated, "dev")
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert set(found) >= {"numpy", "pytest", "distributed", "mypy"}
    assert all(f"\"{name}>={low}\"" in text for name, low in found.items())
    assert versions.lowest_python(stated) in versions.NEWEST
    assert versions.pinned("numpy", "1.26", True) == "numpy==1.26"
    with pytest.raises(versions.FailedError, match=r"numpy>=1\.26,<3"):
        versions.parsed("numpy>=1.26,<3")
