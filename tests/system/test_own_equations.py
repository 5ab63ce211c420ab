"""Equations of a user's own by accuracy: errors of every unknown, the declared index, the start, differences."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from dae_problems import circle, decay, jay, jay_exact, pendulum, pendulum_exact
from own_equations.problems import amplifier

import mbdae as mb
from mbdae.integrators.solution import rejecting
from mbdae.results.accuracy import Unknowns, UnknownsDistance

NAMES = ["x", "y", "vx", "vy", "pull"]
#: the amplifier at 0.05 s, V, by RadauIIA(5) at rtol 1e-12, whose values at 0.2 s have the published digits to 1e-12
AT_50_MS = np.array([-0.005561938096, 3.00652153, 2.849957832, 3.467288463, 2.434184477,
                     2.494964052, 5.535355378, 0.4726943459])


def hanging(index=3, y0=(1, 0, 0, 0, 0), **options):
    """The pendulum of index 3 without a Jacobian."""
    d = pendulum("index3")
    yp0 = [y0[2], y0[3], -y0[4] * y0[0], -9.81 - y0[4] * y0[1], 0]
    return mb.DAE(d.residual, y0, yp0, index=index, names=NAMES, **options)


def test_every_unknown_is_as_accurate_as_asked():
    r = hanging().simulate(2.0, 1e-4)
    x, y, u, v = pendulum_exact(r.t, 2.0).T
    exact = np.array([x, y, u, v, u * u + v * v - 9.81 * y]).T
    assert np.max(UnknownsDistance(np.ones(5))(r.t, r.y, exact)) < 1e-4
    assert r.reliable
    assert r.warnings == ()
    assert r.accuracy.covers == {"unknowns"}
    assert r.t.shape == r["pull"].shape == (201,)
    assert np.array_equal(r["vy"], r.y[:, 3])
    assert r([0.5])["x"] == pytest.approx(pendulum_exact(np.array([0.5]), 2.0)[0, 0], abs=1e-4)


def test_a_multiplier_that_misses_the_accuracy_is_told_by_name():
    with pytest.warns(mb.AccuracyWarning, match="farthest off is pull"):
        r = hanging().simulate(1.0, 1e-9, solver=mb.RadauIIA(3))
    assert r.reliable is False
    assert len(r.warnings) == 1


@pytest.mark.parametrize("solver", [mb.IDA, mb.RadauIIA(2), "radau5"])
def test_solvers_by_object_class_and_name(solver):
    r = pendulum("ggl_rates").simulate(1.0, 1e-5, solver=solver)
    off = np.abs(r.y[:, :4] - pendulum_exact(r.t, 1.0))
    assert np.max(off / np.max(np.abs(r.y[:, :4]), axis=0)) < 1e-5
    assert r.reliable


@pytest.mark.parametrize(("make", "index"), [(lambda: pendulum("index3"), 3), (lambda: pendulum("ggl"), 2), (jay, 2),
                                             (lambda: circle("index1"), 1), (amplifier, 1), (decay, 1)])
def test_a_wrong_index_is_named_before_the_run(make, index):
    right = make()
    for declared in (1, 2, 3):
        stated = mb.DAE(right.residual, right.y0, right.yp0, index=declared)
        if declared == index:
            assert not stated.doubt(1.0)
            continue
        with pytest.raises(mb.OptionError, match=f"give index={index}"):
            stated.simulate(1.0)
    assert not right.doubt(1.0)


@pytest.mark.parametrize(("rate", "t_end", "hint"), [(1e4, 3.0, True), (30.0, 30.0, False)])
def test_a_method_for_what_is_not_stiff_says_so_on_stiff_equations(rate, t_end, hint):
    """y follows cos 3t at some rate: where that is far faster, stability holds the steps of Adams formulas short."""
    def slope(t, y, out):
        out[0] = -rate * (y[0] - np.cos(3 * t))

    system = mb.DAE(lambda t, y, yp, out: np.array([yp[0] + rate * (y[0] - np.cos(3 * t))]), [1.0], [0.0], rhs=slope)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        r = system.simulate(t_end, 1e-6, solver=mb.CVODE())
    assert r.stats.steps > 1000
    assert any("mb.CVODE(method='BDF')" in note for note in r.warnings) is hint


def test_an_index_above_three_is_named():
    """Two masses on a spring, the first led along sin 2t by a force on the second: the force follows from five derivatives."""
    def led(t, y, yp, out):
        x1, x2, v1, v2, force = y
        out[:] = yp[0] - v1, yp[1] - v2, yp[2] + x1 - x2, yp[3] + x2 - x1 - force, x1 - np.sin(2 * t)

    system = mb.DAE(led, [0, 0, 2, -6, 0], [2, -6, 0, 0, 16], index=3, names=["x1", "x2", "v1", "v2", "force"])
    with pytest.raises(mb.OptionError, match="force has index 5, declared 3; no method here solves"):
        system.simulate(3.0, 1e-3)


def test_a_direct_run_warns_of_a_wrong_index():
    with pytest.warns(mb.AccuracyWarning, match="pull has index 3, declared 1"), pytest.raises(mb.SolverError):
        mb.IDA(rtol=1e-5).solve(hanging(1), 1.0)


@pytest.mark.parametrize(("y0", "named"), [((1, 0, 0.3, 0, 0), "vx = 0.3"), ((1, 0, 0, 0, 5), "pull = 5")])
def test_a_start_that_violates_a_derivative_of_a_constraint_is_named(y0, named):
    with pytest.raises(mb.OptionError, match=f"not consistent: {named}"):
        hanging(y0=y0).simulate(1.0)


def test_the_solver_is_chosen():
    def fast(t, y, yp, out):
        out[:] = yp + 1e4 * (y - np.cos(t))

    stiff = mb.DAE(fast, [1.0], [0.0], rhs=lambda t, y, out: -1e4 * (y - np.cos(t)))
    slow = mb.DAE(lambda t, y, yp, out: yp + y, [1.0], [-1.0], rhs=lambda t, y, out: -y)
    assert slow.simulate(1.0).info.solver.label == "DOP853"
    assert stiff.simulate(50.0).info.solver.label == "RadauIIA(3)"


def test_what_was_computed_is_attached_to_an_error():
    with pytest.raises(mb.SolverError) as raised:
        mb.DAE(lambda t, y, yp, out: yp - y * y, [1.0], [1.0]).simulate(2.0, 1e-4)
    part = raised.value.solution
    assert isinstance(part, Unknowns)
    assert part.t[-1] <= 1.0
    assert part["y[0]"][90] == pytest.approx(1 / (1 - part.t[90]), rel=1e-3)
    assert part.reliable is False


def test_names_are_offered():
    r = decay().simulate(0.1)
    with pytest.raises(mb.OptionError, match="the names are"):
        r["z"]


@pytest.mark.parametrize(("rtol", "atol"), [(1e-8, 1e-8), (1e-8, 2e-8), (1e-7, 2.8e-7)])
def test_ida_follows_the_amplifier_with_few_rejections(rtol, atol):
    """Without `ida_converged` of sundials.c IDA rejects thousands of steps, or does not end; the last tolerances are some with
    which it stays at order 1, where 200 000 evaluations do not suffice without `raise_order`. 25 to 50 rejections were measured,
    and errors of up to twice rtol."""
    run = mb.IDA(rtol=rtol, atol=atol).solve(amplifier(), 0.05, max_residuals=8000)
    assert run.stats.rejected < 100
    assert np.max(np.abs(run.y[-1] - AT_50_MS)) < 10 * rtol


def test_columns_without_common_rows_are_changed_together():
    n, calls = 40, [0]

    def chain(t, y, yp, out):
        calls[0] += 1
        out[:] = yp + 2 * y
        out[1:] -= y[:-1]
        out[:-1] -= y[1:]

    pattern = np.eye(n) + np.eye(n, k=1) + np.eye(n, k=-1)
    d = mb.DAE(chain, np.ones(n), -np.r_[1, np.zeros(n - 2), 1], sparsity=pattern)
    calls[0] = 0
    fy, fyp = d.dense_parts(0.0, d.y0, d.yp0)
    assert calls[0] == 1 + 3 + 3
    assert np.allclose(fy, 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1), atol=1e-7)
    assert np.allclose(fyp, np.eye(n), atol=1e-9)


def test_rejections_are_told():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        run = mb.RadauIIA(3, rtol=1e-6).solve(jay(), 1.0)
    assert np.max(np.abs(run.y[-1] / jay_exact(run.t[-1:])[0] - 1)) < 1e-4
    assert rejecting(run) == ""
    run.stats.steps, run.stats.rejected = 300, 240
    assert "rejected 240 attempts of steps and accepted 300" in rejecting(run)
    run.stats.retaken = 200  # because of kinks
    assert rejecting(run) == ""


@pytest.mark.parametrize("solver", [mb.RadauIIA(3), mb.RadauIIA(5)])
def test_a_run_that_fails_at_a_loose_tolerance_is_made_at_a_tighter_one(solver):
    """Robertson's reaction with its small concentration measured at a scale of 1: at 1e-2 it falls below 0, and the reaction
    explodes."""

    def reaction(t, y, yp, out):
        forth, back, pair = 0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] ** 2
        out[:] = yp[0] + forth - back, yp[1] - forth + back + pair, np.sum(y) - 1

    with pytest.raises(mb.SolverError):
        solver.at_accuracy(1e-2, "DAE").solve(mb.DAE(reaction, [1, 0, 0], [-0.04, 0.04, 0]), 40.0)
    r = mb.DAE(reaction, [1, 0, 0], [-0.04, 0.04, 0], names=["a", "b", "c"]).simulate(40.0, accuracy=1e-2, solver=solver)
    assert r.reliable
    assert abs(r["a"][-1] - 0.7158270688) < 1e-2  # of the test set
