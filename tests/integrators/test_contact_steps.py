"""Contacts are never stepped over: impacts against their exact restitution, grazing contacts, a ball that comes to rest."""

from math import inf, pi

import numpy as np
import pytest
from contact_problems import (
    K,
    ball,
    between_walls,
    duration,
    exit_speed,
    law,
    oscillator,
    oscillator_period,
    penetration,
    point_mass,
)
from dae_problems import pendulum, pendulum_exact

import mbdae as mb
from mbdae.integrators import contact_steps
from mbdae.integrators.base import Asked
from mbdae.integrators.contact_steps import ContactSteps, Cubic, suspect
from mbdae.integrators.solution import Stats
from mbdae.run.control import run_controlled

SOLVERS = {
    "IDA": lambda rtol, atol=None: mb.IDA(rtol, atol),
    "BDF": lambda rtol, atol=None: mb.CVODE(rtol, atol, method="BDF"),
    "Adams": lambda rtol, atol=None: mb.CVODE(rtol, atol),
    "Radau3": lambda rtol, atol=None: mb.RadauIIA(3, rtol=rtol, atol=atol),
    "Radau2": lambda rtol, atol=None: mb.RadauIIA(2, rtol=rtol, atol=atol),
}
every_solver = pytest.mark.parametrize("name", SOLVERS)


# -- one impact

#: error over rtol that is allowed; largest over all cells: IDA 69, BDF 420, Adams 620, Radau3 2.2, Radau2 1.5
BAR = {"IDA": 120, "BDF": 700, "Adams": 1000, "Radau3": 5, "Radau2": 5}


def impacts(name, speeds, heights, tolerances, far=False, after=(0.1,)):
    """Cells of (rtol, v0, height, damping, after) with the relative error of the exit speed and the run's statistics."""
    for rtol in tolerances:
        for v0, height, damping, time in ((v, h, c, t) for v in speeds for h in heights for c in (0.0, 0.3, 1.0) for t in after):
            system = ball(v0, height, damping, wall=-height if far else 0.0)
            solver = SOLVERS[name](rtol, [rtol * penetration(v0), rtol * v0])
            solution = solver.solve(system, height / v0 + time)
            exact = exit_speed(v0, damping)
            yield (rtol, v0, height, damping, time), abs(solution.y[-1, 1] - exact) / exact, solution.stats


def check_impacts(name, cells):
    for (rtol, v0, height, damping, _), error, stats in cells:
        noise = 50 * np.finfo(float).eps * height / penetration(v0)  # of the position at the wall, in penetrations
        text = f"{name} {rtol=} {v0=} {height=} {damping=}: {error:.1e}, {stats}"
        assert error < BAR[name] * rtol * max(1.0, damping * v0) + noise, text
        assert (stats.contacts, stats.missed_dips) == (1, 0), text
        assert stats.shortest_contact >= 5, text


@every_solver
@pytest.mark.parametrize("far", [False, True], ids=["wall at 0", "start at 0"])
def test_impact_after_short_and_long_flight(name, far):
    """Speeds over four decades; flights over six, after which the relative tolerance of a position far away is coarse."""
    check_impacts(name, impacts(name, (1e-3, 1.0, 10.0), (1e-3, 1e3), (1e-3, 1e-6), far))


@pytest.mark.slow
@every_solver
@pytest.mark.parametrize("far", [False, True], ids=["wall at 0", "start at 0"])
def test_every_impact(name, far):
    speeds, heights, tolerances = (1e-3, 1e-2, 0.1, 1.0, 10.0), (1e-3, 1.0, 1e3), (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
    cells = list(impacts(name, speeds, heights, tolerances, far, (0.01, 1.0)))
    for rtol in sorted({cell[0] for cell, *_ in cells}):
        found = [(error / rtol, stats.residuals, cell[1:]) for cell, error, stats in cells if cell[0] == rtol]
        errors = np.array([f[0] for f in found])
        print(f"{name:7s} {'far' if far else 'near':5s} rtol {rtol:.0e}: error / rtol {np.median(errors):6.2f} (max "
              f"{errors.max():6.2f} at v0, height, damping, after = {max(found)[2]}), "
              f"above 10: {np.sum(errors > 10):3d} of {len(errors)}, "
              f"evaluations {np.median([f[1] for f in found]):.0f}")
    check_impacts(name, cells)


@every_solver
def test_slow_impact_below_the_tolerance_still_bounces(name):
    """A millimetre per second with a tolerance of 1e-4 m and m/s: without guards IDA and Radau were seen to report no bounce."""
    for damping in (0.0, 1.0):
        solution = SOLVERS[name](1e-4, 1e-4).solve(ball(1e-3, 1e-3, damping), 1.1)
        assert solution.stats.contacts == 1
        assert solution.y[-1, 1] == pytest.approx(1e-3, rel=0.02 if name.startswith("Radau") else 0.35)


@pytest.mark.parametrize("solver", [mb.IDA(), mb.RadauIIA(3)], ids=lambda s: s.label)
def test_accuracy_is_controlled(solver):
    """Position and velocity relative to 1 m and 1 m/s, a tenth of a second after an impact."""
    found = run_controlled(ball(1.0, 0.1, damping=0.3), None, solver, 1e-5, Asked(0.2), np.linspace(0, 0.2, 21))
    error = abs(found.solution.y[-1, 1] - exit_speed(1.0, 0.3))
    print(f"{solver.label}: error {error:.1e}, estimated {found.estimate:.1e}")
    assert found.estimate <= 1e-5
    assert error < 1e-5
    assert found.solution.stats.contacts == 1


# -- grazing contacts


def graze(solver, k, phase):
    """After 12 contacts: error of the phase in contacts, error of the energy, contacts missed, statistics."""
    period = oscillator_period(k)
    t_end = 12.5 * period - phase
    solution = solver.solve(oscillator(phase, k), t_end)
    lead = 2 * pi - period  # one contact puts the phase forward by this
    first = pi / 2 - phase - lead / 2
    count = int((t_end - first) // period)
    exact = pi / 2 + lead / 2 + (t_end - first - count * period)
    off = (exact - np.arctan2(*solution.y[-1]) + pi) % (2 * pi) - pi
    energy = 0.5 * float(solution.y[-1] @ solution.y[-1]) - 0.5
    return abs(off) / lead, abs(energy), count + 1 - solution.stats.contacts, solution.stats


#: phase error in contacts and energy error at rtol 1e-7, about three times those measured
GRAZING = {"IDA": (6, 1e-4), "BDF": (8, 1e-4), "Adams": (6, 1e-4), "Radau3": (0.01, 1e-7), "Radau2": (0.5, 6e-6)}


@every_solver
@pytest.mark.parametrize("k", [1e6, 1e9])
def test_grazing_contacts_are_not_missed(name, k):
    phase, energy, missed, stats = graze(SOLVERS[name](1e-7), k, -1.0)
    print(f"{name} k = {k:.0e}: phase off by {phase:.1e} contacts, energy {energy:.1e}, evaluations {stats.residuals}")
    assert missed == 0
    assert phase < GRAZING[name][0]
    assert energy < GRAZING[name][1]
    assert stats.shortest_contact >= 10


@pytest.mark.slow
@every_solver
@pytest.mark.parametrize("k", [1e6, 1e7, 1e8, 1e9])
def test_grazing_from_many_phases(name, k):
    for rtol in (1e-5, 1e-6, 1e-7, 1e-8):
        found = [graze(SOLVERS[name](rtol), k, phase) for phase in np.linspace(-2.0, 0.4, 12)]
        print(f"{name:7s} k = {k:.0e} rtol {rtol:.0e}: phase off by {np.median([f[0] for f in found]):.1e} contacts "
              f"(max {max(f[0] for f in found):.1e}), energy {max(f[1] for f in found):.1e}, missed {[f[2] for f in found]}, "
              f"evaluations {np.median([f[3].residuals for f in found]):.0f}")
        if rtol <= 1e-7:
            assert max(f[2] for f in found) == 0
            assert max(f[0] for f in found) < GRAZING[name][0]


@every_solver
def test_dips_alone_find_grazing_contacts(name, monkeypatch):
    """Without a bound on the step every contact has to be found by the dip inside a step, and the step taken back."""
    monkeypatch.setattr(ContactSteps, "bound", lambda self: inf)
    found = [graze(SOLVERS[name](1e-7), 1e6, phase) for phase in (-1.0, 0.2)]
    assert [f[2] for f in found] == [0, 0]
    assert max(f[0] for f in found) < GRAZING[name][0]
    assert sum(f[3].missed_dips for f in found) == 0
    if name != "Radau2":  # whose steps are short enough by themselves
        assert sum(f[3].dips for f in found) >= 5


def test_dips_are_taken_back_in_equations_that_are_no_ode(monkeypatch):
    """The contact force as an algebraic unknown: the state and rates of the last accepted step are a consistent start."""
    monkeypatch.setattr(ContactSteps, "bound", lambda self: inf)
    k, wall = 1e6, 1 - 1e-4

    def residual(t, y, yp, out):
        out[:] = yp[0] - y[1], yp[1] + y[0] + y[2], y[2] - law(y[0] - wall, y[1], k)[0]

    def jacobian(t, y, yp, cj, out):
        out[...] = [[cj, -1, 0], [1, cj, 1], [-law(y[0] - wall, y[1], k)[1], 0, 1]]

    def guards(t, y):
        return np.array([wall - y[0]]), -y[1:2], np.array([duration(y[1], k)])

    for solver in (mb.IDA(1e-7), mb.RadauIIA(3, rtol=1e-7)):
        system = mb.DAE(residual, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], jacobian, guards=guards)
        solution = solver.solve(system, 30.0)
        assert solution.stats.contacts == 5
        assert solution.stats.dips >= 1
        assert 0.5 * solution.y[-1, :2] @ solution.y[-1, :2] == pytest.approx(0.5, abs=1e-4)


@pytest.mark.parametrize("bounded", [True, False], ids=["bounded", "dips alone"])
@pytest.mark.parametrize(
    ("form", "solver"),
    [("ggl_rates", mb.IDA(1e-7)), ("ggl", mb.RadauIIA(3, rtol=1e-6)), ("index3", mb.RadauIIA(3, rtol=1e-6))],
    ids=["IDA, multipliers as rates", "Radau, index 2", "Radau, index 3"],
)
def test_constrained_motion_is_not_disturbed(form, solver, bounded, monkeypatch):
    """A pendulum dips 10 um below a surface that exerts no force, 8 times in 10 s: as exact as without the surface."""
    if not bounded:
        monkeypatch.setattr(ContactSteps, "bound", lambda self: inf)
    errors = []
    for guards in (None, lambda t, y: (np.array([y[1] + 1 - 1e-5]), y[3:4], np.array([1e-5]))):
        solution = solver.solve(pendulum(form, guards=guards), 10.0)
        errors.append(np.abs(solution.y[:, :4] - pendulum_exact(solution.t, 10.0)).max())
    assert solution.stats.contacts == 8
    assert (solution.stats.dips > 0) != bounded
    assert errors[1] < 10 * errors[0]


# -- at rest


def drop(solver, guarded=True):
    return solver.solve(ball(0.0, 0.1, damping=3.0, gravity=9.81, guarded=guarded), 1.5)


@every_solver
def test_ball_comes_to_rest(name):
    """37 contacts, then the static penetration, where the bound does not hold the steps down."""
    rtol = 1e-6 if name != "Radau2" else 1e-5
    scaled = SOLVERS[name](rtol, [rtol * penetration(1.4), rtol * 1.4])
    solution, plain = drop(scaled), drop(scaled, guarded=False)
    print(f"{name}: {solution.stats.residuals} evaluations, {plain.stats.residuals} without guards")
    assert solution.stats.contacts == pytest.approx(37, abs=1)
    assert solution.y[-1, 0] == pytest.approx(-((9.81 / K) ** (2 / 3)), rel=1e-2)
    assert solution.stats.residuals < 1.3 * plain.stats.residuals


@pytest.mark.parametrize("name", ["IDA", "Radau3", "Radau2"])
def test_rest_is_cheap_at_loose_tolerances(name):
    scaled = SOLVERS[name](1e-4, [1e-4 * penetration(1.4), 1e-4 * 1.4])
    solution, plain = drop(scaled), drop(scaled, guarded=False)
    print(f"{name}: {solution.stats.residuals} evaluations, {plain.stats.residuals} without guards")
    assert solution.stats.residuals < 1.5 * plain.stats.residuals
    assert np.sum(solution.t > 1.45) < 10


# -- counts, names, refusals


@every_solver
def test_contacts_of_two_walls_are_counted(name):
    solution = SOLVERS[name](1e-6, [1e-6 * penetration(1.0), 1e-6]).solve(between_walls(1.0), 0.1)
    speed = np.abs(solution.y[(solution.y[:, 0] > 0) & (solution.y[:, 0] < 1e-2), 1])
    assert solution.stats.contacts == 9  # every 0.01 s of flight and 0.8 ms of impact, from 5 ms on
    assert solution.stats.shortest_contact >= 30 or name == "Radau3"
    assert speed == pytest.approx(np.ones_like(speed), abs=2e-3)


def test_constant_steps_count_what_they_miss():
    """Radau of constant step cannot be steered: contacts that come and go inside a step are counted, others are not."""
    coarse = mb.RadauIIA(3, step=0.05).solve(oscillator(-1.0, 1e6), 80.0)
    fine = mb.RadauIIA(3, step=1e-3).solve(oscillator(-1.0, 1e6), 10.0)
    assert coarse.stats.contacts + coarse.stats.missed_dips == pytest.approx(13, abs=3)
    assert coarse.stats.missed_dips >= 3
    assert fine.stats.missed_dips == 0
    assert fine.stats.contacts == 2


def test_a_system_without_guards_pays_nothing(monkeypatch):
    monkeypatch.setattr(ContactSteps, "__init__", lambda *arguments: pytest.fail("contacts of a system that has none"))
    for solver in (mb.IDA(1e-6), mb.CVODE(1e-6), mb.RadauIIA(3, rtol=1e-6), mb.RadauIIA(2, step=0.01)):
        stats = solver.solve(ball(1.0, 0.01, guarded=False), 0.005).stats
        assert (stats.contacts, stats.dips, stats.missed_dips, stats.shortest_contact) == (0, 0, 0, 0)


@every_solver
def test_failure_names_the_contact(name):
    """A wall that is not a number beyond a tenth of the penetration: SUNDIALS then reports success without progress."""
    system = between_walls(1.0, limit=0.1 * penetration(1.0))
    with pytest.raises(mb.SolverError, match=r"nearest contact: right wall, gap -.* m, changing by") as caught:
        SOLVERS[name](1e-6, [1e-6 * penetration(1.0), 1e-6]).solve(system, 0.1)
    assert caught.value.time == pytest.approx(0.005, abs=1e-4)


@every_solver
def test_exception_of_the_guards_comes_through(name):
    system = ball(1.0, 0.01, watch=lambda t, y: (np.array([y[0]]), y[1:], np.array([1e-5 if t < 0.003 else 1 / 0])))
    with pytest.raises(ZeroDivisionError):
        SOLVERS[name](1e-6).solve(system, 0.1)


@pytest.mark.parametrize(
    ("guards", "names", "message"),
    [
        (lambda t, y: (y[:1], y[1:]), None, r"return \(gap, gap rate, duration\)"),
        (lambda t, y: (y[:1], y, y), None, r"shapes \(1,\), \(2,\), \(2,\): return three arrays of one dimension and equal"),
        (lambda t, y: (y[0], y[1], 1.0), None, r"shapes \(\), \(\), \(\)"),
        (lambda t, y: (y[:1], y[1:] * np.nan, [1.0]), None, r"contact\[0\] at the start t = 0 s: gap 1\.0, gap rate nan"),
        (lambda t, y: (y[:1], y[1:], [0.0]), ["pin"],
         r"guards returns for pin .* duration of an impact 0\.0 s; return .* positive duration"),
        (lambda t, y: (y[:1], y[1:], [inf]), ["a", "b"], r"guard_names = \['a', 'b'\] has 2 entries: give 1 different names"),
        (None, ["pin"], r"guard_names = \['pin'\] without guards"),
    ],
)
def test_guards_are_checked_at_the_start(guards, names, message):
    with pytest.raises(mb.OptionError, match=message):
        point_mass(1.0, -1.0, lambda x, v: (0.0, 0.0, 0.0), guards, None, names)


# -- the parts


def ends_of(cubic):
    """The contact of a cubic at both ends of its step."""
    return np.array([[cubic.g0, cubic.r0, 1.0]]), np.array([[cubic.g1, cubic.r1, 1.0]])


def test_cubic_minimum_and_zero():
    """(s - 0.4)^2 (s + 1) + c over a step of 2 s."""
    value = lambda s: (s - 0.4) ** 2 * (s + 1)  # noqa: E731
    slope = lambda s: 2 * (s - 0.4) * (s + 1) + (s - 0.4) ** 2  # noqa: E731
    for c in (0.05, -0.01):
        cubic = Cubic(2.0, value(0) + c, value(1) + c, slope(0) / 2, slope(1) / 2)
        assert cubic.minimum() == pytest.approx((0.4, c), abs=1e-12)
        assert cubic.value(0.7) == pytest.approx(value(0.7) + c)
        assert suspect(*ends_of(cubic), cubic.h, 0.0).tolist() == [True]
    assert value(cubic.zero(0.4)) == pytest.approx(0.01, rel=1e-6)
    assert Cubic(1.0, 1.0, 2.0, 1.0, 1.0).minimum() == (0.0, 1.0)
    rising = Cubic(1.0, 1.0, 2.0, 1.0, 1.0)
    assert suspect(*ends_of(rising), rising.h, 0.1).tolist() == [False]


def test_a_place_is_not_taken_back_for_ever():
    """Guards that show a dip in every step, however short: after some attempts the step is kept and the dip counted as missed."""
    stats, dip = Stats(), lambda t: (np.array([1e-3]), np.array([1.0 if t else -1.0]), np.array([1e-9]))
    system = ball(1.0, 1.0, watch=lambda t, y: dip(t))
    steps = ContactSteps(system, stats)
    for attempt in range(contact_steps.RETRIES):
        steps.look(0.1 / 2**attempt, system.y0)
        assert steps.hidden() == pytest.approx(0.01 / 2**attempt, rel=1.0)
    steps.look(0.1, system.y0)
    assert steps.hidden() is None
    assert (stats.dips, stats.missed_dips) == (contact_steps.RETRIES, 1)


@pytest.mark.parametrize("exactly", [contact_steps.MET, (0.0, 0.0)])
@pytest.mark.parametrize("ulps", [1, 30, 300])
def test_no_touch_is_sought_within_round_off_of_the_time(exactly, ulps):
    """States do not change in such steps: the gap stays as it is, and ever shorter steps would follow."""
    t, h = 0.7, ulps * float(np.spacing(0.7))
    system = ball(1.0, 1.0, watch=lambda at, y: tuple(np.array([x]) for x in (-1.0 if at < t + 0.5 * h else 1.0, 2.0, 1e-3)))
    steps = ContactSteps(system, Stats(), meets=exactly)
    steps.look(t, system.y0)
    steps.keep()
    steps.look(t + h, system.y0)
    assert steps.shorter(h, lambda part: system.y0) is None
    steps.look(t + 1e-4, system.y0)
    assert steps.shorter(1e-4, lambda part: system.y0) is None  # at the beginning of that step


def test_bound_of_approach_impact_and_rest():
    contact = {"gap": 1.0, "rate": -2.0, "duration": 1e-3}
    system = ball(1.0, 1.0, watch=lambda t, y: tuple(np.array([contact[part]]) for part in ("gap", "rate", "duration")))
    steps = ContactSteps(system, Stats())

    def bound(t, gap, rate):
        contact.update(gap=gap, rate=rate)
        steps.look(t, system.y0)
        steps.keep()
        return steps.bound()

    assert steps.bound() == pytest.approx(0.25)  # half the way
    assert bound(1.0, 1e-4, -2.0) == pytest.approx(2e-4)  # a fifth of an impact
    assert bound(1.0001, -1e-4, -2.0) == pytest.approx(2e-4)
    assert bound(1.0002, -2e-4, 0.0) == pytest.approx(2e-4)  # it turns, which is no rest
    assert bound(1.0003, -2e-4, 1e-3) == pytest.approx(0.02)  # twice slow: a tenth of the penetration
    assert bound(1.0004, -1e-4, 2.0) == pytest.approx(2e-4)
    assert bound(1.0040, -1e-4, 2.0) == inf  # it lasts
    assert bound(1.0041, 1e-4, 2.0) == inf
    assert steps.stats.contacts == 1
    assert steps.stats.shortest_contact == 5
