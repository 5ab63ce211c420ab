"""DOP853: its numbers against SciPy's, its orders, its dense output, what it refuses and what stops it."""

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.integrate._ivp import dop853_coefficients as scipys

import mbdae as mb
from mbdae.integrators import dop853 as own


def filled(entries, shape):
    found = np.zeros(shape)
    for *at, value in entries:
        found[tuple(at)] = value
    return found


def test_the_numbers_are_those_of_scipy():
    assert np.array_equal(filled(own.STAGES, (16, 16)), scipys.A)
    assert np.array_equal(filled(own.FIFTH, 13), scipys.E5)
    assert np.array_equal(filled(own.THIRD, 13), scipys.E3)
    assert np.array_equal(filled(own.DENSE, (4, 16)), scipys.D)


def orbit(rhs=None):
    """Two bodies, eccentricity 0.6: q'' = -q / |q|^3."""

    def f(t, y, out):
        r3 = np.hypot(y[0], y[1]) ** 3
        out[:] = y[2], y[3], -y[0] / r3, -y[1] / r3

    def residual(t, y, yp, out):
        f(t, y, out)
        out[:] = yp - out

    y0 = np.array([0.4, 0.0, 0.0, 2.0])
    yp0 = np.empty(4)
    f(0.0, y0, yp0)
    return mb.DAE(residual, y0, yp0, rhs=rhs or f, scale=1.0), f


@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])
def test_a_run_takes_the_steps_of_scipy(rtol):
    system, f = orbit()

    def rates(t, y):
        out = np.empty(4)
        f(t, y, out)
        return out

    mine = mb.DOP853(rtol=rtol).solve(system, 10.0, h0=1e-3)
    theirs = solve_ivp(rates, (0, 10), system.y0, method="DOP853", rtol=rtol, atol=rtol, first_step=1e-3, dense_output=True)
    early = slice(0, max(3, len(theirs.t) // 2))  # round-off changes later ones, the last are cut by the end in two ways
    assert mine.t[early] == pytest.approx(theirs.t[early], rel=1e-5)  # lengths hang on estimates near round-off
    assert mine.interpolant.value(theirs.t[early]) == pytest.approx(theirs.y.T[early], rel=1e-6, abs=1e-8)
    times = np.linspace(0, theirs.t[early][-1], 57)
    assert mine.interpolant.value(times) == pytest.approx(theirs.sol(times).T, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize(("omega", "y0", "shorter"), [(10, (0.0, 1.0), 1e-4**0.125), (100, (1.0, 1e-3), 1.0)])
def test_the_first_step_is_that_of_scipy(omega, y0, shorter):
    """An oscillator: where it begins in the middle its rates say little, their change says more. Where that gives the step, it is
    shorter than that of SciPy by the power 1/8 of the error that is allowed of a first step, 1e-4 of that of others."""
    def rates(t, y):
        return np.array([y[1], -(omega**2) * y[0]])

    def residual(t, y, yp, out):
        out[:] = yp - rates(t, y)

    def fill(t, y, out):
        out[:] = rates(t, y)

    system = mb.DAE(residual, y0, rates(0.0, np.array(y0)), rhs=fill, scale=1.0)
    mine = mb.DOP853(rtol=1e-6).solve(system, 0.1)
    theirs = solve_ivp(rates, (0, 0.1), y0, method="DOP853", rtol=1e-6, atol=1e-6)
    assert mine.t[1] == pytest.approx(shorter * theirs.t[1], rel=1e-6)


def test_the_error_falls_as_order_eight_asks():
    """With steps that are halved the error of an orbit falls by 2^8; a wrong coefficient would leave a lower order."""
    system, _ = orbit()
    exact = mb.DOP853(rtol=1e-14).solve(system, 1.0).y[-1]
    errors = []
    for steps in (8, 16):
        part, h = system, 1.0 / steps
        for k in range(steps):  # a loose tolerance, so that every step is the one asked for
            r = mb.DOP853(rtol=0.1, atol=1e3).solve(part, (k + 1) * h, h0=h)
            assert len(r.t) == 2
            part = part.starting((k + 1) * h, r.y[-1], r.yp[-1])
        errors.append(np.abs(r.y[-1] - exact).max())
    assert 7.5 < np.log2(errors[0] / errors[1]) < 9.5


def test_what_the_right_hand_side_raises_comes_through():
    def fails(t, y, out):
        if t > 0.5:
            raise ArithmeticError("no road here")
        out[:] = -y

    system = mb.DAE(lambda t, y, yp, out: np.add(yp, y, out=out), [1.0], [-1.0], rhs=fails)
    with pytest.raises(ArithmeticError, match="no road here"):
        mb.DOP853(rtol=1e-6).solve(system, 1.0)


def test_a_right_hand_side_that_ends_is_named():
    def ends(t, y, out):
        out[:] = y**2  # infinite at t = 1

    system = mb.DAE(lambda t, y, yp, out: np.subtract(yp, y**2, out=out), [1.0], [1.0], rhs=ends, names=["width"])
    with pytest.raises(mb.SolverError, match=r"round-off of the time.*width"):
        mb.DOP853(rtol=1e-6).solve(system, 2.0)


def test_a_scene_with_constraints_is_refused_in_ggl():
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), model=mb.Kinematic())
    with pytest.raises(mb.OptionError, match=r"\(GGL\) has multipliers of constraints"):
        s.simulate(1.0, solver=mb.DOP853(), form=mb.GGL())


@pytest.mark.parametrize("accuracy", [1e-4, 1e-8])
def test_a_spring_that_switches_is_met(accuracy):
    """A stop that acts beyond x = 0.5 alone: the step lands on it; the energy is that of the start."""
    s = mb.Scene("stop")
    cart = s.point_mass("cart", 1.0, at=(0, 0), velocity=(1, 0))
    s.prismatic("slide", s.ground, cart, at=(0, 0), axis=(1, 0), limits=(-0.5, 0.5), stop=mb.Stop(stiffness=1e3))
    r = s.simulate(6.0, accuracy=accuracy, solver=mb.DOP853(), verify=True)
    speed = np.abs(r["cart"].velocity[:, 0])
    free = np.abs(r["cart"].position[:, 0]) < 0.5
    assert speed[free] == pytest.approx(1.0, abs=30 * accuracy)


def test_a_run_ends_where_the_equations_do():
    """The force is a root whose argument becomes negative: steps of the size of round-off were accepted for ever."""
    s = mb.Scene("pulled")
    b = s.point_mass("b", 1.0, at=(0, 0), velocity=(1, 0))
    s.force("F", b, (sp.sqrt(1.005 - s.sensor("b.position[0]")) / 10, 0, 0))
    with pytest.raises(mb.SolverError, match=r"is not finite near t = 0\.9673") as stop:
        s.simulate(3.0, solver=mb.DOP853(rtol=1e-7), form="index1", max_wall=60)
    assert "max_wall" not in str(stop.value)
