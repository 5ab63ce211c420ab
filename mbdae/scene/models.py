"""The tree of a scene: the joint from which the position of each body follows, and the joints that close loops.

The model of a joint as the user states it: checks of its values, and what it makes of the joint's law.

New scenes with other joint models: the statements repeated with another argument `model`.
"""

from __future__ import annotations

from collections.abc import Collection
from copy import copy
from dataclasses import dataclass, replace
from functools import cache
from inspect import signature
from typing import TYPE_CHECKING, Any, TypeVar
from weakref import WeakValueDictionary

from mbdae.deferred import Later, later
from mbdae.errors import LawError, SceneError
from mbdae.scene.changed import refuse_losses
from mbdae.scene.components import Beam, Body, Classical, Clearance, Connection, Constrained, JointModel, Kinematic, Recursive
from mbdae.scene.reading import Argument, instance, quantity
from mbdae.scene.record import STATEMENTS, SceneItems, Statement, encode, item_name
from mbdae.scene.replay import Known, replay
from mbdae.scene.sensed import keep_read_coordinates
from mbdae.symbolic.joint import Joint
from mbdae.values import shown

if TYPE_CHECKING:
    from mbdae.laws.contact import Normal
    from mbdae.laws.friction import Coulomb, Friction
else:
    Normal = Later("mbdae.laws.contact", "Normal")
    Coulomb, Friction = later("mbdae.laws.friction", "Coulomb", "Friction")

T = TypeVar("T")


@dataclass(frozen=True)
class Tree:
    """Spanning forest: (parent, joint, child) from the roots outwards, the roots, and the joints that close loops."""

    edges: list[tuple[Body, Connection, Body]]
    roots: list[Body]
    closing: list[Connection]

    def loop(self, joint: Connection) -> list[Connection]:
        """The joints of the loop that a joint closes, this one first."""
        carrier = {child: (parent, tree_joint) for parent, tree_joint, child in self.edges}

        def ways(body: Body) -> list[Connection]:
            """The joints from a body to its root."""
            found = []
            while body in carrier:
                body, tree_joint = carrier[body]
                found.append(tree_joint)
            return found

        one, other = ways(joint.k), ways(joint.l)
        return [joint, *(j for j in one if j not in other), *(j for j in other if j not in one)]


def leader(item: T, leads: dict[T, T]) -> T:
    """The representative of the group of `item`; leads: item -> an item of its group nearer to the representative; the way to it
    is shortened for later calls."""
    while item in leads:
        before, item = item, leads[item]
        leads[before] = leads.get(item, item)
    return item


def spanning_tree(scene: SceneItems, joints: Collection[Connection] | None = None) -> Tree:
    """Spanning forest in which recursive joints come first, then rigid ones, then those whose start is prescribed or held, then
    the order of the scene; joints with clearance come last. Where bodies float freely, a root is one that is l of no joint, if
    there is one: values held at the start then move l relative to k, whichever body was stated first.

    joints: those that count; all by default."""
    leads: dict[Body, Body] = {}
    chosen: list[Connection] = []
    closing: list[Connection] = []
    for joint in sorted(scene.joints if joints is None else joints, key=_rank):
        a, b = leader(joint.k, leads), leader(joint.l, leads)
        if a is b or joint.others:
            closing.append(joint)
        else:
            leads[a] = b
            chosen.append(joint)
    edges: list[tuple[Body, Connection, Body]] = []
    roots: list[Body] = []
    seen: set[Body] = set()
    joined: dict[Body, list[tuple[Connection, Body]]] = {}  #: body -> its joints, each with the body on its other side
    for joint in chosen:
        for a, b in ((joint.k, joint.l), (joint.l, joint.k)):
            joined.setdefault(a, []).append((joint, b))
    carried = {joint.l for joint in chosen}
    for root in [scene.ground, *sorted(scene.bodies, key=carried.__contains__)]:
        if root not in seen:
            roots.append(root)
            seen.add(root)
            _grow(root, joined, seen, edges)
    return Tree(edges, roots, closing)


def _grow(root: Body, joined: dict[Body, list[tuple[Connection, Body]]], seen: set[Body],
          edges: list[tuple[Body, Connection, Body]]) -> None:
    front = [root]
    for parent in front:
        for joint, child in joined.get(parent, ()):
            if child not in seen:
                seen.add(child)
                edges.append((parent, joint, child))
                front.append(child)


def _rank(c: Connection) -> tuple[bool, ...]:
    return c.loose, not c.recursive, not c.rigid, not is_held(c)


def is_held(joint: Connection) -> bool:
    """Whether the start of the joint's coordinate is fixed by the user."""
    return bool(joint.prescribed or joint.hold or joint.hold_rate)


def not_joined(scene: SceneItems) -> tuple[str, ...]:
    """Names of bodies that no chain of joints connects with the ground: free bodies, or ones whose joint was forgotten."""
    holding = [c for c in scene.connections if c.is_joint or c.kind in ("interface", "inertia")]
    pairs = [{side.name for side in (c.k, c.l, *c.others.values())} for c in holding]
    joined, size = {scene.ground.name}, 0
    while size < len(joined):
        size = len(joined)
        joined.update(*(pair for pair in pairs if pair & joined))
    return tuple(b.name for b in scene.bodies if b.name not in joined and b is not scene.ground)


MODELS = "mb.Kinematic(), mb.Classical(), mb.Recursive() or mb.Clearance(outer, inner, normal)"  #: joint models, in messages
normal_law = instance(Normal, "normal law", "give mb.Hertz(stiffness, damping)")


def friction_law(arg: Argument, value: Any) -> Any:
    """Reader of a friction law. One without internal states is refused where it feeds energy at some sliding velocity."""
    found = instance(Friction, "friction law", "give mb.Coulomb(mu, v_c), mb.LuGre(...) or None", Coulomb(0.0, 1.0))(arg, value)
    if found is not value or found.states:
        return found
    try:
        feeds = found.feeds_at()
    except LawError as error:
        arg.scene.problems.append(f"{arg.item}: {arg.option}: {error}")
        return Coulomb(0.0, 1.0)
    if feeds is not None:
        arg.wrong(f"{shown(value)} does not brake at the sliding velocity v = {feeds:g} m/s: its coefficient there drives the "
                  f"bodies, or is not finite", "give one whose coefficient has the sign of v, or is 0")
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
                                       "give inner <= outer: inner of the pin on l, outer of the race on k")
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
            "use mb.Kinematic() or another joint model"
    if _augments(model) and "scaling" not in law.params:
        return shown(model), f"a {name} has no scaling and penalty; omit them"
    if isinstance(model, Classical | Recursive) and not law.coordinates:
        return f"{shown(model)}, but a {name} has no coordinates", "use mb.Kinematic()"
    if isinstance(model, Classical) and law.scalars().keys() != law.coordinates.keys():
        return f"{shown(model)}, but a {name} has a free rotation, which no three angles describe everywhere", \
            f"use mb.Kinematic(){' or mb.Recursive()' * law.states_motion()}"
    if isinstance(model, Recursive) and law.velocity_constraints is not Joint.velocity_constraints:
        return f"{shown(model)}, but a {name} states rows of velocities", "state them in their own law, or use mb.Kinematic()"
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
                          for n in wrong])
    refused = {n: why for n in names if (why := refusal(type(_ideal(scene[n])), model)) is not None}
    if refused:
        raise SceneError([f"replace: {scene[n].kind} '{n}': model = {model_and_reason}; {what_to_do}"
                          for n, (model_and_reason, what_to_do) in refused.items()])
    few = [n for n in known if len(scene[n].coordinates) <= FEW]
    chosen = set(names or (n for n in few if refusal(type(_ideal(scene[n])), model) is None))
    if not chosen:
        raise SceneError([f"replace: no joint of scene '{scene.name}' with {FEW} coordinates or fewer can have "
                          f"model = {shown(model)}; name a joint to see what it lacks"])
    own = dict(scene.own)
    data = {"name": scene.name, "gravity": scene.gravity.tolist(), "space": scene.space,
            "statements": _with_models(scene, chosen, model, own)}
    found = replay(data, type(scene), Known(own))
    refuse_losses(scene, found)
    return found


def _with_models(scene: SceneItems, chosen: Collection[str], model: JointModel, own: dict[str, Any]) -> list[Statement]:
    """The statements of a scene, with another model of the chosen joints; classes that this needs are entered in `own`."""
    statements: list[Statement] = []
    places, plain = _model_places(), encode(model, own)
    for method, args, kwargs in scene.statements:
        if method in places and item_name([method, args, kwargs]) in chosen:
            args, kwargs = _with_model(args, kwargs, plain, places[method])
        statements.append([method, args, kwargs])
    return statements


def keeping(scene: Any, read: list[str]) -> Any:
    """A copy of the scene in which the angles of joints that these paths of sensors read are unknowns of their own."""
    found = scene._copied()
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
    form a tree without friction that can stick; None where there is nothing to change. Its joints are its own, all else is
    shared with the scene."""
    joints = [c for c in scene.joints if not c.loose]
    open_ = [c.name for c in joints if c.left_open and may_be_recursive(c)]
    sticking = any(law.may_stick(law.states) for c in joints for law in c.laws)
    if not open_ or sticking or scene.problems or any(isinstance(b, Beam) for b in scene.bodies):
        return None
    if spanning_tree(scene, joints).closing:
        return None
    chosen, own = set(open_), dict(scene.own)
    found, of = object.__new__(type(scene)), vars(scene).setdefault("_open_tree", [])  # of the scene that was taken last
    vars(found).update({name: copy(value) if isinstance(value, list | dict) else value for name, value in vars(scene).items()
                        if name != "_open_tree"})
    statements, joints = _with_models(scene, chosen, Recursive(), own), scene.connections
    same = of and of[0] == (chosen, len(statements), len(joints))
    known, models = (dict(zip(map(id, of[1]), of[2], strict=True)), of[3]) if same else ({}, WeakValueDictionary[Any, Any]())
    vars(found).update(statements=[known.get(id(a), b) for a, b in zip(scene.statements, statements, strict=True)], own=own,
                       connections=[known.get(id(c)) or (_recursive(c, c.name in chosen) if c.is_joint else c) for c in joints],
                       _known={"ground": scene.ground}, _read=[0] * len(scene._read), _models=models)
    of[:] = (chosen, len(statements), len(joints)), (*scene.statements, *joints), (*found.statements, *found.connections), models
    return found


def _recursive(c: Connection, chosen: bool) -> Connection:
    """A copy of a joint and of its laws, which is recursive if it is chosen."""
    laws, kinematic = ([copy(law) for law in some] for some in (c.laws, c.as_kinematic))
    if not chosen:
        return replace(c, laws=laws, as_kinematic=kinematic)
    for law in (law for law in laws if hasattr(law, "kept")):
        vars(law)["kept"] = True
    return replace(c, laws=laws, as_kinematic=[copy(law) for law in c.laws], model=Recursive(), left_open=False)


def _with_model(args: list[Any], kwargs: dict[str, Any], model: Any, place: int | None) -> tuple[list[Any], dict[str, Any]]:
    """Arguments of a joint's statement with another model, by position (`place`) or by name."""
    if place is not None and len(args) > place:
        return [*args[:place], model, *args[place + 1 :]], kwargs
    return args, {**kwargs, "model": model}
