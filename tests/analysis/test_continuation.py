"""Branches: Duffing's folds, Mathieu's tongues and ground resonance against SciPy, loads of columns, refusals."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve
from scipy.special import mathieu_a, mathieu_b

import mbdae as mb

LOSS, LOAD = 0.1, 0.3


def slider(stiffness: Any) -> tuple[mb.Scene, Any]:
    s = mb.Scene("slider")
    m = s.point_mass("m", 1.0, (0, 0))
    s.prismatic("J", s.ground, m, at=(0, 0), axis=(1, 0))
    s.spring("k", s.ground, m, at_k=(-1, 0), at_l=(0, 0), stiffness=stiffness, length=1.0)
    return s, m


def duffing() -> mb.Scene:
    w = mb.number("w", 1.2)
    s = mb.Scene("duffing")
    m = s.point_mass("m", 1.0, (0, 0))
    s.prismatic("J", s.ground, m, at=(0, 0), axis=(1, 0), damper=LOSS)
    x = s.sensor("J.displacement")
    s.force("F", m, (-x - x**3 + LOAD * sp.cos(w * mb.t), 0))
    return s


def singular(z: Any) -> Any:
    """Return of Duffing's equation, and the determinant that vanishes at a fold; z: x, v, w."""
    def rhs(t: float, y: Any) -> Any:
        A = np.array([[0, 1], [-1 - 3 * y[0] ** 2, -LOSS]])
        force = LOAD * np.cos(z[2] * t)
        return np.r_[y[1], -y[0] - y[0] ** 3 - LOSS * y[1] + force, (A @ y[2:].reshape(2, 2)).ravel()]

    y = solve_ivp(rhs, (0, 2 * np.pi / z[2]), np.r_[z[:2], 1, 0, 0, 1], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return [y[0] - z[0], y[1] - z[1], np.linalg.det(y[2:].reshape(2, 2) - np.eye(2))]


@pytest.mark.slow
def test_folds_of_duffing_against_scipy() -> None:
    s = duffing()
    branch = s.continuation("w", (0.9, 2.0), of=s.periodic(2 * sp.pi / mb.number("w", 1.2)))
    assert len(branch.folds) == 2
    for fold in branch.folds:
        near = branch.result(int(np.argmin(np.abs(branch.values - fold.value))))
        z = fsolve(singular, [near["m"].position[0, 0], near["m"].velocity[0, 0], fold.value], xtol=1e-12)
        assert abs(fold.value - z[2]) <= 3 * fold.error <= 1e-7
        assert abs(fold.root - 1) < 1e-4
    assert {True, False} == set(branch.stable)
    assert branch.peaks("m.position").max() > 1.5
    assert list(branch.to_dataframe().columns) == ["w", "period", "stable"]
    assert ", planar" in repr(branch)
    assert (branch.values[0], branch.values[-1]) == (pytest.approx(0.9), pytest.approx(2.0))


def test_tongues_of_mathieu() -> None:
    """x'' + (a - 2 q cos 2 t) x = 0 with q = 0.2: its characteristic values."""
    s, _ = slider(mb.number("a", 1.15) - 0.4 * sp.cos(2 * mb.t))
    branch = s.continuation("a", (1.1, 1.3), of=s.periodic(np.pi))
    (found,) = branch.doublings
    assert abs(found.value - mathieu_a(1, 0.2)) <= 3 * found.error <= 1e-9
    assert not branch.stable[0]
    assert branch.stable[-1]
    assert mathieu_b(1, 0.2) < 1.1


@pytest.mark.slow
def test_load_of_euler_within_the_error_of_the_mesh() -> None:
    s = mb.Scene("column")
    column = s.beam("c", (0, 0), (1, 0), section=mb.Section.rectangular(0.01, 0.01, E=12e8, nu=0.3, rho=1e4), elements=2)
    s.weld("w", s.ground, column, at=(0, 0))
    s.force("F", column, (-mb.number("P", 2.2), 0), at=(1, 0))
    branch = s.continuation("P", (2.1, 2.8))
    (found,) = branch.branchings
    assert 1e-4 < abs(found.value - np.pi**2 / 4) <= 2 * branch.mesh_error[0]


@pytest.mark.slow
def test_load_of_beck_within_the_error_of_the_mesh() -> None:
    """A clamped column under a force that stays along its tip flutters from 20.0510 EI / L^2 on (Beck 1952)."""
    s = mb.Scene("column")
    section = mb.Section(EA=1e5, GA2=1e5, GA3=1e5, GJ=1.0, EI2=1.0, EI3=1.0, mass_per_length=1.0, rotary_inertia=1e-6)
    column = s.beam("c", (0, 0), (1, 0), section=section, elements=3, order=3)
    s.weld("w", s.ground, column, at=(0, 0))
    s.force("F", column, (-mb.number("P", 20.02), 0), at=(1, 0), frame="body")
    branch = s.continuation("P", (20.02, 20.1))
    (found,) = branch.hopf
    assert 1e-4 < abs(found.value - 20.0510) <= 2 * branch.mesh_error[0]
    assert abs(found.value - 20.0510) <= 1e-3 * 20.0510


def test_load_of_a_column_of_rigid_links_has_the_error_that_is_told() -> None:
    """Its buckling load is the least eigenvalue of the stiffness in the angles of the links to the ground."""
    s, k = mb.Scene("rigid column"), 1.0 + 0.3 * np.arange(3)
    last: Any = s.ground
    for i in range(3):
        link = s.rigid_body(f"b{i}", 1.0, 0.1, at=(i + 0.5, 0))
        s.revolute(f"J{i}", last, link, at=(i, 0), spring=float(k[i]), damper=0.1)
        last = link
    s.force("F", last, (-mb.number("P", 0.1), 0), at=(3, 0))
    (found,) = s.continuation("P", (0.1, 0.9)).branchings
    load = np.linalg.eigvalsh(np.diag(k) + np.diag([*k[1:], 0.0]) - np.diag(k[1:], 1) - np.diag(k[1:], -1))[0]
    assert abs(found.value - load) <= 3 * found.error <= 1e-11


def rotor_growth(example: Any, speed: float, damper: float) -> float:
    """Largest growth rate (1/s) of the rotor on springs in multiblade coordinates: z = x + i y of the hub, and the sum of the lag
    angles times the directions of their blades."""
    N, L, m = example.BLADES, example.L, example.M
    J, S = m * L**2 / 3, m * L / 2
    M = np.array([[example.BLOCK + N * m, 1j * S], [S * N / 2j, J]])
    C = np.diag([example.DAMPING, damper - 2j * speed * J])
    K = np.diag([example.STIFFNESS, speed**2 * (S * example.HINGE - J) - 1j * speed * damper])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    return float(np.linalg.eigvals(A).real.max())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["speed", "damper"])
def test_boundary_of_ground_resonance_against_scipy(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The rotor of the example: where its turning begins to shake the block, over its speed and over its lag dampers."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "examples"))
    example = importlib.import_module("ground_resonance_map")
    speed, damper = mb.number("speed", 24.0), mb.number("damper", 3500.0)
    if name == "speed":
        s, period, over = example.scene(speed, (2000.0,) * 4), 2 * sp.pi / speed, (20.0, 25.0)
        exact = brentq(lambda w: rotor_growth(example, w, 2000.0), *over, xtol=1e-12, rtol=1e-13)
    else:
        s, period, over = example.scene(18.0, (damper,) * 4), 2 * np.pi / 18.0, (2500.0, 4000.0)
        exact = brentq(lambda c: rotor_growth(example, 18.0, c), *over, xtol=1e-10, rtol=1e-13)
    s = s.recursive()
    (found,) = s.continuation(name, over, of=s.periodic(period)).hopf
    assert abs(found.value - exact) <= 3 * found.error <= 1e-6 * exact


@pytest.mark.parametrize(("options", "words"), [
    ({"name": "w", "over": (2.0, 3.0)}, "does not contain w = 1.2"), ({"name": "w", "over": (2.0, 1.0)}, "not a smaller"),
    ({"name": "w", "over": 1.0}, "no pair"), ({"name": "v", "over": (0.0, 1.0)}, "v"),
    ({"name": "w", "over": (1, 2), "of": 3}, "of = 3"),
])
def test_what_cannot_be_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(mb.MbdaeError, match=words):
        duffing().continuation(**options)


def ziegler(damper: float) -> mb.Scene:
    """Two light links with 2 kg and 1 kg at 1 m and 2 m, springs of 1 N m/rad, and a force along the outer link."""
    s = mb.Scene("ziegler")
    a, b = s.rigid_body("a", 2.0, 1e-13, at=(1, 0)), s.rigid_body("b", 1.0, 1e-13, at=(2, 0))
    s.revolute("A", s.ground, a, at=(0, 0), spring=1.0, damper=damper)
    s.revolute("B", a, b, at=(1, 0), spring=1.0, damper=damper)
    s.force("F", b, (-mb.number("P", 1.4), 0), at=(2, 0), frame="body")
    return s


@pytest.mark.parametrize(("damper", "over", "load"), [
    (0.1, (1.3, 1.6), 41 / 28 + 0.1**2 / 2),  # Routh-Hurwitz
    pytest.param(0.0, (1.0, 2.5), 3.5 - 2**0.5, marks=pytest.mark.slow),  # two frequencies meet
])
def test_flutter_of_two_links(damper: float, over: tuple[float, float], load: float) -> None:
    branch = ziegler(damper).continuation("P", over)
    (found,) = branch.hopf
    assert abs(found.value - load) <= 3 * found.error
    assert branch.stable[0]
    assert not branch.stable[-1]
    assert abs(found.root.real) < 1e-4
    assert branch.mesh_error == [0.0]


@pytest.mark.parametrize(("growth", "stable"), [(0.1, False), (-0.1, True)])
def test_motions_faster_than_the_steps_count_in_branches(growth: float, stable: bool) -> None:
    s = mb.Scene("excited")
    a, b = (s.rigid_body(name, 1.0, 1.0, at=(0, 0)) for name in "AB")
    s.revolute("JA", s.ground, a, at=(0, 0), spring=mb.number("k", 1.0), damper=0.1, torque=sp.cos(mb.t))
    s.revolute("JB", a, b, at=(0, 0), spring=1e6, torque=growth * s.sensor("JB.rate"))
    branch = s.continuation("k", (0.99, 1.01), of=s.periodic(2 * np.pi))
    assert [one is stable for one in branch.stable] == [True] * len(branch)
