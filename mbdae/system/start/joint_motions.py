"""How far joints are from where they are drawn: the relative motions by which the start measures what is near.

Of every joint between two bodies count its rotation from the drawing, 2 sin(angle / 2) about its axis (the angle in rad, where it
is small), and the displacement of the point of l from that of k over the extent of the scene, both in axes fixed to k. Models of
joints, the order of statements and frames do not enter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.deferred import as_full, sp
from mbdae.scene.components import Body, Connection
from mbdae.symbolic.frames import NodeKind
from mbdae.system.base import Array
from mbdae.system.model.model import Model
from mbdae.system.model.nodes import Node
from mbdae.system.model.rotations import quaternion, rotation_of
from mbdae.system.model.sides import joint_axes
from mbdae.system.motion.mechanics import LARGE

INERTIA = 1e-6  #: share of the masses in what is least, which decides where joints do not: of what floats freely


@dataclass
class _Side:
    """A body of a joint as it stands: its rotation from the drawing (3, 3), the joint's point on it (3,), m, and the maps (3, n)
    of its velocities to the velocity of a point fixed to it and to its angular velocity, both inertial."""

    turned: Array
    point: Array
    position: Array
    spins: Array
    moves: Array
    first: int = 0

    def carries(self, point: Array) -> Array:
        """Map (3, n) to the velocity of the point (3,) that moves with the body."""
        arm = point - self.position
        return self.moves - _cross(arm) @ self.spins


class JointMotions:
    """The relative motions of all joints of a model but those with clearance and those of more than two bodies."""

    def __init__(self, model: Model) -> None:
        self.model = model
        joints = [c for c in model.scene.joints if not (c.loose or c.others)]
        self.names = [c.name for c in joints]
        self._ends = [(c.joint, *model.ends(c)) for c in joints]
        points = [law.point_on(side) for law, _, _ in self._ends for side in "kl"]
        points += [b.drawn.position for _, b in model.bodies]
        spread = np.array(points) - np.mean(points, axis=0)
        extent = float(np.max(np.linalg.norm(spread, axis=1), initial=0.0))
        self.extent = extent if extent > 0 else 1.0  #: largest distance of a point from the mean of all, m, in any frame alike

    def at(self, q: Array, rates: bool = False) -> tuple[Array, Any]:
        """Distances (6 j,) of the j joints from their drawn place and their derivatives (6 j, nu) by displacements, sparse where
        the scene is large; with `rates` the maps of velocities to relative angular velocities and to velocities over the
        extent."""
        far, values, rows, columns = ([np.zeros(0)] for _ in range(4))
        for joint, (law, k, l) in enumerate(self._ends):
            a, b = (self._side(body, law.point_on(side), q) for body, side in ((k, "k"), (l, "l")))
            oriented = not (k.is_point or l.is_point)
            w, *v = quaternion(a.turned.T @ b.turned) if oriented else np.eye(4)[0]
            way = a.turned.T @ (b.point - a.point) - (law.point_on("l") - law.point_on("k"))
            far.append(np.r_[2 * np.array(v), way / self.extent])
            turning = a.turned.T if rates else (w * np.eye(3) - _cross(np.array(v))) @ a.turned.T
            for sign, side in ((-1.0, a), (1.0, b)):
                block = sign * np.vstack([turning @ side.spins * oriented, a.turned.T @ side.carries(b.point) / self.extent])
                at = np.indices(block.shape)
                values.append(block.ravel())
                rows.append(6 * joint + at[0].ravel())
                columns.append(side.first + at[1].ravel())
        places = np.concatenate(rows).astype(int), np.concatenate(columns).astype(int)
        shape = 6 * len(self._ends), self.model.nu
        if self.model.nu > LARGE:
            return np.concatenate(far), sp.csr_matrix((np.concatenate(values), places), shape=shape)
        D = np.zeros(shape)
        np.add.at(D, places, np.concatenate(values))
        return np.concatenate(far), D

    def weight(self, D: Any, masses: Any, units: Array) -> Any:
        """D^T D (n, n) of derivatives D (6 j, n), with a small share of the masses (n, n), which decide where no joint does;
        units (n,): unit displacements."""
        matrix = sp.csc_matrix if self.model.nu > LARGE else as_full
        return matrix(D.T @ D) + matrix(masses) * (INERTIA / np.max(masses.diagonal() * (units / self.extent) ** 2))

    def rotation(self, joint: Connection, q: Array) -> Array:
        """Quaternion (4,) of the rotation of l relative to k from the drawing, in the axes of the joint."""
        (k, l), law = self.model.ends(joint), joint.joint
        a, b, axes = self._side(k, law.at, q), self._side(l, law.at, q), joint_axes(law, k)
        return quaternion(axes.T @ a.turned.T @ b.turned @ axes)

    def _side(self, body: Body, drawn: Array, q: Array) -> _Side:
        node = self.model.node(body)
        if node is None:
            return _Side(np.eye(3), drawn, np.zeros(3), np.zeros((3, 0)), np.zeros((3, 0)))
        R, r = rotation_of(node.kind, q[node.q : node.q + node.kind.sizes[0]]), node.position(q)
        P = R if node.kind is NodeKind.POINT or node.kind is NodeKind.PLANAR_POINT else R @ body.drawn.rotation.T
        return _Side(P, r + P @ (drawn - body.drawn.position), r, *_velocities(node, R), node.u)


def _velocities(node: Node, R: Array) -> tuple[Array, Array]:
    """Maps (3, n) of a node's velocities to its angular velocity and to the velocity of its centre, inertial."""
    n, nu = node.kind.translations, node.kind.sizes[1]
    spins, moves = np.zeros((3, nu)), np.eye(3, nu)
    moves[:, n:] = 0.0
    spins[:, n:] = {3: R, 1: np.eye(3)[:, 2:], 0: np.zeros((3, 0))}[nu - n]
    return spins, moves


def _cross(a: Array) -> Array:
    """The matrix (3, 3) of the cross product a x."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
