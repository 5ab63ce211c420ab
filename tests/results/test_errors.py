"""The error of what is read: estimated by the runs beside the run, told once where it is above the accuracy, and kept."""

from __future__ import annotations

import pickle
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from beam_scenes import slider_crank
from contact_scenes import ball

import mbdae as mb
from mbdae.results.clearance import OtherRun
from mbdae.results.contacts import Peak, averaged, largest, with_error
from mbdae.results.errors import Errors, fallen
from mbdae.results.quantities import magnitudes

G = 9.81


def four_bar() -> mb.Scene:
    """A driven loop of rigid links."""
    s = mb.Scene("four-bar", gravity=(0, -G, 0))
    A, B, C, D = (0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)
    crank, coupler, rocker = s.link("crank", A, B, mass=0.3), s.link("coupler", B, C, mass=0.6), s.link("rocker", C, D, mass=0.5)
    s.revolute("A", s.ground, crank, at=A, angle=12.56 * mb.t)
    s.revolute("B", crank, coupler, at=B)
    s.revolute("C", coupler, rocker, at=C)
    s.revolute("D", s.ground, rocker, at=D)
    return s


def elastic() -> mb.Scene:
    """An engine whose elastic rod starts unstrained and rings, without damping."""
    return slider_crank(2, 2)


@pytest.fixture(scope="module")
def rigid() -> mb.Result:
    return four_bar().simulate(0.5, accuracy=1e-4)


@pytest.fixture(scope="module")
def ringing() -> mb.Result:
    return elastic().simulate(0.01, accuracy=1e-3)


def told_by(read: Any) -> list[str]:
    """What a reader is told."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read()
    return [str(w.message) for w in caught if issubclass(w.category, mb.AccuracyWarning)]


# ---- estimates


@pytest.mark.parametrize("quantity", ["A.drive", "B.force", "B.force[1]", "D.torque", "norm(B.force)*2", "coupler.acceleration",
                                      "D.angle", "A.drive*A.rate"])
def test_errors_bound_the_true_ones(quantity: str, rigid: mb.Result) -> None:
    """Against a run at 1e-9, at times between steps; estimates of smooth motion were measured to be 1 to 20 times the error."""
    exact, times = four_bar().simulate(0.5, accuracy=1e-9), np.linspace(0, 0.5, 801)
    error = float(np.max(magnitudes(rigid(times).value(quantity) - exact(times).value(quantity))))
    estimate = rigid.error(quantity)
    assert estimate is not None
    assert error <= 3 * estimate + 1e-12
    assert estimate <= 60 * error + 1e-9


def test_a_function_of_the_result_has_an_error_too(rigid: mb.Result) -> None:
    assert rigid.error(lambda r: r["B"].force) == pytest.approx(rigid.error("B.force"), rel=1e-12)
    assert rigid.error(lambda r: np.full(len(r.t), len(r.warnings))) is None  # no run beside it has warnings
    with pytest.raises(mb.MbdaeError, match="no sensor"):
        rigid.error("B.forces")


def test_a_solver_with_its_own_tolerance_has_no_errors() -> None:
    r = four_bar().simulate(0.1, solver=mb.RadauIIA(3, rtol=1e-6))
    found = r.peak("A.drive")
    assert (r.error("A.drive"), found.error) == (None, None)
    assert "its error is not known" in repr(found)
    assert told_by(lambda: r["A"].drive) == []


@pytest.mark.parametrize("accuracy", [1e-4, 1e-6])
@pytest.mark.parametrize("stiffness", [3e3, 1e4, 3e4])
def test_forces_in_the_first_step_of_a_motion_from_rest(stiffness: float, accuracy: float) -> None:
    """Force m g (1 - cos omega t) of a spring that takes up a weight. Terms of the error estimate cancel in the first step, which
    was too long for forces by the interpolant: 1.1e-5 off where 9e-7 was told."""
    s = mb.Scene("weight on a spring", gravity=(0, -G))
    weight = s.rigid_body("weight", 1.0, 0.1, at=(0, -1))
    s.spring("spring", s.ground, weight, (0, 0), (0, -1), stiffness=stiffness)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        r = s.simulate(0.5, accuracy)
    times = np.linspace(0, 0.1, 1001)
    off = np.abs(np.linalg.norm(r(times)["spring"].force, axis=1) - G * (1 - np.cos(np.sqrt(stiffness) * times)))
    assert np.max(off) / (2 * G) < 1.5 * r.accuracy.reactions
    steps = np.diff(r.solution.t)
    assert steps[0] < 1.3 * np.median(steps)


def test_errors_of_two_companions_show_how_fast_they_fall() -> None:
    """Errors c tol^p: with the tolerances 10 and 100 times that of the run its own error follows. Faster than with the root they
    are not taken to fall: of sequences of impacts no two differences show that the next one follows them. Nor is a near companion
    that differs by nothing, since it took the same steps, a sign of it."""
    e = 1e-3
    assert fallen((e * 99, 100.0), (e * 9, 10.0)) == fallen((e * 99, 100.0), (e / 9, 10.0)) == pytest.approx(e * 99 / 9)
    for p in (0.2, 0.5):
        assert fallen((e * (100**p - 1), 100.0), (e * (10**p - 1), 10.0)) == pytest.approx(e, rel=0.1)
    assert fallen((2e-3, 100.0), (1e-3, 10.0)) == pytest.approx(2e-3)  # they hardly fall: the larger difference
    assert fallen((0.0, 100.0), (0.0, 10.0)) == 0.0


# ---- peaks


def test_errors_of_a_scene_of_rigid_bodies_lack_nothing(rigid: mb.Result) -> None:
    assert (rigid.accuracy.lacks, rigid.peak("A.angle").lacks, rigid.mean("A.angle").lacks) == ("", "", "")


def test_peaks_carry_their_error(rigid: mb.Result) -> None:
    exact, found = four_bar().simulate(0.5, accuracy=1e-9).peak("A.drive"), rigid.peak("A.drive")
    assert found.error is not None
    assert abs(found.value - exact.value) <= 3 * found.error <= 3e-3 * exact.value
    assert tuple(found) == (found.value, found.t, "N m", "A.drive")
    assert " +- " in repr(found)
    assert pickle.loads(pickle.dumps(found)).error == found.error


def test_peaks_and_means_of_an_interval(rigid: mb.Result) -> None:
    """Against sums over many times, which are good to 1e-4 here, and a run at 1e-9."""
    exact, part = four_bar().simulate(0.5, accuracy=1e-9), (0.1, 0.3)
    found, force = rigid.peak("A.drive", t=part), np.abs(rigid(np.linspace(*part, 2001))["A"].drive)
    assert part[0] <= found.t <= part[1]
    assert rigid.peak("A.drive").value > found.value
    assert found.value == pytest.approx(force.max(), rel=1e-6)
    assert found.error is not None
    assert abs(found.value - exact.peak("A.drive", t=part).value) <= 3 * found.error
    times = np.linspace(*part, 4001)
    vector, drive = exact(times)["B"].force, exact(times)["A"].drive
    for read, wanted in ((rigid.mean("B.force", t=part), np.trapezoid(vector, times, axis=0) / 0.2),
                         (rigid.mean("A.drive", t=part), np.trapezoid(drive, times) / 0.2),
                         (rigid.rms("A.drive", t=part), np.sqrt(np.trapezoid(drive**2, times) / 0.2)),
                         (rigid.rms("B.force", t=part), np.sqrt(np.trapezoid(np.sum(vector**2, axis=1), times) / 0.2))):
        assert read.error is not None
        assert np.shape(read.value) == np.shape(wanted)
        off = np.linalg.norm(read.value - wanted)
        assert off <= 3 * read.error + 1e-6 * np.linalg.norm(wanted), read
        assert read.error <= 1e-3 * np.linalg.norm(wanted), read
    whole = exact.rms("A.drive")
    assert " +- " in repr(whole)
    assert "N m" in repr(whole)
    assert whole.sensor == "root mean square of A.drive"
    for wrong in ((0.3, 0.1), (0.1,), (0.1, 0.7), "half", (0.1, float("nan"))):
        with pytest.raises(mb.OptionError):
            rigid.peak("A.drive", t=wrong)


def test_a_mean_outlives_the_shock_of_the_start(ringing: mb.Result) -> None:
    """Undamped vibrations that the run leaves out: values, peak and mean square of the drive are told, each once."""
    fresh = pickle.loads(pickle.dumps(ringing))
    told = told_by(lambda: [fresh.rms("A.drive", t=(0.002, 0.008)) for _ in range(2)])
    assert len(told) <= 1
    assert all("in its root mean square from 0.002 to 0.008 s" in note for note in told)


@pytest.mark.parametrize(("value", "error", "shown"), [
    (26.6018, 0.02, "26.60 +- 0.02"), (26.6018123, 3e-7, "26.6018123 +- 3e-07"), (1594.996586, 1e-4, "1594.9966 +- 0.0001"),
    (110.667, 122.0, "111 +- 120"), (4.0, 0.0, "4"),
    (0.001234, 2e-5, "0.00123 +- 2e-05"), (1.0, None, "1"), (31234.5, 12.0, "31230 +- 10"), (0.0, 1e-3, "0.00 +- 0.001"),
])
def test_values_are_printed_with_the_digits_that_their_error_leaves(value: float, error: float | None, shown: str) -> None:
    assert with_error(value, error) == shown
    assert shown in repr(Peak(value, 0.0, "N", "x", error))


def test_peaks_of_many_steps_are_those_of_a_search_in_every_step(monkeypatch: Any) -> None:
    """Of a force that a swing of two rods and short pulses change; and a peak read again is not sought again."""
    s = mb.Scene("rods", gravity=(0, -G, 0))
    upper, lower = s.link("upper", (0, 0), (1, 0), mass=1.0), s.link("lower", (1, 0), (2, 0), mass=1.0)
    s.revolute("A", s.ground, upper, at=(0, 0))
    s.revolute("B", upper, lower, at=(1, 0))
    s.force("pulses", lower, (0, 30 * sp.Piecewise((1, sp.Mod(mb.t, 0.7) < 0.05), (0, True))))
    r = s.simulate(5.0, accuracy=1e-5)
    exact = [largest(r, quantity, 0.0, 5.0) for quantity in ("A.force", "B.force[1]", "lower.acceleration")]
    monkeypatch.setattr("mbdae.results.contacts.MANY", 50)
    assert [largest(r, quantity, 0.0, 5.0) for quantity in ("A.force", "B.force[1]", "lower.acceleration")] == exact
    first = r.peak("A.force")
    monkeypatch.setattr("mbdae.results.contacts.largest", None)
    again = r.peak("A.force")
    assert (again, again.error) == (first, first.error)


def test_a_closer_run_that_ended_early_counts_where_it_lived(rigid: mb.Result) -> None:
    """Up to its end it alone counts, behind it the companion alone; errors do not add."""
    close = four_bar().simulate(0.5, accuracy=1e-9).solution
    companion = rigid.accuracy.errors.others[0]
    short = OtherRun.beside(close, np.linspace(0, 0.3, 61), 1.1, kind="closer")
    errors = Errors(rigid.prepared, rigid.solution, (companion, short), 1e-4)
    late = Errors(rigid.prepared, rigid.solution, (companion.after(0.3),), 1e-4)
    early = Errors(rigid.prepared, rigid.solution, (short,), 1e-4)
    found = errors.of(rigid, "B.force").error
    assert found == pytest.approx(max(late.of(rigid, "B.force").error, early.of(rigid, "B.force").error), rel=1e-12)
    assert found <= Errors(rigid.prepared, rigid.solution, (companion,), 1e-4).of(rigid, "B.force").error * (1 + 1e-12)


def test_a_peak_at_a_damped_stop_is_not_as_uncertain_as_the_time_of_the_impact() -> None:
    """The force jumps where the bar touches the stop, so that values over time differ by all of it; peaks do not: that of the
    run and that of one at 1e-7 agree."""
    s = mb.Scene("bar on a stop", gravity=(0, -G, 0))
    s.revolute("hinge", s.ground, s.link("bar", (0, 0), (0.5, 0), mass=0.3), at=(0, 0), limits=(-0.1, None),
               stop=mb.Stop(stiffness=1e4, damping=10.0))
    found = s.simulate(0.1, accuracy=1e-3).peak("hinge.force")
    exact = s.simulate(0.1, accuracy=1e-7, solver=mb.RadauIIA(5)).peak("hinge.force")
    assert abs(found.value - exact.value) <= 3 * found.error
    assert found.error < 3e-3 * found.value


# ---- telling


def test_a_force_without_its_vibrations_is_told_once_by_name(ringing: mb.Result) -> None:
    """The motion has the accuracy of 1e-3, the pin force is off by tenths: the reader hears it at the first reading, by whatever
    way, and the result says so from then on."""
    exact = elastic().simulate(0.01, solver=mb.RadauIIA(3, rtol=1e-7), form=mb.GGL(waves=True))
    r = pickle.loads(pickle.dumps(ringing))
    assert (r.warnings, r.reliable) == ((), True)
    (note,) = told_by(lambda: r["B"].force)
    assert "B.force has an error of about " in note
    assert " % of its largest value" in note
    assert told_by(lambda: (r["B"].force, r.value("B.force"), r.peak("B.force"), r(0.005)["B"].force)) == []
    assert any("B.force" in one for one in r.warnings)
    times = np.linspace(0, 0.01, 2001)
    error = np.linalg.norm(r(times)["B"].force - exact(times)["B"].force, axis=1).max()
    assert 0.3 * error <= r.error("B.force") <= 3 * error
    assert r.reliable is True  # which speaks of the motion


@pytest.mark.parametrize("read", [
    lambda r: r.peak("C.force"), lambda r: r.value("norm(C.force)"), lambda r: r.read("C.force[0]"),
    lambda r: r["rod"].at(0.5).strain, lambda r: r["rod"].at(0.5).stress_resultants, lambda r: r["block"].acceleration,
    lambda r: r["A"].drive, lambda r: r["A"].power,
    lambda r: r.to_csv("forces.csv", "C.force"), lambda r: r.to_dataframe("C.force"), lambda r: r.plot("C.force"),
    lambda r: r.value(lambda r: r["C"].force),
])
def test_every_way_to_read_a_force_tells(read: Any, ringing: mb.Result, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    r = pickle.loads(pickle.dumps(ringing))
    assert len(told_by(lambda: read(r))) == 1
    assert len(r.warnings) == 1


def test_what_is_within_the_accuracy_is_not_told(rigid: mb.Result, ringing: mb.Result) -> None:
    r = pickle.loads(pickle.dumps(rigid))
    assert told_by(lambda: (r["B"].force, r.peak("A.drive"), r["coupler"].acceleration, r.to_csv("/dev/null"))) == []
    r = pickle.loads(pickle.dumps(ringing))
    assert told_by(lambda: (r["block"].position, r["A"].angle, r.peak("block.position"), r.energy, repr(r))) == []
    assert r.warnings == ()


def test_a_force_that_vanishes_is_not_told() -> None:
    """In a balanced rotor the axis carries rounding errors, of which no digit is right."""
    s = mb.Scene("rotor")
    wheel = s.rigid_body("wheel", 1.0, 0.02, at=(0, 0))
    s.revolute("axis", s.ground, wheel, at=(0, 0), rate0=30.0, damper=0.1)
    r = s.simulate(1.0, accuracy=1e-8)
    assert told_by(lambda: (r["axis"].force, r["axis"].torque, r.peak("axis.force"))) == []


def test_a_closer_run_spares_warnings_that_are_not_needed() -> None:
    """Companions differ by more than the accuracy in the force of an impact, where the peak of the run is right: nobody warns."""
    r, exact = (ball(1.0, mb.Hertz(1e6)).simulate(0.02, accuracy) for accuracy in (1e-4, 1e-7))
    found, right = r.peak("J.force"), exact.peak("J.force").value
    assert found.value == pytest.approx(right, rel=1e-4)
    assert told_by(lambda: r.peak("J.force")) == []


def test_what_contacts_measure_is_judged_by_its_own_size() -> None:
    """A ball sinks into the ground by a thousandth of the height it falls from: that the motion is right to 1e-3 says nothing of
    its penetration, whose warning is not spared by metres being the unit of motion."""
    s = mb.Scene("ball", gravity=(0, -G, 0))
    b = s.point_mass("b", 0.2, at=(0, 0.5))
    s.contact("f", s.ground, b, mb.Plane(at=(0, 0, 0), normal=(0, 1, 0)), mb.Sphere(radius=0.02), normal=mb.Hertz(1e8, 0.2))
    r, exact = (s.simulate(1.0, accuracy, outputs=801) for accuracy in (1e-4, 1e-8))
    sunk, right = (np.maximum(0.0, -one["f"].at_times(one.t)["gap"]) for one in (r, exact))
    assert np.max(np.abs(sunk - right)) > 3e-4 * np.max(right)
    assert len(told_by(lambda: r["f"].penetration)) == 1
    assert len(told_by(lambda: r["f"].gap_rate)) == 1
    assert told_by(lambda: (r["f"].gap, r["f"].slip, r["b"].velocity)) == []  # the gap is as large as the motion


def test_peaks_of_a_released_cantilever_are_told_or_right() -> None:
    """A steel tube released under its own weight: at 1e-3 the run leaves vibrations out that carry a tenth of the moment at its
    root. Right is 10.573 N m, by runs with all vibrations at 1e-6 and 1e-7."""
    s = mb.Scene("cantilever", gravity=(0, -G, 0))
    tube = mb.Section.tube(outer=0.012, inner=0.010, E=210e9, nu=0.3, rho=7850.0)
    s.weld("root", s.ground, s.beam("b", (0, 0), (1, 0), section=tube, elements=3), at=(0, 0))
    r = s.simulate(0.3, accuracy=1e-3)
    for quantity, right in (("root.torque", 10.573), ("root.force", 20.61), ("b.at(0.5).stress_resultants[5]", 3.301)):
        found: list[Peak] = []
        told = told_by(lambda: found.append(r.peak(quantity)))  # noqa: B023 - called at once
        assert found[0].error is not None
        assert (found[0].lacks, repr(found[0])[-32:]) == ("mesh", "s without the error of the mesh>")
        assert abs(found[0].value - right) < 1.5 * found[0].error
        assert len(told) == (found[0].error > 1e-3 * found[0].value)


def test_what_no_other_run_shows_is_told_as_not_known(rigid: mb.Result) -> None:
    r = pickle.loads(pickle.dumps(rigid))

    def own(r: mb.Result) -> Any:
        if r.info is None:  # in runs beside this one
            raise ValueError
        return r["B"].angle

    assert "an error that is not known" in told_by(lambda: r.value(own))[0]


def test_changed_start_velocities_are_told_by_the_run() -> None:
    """A bob on a rod cannot move along it: what was stated is changed, and both the check and the run say so."""
    s = mb.Scene("pendulum", gravity=(0, -G, 0))
    s.revolute("hinge", s.ground, s.rigid_body("rod", 1.0, 0.1, at=(1, 0), velocity=(1.0, 0.5)), at=(0, 0))
    r = s.simulate(0.1)
    assert any("velocity of 'rod' contradicts the joints" in note for note in r.warnings)
    s = mb.Scene("pendulum", gravity=(0, -G, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), rate0=1.0)
    assert s.simulate(0.1).warnings == ()


# ---- kept


def test_a_stored_result_keeps_its_errors_and_what_was_told(ringing: mb.Result, tmp_path: Path) -> None:
    r = pickle.loads(pickle.dumps(ringing))
    _ = r["B"].force
    r.save(tmp_path / "r.npz")
    again = mb.load(tmp_path / "r.npz")
    assert again.warnings == r.warnings
    assert again.error("B.force") == pytest.approx(r.error("B.force"), rel=1e-9)
    assert told_by(lambda: again["B"].force) == []
    assert len(told_by(lambda: again.peak("C.force"))) == 1
    assert again.accuracy.reactions == r.accuracy.reactions


# ---- parts of a run


def shocked() -> mb.Scene:
    """A mass on a stiff, damped spring that starts compressed: a force of 2000 N at the start, its weight after .3 s."""
    s = mb.Scene("shock", gravity=(0, -G, 0))
    b = s.rigid_body("b", 1.0, 0.1, at=(0, 0, 0))
    s.prismatic("P", s.ground, b, at=(0, 0, 0), axis=(0, 1, 0))
    s.spring("S", s.ground, b, at_k=(0, -1, 0), at_l=(0, 0, 0), stiffness=1e5, damping=60.0, length=1.02)
    return s


def test_what_a_part_of_a_run_is_off_is_not_that_of_its_start() -> None:
    """Short runs of HHT show what it leaves out of the start: a later peak does not have the start's size for its error."""
    r = shocked().simulate(0.6, accuracy=1e-3, solver=mb.HHT())
    late = r.peak("S.force", t=(0.4, 0.6))
    assert late.value == pytest.approx(G, rel=0.05)
    assert late.error is not None
    assert abs(late.value - shocked().simulate(0.6, accuracy=1e-8).peak("S.force", t=(0.4, 0.6)).value) <= 3 * late.error <= 3.0


def test_a_mean_has_an_error_where_a_closer_run_ends_just_before_the_run() -> None:
    """CVODE of an elastic rod: the closer run ends .02 % before the run, and one time of the companion is left beyond it."""
    r = slider_crank(2, 2).simulate(0.004, accuracy=1e-2, solver=mb.CVODE())
    for read in (r.mean("A.drive"), r.rms("A.drive"), r.mean("A.drive", t=(0.0036, 0.004)), r.peak("A.drive")):
        assert read.error is not None, read
    assert r.mean("A.drive").error <= r.error("A.drive")


def test_the_rest_beyond_a_closer_run_counts_for_its_duration() -> None:
    t, apart = np.array([9.9, 10.0]), np.array([[3.0], [3.0]])
    assert averaged(t, apart, 9.8, 10.0) == pytest.approx(3.0 * 0.2 / 10)
    assert averaged(t[1:], apart[1:], 9.8, 10.0) == pytest.approx(3.0 * 0.2 / 10)
    assert averaged(t, apart, 9.9, 0.0) == pytest.approx(3.0)


def test_a_mean_near_0_is_judged_over_the_values_it_is_made_of(rigid: mb.Result) -> None:
    """The mean torque of a drive is small beside its swings: its error is relative to these."""
    fresh, part = pickle.loads(pickle.dumps(rigid)), (0.0, 0.5)
    drive = rigid(np.linspace(*part, 2001))["A"].drive
    away = float(np.mean(drive))
    read = fresh.mean(f"A.drive - {away}", t=part)
    assert abs(read.value) < 0.01 * np.max(np.abs(drive))
    assert not [note for note in told_by(lambda: fresh.mean(f"A.drive - {away}", t=part)) if "mean" in note]
    assert read.error <= 1e-4 * np.max(np.abs(drive))


def test_what_is_not_finite_has_no_error_and_says_so(rigid: mb.Result) -> None:
    fresh = pickle.loads(pickle.dumps(rigid))
    told = told_by(lambda: fresh.value("1/(t - 0.25)"))
    assert fresh.error("1/(t - 0.25)") is None
    assert any("1/(t - 0.25) has an error that is not known" in note and "no number at t = 0.25 s" in note for note in told)
