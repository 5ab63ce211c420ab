"""CVODE: what its tolerance delivers at and between steps, its Jacobian, its counts, and what it refuses."""

import numpy as np
import pytest
from dae_problems import Explicit, decay, pendulum
from scenes import data, dzhanibekov

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.integrators.constant import rate_jacobian
from mbdae.system.base import System
from mbdae.system.prepare import prepare

METHODS = ("Adams", "BDF")
every_method = pytest.mark.parametrize("method", METHODS)


class Orbit(System):
    """Two bodies at eccentricity 0.3; the closed form follows Kepler's equation."""

    n, label, sparsity, t0 = 4, "DAE", None, 0.0
    names, equations, kinds = ("x", "y", "vx", "vy"), ("x'", "y'", "vx'", "vy'"), ("y",) * 4
    index, scale = np.ones(4, dtype=int), np.ones(4)
    e = 0.3

    def __init__(self):
        self.y0, self.yp0 = self.exact(np.zeros(1))[0], np.empty(4)
        self.rhs(0.0, self.y0, self.yp0)

    def exact(self, times):
        """(k, 4)."""
        E = times.copy()
        for _ in range(50):
            E = E - (E - self.e * np.sin(E) - times) / (1 - self.e * np.cos(E))
        b, rate = np.sqrt(1 - self.e**2), 1 / (1 - self.e * np.cos(E))
        return np.array([np.cos(E) - self.e, b * np.sin(E), -np.sin(E) * rate, b * np.cos(E) * rate]).T

    def rhs(self, t, y, out):
        out[:2], out[2:] = y[2:], -y[:2] / np.hypot(y[0], y[1]) ** 3

    def residual(self, t, y, yp, out):
        self.rhs(t, y, out)
        out[:] = yp - out

    def jacobian(self, t, y, yp, cj, out):
        r = np.hypot(y[0], y[1])
        out[...] = cj * np.eye(4)
        out[:2, 2:] -= np.eye(2)
        out[2:, :2] += np.eye(2) / r**3 - 3 * np.outer(y[:2], y[:2]) / r**5


class Stiff(System):
    """y1' = -1e5 (y1 - cos t) - sin t, y2' = y1 - y2: y1 = cos t, y2 = (cos t + sin t) / 2."""

    n, label, sparsity, t0 = 2, "DAE", None, 0.0
    names, equations, kinds = ("fast", "slow"), ("fast'", "slow'"), ("y", "y")
    index, scale, y0, yp0 = np.ones(2, dtype=int), np.ones(2), np.array([1.0, 0.5]), np.array([0.0, 0.5])

    def rhs(self, t, y, out):
        out[:] = -1e5 * (y[0] - np.cos(t)) - np.sin(t), y[0] - y[1]

    def residual(self, t, y, yp, out):
        self.rhs(t, y, out)
        out[:] = yp - out

    def jacobian(self, t, y, yp, cj, out):
        out[...] = [[1e5 + cj, 0.0], [-1.0, 1.0 + cj]]


def free_bodies(masses=1):
    """A body on a bushing, tied by springs to a string of point masses."""
    s = mb.Scene("free", gravity=(0, 0, -9.81))
    before = s.rigid_body("a", 2.0, (1.0, 2.0, 2.5), at=(0, 0, 0), angular_velocity=(0.3, 1.0, -0.2))
    s.bushing("B", s.ground, before, (0, 0, 0), (100.0, 90.0, 80.0, 5.0, 6.0, 7.0), (1.0, 1.0, 1.0, 0.1, 0.1, 0.1))
    for i in range(masses):
        mass = s.point_mass(f"b{i}", 0.5, at=(i + 1, 0, 1), velocity=(0, 0.2, 0))
        s.spring(f"S{i}", before, mass, (i, 0, float(i > 0)), (i + 1, 0, 1), stiffness=40.0, damping=0.5)
        before = mass
    return s


# -- accuracy


@every_method
def test_error_falls_with_the_tolerance(method):
    """At steps, and between them no worse: positions, velocities, and the slope of the interpolant."""
    system, errors = Orbit(), []
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10) if method == "BDF" else (1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
        solution = mb.CVODE(rtol, method=method).solve(system, 20.0)
        inside = (solution.t[:-1, None] + np.diff(solution.t)[:, None] * [0.1, 0.3, 0.5, 0.7, 0.9]).ravel()
        at_steps = np.abs(solution.y - system.exact(solution.t)).max()
        between = np.abs(solution(inside) - system.exact(inside)).max()
        slope = np.abs(solution.derivative(inside)[:, :2] - system.exact(inside)[:, 2:]).max()
        print(f"{method:5s} rtol {rtol:.0e}: error {at_steps / rtol:7.0f} rtol, between {between / at_steps:.3f}, "
              f"slope {slope / at_steps:.2f}, steps {solution.stats.steps}, evaluations {solution.stats.residuals}")
        assert between < 1.1 * at_steps
        assert slope < 20 * at_steps
        errors.append(at_steps)
    falls = np.array(errors[1:]) / errors[:-1]
    assert (falls < 0.01**mb.CVODE.error_fall).all()
    assert errors[-1] < errors[0] * (0.01 ** len(falls)) ** 0.7


def test_high_order_takes_fewer_evaluations_at_equal_error():
    system, cost = Orbit(), {}
    for solver in (mb.CVODE(1e-10), mb.CVODE(1e-10, max_order=4), mb.CVODE(1e-10, method="BDF")):
        solution = solver.solve(system, 20.0)
        error = np.abs(solution.y - system.exact(solution.t)).max()
        cost[solver.method, solver.max_order] = (error, solution.stats.residuals)
    for other in (("Adams", 4), ("BDF", None)):
        assert cost["Adams", None][0] < cost[other][0]
        assert cost["Adams", None][1] < cost[other][1]


@every_method
def test_derivatives_at_steps(method):
    system = Orbit()
    solution = mb.CVODE(1e-8, method=method).solve(system, 10.0)
    rates = np.empty_like(solution.y)
    for t, y, out in zip(solution.t, solution.y, rates, strict=True):
        system.rhs(t, y, out)
    error = np.abs(solution.y - system.exact(solution.t)).max()
    assert np.abs(solution.yp - rates).max() < error


@every_method
def test_free_body_flips_and_keeps_its_energy(method):
    """The middle axis of a free asymmetric body, against elliptic functions; its energy over four flips."""
    d = data("dzhanibekov")
    times = np.array(d["t"])
    r = dzhanibekov().simulate(float(times[-1]), accuracy=1e-6, solver=mb.CVODE(method=method), outputs=times)
    assert np.abs(r["body"].rotation.reshape(-1, 9) - np.reshape(d["R"], (-1, 9))).max() < 1e-6
    assert np.abs(r.u[:, 3:] - d["omega"]).max() < 2e-6
    energy = r.u[:, 3:] ** 2 @ [0.5, 1.0, 1.5]
    assert np.abs(energy / energy[0] - 1).max() < 2e-6
    assert np.abs(r.energy.balance).max() < 1e-5
    assert r.accuracy.met


def test_bdf_takes_longer_steps_where_it_is_stiff():
    bdf, adams = (mb.CVODE(1e-6, method=m).solve(Stiff(), 1.0) for m in ("BDF", "Adams"))
    for solution in (bdf, adams):
        assert solution.y[-1] == pytest.approx([np.cos(1), (np.cos(1) + np.sin(1)) / 2], abs=1e-4)
    assert 3 * bdf.stats.residuals < adams.stats.residuals


# -- beams and large trees


def test_beams_have_a_right_hand_side():
    """Their mass matrix is sparse and factorised once; motion as by Radau IIA."""
    s = mb.Scene("beam", gravity=(0, -9.81, 0))
    section = mb.Section.rectangular(0.02, 0.02, E=1e5, nu=0.3, rho=1000)
    s.revolute("A", s.ground, s.beam("b", (0, 0), (1, 0), section=section, elements=2), at=(0, 0))
    system = system_for(prepare(s), None, mb.CVODE.highest_index)
    rate = np.empty(system.n)
    system.rhs(system.t0, system.y0, rate)
    assert rate == pytest.approx(system.yp0, abs=1e-9 * np.max(np.abs(system.yp0)))
    r = s.simulate(0.1, accuracy=1e-5, solver=mb.CVODE(method="BDF"), outputs=5)
    fine = s.simulate(0.1, solver=mb.RadauIIA(3, rtol=1e-9), form=mb.ODE(waves=True), outputs=5)
    assert np.abs(r.q - fine.q).max() < 1e-5


def test_beams_have_factors_in_a_narrow_band(monkeypatch):
    from mbdae.native import program

    s = mb.Scene("beam", gravity=(0, -9.81, 0))
    section = mb.Section.rectangular(0.02, 0.02, E=1e5, nu=0.3, rho=1000)
    s.revolute("A", s.ground, s.beam("b", (0, 0), (1, 0), section=section, elements=4), at=(0, 0))
    full = system_for(prepare(s), None, mb.CVODE.highest_index)
    rates = np.empty((2, full.n))
    y = full.y0 + 0.1 * np.sin(1.0 + np.arange(full.n))
    full.rhs(0.1, y, rates[0])
    monkeypatch.setattr(program, "BANDED_FROM", 0)
    narrow = system_for(prepare(s), None, mb.CVODE.highest_index)
    narrow.rhs(0.1, y, rates[1])
    assert not np.array_equal(narrow.assembly.evaluation.order, full.assembly.evaluation.order)
    assert rates[1] == pytest.approx(rates[0], rel=1e-9)


# -- Jacobian and counts


@pytest.mark.parametrize("masses", [1, 25])
def test_jacobian_agrees_with_differences(masses):
    """Dense, and sparse equations whose df/dy is dense all the same."""
    system = system_for(prepare(free_bodies(masses)))
    assert (system.sparsity is None) == (masses == 1)
    rng = np.random.default_rng(1)
    y, rate, plus, minus = system.y0 + 0.05 * rng.normal(size=system.n), *np.empty((3, system.n))
    system.rhs(0.2, y, rate)
    found = rate_jacobian(system, 0.2, y, rate)
    for j in range(system.n):
        step = np.zeros(system.n)
        step[j] = 1e-5
        system.rhs(0.2, y + step, plus)
        system.rhs(0.2, y - step, minus)
        assert found[:, j] == pytest.approx((plus - minus) / 2e-5, abs=1e-6 * max(1.0, np.abs(found).max()))


@every_method
def test_work_is_counted(method):
    calls = {"rhs": 0, "jacobian_parts": 0}

    class Counted(Orbit):
        def rhs(self, *arguments):
            calls["rhs"] += 1
            super().rhs(*arguments)

        def jacobian_parts(self, *arguments):
            calls["jacobian_parts"] += 1
            return super().jacobian_parts(*arguments)

    system = Counted()
    calls["rhs"] = -1  # the residual that checks the start calls it
    stats = mb.CVODE(1e-6, method=method).solve(system, 10.0).stats
    assert stats.residuals == calls["rhs"]
    assert stats.jacobians == calls["jacobian_parts"] <= stats.steps / 10
    assert stats.steps < stats.residuals < 1.6 * stats.steps
    assert 0 < stats.rejected < stats.steps / 4


def test_first_step_is_chosen_without_rejections():
    class Announced(Explicit):
        def accept(self, t, y):
            """Steps are made one by one."""

    seen = []
    mb.CVODE(1e-6).solve(decay(Announced), 0.5, progress=lambda t, t_end, stats: seen.append((stats.steps, stats.rejected)))
    assert seen[0] == (1, 0)
    assert mb.CVODE(1e-6).solve(decay(), 0.5, h0=1e-7).t[1] == pytest.approx(1e-7)


# -- with scenes


def test_solvers_agree_on_a_scene(tmp_path):
    outputs = np.linspace(0, 2, 41)
    runs = {s.label: free_bodies().simulate(2.0, 1e-6, s, outputs=outputs)
            for s in (mb.CVODE(), mb.CVODE(method="BDF"), mb.RadauIIA(3))}
    for r in runs.values():
        assert r.accuracy.met
        assert r["b0"].position == pytest.approx(runs["RadauIIA(3)"]["b0"].position, abs=4e-6)
    r = runs["CVODE (Adams)"]
    r.save(tmp_path / "run.npz")
    again = mb.load(tmp_path / "run.npz")
    assert again.info.solver == r.info.solver
    assert np.array_equal(again.solution(outputs), r.solution(outputs))


def test_methods_are_told_apart_in_a_comparison():
    w = mb.compare(free_bodies(), 0.5, [mb.Run(mb.CVODE()), mb.Run(mb.CVODE(method="BDF", max_order=2))], accuracies=[1e-3])
    assert {row.label for row in w.runs} == {"CVODE (Adams) ODE", "CVODE (BDF)[max_order=2] ODE"}
    assert not w.failures


# -- refusals


def test_constraints_are_refused():
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    with pytest.raises(mb.OptionError, match=r"CVODE \(Adams\) needs .*, but this system \(GGL\) has multipliers"):
        s.simulate(1.0, solver=mb.CVODE(), form=mb.GGL())
    with pytest.raises(mb.OptionError, match=r"use mb\.RadauIIA\(3\); or, for a scene, form=mb\.Index1\(mult"):
        mb.CVODE(1e-6).solve(s.system(mb.Index3()), 1.0)


def test_implicit_equations_are_refused():
    with pytest.raises(mb.OptionError, match=r"\(DAE\) gives only F\(t, y, y'\) = 0, .* or give the DAE its rhs="):
        mb.CVODE().solve(mb.DAE(lambda t, y, yp, out: yp + y, [1.0], [-1.0]), 1.0)
    with pytest.raises(mb.OptionError, match="has multipliers of constraints"):
        mb.CVODE().solve(pendulum("ggl"), 1.0)


def test_equations_without_a_derivative_are_refused():
    system = Explicit(lambda t, y, yp, out: np.array([yp[0] + y[0], y[1] - y[0]]), [1.0, 1.0], [-1.0, -1.0])
    with pytest.raises(mb.OptionError, match=r"dF/dy' is singular at t = .*use mb\.IDA\(\) or mb\.RadauIIA\(3\)"):
        mb.CVODE(1e-6).solve(system, 1.0)


@every_method
@pytest.mark.parametrize("after", [0.0, 0.5])
def test_right_hand_side_that_turns_into_nan_is_named(method, after, capfd):
    """Only the right-hand side does, from the first step on or later."""

    class Broken(Explicit):
        def rhs(self, t, y, out):
            super().rhs(t, y, out)
            if t > after:
                out[1] = np.nan

    with pytest.raises(mb.SolverError, match=r"equation F\[1\] is not finite near t = ") as caught:
        mb.CVODE(1e-6, method=method).solve(decay(Broken), 1.0)
    assert caught.value.time == pytest.approx(after, abs=0.1)
    assert capfd.readouterr() == ("", "")


@every_method
def test_what_resists_is_named(method, capfd):
    """The second of three unknowns becomes infinite at t = 1."""
    system = Explicit(lambda t, y, yp, out: yp + np.array([y[0], -y[1] ** 2, y[2]]), [1.0, 1.0, 5.0], [-1.0, 1.0, -5.0],
                      names=["a", "b", "c"])
    remedy = r"where the motion is stiff, use .*mb\.RadauIIA\(3\) \(resisting most: unknown or equation b\)"
    with pytest.raises(mb.SolverError, match=remedy) as caught:
        mb.CVODE(1e-6, method=method).solve(system, 2.0)
    assert caught.value.culprit == "b"
    assert caught.value.time == pytest.approx(1.0, abs=1e-3)
    assert capfd.readouterr() == ("", "")
