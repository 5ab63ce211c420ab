"""Rack and pinion."""

from __future__ import annotations

from mbdae.symbolic.coupling import Coupling
from mbdae.symbolic.law import params as declared
from mbdae.symbolic.vectors import Expr


class Rack(Coupling):
    """The rack moves by `radius` times the angle of the pinion. The multiplier is the force on the rack's displacement, N."""

    params = declared(radius=("m", "pitch radius of the pinion, negative where the rack moves backwards"))
    coordinates = declared(angle=("rad", "angle of the pinion"), displacement=("m", "displacement of the rack"))

    def constraints(self) -> dict[str, Expr]:
        return {"mesh": self.radius * self.angle - self.displacement}
