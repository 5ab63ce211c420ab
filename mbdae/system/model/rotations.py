"""Rotations in numbers: quaternions (4,) of any length, rotation vectors, matrices."""

from __future__ import annotations

import numpy as np

from mbdae.symbolic.frames import NodeKind
from mbdae.system.base import Array


def quaternion_product(a: Array, b: Array) -> Array:
    """Quaternion product a o b of arrays (..., 4), scalar part first: the rotation b after a, in the axes that a has turned."""
    if a.ndim == b.ndim == 1:  # the formula below; for single quaternions Python numbers are much faster than arrays
        (s, x, y, z), (t, u, v, w) = a.tolist(), b.tolist()
        return np.array([s * t - (x * u + y * v + z * w), s * u + t * x + (y * w - z * v), s * v + t * y + (z * u - x * w),
                         s * w + t * z + (x * v - y * u)])  # fmt: skip
    scalar = a[..., :1] * b[..., :1] - np.sum(a[..., 1:] * b[..., 1:], axis=-1, keepdims=True)
    vector = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + np.cross(a[..., 1:], b[..., 1:])
    return np.concatenate([scalar, vector], axis=-1)


def turned(P: Array, rotation: Array) -> Array:
    """Quaternions P (..., 4) after further rotations by rotation vectors (..., 3) in body axes, rad."""
    angle = np.linalg.norm(rotation, axis=-1, keepdims=True)
    half = np.sinc(angle / (2 * np.pi)) / 2
    return quaternion_product(P, np.concatenate([np.cos(angle / 2), half * rotation], axis=-1))


def rotation_matrices(P: Array) -> Array:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4), which need not have unit length."""
    p = P / np.linalg.norm(P, axis=-1, keepdims=True)
    w, x, y, z = p.tolist() if p.ndim == 1 else np.moveaxis(p, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows) if p.ndim == 1 else np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion(R: Array) -> Array:
    """Unit quaternions (..., 4) of rotation matrices (..., 3, 3)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.moveaxis(R, (-2, -1), (0, 1))
    K = np.array([
        [xx + yy + zz, zy - yz, xz - zx, yx - xy],
        [zy - yz, xx - yy - zz, xy + yx, xz + zx],
        [xz - zx, xy + yx, yy - xx - zz, yz + zy],
        [yx - xy, xz + zx, yz + zy, zz - xx - yy],
    ])  # fmt: skip
    P: Array = np.linalg.eigh(np.moveaxis(K, (0, 1), (-2, -1)))[1][..., -1]
    return np.where(P[..., :1] >= 0, P, -P)


def rotation_of(kind: NodeKind, q: Array) -> Array:
    """Rotation matrix (3, 3) of a node of this kind at its positions q."""
    if kind is NodeKind.SPATIAL:
        return rotation_matrices(q[3:])
    if kind is NodeKind.PLANAR:
        c, s = np.cos(q[2]), np.sin(q[2])
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.eye(3)
