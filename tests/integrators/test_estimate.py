"""The estimate of a run's error from companion runs, on errors that are known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
import sympy
from scipy.integrate import solve_ivp

import mbdae as mb
from mbdae.integrators.stepped import _order as shown_order
from mbdae.run.estimate import FALL, FARTHEST, SLOW, STEEP, companions, estimated, least_error, with_rtol
from mbdae.run.estimate import fall_shown as fall

SMOOTH, TOUCHING = SimpleNamespace(guards=None, label="GGL"), SimpleNamespace(guards=object(), label="GGL")


def run_that_is_off(error):
    """A solution that is 0 but for its error."""
    made = SimpleNamespace(t=np.linspace(0.0, 1.0, 11))
    return type("Run", (), {"t": made.t, "__call__": lambda self, t: np.full((len(t), 1), error)})()


def told(system, solver, errors):
    """The estimate from runs with errors by tolerance, as many of them as the system has companions."""
    runs = [(rtol, run_that_is_off(e)) for rtol, e in errors.items()][-1 - len(companions(system, with_rtol(solver, 1e-6))) :]
    return estimated(system, solver, runs, lambda t, a, b: np.abs(a - b)[:, 0], np.zeros(0))


@pytest.mark.parametrize("solver", [mb.RadauIIA(3), mb.IDA(), mb.CVODE()])
@pytest.mark.parametrize("ratio", [0.3, 0.1, 1 / 30])
def test_errors_that_fall_by_the_law_are_estimated_exactly(solver, ratio):
    """Runs that are off to the same side differ by less than the error of the looser one: that counts."""
    fine = 1e-5
    beyond = min(ratio * solver.companion, 1.0)  # the scatter of two runs does not grow any more
    coarse = fine * (ratio / beyond) ** -solver.error_fall * beyond**-FALL
    assert told(SMOOTH, solver, {1e-6 / ratio: coarse, 1e-6: fine}) == pytest.approx(fine, rel=1e-9)


def test_errors_that_happen_to_be_alike_are_not_trusted_with_impacts():
    """Errors measured on a slider-crank with play at three tolerances: the last two agree to a third of what both are off."""
    solver, errors = mb.RadauIIA(3), {5.3e-5: 7.4e-2, 5.3e-6: 3.4e-4, 1.7e-6: 4.8e-4}
    assert told(TOUCHING, solver, errors) > 4.8e-4
    assert told(SMOOTH, solver, errors) < 4.8e-4 / 3
    assert [len(companions(system, with_rtol(solver, 1e-6))) for system in (SMOOTH, TOUCHING)] == [1, 2]


@pytest.mark.parametrize("solver", [mb.RadauIIA(3), mb.DOP853()])
def test_companions_are_farther_where_errors_fall_regularly(solver):
    """At coarse accuracies runs scatter, and a far companion would be no cheaper."""
    far = [companions(SMOOTH, solver.at_accuracy(accuracy, "GGL")) for accuracy in (1e-2, 1e-4, 1e-5, 1e-8)]
    assert far == [pytest.approx([ratio]) for ratio in (solver.companion, solver.companion, FARTHEST, FARTHEST)]
    assert companions(TOUCHING, solver.at_accuracy(1e-8, "GGL")) == pytest.approx([solver.companion**1.5, solver.companion**0.5])


def test_errors_that_fall_more_slowly_than_assumed_are_at_least_the_differences():
    """Measured on two balls that hit each other, DOP853: the difference from the wide companion is five times that from the close
    one, where errors that fall as assumed give six."""
    errors = {9.5e-6: -2.3e-5, 9.5e-7: 2.52e-4, 3e-7: 3.17e-4}
    assert told(TOUCHING, mb.DOP853(), errors) == pytest.approx(3.4e-4)
    falling = {9.5e-6: -2.3e-5, 9.5e-7: 2.62e-4, 3e-7: 3.17e-4}
    assert told(TOUCHING, mb.DOP853(), falling) < 1e-4


def bouncing(damping):
    """A ball thrown at a floor, which it hits once."""
    s = mb.Scene(gravity=(0, -9.81, 0))
    s.rigid_body("ball", mass=1, inertia=(0.004, 0.004, 0.004), at=(0, 0.3, 0.1), velocity=(-2, 0, 0.5))
    s.contact("floor", k="ground", l="ball", shape_k=mb.Plane(at=(0, 0, 0.1), normal=(0, 1, 0)),
              shape_l=mb.Sphere(at=(0, 0.3, 0.1), radius=0.1), normal=mb.Hertz(stiffness=3e6, damping=damping))
    return s


@pytest.mark.parametrize(("damping", "accuracy"), [(0.0, 1e-3), (0.0, 1e-5), (0.3, 1e-3), (0.3, 1e-5), (0.6, 1e-3), (0.6, 1e-4)])
def test_steps_that_impacts_bound_differ_between_a_run_and_its_companions(damping, accuracy):
    """Where the duration of an impact bounds the steps of all runs in the same way, they are off by the same amount: by up to
    14000 times their difference."""
    run = bouncing(damping).simulate(0.3, accuracy=accuracy, solver="dop853", form="index1")
    exact = bouncing(damping).simulate(0.3, solver=mb.DOP853(rtol=1e-12), form="index1")
    error = float(np.max(np.abs(run["ball"].velocity - exact["ball"].velocity))) / 2.1  # m/s, over the speed of the throw
    assert error < 2 * run.accuracy.estimated


class Shaken(NamedTuple):
    """A kilogram with play between stops, in a carriage that is shaken for 3 s: amplitude (m) and angular frequency (1/s) of the
    carriage, stiffness (N/m), damping (N s/m) and limits (m) of the stops."""

    amplitude: float
    w: float
    stiffness: float
    damping: float
    low: float
    high: float

    def scene(self):
        s = mb.Scene("shaken")
        base, c = s.rigid_body("base", 1.0, 1.0, at=(0, 0)), s.rigid_body("c", 1.0, 1.0, at=(0, 0))
        s.prismatic("d", s.ground, base, at=(0, 0), axis=(1, 0, 0), position=self.amplitude * sympy.sin(self.w * mb.t))
        s.prismatic("j", base, c, at=(0, 0), axis=(1, 0, 0), rate0=0.05, limits=(self.low, self.high),
                    stop=mb.Stop(self.stiffness, self.damping))
        return s.recursive()

    def exactly(self, times):
        """Displacements by SciPy, in steps of a twentieth of the time scale of an impact."""
        def equations(t, y):
            below, above = self.low - y[0], y[0] - self.high
            force = max(0.0, self.stiffness * below - self.damping * y[1]) if below > 0 else 0.0
            force -= max(0.0, self.stiffness * above + self.damping * y[1]) if above > 0 else 0.0
            return [y[1], force + self.amplitude * self.w**2 * np.sin(self.w * t)]

        return solve_ivp(equations, (0, times[-1]), [0, 0.05], method="DOP853", rtol=1e-12, atol=1e-14, t_eval=times,
                         max_step=0.05 / self.stiffness**0.5).y[0]


@pytest.mark.parametrize(("case", "accuracy"), [
    (Shaken(0.0949, 13.564, 12841.0, 0.677, -0.0847, 0.0239), 1e-3),
    (Shaken(0.15, 9.0, 3.5e4, 0.0, -0.032, 0.011), 1e-5)])
def test_stops_that_are_hit_often_need_no_word_about_runs_that_are_right(case, accuracy):
    """Twenty to thirty impacts multiply what the tolerance leaves. The search goes on until the runs agree, and calls nothing
    chaotic."""
    times = np.linspace(0, 3.0, 301)
    run = case.scene().simulate(3.0, accuracy=accuracy, outputs=times)
    error = np.max(np.abs(run["j"].displacement - case.exactly(times))) / run.prepared.length
    assert error < accuracy
    assert not run.warnings
    assert run.reliable


@pytest.mark.parametrize("accuracy", [1e-3, 1e-4, 1e-5])
def test_a_body_that_hardly_touches_needs_no_word(accuracy):
    """An oscillator of amplitude a meets a stop at (1 - 1e-6) a, of a penetration far below the tolerance: without damping the
    stop takes nothing from it."""
    s, amplitude, w = mb.Scene("grazing"), 0.3, 6.0
    mass = s.rigid_body("c", 1.0, 1.0, at=(0, 0))
    s.prismatic("j", s.ground, mass, at=(0, 0), axis=(1, 0, 0), spring=w**2, rate0=amplitude * w,
                limits=(None, amplitude * (1 - 1e-6)), stop=mb.Stop(1e4))
    run = s.simulate(3.0, accuracy=accuracy)
    q, v = run["j"].displacement, run["j"].rate
    assert np.max(np.abs(np.hypot(q, v / w) - amplitude)) < accuracy * run.prepared.length
    assert not run.warnings


@pytest.mark.parametrize(("gaps", "expected"), [
    ((16e-6, 1e-6), 4.0), ((1e-6, 16e-6), 2.0), ((2e-6, 1e-6), 2.0), ((1e-6, 0.0), 2.0), ((np.inf, 1e-6), 2.0),
    ((1.0, 1e-6), 5.0), ((8.0, 2.0), 2.0), ((80.0, 2.5), 5.0), ((8.0, 1.0), 3.0)])
def test_the_order_that_runs_with_halved_steps_show(gaps, expected):
    """Their distances fall by 2 to the order: of no less than 2, which is believed, and no more than 5, which is stated."""
    assert shown_order(2.0, 5.0, (gaps[0], 0.2), (gaps[1], 0.1)) == pytest.approx(expected)


@pytest.mark.parametrize(("told", "power"), [
    ([], FALL), ([(1e-4, 1e-2)], FALL), ([(1e-4, 1e-2), (1e-6, 1e-2 * 100 ** -(0.9 * FALL))], 0.9 * FALL),
    ([(1e-4, 1e-2), (1e-6, 1e-9)], FALL), ([(1e-4, 1e-2), (1e-6, 0.99e-2)], SLOW), ([(1e-4, 1e-2), (1e-6, 2e-2)], SLOW),
    ([(1e-4, 1e-2), (1e-6, 0.0)], SLOW)])
def test_the_power_with_which_errors_fall_is_that_of_the_last_two_runs(told, power):
    """No more than is usual and no less than SLOW, which is taken too where they say nothing."""
    assert fall([(1e-2, 1.0), *told] if len(told) > 1 else told) == pytest.approx(power)


@pytest.mark.parametrize(("length", "height", "t_end"), [((1.9533380550547188, 0.28909457026523727), 0.0, 60.0)])
def test_runs_whose_errors_happen_to_be_equal_are_told_apart(length, height, t_end):
    """At 1e-4 DOP853 is 1.1e-3 off with rtol 3e-6, and 1.2e-3 with 3e-7: their difference is an eighth of either."""
    s = mb.Scene("long pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, height), length, mass=1.0), at=(0, height))
    exact, run = s.simulate(t_end, accuracy=1e-10), s.simulate(t_end, accuracy=1e-4)
    assert np.max(np.abs(run["hinge"].angle - exact(run.t)["hinge"].angle)) < 1e-4


def test_a_run_at_the_smallest_tolerance_is_not_trusted_because_round_off_makes_it_equal_to_its_companion():
    """A double pendulum: two runs differ by 2e-7, the last of them with the smallest tolerance, and both are 9e-5 off."""
    s, mass, length = mb.Scene("pendulum", gravity=(0, -9.81, 0)), (2.933482375981572, 1.9005963295860828), 0.9135930633772338
    rods = [s.rigid_body(name, m, (0.01, 0.15, 0.15), at=(x, 0, 0))
            for name, m, x in zip("ab", mass, (length / 2, length + 0.1985016143373363), strict=True)]
    s.revolute("A", s.ground, rods[0], at=(0, 0, 0), axis=(0, 0, 1), model=mb.Kinematic())
    s.revolute("B", *rods, at=(length, 0, 0), axis=(0, 0, 1), model=mb.Kinematic())
    r = s.simulate(18.177030453204537, accuracy=1e-5, form=mb.GGL(), solver=mb.RadauIIA(3))
    assert r.accuracy.estimated > 1e-5
    assert any("accuracy 1e-05 was asked" in warning for warning in r.warnings)


def test_errors_at_the_smallest_tolerance_fall_no_more_steeply_than_they_may():
    """With contacts one unlucky step may have made the estimate before."""
    assert least_error(SMOOTH, [(1e-10, 1e-3)], 1e-11) == pytest.approx(1e-3 * 10**-STEEP)
    for system, before in ((SMOOTH, []), (SMOOTH, [(1e-10, np.inf)]), (TOUCHING, [(1e-10, 1e-3)])):
        assert least_error(system, before, 1e-11) == 0
