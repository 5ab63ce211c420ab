"""Methods with constant steps: given, or found from an accuracy by runs with two different steps."""

from __future__ import annotations

from copy import copy
from typing import Any, ClassVar, Self

from mbdae.errors import OptionError
from mbdae.integrators.base import ACCURACY, DEFAULT_ACCURACY, Asked, Solver
from mbdae.integrators.distance import scaled_distance
from mbdae.integrators.halving import ALGEBRAIC, halved
from mbdae.integrators.second_method import second_method
from mbdae.integrators.solution import Solution
from mbdae.system.base import Array, System
from mbdae.values import number, option, set_option, text


class Stepped(Solver):
    """Base of methods with the options `step` and `accuracy`, of which one may be given. order: the errors of positions and
    velocities fall with step**order."""

    step: float | None
    accuracy: float | None
    order: ClassVar[int]

    @property
    def fixed(self) -> bool:
        """Whether a step is given."""
        return self.step is not None

    @property
    def by_steps(self) -> bool:
        """True: these methods reach an accuracy by shorter constant steps."""
        return True

    def _set_step(self) -> None:
        set_option(self, "step", number, "give a positive number of seconds, or None", above=0)
        set_option(self, "accuracy", number, f"{ACCURACY}, or None", above=0, most=1)
        if self.step is not None and self.accuracy is not None:
            raise OptionError(f"step = {self.step:g} and accuracy = {self.accuracy:g}: give one of the two")

    def at_accuracy(self, accuracy: float, form_label: str) -> Self:
        """This method with steps shortened until its error is below `accuracy`; unchanged where the step is given."""
        if self.fixed:
            return self
        option("form_label", form_label, text, "give the label of a form, such as 'GGL'")
        return self._with(accuracy=option("accuracy", accuracy, number, ACCURACY, above=0, most=1))

    def with_step(self, step: float) -> Self:
        """This method with a constant step, s."""
        return self._with(step=step, accuracy=None)

    def _with(self, **options: Any) -> Self:
        """A copy with other values of some options. The constructor is not called again, so that attributes that a user's own
        constructor has set are kept."""
        made = copy(self)
        for name, value in options.items():
            object.__setattr__(made, name, value)
        return made

    def run(self, system: System, asked: Asked) -> Solution:
        """Integrate with the given step, or with steps shortened until the error of all unknowns but multipliers, over their
        scale, is below `accuracy` (1e-6 where none is given)."""
        if self.fixed:
            return super().run(system, asked)
        goal = self.accuracy if self.accuracy is not None else DEFAULT_ACCURACY

        def measure(t: Array, a: Array, b: Array) -> Array:
            return scaled_distance(system, a, b, ALGEBRAIC)

        second = second_method(self, system, asked, goal, measure)
        return halved(self, system, asked, goal, measure, second).solution
