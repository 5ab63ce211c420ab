"""Numbers of laws (masses, stiffnesses ...) that can be varied between runs without compiling the equations again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mbdae.errors import NotReadError, OptionError
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.base import Numbers
from mbdae.system.motion.workspace import Workspace

REMEDY = "build a scene for every value, and solve them one by one"


def numbers_of(workspace: Workspace, equations: Assembly, names: Sequence[str]) -> Numbers:
    """Slots of the numbers of laws by these names; "elbow.mass" stands for that number of all laws of the item elbow.

    workspace: evaluates y' = f(t, y) of `equations`. Raises OptionError where a number is not an input of every kernel that
    depends on it, because it is compiled in: a number of a tree that is 0, 1 or -1, or one that is part of a constant."""
    reads = frozenset[int]() if workspace.of_rates is None else workspace.of_rates.reads
    slots, of = list[int](), list[int]()
    for k, name in enumerate(names):
        found = _slots(equations, name)
        fixed = [slot for slot in found if slot not in reads]
        if fixed:
            raise NotReadError(f"numbers: {name} cannot vary in a batch: it has no effect on y', or is compiled in as a constant "
                               f"(as a number that is 0, 1 or -1 in the scene): {REMEDY}")  # fmt: skip
        slots += found
        of += [k] * len(found)
    return Numbers(workspace.W, np.array(slots, dtype=np.int64), np.array(of, dtype=np.int64))


def _slots(equations: Assembly, name: str) -> list[int]:
    """Slots of a number by its name "item.number", one for every law of the item that has it."""
    found = [(why, slot) for known, why, slot in _numbers(equations) if known == name]
    if not found:
        offered = sorted({known for known, why, _ in _numbers(equations) if not why})
        raise OptionError(f"numbers: {name} is no number of a law; those that may vary: {', '.join(offered) or 'none'}")
    for why, _ in found:
        if why:
            raise OptionError(f"numbers: {name} cannot be varied alone ({why}): {REMEDY}")
    return [slot for _, slot in found]


def _numbers(equations: Assembly) -> Iterator[tuple[str, str, int]]:
    """For every number of every law: its name, the reason why it cannot be varied alone ("" where it can), and its slot."""
    model = equations.model
    for g, i, instance in model.instances():
        law, derived = instance.law, model.groups[g].derived
        in_tree = any((g, i) in (*tree.members, *tree.joints) for tree in equations.moved.trees)
        constants = () if in_tree else equations.plan(derived).constant_inputs.parameters
        for number in instance.numbers:
            if number in law.params:
                part = number in constants or (derived.rows and not in_tree)
                why = "the equations contain constants computed from it" if part else ""
                why = "other numbers of its law are computed from it" if law.derived() else why
                yield f"{instance.item}.{number}", why, equations.numbering.slot(g, i, number)
