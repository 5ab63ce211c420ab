"""What a missed accuracy says of a smaller one, and what `reliable` says, against what the runs of the scene show."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.run.assessment import _advice
from mbdae.run.estimate import Controlled


@pytest.fixture(autouse=True)
def quiet() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        yield


def double_pendulum() -> mb.Scene:
    """Two rods released from the horizontal: from some 15 s on rounding errors grow to the size of the motion."""
    s = mb.Scene("double pendulum", gravity=(0, -9.81, 0))
    upper, lower = s.link("upper", (0, 0), (1, 0), mass=1.0), s.link("lower", (1, 0), (2, 0), mass=1.0)
    s.revolute("A", s.ground, upper, at=(0, 0))
    s.revolute("B", upper, lower, at=(1, 0))
    return s


def test_where_round_off_limits_a_smaller_accuracy_is_the_same_run_and_the_warning_says_so() -> None:
    r = double_pendulum().simulate(15.0, accuracy=1e-6, solver="ida", outputs=3)
    assert "is the smallest that round-off allows IDA, so that a smaller accuracy ends with the same run" in r.warnings[0]
    again = double_pendulum().simulate(15.0, accuracy=1e-7, solver="ida", outputs=3)
    assert np.array_equal(again["B"].angle, r["B"].angle)


@pytest.mark.parametrize(("told", "limit", "error", "words"), [
    (((1e-6, 1e-2), (1e-7, 1e-3)), 1e-13, 1e-3, "so that accuracy=1e-05 comes nearer"),
    (((1e-6, 0.1), (1e-7, 0.08)), 1e-13, 0.08, "with rtol = 1e-06 the error was 1.0e-01, with rtol = 1e-07 8.0e-02: a smaller "
                                               "accuracy comes no nearer where the motion is chaotic"),
    (((1e-6, 1e-3), (1e-7, 8e-4)), 1e-13, 8e-4, "it is not known whether a smaller accuracy comes nearer"),
    (((1e-6, 1e-2), (1e-7, 1e-3)), 1e-7, 1e-3, "the smallest that round-off allows"),
    (((1e-6, 1e-2), (1e-7, 1e-6)), 1e-13, 1e-3, "alone differ by 1.0e-06, the larger error is what another method or shorter "
                                                "steps show"),
    (((1e-6, 1e-3),), 1e-13, 1e-3, "estimated once"), ((), 1e-13, 1e-3, "no two runs that can be compared"),
    (((1e-6, np.inf),), 1e-13, np.inf, "no two runs that can be compared"),
])
def test_a_smaller_accuracy_is_advised_only_where_the_estimate_fell(told: Any, limit: float, error: float, words: str) -> None:
    run = Controlled(None, mb.IDA(), error, 2, 0.0, told=told, limit=limit)  # type: ignore[arg-type]
    said = _advice(error, 1e-4, run)
    assert words in said
    assert ("comes nearer" in said and "accuracy=" in said) == ("accuracy=1e-05 comes nearer" in words)


def test_reliable_agrees_with_the_accuracy_beside_it() -> None:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    met, own = s.simulate(0.5, outputs=3), s.simulate(0.5, solver=mb.RadauIIA(3, rtol=1e-6), outputs=3)
    missed = double_pendulum().simulate(15.0, accuracy=1e-6, solver="ida", outputs=3)
    assert [(r.reliable, r.accuracy.met, "motion" in r.accuracy.covers) for r in (met, own, missed)] == [
        (True, True, True), (None, None, False), (False, False, False)]
    assert ["not reliable" in repr(r) for r in (met, own, missed)] == [False, False, True]
    vars(met)["info"] = replace(met.info, reliable=False)  # as after an alarm of the energy balance
    assert met.reliable is False
    assert "not reliable" in repr(met)


def test_a_default_run_is_repeated_for_forces_that_are_stiffer_than_the_motion() -> None:
    """At a tight accuracy, where the method is not the user's; the forces of the repeated run are nearer."""
    def ball() -> mb.Scene:
        s = mb.Scene("ball on a stiff spring", gravity=(0, -9.81))
        s.spring("S", s.ground, s.rigid_body("ball", 1.0, 0.1, at=(1, 0)), (0, 0), (1, 0), stiffness=1e4)
        return s

    t = np.linspace(0, 1, 401)
    exact = ball().simulate(1.0, accuracy=1e-10)(t)["S"].force
    runs = [ball().simulate(1.0, accuracy=a, solver=solver) for a, solver in ((1e-6, None), (1e-6, mb.DOP853()), (1e-4, None))]
    assert [r.info.runs for r in runs] == [3, 2, 2]
    off = [float(np.max(np.abs(r(t)["S"].force - exact))) for r in runs]
    assert off[0] < 0.7 * off[1] < off[2]
    assert off[0] <= 1e-6 * np.max(np.abs(exact))
