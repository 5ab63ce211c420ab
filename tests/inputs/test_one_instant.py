"""Instants that differ by round-off are one: no stretch and no step is as short as that."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import mbdae as mb
from mbdae.inputs import timed
from mbdae.inputs.breaks import distinct
from mbdae.inputs.resolution import resolved

BIT = 3 * 0.05  #: 0.15 and one bit
assert BIT != 0.15
TENT = mb.table([0, 0.05, 0.1, 0.15, 0.3], [0, 1, 0, 1, 0])
INPUTS = {
    "break and kink": sp.Piecewise((0, mb.t < BIT), (1, True)) + TENT,
    "kinks of two tables": mb.table([0, 0.05, 0.1, BIT, 0.3], [0, 1, 0, 1, 0]) + TENT,
    "a periodic table": mb.table([0, 0.1, 0.3], [0, 1, 0]) + mb.table([0, 0.05, 0.1], [0, 1, 0], outside="periodic"),
    "break and sample": 3 * sp.sin(20 * mb.t) * sp.Piecewise((0, mb.t < 0.15), (1, True)),
}
WAYS = {"by default": {}, "RadauIIA": {"solver": "radau3"}, "DOP853": {"solver": "dop853", "form": "index1"},
        "generalised alpha": {"solver": mb.GeneralizedAlpha()}, "HHT": {"solver": mb.HHT()},
        "IDA": {"solver": "ida"}}


def test_distinct():
    np.testing.assert_array_equal(distinct(np.array([0.15, 0.0, BIT, 0.5, 0.15])), [0.0, 0.15, 0.5])
    np.testing.assert_array_equal(distinct(np.array([0.0, 0.3, np.nextafter(0.5, 0), 0.5])), [0.0, 0.3, 0.5])
    assert distinct(np.zeros(0)).size == 0


@pytest.mark.parametrize("name", INPUTS)
def test_stretches_and_kinks(name):
    edges, found = resolved((timed.expression(INPUTS[name]),), 0.0, 0.5)
    for times in (edges, found.edges, found.kinks):
        assert np.min(np.diff(times), initial=1.0) > 1e-3


class Holding:
    def __call__(self, t, angle, rate):
        return 20 * (0.3 - angle) - 0.5 * rate


def swing(value, sampled):
    s = mb.Scene("swing", gravity=(0, -9.81, 0))
    s.link("rod", (0, 0), (1, 0), mass=1)
    if sampled:
        s.controller("hold", f=Holding(), every=0.05, reads=("J.angle", "J.rate"), sets=("u",))
    s.revolute("J", s.ground, "rod", at=(0, 0), torque="u" if sampled else None)
    s.torque("M", "rod", (0, 0, value))
    return s


@pytest.mark.parametrize(("sampled", "name", "way"), [
    pytest.param(sampled, name, way, id=f"{name}, {way}{', sampled' * sampled}",
                 marks=[pytest.mark.slow] * ((i + k + sampled) % 2))
    for sampled in (False, True) for i, name in enumerate(INPUTS) for k, way in enumerate(WAYS)])
def test_runs(name, way, sampled):
    scene = swing(INPUTS[name], sampled)
    r = scene.simulate(0.5, 1e-4, max_wall=20, **WAYS[way])
    assert r.accuracy.met
    assert not r.warnings
    exact = scene.simulate(0.5, 1e-8)
    times = np.linspace(0, 0.5, 101)
    assert np.max(np.abs(r(times)["J"].angle - exact(times)["J"].angle)) < 3e-4
    if "lpha" in way or way == "HHT":
        assert np.min(np.diff(r.solution.t)) > 1e-5  # steps end at kinks instead of creeping up to them


@pytest.mark.parametrize("solver", ["radau3", "dop853", mb.GeneralizedAlpha()], ids=str)
def test_samples_of_a_late_run(solver):
    """At 1e5 s a time has a round-off of 1.5e-11 s, more than a billionth of a period of 0.01 s."""
    still = mb.Scene("still")
    still.revolute("J", still.ground, still.link("rod", (0, 0), (1, 0), mass=1), at=(0, 0))
    start = still.simulate(1e5, 1e-4, outputs=2)
    s = mb.Scene("late")
    s.link("rod", (0, 0), (1, 0), mass=1)
    s.controller("hold", f=Holding(), every=0.01, reads=("J.angle", "J.rate"), sets=("u",))
    s.revolute("J", s.ground, "rod", at=(0, 0), torque="u")
    s.torque("M", "rod", (0, 0, sp.Heaviside(mb.t - float(np.nextafter(1e5 + 0.02, np.inf)))))
    r = s.simulate(1e5 + 0.05, 1e-4, start=start, solver=solver, max_wall=20)
    assert r.accuracy.met
    assert np.min(np.diff(r.solution.t)) > 1e-6


def test_steps_end_at_kinks_beside_a_sampled_controller():
    """Also where a smaller share of the intervals between two samples bounds the steps."""
    system = swing(mb.table([0, 0.0813, 0.1271, 0.3], [0, 1, 0, 1]), sampled=True).system()
    times = mb.RadauIIA(3, rtol=1e-4).solve(system, 0.3, share=0.9).t
    for kink in (0.0813, 0.1271):
        assert np.min(np.abs(times - kink)) < 1e-12
