"""The first of values that are equal up to rounding: messages, meshes and signs of modes do not depend on the last digits."""

from __future__ import annotations

from typing import Any

import numpy as np

#: relative difference up to which magnitudes count as equal: solved or differentiated values have errors up to about 1e-8, and
#: which of two rows is named the worst does not matter where they differ by less
ALIKE = 1e-6
NEAR = 1e-9  #: of a length: places closer together count as one


def largest(sizes: Any) -> int:
    """Position of the first of the largest of some magnitudes (n,), those within `ALIKE` of each other taken as equal.

    Where one is not finite, the first such; raises ValueError where there are none.
    """
    found = np.asarray(sizes, dtype=float)
    top = np.max(found)
    return int(np.argmax(found >= (1 - ALIKE) * top if np.isfinite(top) else ~np.isfinite(found)))


def nearest(distances: Any, length: float) -> int:
    """Position of the first of the smallest of some distances (n,), those within `NEAR` of a length of each other being equal."""
    found = np.asarray(distances, dtype=float)
    return int(np.argmax(found <= np.min(found) + NEAR * length))
