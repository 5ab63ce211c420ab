"""Slider crank with an elastic connecting rod (Simeon; "crank" of the IVP test set) as a raw DAE.

Coordinates p = (phi2, x3, q1..q4): rod angle, slider, two lateral (sine) and two longitudinal (quadratic) amplitudes of
the rod in its moving frame. The crank turns at constant speed, phi1 = omega t, so its row only defines the drive torque
and is left out. Everything below is the equation; `dae_problems.mechanism` derives Jacobians, accelerations and multipliers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import sympy as sp
from dae_problems import mechanism, t
from scenes import data

from mbdae.system.dae import DAE

p = phi2, x3, *q = sp.symbols("phi2 x3 q1 q2 q3 q4")
#: typical magnitudes: coordinates, velocities, multipliers (N), stabilising multipliers
SCALE = {"p": [1.0, 0.5, 1e-3, 1e-4, 1e-5, 1e-5], "v": [100.0, 20.0, 0.3, 0.03, 3e-3, 3e-3],
         "lambda": [500.0] * 2, "mu": [1.0] * 2}


def operators(d: dict[str, float]) -> dict[str, Any]:
    """Mass, stiffness and gyroscopic matrices (4, 4) and coupling vectors (4,) of the rod's modes."""
    PI, L2, h = d["PI_used_by_reference"], d["L2"], d["h"]
    fm, fk, fb = d["rho"] * d["b"] * h * L2, d["E"] * d["b"] * h / L2, d["b"] * h * L2
    B = sp.zeros(4)
    B[0, 2], B[0, 3], B[1, 3] = -fb * 16 / PI**3, fb * (8 / PI**3 - 1 / PI), fb / (2 * PI)
    third = sp.Rational(1, 3)
    axial = sp.Matrix([[16, -8], [-8, 7]]) * third
    return {
        "M": fm * sp.diag(sp.diag(1, 1) / 2, sp.Matrix([[8, 1], [1, 2]])),
        "K": fk * sp.diag(PI**4 / 24 * (h / L2) ** 2, PI**4 * 2 * third * (h / L2) ** 2, axial),
        "B": B - B.T,
        "c1": fb * sp.Matrix([0, 0, 2 * third, third / 2]),
        "c2": fb * sp.Matrix([2 / PI, 0, 0, 0]),
        "c12": L2 * fb * sp.Matrix([0, 0, third, third / 2]),
        "c21": L2 * fb * sp.Matrix([1 / PI, -1 / (2 * PI), 0, 0]),
    }


def mass(d: dict[str, float], o: dict[str, Any]) -> sp.Matrix:
    """(6, 6)."""
    Q, rho = sp.Matrix(q), d["rho"]
    M = sp.diag(d["J2"] + (Q.T * o["M"] * Q)[0] + 2 * rho * o["c12"].dot(Q), d["M3"], o["M"])
    M[0, 2:] = rho * (o["c21"].T + Q.T * o["B"])
    M[2:, 0] = M[0, 2:].T
    return M


def force(d: dict[str, float], o: dict[str, Any], v: Any) -> sp.Matrix:
    """(6,) applied, elastic and gyroscopic forces."""
    Q, Qd, v2, w, rho, L1 = sp.Matrix(q), sp.Matrix(v[2:]), v[0], d["omega"], d["rho"], d["L1"]
    s, c = sp.sin(w * t - phi2), sp.cos(w * t - phi2)
    turn = L1 * d["L2"] * d["M2"] * w**2 * s / 2 + rho * L1 * w**2 * (s * o["c1"].dot(Q) - c * o["c2"].dot(Q))
    turn -= 2 * rho * v2 * o["c12"].dot(Qd) + 2 * v2 * (Qd.T * o["M"] * Q)[0] + rho * (Qd.T * o["B"] * Qd)[0]
    modes = v2**2 * o["M"] * Q - o["K"] * Q
    modes += rho * (v2**2 * o["c12"] + L1 * w**2 * (c * o["c1"] + s * o["c2"]) + 2 * v2 * o["B"] * Qd)
    return sp.Matrix([turn, 0, *modes])


def start(d: dict[str, float], initial: dict[str, Any]) -> tuple[list[float], list[float]]:
    """Positions and velocities (6,): the amplitudes and their rates as printed, phi2 and x3 from the constraints.

    The printed phi2, x3 and their rates have 9 digits and violate the constraints by 3e-10 m. The reference solution is
    that of the amplitudes as independent coordinates, so these are kept and the two dependent coordinates computed.
    """
    L1, w, reach, rate = d["L1"], d["omega"], d["L2"] + initial["q"][3], initial["qd"][3]
    phi2_0 = -np.arcsin(L1 * np.sin(0.0) / reach)
    v2 = -(L1 * w + rate * np.sin(phi2_0)) / (reach * np.cos(phi2_0))
    x = L1 + reach * np.cos(phi2_0)
    x_rate = rate * np.cos(phi2_0) - reach * np.sin(phi2_0) * v2
    return [phi2_0, x, *initial["q"]], [v2, x_rate, *initial["qd"]]


def slider_crank(form: str) -> DAE:
    """The mechanism as "index3", "ggl" (stabilised index 2) or "ggl_rates" (its multipliers as derivatives)."""
    reference = data("flexible_slider_crank")
    d = reference["parameters"]
    o, phi1, reach = operators(d), d["omega"] * t, d["L2"] + q[3]
    g = [d["L1"] * sp.sin(phi1) + reach * sp.sin(phi2), x3 - d["L1"] * sp.cos(phi1) - reach * sp.cos(phi2)]
    blocks = ("p", "v", "lambda") if form == "index3" else ("p", "v", "lambda", "mu")
    scale = np.concatenate([SCALE[block] for block in blocks])
    if form == "ggl_rates":  # the integrals of the multipliers over a turn of the crank
        scale[12:14] = 5.0
    return mechanism(p, mass(d, o), lambda v: force(d, o, v), g, *start(d, reference["initial"]), form, scale=scale)
