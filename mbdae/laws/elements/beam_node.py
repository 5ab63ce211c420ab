"""A node of a beam."""

from __future__ import annotations

import symengine as se

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Element
from mbdae.symbolic.vectors import Expr


class BeamNode(Element):
    """A node without inertia of its own: the mass of a beam is consistent, spread over the nodes of its elements."""

    def kinetic_energy(self, b: Frame) -> Expr:
        return se.Integer(0)
