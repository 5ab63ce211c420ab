"""Nodes of a model: bodies, nodes of beams, and coordinates of joints, each with its unknowns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbdae.scene.components import Array, Body
from mbdae.symbolic.frames import NodeKind


@dataclass(frozen=True)
class Node:
    """A node that moves: a body, a node of a beam, or a joint's coordinate that is an unknown. body: None for a coordinate; q, u:
    its first entries among all positions and velocities; unit: that of its translations, or of the coordinate; joint,
    coordinate: name of the joint and of the coordinate in it, for coordinates only."""

    name: str
    body: Body | None
    kind: NodeKind
    q: int
    u: int
    unit: str = "m"
    joint: str = ""
    coordinate: str = ""

    def position(self, q: Array) -> Array:
        """Position (3,) of the node at q (nq,), m."""
        r = np.zeros(3)
        r[: self.kind.translations] = q[self.q : self.q + self.kind.translations]
        return r
