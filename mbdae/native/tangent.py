"""The derivative of a list of operations along a direction, as operations on the same array.

The derivative (differential) of the number in slot k is put into slot k + distance, where distance is the number of slots that
the list had; that of a constant is 0. The operations of the derivative run after those of the list and read their slots again: a
slot that a kernel has read must not be overwritten later in the list.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from mbdae.errors import internal
from mbdae.native.program import ADD, CALL, CHOLESKY, LOAD, MULTIPLY, PASS, POSITIVE, SET, SOLVE, Operations, Step


class Tangent:
    """The differentials of all slots of a list of operations. Their slots are reserved when this object is made, their operations
    are made when `part` is first read.

    distance: number of slots from a number to its differential."""

    def __init__(self, of: Operations) -> None:
        self.distance, self._of = of.size, of
        of.slots(of.size)

    @cached_property
    def part(self) -> Operations:
        """The operations that compute the differentials; they have to be run after the list of operations they belong to."""
        part = self._of.part()
        for step in self._of.steps:
            self._add(part, step)
        return part

    def _add(self, part: Operations, step: Step) -> None:
        fields, tables, by = step.fields, step.tables, self.distance
        kind, first = fields["kind"], fields.get("first", 0) + by
        if kind in (CALL, PASS):
            self._call(part, step, first)
        elif kind == LOAD:
            part.load(first, 0 * tables["weight"])
        elif kind in (SET, ADD, MULTIPLY):
            self._map(part, step)
        elif kind in (CHOLESKY, SOLVE):
            right = fields["outputs"] + by
            part.solve(fields["count"], fields["inputs"], fields["first"], right, fields["times"])
        elif kind != POSITIVE:
            raise internal(f"the derivative of the compiled equations is not known for their operation number {kind}")

    def _call(self, part: Operations, step: Step, first: int) -> None:
        fields, tables, by = step.fields, step.tables, self.distance
        gather = np.hstack([tables["from_"], tables["from_"] + by])
        if fields["kind"] == PASS:
            part.hand_on(fields["kernel"].tangent, gather, tables["to"] + by, first)
        else:
            part.call(fields["kernel"].tangent, gather, first)

    def _map(self, part: Operations, step: Step) -> None:
        fields, tables, by = step.fields, step.tables, self.distance
        steps = {name: fields.get(name, 0) for name in ("to_step", "from_step")}
        to, from_, times = tables["to"] + by, tables["from_"], fields["times"]
        if fields["kind"] == SET:
            part.set(to, from_ + by, times, **steps)
            return
        weight = tables["weight"].reshape(times, -1) if fields["weight_step"] else tables["weight"]
        if fields["kind"] == ADD:
            part.add(to, from_ + by, weight, times, **steps)
            return
        for a, b in ((from_ + by, tables["by"]), (from_, tables["by"] + by)):
            part.multiply(to, a, b, weight, times, by_step=fields.get("by_step", 0), **steps)
