"""Batches: the steps of single runs, whatever happens to other points; what is refused; what stops one."""

import time

import numpy as np
import pytest
import sympy

import mbdae as mb
from mbdae.errors import WallClockError
from mbdae.integrators.batch import solve_batch
from mbdae.native import explicit
from mbdae.native.explicit import Batch
from mbdae.run.batch import Batches, run_batch

SOLVER = mb.DOP853(rtol=1e-8)


def arm(forearm: float = 1.3, damper: float = 0.01) -> mb.Scene:
    """Two bodies on hinges across each other, with a spring and a torque, so that laws outside of the tree act."""
    s = mb.Scene("arm", gravity=(0, 0, -9.81))
    upper = s.rigid_body("upper", 2.1, (0.02, 0.21, 0.22), at=(0.5, 0, 0))
    lower = s.rigid_body("lower", forearm, (0.03, 0.12, 0.11), at=(1.4, 0, 0))
    s.revolute("shoulder", s.ground, upper, at=(0, 0, 0), axis=(0, 1, 0), spring=3.7, torque=0.7 * mb.t)
    s.revolute("elbow", upper, lower, at=(1, 0, 0), axis=(0, 0.6, 0.8), rate0=0.3, damper=damper)
    return s


def system(forearm: float = 1.3):
    return arm(forearm).recursive().system(mb.ODE())


def growing(fails=None):
    """y' = y^2, which has no solution beyond t = 1 / y(0)."""

    def rhs(t, y, out):
        if fails is not None:
            fails(t, y)
        out[:] = y**2

    def residual(t, y, yp, out):
        out[:] = yp - y**2

    return mb.DAE(residual, np.array([0.5]), np.array([0.25]), rhs=rhs, scale=1.0)


def test_points_are_single_runs_bit_for_bit():
    masses, times = [0.4, 1.3, 5.2], np.linspace(0, 2, 38)
    same = system()
    starts = same.y0 + np.array([[0, 0, 0, 0], [0.1, 0.2, 0.3, 0.4], [0.5, 0, 0, 2]])
    found = solve_batch(same, 2.0, SOLVER, starts=starts, numbers={"lower.mass": masses}, outputs=times)
    only_ends = solve_batch(same, 2.0, SOLVER, starts=starts, numbers={"lower.mass": masses})
    assert found.failures == []
    for i, mass in enumerate(masses):
        own = same.numbers(["lower.mass"])
        assert np.all(own.W[own.slots] == 1.3)  # put back
        alone, rate = system(mass), np.empty(4)
        alone.rhs(0.0, starts[i], rate)
        run = mb.DOP853(rtol=1e-8, atol=1e-8 * same.scale).solve(alone.starting(0.0, starts[i], rate), 2.0, outputs=times)
        assert np.array_equal(found.last[i], run.y[-1])
        assert np.array_equal(found.last[i], only_ends.last[i])
        assert (found.steps[i], found.rejected[i]) == (run.stats.steps, run.stats.rejected)
        assert np.array_equal(found.y[i, [0, -1]], run.outputs.y[[0, -1]])
        assert np.max(np.abs(found.y[i] - run.outputs.y)) < 1e-12 * np.max(np.abs(run.y))
        assert only_ends.evaluations[i] < found.evaluations[i] <= run.stats.residuals
    assert not np.array_equal(found.last[0], found.last[1])


def test_eliminated_multipliers_make_batches_too():
    free = mb.Scene("four", gravity=(0, -9.81))
    a, b = (free.link(n, *ends, mass=1.3) for n, ends in (("a", ((0, 0), (1, 0))), ("b", ((1, 0), (2, 0)))))
    free.revolute("A", free.ground, a, at=(0, 0), spring=2.5)
    free.revolute("B", a, b, at=(1, 0))
    index1 = free.system(mb.Index1(multipliers="eliminated"))
    found = solve_batch(index1, 0.5, SOLVER, starts=np.array([index1.y0] * 2))
    run = SOLVER.solve(index1, 0.5)
    if found.steps[0] == run.stats.steps:  # one that looks at its steps is run point by point
        assert np.array_equal(found.last[0], run.y[-1])
    assert np.array_equal(found.last[0], found.last[1])
    with pytest.raises(mb.OptionError, match=r"a\.mass"):
        solve_batch(index1, 0.5, SOLVER, numbers={"a.mass": [1.3, 2.0]})


def test_a_point_that_fails_costs_only_itself():
    starts = np.array([[0.5], [1.25], [0.25]])
    found = solve_batch(growing(), 1.0, SOLVER, starts=starts, outputs=[0.5, 1.0])
    assert found.failures == [1]
    assert np.isnan(found.y[1]).all()
    assert found.y[[0, 2], :, 0] == pytest.approx(np.array([[2 / 3, 1.0], [2 / 7, 1 / 3]]), rel=1e-7)
    with pytest.raises(mb.SolverError) as single:
        SOLVER.solve(growing().starting(0.0, starts[1], starts[1] ** 2), 1.0)
    assert found.errors == (None, str(single.value), None)


@pytest.mark.parametrize("seconds", [0.05, 1e-5, 0.0])
def test_a_point_of_a_scene_that_fails_leaves_the_next_its_own_numbers(seconds, monkeypatch):
    """The point that fails is run again for its message, while the next one is under way where a slice of time ends within it:
    its numbers have to stand there when it goes on."""
    monkeypatch.setattr(explicit, "SLICE", seconds)
    masses = np.array([1.3, -3.0, 0.4, 0.9])  # of a negative mass the mass matrix is not positive definite
    found = solve_batch(system(), 2.0, SOLVER, numbers={"lower.mass": masses})
    good = [0, 2, 3]
    assert found.failures == [1]
    assert "has no inertia" in found.errors[1]
    assert np.array_equal(found.last[good], solve_batch(system(), 2.0, SOLVER, numbers={"lower.mass": masses[good]}).last)


def test_what_a_right_hand_side_raises_is_the_message_of_its_point():
    def fails(t, y):
        if y[0] > 1.5:
            raise ArithmeticError("too large")

    found = solve_batch(growing(fails), 1.0, SOLVER, starts=[[0.5], [0.8], [0.25]])
    assert found.errors == (None, "ArithmeticError: too large", None)
    assert found.last[2, 0] == pytest.approx(1 / 3, rel=1e-7)


def test_ctrl_c_comes_out_with_the_points_done():
    def stop(t, y):
        if y[0] > 1.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match="1 of 3 points") as stopped:
        solve_batch(growing(stop), 1.0, SOLVER, starts=[[0.5], [0.8], [0.25]])
    batch = stopped.value.solution
    assert batch.errors[0] is None
    assert batch.failures == [1, 2]
    assert np.isnan(batch.last[1:]).all()


def test_the_wall_clock_is_looked_at_within_a_point_and_between_points():
    told = []
    with pytest.raises(WallClockError, match="points are done") as stopped:
        solve_batch(growing(lambda t, y: time.sleep(0.01)), 1.0, SOLVER, starts=[[0.5]] * 1000, max_wall=0.2,
                    progress=lambda done, total: told.append((done, total)))
    assert len(stopped.value.solution.failures) > 990
    with pytest.raises(WallClockError, match="0 of 1 points"):
        solve_batch(system(), 1e7, SOLVER, max_wall=0.2)


def test_watched_systems_run_point_by_point():
    s = mb.Scene("stop", gravity=(0, -9.81))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.3)
    s.revolute("A", s.ground, rod, at=(0, 0), torque=sympy.Piecewise((1, mb.t < 0.4), (0, True)))
    watched = s.recursive().system(mb.ODE())
    found = solve_batch(watched, 1.0, SOLVER, starts=[watched.y0] * 2)
    assert np.array_equal(found.last[0], SOLVER.solve(watched, 1.0).y[-1])


@pytest.mark.parametrize(("options", "said"), [
    ({"numbers": {"lower.weight": [1.0]}}, "lower.weight is no number of a law; those that may vary: .*lower.mass"),
    ({"numbers": {"lower.mass": [1.0, 2.0, 3.0]}, "starts": np.zeros((2, 4))},
     r"equally many of each; the shapes given are: starts \(2, 4\), lower.mass \(3,\)"),
    ({"numbers": ["lower.mass"]}, "give a mapping of names"),
    ({"starts": np.zeros((2, 3))}, r"starts has shape \(2, 3\)"),
    ({"starts": np.full((2, 4), np.nan)}, "starts"),
    ({"solver": mb.IDA()}, "give mb.DOP853"),
])
def test_wrong_options_are_refused(options, said):
    with pytest.raises(mb.OptionError, match=said):
        solve_batch(system(), 1.0, **options)


def test_numbers_that_are_compiled_in_are_refused():
    """A mass of 1 kg is part of the kernels of a tree: to vary its place would change nothing."""
    with pytest.raises(mb.OptionError, match="compiled in"):
        solve_batch(system(forearm=1.0), 1.0, SOLVER, numbers={"lower.mass": [1.0, 2.0]})
    # equations with all numbers as inputs
    assert Batches(arm(forearm=1.0), 1.0, numbers=["lower.mass"]).read({"lower.mass": 2.0})
    with pytest.raises(mb.OptionError, match="are functions"):
        solve_batch(growing(), 1.0, SOLVER, numbers={"a.b": [1.0]})


@pytest.mark.parametrize("change", [{"slots": np.array([4])}, {"slots": np.array([-1])}, {"numbers": np.ones((2, 2))},
                                    {"times": np.array([0.5, 0.4])}, {"times": np.array([1.5])}, {"times": np.array([np.nan])},
                                    {"end": -1.0}])
def test_wrong_tables_are_refused(change):
    good = {"begin": 0.0, "end": 1.0, "starts": np.ones((2, 3)), "times": np.array([0.5, 1.0]), "W": np.zeros(4),
            "slots": np.array([3]), "numbers": np.ones((2, 1))}
    Batch(**good)
    with pytest.raises(ValueError, match=r"a batch of 2 runs was given values|a batch was given output times"):
        Batch(**good | change)


def test_runs_of_a_scene_have_their_errors():
    masses = np.linspace(0.4, 5.0, 5)
    runs = run_batch(arm(), 2.0, 1e-7, numbers={"lower.mass": masses}, outputs=[1.0, 2.0])
    assert runs.warnings == {}
    assert np.all(runs.estimate <= 1e-7)
    for i in (0, 4):
        exact = mb.DOP853(rtol=1e-13).solve(system(masses[i]), 2.0, outputs=[1.0, 2.0]).outputs.y
        assert np.max(np.abs(runs.batch.y[i] - exact)) < 20 * runs.estimate[i] + 1e-10
    assert np.array_equal(runs.batch.t, [1.0, 2.0])


def test_points_that_miss_the_accuracy_are_repeated_and_failures_told(monkeypatch):
    monkeypatch.setitem(mb.DOP853.factors["DOP853"], "ODE", 3.0)  # begins far too coarse
    runs = run_batch(arm(), 2.0, 1e-6, numbers={"lower.mass": [0.4, -3.0, 1.3]})
    assert "has no inertia" in runs.warnings.pop(1)
    assert runs.warnings == {}
    assert np.isnan(runs.estimate[1])
    assert np.all(runs.estimate[[0, 2]] <= 1e-6)


def test_stiff_scenes_are_refused_by_name():
    with pytest.raises(mb.OptionError, match="a batch is solved by DOP853, but mbdae solves this scene by RadauIIA"):
        run_batch(arm(damper=1e4), 1.0)
