"""Bodies moved by joint coordinates: the trees of recursive joints in the equations, with the slots of their kernels.

Where no law outside a tree acts on its bodies, its kernels are evaluated like those of any law. Otherwise the motion of those
bodies is evaluated first, the laws outside read it, and their forces on the bodies are projected on the joint coordinates by
the tree's kernel. Nodes on which laws outside act are called loaded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.kernels.tree_plan import MOST_SOLVED, Piece, TreePlan, tree_plan
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.tree import OPERATIONS
from mbdae.system.model.model import Instance, Model
from mbdae.system.model.nodes import Node
from mbdae.system.model.numbering import Numbering, Row
from mbdae.system.model.shared_nodes import Sharing, shared_displacements
from mbdae.system.model.trees import Place, Tree

#: number of unknowns up to which trees evaluated joint by joint beside constraint rows, with a full Jacobian, cost less than
#: kinematic joints with a sparse one
MOST_FULL = 600
SURELY = 64  #: number of a tree's velocities above which one kernel of the whole tree is not tried


def acting_on(instance: Instance) -> list[Node]:
    """The moving nodes a law reads and acts on; a force of a joint's own coordinate acts on that coordinate alone."""
    own = instance.law.own_coordinates and not isinstance(instance.law, Joint)
    return [n for n in (instance.nodes[len(instance.law.frames) :] if own else instance.nodes) if n is not None]


class MovedBodies:
    """The trees of a model: the nodes they move, the laws that their kernels replace, loaded nodes, nodes that share unknowns.

    ordered: the trees are evaluated joint by joint, not by a kernel of the whole tree; alone: and no constraint row is left."""

    def __init__(self, model: Model, trees: Sequence[Tree], share: bool = True, ordered: bool = False) -> None:
        self.ordered = ordered
        self.nodes = tuple(n for tree in trees for n in tree.moved_nodes)
        moved = set(self.nodes)
        inside = {place for tree in trees for place in (*tree.joints, *tree.members)}
        outside = [(g, i, acting_on(inst)) for g, i, inst in model.instances() if (g, i) not in inside]
        idle = {(g, i) for g, i, nodes in outside if nodes and all(n in moved and n.body is None for n in nodes)
                and not model.groups[g].key[1].feeds}  # fmt: skip
        loaded = {n for g, i, nodes in outside if (g, i) not in idle for n in nodes if n in moved}
        loaded |= {n for line in model.lines for n in line.nodes if n in moved}
        self.replaced = frozenset(inside | idle)
        self.alone = ordered and not _rows_left(model, self.replaced)
        self.loaded = tuple(n for n in self.nodes if n in loaded)
        self.trees = [tree.loaded(loaded) for tree in trees]
        not_shared = moved | {n for tree in trees for n in tree.nodes[1:] if n}
        self.sharing = shared_displacements(model, not_shared, self.replaced) if share else Sharing()
        self._constants: dict[Any, int] = {}
        self.constants: list[float] = []  #: quaternions of the joints' axes, which are not among the numbers of the laws
        for tree in self.trees:
            for j, own in enumerate(tree.numbers, start=1):
                for name in (name for name in own if "_P" in name):
                    self._constants[tree.joints[0], f"link{j}", name] = len(self.constants)
                    self.constants.append(own[name])
        self._groups: dict[Any, list[Tree]] = {}
        for tree in self.trees:
            self._groups.setdefault(tree.structure, []).append(tree)

    def keeps(self, row: Row) -> bool:
        """Whether a constraint row stays in the equations: no recursive joint and no shared displacement satisfies it."""
        return (row.group, row.instance) not in self.replaced and (row.group, row.instance, row.row) not in self.sharing.rows

    def numbering(self, model: Model, rows: list[Row], blocks: tuple[str, ...], derivatives: bool = False,
                  loaded: bool = True, numbers: Mapping[str, float] | None = None) -> Numbering:  # fmt: skip
        """The numbering of the remaining unknowns; without `loaded` no moved node has slots. numbers: parameters of the form."""
        return Numbering(model, rows, blocks, derivatives, self.nodes, self.loaded if loaded else (), self.replaced,
                         self.constants, self.sharing, numbers or {})  # fmt: skip

    def plans(self) -> list[tuple[TreePlan, list[Tree]]]:
        """The plans of trees that have kernels of their own, each with the trees of its structure."""
        return [] if self.ordered else [(tree_plan(structure), trees) for structure, trees in self._groups.items()]

    def gather(self, numbering: Numbering, piece: Piece, trees: list[Tree]) -> NDArray[np.intp]:
        """(trees, inputs) slots a kernel reads."""
        return np.array([[self.slot(numbering, tree, p) for p in piece.inputs] for tree in trees], dtype=np.intp)

    def slot(self, numbering: Numbering, tree: Tree, place: tuple[Any, ...]) -> int:
        """Slot of an input of a tree's kernels."""
        head, owner, name = place
        if head in ("q", "u", "up", "wu", "wq"):
            return slot_of(numbering, tree, place)
        if head == "clock":
            j, drive = next((j, drive) for j, c, drive in tree.driven if c == owner)
            g, i = tree.joints[j - 1]
            # the coordinate is prescribed as a constant, its rates are 0
            if drive in numbering.model.groups[g].instances[i].numbers:
                return numbering.slot(g, i, drive) if name == 0 else numbering.width - 1
            return numbering.slot(g, i, drive + ("", "_dot", "_ddot")[name])
        g, i = _instance(tree, owner)
        if "_P" in name:
            return numbering.further + self._constants[tree.joints[0], owner, name]
        return numbering.slot(g, i, name)


def by_order(model: Model, moved: MovedBodies) -> bool:
    """Whether trees are evaluated joint by joint: they are large, without beams, and no other law reads a coordinate that is
    prescribed. Beside constraints only where a kernel of the whole tree is too large, and the Jacobian, which is full, is not."""
    many = any(_freedoms(tree) > MOST_SOLVED for tree in moved.trees)
    if model.lines or acted_on_while_prescribed(moved):
        return False
    left = _rows_left(model, moved.replaced)
    if left:
        carried = set(moved.nodes)
        unknowns = 2 * left + sum(sum(n.kind.sizes) for n in model.nodes if n not in carried)
        return unknowns <= MOST_FULL and bool(too_large(moved))
    return many or bool(too_large(moved))


def _freedoms(tree: Tree) -> int:
    return sum(n.kind.sizes[1] for n in tree.coordinates)


def _rows_left(model: Model, replaced: frozenset[Place]) -> int:
    """Number of constraint rows of the laws that no tree replaces."""
    return sum(len(model.groups[g].derived.rows) for g, i, _ in model.instances() if (g, i) not in replaced)


def too_large(moved: MovedBodies) -> dict[str, str]:
    """Joints of trees whose equations take too many operations to be compiled at once, and why they stay kinematic."""
    found: dict[str, str] = {}
    for tree in moved.trees:
        try:
            if _freedoms(tree) > SURELY:
                raise OverflowError
            tree_plan(tree.structure)
        except OverflowError:
            why = (f"the equations of its tree of {len(tree.joints)} recursive joints take more than {OPERATIONS} operations, "
                   f"where compiling costs more than it saves: kinematic joints are as fast there")  # fmt: skip
            found |= dict.fromkeys(tree.names, why)
    return found


def acted_on_while_prescribed(moved: MovedBodies) -> dict[str, str]:
    """Joints of trees with a prescribed coordinate that a law outside reads, such as a coupling, and why they stay kinematic."""
    why = "a coupling reads its prescribed coordinate, which is no unknown where the joint is recursive"
    return {n.joint: why for n in moved.loaded if n.kind.of_joint}


def _instance(tree: Tree, owner: str) -> Place:
    return tree.joints[int(owner[4:]) - 1] if owner.startswith("link") else tree.members[int(owner[6:])]


def slot_of(numbering: Numbering, tree: Tree, place: tuple[Any, ...]) -> int:
    """Slot of an entry (head, node, i) of a tree's node; below n this is also its row of F."""
    return numbering.node_place(place[0], tree.node(place[1]), place[2])
