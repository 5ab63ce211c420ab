"""The public name list is true, sorted and light to import."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import mbdae

ROOT = Path(mbdae.__file__).parent.parent


def test_names_are_sorted_and_have_a_home() -> None:
    constants = [n for n in mbdae.__all__ if n.isupper()]
    classes = [n for n in mbdae.__all__ if n[0].isupper() and not n.isupper()]
    functions = [n for n in mbdae.__all__ if n[0].islower()]
    assert mbdae.__all__ == [*sorted(constants), *sorted(classes), *sorted(functions)]
    assert list(mbdae._HOME) == sorted(mbdae._HOME)
    here = {"t"} | {name for name in mbdae.__all__ if name.endswith(("Error", "Warning"))}
    assert set(mbdae.__all__) == set(mbdae._HOME) | here


def test_every_name_resolves() -> None:
    """In a process of its own; names of functions that are names of modules too have the last test for themselves."""
    code = """
import mbdae
from importlib import import_module
for name in mbdae.__all__:
    value = getattr(mbdae, name)
    assert name in dir(mbdae)
    elsewhere = name in mbdae._HOME and name not in ("audit", "compare", "extremes", "selftest", "sweep")
    assert not elsewhere or value is getattr(import_module(mbdae._HOME[name]), name), name
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_unknown_name() -> None:
    with pytest.raises(AttributeError, match="module 'mbdae' has no attribute 'Revolut'"):
        mbdae.Revolut  # noqa: B018


@pytest.mark.parametrize(("statement", "t_end"), [
    ("from andrews_squeezer import scene", 1e-3), ("from clearance_rotor import scene", 2e-3),
    ("import ground_resonance as e; scene = lambda: e.scene(flexible=True)", 0.02),
    ("import flapping_wing as e; scene = lambda: e.scene(flexible=True)", 5e-3),
])
def test_a_run_imports_neither_scipy_nor_masked_arrays(statement: str, t_end: float) -> None:
    """Stiff, flexible and with contacts: SciPy takes 0.1 to 0.2 s to be imported, as long as many runs."""
    examples = str(Path(__file__).parent.parent / "examples")
    code = f"import sys; sys.path.insert(0, {examples!r}); {statement}; scene().simulate({t_end}, accuracy=1e-3)"
    code += "; print([m for m in ('scipy', 'numpy.ma', 'numpy.random') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(("statement", "heavy"), [
    ("import mbdae", "sympy symengine matplotlib scipy sksundae"), ("from mbdae import Scene", "sympy matplotlib sksundae"),
    ("from mbdae import load", "sympy matplotlib sksundae"),
])
def test_import_is_light(statement: str, heavy: str) -> None:
    code = f"import sys; {statement}; print([m for m in '{heavy}'.split() if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"


@pytest.mark.parametrize("then", ["s.simulate(1.0)", "s.simulate(1.0, solver='radau')", "s.simulate(1.0, form='GGL')",
                                  "s.simulate(0.1).save(file); begin = set(sys.modules); mb.load(file)"])
def test_a_rigid_scene_imports_nothing_for_beams_contacts_and_other_solvers(then: str, tmp_path: Path) -> None:
    """The modules of a run of a pendulum: what its scene does not have and its run does not use is not among them, whether the
    solver is chosen or named. A loaded run may look through the laws for a class that it names, through no other solver."""
    code = ("import sys, mbdae as mb; file, begin = sys.argv[1], {}; s = mb.Scene('p', gravity=(0, -9.81, 0)); "
            f"s.revolute('h', s.ground, s.link('rod', (0, 0), (1, 0), mass=1.0), at=(0, 0)); {then}; "
            "laws = ('mbdae.laws', 'mbdae.symbolic.line'); "
            "print(*(m for m in sys.modules if m.startswith('mbdae') and not (begin and m.startswith(laws))))")
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "a.npz")], capture_output=True, text=True, check=True)
    modules = done.stdout.split()
    needless = {"laws.beam", "laws.line_mesh", "laws.contact", "laws.friction", "laws.journal", "laws.surfaces",
                "symbolic.line", "kernels.line", "kernels.line_nodes",
                "kernels.line_program", "system.model.beams", "system.start_of_beams",
                "results.beams", "integrators.contact_steps", "integrators.sundials", "native.sundials",
                "native.sundials_library", "integrators.alpha_step", "integrators.generalized_alpha", "integrators.one_step"}
    assert not {f"mbdae.{name}" for name in needless} & set(modules)
    assert len(modules) <= 170


def test_a_result_that_is_loaded_can_be_drawn_and_stored(tmp_path: Path) -> None:
    """In a process that does nothing else: `results` knows neither drawings nor files, they are put on Result from above."""
    s = mbdae.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    s.simulate(0.1, accuracy=1e-3, outputs=3).save(tmp_path / "a.npz")
    code = ("import mbdae as mb; r = mb.load('a.npz'); r.plot('hinge.angle', path='a.png'); r.phase('hinge.angle', 'hinge.rate', "
            "path='b.png'); r.orbit('rod', path='c.png'); r.animate('d.html'); r.save('e.npz')")
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
    assert {f.name for f in tmp_path.iterdir()} == {"a.npz", "a.png", "b.png", "c.png", "d.html", "e.npz"}


def test_functions_survive_the_import_of_their_package() -> None:
    """`import mbdae.compare` imports a package that has the name of a function; the public name must stay the function."""
    code = "import mbdae, mbdae.compare; from mbdae.compare import compare; assert mbdae.compare is compare"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
