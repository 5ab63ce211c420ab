"""Which parts of a suite are measured: all of them, a tenth that a seed draws, or those that are named."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

SHARE = 0.1  #: of a suite, drawn at least
CHANCE = 1e-3  #: of a draw that exceeds what is allowed although the suite keeps its share


class Parts(list[Any]):
    """Parts of a suite that are measured, out of `whole`; `now` is the last one that was taken."""

    def __init__(self, chosen: Sequence[Any], whole: int) -> None:
        super().__init__(chosen)
        self.whole, self.now = whole, None

    def __iter__(self) -> Iterator[Any]:
        for self.now in super().__iter__():
            yield self.now


@dataclass(frozen=True)
class Draw:
    """A tenth of every suite by a seed; or, with `only`, the parts of these names."""

    seed: int
    only: tuple[str, ...] = ()

    def of(self, suite: str, parts: Sequence[Any]) -> Parts:
        """Parts in their order; the same ones for a seed and a suite's name, whatever else is measured."""
        if self.only:
            return Parts([part for part in parts if str(part) in self.only], len(parts))
        random = np.random.default_rng([self.seed, *suite.encode()])
        drawn = random.choice(len(parts), math.ceil(SHARE * len(parts)), replace=False)
        return Parts([parts[i] for i in sorted(drawn)], len(parts))


def allowed(share: float, parts: Sequence[Any]) -> float:
    """The share that some parts may show where at most `share` of the suite is claimed: of all of them and of parts that were
    chosen just this; of a draw the share that a suite which just keeps to it exceeds once in a thousand draws."""
    if not isinstance(parts, Parts) or not 0 < len(parts) < parts.whole:
        return share
    from scipy.stats import hypergeom  # needed for draws only

    most = int(hypergeom.isf(CHANCE, parts.whole, math.floor(share * parts.whole), len(parts)))
    return max(share, most / len(parts))
