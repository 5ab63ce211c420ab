"""Twelve contacts, 1e-4 of the amplitude deep: how many are found."""

from __future__ import annotations

from typing import Any

import numpy as np
from contact_scenes import grazing
from runner import Case, Claim, Found

import mbdae as mb

CONTACTS, PHASES = 12, (0.0, 0.3, 0.6, 0.9)

claim = Claim("grazing", "contacts that hardly touch are not stepped over, or the run says that they may be", 0.5,
              "contacts missed without a warning", "an oscillator meets each wall once a period")


def missed(accuracy: float, solver: Any, stiffness: float) -> Found:
    silent = lost = told = 0
    for phase in PHASES:
        r = grazing(1e-4, stiffness, phase).simulate(CONTACTS * np.pi - phase, accuracy=accuracy, solver=solver, outputs=3)
        gone = abs(len(r["J"].contacts) - CONTACTS)
        lost, told, silent = lost + gone, told + bool(r.warnings), silent + (0 if r.warnings else gone)
    return Found(silent, note=f"{lost} of {CONTACTS * len(PHASES)} missed, {told} of {len(PHASES)} runs warn")


def cases() -> list[Case]:
    asked = [("RadauIIA(3)", mb.RadauIIA(3), accuracy, k) for accuracy in (1e-3, 1e-5, 1e-7) for k in (1e6, 1e7, 1e9)]
    asked += [("IDA", mb.IDA(), accuracy, 1e7) for accuracy in (1e-3, 1e-5, 1e-7)]
    asked += [("RadauIIA(2)", mb.RadauIIA(2), 1e-3, 1e7)]
    return [Case(f"accuracy {accuracy:g}, k = {k:g}", name, lambda a=accuracy, s=solver, k=k: missed(a, s, k),
                 slow=name != "RadauIIA(3)" or k != 1e7 or accuracy < 1e-3) for name, solver, accuracy, k in asked]
