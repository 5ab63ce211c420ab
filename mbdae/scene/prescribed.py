"""Prescribed values over a run: finite, and for joints without jumps of value or rate."""

from __future__ import annotations

from typing import Any

import numpy as np
import symengine as se

from mbdae.inputs import timed
from mbdae.scene.beams import BeamLoad
from mbdae.scene.components import Connection
from mbdae.symbolic.law import Joint, Law

_SAID = {("revolute", "drive"): "angle", ("prismatic", "drive"): "position"}
_RAMP = "; join the pieces by a smooth ramp such as h*(3*x**2 - 2*x**3), x = (mb.t - t1)/T from 0 to 1"


def problems(connections: list[Connection], loads: list[BeamLoad], t0: float, t_end: float) -> list[str]:
    """What is wrong with prescribed values in [t0, t_end], one sentence each."""
    found = []
    stated: list[tuple[str, str, Any]] = [(item.kind, item.name, law) for item in connections for law in item.laws]
    for kind, name, law in stated + [("load", load.name, load.law) for load in loads]:
        for key, parameter in law.params.items():
            value = getattr(law, key)
            if value is not None and getattr(se.sympify(value), "free_symbols", None):
                what = f"{kind} '{name}': {_SAID.get((kind, key), key)} = {value}"
                found += _of_one(what, se.sympify(value), parameter.unit, law, t0, t_end)
    return found


def _of_one(what: str, e: Any, unit: str, law: Law, t0: float, t_end: float) -> list[str]:
    parts = list(timed.derivatives(e)) if isinstance(law, Joint) else [e]
    for part, name in zip(parts, ("value", "rate", "second derivative"), strict=False):
        start = float(timed.values(part, np.array([t0]))[0])
        if not np.isfinite(start):
            return [f"{what}: its {name} is {start} at the start t = {t0:g} s"]
    jump = timed.first_jump(e, t0, t_end)
    if not isinstance(law, Joint):
        pole = jump is not None and not np.isfinite(jump[1])
        return [f"{what} is not finite near t = {jump[0]:.6g} s"] if jump is not None and pole else []
    if jump is not None:
        size = f"jumps by {jump[1]:.4g} {unit}" if np.isfinite(jump[1]) else "has no finite value"
        return [f"{what} {size} at t = {jump[0]:.6g} s; the bodies cannot follow{_RAMP}"]
    kink = timed.first_jump(parts[1], t0, t_end)
    if kink is not None:
        return [f"{what}: its rate jumps by {kink[1]:.4g} {unit}/s at t = {kink[0]:.6g} s; that takes an infinite force{_RAMP}"]
    return []
