"""New scenes with other joint models: the statements repeated with another argument `model`."""

from __future__ import annotations

from functools import cache
from inspect import signature
from typing import Any

from mbdae.errors import SceneError
from mbdae.scene.components import Beam, Connection, JointModel, Kinematic, Recursive
from mbdae.scene.items import SceneItems
from mbdae.scene.models import MODELS, refusal
from mbdae.scene.record import STATEMENTS, Statement, encode, item_name
from mbdae.scene.replay import Known, refuse_losses, replay
from mbdae.scene.sensed import keep_read_coordinates
from mbdae.scene.topology import spanning_tree
from mbdae.values import shown

FEW = 2  #: `replace` without names changes only joints with up to this number of coordinates


@cache
def _model_places() -> dict[str, int | None]:
    """Statements whose item may have a joint model, with the position of the argument `model` among those that follow self; None:
    it is given by name only."""
    found = {}
    for name, method in STATEMENTS.items():
        arguments = list(signature(method).parameters)
        if "model" in arguments or "further" in arguments:
            found[name] = arguments.index("model") - 1 if "model" in arguments else None
    return found


def replaced(scene: SceneItems, names: tuple[str, ...], model: JointModel) -> Any:
    """The scene with another model of some joints; see `SceneData.replace`."""
    if scene.problems:
        raise SceneError(scene.problems)
    if not isinstance(model, JointModel):
        raise SceneError([f"replace: model = {shown(model)} is not a joint model; use {MODELS}"])
    known = [c.name for c in scene.joints if c.has_models]
    wrong = [n for n in names if not (isinstance(n, str) and n in known)]
    if wrong:
        raise SceneError([f"replace: names = {shown(n)} is no joint with coordinates of scene '{scene.name}'; there are "
                          f"{', '.join(map(repr, known)) or 'none'}"
                          for n in wrong])  # fmt: skip
    refused = {n: why for n in names if (why := refusal(type(_ideal(scene[n])), model)) is not None}
    if refused:
        raise SceneError([f"replace: {scene[n].kind} '{n}': model = {model_and_reason}; {what_to_do}"
                          for n, (model_and_reason, what_to_do) in refused.items()])  # fmt: skip
    few = [n for n in known if len(scene[n].coordinates) <= FEW]
    chosen = set(names or (n for n in few if refusal(type(_ideal(scene[n])), model) is None))
    if not chosen:
        raise SceneError([f"replace: no joint of scene '{scene.name}' with {FEW} coordinates or fewer can have "
                          f"model = {shown(model)}; name a joint to see what it lacks"])
    statements: list[Statement] = []
    own, places = dict(scene.own), _model_places()
    for method, args, kwargs in scene.statements:
        if method in places and item_name([method, args, kwargs]) in chosen:
            args, kwargs = _with_model(args, kwargs, encode(model, own), places[method])
        statements.append([method, args, kwargs])
    data = {"name": scene.name, "gravity": scene.gravity.tolist(), "space": scene.space, "statements": statements}
    found = replay(data, type(scene), Known(own))
    refuse_losses(scene, found)
    return found


def keeping(scene: SceneItems, read: list[str]) -> Any:
    """A copy of the scene in which the angles of joints that these paths of sensors read are unknowns of their own."""
    data = {"name": scene.name, "gravity": scene.gravity.tolist(), "space": scene.space, "statements": scene.statements}
    found = replay(data, type(scene), Known(dict(scene.own)))
    refuse_losses(scene, found)
    keep_read_coordinates(found, read)
    return found


def _ideal(joint: Connection) -> Any:
    """The law of a joint; where it has clearance, that of the joint without it."""
    return joint.as_kinematic[0] if joint.loose else joint.joint


def with_recursive_tree(scene: SceneItems) -> Any:
    """The scene with a spanning tree of recursive joints; see `SceneData.recursive`."""
    if scene.problems:
        raise SceneError(scene.problems)
    turning = [c for c in scene.joints if may_be_recursive(c)]
    closing = [c.name for c in spanning_tree(scene, turning).closing]
    tree = [c.name for c in turning if c.name not in closing]
    variant: Any = replaced(scene, tuple(tree), Recursive()) if tree else scene
    return replaced(variant, tuple(closing), Kinematic()) if closing else variant


def may_be_recursive(c: Connection) -> bool:
    """Whether a joint can be recursive where it closes no loop."""
    points = c.k.is_point or c.l.is_point
    return c.has_models and refusal(type(_ideal(c)), Recursive()) is None and not (points or c.loose or c.rubs)


def with_open_tree(scene: SceneItems) -> Any | None:
    """The scene with recursive joints in place of those whose model its statements leave open, where the joints of rigid bodies
    form a tree without friction that can stick; None where there is nothing to change, or a statement cannot be repeated."""
    joints = [c for c in scene.joints if not c.loose]
    open_ = [c.name for c in joints if c.left_open and may_be_recursive(c) and "rotation" not in map(c.unit, c.coordinates)]
    sticking = any(law.may_stick(law.states) for c in joints for law in c.laws)
    if not open_ or sticking or scene.problems or any(isinstance(b, Beam) for b in scene.bodies):
        return None
    if spanning_tree(scene, joints).closing:
        return None
    try:
        return replaced(scene, tuple(open_), Recursive())
    except SceneError:
        return None


def _with_model(args: list[Any], kwargs: dict[str, Any], model: Any, place: int | None) -> tuple[list[Any], dict[str, Any]]:
    """Arguments of a joint's statement with another model, by position (`place`) or by name."""
    if place is not None and len(args) > place:
        return [*args[:place], model, *args[place + 1 :]], kwargs
    return args, {**kwargs, "model": model}
