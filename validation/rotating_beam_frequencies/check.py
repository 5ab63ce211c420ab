"""Frequencies of a beam clamped to the axis of a rotating hub, in the hub's frame."""

from __future__ import annotations

import numpy as np
from beam_scenes import on_hub
from runner import Case, Claim, Found
from scenes import data

import mbdae as mb

claim = Claim("rotating_beam_frequencies", "flap and lag frequencies of a beam on a turning hub, up to 12 sqrt(EI / (rho A L^4))",
              1e-3, "relative", "Galerkin's method for the inextensible beam, computed independently")
SECTION = mb.Section(1e8, 1e8, 1e8, 1e4, 1.0, 1.0, 1.0, (1e-8, 1e-8, 1e-8))  #: torsion and extension far above the rest


def frequencies(rate: str) -> list[Found]:
    scene = on_hub(SECTION, float(rate), 1.0, 8, 3, "spatial")
    e = scene.equilibrium(frame="hub")
    found = scene.linearize(at=e, frame="hub", count=12).angular_frequencies
    known = data("rotating_beam_frequencies")["table"][rate]
    return [Found(max(float(np.min(np.abs(found / value - 1))) for value in known[kind]), quantity=kind) for kind in known]


def cases() -> list[Case]:
    rates = [rate for rate in data("rotating_beam_frequencies")["table"] if float(rate)]
    return [Case(f"rate {rate}, 8 cubic elements", "linearize", lambda rate=rate: frequencies(rate), rate not in ("1.0", "12.0"))
            for rate in rates]
