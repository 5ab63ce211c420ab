"""Comparisons: errors are true, failures stay visible, table, picture and JSON tell the same."""

from __future__ import annotations

import json
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mbdae as mb
from mbdae.compare.measures import seconds
from mbdae.compare.table import Row, cells, with_front


def pendulum():
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("hinge", s.ground, rod, at=(0, 0))
    return s


@pytest.fixture(scope="module")
def w():
    """Two good runs, one with a step of its own, one that must fail."""
    runs = [mb.Run(mb.IDA()), mb.Run(mb.RadauIIA(3), mb.GGL()), mb.Run(mb.RadauIIA(2, step=0.01), label="constant step"),
            mb.Run(mb.IDA(), mb.Index3())]
    return mb.compare(pendulum(), 1.0, runs, accuracies=[1e-5, 1e-3], measure="hinge.angle")


def test_one_row_for_every_run_and_accuracy_coarse_first(w):
    asked = [(row.label, row.accuracy) for row in w.runs]
    assert asked == [("IDA GGL", 1e-3), ("IDA GGL", 1e-5), ("RadauIIA(3) GGL", 1e-3), ("RadauIIA(3) GGL", 1e-5),
                     ("constant step", None), ("IDA Index3", 1e-3), ("IDA Index3", 1e-5)]


def test_errors_are_those_against_an_independent_integration(w):
    from scipy.integrate import solve_ivp

    def truth(t):
        fine = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-12}
        return solve_ivp(lambda _, y: [y[1], -1.5 * 9.81 * np.cos(y[0])], (0, 1), [0, 0], t_eval=t, **fine).y[0]

    again = mb.compare(pendulum(), 1.0, [mb.Run(mb.RadauIIA(2, step=0.01))], measure="hinge.angle", reference=truth)
    assert again.runs[0].error == pytest.approx(w.runs[4].error, rel=1e-2)
    assert w.reference.difference < 1e-6


def test_reference_is_tighter_than_the_smallest_accuracy_and_confirmed_by_another_method(w):
    assert w.reference.accuracy <= 1e-6
    assert "Radau" in w.reference.label
    assert "IDA" in w.reference.confirmed_by
    assert w.reference.trusted
    assert f"{w.reference.difference:.1e}" in w.table()


def test_reference_is_tighter_than_solvers_with_a_tolerance_of_their_own():
    runs = [mb.Run(mb.RadauIIA(3, rtol=rtol)) for rtol in (1e-5, 1e-8)]
    w = mb.compare(pendulum(), 0.5, runs, [1e-2], measure="hinge.angle")
    assert w.reference.accuracy < 1e-9
    assert w.runs[1].error < 1e-2 * w.runs[0].error
    assert w.caution is None


def test_errors_below_what_is_known_of_the_reference_are_pointed_out(w):
    assert w.caution is None or min(row.error for row in w.runs if row.error) < w.reference.difference
    loose = replace(w, reference=replace(w.reference, difference=1e-3))
    assert loose.caution in loose.table()
    assert loose.caution in loose.to_html().replace("&#x27;", "'")


def test_a_comparison_in_which_every_run_fails_has_all_outputs(tmp_path):
    w = mb.compare(pendulum(), 0.1, [mb.Run(mb.IDA(), mb.Index3(), label="costs $1 or $2")], [1e-3])
    w.plot(tmp_path / "w.png")
    for text in (w.table(), w.to_json(), w.to_html()):
        assert "has index 3" in text
    assert "1e-03 was reached by no run." in w.decision
    assert w.pairwise.largest is None


def test_table_and_json_tell_the_same(w, tmp_path):
    w.to_json(tmp_path / "w.json")
    data = json.loads((tmp_path / "w.json").read_text(encoding="utf-8"))
    assert set(data) >= {"scene", "measure", "reference", "runs"}
    promised = {"label", "solver", "form", "model", "accuracy", "error", "cpu_s", "residuals", "jacobians", "factorisations",
                "failure"}
    lines = w.table(all_columns=True).splitlines()
    for entry in data["runs"]:
        assert set(entry) >= promised
        shown = [text for text in cells(Row(**entry)) if text]
        assert any(all(text in line for text in shown) for line in lines), shown


def test_a_failed_run_shows_its_reason_in_table_and_json(w):
    failed = [entry for entry in json.loads(w.to_json())["runs"] if entry["failure"]]
    assert [entry["label"] for entry in failed] == ["IDA Index3", "IDA Index3"]
    assert all(entry["error"] is None and "index 3" in entry["failure"] for entry in failed)
    assert "failed: IDA Index3 asked for 1e-03, 1e-05" in w.table()
    assert "index 3" in w.table()


def test_the_picture_names_runs_that_failed_with_their_reason(w):
    (legend,) = w.plot().legends
    told = [" ".join(text.get_text().split()) for text in legend.get_texts()]
    reason = w.failures[0].failure
    assert f"IDA Index3 (2 of 2 failed: {reason})" in told


def test_rows_carry_all_work_and_the_size_of_what_is_kept(w):
    row = w.runs[3]
    s = pendulum()
    r = s.simulate(1.0, solver=mb.RadauIIA(3).at_accuracy(1e-5, "GGL"), form=mb.GGL())
    stats = r.stats
    assert (row.steps, row.rejected, row.residuals) == (stats.steps, stats.rejected, stats.residuals)
    assert (row.jacobians, row.factorisations) == (stats.jacobians, stats.factorisations)
    assert row.newton_iterations == stats.newton_iterations > row.steps
    solution = r.solution
    assert row.stored_bytes == 8 * (solution.t.size + 2 * solution.y.size)


def test_pairwise_differences_are_in_table_and_json(w):
    found = json.loads(w.to_json())["pairwise"]
    assert found["runs"] == ["IDA GGL", "RadauIIA(3) GGL", "constant step"]
    assert found["asked"] == ["1e-05", "1e-05", "its own setting"]
    matrix = np.array(found["differences"])
    assert np.array_equal(matrix, matrix.T)
    assert 0 < matrix[0, 1] < 2e-5
    for text in (f"{matrix[1, 0]:.1e}", f"{matrix[2, 1]:.1e}", str(w.pairwise)):
        assert text in " ".join(w.table().split())


def test_a_run_that_stops_midway_keeps_its_counts_and_reason():
    truth = pendulum().simulate(50.0, accuracy=1e-2)  # given, so that the time limit is that of the run alone
    w = mb.compare(pendulum(), 50.0, [mb.Run(mb.RadauIIA(2, step=1e-4))], [1e-2], reference=truth, max_wall=0.5)
    assert "max_wall" in w.runs[0].failure
    assert w.runs[0].steps > 0
    assert w.runs[0].cpu_s > 0


def test_decision_names_the_cheapest_run_of_each_accuracy(w):
    for wanted in w.accuracies:
        best = w.cheapest(wanted)
        assert best.error <= wanted
        assert not any(row.error is not None and row.error <= wanted and row.cpu_s < best.cpu_s for row in w.runs)
        assert f"take {best.label}: {seconds(best.cpu_s)} in the solver" in w.decision or wanted != min(w.accuracies)


def test_the_front_holds_what_nothing_beats_in_both():
    rows = [Row("a", "", "", None, 1, error=1e-3, cpu_s=1.0), Row("b", "", "", None, 1, error=1e-4, cpu_s=2.0),
            Row("c", "", "", None, 1, error=1e-3, cpu_s=2.0), Row("d", "", "", None, 1, cpu_s=0.1, failure="no")]
    assert [row.pareto for row in with_front(rows)] == [True, True, False, False]


def test_whole_state_is_measured_without_a_sensor_and_a_result_serves_as_reference():
    s = pendulum()
    truth = s.simulate(1.0, accuracy=1e-9, solver=mb.RadauIIA(3))
    w = mb.compare(s, 1.0, [mb.Run(mb.RadauIIA(3))], [1e-4], reference=truth)
    assert "motion of the bodies" in w.what
    assert 0 < w.runs[0].error < 1e-3


def oscillator(t, y, yp, out):
    out[0], out[1] = yp[0] - y[1], yp[1] + y[0]


def test_equations_without_a_scene_are_compared_too():
    w = mb.compare(mb.DAE(oscillator, [1.0, 0.0], [0.0, -1.0]), 3.0, accuracies=[1e-4])
    assert [row.solver for row in w.runs] == ["IDA", "RadauIIA(2)", "RadauIIA(3)"]
    assert all(row.error < 1e-3 for row in w.runs)


def test_a_textbook_dae_of_index_2_gives_the_same_outputs(tmp_path):
    """Jay (1993): y1 = exp t, y2 = exp -2t, z = exp 2t."""

    def jay(t, y, yp, out):
        a, b, z = y
        out[:] = yp[0] - a * b**2 * z**2, yp[1] - a**2 * b**2 + 3 * b**2 * z, a**2 * b - 1

    problem = mb.DAE(jay, [1, 1, 1], [1, -2, 2], index=[1, 1, 2], names=["y1", "y2", "z"])
    runs = [mb.Run(mb.RadauIIA(2)), mb.Run(mb.RadauIIA(3)), mb.Run(mb.IDA()), mb.Run(mb.RadauIIA(3), model=mb.Classical())]
    w = mb.compare(problem, 0.5, runs, [1e-3, 1e-5], resume=tmp_path / "w.resume")
    assert [row.failure is None for row in w.runs] == [True] * 4 + [False] * 4
    assert all(row.error < 10 * row.accuracy for row in w.runs[:4])
    assert "a System has no joints" in w.runs[-1].failure
    w.plot(tmp_path / "w.svg")
    for text in (w.table(), w.to_json(), w.to_html()):
        assert "a System has no joints" in text
    assert mb.compare(problem, 0.5, runs, [1e-3, 1e-5], resume=tmp_path / "w.resume") == w


def test_solver_options_show_in_the_label_and_own_tolerances_run_once():
    runs = [mb.Run(mb.IDA(rtol=1e-7, max_order=2)), mb.Run(mb.RadauIIA(3), mb.GGL(algebraic=True))]
    w = mb.compare(pendulum(), 0.5, runs, [1e-3])
    assert [row.label for row in w.runs] == ["IDA[max_order=2] GGL", "RadauIIA(3) GGL[algebraic=True]"]
    assert [row.accuracy for row in w.runs] == [None, 1e-3]
    assert w.runs[0].rtol == 1e-7


def test_picture_has_two_logarithmic_panels_with_units(w, tmp_path):
    figure = w.plot(tmp_path / "w.png")
    assert (tmp_path / "w.png").read_bytes().startswith(b"\x89PNG")
    assert [(a.get_xscale(), a.get_yscale()) for a in figure.axes] == [("log", "log")] * 2
    assert figure.axes[0].get_ylabel() == "error: largest difference of hinge.angle [rad]"
    assert figure.axes[0].get_xlabel() == "CPU time [s]"


def test_total_work_is_that_of_the_solvers(w):
    assert w.cpu_s >= sum(row.cpu_s for row in w.runs if row.cpu_s is not None)
    assert w.total_cpu_s >= w.cpu_s


@pytest.mark.slow
def test_comparing_costs_little_beside_the_solvers():
    """3 solvers x 4 accuracies on ground resonance; everything, compilation included, against all solver calls."""
    example = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "ground_resonance.py"))
    runs = [mb.Run(s) for s in (mb.IDA(), mb.RadauIIA(2), mb.RadauIIA(3))]
    w = mb.compare(example["scene"](), example["t_end"], runs, measure=example["measure"])
    assert len(w.runs) == 12
    assert w.total_cpu_s < 1.5 * w.cpu_s


@pytest.mark.parametrize(("make", "said"), [
    (lambda: mb.Run("idas"), "solver = 'idas' is not one of 'cvode', 'cvodeadams'"),
    (lambda: mb.Run(mb.IDA(), "gg"), "form = 'gg' is not one of 'ggl'"),
    (lambda: mb.Run(mb.IDA(), model="clearance"), "model = 'clearance'"),
    (lambda: mb.compare(pendulum(), 1.0, []), "is empty: give one or more, such as"),
    (lambda: mb.compare(pendulum(), 1.0, accuracies=[]), r"accuracies = \[\] is empty"),
    (lambda: mb.compare(pendulum(), -1.0), "t_end = -1.0"),
    (lambda: mb.compare(pendulum(), 1.0, reference=3), "reference = 3"),
    (lambda: mb.compare(pendulum(), 1.0, reference=np.sin), "name the sensor"),
])
def test_wrong_options_are_named_with_their_value(make, said):
    with pytest.raises(mb.OptionError, match=said):
        make()


def test_an_unknown_sensor_is_refused_before_the_runs():
    with pytest.raises(mb.OptionError, match=r"measure = 'hinge\.angel': .*no sensor"):
        mb.compare(pendulum(), 1.0, measure="hinge.angel")


def test_peak_memory_is_that_of_the_run():
    """A large array that lives during a run counts, one freed before it does not."""
    import numpy as np

    from mbdae.compare.run import peak_bytes, reset_peak

    large = np.ones(40_000_000)
    del large
    if not reset_peak():
        assert mb.compare(pendulum(), 0.1, accuracies=[1e-3]).runs[0].peak_bytes is None
        return
    before = peak_bytes()
    held = np.ones(20_000_000)
    assert peak_bytes() - before > 0.9 * held.nbytes
    del held
    row = mb.compare(pendulum(), 0.1, accuracies=[1e-3]).runs[0]
    assert 10e6 < row.peak_bytes < before + 150e6
