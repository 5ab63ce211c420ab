"""Values of expressions of sensors at states of any form: the statement that feeds loads, evaluated by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.kernels import plan
from mbdae.laws.control.observed import Observed, observed_value
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembled.switches import motion_of_all
from mbdae.system.base import Array
from mbdae.system.model.model import Group, Model, entry_of
from mbdae.system.model.moved_bodies import MovedBodies
from mbdae.system.model.numbering import Numbering
from mbdae.system.motion.workspace import Values


class Observer:
    """Expressions of sensors and of time, (count,), at times t (k,) and unknowns y (k, n) of any form: values (k, count)."""

    def __init__(self, model: Model, moved: MovedBodies, expressions: Sequence[Expr]) -> None:
        self.model, self.moved = model, moved
        groups: dict[Any, Group] = {}
        self._at: list[tuple[Any, int]] = []
        for n, e in enumerate(expressions):
            law = Observed(f"observed {n + 1}", value=e)
            key, instance = entry_of(model.scenery, law, (), (), law.name)
            groups.setdefault(key, Group(key)).instances.append(instance)
            self._at.append((key, len(groups[key].instances) - 1))
        first = len(model.groups)
        self._numbers = {key: first + n for n, key in enumerate(groups)}
        self._extended = replace(model, groups=[*model.groups, *groups.values()])

    @cached_property
    def _values(self) -> tuple[Values, Any]:
        """The kernels, compiled when they are first asked for, and the order of their values."""
        model, moved = self._extended, self.moved
        chosen = list(self._numbers.values())
        needed = {node for g in chosen for i in model.groups[g].instances for node in i.nodes if node}
        loaded = moved.nodes if needed & set(moved.nodes) else ()
        nb = Numbering(model, [], (), False, moved.nodes, loaded, moved.replaced, moved.constants, moved.sharing)
        plans = [plan(model.groups[g].derived, observed_value) for g in chosen]
        gathers = [nb.gather(g, p.all_inputs) for p, g in zip(plans, chosen, strict=True)]
        counts = np.cumsum([0, *(len(model.groups[g].instances) for g in chosen)])
        order = np.array([counts[chosen.index(self._numbers[key])] + i for key, i in self._at], dtype=np.intp)
        return Values(nb, motion_of_all(moved, nb) if loaded else (), gathers, [p.kernel for p in plans]), order

    def __call__(self, t: Array, y: Array) -> Array:
        values, order = self._values
        found: Array = values.at_states(np.asarray(t, dtype=float), y)[:, order]
        return found
