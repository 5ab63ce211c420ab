"""Differential gear."""

from __future__ import annotations

from mbdae.symbolic.coupling import Coupling
from mbdae.symbolic.law import params as declared
from mbdae.symbolic.vectors import Expr


class Differential(Coupling):
    """The angles of both outputs add to twice that of the carrier. The multiplier is the torque on the carrier's coordinate over
    2, N m: both outputs take the opposite of it."""

    coordinates = declared(first=("rad", "angle of an output"), second=("rad", "angle of the other output"),
                           carrier=("rad", "angle of the carrier"))  # fmt: skip

    def constraints(self) -> dict[str, Expr]:
        return {"sum": self.first + self.second - 2 * self.carrier}
