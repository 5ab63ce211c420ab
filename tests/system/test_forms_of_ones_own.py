"""A form under a label of its own, and a solver of one's own, are known everywhere by what they say of themselves: nothing but
this file states them."""

import ast
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

import mbdae as mb
import mbdae.formulations
import mbdae.integrators.named
from mbdae.compare.run import shipped_runs
from mbdae.formulations import form_of, forms, system_for
from mbdae.integrators import collocation_table, stored_runs
from mbdae.integrators.base import Solver, absolute_tolerance, set_tolerances
from mbdae.integrators.constant import check_rates
from mbdae.integrators.dense import hermite
from mbdae.integrators.named import solver_of, solvers
from mbdae.integrators.radau import CollocationMethod
from mbdae.laws import exported
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


@dataclass(frozen=True)
class Bogacki(Solver):
    """Bogacki and Shampine's method of order 3: explicit, its steps follow a tolerance."""

    rtol: float | None = None
    highest_index: ClassVar[int] = 0
    factors: ClassVar[dict[str, dict[str, float]]] = {"Bogacki": {"": 0.03}}

    def __post_init__(self):
        set_tolerances(self)

    atol = None

    def check(self, system):
        check_rates(self.label, system)

    def integrate(self, system, loop, h0):
        def f(t, y):
            out = np.empty(system.n)
            system.rhs(t, y, out)
            loop.stats.residuals += 1
            return out

        t, (y, a), going = loop.t, loop.state, True
        atol, h = absolute_tolerance(system, self.tolerance, None), h0 or 1e-3 * (loop.t_end - t)
        while going:
            longest = np.inf if system.longest_step is None else system.longest_step(t)
            end = loop.t_end if loop.t_end - t < 1.01 * min(h, longest) else t + min(h, longest)
            h = end - t
            b = f(t + h / 2, y + h / 2 * a)
            c = f(t + 3 * h / 4, y + 3 * h / 4 * b)
            reached = y + h / 9 * (2 * a + 3 * b + 4 * c)
            d = f(end, reached)
            error = np.max(np.abs(h * (-5 * a / 72 + b / 12 + c / 9 - d / 8)) / (atol + self.tolerance * np.abs(reached)))
            if error > 1:
                loop.stats.rejected += 1
                loop.guard()
            else:
                t, y, a = end, reached, d
                going = loop.accept(t, y, a)
            h *= min(5.0, max(0.2, 0.9 * (error + 1e-10) ** (-1 / 3)))

    def dense(self, t, y, yp, pieces):
        return hermite(3, t, y, yp)


@dataclass(frozen=True)
class Late(CollocationMethod):
    """Implicit collocation at 1/3 and 1, order 3: stiffly accurate, so that it takes constraints."""

    rtol: float | None = None
    highest_index: ClassVar[int] = 3
    factors: ClassVar[dict[str, dict[str, float]]] = {"Late": {"": 0.01}}
    table = collocation_table((1 / 3, 1.0), 3)


OWN = [(Bogacki(), Accelerations()), (Kutta(), Accelerations()), (Late(), Stabilised()), (Late(), Positions())]
every_pair = pytest.mark.parametrize(("solver", "form"), OWN, ids=lambda made: made.label)


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


@every_pair
def test_own_equations_by_own_methods_deliver_the_accuracy_and_are_continued_and_stored(solver, form, tmp_path):
    s, exact = four_bar(), four_bar().simulate(0.3, 1e-8)
    r = s.simulate(0.2, 1e-4, solver=solver, form=form, outputs=11)
    assert (r.info.solver.label, r.info.form, r.accuracy.met) == (solver.label, form.label, True)
    on = s.simulate(0.3, 1e-4, solver=solver, form=form, start=r)
    for part in (r, on):
        assert np.abs(part["D"].angle - exact(part.t)["D"].angle).max() < 2e-4
    r.save(tmp_path / "own.npz")
    again = mb.load(tmp_path / "own.npz", laws=[type(solver), type(form)])
    assert again.info.solver == r.info.solver
    assert np.array_equal(again(0.123)["D"].angle, r(0.123)["D"].angle)


@every_pair
def test_a_run_that_was_killed_goes_on(solver, form, tmp_path, monkeypatch):
    options = {"accuracy": 1e-4, "solver": solver, "form": form, "every": 20}
    whole = four_bar().simulate(0.2, checkpoint=tmp_path / "whole", **options)
    write, count = stored_runs.RunFiles.write, []

    class Killed(BaseException):
        pass

    def killing(*arguments):
        write(*arguments)
        count.append(1)
        if len(count) == 2:
            raise Killed

    with monkeypatch.context() as patched:
        patched.setattr(stored_runs.RunFiles, "write", killing)
        with pytest.raises(Killed):
            four_bar().simulate(0.2, checkpoint=tmp_path / "killed", **options)
    again = four_bar().simulate(0.2, checkpoint=tmp_path / "killed", **options)
    assert np.array_equal(again.solution.t, whole.solution.t)
    assert np.array_equal(again.solution.y, whole.solution.y)


def test_comparisons_and_maps_run_them():
    runs = [mb.Run(solver, form) for solver, form in OWN] + [mb.Run(Bogacki(rtol=1e-6), Accelerations())]
    found = mb.compare(four_bar(), 0.1, accuracies=(1e-3,), runs=[*runs, mb.Run(mb.RadauIIA(3), Stabilised())])
    assert len(found.runs) == len(runs) + 1
    assert all(run.error < 1e-3 for run in found.runs)
    mapped = mb.extremes(four_bar(), 0.1, {"coupler.mass": [0.6, 6.0]}, runs=runs, accuracy=1e-3)
    assert {(cell.form, cell.solver) for cell in mapped.cells} >= {(form.label, solver.label) for solver, form in OWN}
    assert not any(cell.failure for cell in mapped.cells)


def test_a_class_in_a_folder_of_the_package_is_known_by_its_names(monkeypatch):
    """Words, stored files and the runs of maps read the same list."""
    monkeypatch.setattr("mbdae.integrators.named.classes_in", lambda folder, base, called: (mb.IDA, Late))
    monkeypatch.setattr("mbdae.formulations.classes_in", lambda folder, base: (mb.GGL, Stabilised))
    named = [module.__dict__[name] for module in (mbdae.integrators.named, mbdae.formulations)
             for name in ("solver_words", "_full_names", "form_words") if name in vars(module)]
    for one in named:
        one.cache_clear()
    try:
        assert solver_of("late") == Late()
        assert form_of("stabilised") == Stabilised()
        assert ("Late", "Stabilised") in {(run.solver.label, run.form.label) for run in shipped_runs(free=False)}
    finally:
        for one in named:
            one.cache_clear()


def test_a_word_finds_its_file_in_the_folder(tmp_path, monkeypatch):
    """No other file of the folder is imported for it."""
    (tmp_path / "on_time.py").write_text("from mbdae.integrators.one_step import OneStep\n\n\nclass Punctual(OneStep):\n"
                                         "    order = 1\n\n    def advance(self, f, t, y, h):\n        return y + h * f(t, y)\n")
    (tmp_path / "other.py").write_text("raise AssertionError\n")
    monkeypatch.setattr(mbdae.integrators, "__path__", [str(tmp_path)])
    try:
        assert solver_of("punctual").label == "Punctual"
    finally:
        sys.modules.pop("mbdae.integrators.on_time")


#: texts that are no labels: prefixes of names in C, headings of reports
NO_LABELS = {"native": {"IDA", "Free"}, "reports": {"Friction", "Planar"}}


def test_no_label_of_a_form_solver_or_law_is_written_outside_of_its_class():
    labels = {form.label for form in forms()} | {variant.label for solver in solvers() for variant in solver.variants()}
    labels |= {made.__name__ for made in (*exported().values(), *solvers())}
    package = Path(mb.__file__).parent
    written = [f"{where}:{node.lineno}: {node.value}" for path in sorted(package.rglob("*.py")) if path.name != "__init__.py"
               for where in [path.relative_to(package)] for node in _texts(ast.parse(path.read_text(encoding="utf-8")), labels)
               if node.value not in NO_LABELS.get(where.parts[0], ())]  # __init__.py: lists of exported names
    assert written == []


def _texts(tree, labels):
    """Texts of a module that are labels, without those in the class of this name, those by which a class says something of itself
    (what it has measured, its label), and names that are imported at their first use."""
    lists = [n for n in tree.body if isinstance(n, ast.Assign) and ast.unparse(n.targets[0]) == "__all__"]  # exported names
    said, found = {id(node) for exported in lists for node in ast.walk(exported)}, []
    for made in ast.walk(tree):
        if isinstance(made, ast.ClassDef):
            stated = (entry for entry in made.body if isinstance(entry, ast.Assign | ast.AnnAssign))
            said |= {id(node) for entry in stated for node in ast.walk(entry)}
            said |= {id(node) for node in ast.walk(made) if getattr(node, "value", None) == made.name}
        elif isinstance(made, ast.Call) and ast.unparse(made.func) in ("Later", "later"):
            said |= {id(node) for node in made.args}
        elif isinstance(made, ast.Constant) and isinstance(made.value, str) and made.value in labels:
            found.append(made)
    return [node for node in found if id(node) not in said]
