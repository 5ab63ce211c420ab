"""Gear pair, or belt."""

from __future__ import annotations

from mbdae.symbolic.coupling import Coupling
from mbdae.symbolic.law import params as declared
from mbdae.symbolic.vectors import Expr


class Gear(Coupling):
    """The driven angle is `ratio` times the driving one. The ratio is negative for two wheels with external teeth, positive with
    internal teeth or a belt. Both angles are relative to the bodies k of their joints, which may be a carrier that moves. The
    multiplier is the torque on the driven coordinate, N m."""

    params = declared(ratio=("1", "driven angle over driving angle"))
    coordinates = declared(driving=("rad", "angle of the driving wheel"), driven=("rad", "angle of the driven wheel"))

    def constraints(self) -> dict[str, Expr]:
        return {"mesh": self.ratio * self.driving - self.driven}
