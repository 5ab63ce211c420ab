"""Radau IIA for F(t, y, y') = 0 of index up to 3: adaptive with a filtered embedded estimate, or constant step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from mbdae.errors import OptionError
from mbdae.integrators.base import set_tolerances
from mbdae.integrators.runge_kutta.method import CollocationMethod
from mbdae.integrators.runge_kutta.tables import CollocationTable, radau_table
from mbdae.values import number, set_option, whole

#: numbers of stages for which `orders` and `factors` were measured
STAGES = (2, 3, 5)


@dataclass(frozen=True)
class RadauIIA(CollocationMethod):
    """Radau IIA with 2, 3 or 5 stages: order 3, 5 or 9, stiffly accurate, index up to 3.

    stages  2, 3 or 5
    rtol    tolerance of the local error relative to each unknown (and to its scale, unless atol is given)
    atol    None, one number, or (n,)
    step    constant step in s: no error control; the last step is cut to end at t_end
    newton  with a constant step: tolerance of the stage equations, relative to each unknown and its scale; None: as small as
            round-off allows
    """

    stages: int = 3
    rtol: float | None = None
    atol: Any = None
    step: float | None = None
    newton: float | None = None

    factors: ClassVar[dict[str, dict[str, float]]] = {
        "RadauIIA(5)": {"GGL": 0.3, "Index3": 0.01, "Index1": 0.5, "ODE": 0.3, "DAE": 0.1},
        "RadauIIA(3)": {"GGL": 0.2, "Index3": 3e-3, "Index1": 0.2, "ODE": 0.2, "DAE": 0.03},
        "RadauIIA(2)": {"GGL": 0.01, "Index3": 3e-3, "Index1": 0.01, "ODE": 0.01, "DAE": 0.01},
    }
    orders: ClassVar[dict[str, dict[str, tuple[int, int, int]]]] = {
        "RadauIIA(5)": {"GGL": (9, 9, 5), "Index3": (9, 5, 4), "Index1": (9, 9, 9)},
        "RadauIIA(3)": {"GGL": (5, 5, 3), "Index3": (5, 3, 2), "Index1": (5, 5, 5)},
        "RadauIIA(2)": {"GGL": (3, 3, 2), "Index3": (3, 2, 1), "Index1": (3, 3, 3)},
    }
    highest_index: ClassVar[int] = 3
    word: ClassVar[str] = "radau"
    penetration_share: ClassVar[float] = 0.1
    tightest: ClassVar[dict[str, float]] = {"": 1e-11, "Index3": 1e-10, "DAE": 1e-11}

    def __post_init__(self) -> None:
        stages_offered = "Radau IIA is offered with 2 (order 3), 3 (order 5) or 5 (order 9) stages"
        set_option(self, "stages", whole, stages_offered, least=STAGES[0], most=STAGES[-1])
        if self.stages not in STAGES:
            raise OptionError(f"stages = {self.stages}: {stages_offered}")
        set_tolerances(self)
        set_option(self, "step", number, "give a positive number of seconds, or None for error control", above=0)
        newton = "give a value from 1e-15 to 1e-2 with a constant step, or rtol for an adaptive one"
        set_option(self, "newton", number, newton, least=1e-15, most=1e-2)
        if self.newton is not None and self.step is None:
            raise OptionError(f"newton = {self.newton:g} (the tolerance of Newton's iteration for constant steps) without a "
                              "step: give step= too, or rtol instead of newton for steps that adapt")  # fmt: skip

    @classmethod
    def variants(cls) -> list[RadauIIA]:
        """The method with 2, 3 and 5 stages."""
        return [cls(stages) for stages in STAGES]

    @classmethod
    def mapped(cls) -> list[RadauIIA]:
        """The method with 2 and 3 stages."""
        return [cls(2), cls(3)]

    @property
    def label(self) -> str:
        """Name with the number of stages."""
        return f"RadauIIA({self.stages})"

    @property
    def table(self) -> CollocationTable:
        """Coefficients on the right Radau points."""
        return radau_table(self.stages)
