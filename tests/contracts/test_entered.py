"""Laws and solvers of other packages, which these enter in the groups `mbdae.laws` and `mbdae.solvers` of entry points."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

PACKAGE = '''
import mbdae as mb


class Rail(mb.Joint):
    """The point of l stays on the line through k along k.x."""

    def constraints(self, k, l):
        d = l.r - k.r
        return {"y": k.y @ d, "z": k.z @ d}


class Careful(mb.DOP853):
    """DOP853 by another name."""
'''
ENTRIES = """[mbdae.laws]
rail = aside:Rail
lost = aside:Lost
[mbdae.solvers]
careful = aside:Careful
rail = aside:Rail
"""
USE = '''
import sys
import mbdae as mb

if sys.argv[1] == "state":
    from aside import Rail

    s = mb.Scene("bead", gravity=(0, -9.81, 0), space="spatial")
    bead = s.point_mass("bead", 1.0, at=(0, 0, 0), velocity=(1.0, 0, 0))
    s.add(Rail("rail", s.ground, bead, at=(0, 0, 0)))
    r = s.simulate(1.0, solver="careful")
    print(r.info.solver.label)
    r.save("bead.npz")
else:
    print(mb.load("bead.npz").prepared.model.scene["rail"].joint.__class__.__name__)
'''


def test_laws_and_solvers_of_an_installed_package_are_known_by_name(tmp_path: Path) -> None:
    """A stored scene is read without laws=[...], a solver found by its name; other entries are told, and left out."""
    (tmp_path / "aside.py").write_text(PACKAGE, encoding="utf-8")
    (tmp_path / "use.py").write_text(USE, encoding="utf-8")
    stated = tmp_path / "aside-1.0.dist-info"
    stated.mkdir()
    (stated / "METADATA").write_text("Metadata-Version: 2.1\nName: aside\nVersion: 1.0\n", encoding="utf-8")
    (stated / "entry_points.txt").write_text(ENTRIES, encoding="utf-8")
    here = str(Path(__file__).resolve().parents[2])
    given = os.environ | {"PYTHONPATH": os.pathsep.join([here, str(tmp_path)])}
    how = {"cwd": tmp_path, "env": given, "capture_output": True, "text": True, "check": False}
    found = [subprocess.run([sys.executable, "use.py", word], **how) for word in ("state", "load")]  # type: ignore[call-overload]
    assert [run.stdout.strip() for run in found] == ["Careful", "Rail"], "\n".join(run.stderr for run in found)
    assert "'aside:Rail', which an installed package enters in mbdae.solvers, is left out: it is no class" in found[0].stderr
    assert "'aside:Lost', which an installed package enters in mbdae.laws, is left out: AttributeError" in found[1].stderr
