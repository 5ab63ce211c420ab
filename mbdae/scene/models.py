"""The model of a joint as the user states it: checks of its values, and the law it selects."""

from __future__ import annotations

from typing import Any

from mbdae.errors import LawError
from mbdae.laws.contact import Normal
from mbdae.laws.friction import Coulomb, Friction
from mbdae.laws.joints import ClassicalPrismatic, ClassicalRevolute, ClearanceRevolute, Prismatic, Revolute
from mbdae.scene.components import Classical, Clearance, Constrained, Kinematic, Recursive
from mbdae.scene.reading import Argument, instance, quantity
from mbdae.symbolic.law import Joint
from mbdae.values import shown

MODELS = "mb.Kinematic(), mb.Classical(), mb.Recursive() or mb.Clearance(outer, inner, normal)"  #: for messages
#: kinematic law -> the law of the same joint with its coordinate as an unknown
CLASSICAL: dict[type[Joint], type[Joint]] = {Revolute: ClassicalRevolute, Prismatic: ClassicalPrismatic}
a_friction = instance(Friction, "friction law", "give mb.Coulomb(mu, v_c), mb.LuGre(...) or None", Coulomb(0.0, 1.0))
normal_law = instance(Normal, "normal law", "give mb.Hertz(stiffness, damping)")


def friction_law(arg: Argument, value: Any) -> Any:
    """A friction law; one without internal states may feed no energy at any speed."""
    found = a_friction(arg, value)
    if found is not value or found.states:
        return found
    try:
        feeds = found.feeds_at()
    except LawError as error:
        arg.scene.problems.append(f"{arg.item}: {arg.option}: {error}")
        return Coulomb(0.0, 1.0)
    if feeds is not None:
        arg.wrong(f"{shown(value)} drives the bodies at v = {feeds:g} m/s", "its coefficient must have the sign of v, or be 0")
        return Coulomb(0.0, 1.0)
    return found


def joint_model(arg: Argument, value: Any) -> Any:
    """A joint model whose numbers can be used; None, the kinematic one, where it has none."""
    before = len(arg.scene.problems)
    if isinstance(value, Clearance):
        _read_clearance(arg, value)
    elif isinstance(value, Kinematic | Classical):
        quantity("1", "positive")(arg.part("model.scaling"), value.scaling)
        quantity("N m", "not negative")(arg.part("model.penalty"), value.penalty)
    elif not isinstance(value, Recursive):
        arg.wrong(f"{shown(value)} is not a joint model", f"use {MODELS}")
    return value if len(arg.scene.problems) == before else None


def _read_clearance(arg: Argument, model: Clearance) -> None:
    before = len(arg.scene.problems)
    for key in ("outer", "inner", "length"):
        value = getattr(model, key)
        if value is not None or key != "length":
            quantity("m", "positive")(arg.part(f"model.{key}"), value)
    if len(arg.scene.problems) == before and model.inner > model.outer:
        arg.part("model.inner").wrong(f"{model.inner:g} m is larger than model.outer = {model.outer:g} m: the pin does not fit "
                                       f"into the race", "k carries the race, l the pin")  # fmt: skip
    normal_law(arg.part("model.normal"), model.normal)
    if model.friction is not None:
        friction_law(arg.part("model.friction"), model.friction)


def law_of(arg: Argument, law: type[Joint], model: Any) -> tuple[type[Joint], dict[str, float]]:
    """The law of a joint in the model stated, and scaling and penalty (paper Eq. 2) where they differ from 1 and 0."""
    if isinstance(model, Clearance):
        if law is Revolute:
            return ClearanceRevolute, {"tilting": model.length is not None}
        arg.wrong(f"{shown(model)} exists for revolute joints only", "use mb.Kinematic(), mb.Classical() or mb.Recursive()")
    if not isinstance(model, Constrained):
        return CLASSICAL[law] if isinstance(model, Recursive) else law, {}
    if law is Prismatic and model != type(model)():
        arg.wrong(shown(model), "scaling and penalty exist for revolute joints only; omit them")
        return law, {}
    extra = ({"scaling": model.scaling} if model.scaling != 1 else {}) | ({"penalty": model.penalty} if model.penalty else {})
    return law if isinstance(model, Kinematic) else CLASSICAL[law], extra
