"""Laws of control: states that are integrated with the motion, outputs of sampled controllers held between two instants, and
expressions of sensors that controllers, events and loads read.
"""

from __future__ import annotations

from typing import Any

import symengine as se

from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import TwoBodyLaw
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.part import Parameter, params
from mbdae.symbolic.vectors import Expr


class InternalState(TwoBodyLaw):
    """A state of a controller, filter or actuator, integrated with the motion.

    d value / dt = rate. The law acts on no bodies; its rate is an expression of sensors."""

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


class HeldOutput(InternalState):
    """A state that is constant between the instants at which a sampled controller sets it."""

    def rates(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        return {"value": se.Integer(0)}


class Observed(TwoBodyLaw):
    """A value that is computed and exerts no force."""

    frames = ()
    params = params(value=("1", "what is observed"))

    def __init__(self, name: str, **values: Any) -> None:
        super().__init__(name, None, None, **values)


def observed_value(d: Derived) -> list[tuple[Target, Expr]]:
    """The value as an output of the law's kernel; none for other laws."""
    return [(("observed",), se.Symbol("value"))] if isinstance(d.law, Observed) else []
