"""Screw joint."""

from __future__ import annotations

import symengine as se

from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import params
from mbdae.symbolic.motion import Motion


class Screw(Joint):
    """l turns about k.z and travels along it by `lead` a turn, right-handed where that is positive.

    Its angle counts whole turns, which the frames do not show, so that it is an unknown in every model."""

    coordinates = params(angle=("rad", "rotation of l about k.z"))
    params = params(lead=("m", "travel a turn"))

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("z", self.lead / (2 * se.pi) * self.angle).about("z", self.angle)
