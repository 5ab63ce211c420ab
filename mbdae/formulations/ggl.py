"""Stabilised index-2 form of Gear, Gupta and Leimkuhler."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from mbdae.formulations.base import WAVES, Form
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import Target, correction, dynamics, kinematics, position, scaled, state_rows, velocity
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembled.form_spec import FormSpec
from mbdae.values import flag, set_option


def ggl_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """q' = H (u + G^T mu), M u' + G^T lambda = f, G u + g_t = 0, g = 0; g: constraints, G: their Jacobian, H: from u to q'."""
    if isinstance(d.law, Element):
        return [*kinematics(d), *dynamics(d)]
    return [*dynamics(d), *correction(d), *scaled(d, velocity(d)), *scaled(d, position(d)), *state_rows(d)]


@dataclass(frozen=True)
class GGL(Form):
    """Constraints of positions and of velocities are both satisfied, so that neither drifts.

    C.W. Gear, B. Leimkuhler, G.K. Gupta, J. Comput. Appl. Math. 12-13 (1985) 77.
    algebraic: False makes the multipliers time derivatives of unknowns (lambda = Lambda', mu = M'), which lowers the index of
    the equations to 1. True makes them algebraic unknowns of index 2; in this variant alone Radau IIA can pass singular
    positions. None (default): True for solvers that take index 2, else False; `Scene.system` gives the equations of index 1.
    waves: Radau IIA resolves elastic vibrations instead of stepping over them.
    """

    algebraic: bool | None = None
    waves: bool = False
    label: ClassVar[str] = "GGL"

    def __post_init__(self) -> None:
        set_option(self, "algebraic", flag,
                   "give True (index 2), False (multipliers as derivatives), or None (the solver decides)")
        set_option(self, "waves", flag, WAVES)

    def for_index(self, highest: int) -> GGL:
        return replace(self, algebraic=highest >= 2) if self.algebraic is None else self

    def spec(self) -> FormSpec:
        k = 2 if self.algebraic else 1
        rows = {"q": "q", "u": "u", "s": "s", "gd": "lambda", "g": "mu"}
        index = {"q": 1, "v": 1, "s": 1, "lambda": k, "mu": k}
        return FormSpec(self.label, ggl_outputs, rows, ("lambda", "mu"), not self.algebraic, index, bool(self.algebraic),
                        self.waves)  # fmt: skip
