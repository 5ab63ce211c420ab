"""A chain of joints by kinematics alone: Kane's equations with Jacobians by complex steps. No equation of mbdae."""

from __future__ import annotations

from typing import Any

import numpy as np

STEP = 1e-30


def turn(axis: Any, angle: Any) -> Any:
    """Rotation (3, 3) about a unit axis, of a complex angle too."""
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


class Chain:
    """Bodies drawn with centres (n, 3), inertias (n, 3, 3) in inertial axes, masses (n,), on joints of axes and points (n, 3)."""

    def __init__(self, seed: int, n: int = 5) -> None:
        rng = np.random.default_rng(seed)
        self.slides = rng.random(n) < 0.3
        self.axes = rng.normal(size=(n, 3))
        self.axes /= np.linalg.norm(self.axes, axis=1)[:, None]
        self.at, self.centres, self.masses = rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), 1 + rng.random(n)
        A = rng.normal(size=(n, 3, 3))
        self.J = np.array([np.trace(a @ a.T) * np.eye(3) - a @ a.T for a in A]) * 0.05
        self.rotors, self.g = rng.random(n), np.array([0.2, -0.4, -9.81])

    def placed(self, q: Any) -> tuple[Any, Any]:
        """Centres (n, 3) and rotations from the drawing (n, 3, 3)."""
        R, p, centres, turns = np.eye(3) + 0j, np.zeros(3) + 0j, [], []
        for slides, axis, at, c, value in zip(self.slides, self.axes, self.at, self.centres, q, strict=True):
            if slides:
                p = p + R @ axis * value
            else:
                own = turn(axis, value)
                p, R = p + R @ (at - own @ at), R @ own
            centres.append(p + R @ c)
            turns.append(R)
        return np.array(centres), np.array(turns)

    def rates(self, q: Any, v: Any) -> tuple[Any, Any]:
        """Velocities of the centres and angular velocities (n, 3) at velocities v, by a complex step along v."""
        x, R = self.placed(q + 1j * STEP * v)
        S = (R.imag / STEP) @ R.real.transpose(0, 2, 1)
        return x.imag / STEP, np.stack([S[:, 2, 1], S[:, 0, 2], S[:, 1, 0]], axis=1)

    def mass(self, q: Any) -> Any:
        """Mass matrix (n, n), and Jacobians of all bodies."""
        columns = [self.rates(q, e) for e in np.eye(len(q))]
        X, W = (np.stack([c[k] for c in columns], axis=2) for k in (0, 1))
        R = self.placed(q)[1].real
        J = R @ self.J @ R.transpose(0, 2, 1)
        M = np.einsum("b,bik,bil->kl", self.masses, X, X) + np.einsum("bik,bij,bjl->kl", W, J, W)
        return M + np.diag(self.rotors), X

    def bias(self, q: Any, v: Any, h: float = 1e-2) -> Any:
        """Forces for no acceleration, M' v - d(v M v / 2)/dq - gravity, by differences of sixth order of M."""
        def slope(direction: Any) -> Any:
            weights = ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))
            return sum(w * (self.mass(q + k * h * direction)[0] - self.mass(q - k * h * direction)[0]) for k, w in weights) / h
        pull = np.einsum("b,bik,i->k", self.masses, self.mass(q)[1], self.g)
        return slope(v) @ v - np.array([v @ slope(e) @ v / 2 for e in np.eye(len(q))]) - pull
