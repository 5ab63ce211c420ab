"""An output of a sampled controller, held from one instant to the next."""

from __future__ import annotations

from typing import Any

import symengine as se

from mbdae.laws.control.internal_state import InternalState
from mbdae.symbolic.vectors import Expr


class HeldOutput(InternalState):
    """A state that is constant between the instants at which a sampled controller sets it."""

    def rates(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        return {"value": se.Integer(0)}
