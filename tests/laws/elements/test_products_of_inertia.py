"""Bodies with products of inertia: Euler's equations with the whole matrix, reactions of joints that hold an axis."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbdae as mb

J = np.array([[0.30, 0.05, -0.08], [0.05, 0.50, 0.11], [-0.08, 0.11, 0.60]])  # kg m^2, about the centre in body axes
G = 9.81
TURN = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])  # body axes as drawn, columns


def euler(t: float, y: np.ndarray) -> np.ndarray:
    """J Omega' + Omega x J Omega = 0 in body axes, R' = R [Omega x]."""
    w, R = y[:3], y[3:].reshape(3, 3)
    return np.r_[np.linalg.solve(J, -np.cross(w, J @ w)), np.cross(R, w).ravel()]


def test_free_tumbling() -> None:
    """Against SciPy in rotation matrices: nothing in common with quaternions and a mass matrix."""
    start = TURN @ [1.0, 4.0, -2.0]
    s = mb.Scene("tumbling")
    s.rigid_body("body", 2.0, J, at=(0, 0, 0), rotation=TURN, angular_velocity=start)
    t = np.linspace(0, 3, 31)
    r = s.simulate(3.0, accuracy=1e-7, outputs=t)["body"]
    reference = solve_ivp(euler, (0, 3), np.r_[TURN.T @ start, TURN.ravel()], t_eval=t, method="DOP853", rtol=1e-11, atol=1e-12)
    R = reference.y[3:].T.reshape(-1, 3, 3)
    assert np.abs(r.rotation - R).max() < 1e-6
    assert np.abs(r.angular_velocity - np.einsum("tij,tj->ti", R, reference.y[:3].T)).max() < 1e-5
    assert np.ptp(reference.y[0]) > 1  # it does tumble


MODELS = [mb.Kinematic(), mb.Classical(), mb.Recursive()]


@pytest.mark.parametrize("model", MODELS, ids=lambda m: type(m).__name__)
@pytest.mark.parametrize("space", ["auto", "spatial"])
def test_torques_that_keep_the_axis(space: Any, model: Any) -> None:
    """Turned from rest by a constant torque a Jzz: J w' + w x J w = a (Jxz, Jyz, Jzz) + w^2 (-Jyz, Jxz, 0), turned with the
    body. All points lie in the plane, the reactions do not."""
    a = 3.0
    s = mb.Scene("unbalance", space=space)
    body = s.rigid_body("body", 2.0, J, at=(0, 0, 0))
    s.revolute("axis", s.ground, body, at=(0, 0, 0), torque=a * J[2, 2], model=model)
    r = s.simulate(1.0, accuracy=1e-7)
    phi, w = a * r.t**2 / 2, a * r.t
    assert r["axis"].angle == pytest.approx(phi, abs=1e-6)
    x, y = a * J[0, 2] - w**2 * J[1, 2], a * J[1, 2] + w**2 * J[0, 2]
    assert r["axis"].torque[:, 0] == pytest.approx(np.cos(phi) * x - np.sin(phi) * y, abs=1e-4)
    assert r["axis"].torque[:, 1] == pytest.approx(np.sin(phi) * x + np.cos(phi) * y, abs=1e-4)


@pytest.mark.parametrize("model", MODELS, ids=lambda m: type(m).__name__)
def test_pendulum_about_any_axis(model: Any) -> None:
    """Small swings about e through a point h above the centre: w^2 = m g h sin(tilt) / (e.J e + m h^2 (1 - (e.up)^2))."""
    m, h = 2.0, 0.4
    e = np.array([1.0, 2.0, 0.5]) / np.linalg.norm([1.0, 2.0, 0.5])
    s = mb.Scene("pendulum", gravity=(0, 0, -G))
    body = s.rigid_body("body", m, J, at=(0, 0, -h))
    s.revolute("axis", s.ground, body, at=(0, 0, 0), axis=e, model=model)
    arm = np.array([0, 0, -h])
    inertia = e @ J @ e + m * np.sum(np.cross(e, arm) ** 2)
    stiffness = m * G * h * (1 - e[2] ** 2)
    assert s.linearize().angular_frequencies == pytest.approx([np.sqrt(stiffness / inertia)], rel=1e-8)


def test_reactions_at_release() -> None:
    """The static moment of a hanging body and the moment that turns it: reactions at the start, from rest at an angle."""
    m, arm = 2.0, np.array([0.3, 0.1, 0.2])
    s = mb.Scene("released", gravity=(0, -G, 0))
    body = s.rigid_body("body", m, J, at=arm)
    s.revolute("axis", s.ground, body, at=(0, 0, 0))
    r = s.simulate(0.01, accuracy=1e-7)
    weight, z = np.array([0, -m * G, 0]), np.array([0, 0, 1.0])
    about = J + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    rate = np.cross(arm, weight)[2] / about[2, 2]
    force = m * rate * np.cross(z, arm) - weight
    assert r["axis"].force[0] == pytest.approx(force, abs=1e-4)
    assert r["axis"].torque[0] == pytest.approx(about @ z * rate - np.cross(arm, weight), abs=1e-4)
