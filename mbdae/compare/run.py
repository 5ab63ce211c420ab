"""What is compared: a solver on a form, with a joint model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from mbdae.errors import OptionError
from mbdae.formulations import Form, Index3
from mbdae.integrators.base import Solver
from mbdae.scene.components import Kinematic
from mbdae.system.base import System

#: options that a label need not tell: the table has them in columns of their own, or the solver's name holds them
TOLD_ELSEWHERE = ("rtol", "stages")


@dataclass(frozen=True)
class Run:
    """A solver on a form (None: the scene's default), with a joint model (None: as the scene states it).

    A solver that has no tolerance or step of its own is run once for every accuracy; one that has is run as it is.
    """

    solver: Solver
    form: Form | None = None
    model: Kinematic | None = None
    label: str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.solver, Solver):
            raise OptionError(f"solver = {self.solver!r}: give a solver object such as mb.IDA() or mb.RadauIIA(3)")
        if self.form is not None and not isinstance(self.form, Form):
            raise OptionError(f"form = {self.form!r}: give a form object such as mb.GGL(), or None for the scene's default")
        if self.model is not None and not isinstance(self.model, Kinematic):
            raise OptionError(f"model = {self.model!r} is not a joint model; use mb.Kinematic() or None")

    @property
    def as_it_is(self) -> bool:
        """Whether the solver brings its own tolerance or step."""
        return self.solver.fixed or self.solver.rtol is not None

    def name(self, form_label: str) -> str:
        """Label for tables: what the user gave, or solver, form and every option that differs from its default."""
        return self.label or f"{described(self.solver, self.solver.label)} {described(self.form, form_label)}"


def described(choice: Any, name: str) -> str:
    """`name` with the options of a frozen dataclass that differ from their defaults."""
    if choice is None:
        return name
    told = [(f, getattr(choice, f.name)) for f in fields(choice) if f.name not in TOLD_ELSEWHERE]
    changed = [f"{f.name}={value}" for f, value in told if value is not f.default and value != f.default]
    return f"{name}[{', '.join(changed)}]" if changed else name


def default_runs(constrained: bool, system: System | None = None) -> list[Run]:
    """IDA and Radau side by side; index 3 for Radau where there are constraints, IDA only up to index 1."""
    from mbdae.integrators.ida import IDA
    from mbdae.integrators.radau import RadauIIA

    runs = [Run(IDA()), Run(RadauIIA(2)), Run(RadauIIA(3))]
    if system is not None and int(np.max(system.index)) > 1:
        runs = runs[1:]
    return [*runs, Run(RadauIIA(3), Index3())] if constrained else runs


def checked_runs(runs: Sequence[Run]) -> list[Run]:
    """The runs as a list; anything else than a Run is refused."""
    out = list(runs)
    wrong = [r for r in out if not isinstance(r, Run)]
    if wrong or not out:
        raise OptionError(f"runs = {wrong or out!r}: give a list of mb.Run, such as [mb.Run(mb.IDA()), mb.Run(mb.RadauIIA(3))]")
    return out
