"""Equations of motion of Lagrange and d'Alembert from energies and rows A(q, t) q' = 0 by SymPy, integrated by SciPy; a thin disc
by Newton and Euler; the linear equations of the bicycle as published."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
TIME = sp.Symbol("t")
TIGHT = {"rtol": 1e-12, "atol": 1e-13, "method": "DOP853"}
G = 9.81  # m/s^2


def coordinates(names: str) -> tuple[list[Any], list[Any]]:
    """Coordinates and their rates as symbols."""
    q = list(sp.symbols(names))
    return q, [sp.Symbol(f"{x}_rate") for x in q]


def moved(T: Any, q: Sequence[Any], u: Sequence[Any], rows: Sequence[Any], start: Sequence[float], t: Array) -> Array:
    """q (n, times) of a system with the kinetic energy T(q, u, t) and the rows linear in u that vanish; start: q, then u."""
    A = sp.Matrix(list(rows)).jacobian(u)
    momentum = sp.Matrix([T]).jacobian(u).T
    bias = momentum.jacobian(q) * sp.Matrix(u) + momentum.diff(TIME) - sp.Matrix([T]).jacobian(q).T
    row_bias = sp.Matrix(list(rows)).jacobian(q) * sp.Matrix(u) + sp.Matrix(list(rows)).diff(TIME)
    found = sp.lambdify([TIME, *q, *u], (momentum.jacobian(u), bias, A, row_bias), cse=True)
    n, m = len(q), len(rows)

    def rates(t: float, y: Array) -> Array:
        M, b, G_, g = found(t, *y)
        K = np.block([[M, G_.T], [G_, np.zeros((m, m))]])
        return np.r_[y[n:], np.linalg.solve(K, -np.r_[b.ravel(), g.ravel()])[:n]]

    return np.asarray(solve_ivp(rates, (0, t[-1]), np.asarray(start, dtype=float), t_eval=t, **TIGHT).y[:n])


def disc(radius: float, mass: float, inertia: tuple[float, float], center: Array, axle: Array, spin: Array, t: Array) -> Array:
    """Centre (times, 3) of a thin disc that rolls on z = 0; inertia: about a diameter, about the axle; spin: angular velocity."""
    n, g = np.array([0.0, 0, 1]), np.array([0.0, 0, -G])

    def rates(_: float, y: Array) -> Array:
        a, w = y[3:6], y[6:]
        s, da = n @ a, np.cross(w, a)
        c, ds = np.sqrt(1 - s * s), n @ da
        dc = -s * ds / c
        arm = -radius * (n - s * a) / c
        turned = -radius * (-ds * a - s * da) / c - arm * dc / c
        J = inertia[0] * np.eye(3) + (inertia[1] - inertia[0]) * np.outer(a, a)
        whole = J + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        moment = -np.cross(w, J @ w) - mass * np.cross(arm, np.cross(w, turned)) - mass * np.cross(arm, g)
        return np.r_[-np.cross(w, arm), da, np.linalg.solve(whole, moment)]

    return np.asarray(solve_ivp(rates, (0, t[-1]), np.r_[center, axle, spin], t_eval=t, **TIGHT).y[:3].T)


#: M, C1, K0 and K2 of the benchmark bicycle: Meijaard, Papadopoulos, Ruina, Schwab, Proc. R. Soc. A 463 (2007) 1955, appendix
M = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
C1 = np.array([[0.0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]])
K0 = np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]])
K2 = np.array([[0.0, 76.59734589573222], [0.0, 2.65431523794604]])
#: table 2 of the same paper: capsize, castering and weave at 0, 1 ... 10 m/s, 1/s; at rest the four roots are real
CAPSIZE = (-3.13164324790656, -3.13423125066578, -3.07158645641514, -2.63366137253667, -1.42944427361326, -0.32286642900409,
           -0.00406690076970, 0.10268170574766, 0.14327879765713, 0.15790184030917, 0.16105338653172)
CASTERING = (-5.53094371765393, -7.11008014637442, -8.67387984831735, -10.35101467245920, -12.15861426576447, -14.07838969279822,
             -16.08537123098026, -18.15788466125262, -20.27940894394569, -22.43788559040858, -24.62459635017404)
WEAVE = (5.53094371765393, 3.52696170990070 + 0.80774027519930j, 2.68234517512745 + 1.68066296590675j,
         1.70675605663975 + 2.31582447384325j, 0.41325331521125 + 3.07910818603206j, -0.77534188219585 + 4.46486771378823j,
         -1.52644486584142 + 5.87673060598709j, -2.13875644258362 + 7.19525913329805j, -2.69348683581097 + 8.46037971396931j,
         -3.21675402252485 + 9.69377351531791j, -3.72016840437287 + 10.90681139476287j)
PUBLISHED = {float(v): three for v, three in enumerate(zip(WEAVE, CAPSIZE, CASTERING, strict=True))}
PUBLISHED[0.0] += (3.13164324790656,)
#: speeds between which the bicycle is stable by itself, m/s
SELF_STABLE = 4.29238253634111, 6.02426201538837


def bicycle_roots(speed: float) -> Any:
    """Eigenvalues of M x'' + v C1 x' + (g K0 + v^2 K2) x = 0 with imaginary part >= 0, 1/s."""
    A = np.block([[np.zeros((2, 2)), np.eye(2)],
                  [-np.linalg.solve(M, G * K0 + speed**2 * K2), -np.linalg.solve(M, speed * C1)]])
    found = np.linalg.eigvals(A)
    return found[found.imag >= 0]
