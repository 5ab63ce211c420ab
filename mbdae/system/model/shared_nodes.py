"""The clock of a scene: it evaluates everything that is prescribed as a function of time, by reading tables and by one kernel for
all expressions.

Nodes of beams that share unknowns, so that the joint between them needs no translation rows, or a weld no rows at all.

Where a joint that fixes a point lies exactly on two nodes, these have the same position: the second node uses the displacement
unknowns of the first. Where the joint connects a node with the ground, its displacement is constant. A weld between nodes with
equal axes shares the rotation unknowns in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from mbdae.inputs import timed
from mbdae.kernels import Kernel
from mbdae.native.program import Operations
from mbdae.scene.models import leader
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.model.model import Model
from mbdae.system.model.nodes import Instance, Node, drawn_quaternion


class Clock:
    """Evaluates `expressions` of two times: the time itself, and the one at which conditions such as t < 1 are evaluated
    (`timed.sided`), so that a step that ends at a switch stays on one side of it."""

    def __init__(self, expressions: tuple[Expr, ...]) -> None:
        self.expressions = expressions
        self._split = timed.split(expressions)
        self._kernel = Kernel([timed.TIME, timed.SIDE, *self._split.symbols], self._split.expressions)

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


ON = 1e-13  #: a joint counts as lying on a node where no coordinate differs by more, over the scene's length
EQUAL = 1e-13  #: difference of the angles (rad), or of a component of the quaternions, up to which axes of nodes count as equal
ROWS = ("x", "y", "z")


@dataclass(frozen=True)
class Sharing:
    """Which nodes share unknowns. displacement_of: name of a node -> the node whose displacement unknowns it uses;
    fixed_position: name of a node -> its constant position; rotation_of, fixed_rotation: the same for rotations (quaternion, or
    angle in the plane); rows: group, instance and row number of the constraint rows that are satisfied because of the sharing."""

    displacement_of: dict[str, Node] = field(default_factory=dict)
    fixed_position: dict[str, Array] = field(default_factory=dict)
    rows: frozenset[tuple[int, int, int]] = frozenset()
    rotation_of: dict[str, Node] = field(default_factory=dict)
    fixed_rotation: dict[str, Array] = field(default_factory=dict)

    @cached_property
    def nodes(self) -> set[str]:
        """Names of the nodes without displacement unknowns of their own."""
        return self.displacement_of.keys() | self.fixed_position.keys()

    def has(self, name: str) -> bool:
        """Whether a node of this name has fewer unknowns than its kind."""
        return name in self.nodes or name in self.turned

    @cached_property
    def turned(self) -> set[str]:
        """Names of the nodes without rotation unknowns of their own."""
        return self.rotation_of.keys() | self.fixed_rotation.keys()


def shared_displacements(model: Model, excluded: set[Node], replaced: frozenset[tuple[int, int]]) -> Sharing:
    """The nodes of a model with beams that share unknowns, and the joint rows thus satisfied. excluded: nodes of recursive
    joints, which share nothing; replaced: laws (group, instance) that are part of a tree."""
    leads: dict[Node, Node] = {}
    pinned: dict[Node, Array] = {}
    order = {n: i for i, n in enumerate(model.nodes)}
    rows: set[tuple[int, int, int]] = set()
    welded: list[tuple[int, int, list[Node]]] = []
    for g, i, instance in model.instances() if model.lines else ():
        names, ends = model.groups[g].derived.rows, [n for n in instance.nodes[:2] if n is not None]
        if model.groups[g].derived.reactive:
            continue  # its friction depends on the multipliers of its rows, so that these have to stay
        if (g, i) in replaced or not {"x", "y"} <= set(names) or excluded & set(ends) or not _on_both(model, instance):
            continue
        first, *others = sorted({leader(n, leads) for n in ends}, key=lambda n: order[n])
        if len(ends) == 1 and first not in pinned:
            pinned[first] = np.asarray(instance.law.at, dtype=float)
        elif len(ends) == 2 and others and not (first in pinned and others[0] in pinned):
            leads[others[0]] = first
            if others[0] in pinned:
                pinned[first] = pinned.pop(others[0])
        elif others or len(ends) == 1:
            continue  # all ends are already fixed to the ground, so that these rows constrain the beams
        rows |= {(g, i, names.index(name)) for name in ROWS if name in names}
        if instance.law.welds:
            welded.append((g, i, ends))
    fixed_position = {n.name: pinned[leader(n, leads)] for n in model.nodes if leader(n, leads) in pinned}
    displacement_of = {n.name: leader(n, leads) for n in model.nodes if n in leads and n.name not in fixed_position}
    rotation_of, fixed_rotation, more = _shared_rotations(model, welded)
    return Sharing(displacement_of, fixed_position, frozenset(rows | more), rotation_of, fixed_rotation)


def _shared_rotations(model: Model, welded: list[tuple[int, int, list[Node]]],
                      ) -> tuple[dict[str, Node], dict[str, Array], set[Any]]:
    """Nodes that use the rotation unknowns of another node, nodes whose rotation is fixed as drawn, and the rows of welds thus
    satisfied. welded: group, instance and nodes of every weld whose nodes share displacements."""
    leads: dict[Node, Node] = {}
    fixed_rotation: dict[Node, Array] = {}
    rows: set[Any] = set()
    order = {n: i for i, n in enumerate(model.nodes)}
    for g, i, ends in welded:
        first, *others = sorted({leader(n, leads) for n in ends}, key=lambda n: order[n])
        if len(ends) == 1 and first not in fixed_rotation:
            fixed_rotation[first] = _drawn(first)
        elif len(ends) == 2 and others and others[0] not in fixed_rotation and _alike(*ends):
            leads[others[0]] = first
        else:
            continue
        names = model.groups[g].derived.rows
        rows |= {(g, i, r) for r, name in enumerate(names) if name not in ROWS}
    kept = {n.name: fixed_rotation[leader(n, leads)] for n in model.nodes if leader(n, leads) in fixed_rotation}
    return {n.name: leader(n, leads) for n in leads if n.name not in kept}, kept, rows


def _drawn(node: Node) -> Array:
    """Angle (1,) or quaternion (4,) of a node as drawn."""
    assert node.body is not None
    return np.array([node.body.heading]) if node.kind is NodeKind.PLANAR else drawn_quaternion(node.body)


def _alike(a: Node, b: Node) -> bool:
    """Whether two nodes have rotation unknowns of the same kind and equal axes as drawn."""
    return a.kind is b.kind and a.kind.turns and bool(np.max(np.abs(_drawn(a) - _drawn(b))) <= EQUAL)


def _on_both(model: Model, instance: Instance) -> bool:
    """Whether the point of a joint is exactly at the nodes of both sides (the ground is no node), at least one of them of a
    beam."""
    stations = {n for line in model.lines for n in line.nodes}
    if not stations & set(instance.nodes[:2]):
        return False
    offsets = [np.array([instance.numbers[f"{side}_p{i}"] for i in (1, 2, 3)])
               for side, node in zip("kl", instance.nodes, strict=False) if node is not None]
    return all(float(np.max(np.abs(p))) <= ON * model.length for p in offsets)
