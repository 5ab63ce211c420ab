"""A scene in which numbers of some statements are others: it shares all items with the scene it comes from but those of these
statements and of all that name them. Of these, items on bodies that are drawn as they were are not read anew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mbdae.errors import MbdaeError, SceneError
from mbdae.scene.components import Beam, Body, Connection
from mbdae.scene.record import SceneItems, Statement, encode, models_of
from mbdae.scene.replay import KINDS, Known, repeat
from mbdae.scene.sensed import read_by
from mbdae.symbolic.class_checks import PLACES


def with_statements(scene: SceneItems, statements: list[Statement]) -> Any:
    """A scene by statements of which some state other numbers. None where it cannot be told what they touch, as beside beams, or
    where one of them is wrong."""
    statements = [old if new is old or new == old else new for new, old in zip(statements, scene.statements, strict=True)]
    touched = scene._touched(statements)
    if scene.problems or touched is None or any(isinstance(b, Beam) for b in scene.bodies):
        return None
    made, _, _ = object.__new__(type(scene)), models_of(scene), vars(scene).setdefault("_stated", {})
    vars(made).update(vars(scene), statements=statements, problems=[], numbers={}, recording=False, _as_named={}, told=[],
                      _known=dict(scene._by_name), _wanted={name: set(of) for name, of in scene._wanted.items()},
                      bodies=[*scene.bodies], connections=[*scene.connections], frames=dict(scene.frames))
    vars(made)["_shares"] = tuple({id(b.scene): b.scene for b in (scene.ground, *scene.bodies)}.values())
    own = [i for i in touched if statements[i] is not scene.statements[i]]
    of_bodies = all(isinstance(scene._by_name.get(touched[i]), Body) and statements[i][0] != "frame" for i in own)
    bodies: dict[Any, Any] = {}  # those that are drawn as they were, by those in the place of which they are
    try:
        for i in sorted(touched):
            if of_bodies and i not in own and _onto(made, statements[i][0], touched[i], bodies):
                continue
            old = _repeated(made, i, touched[i], scene)
            new: Any = made._known.get(touched[i])
            if isinstance(old, Body) and drawn_as(new, old):
                bodies[old] = new
                vars(new).update(drawn=old.drawn, outline=old.outline, shapes=old.shapes)
            if isinstance(old, Connection) and read_by(new) != read_by(old):
                return None  # which coordinates are unknowns of their own may change
    except MbdaeError:  # it is told of all statements
        return None
    if made.problems or len(made._items) != len(scene._items):  # a wrong number, or a statement that makes several items
        return None
    made.recording = True
    vars(made).update(numbers=scene.numbers | made.numbers, _read=[*scene._read])
    return made


def _repeated(made: Any, number: int, name: str, scene: SceneItems) -> Any:
    """Make an item anew by the statement of a number, in the place of the one that the scene has; returns that one."""
    statement = made.statements[number]
    if statement[0] == "frame":
        old = made.frames.pop(name)
        repeat(made, statement, Known(scene.own))
        vars(made)["frames"] = {frame: made.frames[frame] for frame in scene.frames}
        return old
    old = made._known.pop(name)
    items: list[Any] = made.bodies if isinstance(old, Body) else made.connections
    at = items.index(old)
    del items[at]
    vars(made)["_read"] = [len(made.bodies), len(made.connections), *scene._read[2:]]
    read = vars(made)["_stated"]
    read[statement[0], name] = repeat(made, statement, Known(scene.own), read.get((statement[0], name), ({}, {})))
    items.insert(at, items.pop())
    made._known[name] = items[at]
    return old


def _onto(made: Any, method: str, name: str, bodies: Mapping[Any, Any]) -> bool:
    """Put a joint, force or frame on the bodies that are in the place of others (old -> new), drawn as these; False where one of
    its bodies is drawn otherwise. method: that states it."""
    def moved(thing: Any) -> Any:
        other = object.__new__(type(thing))
        vars(other).update((key, bodies.get(v, v) if isinstance(v, Body) else v) for key, v in vars(thing).items())
        return other

    if method == "frame":
        frame = made.frames[name]
        made.frames[name] = replace(frame, body=bodies.get(frame.body, frame.body))
        return frame.body in bodies
    old = made._known.get(name)
    if not isinstance(old, Connection) or not all(
            body in bodies or body is made._known.get(body.name) for body in (old.k, old.l, *old.others.values())):
        return False
    made._known[name] = made.connections[made.connections.index(old)] = new = moved(old)
    vars(new).update(laws=[moved(law) for law in old.laws], as_kinematic=[moved(law) for law in old.as_kinematic],
                     others={side: bodies.get(body, body) for side, body in old.others.items()})
    return True


def drawn_as(body: Body, other: Body) -> bool:
    """Whether a body is drawn as another one, and starts as it: they differ in mass, inertia and gravity at most."""
    a, b = vars(body), vars(other)
    if any(a[key] != b[key] for key in ("is_point", "principal_plane", "color")) or not (
            a["shapes"] is b["shapes"] or encode(a["shapes"]) == encode(b["shapes"])):
        return False
    pairs = [] if a["drawn"] is b["drawn"] else [*zip(vars(a["drawn"]).values(), vars(b["drawn"]).values(), strict=True)]
    return all(x is y or np.array_equal(x, y) for x, y in (*pairs, (a["outline"], b["outline"])))


def carried_over(item: Connection, other: Connection) -> bool:
    """Whether a joint or force states the same as another one, on bodies that are drawn as those of the other one."""
    def same(a: Any, b: Any) -> bool:
        x, y = vars(a), vars(b)
        return type(a) is type(b) and x.keys() == y.keys() and all(
            v is y[key] or (isinstance(v, Body) and drawn_as(v, y[key])) or (type(v) is float and v == y[key])
            for key, v in x.items() if key not in ("laws", "as_kinematic", "others"))

    parts, theirs = ([*c.laws, *c.as_kinematic] for c in (item, other))
    return same(item, other) and len(parts) == len(theirs) and all(map(same, parts, theirs)) and all(
        drawn_as(body, other.others[side]) for side, body in item.others.items())


def refuse_losses(scene: Any, copy: Any) -> None:
    """Raise SceneError where a user's own law in a copy of a scene lacks an attribute of the law in the scene that is neither a
    parameter nor an option, or has another value of it."""
    for old, new in zip(scene.connections, copy.connections, strict=True):
        for law, again in zip(old.laws, new.laws, strict=False):
            if type(law) is not type(again) or type(law).__module__.startswith("mbdae."):
                continue
            for name in sorted(vars(law).keys() - {"params", "states", *KINDS, *PLACES}):
                if name not in vars(again) or encode(vars(law)[name]) != encode(vars(again)[name]):
                    raise SceneError([f"'{old.name}': the attribute {name} of {type(law).__name__} would be lost in a copy of "
                                      f"the scene: declare it in the class, in `params` (numbers) or `options`"])
