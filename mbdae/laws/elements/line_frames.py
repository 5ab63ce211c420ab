"""Section axes along a line and their quaternions."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.errors import OptionError
from mbdae.laws.elements.line_shape import Array

#: sine of the angle up to which two directions count as parallel; also bound up to which a component of a unit vector, and 1 plus
#: the cosine between two tangents, count as 0, and the second singular value of a line's tangents and points over the first,
#: which then is straight
PARALLEL = 1e-8
ROUND_OFF = 1e-13  #: unit quaternions whose components all differ by less count as equal


def section_axes(tangents: Array, positions: Array, axis2: Any = None) -> Array:
    """(k, 3, 3) axes 1, 2, 3 as columns at places (k,) along a line.

    axis2: direction whose part normal to the tangent is axis 2. By default axis 3 is the normal of the plane in which the
    line lies; for a straight line z, or x where the line is along z. Along a line in space axis 3 turns with the tangent,
    without twist.
    """
    first = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    if axis2 is None:
        third = _carried(first, _normal(first, positions))
        return np.stack([first, np.cross(third, first), third], axis=-1)
    direction = np.zeros(3)
    direction[: len(axis2)] = axis2
    second = direction - (first @ direction)[:, None] * first
    size = np.linalg.norm(second, axis=1, keepdims=True)
    if np.any(size <= PARALLEL * np.linalg.norm(direction)):
        raise OptionError(f"axis2 = {direction.tolist()} is parallel to the beam somewhere: give a direction across it")
    second = second / size
    return np.stack([first, second, np.cross(first, second)], axis=-1)


def _normal(first: Array, positions: Array) -> Array:
    """Unit normal of the plane that fits the line best, of the sign that makes its z component positive (its y where z is 0, its
    x where both are); of a straight line z, or x where the line is along z. first: unit tangents."""
    spread = np.linalg.svd(np.vstack([first, positions - positions[0]]), full_matrices=False)
    if spread[1][1] <= PARALLEL * spread[1][0]:
        return np.asarray(np.eye(3)[2 if np.linalg.norm(first[0, :2]) > PARALLEL else 0])
    normal = spread[2][2]
    leading = next(c for c in normal[::-1] if abs(c) > PARALLEL)
    return np.asarray(normal * np.sign(leading))


def _carried(first: Array, normal: Array) -> Array:
    """Axis 3 (k, 3) along the line: the normal at its start, turned from tangent to tangent without twist. first: unit
    tangents."""
    found = np.empty_like(first)
    before = first[0]
    normal = normal - (normal @ before) * before
    for i, t in enumerate(first):
        both = 1 + before @ t
        if both > PARALLEL:  # opposite tangents fix no rotation: the normal stays
            normal = normal - (normal @ t) / both * (before + t)
        found[i] = normal = normal / np.linalg.norm(normal)
        before = t
    return found


def quaternions(axes: Array) -> Array:
    """(k, 4) unit quaternions of axes (k, 3, 3), each with a positive dot product with the one before."""
    R, K = np.moveaxis(axes, 0, -1), np.empty((4, 4, len(axes)))  # K = 4 P P^T
    K[0, 0] = 1 + R[0, 0] + R[1, 1] + R[2, 2]
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        K[i + 1, i + 1] = 1 + R[i, i] - R[j, j] - R[k, k]
        K[0, i + 1] = K[i + 1, 0] = R[k, j] - R[j, k]
        K[j + 1, k + 1] = K[k + 1, j + 1] = R[k, j] + R[j, k]
    largest = np.argmax(np.einsum("iik->ki", K), axis=1)  # the row with the largest diagonal entry is the most accurate
    P = np.moveaxis(K, -1, 0)[np.arange(len(axes)), largest]
    P = P / np.linalg.norm(P, axis=1, keepdims=True)
    first = 1.0 if P[0, 0] >= 0 else -1.0
    flips = np.where(np.einsum("ki,ki->k", P[1:], P[:-1]) < 0, -1.0, 1.0)
    return np.asarray(P * np.cumprod(np.r_[first, flips])[:, None])


def headings(tangents: Array) -> Array:
    """(k,) angle of the tangents in the plane z = 0, continuous along the line, rad."""
    return np.asarray(np.unwrap(np.arctan2(tangents[:, 1], tangents[:, 0])))


def relative(P: Array, S: Array) -> Array:
    """conj(P) o S (..., 4): the rotation from axes P to axes S; exactly (1, 0, 0, 0) where they agree to round-off."""
    vector = P[..., :1] * S[..., 1:] - S[..., :1] * P[..., 1:] - np.cross(P[..., 1:], S[..., 1:])
    found: Array = np.concatenate([np.sum(P * S, axis=-1, keepdims=True), vector], axis=-1)
    found[np.max(np.abs(P - S), axis=-1) < ROUND_OFF] = [1.0, 0.0, 0.0, 0.0]
    return found
