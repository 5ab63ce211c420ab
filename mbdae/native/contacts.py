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

#: impact speeds (m/s, rad/s) at which the durations of impacts are tabulated for C, from 1e-14 to 1e6, eight in a decade; in
#: between log(duration) is interpolated linearly over log(speed), beyond them the duration is that at the nearest end
SPEEDS = 10.0 ** (np.arange(161) / 8 - 14)
NUMBERS = ("impact", "approach", "rest", "margin", "slope", "change", "near", "round")


class Table(ctypes.Structure):
    """The C struct `Contacts` of contacts.h, with the same members in the same order."""

    _fields_ = (("values", Pointer), ("scene", Pointer), ("count", Whole), ("positions", Whole),
                *((name, Pointer) for name in ("logarithms", "by_joints", "known", "at")), ("reach", Number),
                *((name, Pointer) for name in ("here", "before", "end", "lasting", "stiff", "pairs", "inside")),
                *((name, Number) for name in NUMBERS))  # fmt: skip


class Contacts:
    """Contacts whose gaps and gap rates are evaluated in C.

    here, before (count, 3): gap (m or rad), its rate, and the duration (s) of an impact at this rate, at the end of the last step
    and of the one before; lasting (count,): times (s) from which on a contact that is still closed counts as resting, no longer
    as an impact; stiff (count,): gaps at which the Jacobian in use was evaluated; inside (count,): number of steps since the
    contact closed."""

    def __init__(self, scene: Any, by_joints: Sequence[bool], numbers: Mapping[str, float]) -> None:
        """scene: `Values` of gap and gap rate of every contact; by_joints: of every contact, whether its effective mass contains
        bodies that joints tie to those in contact; numbers: the constants `NUMBERS` of the checks."""
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
        """Set the durations (s) of impacts at SPEEDS, an array of every contact. known (count,): whether its effective mass was
        computed at the positions `at` (k,); reach: change of any of these up to which that mass is used."""
        found, self._at = np.array(durations, dtype=float), np.array(at, dtype=float)
        if found.shape != self._logarithms.shape or len(known) != len(found) or len(self._at) > self._scene.n:
            raise internal(f"the watch over contacts in C was given durations of impacts of shape {found.shape} instead of "
                           f"{self._logarithms.shape}, {len(known)} marks for {len(self._known)} contacts, or "
                           f"{len(self._at)} positions where there are {self._scene.n} unknowns")
        self._logarithms[:], self._known[:] = np.log(np.clip(found, 1e-300, 1e300)), known
        self.table.at, self.table.positions, self.table.reach = address(self._at), len(self._at), reach
