"""Mass properties: slender rods, inertia matrices and what makes them impossible."""

from __future__ import annotations

import numpy as np

from mbdae.scene.components import Array


def of_rods(points: Array, mass: float) -> tuple[Array, Array]:
    """Centre of mass (3,), m, and inertia (3, 3) about it, kg m^2, of uniform slender rods through points (n, 3); mass in kg."""
    ends = np.stack([points[:-1], points[1:]], axis=1)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    masses = mass * lengths / lengths.sum()
    middles = ends.mean(axis=1)
    center = (masses[:, None] * middles).sum(axis=0) / mass if mass else middles.mean(axis=0)
    J = np.zeros((3, 3))
    for m, (a, b), c in zip(masses, ends, middles, strict=True):
        for direction, weight in (((b - a), m / 12), (c - center, m)):
            J += weight * (direction @ direction * np.eye(3) - np.outer(direction, direction))
    return center, J


def matrix(value: Array) -> Array:
    """Inertia matrix (3, 3), kg m^2, from one number (about z), 3 principal values or 3x3."""
    if value.ndim == 0:
        return np.diag([0.0, 0.0, float(value)])
    return np.diag(value) if value.shape == (3,) else np.asarray(value, dtype=float)


def problems(name: str, J: Array, planar: bool, as_given: bool) -> list[str]:
    """Why an inertia matrix is impossible, one sentence each. as_given: whether one that no body has is taken all the same."""
    if not np.allclose(J, J.T, atol=1e-12 * (1 + np.abs(J).max())):
        return [f"body '{name}': inertia matrix is not symmetric (differs by {np.abs(J - J.T).max():.3g} kg m^2); "
                f"give equal products of inertia above and below the diagonal"]  # fmt: skip
    moments = np.linalg.eigvalsh(J)
    if moments[0] < -1e-12 * max(moments[-1], 1e-300):
        return [f"body '{name}': inertia has the negative principal moment {moments[0]:.6g} kg m^2; give that of a "
                f"body, whose principal moments are 0 or positive"]  # fmt: skip
    if not (planar or as_given) and moments[0] + moments[1] < moments[2] * (1 - 1e-9):
        return [f"body '{name}': principal moments {moments[0]:.6g}, {moments[1]:.6g}, {moments[2]:.6g} kg m^2 violate the "
                f"triangle inequality (the two smaller must add up to at least the largest); correct them, or pass as_given=True "
                f"to have them taken as they are"]  # fmt: skip
    return []
