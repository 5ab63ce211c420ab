"""The index-1 form: its equations, its elimination of multipliers, and what it must not do silently."""

import warnings

import numpy as np
import pytest
import recursive_scenes
from scenes import a01, andrews, ground_resonance, heavy_top, n_rods, stick_slip

import mbdae as mb
from mbdae.errors import AccuracyWarning, OptionError, SolverError
from mbdae.formulations import system_for
from mbdae.system.prepare import prepare


def rubbing_slider():
    """Coulomb friction pressed by the reaction of its own joint: forces depend on multipliers."""
    s = mb.Scene("slider", gravity=(0, -9.81, 0))
    block = s.rigid_body("block", 2.0, 0.1, at=(0, 0, 0), velocity=(1.0, 0, 0))
    s.prismatic("P", s.ground, block, at=(0, 0, 0), axis=(1, 0, 0), friction=mb.Coulomb(mu=0.3, v_c=0.1))
    return s


def mixed_masses():
    """A chain with a link of a billionth of the others' mass."""
    s = mb.Scene("mixed", gravity=(0, -9.81, 0))
    before = s.ground
    for i, mass in enumerate((1.0, 1e-9, 1.0)):
        link = s.link(f"l{i}", (i, 0), (i + 1, 0), mass=mass)
        s.revolute(f"J{i}", before, link, at=(i, 0))
        before = link
    return s


SCENES = {
    "pendulum": (a01, "Cholesky"), "andrews": (andrews, "Cholesky"), "top": (heavy_top, "Cholesky"),
    "chain": (lambda: n_rods(40), "Cholesky"),
    "massless hub": (ground_resonance, "LU"), "mixed masses": (mixed_masses, "LU"), "loop": (recursive_scenes.loop, None),
    "LuGre": (stick_slip, "Cholesky"), "friction by reaction": (rubbing_slider, None),
}


@pytest.mark.parametrize("name", ["andrews", "massless hub", "friction by reaction"])  # by Cholesky, by LU, in full
def test_a_singular_position_is_looked_for_at_the_accepted_state(name):
    """Not where the right-hand side was evaluated last, which is another place for some methods."""
    system = system_for(prepare(SCENES[name][0]()), mb.Index1(), 0)
    rates, rng = system._rates.kernel or system._rates, np.random.default_rng(2)

    def shares(t, y):
        return rates.shares(np.array([t, t]), np.array([system.y0, y]))[1]

    y, other = system.y0, system.y0 + 0.1 * rng.normal(size=system.n)
    expected = shares(0.0, y)
    system.rhs(0.0, other, np.empty(system.n))
    assert np.array_equal(shares(0.0, y), expected)
    assert name == "friction by reaction" or not np.array_equal(shares(0.0, other), expected)


@pytest.fixture(params=SCENES)
def eliminated(request):
    make, way = SCENES[request.param]
    prepared = prepare(make())
    return prepared, system_for(prepared, mb.Index1(), 0), way


def test_rates_are_those_of_the_equations_of_motion(eliminated):
    prepared, system, way = eliminated
    rate, start = np.empty(system.n), prepared.start
    system.rhs(system.t0, system.y0, rate)
    assert rate == pytest.approx(system.yp0, rel=1e-8, abs=1e-8 * np.max(np.abs(system.yp0)))
    among = system.full.numbering.rows_among(prepared.mechanics.rows)
    assert system.multipliers == pytest.approx(start.multipliers[among], rel=1e-7, abs=1e-7 * np.max(np.abs(start.multipliers)))
    kernel = system._rates.kernel
    assert (None if kernel is None else "LU" if kernel.whole else "Cholesky") == way


def test_every_way_agrees_with_the_full_equations_off_the_constraints(eliminated):
    """Baumgarte's terms count there."""
    _, system, _ = eliminated
    rng = np.random.default_rng(3)
    y = system.y0 + 1e-3 * rng.normal(size=system.n) * np.minimum(system.scale, 1)
    rate, full = np.empty(system.n), np.zeros(system.n)
    system.rhs(0.1, y, rate)
    multipliers = system.multipliers.copy()
    system._rates.solve(0.1, y, full)
    assert rate == pytest.approx(full, rel=1e-6, abs=1e-9 * np.max(np.abs(full)))
    assert multipliers == pytest.approx(system._rates.multipliers, rel=1e-6, abs=1e-9 * np.max(np.abs(multipliers)))
    residual = np.empty(system.full.n)
    system.full.residual(0.1, np.r_[y, multipliers], np.r_[rate, 0 * multipliers], residual)
    assert np.max(np.abs(residual)) < 1e-8 * max(1.0, np.max(np.abs(rate)), np.max(np.abs(multipliers)))


def test_jacobian_agrees_with_differences(eliminated):
    _, system, _ = eliminated
    J, plus, minus = system.rate_jacobian(0.1, system.y0), *np.empty((2, system.n))
    for j in range(0, system.n, max(1, system.n // 12)):
        y, h = system.y0.copy(), 1e-6 * max(1.0, abs(system.y0[j]))
        y[j] += h
        system.rhs(0.1, y, plus)
        y[j] -= 2 * h
        system.rhs(0.1, y, minus)
        assert J[:, j] == pytest.approx((plus - minus) / (2 * h), rel=1e-5, abs=1e-6 * np.max(np.abs(J)))


@pytest.mark.parametrize("solver", [mb.CVODE(), mb.CVODE(method="BDF"), mb.IDA(), mb.RadauIIA(3), mb.RadauIIA(2)], ids=repr)
def test_every_solver_keeps_the_accuracy_asked_for(solver):
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("A", s.ground, rod, at=(0, 0))
    asked = 1e-6
    r = s.simulate(1.0, accuracy=asked, solver=solver, form=mb.Index1(), outputs=21)
    fine = s.simulate(1.0, solver=mb.RadauIIA(3, rtol=1e-10), form=mb.GGL(), outputs=21)
    assert np.max(np.abs(r["A"].angle - fine["A"].angle)) < asked
    assert np.max(np.abs(r["A"].force - fine["A"].force)) < 1e-4
    assert r.accuracy.met
    assert not r.warnings


def test_cvode_takes_constraints_by_itself():
    r = a01().simulate(0.5, solver=mb.CVODE())
    assert r.info.form == "Index1"
    assert r.accuracy.met


def test_drift_is_told():
    """Without stabilisation and with a coarse tolerance the rod grows."""
    s = a01()
    with pytest.warns(AccuracyWarning, match=r"rod.* is violated in position, by .* raise its baumgarte"):
        s.simulate(20.0, solver=mb.CVODE(1e-5), form=mb.Index1(baumgarte=0))
    r = s.simulate(20.0, accuracy=1e-5, solver=mb.CVODE(), form=mb.Index1())
    assert not r.warnings


def parallelogram(angle=np.pi / 2, rate=None):
    """Equal cranks: flat at the angle 0, where it may open to the other branch."""
    s = mb.Scene("parallelogram", gravity=(0, -9.81, 0))
    near = np.array([np.cos(angle), np.sin(angle)])
    far = near + np.array([2.0, 0.0])
    crank, rocker = s.link("crank", (0, 0), near, mass=1.0), s.link("rocker", (2, 0), far, mass=1.0)
    coupler = s.link("coupler", near, far, mass=1.0)
    s.revolute("A", s.ground, crank, at=(0, 0), rate0=rate)
    s.revolute("B", crank, coupler, at=near)
    s.revolute("C", coupler, rocker, at=far)
    s.revolute("D", rocker, s.ground, at=(2, 0))
    return s


@pytest.mark.parametrize("rtol", [1e-6, 1e-10])
def test_crossing_a_singular_position_is_told(rtol):
    """The cranks turn through the flat position: an error or a warning, whatever branch the run then takes."""
    system = system_for(prepare(parallelogram(rate=-3.0)), mb.Index1(), 0)
    with warnings.catch_warnings():
        warnings.simplefilter("error", AccuracyWarning)
        with pytest.raises((SolverError, AccuracyWarning), match="singular position"):
            mb.CVODE(rtol).solve(system, 2.0)


def test_singular_state_has_no_rates():
    system = system_for(prepare(parallelogram(angle=0.3)), mb.Index1(), 0)
    y = system.y0.copy()
    turned = -0.3 * np.array([1, 1, 0])  # crank, rocker, coupler
    y[:9] = np.c_[[0.5, 2.5, 2.0], np.zeros(3), turned].ravel()
    with pytest.raises(SolverError, match=r"singular position.*form=mb\.GGL\(\)"):
        system.rhs(0.0, y, np.empty(system.n))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"baumgarte": -1.0}, r"baumgarte = -1\.0 is not 0 or more: give alpha >= 0"),
        ({"baumgarte": float("nan")}, "baumgarte = nan"),
        ({"baumgarte": (1.0, 2.0, 3.0)}, "the pair"),
        ({"baumgarte": "much"}, "baumgarte = 'much'"),
        ({"multipliers": "none"}, "multipliers = 'none' is not one of 'derivatives', 'algebraic', 'eliminated'"),
    ],
)
def test_options(options, message):
    with pytest.raises(OptionError, match=message):
        mb.Index1(**options)


def test_baumgarte_follows_the_characteristic_time():
    fast, slow = (mb.Index1().for_time(T).spec().numbers["baumgarte_velocity"] for T in (1e-3, 1.0))
    assert fast == pytest.approx(1000 * slow)
    assert mb.Index1(baumgarte=(2.0, 3.0)).spec().numbers == {"baumgarte_velocity": 4.0, "baumgarte_position": 9.0}
