"""What a comparison decides: measures beside each other, ties of the clock, models apart from methods."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbdae as mb
from mbdae.compare.measures import decision, rivals, seconds
from mbdae.compare.table import Row


def pendulum() -> Any:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    return s


@pytest.fixture(scope="module")
def w() -> Any:
    return mb.compare(pendulum(), 1.0, [mb.IDA(), mb.RadauIIA(3), mb.Run(mb.RadauIIA(3), mb.Index3())], [1e-3, 1e-5])


def test_every_measure_has_its_error(w: Any) -> None:
    """Motion, joint forces in N and energy in J, against the pendulum's own equations by SciPy."""
    t = np.linspace(0, 1, 1001)
    y = solve_ivp(lambda _, y: [y[1], -1.5 * 9.81 * np.cos(y[0])], (0, 1), [0, 0], "DOP853", t, rtol=1e-12, atol=1e-12).y
    for row in (one for one in w.runs if one.label == "RadauIIA(3) GGL"):
        solver = mb.RadauIIA(3).at_accuracy(row.accuracy, "GGL")
        r = pendulum().simulate(1.0, solver=solver, form=mb.GGL(), outputs=t)
        force = r["hinge"].force[::5, :2]
        a, v, q = -1.5 * 9.81 * np.cos(y[0]), y[1], y[0]
        along, across = -0.5 * v**2, 0.5 * a
        exact = np.stack([along * np.cos(q) - across * np.sin(q), along * np.sin(q) + across * np.cos(q) + 9.81], axis=1)[::5]
        assert row.errors["joint forces"] == pytest.approx(np.max(np.abs(force - exact)), rel=1.0)
        energy = r.energy
        off = np.max(np.abs((energy.kinetic + energy.potential)[::5] - (energy.kinetic + energy.potential)[0]))
        assert row.errors["energy"] == pytest.approx(off, rel=1.0)
        assert row.errors["motion"] == row.error
    data = w.to_dict()
    assert data["measures"] == {"motion": "", "joint forces": "N", "energy": "J"}
    assert set(data["runs"][0]["errors"]) == set(data["measures"])


def test_runs_are_asked_for_quantities() -> None:
    """Errors over the largest values, of a component of a force with a known size, an expression and a function; beside them what
    each run tells of them, which covers the error."""
    def power(r: Any) -> Any:
        return r["hinge"].force[:, 1] * r["rod"].velocity[:, 1]

    asked = ["hinge.force[1]", "norm(hinge.force)*rod.position[0]", power]
    w = mb.compare(pendulum(), 1.0, [mb.RadauIIA(3), mb.Run(mb.RadauIIA(3, rtol=1e-4))], [1e-3, 1e-5], of=asked)
    names = ["hinge.force[1]", "norm(hinge.force)*rod.position[0]", "power"]
    assert list(w.units) == [*names, "motion"]
    exact = pendulum().simulate(1.0, accuracy=1e-10)
    for row in w.runs:
        r = pendulum().simulate(1.0, solver=mb.RadauIIA(3, rtol=row.rtol), form=mb.GGL(), outputs=exact.t)
        off = np.max(np.abs(r["hinge"].force - exact["hinge"].force)[:, 1]) / np.max(np.abs(exact["hinge"].force[:, 1]))
        assert row.errors[names[0]] == pytest.approx(off, rel=0.5)
        assert row.error == row.errors[names[0]]
    assert all(set(row.estimates) == set(names) for row in w.runs)
    pairs = [(row.errors[name], row.estimates[name]) for row in w.runs for name in names]
    assert all(error <= 3 * told <= 300 * max(error, 1e-12) for error, told in pairs)
    assert any(row.chosen for row in mb.compare(pendulum(), 0.5, accuracies=[1e-4], of={"load": "hinge.force"}).runs)
    assert f"({w.runs[0].estimates[names[0]]:.1e})" in w.table()
    named = mb.compare(pendulum(), 0.5, [mb.IDA()], [1e-4], measure="hinge.angle", of="hinge.force")
    assert list(named.units) == ["hinge.angle", "hinge.force"]
    with pytest.raises(mb.OptionError, match=r"^of = "):
        mb.compare(pendulum(), 0.5, of=["hinge.colour"])
    with pytest.raises(mb.OptionError, match=r"a System has no sensors"):
        mb.compare(pendulum().system(), 0.5, of=["hinge.force"])


def test_named_measures_are_those_asked_for() -> None:
    w = mb.compare(pendulum(), 0.5, [mb.RadauIIA(3)], [1e-4], measure=["hinge.angle", "hinge.force"])
    assert list(w.runs[0].errors) == ["hinge.angle", "hinge.force"]
    assert w.runs[0].error == w.runs[0].errors["hinge.angle"]
    assert "largest difference of hinge.force, N" in w.table()
    assert set(w.reference.differences) == {"hinge.angle", "hinge.force"}
    with pytest.raises(mb.OptionError, match=r"give one name or more, each once"):
        mb.compare(pendulum(), 0.5, measure=["hinge.angle", "hinge.angle"])


def test_unknowns_of_own_equations_are_measures() -> None:
    def oscillator(t: float, y: Any, yp: Any, out: Any) -> None:
        out[0], out[1] = yp[0] - y[1], yp[1] + y[0]

    dae = mb.DAE(oscillator, [1.0, 0.0], [0.0, -1.0], names=["x", "v"])
    row = mb.compare(dae, 3.0, [mb.RadauIIA(3)], [1e-4], measure=["v", "x"]).runs[0]
    solution = mb.RadauIIA(3).at_accuracy(1e-4, dae.label).solve(dae, 3.0)
    t = np.linspace(0, 3, 1001)
    assert row.errors["v"] == pytest.approx(np.max(np.abs(solution(t)[:, 1] + np.sin(t))), rel=0.1)
    assert row.error == row.errors["v"]
    with pytest.raises(mb.OptionError, match=r"there is no such unknown: .*the System has x, v"):
        mb.compare(dae, 3.0, measure="y")


def test_a_clock_that_ticks_in_10_ms_says_what_it_cannot_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimpleNamespace(process_time=lambda: round(time.process_time(), 2))
    monkeypatch.setattr(sys.modules[Row.__module__.replace("table", "run")], "time", clock)
    w = mb.compare(pendulum(), 0.2, [mb.RadauIIA(3), mb.Run(mb.RadauIIA(3), mb.Index1())], [1e-3])
    assert w.tick == pytest.approx(0.01)
    assert "The clock (it ticks in 10 ms) does not tell it from" in w.decision
    assert all(row.cpu_spread_s > 0 for row in w.runs)


def test_what_simulate_does_is_a_row_unless_runs_are_named(w: Any) -> None:
    assert not any(row.label.startswith("simulate") for row in w.runs)
    found = mb.compare(pendulum(), 0.2, accuracies=[1e-3])
    own = found.runs[-1]
    assert own.label == "simulate: DOP853 ODE"
    assert own.call_s > own.cpu_s > 0
    assert found.cheapest(1e-3) is not own
    assert f"`simulate` takes DOP853 ODE, {seconds(own.call_s)} a call for 1e-03." in found.decision


def test_a_label_does_not_make_a_run_the_choice_of_simulate() -> None:
    w = mb.compare(pendulum(), 0.1, [mb.Run(mb.RadauIIA(3), label="simulate by hand")], [1e-3])
    assert w.cheapest(1e-2) is w.runs[0]
    assert w.decision.startswith("For 1e-03 take simulate by hand: ")


def test_another_scene_is_part_of_what_is_resumed(tmp_path: Path) -> None:
    """Two scenes of the same statements under another gravity are two models."""
    def run(gravity: float) -> Any:
        other = mb.Scene("pendulum", gravity=(0, gravity, 0))
        other.revolute("hinge", other.ground, other.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
        runs = [mb.RadauIIA(3), mb.Run(mb.RadauIIA(3), scene=other, label="elsewhere")]
        return mb.compare(pendulum(), 0.1, runs, [1e-3], resume=tmp_path / "w.json")

    run(-1.6)
    with pytest.raises(mb.OptionError, match=r"holds another comparison: .*gravity"):
        run(-3.7)


def test_all_solvers_on_request() -> None:
    few, many = (mb.compare(pendulum(), 0.1, accuracies=[1e-2], runs=runs) for runs in (None, "all"))
    assert {row.label for row in few.runs} < {row.label for row in many.runs}
    assert {"HHT GGL", "DOP853 Index1"} <= {row.label for row in many.runs}


def test_models_are_no_errors_of_methods() -> None:
    """A joint with play beside the ideal one: each method is measured against a reference of its own model, and the difference of
    the models, which is about the play, is told beside, never ranked."""
    s = pendulum()
    play = mb.Clearance(outer=0.0105, inner=0.0100, normal=mb.Hertz(1e7, 0.5))
    runs = [mb.Run(mb.RadauIIA(3)), mb.Run(mb.RadauIIA(3), model=play)]
    w = mb.compare(s, 0.3, runs, [1e-4])
    ideal, with_play = w.runs
    assert (ideal.loose, with_play.loose) == ("", with_play.model)
    assert with_play.error < 1e-3
    assert not with_play.pareto
    assert w.cheapest(1e-1) is ideal
    assert 1e-4 < w.models[with_play.model]["motion"] < 0.5
    assert f"{with_play.model} changes the motion by" in w.decision
    assert "another model" in w.to_html()


def test_another_scene_is_another_model() -> None:
    """A flexible rod beside the rigid one, by sensors that both have; several solvers each."""
    flexible = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    section = mb.Section.rectangular(0.02, 0.02, E=2e9, nu=0.3, rho=2500)
    flexible.revolute("hinge", flexible.ground, flexible.beam("rod", (0, 0), (1, 0), section=section, elements=2), at=(0, 0))
    solvers = (mb.RadauIIA(2), mb.RadauIIA(3))
    runs = [mb.Run(mb.RadauIIA(3)), *(mb.Run(solver, scene=flexible, label="flexible") for solver in solvers)]
    w = mb.compare(pendulum(), 0.2, runs, [1e-4], measure=["hinge.angle", "hinge.force"])
    assert [row.loose for row in w.runs] == ["", "flexible", "flexible"]
    assert len({row.label for row in w.runs}) == 3
    assert all(row.error < 1e-3 < w.models["flexible"]["hinge.force"] for row in w.runs)
    assert f"flexible changes hinge.angle by {w.models['flexible']['hinge.angle']:.1e} rad" in w.decision
    with pytest.raises(mb.OptionError, match=r"give a mb\.Scene with label="):
        mb.Run(mb.IDA(), scene=flexible)


def test_lost_digits_and_ties_are_named(w: Any) -> None:
    other = {"motion": 1e-6, "energy": 1e-6}
    rows = [Row(name, name, "", None, 1e-5, 1e-6, 1e-6, 1e-3, 1e-5, errors={**other, "joint forces": force})
            for name, force in (("a", 1e-6), ("b", 1e-6), ("c", 1e-3))]
    found = decision(replace(w, runs=tuple(rows), accuracies=(1e-5,)))
    assert "c loses digits of joint forces: 1.0e-03 N, where others have 1.0e-06 N." in found
    assert "For 1e-05 take a: 1 ms in the solver." in found
    assert "does not tell them from b, c." in found
    assert rivals(rows, 1e-5) == [0, 1, 2]
    assert [seconds(x) for x in (3.21e-4, 0.05, 12.3, None)] == ["321 us", "50 ms", "12.3 s", "-"]
