"""New scenes with other joint models: the statements repeated with another argument `model`."""

from __future__ import annotations

from inspect import signature
from typing import Any

from mbdae.errors import SceneError
from mbdae.scene.components import Beam, Classical, JointModel, Kinematic, Recursive
from mbdae.scene.items import SceneItems
from mbdae.scene.joints import JointStatements
from mbdae.scene.models import MODELS
from mbdae.scene.record import STATEMENTS, Statement, encode
from mbdae.scene.replay import Known, refuse_losses, replay
from mbdae.scene.topology import spanning_tree
from mbdae.values import shown

#: statements whose joint has models, and the position of the argument `model` among those that follow self
MODELLED = {name: list(arguments).index("model") - 1 for name, method in vars(JointStatements).items()
            if callable(method) and "model" in (arguments := signature(method).parameters) and name in STATEMENTS}


def replaced(scene: SceneItems, names: tuple[str, ...], model: JointModel) -> Any:
    """The scene with another model of some joints; see `SceneData.replace`."""
    if scene.problems:
        raise SceneError(scene.problems)
    if not isinstance(model, JointModel):
        raise SceneError([f"replace: model = {shown(model)} is not a joint model; use {MODELS}"])
    known = [c.name for c in scene.connections if c.kind in MODELLED]
    wrong = [n for n in names if not (isinstance(n, str) and n in known)]
    if wrong:
        raise SceneError([f"replace: names = {shown(n)} is no revolute or prismatic joint of scene '{scene.name}'; it has {known}"
                          for n in wrong])  # fmt: skip
    plain = model in (Kinematic(), Classical(), Recursive())
    chosen = set(names or (c.name for c in scene.connections if c.kind == "revolute" or (plain and c.name in known)))
    if not chosen:
        raise SceneError([f"scene '{scene.name}' has no joint whose model could be replaced by {shown(model)}"])
    statements: list[Statement] = []
    own = dict(scene.own)
    for method, args, kwargs in scene.statements:
        if method in MODELLED and (args[0] if args else kwargs["name"]) in chosen:
            args, kwargs = _with_model(args, kwargs, encode(model, own), MODELLED[method])
        statements.append([method, args, kwargs])
    data = {"name": scene.name, "gravity": scene.gravity.tolist(), "space": scene.space, "statements": statements}
    found = replay(data, type(scene), Known(own))
    refuse_losses(scene, found)
    return found


def with_recursive_tree(scene: SceneItems) -> Any:
    """The scene with a spanning tree of recursive joints; see `SceneData.recursive`."""
    if scene.problems:
        raise SceneError(scene.problems)
    turning = [c for c in scene.joints if c.kind in MODELLED and not (c.k.is_point or c.l.is_point or c.loose or c.rubs)]
    closing = [c.name for c in spanning_tree(scene, turning).closing]
    tree = [c.name for c in turning if c.name not in closing]
    variant: Any = replaced(scene, tuple(tree), Recursive()) if tree else scene
    return replaced(variant, tuple(closing), Kinematic()) if closing else variant


def with_open_tree(scene: SceneItems) -> Any | None:
    """The scene with recursive joints in place of those whose model its statements leave open, where the joints of rigid bodies
    form a tree in which nothing can stick; None where there is nothing to change, or a statement cannot be repeated."""
    joints = [c for c in scene.joints if not c.loose]
    open_ = [c.name for c in joints if c.left_open and not (c.k.is_point or c.l.is_point)]
    sticking = any(law.may_stick(law.states) for c in joints for law in c.laws)
    if not open_ or sticking or scene.problems or any(isinstance(b, Beam) for b in scene.bodies):
        return None
    if spanning_tree(scene, joints).closing:
        return None
    try:
        return replaced(scene, tuple(open_), Recursive())
    except SceneError:
        return None


def _with_model(args: list[Any], kwargs: dict[str, Any], model: Any, place: int) -> tuple[list[Any], dict[str, Any]]:
    """Arguments of a joint's statement with another model, by position (`place`) or by name as it was given."""
    if len(args) > place:
        return [*args[:place], model, *args[place + 1 :]], kwargs
    return args, {**kwargs, "model": model}
