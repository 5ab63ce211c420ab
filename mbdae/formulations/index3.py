"""Index-3 form: position constraints only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from mbdae.formulations.base import WAVES, Form
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import Target, dynamics, kinematics, position, scaled, state_rows
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembled.form_spec import FormSpec
from mbdae.values import flag, set_option


def index3_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """q' = H u, M u' + G^T lambda = f, g = 0; g: constraints, G: their Jacobian, H: from u to q'."""
    if isinstance(d.law, Element):
        return [*kinematics(d), *dynamics(d)]
    return [*dynamics(d), *scaled(d, position(d)), *state_rows(d)]


@dataclass(frozen=True)
class Index3(Form):
    """Equations of motion with the constraints on positions, not differentiated; for mbdae's own integrators (IDA refuses it).

    waves: elastic vibrations are resolved instead of stepped over."""

    waves: bool = False
    label: ClassVar[str] = "Index3"

    def __post_init__(self) -> None:
        set_option(self, "waves", flag, WAVES)

    def spec(self) -> FormSpec:
        rows = {"q": "q", "u": "u", "s": "s", "g": "lambda"}
        index = {"q": 1, "v": 2, "s": 1, "lambda": 3}
        return FormSpec(self.label, index3_outputs, rows, ("lambda",), False, index, True, self.waves)
