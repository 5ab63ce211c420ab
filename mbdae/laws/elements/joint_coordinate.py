"""The coordinate of a joint as an unknown of its own."""

from __future__ import annotations

import symengine as se

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Element
from mbdae.symbolic.vectors import Expr


class JointCoordinate(Element):
    """An unknown without mass: its momentum row is the sum of the forces that act on it."""

    def kinetic_energy(self, b: Frame) -> Expr:
        return se.Integer(0)
