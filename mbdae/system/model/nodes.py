"""Nodes of a model: bodies, nodes of beams, and coordinates of joints, each with its unknowns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbdae.scene.components import Array, Body
from mbdae.symbolic.frames import NodeKind


@dataclass(frozen=True)
class Node:
    """A moving node: its name and body (None for a joint's own coordinate), its kind, and its first entries in q and u.
    unit: of its translations, or of the coordinate. A coordinate also has the name of its joint and its name there."""

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
