"""Units of what formulas contain: products of powers of m, kg and s; angles have the unit 1."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from mbdae.audit.notation import AuditError

BASIC = ("m", "kg", "s")
_KNOWN = {"m": (1, 0, 0), "kg": (0, 1, 0), "s": (0, 0, 1), "rad": (0, 0, 0), "1": (0, 0, 0), "N": (1, 1, -2), "J": (2, 1, -2),
          "W": (2, 1, -3), "Pa": (-1, 1, -2), "Hz": (0, 0, -1)}  # fmt: skip


@dataclass(frozen=True)
class Unit:
    """Powers of m, kg and s."""

    powers: tuple[float, float, float] = (0.0, 0.0, 0.0)
    text: str = field(default="", compare=False)  #: as it was written

    def size(self, scale: Mapping[str, float]) -> float:
        """Size of the unit for given sizes of the basic units."""
        out = 1.0
        for name, power in zip(BASIC, self.powers, strict=True):
            out *= scale[name] ** power
        return out

    def __str__(self) -> str:
        if self.text:
            return self.text
        shown = [name if power == 1 else f"{name}^{power:g}" for name, power in zip(BASIC, self.powers, strict=True) if power]
        return " ".join(shown) or "1"


def unit(text: str, line: int = 0) -> Unit:
    """The unit of a text such as "N m s/rad" or "N/m^1.5"."""
    powers = [0.0, 0.0, 0.0]
    for i, part in enumerate(text.split("/")):
        for word in part.strip(" ()").split():
            match = re.fullmatch(r"(\w+?)(?:\^(-?[\d.]+))?", word)
            if match is None or match[1] not in _KNOWN:
                raise AuditError(f"line {line}: the unit '{word}' is not known; there are {', '.join(_KNOWN)}")
            for j, power in enumerate(_KNOWN[match[1]]):
                powers[j] += (1 if i == 0 else -1) * power * float(match[2] or 1)
    return Unit((powers[0], powers[1], powers[2]), text.strip())
