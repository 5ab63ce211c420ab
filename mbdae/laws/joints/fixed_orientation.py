"""Fixed orientation: no relative rotation, all translations free."""

from __future__ import annotations

from mbdae.laws.joints.coincidence import same_attitude, upright
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.vectors import Expr


class FixedOrientation(Joint):
    """l does not turn relative to k."""

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return same_attitude(k, l)

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return upright(k, l)
