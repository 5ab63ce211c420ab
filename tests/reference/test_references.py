"""Reference problems from the accuracy alone, set to a third of the reference's tolerance, with IDA and Radau IIA."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import a01, andrews, data, dzhanibekov, ground_resonance, heavy_top, n_points, n_rods, physical_pendulum

import mbdae as mb

SOLVERS = [mb.IDA(), mb.RadauIIA(3)]
both = pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.label)


def run(scene: mb.Scene, times: list[float], tolerance: float, solver: object) -> mb.Result:  # type: ignore[name-defined]
    outputs = np.array(times, dtype=float)
    return scene.simulate(float(outputs[-1]), accuracy=tolerance / 3, solver=solver, outputs=outputs)


@both
def test_a01_point_pendulum(solver):
    d = data("iftomm_a01")
    r = run(a01(), d["t"], 1e-8, solver)
    assert np.abs(r["bob"].position[:, :2] - np.c_[d["x"], d["y"]]).max() <= 1e-8


@both
@pytest.mark.parametrize("case", range(6))
def test_physical_pendulum_period(solver, case):
    """At the exact period the rod is back at rest; its remaining rate over its acceleration is the error in time."""
    d = data("physical_pendulum")
    period = d["period_s"][case]
    r = run(physical_pendulum(d["amplitude_deg"][case]), [period / 2, period], 1e-8, solver)
    assert abs(r["A"].rate[-1] / r.acceleration[-1, 2]) / period <= 1e-8


@both
@pytest.mark.parametrize(("n", "space"), [
    (2, "auto"), (5, "auto"), (10, "auto"), (20, "auto"), (2, "spatial"), (5, "spatial"), (10, "spatial"),
])  # fmt: skip
def test_chain_of_rods(solver, n, space):
    e = data("n_pendulum_rods")["results"][str(n)]
    r = run(n_rods(n, space), e["t"], 1e-7, solver)
    theta = np.cumsum([r[f"J{i + 1}"].angle for i in range(n)], axis=0).T + np.pi / 2
    assert np.abs(theta - np.array(e["theta"])).max() <= 1e-7


@pytest.mark.slow
@both
def test_chain_of_twenty_rods_in_space(solver):
    test_chain_of_rods(solver, 20, "spatial")


@both
@pytest.mark.parametrize("n", [2, 3, 5, 10])
def test_chain_of_points(solver, n):
    e = data("n_pendulum_point")["results"][str(n)]
    r = run(n_points(n), e["t"], 1e-7, solver)
    theta = np.array(e["theta"])
    x, y = np.cumsum(np.sin(theta), axis=1), -np.cumsum(np.cos(theta), axis=1)
    for i in range(n):
        assert np.abs(r[f"bob{i + 1}"].position[:, :2] - np.c_[x[:, i], y[:, i]]).max() <= 1e-7


@both
def test_heavy_top(solver):
    d = data("heavy_top")["own"]
    r = run(heavy_top(), d["t"], 1e-6, solver)
    assert np.abs(r["top"].position - np.array(d["x"])).max() <= 1e-6
    assert np.abs(r["top"].rotation.reshape(-1, 9) - np.array(d["R"])).max() <= 1e-5


@both
def test_dzhanibekov(solver):
    d = data("dzhanibekov")
    r = run(dzhanibekov(), d["t"], 1e-6, solver)
    assert np.abs(r["body"].rotation.reshape(-1, 9) - np.array(d["R"])).max() <= 1e-6
    assert np.abs(r.u[:, 3:] - np.array(d["omega"])).max() <= 1e-6
    momentum = np.einsum("tij,tj->ti", r["body"].rotation, r.u[:, 3:] * np.array([1.0, 2.0, 3.0]))
    assert np.abs(momentum - momentum[0]).max() <= 1e-6


@both
def test_andrews_squeezer(solver):
    d = data("andrews_squeezer")["own"]
    r = run(andrews(), [0.0, 0.03], 1e-8, solver)
    q = np.array(d["q"])
    absolute = np.array([q[0], q[0] + q[1], q[2], q[3] + q[4], q[4], q[5] + q[6], q[6]])
    heading = r.q[-1, 2::3]
    assert np.abs((heading - absolute) / absolute).max() <= 1e-8
    closing = np.concatenate([r[name].force[-1, :2] for name in ("P3", "P4", "P6")])
    assert np.abs(closing - np.array(d["lam"])).max() <= 1e-5 * np.abs(d["lam"]).max()


@both
@pytest.mark.parametrize("case", ["A1_prescribed_1axis", "A2_prescribed_2axis_iso", "B1_free_1axis", "B2_free_2axis_iso"])
def test_ground_resonance(solver, case):
    e = data("ground_resonance")["nonlinear"][case]
    axes, keep = e["settings"]["axes"], np.array(e["t"]) <= 2.0
    r = run(ground_resonance(axes, e["settings"]["free"]), np.array(e["t"])[keep], 1e-6, solver)
    lag = np.array([r[f"lag{i + 1}"].angle for i in range(4)]).T
    assert np.abs(lag - np.array(e["lag_angles"])[keep]).max() <= 1e-6
    assert np.abs(r["block"].position[:, :axes] - np.array(e["hub"])[keep]).max() <= 1e-6
    assert np.abs(r["rotor"].rate - np.array(e["rotor_speed"])[keep]).max() <= 1e-5
