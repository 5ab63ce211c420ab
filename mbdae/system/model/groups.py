"""Laws of a model in groups: laws of one class and structure between nodes of the same kinds, evaluated by one kernel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import nan
from typing import Any

import numpy as np

from mbdae.scene.components import Array
from mbdae.symbolic.derive import Derived, Side, derive
from mbdae.symbolic.law import Structure
from mbdae.symbolic.stated import motion_key
from mbdae.system.model.nodes import Node

Key = tuple[Any, Structure, tuple[Side, ...]]  #: class of a law, its structure, kinds of nodes and axes of its frames


@dataclass
class Instance:
    """One law of the scene with the nodes it acts between (None: the ground). numbers: points and axes of its frames and its
    constant parameters, by name; signals: of these the values of signals, with their names; item: of the joint, force or body."""

    law: Any
    nodes: tuple[Node | None, ...]
    numbers: dict[str, float]
    timed: dict[str, Any]  #: parameter -> expression of time
    item: str
    states: tuple[str, ...] = ()  #: names of other items whose internal state the law reads
    signals: Mapping[str, str] = field(default_factory=dict)


@dataclass
class Group:
    """All laws of one class and structure between nodes of the same kinds: one kernel evaluates them. derived: the expressions
    derived from what the law stated when the model was made, which all instances share."""

    key: Key
    derived: Derived
    instances: list[Instance] = field(default_factory=list)

    @cached_property
    def motion(self) -> object:
        """What stands for the motion of a joint, see `motion_key`."""
        return motion_key(*self.key[:2])

    @cached_property
    def side_numbers(self) -> dict[str, int]:
        """Name of a frame -> position of its node in `Instance.nodes`."""
        return {f.side: n for n, f in enumerate(self.derived.frames)}

    @cached_property
    def names_of_numbers(self) -> dict[str, int]:
        """Name of a number of the laws -> its column in `numbers`."""
        return {name: n for n, name in enumerate(dict.fromkeys(name for i in self.instances for name in i.numbers))}

    @cached_property
    def numbers(self) -> Array:
        """(instances, names) numbers of its laws; NaN where a law has none of that name."""
        names = self.names_of_numbers
        rows = [[i.numbers.get(name, nan) for name in names] for i in self.instances]
        return np.array(rows, dtype=float).reshape(len(rows), len(names))

    def side(self, name: str) -> list[Node]:
        """Of every instance the node of the frame `name`."""
        n = self.side_numbers[name]
        return [i.nodes[n] for i in self.instances]  # type: ignore[misc]


class Groups(dict[Key, Group]):
    """Groups by their keys. A law is derived when the first of its group is added."""

    def of(self, key: Key) -> Group:
        """The group with a key, made where there is none."""
        found = self.get(key)
        if found is None:
            found = self[key] = Group(key, derive(*key))
        return found
