"""Gaps of contact laws at any states."""

from __future__ import annotations

from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Force
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.motion.states import States


def gap_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Gap (m) and rate (m/s) of every place of contact."""
    if not isinstance(d.law, Force):
        return []
    pairs = d.law.gaps(*d.sides)
    resolve, name = d.variation.resolve, d.variation.name
    return [((what, i), resolve(name(e))) for i, pair in enumerate(pairs) for what, e in zip(("gap", "rate"), pair, strict=True)]


def gaps_of(mechanics: States, t: Array, q: Array, u: Array) -> dict[str, tuple[Array, Array]]:
    """By item: gaps (m) and rates (m/s) of its places of contact at states (nt,), (nt, places) each."""
    found = {}
    for g, _, values in mechanics.evaluate(gap_outputs, t, q, u):
        for i, instance in enumerate(mechanics.model.groups[g].instances):
            found[instance.item] = values[:, i, ::2], values[:, i, 1::2]
    return found
