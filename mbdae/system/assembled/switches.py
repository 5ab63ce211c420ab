"""Arguments u of functions in laws that switch where u changes its sign, or that vary only within a narrow range of u, as
functions of the unknowns of any form: solvers watch them so that no step passes such a change unnoticed."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.kernels import plan
from mbdae.symbolic.switches import switch_kinds, switch_outputs
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array, Switches
from mbdae.system.model.groups import Instance
from mbdae.system.model.model import Model
from mbdae.system.model.moved_bodies import MovedBodies
from mbdae.system.model.numbering import Numbering
from mbdae.system.motion.ordered_motion import OrderedBodies
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
    """Weight of an argument, see `Switches`: |exponent| of a power, with the numbers of this instance inserted; 1 for an exponent
    that varies, and for all other functions, where `stated` is 1."""
    exponent = stated.subs(dict(instance.numbers))
    return 1.0 if exponent.free_symbols else abs(float(exponent))


class _Arguments:
    """The function (t (k,), y (k, n)) -> arguments (k, na) of all watched laws. watched: numbers of groups, each with the numbers
    of its instances."""

    def __init__(self, model: Model, moved: MovedBodies, watched: list[tuple[int, list[int]]]) -> None:
        self.model, self.moved, self.watched = model, moved, watched

    @cached_property
    def _values(self) -> Callable[[Array, Array], Array]:
        """The function that evaluates all arguments; its kernels are compiled when it is first needed."""
        return values_at_states(self.model, self.moved, self.watched, switch_outputs)

    def __call__(self, t: Array, y: Array) -> Array:
        return self._values(t, y)


def values_at_states(model: Model, moved: MovedBodies, watched: list[tuple[int, list[int]]],
                     outputs: Any) -> Callable[[Array, Array], Array]:  # fmt: skip
    """The function (t (k,), y (k, n) of any form) -> outputs (k, no) of the watched laws. watched: numbers of groups, each with
    the numbers of its instances; outputs: selects outputs of a law. Where the laws read bodies that recursive joints move, the
    motion of these is evaluated first."""
    needed = {node for g, active in watched for i in active for node in model.groups[g].instances[i].nodes if node}
    carried = bool(needed & set(moved.nodes))
    bodies = OrderedBodies(model, moved) if carried and moved.ordered else None
    if bodies is not None:
        nb = Numbering(model, [], (), False, replaced=moved.replaced)
    else:
        nb = Numbering(model, [], (), False, moved.nodes, moved.nodes if carried else (), moved.replaced, moved.constants,
                       moved.sharing)  # fmt: skip
    plans = [plan(model.groups[g].derived, outputs) for g, _ in watched]
    gathers = [nb.gather(g, p.all_inputs, active) for p, (g, active) in zip(plans, watched, strict=True)]
    values = Values(nb, motion_of_all(moved, nb) if carried else (), gathers, [p.kernel for p in plans])
    if bodies is None:
        return values.at_states
    first, count = bodies.nq + bodies.nu, len(nb.states)

    def of_all_nodes(t: Array, y: Array) -> Array:
        return values.at_states(t, np.concatenate([*bodies.states(t, y), y[:, first : first + count]], axis=1))

    return of_all_nodes


def motion_of_all(moved: MovedBodies, nb: Numbering) -> Loaded:
    """Kernels of the motion of every node that joint coordinates move, each with the slots that it reads and those of its values,
    from which the laws read the motion."""
    pieces = []
    for p, trees in moved.plans():
        piece = p.motion_of_all
        places = [[nb.node_place(head, tree.node(j), i) for head, j, i in piece.targets] for tree in trees]
        pieces.append((piece, moved.gather(nb, piece, trees), np.array(places, dtype=np.intp)))
    return pieces
