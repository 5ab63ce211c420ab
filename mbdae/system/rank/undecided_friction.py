"""Joints whose friction follows from a reaction that redundant constraints leave undecided."""

from __future__ import annotations

import numpy as np
import symengine as se

from mbdae.symbolic.derive import Derived
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.rank.redundancy import RankReport


def normal_force_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Derivative of the normal force of a joint with friction by each of its multipliers, as a magnitude."""
    if not d.reactive:
        return []
    v = d.variation
    if not hasattr(d.law, "pressing"):  # a law of one's own: all its reactions count
        return [(("counts", j), se.Integer(1)) for j in range(len(d.rows))]
    pressing = [v.name(c) for c in d.law.pressing(*d.sides, d.reactions)]
    return [(("counts", j), v.resolve(sum(v.diff(c, s) ** 2 for c in pressing) ** 0.5)) for j, s in enumerate(d.multipliers)]


def undecided(mechanics: Mechanics, rank: RankReport, t: Array, q: Array) -> list[str]:
    """Joints whose friction needs a reaction that redundant constraints share, one sentence each."""
    if not (mechanics.reactive and rank.not_unique):
        return []
    shared = {(r.group, r.instance, r.row): r.name for r in rank.not_unique}
    found = []
    state = t, q[None], np.zeros((1, mechanics.nu))
    for g, p, values in mechanics.evaluate(normal_force_outputs, *state, groups=mechanics.reactive):
        for i, instance in enumerate(mechanics.model.groups[g].instances):
            rows = [shared[g, i, target[1]] for o, target in enumerate(p.targets)
                    if values[0, i, o] > 1e-9 and (g, i, target[1]) in shared]  # fmt: skip
            if rows:
                found.append(f"joint '{instance.item}': its friction follows from its reaction, but redundant constraints share "
                             f"that ({', '.join(rows)}); state a scene that is planar in the plane z = 0, replace joints of the "
                             f"loop by spherical ones, or for a prismatic joint give normal_force")  # fmt: skip
    return found
