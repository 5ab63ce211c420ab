"""Generalised-alpha and HHT: extreme steps, bodies that turn, internal states, beams, and what must be told."""

import warnings

import numpy as np
import pytest
from dae_problems import circle, circle_exact, decay, pendulum, pendulum_exact
from recursive_scenes import spring_chain
from scenes import a01, heavy_top, n_rods, physical_pendulum, stick_slip

import mbdae as mb
from mbdae.errors import AccuracyWarning, OptionError, SolverError
from mbdae.formulations import system_for
from mbdae.integrators.stepped import MOST_STEPS
from mbdae.system.prepare import prepare


def system(scene, form=None):
    return system_for(prepare(scene), form, mb.HHT.highest_index)


@pytest.mark.parametrize("form", ["ggl", "index3"])
def test_newton_at_a_step_of_a_nanosecond(form):
    """In motion, where the constraint has something to say."""
    h, moving = 1e-9, circle(form)
    solution = mb.GeneralizedAlpha(step=h).solve(pendulum(form), 20 * h)
    assert solution.stats.steps == 20
    assert solution.stats.newton_iterations <= 2 * solution.stats.steps
    assert solution.y[-1, :2] == pytest.approx([1, -9.81 * (20 * h) ** 2 / 2], rel=1e-6)
    moving.t0 = 0.0
    assert mb.HHT(step=h).solve(moving, 20 * h).stats.newton_failures == 0


def test_multipliers_at_a_nanosecond_far_from_rest():
    """The heavy top in full motion: round-off in the stabilised form is eps / h, in index 3 eps / h^2."""
    prepared = prepare(heavy_top())
    exact, h = prepared.start.multipliers, 1e-9
    solution = mb.GeneralizedAlpha(step=h).solve(system(heavy_top(), mb.GGL()), 20 * h)
    first = solution.names.index("lambda(O.x)")
    assert np.abs(solution.y[-1, first : first + 3] - exact).max() < 1e-4 * np.abs(exact).max()


@pytest.mark.parametrize("form", ["ggl", "index3"])
@pytest.mark.parametrize("solver", [mb.GeneralizedAlpha(0.6, step=2e-3), mb.HHT(0.1, step=2e-3)], ids=repr)
def test_pendulum_by_its_parts(solver, form):
    solution = solver.solve(pendulum(form), 1.0)
    assert np.abs(solution.y[:, :4] - pendulum_exact(solution.t, 1.0)).max() < 4e-4
    between = solution.t[:-1] + 0.3 * np.diff(solution.t)
    assert np.abs(solution(between)[:, :4] - pendulum_exact(between, 1.0)).max() < 4e-4
    slopes = solution.derivative(between)[:, :2] - pendulum_exact(between, 1.0)[:, 2:]
    assert np.abs(slopes).max() < 1e-3


def test_start_rates_of_a_driven_point():
    """Multipliers have order 2 from the first step on: the algorithmic accelerations begin where they belong."""
    errors = [np.abs(mb.GeneralizedAlpha(step=h).solve(circle("ggl"), 0.5)(h)[4] - circle_exact(np.array([h]))[0, 4])
              for h in (4e-3, 2e-3, 1e-3)]
    assert np.log2(np.array(errors[:-1]) / errors[1:]).min() > 1.7


@pytest.mark.parametrize("form", [mb.GGL(), mb.Index3(), mb.Index1()])
def test_quaternions_keep_their_length(form):
    solution = mb.GeneralizedAlpha(step=2e-4).solve(system(heavy_top(), form), 0.1)
    assert np.abs(np.linalg.norm(solution.y[:, 3:7], axis=1) - 1).max() < 1e-12


def test_recursive_chain_as_an_ode():
    s = spring_chain()
    fine = s.simulate(1.0, solver=mb.RadauIIA(3, rtol=1e-10), outputs=11)
    errors = [np.abs(s.simulate(1.0, solver=mb.HHT(step=h), outputs=11).q - fine.q).max() for h in (4e-3, 2e-3)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.2)


def test_internal_states_have_order_two():
    """Bristles of a block on a spring."""
    s = stick_slip()
    fine = mb.RadauIIA(3, rtol=1e-11).solve(system(s), 0.4)
    times, errors = np.linspace(0.05, 0.4, 50), []
    first = fine.solver and system(s).kinds.index("s")
    for h in (1e-3, 5e-4, 2.5e-4):
        solution = mb.GeneralizedAlpha(step=h).solve(system(s), 0.4)
        errors.append(np.abs(solution(times)[:, first] - fine(times)[:, first]).max())
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(2, abs=0.25)


def test_beam_and_chain_by_sparse_factors():
    s = mb.Scene("beam", gravity=(0, -9.81, 0))
    section = mb.Section.rectangular(0.02, 0.02, E=1e5, nu=0.3, rho=1000)
    beam = s.beam("b", (0, 0), (1, 0), section=section, elements=10)
    s.revolute("A", s.ground, beam, at=(0, 0))
    assert system(s).sparsity is not None
    fine = mb.RadauIIA(3, rtol=1e-9).solve(system(s, mb.ODE(waves=True)), 0.05)
    moving, errors = system(s).kinds.count("q"), []
    for h in (2e-4, 1e-4):
        solution = mb.GeneralizedAlpha(step=h).solve(system(s), 0.05)
        errors.append(np.abs(solution.y - fine(solution.t))[:, :moving].max())
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
    chain = mb.GeneralizedAlpha(step=2e-3).solve(system(n_rods(20)), 0.2)
    assert np.abs(chain.y - mb.RadauIIA(3, rtol=1e-9).solve(system(n_rods(20)), 0.2)(chain.t))[:, :60].max() < 1e-4


# -- accuracy by shorter steps


@pytest.mark.parametrize("solver", [mb.GeneralizedAlpha(), pytest.param(mb.HHT(), marks=pytest.mark.slow)], ids=repr)
def test_accuracy_steers_the_step(solver):
    s = physical_pendulum(60)
    fine = s.simulate(1.0, solver=mb.RadauIIA(3, rtol=1e-10), outputs=21)
    for asked in (1e-3, 1e-5):
        r = s.simulate(1.0, accuracy=asked, solver=solver, outputs=21)
        assert np.abs(r["A"].angle - fine["A"].angle).max() < asked
        assert r.accuracy.met
        assert r.accuracy.estimated > 0.02 * asked
        assert not r.warnings
    with pytest.raises(SolverError, match=r"accuracy 1e-12 needs about .* steps of .* s of CPU.* Ask for .*RadauIIA"):
        s.simulate(1.0, accuracy=1e-12, solver=solver)


def test_the_accuracy_that_a_refusal_asks_for_is_one_that_the_steps_reach():
    s, solver, asked = physical_pendulum(60), mb.HHT(), 1e-9
    with pytest.raises(SolverError, match="Ask for") as refused:
        s.simulate(2.0, accuracy=asked, solver=solver)
    enough = float(str(refused.value).partition("Ask for an accuracy of ")[2].partition(" ")[0])
    assert enough > asked
    steps = float(str(refused.value).partition(" about ")[2].partition(" ")[0])
    assert steps * (asked / enough) ** 0.5 <= MOST_STEPS


def test_runs_are_stored(tmp_path):
    r = physical_pendulum(60).simulate(0.5, solver=mb.HHT(step=1e-2), outputs=7)
    r.save(tmp_path / "r.npz")
    back = mb.load(tmp_path / "r.npz")
    assert back.info.solver == r.info.solver
    times = np.linspace(0, 0.5, 33)
    np.testing.assert_array_equal(back(times)["A"].angle, r(times)["A"].angle)


def test_constant_step_claims_no_accuracy():
    r = a01().simulate(0.5, solver=mb.HHT(step=1e-3))
    assert (r.accuracy.asked, r.accuracy.estimated, r.accuracy.met) == (None, None, None)
    assert a01().simulate(0.5, solver=mb.HHT(step=1e-3), verify=True).accuracy.verified == pytest.approx(2e-5, rel=1)


# -- what must be told


def periods(count, steps):
    period = 2.36784 * np.pi / np.pi  # of the point pendulum released horizontally, 4 K(1/2) sqrt(l / g), s
    return count * period, period / steps


def test_blow_up_of_index_three_is_not_reliable():
    """rho = 0.9 and 40 steps per period: every step converges, and the energy is off by many times what there is."""
    end, h = periods(30, 40)
    with pytest.warns(AccuracyWarning, match="not reliable: .* energy balance is off"):
        r = a01().simulate(end, solver=mb.GeneralizedAlpha(0.9, step=h), form=mb.Index3(), outputs=400)
    assert r.complete
    assert r.reliable is False
    assert np.max(np.abs(r.energy.balance)) > 5


def test_nothing_speaks_against_the_stabilised_form_there():
    end, h = periods(10, 80)
    r = a01().simulate(end, solver=mb.GeneralizedAlpha(0.6, step=h), form=mb.GGL(), outputs=400)
    assert r.reliable is None  # its error was not estimated
    assert not r.warnings


@pytest.mark.parametrize(
    ("solver", "message"),
    [
        (mb.GeneralizedAlpha(0.95, step=1e-3), r"spectral radius 0\.95\) that long steps gain energy"),
        (mb.HHT(0.02, step=1e-3), "long steps gain energy"),
    ],
)
def test_weak_damping_is_told(solver, message):
    with pytest.warns(AccuracyWarning, match=message):
        solver.solve(system(a01()), 0.01)
    with pytest.warns(AccuracyWarning, match=message):
        assert a01().simulate(0.01, solver=solver).warnings


def test_newmark_in_index_three_is_told():
    with pytest.warns(AccuracyWarning, match=r"\(Newmark's method, alpha = 0\): with form mb\.Index3\(\) constraint"):
        mb.HHT(0.0, step=1e-3).solve(system(a01(), mb.Index3()), 0.01)


def test_multipliers_of_newmark_do_not_converge():
    """What the warning says: in index 3 their error stays larger than they are, that of HHT falls fourfold."""
    top, errors = heavy_top(), {}
    fine = mb.RadauIIA(3, rtol=1e-9).solve(system(top, mb.GGL()), 0.05)
    first = fine.names.index("lambda(O.x)")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        for alpha in (0.0, 0.15):
            for h in (2.5e-4, 1.25e-4):
                solution = mb.HHT(alpha, step=h).solve(system(top, mb.Index3()), 0.05)
                late = solution.t > 0.025
                gap = solution.y[late, first : first + 3] - fine(solution.t[late])[:, first : first + 3]
                errors[alpha, h] = np.abs(gap).max() / np.abs(fine.y[:, first : first + 3]).max()
    assert errors[0.0, 1.25e-4] > 0.8 * errors[0.0, 2.5e-4] > 1.0
    assert errors[0.15, 1.25e-4] == pytest.approx(errors[0.15, 2.5e-4] / 4, rel=0.1)


def test_failure_names_the_unknown():
    with pytest.raises(SolverError, match=r"a step of 5 s fails, try another step.*resisting most: "):
        mb.HHT(step=5.0).solve(system(heavy_top(), mb.GGL()), 10.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: mb.GeneralizedAlpha(rho=1.1), r"rho = 1\.1 is not between 0 and 1: give the spectral radius"),
        (lambda: mb.GeneralizedAlpha(rho=float("nan")), "rho = nan"),
        (lambda: mb.HHT(alpha=0.5), r"alpha = 0\.5 is not between -0\.333333 and 0\.333333: give 0 \(Newmark\) to 1/3"),
        (lambda: mb.HHT(step=0.0), r"step = 0\.0 is not positive: give a positive number"),
        (lambda: mb.GeneralizedAlpha(step=1e-3, accuracy=1e-3), "give one of the two"),
        (lambda: mb.HHT(step=1e-2).solve(decay(), 1.0), r"no partition into them.*partition=\(M, f, g, G\)"),
        (lambda: mb.HHT(step=1e-2).solve(pendulum("ggl_rates"), 1.0), "no partition into them"),
        (lambda: mb.HHT(step=1e-2).solve(a01().system(mb.GGL()), 1.0),
         r"this system \(GGL\) contains only their derivatives: .*mb\.GGL\(algebraic=True\)"),
    ],
)
def test_what_is_refused(make, message):
    with pytest.raises(OptionError, match=message):
        make()


def test_hht_is_generalised_alpha_with_one_parameter():
    assert mb.HHT(0.1).coefficients.gamma == pytest.approx(0.6)
    assert mb.HHT(0.1).coefficients.beta == pytest.approx(1.1**2 / 4)
    assert mb.HHT(-0.1).coefficients == mb.HHT(0.1).coefficients
    assert mb.HHT(1 / 3).rho_infinity == pytest.approx(0.5)


def test_partition_is_checked_against_the_equations():
    def residual(t, y, yp, out):
        out[:] = [yp[0] - y[1], yp[1] + y[0]]

    parts = (lambda t, q: np.eye(1), lambda t, q, u: -q, lambda t, q: np.zeros(0), lambda t, q: np.zeros((0, 1)))
    solution = mb.GeneralizedAlpha(step=1e-2).solve(mb.DAE(residual, [1.0, 0.0], [0.0, -1.0], partition=parts), 1.0)
    assert solution.y[-1] == pytest.approx([np.cos(1), -np.sin(1)], abs=1e-4)
    with pytest.raises(OptionError, match="state other equations"):
        mb.DAE(residual, [1.0, 0.0], [0.0, -1.0], partition=(parts[0], lambda t, q, u: q, *parts[2:]))
    with pytest.raises(OptionError, match="give four functions"):
        mb.DAE(residual, [1.0, 0.0], [0.0, -1.0], partition=parts[:3])
    with pytest.raises(OptionError, match="no division of the 2 unknowns"):
        mb.DAE(residual, [1.0, 0.0], [0.0, -1.0], partition=(lambda t, q: np.eye(2), *parts[1:]))
