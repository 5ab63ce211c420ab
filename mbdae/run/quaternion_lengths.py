"""Quaternions of different length along a beam, which make interpolated rotations and strains wrong.

A length other than 1 that is common to all does not matter. Measured: lengths from 1 to 1.08 within an element change its strains
by 1e-4."""

from __future__ import annotations

import numpy as np

from mbdae.results.result import Result

UNEQUAL = 1e-3  #: largest relative difference of the quaternion lengths in one element without a warning
SAMPLES = 200  #: largest number of steps of the run at which lengths are compared


def unequal_lengths(result: Result) -> list[str]:
    """A warning for every beam in space whose quaternions differ in length."""
    lines = [line for line in result.prepared.model.lines if line.kind.sizes[0] == 7]
    if not lines:
        return []
    t = result.solution.t
    q = result.states(t[:: len(t) // SAMPLES + 1])[0]
    notes = []
    for line in lines:
        norms = np.stack([np.linalg.norm(q[:, node.q + 3 : node.q + 7], axis=1) for node in line.nodes], axis=1)
        along = norms[:, line.mesh.elements]
        worst = float(np.max(np.max(along, axis=2) / np.min(along, axis=2))) - 1
        if worst > UNEQUAL:
            notes.append(f"beam '{line.beam.name}': quaternions within one element differ in length by {worst:.1e}, which "
                         "strains it falsely (all should have length 1): ask for a smaller accuracy, or more elements")
    return notes
