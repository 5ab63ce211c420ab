"""Curves over sensors, and parameters that are functions of time and sensors: values, slopes, balances, refusals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from curves.check import judge

import mbdae as mb

X, Y = [-0.4, -0.1, 0.0, 0.15, 0.5], [-30.0, -5.0, 0.0, 10.0, 60.0]


def slider(value: Any = None, **options: Any) -> Any:
    """A mass of 2 kg on a guide along x, moving at 2.2 m/s, pushed by a force, on a spring of 1 m drawn at 1.3 m."""
    s = mb.Scene(gravity=(0, 0, 0))
    b = s.rigid_body("b", 2.0, (0.1, 0.1, 0.1), at=(1.3, 0, 0))
    s.prismatic("P", s.ground, b, (1.3, 0, 0), (1, 0, 0), rate0=2.2 * bool(options), force=value)
    if options:
        s.spring("S", s.ground, b, (0, 0, 0), (1.3, 0, 0), **{"stiffness": 100.0, **options})
    return s


POSITION = mb.Scene().sensor("P.displacement")


def test_runs_against_scipy() -> None:
    rows = judge(range(0, 12, 4))
    assert all(row.error <= row.tolerance for row in rows if row.tolerance is not None), rows


def test_slope_of_the_equations() -> None:
    """5 N hold the mass where the curve is 5 N, at 0.075 m; there it swings by the slope of the curve, 10/0.15 N/m."""
    s = slider(5 - mb.curve(X, Y)(POSITION))
    rest = s.equilibrium()
    assert rest.read("P.displacement")[0] == pytest.approx(0.075, abs=1e-12)
    assert s.linearize(at=rest).eigenvalues[0].imag == pytest.approx((10 / 0.15 / 2) ** 0.5, rel=1e-12)


@pytest.mark.parametrize("option", [
    {"stiffness": 100 + 20 * sp.sin(9 * mb.t)}, {"length": 1 + 0.2 * sp.sin(7 * mb.t)}, {"damping": mb.table([0, 1], [0, 5])},
    {"stiffness": mb.curve([-1, 0, 1], [80, 100, 300])(POSITION)}, {"length": 1 + 0.2 * sp.atan2(POSITION, 2)},
])
def test_energy_balance(option: dict[str, Any]) -> None:
    """What a changing parameter brings in is work: the balance closes at every output."""
    r = slider(**option).simulate(1.0, accuracy=1e-8)
    e = r.energy
    balance = e.kinetic + e.potential + e.dissipated - e.work
    assert np.ptp(balance) < 1e-7 * np.max(e.kinetic)
    brings_in = "damping" not in option
    assert (np.ptp(e.work) > 1e-3) == brings_in


def test_work_of_a_stiffness_in_time() -> None:
    """A mass that is held at an elongation of 0.3 m: the stiffness that rises by 50 N/m brings in 50 * 0.3^2 / 2 J."""
    s = mb.Scene(gravity=(0, 0, 0))
    b = s.rigid_body("b", 2.0, (0.1, 0.1, 0.1), at=(1.3, 0, 0))
    s.prismatic("P", s.ground, b, (1.3, 0, 0), (1, 0, 0), position=0.0)
    s.spring("S", s.ground, b, (0, 0, 0), (1.3, 0, 0), stiffness=100 + 50 * mb.t, length=1.0)
    assert np.diff(s.simulate(1.0).energy.work[[0, -1]])[0] == pytest.approx(2.25, rel=1e-6)


def test_joint_springs_and_bushings_take_expressions() -> None:
    """A joint's spring and a bushing with the same stiffness in time make the same motion."""
    k = 60 + 20 * sp.sin(3 * mb.t)
    found = []
    for joint in (True, False):
        s = mb.Scene(gravity=(0, 0, 0))
        b = s.rigid_body("b", 2.0, (0.1, 0.1, 0.1), at=(0, 0, 0))
        s.prismatic("P", s.ground, b, (0, 0, 0), (1, 0, 0), rate0=1.0, **({"spring": k, "damper": 0.5 + mb.t} if joint else {}))
        if not joint:
            s.bushing("B", s.ground, b, (0, 0, 0), (k, 1, 1), (0.5 + mb.t, 0, 0))
        found.append(s.simulate(1.0, accuracy=1e-8).read("P.displacement"))
    assert found[0] == pytest.approx(found[1], abs=1e-8)


def test_angles_of_sensors_jump_where_they_do() -> None:
    """The angle of a turning body by atan2 of its axes is its angle less whole turns."""
    s = mb.Scene(gravity=(0, 0, 0))
    b = s.rigid_body("b", 1.0, (0.1, 0.1, 0.1), at=(0, 0, 0))
    s.revolute("A", s.ground, b, (0, 0, 0), rate0=4.0)
    angle = sp.atan2(s.sensor("b.rotation[1, 0]"), s.sensor("b.rotation[0, 0]"))
    s.state("sum", rate=angle)
    r = s.simulate(2.0, accuracy=1e-8)
    first = np.pi / 4  # s, of the half turn; the integral over a whole turn is 0
    t = np.mod(r.t + first, 2 * first) - first
    assert r["sum"] == pytest.approx(2 * t**2, abs=1e-6)


def test_a_run_that_leaves_a_curve_ends_there() -> None:
    s = slider(stiffness=20 + mb.curve(X, Y, outside="error")(POSITION))
    with pytest.raises(mb.SolverError, match=r"spring 'S' reads its curve over P.displacement beyond the points from "
                                             r"-0.4 to 0.5, from t = 0\.\d+ s on; give it more points") as caught:
        s.simulate(2.0)
    assert caught.value.solution.read("P.displacement")[-1] == pytest.approx(-0.4, abs=1e-9)
    assert s.simulate(0.2).t[-1] == 0.2


def test_curves_in_conditions_and_files(tmp_path: Path) -> None:
    curve = mb.curve(X, Y)
    r = slider(stiffness=100 + curve(POSITION)).simulate(1.0, until=curve(POSITION) > 3)
    assert r.read("P.displacement")[-1] == pytest.approx(0.045, abs=1e-9)
    r.save(tmp_path / "run")
    assert np.array_equal(mb.load(tmp_path / "run").energy.work, r.energy.work)


def test_a_curve_of_a_curve() -> None:
    """Its force is the outer curve at what the inner one reads, 10 + 3 x, in the equations and in the result."""
    inner, outer = mb.curve([-1, 1], [7.0, 13.0]), mb.curve([0, 10, 20], [0.0, 1.0, 5.0])
    r = slider(-outer(inner(POSITION) + sp.sin(mb.t)), stiffness=1.0).simulate(0.5)
    at = 10 + 3 * r.read("P.displacement") + np.sin(r.t)
    assert r.read("P.drive") == pytest.approx(-np.interp(at, [0, 10, 20], [0, 1, 5]), abs=1e-9)


def test_numbers_and_paths() -> None:
    curve = mb.curve(X, Y)
    assert curve(0.075) == 5.0
    assert curve(2) == 60.0
    assert curve("P.displacement") == curve(POSITION)


BAD = [
    (lambda: mb.curve([1, 0], [1, 2]), r"mb.curve: x\[0\] = 1.0 and x\[1\] = 0.0 are not in rising order"),
    (lambda: mb.curve([0, 1], [1, 2, 3]), "2 numbers x and 3 numbers y: give one value for every x"),
    (lambda: mb.curve(np.arange(2000), np.arange(2000)), "2000 points are more than the 200"),
    (lambda: mb.curve(X, Y)([1, 2]), r"not at \[1, 2\]"),
    (lambda: mb.curve(X, Y, outside="periodic"), "append the first value, a period after its x"),
    (lambda: slider(mb.curve(X, Y)(sp.Symbol("z"))).check(), "contains the symbol z"),
    (lambda: slider(damping=-1.0, stiffness="P.displacement").check(), "damping = -1 N s/m is negative: it would feed energy"),
    (lambda: driven(mb.curve([-1, 0.5, 1], [0, 1, 0])(sp.sin(mb.t))).simulate(1.0), "its rate jumps by"),
    (lambda: driven(mb.curve(X, Y, "cubic")("P.displacement")).check(), "it may depend on the time mb.t alone"),
]


def driven(value: Any) -> Any:
    """A mass on a guide whose position is prescribed."""
    s = mb.Scene(gravity=(0, 0, 0))
    s.prismatic("P", s.ground, s.rigid_body("b", 1.0, (1, 1, 1), at=(0, 0, 0)), (0, 0, 0), (1, 0, 0), position=value)
    return s


@pytest.mark.parametrize(("statement", "words"), BAD)
def test_mistakes_are_named(statement: Any, words: str) -> None:
    with pytest.raises(mb.MbdaeError, match=words):
        statement()
