"""Mass and stiffness matrices of a slender beam, as a finite-element program gives them."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

import mbdae as mb

LENGTH, AREA, SECOND, DENSITY, SHEAR = 1.0, 4e-4, 1.3e-8, 7800.0, 8e10  # m, m^2, m^4, kg/m^3, Pa
PER_LENGTH = DENSITY * AREA  # kg/m


def beam_matrices(elements: int, E: float = 2.1e11, slender: float = 1.0, length: float = LENGTH) -> tuple[Any, Any, Any]:
    """M, K (CSC, 6 freedoms a node) and nodes of a beam of Bernoulli along x from the origin, with rotary inertia; slender: a
    factor on its second moment of area."""
    h, n, I = length / elements, 6 * (elements + 1), SECOND * slender
    M, K = np.zeros((n, n)), np.zeros((n, n))
    stiff = E * I / h**3 * np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
                                          [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]])
    mass = PER_LENGTH * h / 420 * np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h],
                                            [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]])
    mass += DENSITY * I / 30 / h * np.array([[36, 3 * h, -36, 3 * h], [3 * h, 4 * h * h, -3 * h, -h * h],
                                                  [-36, -3 * h, 36, -3 * h], [3 * h, -h * h, -3 * h, 4 * h * h]])
    sign = np.diag([1, -1, 1, -1])
    for i in range(0, n - 6, 6):
        j = i + 6
        for at, k, m in (([i, j], E * AREA, PER_LENGTH), ([i + 3, j + 3], SHEAR * 2 * I, DENSITY * 2 * I)):
            K[np.ix_(at, at)] += k / h * np.array([[1, -1], [-1, 1]])
            M[np.ix_(at, at)] += m * h / 6 * np.array([[2, 1], [1, 2]])
        for at, s in (([i + 1, i + 5, j + 1, j + 5], np.eye(4)), ([i + 2, i + 4, j + 2, j + 4], sign)):
            K[np.ix_(at, at)] += s @ stiff @ s
            M[np.ix_(at, at)] += s @ mass @ s
    nodes = np.column_stack([np.linspace(0, length, elements + 1), np.zeros((elements + 1, 2))])
    return sp.csc_matrix(M), sp.csc_matrix(K), nodes


def on_a_hub(elements: int, modes: int, share: float, slender: float = 1.0) -> Any:
    """Angular frequencies of this beam clamped to a hub that turns at `share` of sqrt(E I / (m L^4)), over that, with geometric
    stiffness; see rotating_beam_frequencies."""
    M, K, nodes = beam_matrices(elements, slender=slender)
    ends = {"root": [0], "tip": [elements]}
    body = mb.ReducedBody.craig_bampton(M, K, nodes, ends, modes, accelerations=True, stiffening=True)
    unit = np.sqrt(2.1e11 * SECOND * slender / PER_LENGTH)
    rate = share * unit
    s = mb.Scene("hub")
    hub = s.rigid_body("hub", 1.0, np.eye(3), at=(0, 0, 0), angular_velocity=(0, 0, rate))
    s.reduced_body("beam", body, velocity=(0, rate * LENGTH / 2, 0), angular_velocity=(0, 0, rate))
    s.weld("root", hub, "beam.root", at=(0, 0, 0))
    s.revolute("shaft", s.ground, hub, at=(0, 0, 0), angle=rate * mb.t)
    return s.linearize(at=s.equilibrium(frame="hub"), frame="hub").angular_frequencies / unit
