"""The model of a joint as the user states it: checks of its values, and what it makes of the joint's law."""

from __future__ import annotations

from typing import Any

from mbdae.errors import LawError
from mbdae.laws.contact import Normal
from mbdae.laws.friction import Coulomb, Friction
from mbdae.scene.components import Classical, Clearance, Constrained, JointModel, Kinematic, Recursive
from mbdae.scene.reading import Argument, instance, quantity
from mbdae.symbolic.joint import Joint
from mbdae.values import shown

MODELS = "mb.Kinematic(), mb.Classical(), mb.Recursive() or mb.Clearance(outer, inner, normal)"  #: joint models, in messages
a_friction = instance(Friction, "friction law", "give mb.Coulomb(mu, v_c), mb.LuGre(...) or None", Coulomb(0.0, 1.0))
normal_law = instance(Normal, "normal law", "give mb.Hertz(stiffness, damping)")


def friction_law(arg: Argument, value: Any) -> Any:
    """Reader of a friction law. One without internal states is refused where it feeds energy at some sliding velocity."""
    found = a_friction(arg, value)
    if found is not value or found.states:
        return found
    try:
        feeds = found.feeds_at()
    except LawError as error:
        arg.scene.problems.append(f"{arg.item}: {arg.option}: {error}")
        return Coulomb(0.0, 1.0)
    if feeds is not None:
        arg.wrong(f"{shown(value)} does not brake at the sliding velocity v = {feeds:g} m/s: its coefficient there drives the "
                  f"bodies, or is not finite", "give one whose coefficient has the sign of v, or is 0")  # fmt: skip
        return Coulomb(0.0, 1.0)
    return found


def joint_model(arg: Argument, value: Any) -> Any:
    """Reader of a joint model: returns it with plain numbers; None, for the kinematic model, where it cannot be used."""
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
                                       f"into the race",
                                       "give inner <= outer: inner of the pin on l, outer of the race on k")  # fmt: skip
    normal_law(arg.part("model.normal"), model.normal)
    if model.friction is not None:
        friction_law(arg.part("model.friction"), model.friction)


def _augments(model: JointModel) -> bool:
    """Whether the model has a scaling or penalty (`symbolic.law.AUGMENTED`)."""
    return isinstance(model, Constrained) and (model.scaling != 1 or model.penalty != 0)


def refusal(law: type[Joint], model: JointModel) -> tuple[str, str] | None:
    """What a joint lacks for a model, and what to use instead; None where it can be modelled so."""
    name = law.__name__
    if isinstance(model, Clearance) and law.loose is None:
        return f"{shown(model)} exists for joints with a pin in a race, not for a {name}", \
            "use mb.Kinematic() or another joint model"  # fmt: skip
    if _augments(model) and "scaling" not in law.params:
        return shown(model), f"a {name} has no scaling and penalty; omit them"
    if isinstance(model, Classical | Recursive) and not law.coordinates:
        return f"{shown(model)}, but a {name} has no coordinates", "use mb.Kinematic()"
    if isinstance(model, Classical) and law.scalars().keys() != law.coordinates.keys():
        return f"{shown(model)}, but a {name} has a free rotation, which no three angles describe everywhere", \
            f"use mb.Kinematic(){' or mb.Recursive()' * law.states_motion()}"  # fmt: skip
    if isinstance(model, Recursive) and not law.states_motion():
        return f"{shown(model)}, but {name} does not state its motion", "state `motion(self, from_k)`, or use mb.Kinematic()"
    return None


def law_of(arg: Argument, law: type[Joint], model: JointModel | None) -> tuple[type[Joint], dict[str, Any]]:
    """The law of a joint in the model stated, and what the model gives it: whether its coordinates are kept, scaling and penalty
    where they differ from 1 and 0."""
    wrong = None if model is None else refusal(law, model)
    if wrong is not None or model is None:
        if wrong is not None:
            arg.wrong(*wrong)
        return law, {}
    if isinstance(model, Clearance):
        assert law.loose is not None
        return law.loose, {"tilting": model.length is not None}
    if not isinstance(model, Constrained):
        return law, {"kept": True}
    extra = {"scaling": model.scaling} if model.scaling != 1 else {}
    return law, extra | ({"penalty": model.penalty} if model.penalty else {}) | {"kept": isinstance(model, Classical)}
