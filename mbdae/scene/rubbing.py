"""Friction in revolute and prismatic joints: checks of its arguments, and the laws that model it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from mbdae.laws.forces import SlideFriction
from mbdae.laws.joints import (
    ClassicalPrismatic,
    ClassicalRevolute,
    Prismatic,
    Revolute,
    RubbingClassicalPrismatic,
    RubbingClassicalRevolute,
    RubbingPrismatic,
    RubbingRevolute,
)
from mbdae.scene.components import Clearance, Recursive
from mbdae.symbolic.law import Joint, TwoBodyLaw

#: joint law -> the same with friction whose normal force is the joint's own reaction
RUBBING: dict[type[Joint], type[Joint]] = {
    Revolute: RubbingRevolute, ClassicalRevolute: RubbingClassicalRevolute,
    Prismatic: RubbingPrismatic, ClassicalPrismatic: RubbingClassicalPrismatic,
}  # fmt: skip


@dataclass(frozen=True)
class Rubbing:
    """Friction of one joint. own: values of the joint's law, where its reaction is the normal force; given: values of a separate
    force law, where the normal force is stated."""

    own: dict[str, Any] = field(default_factory=dict)
    given: dict[str, Any] = field(default_factory=dict)

    def joint(self, law: type[Joint]) -> type[Joint]:
        """The joint's law with this friction."""
        return RUBBING.get(law, law) if self.own else law

    def values(self, law: type[Joint]) -> dict[str, Any]:
        """Values of the joint's law for its friction."""
        return self.own if law in RUBBING else {}

    @property
    def forces(self) -> list[tuple[type[TwoBodyLaw], dict[str, Any]]]:
        """Force laws beside the joint's."""
        return [(SlideFriction, self.given)] if self.given else []


def rubbing(problems: list[str], kind: str, name: str, friction: Any, option: str, value: Any, model: Any) -> Rubbing:
    """The friction of a joint; mistakes are added to `problems`, and then there is no friction.

    option: "radius" (m) or "normal_force" (N) with its value."""
    head, unit = f"{kind} '{name}': ", "m" if option == "radius" else "N"
    if friction is None:
        if value is not None:
            problems.append(f"{head}{option} = {value:g} {unit} does nothing without friction=; give mb.Coulomb(mu, v_c), or "
                            f"omit it")  # fmt: skip
        return Rubbing()
    own_reaction = option == "radius" or value is None
    wrong = []
    if option == "radius" and value is None:
        wrong.append(f"{head}radius = None: friction in a bearing needs the radius of its pin, a positive number in m")
    if isinstance(model, Clearance):
        wrong.append(f"{head}friction of a joint with clearance belongs to its model: omit friction= and {option}=, say "
                     f"model=mb.Clearance(outer, inner, normal, friction=...)")  # fmt: skip
    if isinstance(model, Recursive) and own_reaction:
        remedy = " or a given normal_force" if option == "normal_force" else ""
        wrong.append(f"{head}its friction follows from its reaction, and a recursive joint has none among its unknowns; "
                     f"use model=mb.Kinematic(){remedy}")  # fmt: skip
    problems += wrong
    if wrong:
        return Rubbing()
    if not own_reaction:
        return Rubbing(given={"friction": friction, "normal_force": value})
    return Rubbing(own={"friction": friction} | ({"radius": value} if option == "radius" else {}))
