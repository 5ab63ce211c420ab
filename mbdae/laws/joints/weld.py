"""Weld: no relative motion."""

from __future__ import annotations

from mbdae.laws.joints.coincidence import same_attitude, same_point, upright
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.motion import Motion
from mbdae.symbolic.vectors import Expr


class Weld(Joint):
    """l is fixed to k."""

    def motion(self, from_k: Motion) -> Motion:
        return from_k

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return same_point(k, l) | same_attitude(k, l)

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return upright(k, l)
