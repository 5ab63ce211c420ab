"""The base class of forms: a form is a set of equations in which a scene is integrated, such as GGL."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from mbdae.system.assembled.form_spec import FormSpec
from mbdae.system.model.model import Model
from mbdae.system.model.numbering import Row

#: end of the error messages about a wrong value of the option `waves`: the valid values and their meaning
WAVES = "give True to have Radau IIA resolve elastic vibrations, False to let it step over them"


class Form(ABC):
    """Base of the forms. A form turns laws into equations and says which multipliers are unknowns.

    Whoever adds one derives a frozen dataclass from this class; nothing else knows it. Its duties:

    1. `label`, its name in tables, messages and stored results.
    2. The option `waves`, whether elastic vibrations are resolved; `__post_init__` checks it and its own options.
    3. `spec`: which outputs it takes of every law, the blocks of rows and of multipliers they make, the index of each kind of
       unknown. What drifts, how many unknowns there are and which solvers take the form follows from it.
    4. Where it depends on the solver, `for_index`: its variant for the highest index of unknowns that this integrates.
    5. Where it depends on the scene, `for_time` (options that follow from the characteristic time) and `refusal` (scenes that it
       cannot describe, with what to do).
    """

    label: ClassVar[str]
    waves: bool

    @abstractmethod
    def spec(self) -> FormSpec:
        """What the form prescribes for the assembly of a scene: its equations, the blocks of unknowns, their index and
        options."""

    def refusal(self, model: Model, rows: list[Row]) -> str | None:
        """Why this form cannot describe the scene, or None."""
        return None

    def for_index(self, highest: int) -> Form:
        """The variant of this form for a solver that can integrate unknowns up to the differentiation index `highest`."""
        return self

    def within(self, highest: int) -> bool:
        """Whether a solver that integrates unknowns up to the index `highest` (0: ordinary differential equations only) takes
        this form, in its variant for that solver."""
        spec = self.for_index(highest).spec()
        return max(spec.index.values()) <= highest if highest else not spec.multipliers

    def for_time(self, characteristic: float) -> Form:
        """This form with those options filled in that depend on the characteristic time (s) of a scene."""
        return self
