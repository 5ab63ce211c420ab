"""The options of a form for the assembly of a scene's equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mbdae.kernels.plan import Outputs


@dataclass(frozen=True)
class FormSpec:
    """The options of a form for the assembly.

    outputs: selects the outputs of every law; rows: to which block of rows each kind of output belongs; blocks: blocks of
    multipliers in y; derivatives: the multipliers are the derivatives of these unknowns; index: index of each kind of unknown;
    mixed: stresses of beams are unknowns (kind "z"); waves: elastic vibrations are resolved (velocities are in the error test);
    loads_only: beams enter with gravity and loads alone; numbers: parameters of the form itself, by name; eliminated: the
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
