"""Joint models side by side: one scene, prepared once per model, measured on what all models share."""

from __future__ import annotations

import numpy as np
import pytest

import mbdae as mb
from mbdae.compare import problem


def four_bar():
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    crank = s.link("crank", (0, 0), (0, 0.3), mass=0.3)
    coupler = s.link("coupler", (0, 0.3), (0.5, 0.6), mass=0.6)
    rocker = s.link("rocker", (0.5, 0.6), (0.6, 0), mass=0.5)
    s.revolute("A", s.ground, crank, at=(0, 0), angle=12.56 * mb.t)
    s.revolute("B", crank, coupler, at=(0, 0.3))
    s.revolute("C", coupler, rocker, at=(0.5, 0.6), spring=2.0, damper=0.01)
    s.revolute("D", s.ground, rocker, at=(0.6, 0))
    return s


@pytest.mark.parametrize("stated", [mb.Kinematic(), mb.Classical()])
def test_models_agree_on_the_motion_of_the_bodies_whatever_the_scene_states(stated):
    runs = [mb.Run(mb.RadauIIA(3), model=m) for m in (mb.Kinematic(), mb.Classical(), {"C": mb.Classical()}, None)]
    w = mb.compare(four_bar().replace(model=stated), 0.3, runs, [1e-3, 1e-6])
    assert not w.failures
    assert all(row.error <= 2 * row.accuracy for row in w.runs)
    assert w.pairwise.largest[0] < 3e-6
    assert [row.model for row in w.runs[::2]] == ["Kinematic", "Classical", "C: Classical", None]
    assert w.runs[4].label == "RadauIIA(3) GGL C: Classical"


def test_models_are_compared_on_a_sensor_too():
    w = mb.compare(four_bar(), 0.3, [mb.Run(mb.IDA(), model=mb.Classical(scaling=2.0))], [1e-5], measure="D.angle")
    assert w.runs[0].error < 1e-4
    assert w.runs[0].label == "IDA GGL Classical[scaling=2.0]"


def test_every_model_is_prepared_once(monkeypatch):
    calls = []
    prepare = problem.prepared_from
    monkeypatch.setattr(problem, "prepared_from", lambda *given: (calls.append(given), prepare(*given))[1])
    runs = [mb.Run(s, model=m) for s in (mb.IDA(), mb.RadauIIA(3)) for m in (None, mb.Classical(), {"B": mb.Classical()})]
    mb.compare(four_bar(), 0.1, runs, [1e-3, 1e-4])
    assert len(calls) == 3


def test_the_default_runs_cross_check_solvers_forms_and_models():
    w = mb.compare(four_bar(), 0.2, accuracies=[1e-4])
    forms = {f"RadauIIA(3) {form}" for form in ("GGL", "Index3", "Index1", "GGL Classical", "GGL Recursive")}
    assert {row.label for row in w.runs} == {"IDA GGL", "RadauIIA(2) GGL", "simulate: DOP853 Index1", *forms}
    assert w.pairwise.largest[0] < 1e-3


def test_differences_between_runs_are_those_of_their_trajectories():
    s = four_bar()
    runs = [mb.Run(mb.RadauIIA(2)), mb.Run(mb.RadauIIA(3))]
    w = mb.compare(s, 0.3, runs, [1e-2, 1e-3], measure="D.angle")
    tight = [run.solver.at_accuracy(1e-3, "GGL") for run in runs]
    times = np.linspace(0, 0.3, 1025)
    angles = [s.simulate(0.3, solver=solver, outputs=times)["D"].angle for solver in tight]
    d = w.pairwise.differences
    assert d[0][1] == d[1][0] == pytest.approx(np.max(np.abs(angles[0] - angles[1])), rel=1e-6)
    assert w.pairwise.asked == ("1e-03", "1e-03")


def test_a_model_that_cannot_be_is_a_failed_run_with_its_reason():
    runs = [mb.Run(mb.RadauIIA(3)), mb.Run(mb.RadauIIA(3), model={"nowhere": mb.Classical()})]
    w = mb.compare(four_bar(), 0.1, runs, [1e-3])
    assert [row.failure is None for row in w.runs] == [True, False]
    assert "nowhere" in w.runs[1].failure
    assert "nowhere" in w.table()


def test_a_model_without_a_joint_to_describe_fails_and_says_so():
    s = mb.Scene("ball", gravity=(1, 0, 0))
    s.distance("rope", s.ground, s.rigid_body("block", 1.0, (1.0, 1.0, 1.0)), at_k=(0, 1, 0), at_l=(0, 0, 0))
    row = mb.compare(s, 0.1, [mb.Run(mb.IDA(), model=mb.Classical())], [1e-3]).runs[0]
    assert "no joint with coordinates, which alone have joint models" in row.failure


@pytest.mark.parametrize("model", ["classical", {}, {"A": "classical"}, mb.Classical])
def test_anything_else_than_a_joint_model_is_refused(model):
    with pytest.raises(mb.OptionError, match="is not a joint model"):
        mb.Run(mb.IDA(), model=model)


def test_beams_are_compared_by_methods_that_suit_them():
    """Their reference resolves the vibrations; multistep methods would follow those for ever and are not among the defaults."""
    s = mb.Scene("rod", gravity=(0, -9.81, 0))
    rod = s.beam("rod", (0, 0), (1, 0), section=mb.Section.circular(0.02, 7e10, 0.3, 2700), elements=2)
    s.revolute("A", s.ground, rod, at=(0, 0))
    w = mb.compare(s, 0.1, accuracies=[1e-3])
    assert not any("IDA" in row.label or "CVODE" in row.label or row.failure for row in w.runs)
    assert "vibrations resolved" in w.reference.label
    assert w.reference.trusted
    assert all(row.error < 1e-2 for row in w.runs)


def test_joints_that_always_keep_their_coordinates_are_compared_by_the_bodies():
    """A screw has its angle among its unknowns in every model but the recursive one; the bodies move the same."""
    s, size = mb.Scene("chain", gravity=(0, 0.5, -9.81)), (0.02, 0.05, 0.04)
    a, b = s.rigid_body("a", 1.0, size, at=(0.4, 0, 0)), s.rigid_body("b", 1.0, size, at=(0.9, 0, 0))
    s.universal("U", s.ground, a, at=(0, 0, 0), axis=(1, 0, 0))
    s.screw("H", a, b, at=(0.6, 0, 0), axis=(1, 0, 0), lead=0.1, start_rate=3.0)
    models = (None, mb.Kinematic(), mb.Classical(), mb.Recursive(), {"H": mb.Recursive()}, {"U": mb.Classical()})
    for measure in (None, "H.angle_rate"):
        w = mb.compare(s, 0.2, [mb.Run(mb.RadauIIA(3), model=m) for m in models], [1e-4], measure=measure)
        assert [row.failure for row in w.runs] == [None] * len(models)
        assert all(row.error < 1e-3 for row in w.runs)  # rad/s for the sensor, of 3 rad/s
        assert w.runs[3].form == "ODE"
