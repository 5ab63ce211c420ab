"""A state of a controller, filter or actuator, integrated with the motion."""

from __future__ import annotations

from typing import Any

from mbdae.symbolic.law import TwoBodyLaw
from mbdae.symbolic.part import Parameter, params
from mbdae.symbolic.vectors import Expr


class InternalState(TwoBodyLaw):
    """d value / dt = rate. The law acts on no bodies; its rate is an expression of sensors."""

    frames = ()
    params = params(rate=("1/s", "time derivative"), start=("1", "value at the start"), size=("1", "typical magnitude"))
    states = {"value": Parameter("1", "value")}  # noqa: RUF012
    keeps_states = True
    sticks = False

    def __init__(self, name: str, **values: Any) -> None:
        super().__init__(name, None, None, **values)

    def rates(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        return {"value": self.rate}

    def initial(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        return {"value": self.start}

    def state_scales(self) -> dict[str, float]:
        return {"value": float(self.size)}
