"""The clock of a scene: it evaluates everything that is prescribed as a function of time, by reading tables and by one kernel for
all expressions."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from mbdae.inputs import timed
from mbdae.kernels import Kernel
from mbdae.native.program import Operations
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array


class Clock:
    """Evaluates `expressions` of two times: the time itself, and the one at which conditions such as t < 1 are evaluated
    (`timed.sided`), so that a step that ends at a switch stays on one side of it."""

    def __init__(self, expressions: tuple[Expr, ...]) -> None:
        self.expressions = expressions
        self._split = timed.split(expressions)
        self._kernel = Kernel([timed.TIME, timed.SIDE, *self._split.symbols], self._split.expressions)

    def values(self, inputs: Array) -> Array:
        """Values (k, expressions) at inputs (k, 2): time, and time at which conditions are evaluated."""
        return self._kernel.values(self._split.with_lookups(inputs))

    def emit(self, part: Operations, at: int, first: int) -> None:
        """Append the clock to a native program. It writes its values into the slots from `first` on; slot `at` holds the time,
        the next one the time at which conditions are evaluated."""
        read: dict[tuple[str, float, float, int], int] = {}
        slots = [at, at + 1]
        for (table, order), a, b, column in self._split.readings:
            key = table.name, a, b, column
            if key not in read:
                read[key] = part.lookup(table.packed, at + column, at + 1, a, b)
            slots.append(read[key] + order)
        self._kernel.emit(part, np.array([slots]), first)


@lru_cache(maxsize=64)
def clock(expressions: tuple[Expr, ...]) -> Clock:
    """The clock of some expressions; one object serves all numberings of a scene."""
    return Clock(expressions)
