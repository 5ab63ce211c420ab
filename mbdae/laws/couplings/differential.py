"""Differential gear."""

from __future__ import annotations

from mbdae.symbolic.coupling import Coupling
from mbdae.symbolic.law import params as declared
from mbdae.symbolic.vectors import Expr


class Differential(Coupling):
    """The angles of both outputs add to twice that of the carrier. The multiplier is half the torque on the carrier's coordinate,
    N m; the torque on each output is the opposite of the multiplier."""

    coordinates = declared(first=("rad", "angle of an output"), second=("rad", "angle of the other output"),
                           carrier=("rad", "angle of the carrier"))  # fmt: skip

    def constraints(self) -> dict[str, Expr]:
        return {"sum": self.first + self.second - 2 * self.carrier}
