"""How fast beams vibrate: what tells whether a motion is slow beside them."""

from __future__ import annotations

import numpy as np

from mbdae.system.base import Array
from mbdae.system.model.beams import Line
from mbdae.ties import largest


def fastest_vibration(lines: list[Line], q: Array) -> tuple[str, float]:
    """The beam with the fastest vibration in the position q (nq,), and a bound of its angular frequency, rad/s.

    No mode of a mesh is faster than the fastest one of its elements alone. Where a strain is rigid there is no bound.
    """
    found = {line.beam.name: _of_elements(line, q) if not line.beam.section.rigid else float("inf") for line in lines}
    name = list(found)[largest(list(found.values()))]
    return name, found[name]


def _of_elements(line: Line, q: Array) -> float:
    """Largest angular frequency of an element that nothing holds, rad/s."""
    return float(np.sqrt(np.max(np.abs(np.linalg.eigvals(np.linalg.solve(line.blocks, line.stiffness(q)))))))
