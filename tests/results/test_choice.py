"""What a default run chooses: predicted by `check`, told by the result, safe where the choice does not hold."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from scenes import andrews, n_four_bar

import mbdae as mb
import mbdae.run.choice as choices

EXAMPLES = Path(__file__).parent.parent.parent / "examples"
LONG = ("arm_control", "clearance_rotor")
PRINTED = ("four_bar", "pendulum", "quarter_car")


def chain(n: int, **options: Any) -> mb.Scene:
    s = mb.Scene("chain", gravity=(0, -9.81, 0))
    before = s.ground
    for i in range(n):
        rod = s.link(f"rod{i}", (i, 0), (i + 1, 0), mass=1.0)
        s.revolute(f"J{i}", before, rod, at=(i, 0), **options)
        before = rod
    return s


#: parts of their time that motions take to vibrate or decay as `check` counts with
LONG_ENOUGH = {"heavy_top": 1e-2, "ground_resonance_map": 0.1, "ground_resonance_boundary": 0.1, "bicycle": 0.1,
               "rolling_coin": 0.1, "snap_through": 0.5}

#: examples that start at rest: how slowly they change is bounded by the length of a run, which `check` does not know
AT_REST = ("snap_through",)


# every second example at 1e-8, the others at 1e-5
@pytest.mark.parametrize(("name", "accuracy"), [
    pytest.param(path.stem, accuracy, marks=[pytest.mark.slow] * (path.stem in LONG or i % 2 != (accuracy < 1e-6)))
    for i, path in enumerate(sorted(EXAMPLES.glob("*.py"))) for accuracy in (1e-5, 1e-8)])
@pytest.mark.filterwarnings("ignore::mbdae.AccuracyWarning")
def test_check_predicts_what_is_run(name: str, accuracy: float, monkeypatch: Any) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    example = importlib.import_module(name)
    checked = example.scene().check(accuracy)
    predicted = checked.choice
    part = LONG_ENOUGH.get(name, 1e-4)
    r = example.scene().simulate(part * example.t_end, accuracy)
    assert r.info.choice == str(predicted) or name in AT_REST
    assert (type(r.info.solver), r.info.form) == (type(predicted.solver), predicted.form.label)
    if name in PRINTED:  # which builds all formulations for their sizes
        assert predicted.why in str(checked)


@pytest.mark.parametrize("accuracy", [1e-3, 1e-8])
def test_open_joints_of_a_tree_become_recursive(accuracy: float) -> None:
    choice = chain(2).check(accuracy).choice
    assert choice.recursive == ("J0", "J1")
    assert isinstance(choice.solver, mb.DOP853)
    r = chain(2).simulate(0.5, accuracy)
    stated = chain(2).simulate(0.5, accuracy, solver=mb.RadauIIA(3), form=mb.GGL())
    assert r.info.form == "ODE"
    for sensor in ("J0.angle", "rod1.velocity", "J1.force"):
        known = stated.read(sensor)
        np.testing.assert_allclose(r.read(sensor), known, atol=50 * accuracy * np.max(np.abs(known)))


@pytest.mark.parametrize("joints", [6, 10])
def test_arms_of_usual_size_become_recursive(joints: int) -> None:
    """A robot in space with six axes, or ten, has as many joint coordinates and speeds as unknowns."""
    s = mb.Scene("arm", gravity=(0, 0, -9.81))
    before: Any = s.ground
    for i in range(joints):
        link = s.rigid_body(f"link{i}", 1.0, (0.01, 0.09, 0.08), at=(i + 0.5, 0.1, 0))
        s.revolute(f"q{i}", before, link, at=(i, 0, 0), axis=(0, 1, 0) if i % 2 else (0, 0, 1), damper=0.5)
        before = link
    choice = s.check().choice
    assert len(choice.recursive) == joints
    assert choice.prepared.all_bodies.nq + choice.prepared.all_bodies.nu == 2 * joints


@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical()])
def test_a_model_that_is_named_is_kept(model: mb.JointModel) -> None:
    assert chain(2, model=model).check().choice.recursive == ()
    assert chain(2, model=model).simulate(0.1).info.form == "Index1"


def test_large_trees_become_recursive_and_loops_and_chosen_forms_stay_as_stated() -> None:
    assert len(chain(26).check().choice.recursive) == 26
    assert andrews().check().choice.recursive == ()
    assert chain(2).simulate(0.1, form=mb.GGL()).info.form == "GGL"
    assert chain(2).simulate(0.1, solver=mb.RadauIIA(3)).info.form == "GGL"


def test_runs_continue_each_other_whatever_their_joints() -> None:
    s = chain(2)
    whole = s.simulate(0.6, accuracy=1e-8)["rod1"].position[-1]
    lean = s.simulate(0.2, accuracy=1e-8)
    full = s.simulate(0.4, accuracy=1e-8, solver=mb.IDA(), start=lean)
    again = s.simulate(0.6, accuracy=1e-8, start=full)
    assert (lean.info.form, full.info.form, again.info.form) == ("ODE", "GGL", "GGL")
    assert s.simulate(0.4, start=lean).info.form == "ODE"
    np.testing.assert_allclose(again["rod1"].position[-1], whole, atol=1e-6)


def test_places_are_found_and_files_read(tmp_path: Path) -> None:
    """Bodies of the scene as stated name those of the run, also of a loaded one."""
    s = chain(2)
    r = s.simulate(0.3)
    r.save(tmp_path / "run.npz")
    loaded = mb.load(tmp_path / "run.npz")
    tip = s["rod1"].at((2, 0))
    for found in (r, loaded):
        np.testing.assert_allclose(found[tip].position, found["rod1"].at((2, 0)).position)
        assert np.ptp(found[tip].position) > 0.1
    assert loaded.info.choice == r.info.choice
    assert loaded.info.form == "ODE"


def test_a_scene_with_a_law_from_inside_a_function_gets_recursive_joints() -> None:
    class Slow(mb.Force):
        params = mb.params(c="N s/m")

        def wrench(self, k: Any, l: Any) -> Any:
            return (l.v - k.v) * (-self.c), l.r * 0.0

    s = chain(1)
    s.add(Slow("drag", s.ground, s["rod0"], at=(1, 0), c=0.1))
    assert s.check().choice.recursive == ("J0",)


def test_where_eliminated_multipliers_stop_radau_takes_over_and_says_so() -> None:
    """A four-bar whose bars are equally long passes flat positions, where another branch begins: how much of the accuracy is left
    beyond them depends on round-off, and is told."""
    scene = n_four_bar(2)
    assert isinstance(scene.check(1e-8).choice.solver, mb.DOP853)
    r = scene.simulate(1.0, 1e-8)
    assert isinstance(r.info.solver, mb.RadauIIA)
    assert "singular position" in r.info.choice
    assert r.accuracy.met or any("1e-08 was asked" in note for note in r.warnings)


def test_decay_and_vibration_decide_between_explicit_methods_and_radau() -> None:
    def damped(damper: float, spring: float) -> Any:
        s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
        rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
        s.revolute("hinge", s.ground, rod, at=(0, 0), damper=damper, spring=spring)
        return s.check(1e-8).choice

    assert isinstance(damped(0.1, 1.0).solver, mb.DOP853)
    for stiff in (damped(1e5, 1.0), damped(0.1, 1e7)):
        assert isinstance(stiff.solver, mb.RadauIIA)
        assert "stiff" in stiff.why


def test_the_largest_eigenvalues_of_a_large_system_are_those_of_its_jacobian() -> None:
    """A chain with strong dampers, by products with the Jacobian and by the Jacobian itself."""
    s = chain(155, spring=1.0, damper=100.0).recursive()
    system = s.system(mb.ODE())
    assert system.n > choices.EIGENVALUES
    every = np.linalg.eigvals(system.rate_jacobian(system.t0, system.y0))
    found = choices._largest_eigenvalues(system)
    assert found.shape == (choices.LARGEST,)
    assert np.max(np.abs(found)) == pytest.approx(np.max(np.abs(every)), rel=0.05)


@pytest.mark.parametrize("make", [andrews, lambda: n_four_bar(2), lambda: chain(3, damper=0.3)])
def test_finite_eigenvalues_are_those_of_scipys_pencil(make: Any) -> None:
    """Those that are not zero: by motions that satisfy the rows without a derivative, and by QZ."""
    prepared = make().system("ggl")._prepared
    system = choices.system_for(prepared, choices.GGL())
    fy, fyp = system.dense_parts(system.t0, system.y0, system.yp0)
    pencil = scipy.linalg.eigvals(-fy, fyp)
    size = max(abs(pencil[np.isfinite(pencil)]))
    found, wanted = (np.sort_complex(values[np.isfinite(values) & (abs(values) > 1e-4 * size)])
                     for values in (choices.finite_eigenvalues(fy, fyp), pencil))
    np.testing.assert_allclose(found, wanted, rtol=1e-6)


def test_eigenvalues_of_bodies_without_mass_are_those_of_scipy() -> None:
    """x' and y' appear in one sum only: y follows from the second row, which has a derivative too."""
    fy, fyp = np.array([[1.0, 0.0], [0.0, 2.0]]), np.array([[1.0, 1.0], [1.0, 1.0]])
    found = choices.finite_eigenvalues(fy, fyp)
    assert np.isfinite(found).sum() == 1
    assert found[np.isfinite(found)].real == pytest.approx(-2 / 3)
