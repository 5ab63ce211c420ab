"""How fast beams vibrate: what tells whether a motion is slow beside them."""

from __future__ import annotations

import numpy as np

from mbdae.system.base import Array
from mbdae.system.lines import Line, nodal_inputs
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
    kernel, u = line.displacement, np.zeros((1, 1 + max(node.u + node.kind.sizes[1] for node in line.nodes)))
    x = nodal_inputs(kernel, [line], q[None], u, np.zeros((1, 0)))
    nodes, count = kernel.nodes, kernel.nodes.count
    by_position = kernel.full_jacobian(x)[:, : count * nodes.nu, : count * nodes.nq].transpose(1, 2, 0)
    at = x[:, : count * nodes.nq].reshape(len(x), count, nodes.nq)
    stiffness = nodes.velocity_columns(by_position, at).transpose(2, 0, 1)
    return float(np.sqrt(np.max(np.abs(np.linalg.eigvals(np.linalg.solve(line.blocks, stiffness))))))
