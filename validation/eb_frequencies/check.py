"""Natural frequencies of thin beams with clamped, hinged and free ends."""

from __future__ import annotations

import numpy as np
from beam_scenes import supported
from runner import Case, Claim, Found
from runs import largest
from scenes import data

claim = Claim("eb_frequencies", "the first five frequencies of thin beams with clamped, hinged and free ends", 1e-4, "relative",
              "roots of the frequency equations of Euler and Bernoulli")
ENDS = {"cf": "cantilever", "ff": "free_free_or_clamped_clamped", "cc": "free_free_or_clamped_clamped",
        "hf": "hinged_free_or_clamped_hinged", "ch": "hinged_free_or_clamped_hinged", "hh": "pinned_pinned"}


def five(ends: str, elements: int, order: int) -> Found:
    """Largest relative error of the first five frequencies above zero, of sqrt(EI / (rho A L^4)) = 1."""
    modes = supported(ends, elements, order).linearize(count=12)
    found = modes.angular_frequencies[modes.angular_frequencies > 0][:5]
    free = int(np.sum(modes.eigenvalues == 0)) // 2
    return Found(largest(found / np.square(data("eb_frequencies")["roots"][ENDS[ends]]), 1.0),
                 note=f"{free} rigid motions besides")


def cases() -> list[Case]:
    return [Case(f"ends {ends}, {name} elements", "linearize", lambda ends=ends, mesh=mesh: five(ends, *mesh))
            for name, mesh in (("16 cubic", (16, 3)), ("10 quartic", (10, 4))) for ends in ENDS]
