"""Spherical joint."""

from __future__ import annotations

from mbdae.laws.joints.coincidence import same_point
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import params
from mbdae.symbolic.motion import Motion
from mbdae.symbolic.vectors import Expr


class Spherical(Joint):
    """The points of k and l coincide, all rotations are free."""

    coordinates = params(rotation=("rotation", "rotation of l relative to k"))

    def motion(self, from_k: Motion) -> Motion:
        return from_k.turned(self.rotation)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return same_point(k, l)
