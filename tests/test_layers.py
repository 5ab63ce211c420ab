"""Imports point downwards only; sksundae and matplotlib stay where they belong."""

from __future__ import annotations

import ast
from pathlib import Path

import mbdae

ROOT = Path(mbdae.__file__).parent
LAYERS = [
    {"__init__", "__main__", "cli"}, {"api"}, {"contracts", "extremes"}, {"audit"}, {"reports", "compare", "validation"},
    {"sweep", "documents"}, {"analysis"}, {"show"}, {"run"}, {"results"}, {"integrators"}, {"formulations"}, {"system"},
    {"kernels"}, {"scene"}, {"laws"}, {"inputs"}, {"symbolic"}, {"values", "files"}, {"notation", "errors", "threads", "ties"},
]  # fmt: skip
LEVEL = {name: len(LAYERS) - i for i, names in enumerate(LAYERS) for name in names}
#: upward on purpose: the System interface is all an integrator sees; kernels are called by the system only
KERNELS_CALLED_BY = {"system", "results", "run", "contracts"}
ALONE = {"sksundae": {"integrators/sundials/ida.py", "integrators/sundials/cvode.py"},
         "matplotlib": {"show", "compare", "reports"}}  # fmt: skip


def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
    return found


def test_imports_point_downwards() -> None:
    wrong = []
    for path in sorted(ROOT.rglob("*.py")):
        here = path.relative_to(ROOT).parts[0].removesuffix(".py")
        for name in imports(path):
            there = name.split(".")[1] if name.startswith("mbdae.") else here
            assert {here, there} <= set(LEVEL), f"{path.relative_to(ROOT)} imports {name}: give both a layer here"
            allowed = LEVEL[there] <= LEVEL[here] or (path.name == "__init__.py" and here == "__init__")
            if there == "kernels" != here:
                allowed &= here in KERNELS_CALLED_BY or name == "mbdae.kernels.plan"
            if there != here and there in next(names for names in LAYERS if here in names):
                allowed = here in ("__main__", "forces")  # forces may name the joint whose coordinate they act on
            if not allowed:
                wrong.append(f"{path.relative_to(ROOT)} imports {name}")
    assert not wrong


def test_heavy_packages_stay_where_they_belong() -> None:
    for path in ROOT.rglob("*.py"):
        where = path.relative_to(ROOT)
        for package, places in ALONE.items():
            if any(name.split(".")[0] == package for name in imports(path)):
                assert {str(where), where.parts[0]} & places, f"{where} imports {package}"
