"""Free joint: no constraint, coordinates of the relative motion."""

from __future__ import annotations

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import params
from mbdae.symbolic.motion import Motion
from mbdae.symbolic.vectors import Expr


class Free(Joint):
    """l moves freely relative to k; the displacements are along k's axes."""

    coordinates = params(x=("m", "displacement of l along k.x"), y=("m", "displacement of l along k.y"),
                         z=("m", "displacement of l along k.z"),
                         rotation=("rotation", "rotation of l relative to k"))  # fmt: skip

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("x", self.x).along("y", self.y).along("z", self.z).turned(self.rotation)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {}

    def coordinate(self, k: Frame, l: Frame) -> dict[str, Expr]:
        d = l.r - k.r
        return {"x": k.x @ d, "y": k.y @ d, "z": k.z @ d}

    def ties(self, k: Frame, l: Frame) -> dict[str, Expr]:
        d = l.r - k.r
        return {"x": self.x - k.x @ d, "y": self.y - k.y @ d, "z": self.z - k.z @ d}
