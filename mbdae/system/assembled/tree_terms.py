"""The trees of a scene in its equations: the motion of bodies on which other laws act, the rows of the joint coordinates, and
their accelerations; by the passes over every tree, or by kernels in which the passes over a small tree are one function."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mbdae.kernels.tree_passes import Place, TreePasses
from mbdae.kernels.tree_plan import Piece
from mbdae.native.program import Operations
from mbdae.system.assembled.jacobian_entries import Entries, Scatter
from mbdae.system.model.moved_bodies import MovedBodies, slot_of
from mbdae.system.model.numbering import Numbering
from mbdae.system.model.trees import Tree
from mbdae.system.motion.tree_mechanics import Inertia, own_inertia

Pivots = list[tuple[int, int]]  #: slots of the pivots of the mass matrix, each with the number of its velocity unknown


class TreeTerms:
    """Appends the trees of a scene to lists of operations. inertia: (row, column) -> entry of the mass matrix by laws outside of
    the trees."""

    def __init__(self, moved: MovedBodies, numbering: Numbering, operations: Operations, inertia: Inertia) -> None:
        self.moved, self.nb, self._operations = moved, numbering, operations
        self._own = [{pair: operations.constant([m]) for pair, m in own_inertia(numbering, tree, inertia).items()}
                     for tree in moved.trees]
        self._passes = [(moved.passes(numbering, tree, bool(tree.structure.loaded), own), tree)
                        for tree, own in zip(moved.trees, self._own, strict=True) if moved.ordered]
        self._plans = [plan for plan in moved.plans() if plan[0].structure.loaded]

    def motion(self, part: Operations, still: bool = False) -> None:
        """Append the motion of loaded nodes, and what the other methods read. still: without accelerations."""
        for plan, trees in self._plans:
            values = plan.forward.kernel.emit(part, self.moved.gather(self.nb, plan.forward, trees))
            part.set([[slot_of(self.nb, tree, t) for t in plan.forward.targets] for tree in trees], values)
        for passes, tree in self._passes:
            passes.outwards(part)
            if not still:
                passes.accelerations(part, self._at(tree, "up"), given=True)
            passes.write_motion(part, tree.structure.loaded, lambda j, head, i, of=tree: slot_of(self.nb, of, (head, j, i)),  # type: ignore[misc]
                                ("q", "u") if still else ("q", "u", "up"))

    def rows(self, part: Operations, first: int) -> None:
        """Append the rows of the trees' equations of motion, and corrections of the rates of their positions (form GGL); row 0 is
        in slot `first`."""
        for plan, trees in self.moved.plans():
            places = np.array([[slot_of(self.nb, tree, t) for t in plan.residual.targets] for tree in trees], dtype=np.intp)
            part.add(first + places, plan.residual.kernel.emit(part, self.moved.gather(self.nb, plan.residual, trees)))
        for passes, tree in self._passes:
            self._loads(part, passes, tree)
            passes.corrections(part, tree.structure.loaded, self._on_body(tree, "wq"), self._at(tree, "q", first))
            passes.balance(part, self._at(tree, "u", first))

    def rates(self, part: Operations, first: int) -> Pivots:
        """Append the accelerations of the trees' velocities: slots from `first` on, one for each unknown, hold the forces on the
        velocities before, and the accelerations after."""
        pivots: Pivots = []
        forces = part.slots(self.nb.nu)  # a copy, because slots that a kernel has read are read again by its derivative
        part.set(forces + np.arange(self.nb.nu), first + self.nb.nq + np.arange(self.nb.nu))
        for passes, tree in self._passes:
            rate, force = self._at(tree, "u", first), self._at(tree, "u", forces - self.nb.nq)
            self._loads(part, passes, tree)
            pivots += [(slot, force(place) - forces) for slot, place in passes.inwards(part, force)]
            passes.accelerations(part, rate)
        own = dict(zip(map(id, self.moved.trees), self._own, strict=True))
        for plan, trees in self.moved.plans():
            alike: dict[tuple[Any, ...], list[Tree]] = {}
            for tree in trees:
                alike.setdefault(tuple(own[id(tree)]), []).append(tree)
            for pairs, some in alike.items():
                piece = plan.rates(pairs)
                gather = [[self._read(tree, place, forces - self.nb.nq, own[id(tree)]) for place in piece.inputs]
                          for tree in some]
                values = piece.kernel.emit(part, np.array(gather, dtype=np.intp).reshape(len(some), -1))
                half = values.shape[1] // 2
                to = np.array([[self._at(tree, "u", first)(t) for t in piece.targets[:half]] for tree in some], dtype=np.intp)
                part.set(to, values[:, :half])
                pivots += zip(values[:, half:].ravel().tolist(), (to - first - self.nb.nq).ravel().tolist(), strict=True)
        return pivots

    def _read(self, tree: Tree, place: Place, first: int, own: Mapping[tuple[Place, Place], int]) -> int:
        if place[0] == "own":
            return own[place[1:]]
        return self._at(tree, "u", first)(place) if place[0] == "force" else self.moved.slot(self.nb, tree, place)

    def _at(self, tree: Tree, head: str, first: int = 0) -> Callable[[Place], int]:
        return lambda place: first + slot_of(self.nb, tree, (head, *place[1:]))

    def _on_body(self, tree: Tree, role: str) -> Callable[[int, int], int]:
        return lambda j, i: slot_of(self.nb, tree, (role, j, i))

    def _loads(self, part: Operations, passes: TreePasses, tree: Tree) -> None:
        passes.loads(part, tree.structure.loaded, self._on_body(tree, "wu"))


def add_derivatives(moved: MovedBodies, nb: Numbering, entries: Entries, single: Scatter) -> list[tuple[Piece, Any]]:
    """Add the entries of the Jacobian of trees whose passes are one function. Returns the kernels of trees with loaded nodes,
    with the slots that they read, for the chain rule; those of other trees are added to `single` like the kernels of any law."""
    found: list[tuple[Piece, Any]] = []
    for plan, trees in moved.plans():
        for piece in plan.jacobian:
            gather = moved.gather(nb, piece, trees)
            if plan.structure.loaded:
                found.append((piece, gather))
                entries.chain(piece, len(trees), lambda i, place, of=trees: slot_of(nb, of[i], place))  # type: ignore[misc]
                continue
            rows, columns = (np.array([[slot_of(nb, tree, pair[k]) for pair in piece.targets] for tree in trees], dtype=np.intp)
                             for k in (0, 1))
            single.kernel(gather, rows, piece.kernel)
            entries.varying(rows, columns)
    return found
