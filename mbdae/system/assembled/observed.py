"""Values of expressions of sensors at given states, evaluated by the same code by which loads read sensors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.laws.control.observed import Observed, observed_value
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembled.switches import values_at_states
from mbdae.system.base import Array
from mbdae.system.model.groups import Groups
from mbdae.system.model.model import Model, entry_of
from mbdae.system.model.moved_bodies import MovedBodies


class Observer:
    """Evaluates expressions of sensors and of time: a call with times t (k,) and unknowns y (k, n) of any form returns their
    values (k, number of expressions)."""

    def __init__(self, model: Model, moved: MovedBodies, expressions: Sequence[Expr]) -> None:
        self.model, self.moved = model, moved
        groups = Groups()
        self._at: list[tuple[Any, int]] = []
        for n, e in enumerate(expressions):
            law = Observed(f"observed {n + 1}", value=e)
            key, instance = entry_of(model.scenery, law, (), (), law.name)
            groups.of(key).instances.append(instance)
            self._at.append((key, len(groups[key].instances) - 1))
        first = len(model.groups)
        self._numbers = {key: first + n for n, key in enumerate(groups)}
        self._extended = replace(model, groups=[*model.groups, *groups.values()])

    @cached_property
    def _values(self) -> tuple[Callable[[Array, Array], Array], Any]:
        """The function that evaluates all expressions, compiled when it is first needed, and the column of every expression in
        its result, which is in the order of kernels."""
        model = self._extended
        chosen = [(g, list(range(len(model.groups[g].instances)))) for g in self._numbers.values()]
        counts = dict(zip(self._numbers, np.cumsum([0, *(len(active) for _, active in chosen)])[:-1], strict=True))
        order = np.array([counts[key] + i for key, i in self._at], dtype=np.intp)
        return values_at_states(model, self.moved, chosen, observed_value), order

    def __call__(self, t: Array, y: Array) -> Array:
        values, order = self._values
        found: Array = values(np.asarray(t, dtype=float), y)[:, order]
        return found
