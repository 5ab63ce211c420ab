"""Contacts that C checks after every step, until one needs a closer check in Python: the table of contacts.h."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import internal
from mbdae.native.elimination import Array, address
from mbdae.native.equations import Number, Pointer, Whole
from mbdae.native.program import address_of

#: impact speeds (m/s, rad/s) at which durations of impacts are tabulated; in between their logarithms are interpolated
SPEEDS = 10.0 ** (np.arange(161) / 8 - 14)
NUMBERS = ("impact", "approach", "rest", "margin", "slope", "change", "near", "round")


class Table(ctypes.Structure):
    """`Contacts` of contacts.h."""

    _fields_ = (("values", Pointer), ("scene", Pointer), ("count", Whole), ("positions", Whole),
                *((name, Pointer) for name in ("logarithms", "by_joints", "known", "at")), ("reach", Number),
                *((name, Pointer) for name in ("here", "before", "end", "lasting", "stiff", "pairs", "inside")),
                *((name, Number) for name in NUMBERS))  # fmt: skip


class Contacts:
    """Contacts whose gaps and gap rates are evaluated in C.

    here, before (count, 3): gap (m or rad), rate and duration (s) of an impact at the last step and the one before; lasting
    (count,): times (s) after which a contact no longer counts as an impact; stiff (count,): gaps for which the Jacobian in use
    was evaluated; inside (count,): number of steps inside the present contact."""

    def __init__(self, scene: Any, by_joints: Sequence[bool], numbers: Mapping[str, float]) -> None:
        """scene: `Values` of gap and gap rate of every contact; by_joints: whether joints add to the effective mass of each."""
        count = len(by_joints)
        if count < 1 or scene.width != 2 * count or set(numbers) != set(NUMBERS):
            raise internal(f"the watch over contacts in C has {count} contacts, which need {2 * count} values (gap and gap rate "
                           f"of each) and the numbers {sorted(NUMBERS)}: it was given {scene.width} values and the numbers "
                           f"{sorted(numbers)}")
        self._scene, self._by_joints, self._known = scene, np.array(by_joints, dtype=np.int64), np.zeros(count, dtype=np.int64)
        self._logarithms, self._pairs = np.zeros((count, len(SPEEDS))), np.zeros((count, 2))
        self.here, self.before, self._end = (np.zeros((count, 3)) for _ in range(3))
        self.lasting, self.stiff, self.inside = np.zeros(count), np.zeros(count), np.zeros(count, dtype=np.int64)
        self.table = Table(address_of("scene_values"), scene.address, count, 0,
                           *map(address, (self._logarithms, self._by_joints, self._known)), None, 0.0,
                           *map(address, (self.here, self.before, self._end, self.lasting, self.stiff, self._pairs, self.inside)),
                           **numbers)  # fmt: skip

    def hold(self, durations: Sequence[Array], known: NDArray[Any], at: Array, reach: float) -> None:
        """Set the durations (s) at SPEEDS of impacts at every contact. known (count,): whether the effective mass was computed
        at the positions `at`; reach: distance from these up to which it is used."""
        found, self._at = np.array(durations, dtype=float), np.array(at, dtype=float)
        if found.shape != self._logarithms.shape or len(known) != len(found) or len(self._at) > self._scene.n:
            raise internal(f"the watch over contacts in C was given durations of impacts of shape {found.shape} instead of "
                           f"{self._logarithms.shape}, {len(known)} marks for {len(self._known)} contacts, or "
                           f"{len(self._at)} positions where there are {self._scene.n} unknowns")
        self._logarithms[:], self._known[:] = np.log(np.clip(found, 1e-300, 1e300)), known
        self.table.at, self.table.positions, self.table.reach = address(self._at), len(self._at), reach
