"""The first among values that are equal up to rounding, so that messages, meshes and signs of modes do not depend on rounding."""

from __future__ import annotations

from typing import Any

import numpy as np

#: relative difference up to which magnitudes count as equal: solved or differentiated values have errors up to about 1e-8, and
#: which of two rows is named the worst does not matter where they differ by less
ALIKE = 1e-6
NEAR = 1e-9  #: distances whose difference, over a length, is at most this count as equal


def largest(sizes: Any) -> int:
    """Index of the first of the largest of some magnitudes (n,); those within `ALIKE` (relative) of the largest count as equal.

    Where some are not finite, the index of the first of them; raises ValueError for an empty array.
    """
    found = np.asarray(sizes, dtype=float)
    top = np.max(found)
    return int(np.argmax(found >= (1 - ALIKE) * top if np.isfinite(top) else ~np.isfinite(found)))


def nearest(distances: Any, length: float) -> int:
    """Index of the first of the smallest of some distances (n,), m; those within `NEAR` times `length` of it count as equal."""
    found = np.asarray(distances, dtype=float)
    return int(np.argmax(found <= np.min(found) + NEAR * length))
