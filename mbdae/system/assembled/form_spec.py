"""What a form asks of the assembly of a scene's equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mbdae.kernels.plan import Outputs


@dataclass(frozen=True)
class FormSpec:
    """What a form asks of the assembly.

    outputs: which outputs of every law; rows: to which block of rows each kind of output belongs; blocks:
    multiplier blocks of y; derivatives: multipliers are read from y'; index: index of each kind of unknown; mixed: beams
    keep their stresses as unknowns (kind "z"); waves: elastic vibrations are resolved (velocities in the error test);
    loads_only: of beams only gravity and loads along them; numbers: parameters of the form itself, by name; eliminated: the
    multipliers are solved for at every state, y = (q, u, s)."""

    label: str
    outputs: Outputs
    rows: Mapping[str, str]
    blocks: tuple[str, ...]
    derivatives: bool
    index: Mapping[str, int]
    mixed: bool = False
    waves: bool = False
    loads_only: bool = False
    numbers: Mapping[str, float] = field(default_factory=dict)
    eliminated: bool = False
