"""The coordinate of a joint as an unknown of its own."""

from __future__ import annotations

import symengine as se

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Element
from mbdae.symbolic.vectors import Expr


class JointCoordinate(Element):
    """An unknown without mass: its equation of motion says that the forces on it add to zero."""

    def kinetic_energy(self, b: Frame) -> Expr:
        return se.Integer(0)
