"""Methods as users state them: in a few lines each, none of them exported by the package."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy.integrate import DOP853, RK45

import mbdae as mb
from mbdae.integrators import CollocationTable, collocation_table
from mbdae.integrators.radau import CollocationMethod
from mbdae.integrators.stepped import Stepped


class Euler(mb.OneStep):
    """Explicit Euler."""

    order = 1

    def advance(self, f: Any, t: float, y: Any, h: float) -> Any:
        return y + h * f(t, y)


class Midpoint(mb.OneStep):
    """The implicit midpoint rule, by simplified Newton iteration."""

    order = 2

    def advance(self, f: Any, t: float, y: Any, h: float) -> Any:
        k = f(t, y)
        matrix = np.eye(len(y)) - h / 2 * f.jacobian(t, y)
        for _ in range(30):
            change = np.linalg.solve(matrix, f(t + h / 2, y + h / 2 * k) - k)
            k += change
            if np.abs(h * change).max() <= 1e-14 * (1 + np.abs(y).max()):
                return y + h * k
        raise self.Failed("the iteration on the slope does not converge")


class Explicit(mb.OneStep):
    """An explicit Runge-Kutta method by its coefficients."""

    A: ClassVar[Any]
    b: ClassVar[Any]
    c: ClassVar[Any]

    def advance(self, f: Any, t: float, y: Any, h: float) -> Any:
        k = np.zeros((len(self.b), len(y)))
        for i in range(len(self.b)):
            k[i] = f(t + self.c[i] * h, y + h * (self.A[i][:i] @ k[:i]) if i else y)
        return y + h * (self.b @ k)


class Kutta3(Explicit):
    """Kutta's method of order 3."""

    order = 3
    A, b, c = np.array([[0, 0, 0], [0.5, 0, 0], [-1, 2, 0]]), np.array([1, 4, 1]) / 6, np.array([0, 0.5, 1])


class RK4(Explicit):
    """The classical method."""

    order = 4
    A = np.array([[0, 0, 0, 0], [0.5, 0, 0, 0], [0, 0.5, 0, 0], [0, 0, 1, 0]])
    b, c = np.array([1, 2, 2, 1]) / 6, np.array([0, 0.5, 0.5, 1])


class Dormand5(Explicit):
    """Dormand and Prince, order 5."""

    order = 5
    A, b, c = RK45.A, RK45.B, RK45.C


class Dormand8(Explicit):
    """Dormand and Prince, order 8."""

    order = 8
    A, b, c = DOP853.A, DOP853.B, DOP853.C


@dataclass(frozen=True)
class Gauss(Stepped, CollocationMethod):
    """Collocation at the Gauss points, order 2 s: with one stage the implicit midpoint rule. Not stiffly accurate."""

    stages: int = 2
    step: float | None = None
    accuracy: float | None = None
    rtol: float | None = None

    @property
    def label(self) -> str:
        return f"Gauss({self.stages})"

    @property
    def order(self) -> int:  # type: ignore[override]
        return 2 * self.stages

    @property
    def table(self) -> CollocationTable:
        return collocation_table((1 + np.polynomial.legendre.leggauss(self.stages)[0]) / 2, self.order)


#: methods that tests hold to the services of every solver: a line for each
CONTRIBUTED = [Midpoint(), RK4(), Dormand8(), Gauss(2)]
