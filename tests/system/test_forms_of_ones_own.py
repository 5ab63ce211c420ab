"""A form under a label of its own, and a solver of one's own, are known everywhere by what they say of themselves."""

import ast
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.formulations.named import forms
from mbdae.integrators.named import solvers
from mbdae.run.choice import unknowns
from mbdae.system.prepare import prepare


@dataclass(frozen=True)
class Stabilised(mb.GGL):
    """GGL under another label."""

    label: ClassVar[str] = "Stabilised"


@dataclass(frozen=True)
class Accelerations(mb.Index1):
    """Index 1 under another label."""

    label: ClassVar[str] = "Accelerations"


@dataclass(frozen=True)
class Positions(mb.Index3):
    """Index 3 under another label."""

    label: ClassVar[str] = "Positions"


class Kutta(mb.OneStep):
    """The classical Runge-Kutta method."""

    order = 4

    def advance(self, f, t, y, h):
        a = f(t, y)
        b = f(t + h / 2, y + h / 2 * a)
        c = f(t + h / 2, y + h / 2 * b)
        return y + h / 6 * (a + 2 * b + 2 * c + f(t + h, y + h * c))


def four_bar():
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    crank, coupler = s.link("crank", (0, 0), (0, 0.3), mass=0.3), s.link("coupler", (0, 0.3), (0.5, 0.6), mass=0.6)
    rocker = s.link("rocker", (0.5, 0.6), (0.6, 0), mass=0.5)
    for name, k, l, at in (("A", s.ground, crank, (0, 0)), ("B", crank, coupler, (0, 0.3)), ("C", coupler, rocker, (0.5, 0.6)),
                           ("D", s.ground, rocker, (0.6, 0))):
        s.revolute(name, k, l, at=at)
    return s


def warnings_of_drift(form):
    r = four_bar().simulate(4.0, form=form, solver=mb.RadauIIA(3, rtol=1e-3))
    return [w.split(":")[0] for w in r.warnings if "violated" in w]


@pytest.mark.parametrize(("form", "like"), [(Stabilised(), mb.GGL()), (Accelerations(), mb.Index1()), (Positions(), mb.Index3())],
                         ids=lambda form: form.label)
def test_a_default_run_is_that_of_the_form_it_derives_from(form, like):
    s = four_bar()
    own, shipped = s.simulate(0.2, 1e-4, form=form), s.simulate(0.2, 1e-4, form=like)
    assert own.info.form == form.label
    assert np.allclose(own["D"].angle, shipped["D"].angle, atol=1e-4)
    again = s.simulate(0.3, 1e-4, form=form, start=own)
    assert again.info.form == form.label
    assert s.check().degrees_of_freedom == 1


@pytest.mark.parametrize("form", [Stabilised(), Accelerations(), Positions()], ids=lambda form: form.label)
@pytest.mark.parametrize("highest", [0, 1, 2, 3])
def test_the_choice_counts_the_unknowns_that_the_equations_have(form, highest):
    prepared = prepare(four_bar())
    assert unknowns(prepared, form, highest) == system_for(prepared, form, highest).n


def test_only_forms_that_hold_accelerations_alone_are_looked_at_for_drift():
    assert warnings_of_drift(Accelerations(baumgarte=0)) == warnings_of_drift(mb.Index1(baumgarte=0)) != []
    assert warnings_of_drift(Stabilised()) == []


def test_solvers_take_the_forms_whose_index_they_integrate():
    taken = [[form.within(highest) for highest in (0, 1, 2, 3)] for form in (Stabilised(), Accelerations(), Positions())]
    assert taken == [[False, True, True, True], [True, True, True, True], [False, False, False, True]]


def test_comparisons_and_maps_run_them():
    runs = [mb.Run(mb.RadauIIA(3), Stabilised()), mb.Run(Kutta(), Accelerations())]
    found = mb.compare(four_bar(), 0.2, accuracies=(1e-4,), runs=runs)
    assert {run.form for run in found.runs} == {"Stabilised", "Accelerations"}
    assert all(run.error < 1e-4 for run in found.runs)
    mapped = mb.extremes(four_bar(), 0.2, {"coupler.mass": [0.6, 6.0]}, runs=runs, accuracy=1e-4)
    assert {cell.form for cell in mapped.cells} >= {"Stabilised", "Accelerations"}
    assert not any(cell.failure for cell in mapped.cells)


def test_no_label_of_a_form_or_solver_is_written_outside_of_its_class():
    labels = {form.label for form in forms()} | {variant.label for solver in solvers() for variant in solver.variants()}
    package = Path(mb.__file__).parent
    written = [f"{path.relative_to(package)}:{node.lineno}: {node.value}" for path in sorted(package.rglob("*.py"))
               if path.name != "__init__.py" for node in _texts(ast.parse(path.read_text(encoding="utf-8")))
               if node.value in labels]  # __init__.py: lists of exported names
    assert [place for place in written if not place.startswith("native/sundials_library.py")] == []  # IDA: a prefix of names in C


def _texts(tree):
    """Texts of a module, without those by which a class says something of itself (what it has measured, its label)."""
    said = {id(node) for made in ast.walk(tree) if isinstance(made, ast.ClassDef)
            for entry in made.body if isinstance(entry, ast.Assign | ast.AnnAssign) for node in ast.walk(entry)}
    texts = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str))
    return [node for node in texts if id(node) not in said]
