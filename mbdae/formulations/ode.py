"""Ordinary differential equations: scenes without constraints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from mbdae.formulations.base import WAVES, Form
from mbdae.formulations.index3 import index3_outputs
from mbdae.notation import counted
from mbdae.system.assembled.form_spec import FormSpec
from mbdae.system.model.model import Model
from mbdae.system.model.numbering import Row
from mbdae.values import flag, set_option


@dataclass(frozen=True)
class ODE(Form):
    """q' = H u, M u' = f, for scenes without constraints. mixed: the stress resultants of beams are algebraic unknowns, which
    Radau IIA can integrate; waves: Radau IIA resolves elastic vibrations instead of stepping over them."""

    mixed: bool = False
    waves: bool = False
    label: ClassVar[str] = "ODE"

    def __post_init__(self) -> None:
        set_option(self, "mixed", flag, "give True to keep the stresses of beams as unknowns, False to leave them out")
        set_option(self, "waves", flag, WAVES)

    def for_index(self, highest: int) -> ODE:
        return replace(self, mixed=highest >= 2)

    def spec(self) -> FormSpec:
        index = {"q": 1, "v": 1, "s": 1}
        return FormSpec(self.label, index3_outputs, {"q": "q", "u": "u", "s": "s"}, (), False, index, self.mixed, self.waves)

    def refusal(self, model: Model, rows: list[Row]) -> str | None:
        if not rows:
            return None
        return (f"form ODE needs a scene without constraints, this one has {counted(len(rows), 'constraint row')} (such as "
                f"{rows[0].name}): use mb.GGL(), or s.recursive() if its joints form a tree")  # fmt: skip
