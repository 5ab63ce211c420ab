"""What a form prescribes for the assembly of a scene's equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mbdae.kernels.plan import Outputs


@dataclass(frozen=True)
class FormSpec:
    """What a form prescribes for the assembly of a scene's equations.

    outputs: function that selects the expressions which a law adds to the equations; rows: head of a target -> block of rows of F
    ("q", "u", "s" or a block of multipliers) to which such an expression is added; blocks: blocks of multipliers in y
    ("lambda", "mu"); derivatives: whether the multipliers are the time derivatives of these unknowns; index: differentiation
    index of each kind of unknown; mixed: whether stresses of beams are unknowns (kind "z"); waves: whether elastic vibrations
    are resolved, so that the error test contains the velocities; loads_only: whether beams enter without elastic forces and
    inertia, only with gravity and loads; numbers: parameters of the form itself, by name, such as Baumgarte's; eliminated:
    whether the multipliers are solved for at every state, so that y = (q, u, s)."""

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

    @property
    def multipliers(self) -> int:
        """Number of multipliers that are unknowns for every constraint row."""
        return 0 if self.eliminated else len(self.blocks)

    @property
    def drifts(self) -> bool:
        """Whether constraints are imposed on velocities or accelerations only, so that joints may come apart slowly."""
        return bool(self.blocks) and "g" not in self.rows
