"""The core knows no joint by its name: what it does follows from what a joint's law states."""

from __future__ import annotations

import ast
from pathlib import Path

import mbdae.laws.forces
import mbdae.laws.joints
import mbdae.laws.on_coordinates

ROOT = Path(mbdae.laws.joints.__file__).parents[1]
CORE = ("symbolic", "kernels", "system", "formulations", "integrators")
FORCES = {name for name in mbdae.laws.forces.__all__ if name.startswith("Joint")}
CLASSES = {*mbdae.laws.joints.__all__, *mbdae.laws.on_coordinates.__all__, *FORCES}


def words() -> set[str]:
    """Class names and the words of the statements for them."""
    return CLASSES | {name.lower() for name in CLASSES if name not in ("Free", "Planar", "Distance")} | {"drive"}


def named(source: str) -> set[str]:
    """Joints named in a source: identifiers, and texts that are a name as a whole."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Name):
            found |= {node.id} & CLASSES
        elif isinstance(node, ast.Attribute):
            found |= {node.attr} & CLASSES
        elif isinstance(node, ast.alias):
            found |= {node.name.rpartition(".")[2]} & CLASSES
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found |= {node.value} & words()
    return found


def test_the_core_names_no_joint() -> None:
    files = [path for part in CORE for path in (*ROOT.glob(f"{part}.py"), *(ROOT / part).rglob("*.py"))]
    found = {str(path.relative_to(ROOT)): names for path in files
             if (names := named(path.read_text(encoding="utf-8")))}
    assert found == {"symbolic/joint.py": {"drive"}}  # where the parameter that prescribes a coordinate gets its name


def test_a_name_would_be_found() -> None:
    sources = "from mbdae.laws.joints import Revolute", "x = joints.Screw", "if kind == 'prismatic': pass", "Gear()", "'drive'"
    for source in sources:
        assert named(source)
