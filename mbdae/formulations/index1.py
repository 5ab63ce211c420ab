"""Index-1 form: constraints on the level of accelerations, with Baumgarte's stabilisation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from mbdae.formulations.base import WAVES, Form
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import Target, dynamics, kinematics, state_rows
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembled.acceleration_kernel import POSITION, VELOCITY, stabilised
from mbdae.system.assembled.form_spec import FormSpec
from mbdae.values import array, flag, number, set_option, several, word

#: default of Baumgarte's alpha times the characteristic time of the scene. With 1, constraint violations decay as fast as the
#: motion changes, so that the constraint rows are no stiffer than the motion. Measured with CVODE on five scenes: 3 takes up to
#: 2.5, 10 up to 4, 100 up to 12 times the evaluations of 1 without a smaller error; with 0 the constraints drift and the error is
#: 5 to 50 times as large (docs/accuracy.md)
RATE = 1.0
MULTIPLIERS = ("derivatives", "algebraic", "eliminated")


def index1_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """q' = H u, M u' + G^T lambda = f, G u' + gamma + 2 alpha (G u + g_t) + beta^2 g = 0; g: constraints, G: their Jacobian,
    d2g/dt2 = G u' + gamma."""
    if isinstance(d.law, Element):
        return [*kinematics(d), *dynamics(d)]
    return [*dynamics(d), *stabilised(d), *state_rows(d)]


@dataclass(frozen=True)
class Index1(Form):
    """Constraints differentiated twice: cheap steps, but only Baumgarte's terms keep positions and velocities of joints closed.

    J. Baumgarte, Comput. Methods Appl. Mech. Eng. 1 (1972) 1.

    baumgarte    alpha (1/s): an error of a joint decays like exp(-alpha t); or the pair (alpha, beta) of
                 G u' + gamma + 2 alpha (G u + g_t) + beta^2 g = 0. None: 1 over the characteristic time of the scene; a
                 fixed alpha is too weak for a fast scene and makes a slow one stiff. 0: no stabilisation
    multipliers  "derivatives": they are time derivatives of unknowns (for IDA, whose error test fails where multipliers are
                 unknowns themselves); "algebraic": they are unknowns (for Radau IIA); "eliminated": u' and lambda are solved
                 for at every state, which leaves y' = f(t, y) (for CVODE). None: as the solver needs it; `Scene.system` gives
                 "derivatives"
    waves        Radau IIA resolves elastic vibrations instead of stepping over them

    A run warns where its constraints are violated by more than the accuracy at the end.
    """

    baumgarte: float | Sequence[float] | None = None
    multipliers: str | None = None
    waves: bool = False
    label: ClassVar[str] = "Index1"

    def __post_init__(self) -> None:
        set_option(self, "baumgarte", _pair, f"give alpha >= 0 in 1/s, the pair (alpha, beta), or None for {RATE:g} over the "
                                             f"characteristic time of the scene")  # fmt: skip
        set_option(self, "multipliers", word, "or give None to have it follow from the solver", words=MULTIPLIERS)
        set_option(self, "waves", flag, WAVES)

    def for_index(self, highest: int) -> Index1:
        if self.multipliers is not None:
            return self
        return replace(self, multipliers="algebraic" if highest >= 2 else MULTIPLIERS[2 * (highest < 1)])

    def for_time(self, characteristic: float) -> Index1:
        return self if self.baumgarte is not None else replace(self, baumgarte=RATE / characteristic)

    def spec(self) -> FormSpec:
        alpha, beta = _pair(self.baumgarte if self.baumgarte is not None else 0.0)
        dotted, algebraic = self.multipliers in (None, "derivatives"), self.multipliers == "algebraic"
        rows = {"q": "q", "u": "u", "s": "s", "gdd": "lambda"}
        index = {"q": 1, "v": 1, "s": 1, "lambda": 1}
        numbers, eliminated = {VELOCITY: 2 * alpha, POSITION: beta**2}, self.multipliers == "eliminated"
        return FormSpec(self.label, index1_outputs, rows, ("lambda",), dotted, index, algebraic, self.waves, numbers=numbers,
                        eliminated=eliminated)  # fmt: skip


def _pair(value: Any) -> tuple[float, float]:
    """alpha and beta, equal where one number is given."""
    if not several(value):
        return (number(value, least=0),) * 2
    alpha, beta = (number(entry, least=0) for entry in array(value, (2,)))
    return alpha, beta
