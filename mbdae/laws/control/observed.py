"""An expression of sensors whose value is read by controllers, events and results."""

from __future__ import annotations

from typing import Any

import symengine as se

from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import TwoBodyLaw, params
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Expr


class Observed(TwoBodyLaw):
    """A value that is computed and exerts no force."""

    frames = ()
    params = params(value=("1", "what is observed"))

    def __init__(self, name: str, **values: Any) -> None:
        super().__init__(name, None, None, **values)


def observed_value(d: Derived) -> list[tuple[Target, Expr]]:
    """The value as an output of the law's kernel; none for other laws."""
    return [(("observed",), se.Symbol("value"))] if isinstance(d.law, Observed) else []
