"""Nodes of beams that share their displacement: a joint through both of them needs no translation rows.

The paper's models count no multipliers for translations: end nodes of links that meet in a joint are one point. Where a
joint lies exactly on two nodes, the second takes the displacement unknowns of the first; where it lies on the ground,
the node's displacement is a constant.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mbdae.scene.components import Array
from mbdae.system.model import Instance, Model
from mbdae.system.nodes import Node

ON = 1e-13  #: of the scene's length: a joint that lies on a node
ROWS = ("x", "y", "z")


@dataclass(frozen=True)
class Sharing:
    """owner: node -> the node whose displacement it takes; fixed: node -> its constant position; rows not needed."""

    owner: dict[str, Node] = field(default_factory=dict)
    fixed: dict[str, Array] = field(default_factory=dict)
    rows: frozenset[tuple[int, int, int]] = frozenset()

    @property
    def nodes(self) -> set[str]:
        """Names of the nodes without displacement unknowns of their own."""
        return self.owner.keys() | self.fixed.keys()


def shared_displacements(model: Model, excluded: set[Node], dropped: frozenset[tuple[int, int]]) -> Sharing:
    """The joints of a model with beams whose translation rows are met by sharing; excluded: nodes that are carried."""
    leader: dict[Node, Node] = {n: n for n in model.nodes}
    pinned: dict[Node, Array] = {}
    order = {n: i for i, n in enumerate(model.nodes)}

    def find(n: Node) -> Node:
        while leader[n] is not n:
            n = leader[n]
        return n

    rows: set[tuple[int, int, int]] = set()
    for g, i, instance in model.instances() if model.lines else ():
        names, ends = model.groups[g].derived.rows, [n for n in instance.nodes[:2] if n is not None]
        if (g, i) in dropped or not {"x", "y"} <= set(names) or excluded & set(ends) or not _on_both(model, instance):
            continue
        first, *others = sorted({find(n) for n in ends}, key=lambda n: order[n])
        if len(ends) == 1 and first not in pinned:
            pinned[first] = np.asarray(instance.law.at, dtype=float)
        elif len(ends) == 2 and others and not (first in pinned and others[0] in pinned):
            leader[others[0]] = first
            if others[0] in pinned:
                pinned[first] = pinned.pop(others[0])
        elif others or len(ends) == 1:
            continue  # held at two points of the ground: the rows say more than sharing could
        rows |= {(g, i, names.index(name)) for name in ROWS if name in names}
    fixed = {n.name: pinned[find(n)] for n in model.nodes if find(n) in pinned}
    owner = {n.name: find(n) for n in model.nodes if find(n) is not n and n.name not in fixed}
    return Sharing(owner, fixed, frozenset(rows))


def _on_both(model: Model, instance: Instance) -> bool:
    """Whether the joint lies on the nodes of both sides (on one where the other is the ground), at least one of a beam."""
    stations = {n for line in model.lines for n in line.nodes}
    if not stations & set(instance.nodes[:2]):
        return False
    offsets = [np.array([instance.numbers[f"{side}_p{i}"] for i in (1, 2, 3)])
               for side, node in zip("kl", instance.nodes, strict=False) if node is not None]  # fmt: skip
    return all(float(np.max(np.abs(p))) <= ON * model.length for p in offsets)
