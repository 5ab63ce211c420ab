"""Arguments of functions in laws that switch or vary within a narrow range, from the unknowns of any form."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from mbdae.kernels import plan
from mbdae.symbolic.switches import switch_kinds, switch_outputs
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array, Switches
from mbdae.system.model.model import Instance, Model
from mbdae.system.model.moved_bodies import MovedBodies
from mbdae.system.model.numbering import Numbering
from mbdae.system.motion.workspace import Loaded, Values


def switches_of_model(model: Model, moved: MovedBodies) -> Switches | None:
    """The arguments of a model that solvers have to watch; None where there are none."""
    members = {place for tree in moved.trees for place in tree.members}
    watched = [(g, [i for i in range(len(group.instances)) if (g, i) not in moved.replaced or (g, i) in members])
               for g, group in enumerate(model.groups) if switch_kinds(group.derived)]  # fmt: skip
    watched = [(g, active) for g, active in watched if active]
    if not watched:
        return None
    found = [(model.groups[g].instances[i], s) for g, active in watched for i in active
             for s in switch_kinds(model.groups[g].derived)]  # fmt: skip
    kinds, names = tuple(kind for _, (kind, _) in found), tuple(instance.item for instance, _ in found)
    weights = np.array([_weight(instance, exponent) for instance, (_, exponent) in found])
    return Switches(_Arguments(model, moved, watched), kinds, weights, names)


def _weight(instance: Instance, stated: Expr) -> float:
    """Magnitude of the exponent of a power at the numbers of an instance; 1 where it varies and for everything else."""
    exponent = stated.subs(dict(instance.numbers))
    return 1.0 if exponent.free_symbols else abs(float(exponent))


class _Arguments:
    """(t (k,), y (k, n)) -> arguments (k, na): the kernels of all watched laws, after the motion of bodies moved by joints."""

    def __init__(self, model: Model, moved: MovedBodies, watched: list[tuple[int, list[int]]]) -> None:
        self.model, self.moved, self.watched = model, moved, watched

    @cached_property
    def _values(self) -> Values:
        """Compiled when they are first asked for."""
        model, moved, watched = self.model, self.moved, self.watched
        needed = {node for g, active in watched for i in active for node in model.groups[g].instances[i].nodes if node}
        loaded = moved.nodes if needed & set(moved.nodes) else ()
        nb = Numbering(model, [], (), False, moved.nodes, loaded, moved.replaced, moved.constants, moved.sharing)
        plans = [plan(model.groups[g].derived, switch_outputs) for g, _ in watched]
        gathers = [nb.gather(g, p.all_inputs, active) for p, (g, active) in zip(plans, watched, strict=True)]
        return Values(nb, motion_of_all(moved, nb) if loaded else (), gathers, [p.kernel for p in plans])

    def __call__(self, t: Array, y: Array) -> Array:
        return self._values.at_states(t, y)


def motion_of_all(moved: MovedBodies, nb: Numbering) -> Loaded:
    """The motion of every node moved by joint coordinates, written where the laws read it."""
    pieces = []
    for p, trees in moved.plans():
        piece = p.motion_of_all
        places = [[nb.node_place(head, tree.node(j), i) for head, j, i in piece.targets] for tree in trees]
        pieces.append((piece, moved.gather(nb, piece, trees), np.array(places, dtype=np.intp)))
    return pieces
