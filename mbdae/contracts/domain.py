"""Values of the coordinates of a joint for which its motion is defined."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import symengine as se

from mbdae.errors import OptionError
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.motion import real_value, symbolic_motion
from mbdae.symbolic.vectors import Expr

DRAWS = 200  #: number of random values of the coordinates that are tried before a motion is refused as nowhere defined
#: a motion counts as defined where its rotations (rad) and displacements (m) and their first and second derivatives by the
#: coordinates are below this: beyond it rounding errors are larger than the errors that the contracts allow
LARGEST = 1e6


def value(e: Expr, numbers: Mapping[str, float]) -> float:
    """An expression at values of its symbols by name; NaN where it is not real or not finite."""
    found = real_value(e.subs({se.Symbol(name): number for name, number in numbers.items()}))
    return found if np.isfinite(found) else np.nan


class Domain:
    """Where the motion of a joint and its first two derivatives by the coordinates are finite and real."""

    def __init__(self, law: Any) -> None:
        motion = symbolic_motion(law) if isinstance(law, Joint) else None
        self.law, self.needed = law, list[Expr]()
        for step in motion.steps if motion is not None else ():
            self.needed.append(step.amount)
            for c in law.scalars():
                slope = step.amount.diff(se.Symbol(c))
                self.needed += [slope, *(slope.diff(se.Symbol(other)) for other in law.scalars())]
        self.needed = [e for e in dict.fromkeys(self.needed) if e.free_symbols]

    def holds(self, numbers: Mapping[str, float]) -> bool:
        """Whether the motion is defined at values of coordinates and parameters by name."""
        return all(abs(value(e, numbers)) < LARGEST for e in self.needed)

    def inside(self, numbers: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
        """Random coordinates for which the motion is defined, to replace those in `numbers`; empty where the motion is defined
        for those already. Raises OptionError where none are found."""
        if self.holds(numbers):
            return {}
        for n in range(DRAWS):
            reach = 3.0 * 0.97**n
            drawn = {c: float(rng.uniform(-reach, reach)) for c in self.law.scalars()}
            if self.holds({**numbers, **drawn}):
                return drawn
        name = type(self.law).__name__
        given = ", ".join(f"{p} = {numbers[p]:.3g}" for p in self.law.params if p in numbers and p not in self.law.derived())
        if given:
            raise OptionError(f"the motion of {name} cannot be evaluated: it is finite and real at none of {DRAWS} random values "
                              f"of its coordinates with {given}; give values of its parameters, as in mb.selftest({name}, "
                              f"parameter=value)")  # fmt: skip
        raise OptionError(f"the motion of {name} cannot be evaluated: it is finite and real at none of {DRAWS} random values of "
                          f"its coordinates; state it by functions that are defined near 0")  # fmt: skip
