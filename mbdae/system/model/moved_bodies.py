"""The inputs of time of a model: the instants at which they break, and how fast they vary in between.

Bodies moved by joint coordinates: the trees of recursive joints in the equations, with the slots of their kernels.

Laws between bodies of one tree are part of its kernels; all others are outside of it. Where no law outside acts on the bodies of
a tree, its kernels are evaluated like those of any law. Otherwise the nodes on which laws outside act are called loaded: their
motion is evaluated first, the laws outside read it, and the tree's kernel projects their forces on the joint coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.inputs.breaks import TOLERANCE, switches
from mbdae.inputs.resolution import LongestStep, Stretches, resolved
from mbdae.inputs.timed import sided, split, used
from mbdae.kernels.tree_passes import TreePasses
from mbdae.kernels.tree_plan import Piece, TreePlan, tree_plan
from mbdae.native.program import Operations
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Force
from mbdae.symbolic.links import directions
from mbdae.symbolic.outputs import insert, loads
from mbdae.symbolic.tree_motion import Open
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.model.model import Model
from mbdae.system.model.nodes import Instance, Node
from mbdae.system.model.numbering import Numbering, Row
from mbdae.system.model.shared_nodes import Sharing, shared_displacements
from mbdae.system.model.trees import Place, Tree

#: steps over a table are bounded so that their error of its value is at most this share of the accuracy of the run times the
#: range of the values
SHARE = 0.02


@dataclass(frozen=True)
class Timeline:
    """What the inputs of time require of the steps of a run. A break is an instant at which an input or one of its derivatives
    jumps: a step has to end there.

    edges (k+2,): start, breaks and end of the run, s; stretches: consecutive intervals, each about as long as the shortest change
    of an input in it; a step must not exceed them."""

    edges: Array
    stretches: Stretches

    @property
    def breaks(self) -> Array:
        """Instants (k,) inside the run at which an input or one of its derivatives may jump."""
        return self.edges[1:-1]

    def longest_step(self, share: float = 1.0) -> LongestStep | None:
        """Function of the time that returns the longest step (s) allowed from there: `share` times the stretch in which it lies.
        None where share is 1 and the breaks alone limit steps."""
        if share == 1 and not self.varies:
            return None
        return LongestStep(self.stretches.edges, share, self.stretches.kinks)

    @property
    def varies(self) -> bool:
        """Whether some input varies within a stretch that is shorter than the intervals between breaks."""
        return len(self.stretches.edges) > len(self.edges) or len(self.stretches.kinks) > 0

    def summary(self) -> str:
        """A line for the output of `Scene.check`: breaks, kinks and the fastest change of the inputs."""
        found = []
        if len(self.breaks):
            found.append(f"{len(self.breaks)} break{'s' * (len(self.breaks) > 1)}, the first at t = {self.breaks[0]:.6g} s")
        kinks = self.stretches.kinks
        if len(kinks):
            found.append(f"{len(kinks)} kink{'s' * (len(kinks) > 1)} of tables, the first at t = {kinks[0]:.6g} s")
        if self.varies:
            finest, where = self.stretches.finest
            found.append(f"finest change within {finest:.2g} s, at t = {where:.6g} s")
        return "; ".join(found) or "smooth, no breaks"


def expressions_of(model: Model) -> tuple[Expr, ...]:
    """Every expression of time in a model, each once."""
    found = [e for g, _, instance in model.instances() for value in instance.timed.values()
             for e in used(value, by_rates(model.groups[g].derived))]
    found += [se.sympify(value) for line in model.lines for value in line.timed.values()]
    return tuple(dict.fromkeys(found))


def by_rates(d: Derived) -> bool:
    """Whether the equations of a law contain time derivatives of its inputs: a prescribed motion does, or a damper one end of
    which an input moves."""

    def in_loads() -> bool:
        rates = set(d.variation.clock.values())
        return any(rates & e.free_symbols for e in insert(d, [e for _, e in loads(d)]))

    return bool(d.rows) or bool(d.noted(f"{__name__}.by_rates", in_loads))


def timeline(model: Model, t0: float, t1: float, accuracy: float | None = None) -> Timeline | None:
    """The timeline of a run from t0 to t1 (s); None where no input of time switches or limits steps. accuracy: that of the run,
    None where its steps are constant."""
    expressions = expressions_of(model)
    if not expressions:
        return None
    found = Timeline(*resolved(expressions, t0, t1, TOLERANCE if accuracy is None else SHARE * accuracy))
    switching = any(switches(e) or split((sided(e),)).readings for e in expressions)
    return found if switching or found.varies else None


#: number of unknowns up to which a scene with constraint rows evaluates large trees joint by joint, with a full Jacobian; with
#: more, kinematic joints with a sparse Jacobian cost less
MOST_FULL = 600
#: squared number of components of the acceleration of a body (36 in space, 9 in the plane), summed over the bodies of a tree, up
#: to which the passes over the tree are one function: 4 bodies in space, 16 in the plane. Measured of chains: y' takes 0.9 of the
#: time of functions of single joints with 16 bodies in the plane, the Jacobian a quarter (10 for 45 us); first runs take 0.43 for
#: 0.47 s with 4 bodies in space and 0.67 for 0.26 s with these 16, but 1.2 for 0.5 s with 8 in space, 1.2 for 0.3 s with 24
FUSED = 144
BESIDE_BEAMS = 360  #: the same up to which trees stay trees beside beams, with one function: 10 bodies in space, compiled in 2 s


def acting_on(instance: Instance) -> list[Node]:
    """The moving nodes that a law reads or acts on; of a force on a joint's own coordinate the node of this coordinate alone."""
    own = instance.law.own_coordinates and isinstance(instance.law, Force)
    return [n for n in (instance.nodes[len(instance.law.frames) :] if own else instance.nodes) if n is not None]


class MovedBodies:
    """The trees of a model. nodes: the nodes that they move; replaced: laws (group, instance) that their kernels contain; loaded:
    nodes among these on which other laws act; sharing: nodes of beams that share unknowns.

    ordered: whether the trees are evaluated joint by joint instead of by kernels of whole trees: one of them is large, and there
    are no beams; alone: whether in addition no constraint row remains besides the joints of the trees; open: which parameters
    are inputs of kernels, of laws outside of the trees too. ordered=False: by kernels of whole trees, however large."""

    def __init__(self, model: Model, trees: Sequence[Tree], share: bool = True, open: Open = Open.FEWEST,
                 ordered: bool | None = None) -> None:
        large = not model.lines and any(_size(tree) > FUSED for tree in trees)
        self.ordered, self.open = large if ordered is None else ordered, open
        self.nodes = dict.fromkeys(n for tree in trees for n in tree.moved_nodes)
        moved = set(self.nodes)
        inside = {place for tree in trees for place in (*tree.joints, *tree.members)}
        outside = [(g, i, acting_on(inst)) for g, i, inst in model.instances() if (g, i) not in inside]
        idle = {(g, i) for g, i, nodes in outside if nodes and all(n in moved and n.body is None for n in nodes)
                and not model.groups[g].key[1].feeds}
        loaded = {n for g, i, nodes in outside if (g, i) not in idle for n in nodes if n in moved}
        loaded |= {n for line in model.lines for n in line.nodes if n in moved}
        self.replaced = frozenset(inside | idle)
        self.alone = self.ordered and not _rows_left(model, self.replaced)
        self.loaded = tuple(n for n in self.nodes if n in loaded)
        not_shared = moved | {n for tree in trees for n in tree.nodes[1:] if n}
        self.sharing = shared_displacements(model, not_shared, self.replaced) if share else Sharing()
        self._take([tree.loaded(loaded) for tree in trees])

    def _take(self, trees: list[Tree]) -> None:
        """Take over trees with their numbers."""
        self.trees, self._constants = trees, dict[Any, int]()
        self.constants: list[float] = []  #: quaternions of the joints' axes, which are not among the numbers of the laws
        for tree in self.trees:
            for j, own in enumerate(tree.numbers, start=1):
                for name in (name for name in own if "_P" in name):
                    self._constants[tree.joints[0], f"link{j}", name] = len(self.constants)
                    self.constants.append(own[name])
        self._groups: dict[Any, list[Tree]] = {}
        for tree in self.trees:
            self._groups.setdefault(tree.structure, []).append(tree)

    @cached_property
    def shape(self) -> tuple[Any, ...]:
        """All but the numbers of its trees; nodes of beams may share unknowns."""
        return self.ordered, self.open, bool(self.sharing.nodes), self.replaced, tuple(tree.structure for tree in self.trees)

    def again(self, model: Model, last: Model) -> MovedBodies | None:
        """The same of a model that differs from `last`, whose these are, in numbers alone; None where kernels contain one of
        these."""
        if not self.trees:
            return self
        trees = [again for tree in self.trees if (again := tree.again(model, last)) is not None]
        if len(trees) < len(self.trees):
            return None
        made, named = copy(self), {n.name: n for n in model.nodes}
        made.nodes = dict.fromkeys(named[n.name] for n in self.nodes)
        made.loaded = tuple(named[n.name] for n in self.loaded)
        made._take(trees)
        return made

    def opened(self, model: Model, open: Open = Open.LAWS, ordered: bool | None = None) -> MovedBodies:
        """The same with the numbers of laws as inputs of kernels."""
        return MovedBodies(model, [tree.opened(open) for tree in self.trees], open=open, ordered=ordered)

    def written(self, model: Model) -> set[tuple[str, str]]:
        """Parameters (item, name) that are no inputs because their values are written into the kernels of a tree."""
        found = set()
        for tree in self.trees:
            parts: tuple[Any, ...] = (*tree.structure.links, *tree.structure.members)
            for place, part in zip((*tree.joints, *tree.members), parts, strict=True):
                item = model.groups[place[0]].instances[place[1]].item
                found |= {(item, name) for name, value in part.numbers if value is not None}
        return found

    def keeps(self, row: Row) -> bool:
        """Whether a constraint row stays in the equations: no recursive joint and no shared displacement satisfies it."""
        return (row.group, row.instance) not in self.replaced and (row.group, row.instance, row.row) not in self.sharing.rows

    def numbering(self, model: Model, rows: list[Row], blocks: tuple[str, ...], derivatives: bool = False,
                  loaded: bool = True, numbers: Mapping[str, float] | None = None) -> Numbering:
        """The numbering of the unknowns that remain. loaded: whether loaded nodes get slots for their motion; other arguments as
        in `Numbering`."""
        return Numbering(model, rows, blocks, derivatives, self.nodes, self.loaded if loaded else (), self.replaced,
                         self.constants, self.sharing, numbers or {})

    def plans(self) -> list[tuple[TreePlan, list[Tree]]]:
        """The plans of the kernels of whole trees, each with the trees of its structure; none where trees are evaluated joint by
        joint."""
        return [] if self.ordered else [(tree_plan(structure), trees) for structure, trees in self._groups.items()]

    def gather(self, numbering: Numbering, piece: Piece, trees: list[Tree]) -> NDArray[np.intp]:
        """(trees, inputs) slots that a kernel of trees of one structure reads."""
        return np.array([[self.slot(numbering, tree, p) for p in piece.inputs] for tree in trees], dtype=np.intp)

    def slot(self, numbering: Numbering, tree: Tree, place: tuple[Any, ...]) -> int:
        """Slot of an input of a tree's kernels; place: its meaning, see `TreeProgram.inputs`."""
        head, owner, name = place
        if head in ("q", "u", "up", "wu", "wq"):
            return slot_of(numbering, tree, place)
        if head == "clock":
            j, drive = next((j, drive) for j, c, drive in tree.driven if c == owner)
            g, i = tree.joints[j - 1]
            # where the coordinate is prescribed as a constant, its rates are read from the slot of the constant 0
            if drive in numbering.model.groups[g].instances[i].numbers:
                return numbering.slot(g, i, drive) if name == 0 else numbering.width - 1
            return numbering.slot(g, i, drive + ("", "_dot", "_ddot")[name])
        g, i = tree.joints[int(owner[4:]) - 1] if owner.startswith("link") else tree.members[int(owner[6:])]
        if "_P" in name:
            return numbering.further + self._constants[tree.joints[0], owner, name]
        return numbering.slot(g, i, name)


    def motion(self, part: Operations, numbering: Numbering, to: Callable[[Node, str, int], int]) -> None:
        """Append q, u and u' ("up") of all nodes that the trees move, in the slots to(node, head, i)."""
        for plan, trees in self.plans():
            piece = plan.motion_of_all
            values = piece.kernel.emit(part, self.gather(numbering, piece, trees))
            part.set([[to(tree.node(j), head, i) for head, j, i in piece.targets] for tree in trees], values)
        for tree in self.trees:
            if self.ordered:
                passes = self.passes(numbering, tree, quaternion=True)
                passes.outwards(part)
                passes.accelerations(part, lambda place, of=tree: slot_of(numbering, of, ("up", *place[1:])), given=True)  # type: ignore[misc]
                passes.write_motion(part, [j for j in passes.bodies if j], lambda j, head, i, of=tree: to(of.node(j), head, i))  # type: ignore[misc]
            driven = [(to(tree.node(-c), head, 0), self.slot(numbering, tree, ("clock", c, order)))
                      for _, c, _ in tree.driven for order, head in enumerate(("q", "u", "up"))]
            part.set([at for at, _ in driven], [slot for _, slot in driven])

    def passes(self, numbering: Numbering, tree: Tree, quaternion: bool = False,
               inertia: Mapping[tuple[Any, Any], int] | None = None) -> TreePasses:
        """The passes over a tree, whose inputs are in the slots of a numbering; other arguments as in `TreePasses`."""
        return TreePasses(tree.structure, lambda place: self.slot(numbering, tree, place), self.open, quaternion, inertia)


def _rows_left(model: Model, replaced: frozenset[Place]) -> int:
    """Number of constraint rows of the laws that no tree replaces."""
    return sum(len(model.groups[g].derived.rows) for g, i, _ in model.instances() if (g, i) not in replaced)


def _size(tree: Tree) -> int:
    return sum(len(directions(link.kind)) ** 2 for link in tree.structure.links)


def too_large(model: Model, moved: MovedBodies) -> dict[str, str]:
    """Joints of trees that are treated as kinematic because they would cost more, and why."""
    if model.lines:
        why = "beside beams the equations of its tree are one function, which for so many bodies costs more than kinematic joints"
        return {name: why for tree in moved.trees if _size(tree) > BESIDE_BEAMS for name in tree.names}
    carried = set(moved.nodes)
    left = _rows_left(model, moved.replaced)
    unknowns = 2 * left + sum(sum(n.kind.sizes) for n in model.nodes if n not in carried)
    if not left or unknowns <= MOST_FULL or not moved.ordered:
        return {}
    why = "beside constraints the Jacobian of large trees is full; kinematic joints, whose Jacobian is not, cost less here"
    return {name: why for tree in moved.trees if _size(tree) > FUSED for name in tree.names}


def acted_on_while_prescribed(moved: MovedBodies) -> dict[str, str]:
    """Joints of trees that are treated as kinematic because a law outside, such as a coupling, reads their prescribed coordinate;
    and why."""
    why = "a coupling reads its prescribed coordinate, which is no unknown where the joint is recursive"
    return {n.joint: why for n in moved.loaded if n.kind.of_joint}


def slot_of(numbering: Numbering, tree: Tree, place: tuple[Any, ...]) -> int:
    """Slot of the component place = (head, number of the node in the tree, i) of a tree's node; below n also its row of F."""
    return numbering.node_place(place[0], tree.node(place[1]), place[2])
