"""The values that a user wants for a parameter: a list, or decades between two bounds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from mbdae.errors import OptionError
from mbdae.values import number, option, sequence, shown

OPTIONS = {"accuracy": "accuracy asked", "step": "constant step, s", "t_end": "end of the run, s"}
RUNGS = 7  #: largest number of values from one bound to the other, both included


def asked_values(vary: Any) -> dict[str, tuple[float, ...]]:
    """The values by parameter; OptionError where `vary` is no such mapping, or a value is no number."""
    remedy = "give {parameter: (low, high) or [values]}, such as {'coupler.mass': (1e-3, 1e3)}"
    if not isinstance(vary, Mapping) or not vary or not all(isinstance(name, str) for name in vary):
        raise OptionError(f"vary = {shown(vary)}: {remedy}")
    return {name: _values(name, asked) for name, asked in vary.items()}


def _values(name: str, asked: Any) -> tuple[float, ...]:
    what, remedy = f"vary: '{name}'", "give (low, high) for a ladder of decades, or a list of values"
    each, bounds = remedy, dict[str, float]()
    if name == "accuracy":
        each, bounds = f"{remedy}, each from 1e-12 to 0.1", {"least": 1e-12, "most": 1e-1}
    elif name in OPTIONS:
        each, bounds = f"{remedy}, each positive, in s", {"above": 0}
    given: tuple[float, ...] = tuple(option(what, asked, sequence, each, each=number, **bounds))
    if not given:
        raise OptionError(f"{what} = {shown(asked)} is empty: {remedy}")
    if not isinstance(asked, tuple) or len(given) != 2:
        return given
    if given[0] * given[1] <= 0:
        raise OptionError(f"{what} = {shown(asked)}: a tuple means (low, high) with values by decades between, so that both "
                          f"need one sign and neither may be 0; give a list for single values: [..., ...]")  # fmt: skip
    return ladder(*given)


def ladder(low: float, high: float) -> tuple[float, ...]:
    """Both bounds and values between them, equal numbers of whole decades apart where possible; at most `RUNGS` values."""
    decades = abs(math.log10(high / low))
    steps = max(1, math.ceil(decades - 1e-9)) if decades <= RUNGS - 1 else 0
    if not steps:  # prefer steps of whole decades, as many as are allowed
        whole = [n for n in range(RUNGS - 1, 0, -1) if abs(decades / n - round(decades / n)) < 1e-9]
        steps = whole[0] if whole else RUNGS - 1
    return tuple(float(f"{low * (high / low) ** (i / steps):.6g}") for i in range(steps + 1))
