"""What `simulate` promises beside accuracy: choices, continuation, interruption, partial results."""

from __future__ import annotations

import os
import signal
import threading
import time

import numpy as np
import pytest

import mbdae as mb
from mbdae.errors import WallClockError


def pendulum() -> mb.Scene:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("A", s.ground, rod, at=(0, 0))
    return s


def test_a_run_continues_another() -> None:
    whole = pendulum().simulate(2.0, accuracy=1e-8)
    first = pendulum().simulate(1.0, accuracy=1e-8)
    second = pendulum().simulate(2.0, accuracy=1e-8, start=first)
    assert second.t[0] == 1.0
    assert abs(second["A"].angle[-1] - whole["A"].angle[-1]) < 1e-7


def test_reaction_at_the_start() -> None:
    """A rod released horizontally: its hinge carries a quarter of the weight."""
    r = pendulum().simulate(0.1)
    np.testing.assert_allclose(r["A"].force[0], [0, 9.81 / 4, 0], atol=1e-9)


def test_verify_measures_with_another_method() -> None:
    r = pendulum().simulate(1.0, accuracy=1e-6, verify=True)
    assert r.accuracy.verified is not None
    assert r.accuracy.verified <= 1e-6
    assert r.accuracy.met


def test_explicit_tolerance_runs_once_without_a_claim() -> None:
    r = pendulum().simulate(1.0, solver=mb.IDA(rtol=1e-7))
    assert r.info.runs == 1
    assert r.accuracy.asked is None
    assert r.accuracy.met is None


def test_wall_clock_keeps_what_was_computed() -> None:
    pendulum().simulate(0.01)  # what a process imports and compiles at its first call counts too, and may take as long
    with pytest.raises(WallClockError, match=r"max_wall = 0\.2 s") as caught:
        pendulum().simulate(1e5, max_wall=0.2)
    assert caught.value.solution["A"].angle.size > 0
    assert caught.value.time > 0


def test_wall_clock_holds_for_all_runs_of_an_accuracy() -> None:
    """The companion ends in time, the run itself does not: no further run begins, the complete one is attached."""
    s, end = pendulum(), 40.0
    s.simulate(0.1)
    loose = mb.IDA().at_accuracy(1e-8, "GGL")
    begin = time.perf_counter()
    s.simulate(end, solver=mb.IDA(rtol=30 * loose.rtol))
    companion = time.perf_counter() - begin
    begin = time.perf_counter()
    with pytest.raises(WallClockError, match="used up") as caught:
        s.simulate(end, accuracy=1e-8, solver=mb.IDA(), max_wall=1.3 * companion)
    assert time.perf_counter() - begin < 3 * companion + 1
    assert caught.value.solution["A"].angle.size > 0


def test_ctrl_c_keeps_what_was_computed() -> None:
    pendulum().simulate(0.1)  # compiled and imported before the clock runs
    timer = threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    begin = time.perf_counter()
    with pytest.raises(KeyboardInterrupt, match=r"interrupted at t = .* s of 100000 s: .*attribute `solution`") as stop:
        pendulum().simulate(1e5)
    assert time.perf_counter() - begin < 20
    r = stop.value.solution  # type: ignore[attr-defined]
    assert isinstance(r, mb.api.Result)
    assert not r.complete
    assert r.info.runs == 1
    assert 0 < r.solution.t[-1] < 1e5
    assert np.isfinite(r["A"].angle).all()


def test_energy_of_a_damped_driven_linkage_balances() -> None:
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    crank = s.link("crank", (0, 0), (0, 0.3), mass=0.3)
    coupler = s.link("coupler", (0, 0.3), (0.5, 0.6), mass=0.4)
    rocker = s.link("rocker", (0.5, 0.6), (0.6, 0), mass=0.5)
    s.revolute("A", s.ground, crank, at=(0, 0), angle=6.0 * mb.t)
    s.revolute("B", crank, coupler, at=(0, 0.3), damper=0.05)
    s.revolute("C", coupler, rocker, at=(0.5, 0.6), spring=2.0, damper=0.01)
    s.revolute("D", rocker, s.ground, at=(0.6, 0))
    r = s.simulate(1.0, accuracy=1e-8)
    size = np.abs(r.energy.work).max()
    assert size > 1.0
    assert np.abs(r.energy.balance).max() <= 1e-6 * size
    assert (np.diff(r.energy.dissipated) >= 0).all()
    power = r["A"].torque[:, 2] * r["A"].rate  # the drive against the ground: torque times rate
    np.testing.assert_allclose(power, r["A"].power, rtol=1e-6, atol=1e-6 * np.abs(power).max())
