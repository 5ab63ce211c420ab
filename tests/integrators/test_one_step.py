"""One-step methods of a user's own: what a class of a few lines gets, and what it is refused."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import sympy as sp
from dae_problems import blow_up, circle, circle_exact, circle_ode, decay
from own_methods import RK4, Dormand5, Dormand8, Euler, Gauss, Kutta3, Midpoint

import mbdae as mb
from mbdae.errors import OptionError, SolverError
from mbdae.integrators import collocation_table
from mbdae.integrators.dense import hermite

ACCURACIES = {Euler: (3e-2,), Midpoint: (1e-3, 1e-5), Kutta3: (1e-4, 1e-6), RK4: (1e-4, 1e-8), Dormand5: (1e-6, 1e-9),
              Dormand8: (1e-6, 1e-9), Gauss: (1e-4, 1e-8)}


def double_pendulum() -> Any:
    s = mb.Scene("p", gravity=(0, -9.81, 0))
    a, b = s.link("a", (0, 0), (1, 0), mass=1.0), s.link("b", (1, 0), (2, 0), mass=1.0)
    s.revolute("A", s.ground, a, at=(0, 0))
    s.revolute("B", a, b, at=(1, 0))
    return s


@pytest.fixture(scope="module")
def exact() -> Any:
    return double_pendulum().simulate(0.8, accuracy=1e-10, solver=mb.RadauIIA(5), outputs=101)


@pytest.mark.parametrize("method", ACCURACIES)
def test_a_method_delivers_the_accuracy_and_its_estimate_holds(method, exact):
    for asked in ACCURACIES[method]:
        r = double_pendulum().simulate(0.8, accuracy=asked, solver=method(), outputs=101)
        error = max(np.abs(r[name].angle - exact[name].angle).max() for name in ("A", "B"))
        assert r.info.form == "Index1"
        assert r.accuracy.met
        assert error < 2 * r.accuracy.estimated < 2 * asked  # the angle of B is the difference of two bodies' angles


def test_an_implicit_midpoint_does_what_every_solver_does(exact, tmp_path):
    s, errors = double_pendulum(), []
    for h in (1e-2, 5e-3, 2.5e-3):
        errors.append(abs(s.simulate(0.8, solver=Midpoint(step=h))["B"].angle[-1] - exact["B"].angle[-1]))
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2, abs=0.05)
    r = s.recursive().simulate(0.8, solver=Midpoint(), accuracy=1e-4, outputs=101)
    assert r.info.form == "ODE"
    assert np.abs(r["B"].angle - exact["B"].angle).max() < 2e-4
    r.save(tmp_path / "a.npz")
    again = mb.load(tmp_path / "a.npz", laws=[Midpoint])
    assert again.info.solver == r.info.solver
    assert np.array_equal(again.solution(0.123), r.solution(0.123))
    with pytest.raises(OptionError, match="pass laws="):
        mb.load(tmp_path / "a.npz")
    runs = [mb.Run(Midpoint(), mb.Index1()), mb.Run(mb.RadauIIA(3))]
    table = mb.compare(s, 0.2, runs=runs, accuracies=[1e-3], measure="B.angle")
    assert "Midpoint Index1" in table.table()


@pytest.mark.parametrize("form", [mb.GGL(), mb.Index3()])
def test_forms_with_multipliers_are_refused_with_what_to_use(form):
    with pytest.raises(OptionError, match=r"Midpoint needs y' = f\(t, y\).*form=mb.Index1\(multipliers='elim.*s.recursive\(\)"):
        double_pendulum().simulate(0.1, solver=Midpoint(), form=form)


@pytest.mark.parametrize("method", [Kutta3, RK4, Dormand5, Dormand8])
def test_between_steps_the_error_is_as_small_as_at_them(method):
    errors = []
    for count in (16, 32):
        solution = method(step=1 / count).solve(circle_ode(), 1.0)
        t = np.linspace(0.3, 1, 1001)
        errors.append([np.abs(solution(at) - circle_exact(at)[:, :2]).max() for at in (t, solution.t[count // 3 :])])
    (coarse, _), (fine, at_steps) = errors
    assert np.log2(coarse / fine) > min(method.order, 8) - 0.7 or fine < 30 * at_steps


def test_unequal_steps_do_not_magnify_round_off():
    t = np.concatenate([np.linspace(0, 1, 11), 1 + np.array([1e-6, 2e-6]), 1 + np.linspace(0.1, 1, 10)])
    dense = hermite(8, t, np.exp(-t)[:, None], -np.exp(-t)[:, None])
    inside = np.linspace(0, 2, 2001)
    assert np.abs(dense.value(inside)[:, 0] - np.exp(-inside)).max() < 1e-6
    assert np.abs(dense.value(inside[:900])[:, 0] - np.exp(-inside[:900])).max() < 1e-11


def test_breaks_of_inputs_end_steps_and_steps_are_equal():
    s = mb.Scene("kicked")
    push = sp.Piecewise((1.0, mb.t < 0.33), (-2.0, True))
    s.force("push", s.rigid_body("a", 1.0, (1, 1, 1)), (push, 0, 0))
    r = s.simulate(1.0, solver=RK4(step=0.05))
    assert 0.33 in r.solution.t
    assert r["a"].position[-1, 0] == pytest.approx(0.5 * 0.33**2 + 0.33 * 0.67 - 0.67**2, abs=1e-12)
    assert np.ptp(np.diff(RK4(step=0.3).solve(decay(), 1.0).t)) < 1e-12


def test_what_a_step_cannot_be_is_told():
    class Wrong(Euler):
        def advance(self, f, t, y, h):
            return y[:1]

    class Changes(Euler):
        def advance(self, f, t, y, h):
            y += h * f(t, y)
            return y

    class Fails(Euler):
        def advance(self, f, t, y, h):
            if t > 0.5:
                raise self.Failed("no luck")
            return y + h * f(t, y)

    class Orderless(mb.OneStep):
        def advance(self, f, t, y, h):
            return y

    with pytest.raises(OptionError, match=r"Wrong.advance returned an array of shape \(1,\)"):
        Wrong(step=0.1).solve(decay(), 1.0)
    with pytest.raises(ValueError, match="read-only"):
        Changes(step=0.1).solve(decay(), 1.0)
    told = r"Fails stopped at t = 0\.6 s of 1 s: a step of 0\.1 s fails, try another step: no luck"
    with pytest.raises(SolverError, match=told) as caught:
        Fails(step=0.1).solve(decay(), 1.0)
    assert caught.value.solution.t[-1] == pytest.approx(0.6)
    with pytest.raises(OptionError, match="order = 0 is not between 1 and 20: state the order of Orderless in its class"):
        Orderless()
    with pytest.raises(SolverError, match=r"the motion grows beyond all bounds"):
        RK4(step=0.01).solve(blow_up(), 2.0)


def test_options_of_ones_own_are_fields():
    @dataclass(frozen=True)
    class Theta(mb.OneStep):
        theta: float = 0.5
        order = 1

        def advance(self, f, t, y, h):
            k = f(t, y)
            return y + h * ((1 - self.theta) * k + self.theta * f(t + h, y + h * k))

    assert replace(Theta(theta=0.25), step=0.1) == Theta(step=0.1, theta=0.25)
    assert Theta(step=0.01).solve(decay(), 1.0).y[-1, 0] == pytest.approx(np.exp(-1), abs=1e-4)


def test_a_stated_order_that_a_method_does_not_have_is_not_believed():
    """Halving takes order 2 until three runs have shown more."""

    class Boaster(Kutta3):
        order = 8

    r = double_pendulum().simulate(0.5, accuracy=1e-5, solver=Boaster())
    fine = double_pendulum().simulate(0.5, accuracy=1e-9, solver=mb.RadauIIA(5))
    assert abs(r["B"].angle[-1] - fine["B"].angle[-1]) < 2 * max(r.accuracy.estimated, 1e-5)


def test_one_f_per_stage():
    """The slope at the start of a step is that at the end of the one before."""
    assert RK4(step=0.1).solve(decay(), 1.0).stats.residuals == 40
    assert Euler(step=0.1).solve(decay(), 1.0).stats.residuals == 10


@pytest.mark.parametrize("stages", [1, 2, 3])
def test_a_table_of_ones_own_that_is_not_stiffly_accurate(stages):
    measured = mb.measure_order(Gauss(stages), circle_ode(), 1.0, exact=lambda t: circle_exact(t)[:, :2])
    assert measured.orders["unknowns"] == pytest.approx(2 * stages, abs=0.2)
    with pytest.raises(OptionError, match=rf"Gauss\({stages}\) needs y' = f\(t, y\)"):
        Gauss(stages, step=0.1).solve(circle("ggl"), 1.0)


def test_gauss_keeps_quadratic_invariants():
    """x^2 + y^2 of a harmonic oscillator; Radau damps it."""
    system = mb.DAE(lambda t, y, yp, out: [yp[0] - y[1], yp[1] + y[0]], [1.0, 0.0], [0.0, -1.0],
                    rhs=lambda t, y, out: [y[1], -y[0]])
    run = Gauss(2, step=0.5).solve(system, 100.0)
    assert np.abs(np.hypot(*run.y.T) - 1).max() < 1e-12


@pytest.mark.parametrize(("nodes", "order", "message"), [
    ([0.4], 2, "the quadrature condition is off by 1.0e-01"), ([0.0, 1.0], 2, "give increasing numbers above 0 up to 1"),
    ([0.5, 1.2], 2, "increasing numbers above 0"), ([0.5], 3, "order = 3 is not between 1 and 2"),
])
def test_a_table_that_is_none_is_refused(nodes, order, message):
    with pytest.raises(OptionError, match=message):
        collocation_table(nodes, order)


class EulerSaysFour(mb.OneStep):
    """Explicit Euler with the order of another method."""

    order = 4

    def advance(self, f, t, y, h):
        return y + h * f(t, y)


class EulerSaysTwo(EulerSaysFour):
    order = 2


class WrongWeight(mb.OneStep):
    """The classical method with a last weight that is 3 % off: it converges, to the solution of other equations."""

    order = 4

    def advance(self, f, t, y, h):
        a = f(t, y)
        b = f(t + h / 2, y + h / 2 * a)
        c = f(t + h / 2, y + h / 2 * b)
        return y + h / 6 * (a + 2 * b + 2 * c + 1.03 * f(t + h, y + h * c))


class HalfASlope(mb.OneStep):
    order = 1

    def advance(self, f, t, y, h):
        return y + h / 2 * f(t, y)


@pytest.mark.parametrize("method", [EulerSaysFour, EulerSaysTwo, WrongWeight, HalfASlope])
@pytest.mark.parametrize("asked", [5e-2, 1e-2])
def test_a_method_that_is_not_what_it_says_is_never_met_silently(method, asked, exact):
    r = double_pendulum().simulate(0.8, accuracy=asked, solver=method(), outputs=101)
    error = max(np.abs(r[name].angle - exact[name].angle).max() for name in ("A", "B"))
    assert error < 2.2 * r.accuracy.estimated
    if not r.accuracy.met and r.accuracy.estimated > 0.1:
        assert any(f"{method.__name__} differs by" in w and "mb.measure_order" in w for w in r.warnings)
    if method is HalfASlope:
        assert not r.accuracy.met


def test_equations_of_ones_own_get_the_second_method_too():
    with pytest.warns(mb.AccuracyWarning, match="WrongWeight differs by"):
        WrongWeight(accuracy=1e-4).solve(circle_ode(), 1.0)


def test_a_coarse_run_that_diverges_is_no_end():
    """Masses of 1 and 0.01 kg on a stiff spring, one of which is pushed late: coarse steps of an explicit method diverge."""
    s = mb.Scene("late")
    a, b = s.point_mass("a", 1.0, at=(0, 0)), s.point_mass("b", 0.01, at=(1.2, 0))
    for body in (a, b):
        s.prismatic(f"slide {body.name}", s.ground, body, at=body.drawn.position, axis=(1, 0, 0))
    s.spring("spring", a, b, at_k=a.drawn.position, at_l=b.drawn.position, stiffness=1e5, length=1.2)
    s.force("push", a, (sp.Piecewise((0, mb.t < 0.7), (10, True)), 0, 0))
    r = s.simulate(1.0, accuracy=1e-2, solver=RK4())
    assert r["a"].position[-1, 0] == pytest.approx(10 / 1.01 * 0.3**2 / 2, rel=3e-2)
    assert r.accuracy.estimated < 1e-2


def test_a_law_that_refuses_what_a_diverging_run_asks_is_no_end():
    s = mb.Scene("race", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    race = mb.Clearance(outer=0.0205, inner=0.02, normal=mb.Hertz(1e6, damping=0.3))
    s.revolute("A", s.ground, rod, at=(0, 0), model=race)
    r = s.simulate(0.05, accuracy=1e-3, solver=RK4())
    assert r.complete


@pytest.mark.parametrize(("call", "message"), [
    (lambda f, t, y, h: y + h * f(t, y[:1]), r"called f\(t, y\) with t of shape \(\) and an array of shape \(1,\)"),
    (lambda f, t, y, h: y + h * f(y, t), r"with t of shape \(2,\)"), (lambda f, t, y, h: None, "returned None"),
    (lambda f, t, y, h: y * 1j, "returned complex numbers"), (lambda f, t, y, h: y + h * f(t, y * 1j), "and complex numbers"),
])
def test_what_advance_does_wrong_is_named(call, message):
    class Wrong(mb.OneStep):
        order = 1

        def advance(self, f, t, y, h):
            return call(f, t, y, h)

    with pytest.raises(OptionError, match=message):
        Wrong(step=0.1).solve(circle_ode(), 1.0)


def test_a_step_without_a_value_and_one_given_up_say_so():
    class NoValue(mb.OneStep):
        order = 1

        def advance(self, f, t, y, h):
            return y * np.nan

    class GivesUp(NoValue):
        def advance(self, f, t, y, h):
            raise self.Failed

    with pytest.raises(SolverError, match=r"NoValue\.advance returned a value that is not finite"):
        NoValue(step=0.1).solve(circle_ode(), 1.0)
    with pytest.raises(SolverError, match="a step cannot be solved"):
        GivesUp(step=0.1).solve(circle_ode(), 1.0)


def test_options_that_a_constructor_sets_stay():
    class Repeated(mb.OneStep):
        order = 1

        def __init__(self, times, **options):
            super().__init__(**options)
            object.__setattr__(self, "times", times)

        def advance(self, f, t, y, h):
            for i in range(self.times):
                y = y + h / self.times * f(t + i * h / self.times, y)
            return y

    assert Repeated(7).at_accuracy(1e-2, "ODE").with_step(0.1).times == 7


def test_a_comparison_takes_the_form_a_method_needs_and_a_run_that_raises_is_a_row():
    class Broken(mb.OneStep):
        order = 1

        def advance(self, f, t, y, h):
            raise ZeroDivisionError("on purpose")

    w = mb.compare(double_pendulum(), 0.2, runs=[RK4(), Broken(), "radau3"], accuracies=[1e-4])
    done = {row.solver: row for row in w.runs}
    assert done["RK4"].form == "Index1"
    assert done["RK4"].error < 1e-4
    assert "ZeroDivisionError: on purpose" in done["Broken"].failure
    assert done["RadauIIA(3)"].error < 1e-4


class Simpson(mb.OneStep):
    """Order 4 where y' depends on the time alone: f at other times with the y of the start of the step."""

    order = 4

    def advance(self, f, t, y, h):
        return y + h / 6 * (f(t, y) + 4 * f(t + h / 2, y) + f(t + h, y))


def test_the_slope_belongs_to_its_time():
    system = mb.DAE(lambda t, y, yp, out: yp - np.cos(3 * t), [0.0], [1.0], rhs=lambda t, y, out: np.cos(3 * t) + 0 * y)
    measured = mb.measure_order(Simpson(), system, 1.0, exact=lambda t: np.sin(3 * t)[:, None] / 3)
    assert measured.orders["unknowns"] == pytest.approx(4, abs=0.1)


def test_a_right_method_is_not_blamed_for_the_errors_of_the_second(recwarn):
    """A chaotic double pendulum: a run of Radau IIA to a tenth of a loose accuracy is far off at the end."""
    r = double_pendulum().recursive().simulate(5.0, accuracy=0.1, solver=RK4())
    near = double_pendulum().simulate(5.0, accuracy=1e-9, solver=mb.RadauIIA(5))
    assert r.accuracy.met
    assert abs(r["B"].angle[-1] - near["B"].angle[-1]) < 0.1
    assert not [w for w in recwarn if "differs by" in str(w.message)]
