"""Spherical joint: two points coincide."""

from __future__ import annotations

from mbdae.laws.joints.coincidence import same_point
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.vectors import Expr


class Spherical(Joint):
    """The points of k and l coincide, all rotations are free."""

    holds_point = True

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return same_point(k, l)
