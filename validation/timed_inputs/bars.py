"""Quadratic finite elements of a cantilever, strains at 2 Gauss points, mass at 3: axial, or bent with shear (Timoshenko)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ORDER = 2


@dataclass(frozen=True)
class Bar:
    """M y'' + K (y + damping y') = load f(t); tip (n,) reads the deflection of the end."""

    M: Array
    K: Array
    damping: float
    spread: Array
    tip: Array

    @property
    def slowest(self) -> float:
        """Lowest natural frequency, rad/s."""
        return float(np.sqrt(np.min(np.linalg.eigvals(np.linalg.solve(self.M, self.K)).real)))

    def largest(self, deflection: float, spread: bool) -> float:
        """Static load (N, or N/m where spread) that deflects the tip by so much (m)."""
        return float(deflection / (self.tip @ np.linalg.solve(self.K, self.spread if spread else self.tip)))

    def rhs(self, y: Array, force: float, spread: bool) -> Any:
        """Rates of (y, y')."""
        n = len(self.tip)
        pushed = force * (self.spread if spread else self.tip) - self.K @ (y[:n] + self.damping * y[n:])
        return np.r_[y[n:], np.linalg.solve(self.M, pushed)]


def shapes(x: float) -> tuple[Array, Array]:
    """Quadratic shape functions and slopes over 0..1."""
    return np.array([(1 - x) * (1 - 2 * x), 4 * x * (1 - x), x * (2 * x - 1)]), np.array([4 * x - 3, 4 - 8 * x, 4 * x - 1])


def cantilever(stiffness: float, line: float, L: float, elements: int, damping: float, shear: float = 0.0,
               rotary: float = 0.0) -> Bar:
    """stiffness EA (N), or EI (N m^2) with shear GA (N) and rotary inertia (kg m) of a bent one; line kg/m, L m."""
    fields, nodes, h = (2 if shear else 1), ORDER * elements + 1, L / elements
    M, K, f = np.zeros((fields * nodes, fields * nodes)), np.zeros((fields * nodes, fields * nodes)), np.zeros(fields * nodes)
    for e in range(elements):
        first = ORDER * e + np.arange(ORDER + 1)
        for points, is_mass in ((ORDER, False), (ORDER + 1, True)):
            xs, ws = np.polynomial.legendre.leggauss(points)
            for x, w in zip((xs + 1) / 2, ws / 2 * h, strict=True):
                N, B = shapes(x)
                n, b = np.zeros((fields, fields * nodes)), np.zeros((fields, fields * nodes))
                for i in range(fields):
                    n[i, fields * first + i], b[i, fields * first + i] = N, B / h
                if is_mass:
                    M += w * (line * np.outer(n[0], n[0]) + (rotary * np.outer(n[1], n[1]) if shear else 0))
                    f += w * n[0]
                elif shear:
                    slip = b[0] - n[1]
                    K += w * (stiffness * np.outer(b[1], b[1]) + shear * np.outer(slip, slip))
                else:
                    K += w * stiffness * np.outer(b[0], b[0])
    free = slice(fields, None)
    tip = np.zeros(fields * nodes)
    tip[-fields] = 1.0
    return Bar(M[free, free], K[free, free], damping, f[free], tip[free])
