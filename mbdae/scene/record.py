"""The statements of a scene, recorded as plain data: stored as JSON, repeated by `replay`.

The data of a scene, on which all statements work: its items by name, the statements made, the mistakes found.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache, lru_cache, wraps
from inspect import Signature, signature
from itertools import count
from types import FunctionType
from typing import Any, TypeVar
from weakref import WeakValueDictionary

import numpy as np
import symengine as se

from mbdae.errors import NamesAttributes, SceneError, meant
from mbdae.inputs import text, timed
from mbdae.inputs.tables import from_data, lookup_of
from mbdae.notation import Arguments
from mbdae.scene import reading
from mbdae.scene.components import AsGiven, Beam, BeamLoad, Body, Connection, Controller, Place, Signal
from mbdae.scene.reading import Argument, Reader
from mbdae.scene.sensed import keep_read_coordinates, keep_wanted, read_by
from mbdae.symbolic.class_checks import PLACES
from mbdae.symbolic.joint import Coupling
from mbdae.symbolic.law import Law
from mbdae.symbolic.part import Part
from mbdae.symbolic.rebuild import nodes
from mbdae.values import fixed, number, shown

F = TypeVar("F", bound=Callable[..., Any])
Statement = list[Any]  #: [method, positional arguments, keyword arguments], of values that JSON can store
Own = dict[str, Any]  #: classes and functions by the names that statements give them
PACKAGE = __name__.partition(".")[0]

@dataclass(frozen=True, eq=False)
class FrameOnBody:
    """A frame fixed to a body: point (3,), m, and axes (3, 3) by columns, as drawn."""

    name: str
    body: Body
    point: np.ndarray[Any, Any]
    axes: np.ndarray[Any, Any]


STATEMENTS: dict[str, Callable[..., Any]] = {}  #: methods that are statements, by name: all that a stored scene may call


def statement(method: F) -> F:
    """Record the calls of a public method of a scene in `scene.statements`; calls between methods are not recorded."""
    names = Arguments(signature(method)).placed

    @wraps(method)
    def recorded(self: Any, *args: Any, **kwargs: Any) -> Any:
        if self.recording:
            given = dict(zip(names, args, strict=False)) | kwargs
            told = {k: encode(self._as_named.get(k, v), self.own) for k, v in given.items()}
            positional = min(len(args), len(names))
            more = [encode(a, self.own) for a in args[positional:]]
            self.statements.append([method.__name__, [*(told.pop(k) for k in names[:positional]), *more], told])
            self._as_named = {}
        before, self.recording = self.recording, False
        others = [one for one in self._shares if one.recording]  # until the statement ends, it sets what belongs to its items
        for one in others:
            one.recording = False
        try:
            return method(self, *args, **kwargs)
        finally:
            self.recording = before
            for one in others:
                one.recording = True

    STATEMENTS[method.__name__] = recorded
    return recorded  # type: ignore[return-value]


@cache
def signature_of(method: str) -> Signature:
    """The signature of a statement."""
    return signature(STATEMENTS[method])


@cache
def arguments_of(method: str) -> Arguments:
    """The arguments of a statement."""
    return Arguments(signature_of(method))


def item_name(statement_: Statement) -> Any:
    """The name of the item of a recorded statement; None where it has none."""
    method, args, kwargs = statement_
    given = {**dict(zip(arguments_of(method).names if method in STATEMENTS else (), args, strict=False)), **kwargs}
    law = given.get("law")
    return law.get("name") if isinstance(law, dict) else given.get("name")


def without(statement_: Statement, words: tuple[str, ...]) -> Statement:
    """A recorded statement that leaves out arguments, given by name or by place."""
    method, args, kwargs = statement_
    names = arguments_of(method).names
    last = next((i for i, name in enumerate(names[: len(args)]) if name in words), len(args))
    given = {**dict(zip(names[last:], args[last:], strict=False)), **kwargs}
    return [method, args[:last], {name: value for name, value in given.items() if name not in words}]


def encode(value: Any, own: Own | None = None) -> Any:
    """JSON-able form of an argument; classes and functions in it are kept in `own`, by the names they get."""
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, int | float):
        return float(value) if isinstance(value, float) else int(value)
    if isinstance(value, Body):
        return {"body": value.name}
    if isinstance(value, Place):
        return {"place": value.body.name, "point": value.point.tolist()}
    if isinstance(value, Law):
        return _encode_law(value, own)
    if isinstance(value, type | FunctionType):
        return {"class": stored_name(value, own)}
    if isinstance(value, AsGiven):
        return _encode_as_given(value, own)
    if isinstance(value, Mapping):
        return {"by": {str(key): encode(v, own) for key, v in value.items()}}
    if isinstance(value, list | tuple):
        return [encode(v, own) for v in value]
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biufUS":
        return value.tolist() if value.dtype.kind != "S" else {"unreadable": shown(value)}
    if isinstance(value, np.ndarray) and value.dtype == object:
        return [encode(v, own) for v in value] if value.ndim else encode(value.item(), own)
    if isinstance(value, Part):
        given = {key: v for key, v in value.values().items() if v is not None}
    elif is_dataclass(value):
        given = {f.name: getattr(value, f.name) for f in fields(value)}
    else:
        return _encode_expression(value)
    return {"object": stored_name(type(value), own), "fields": {key: encode(v, own) for key, v in given.items()}}


def _encode_as_given(value: AsGiven, own: Own | None) -> dict[str, Any]:
    """Keep the object itself in `own`, and encode its value as plain data for files."""
    number = 0 if own is None else next(n for n in count() if own.setdefault(f"kept {n}", value) is value)
    return {"kept": f"kept {number}", "plain": encode(value.value)}


def stored(e: Any) -> dict[str, Any]:
    """An expression of time as plain data: its text, and the tables that it names."""
    found = {lookup.table.name: lookup.table.as_data for node in nodes(e) if (lookup := lookup_of(node)) is not None}
    return {"expression": text.written(e)} | ({"tables": found} if found else {})


def tables_in(data: Any) -> Iterator[tuple[str, Any]]:
    """Names and data of all tables in nested plain data."""
    if isinstance(data, dict) and set(data) == {"expression", "tables"}:
        yield from data["tables"].items()
    elif isinstance(data, dict | list):
        for part in data.values() if isinstance(data, dict) else data:
            yield from tables_in(part)


def read(stored_: Any) -> Any:
    """The expression of time from data that `stored` made; ValueError where that cannot be read."""
    for name, data in stored_.get("tables", {}).items():
        from_data(name, data)
    return text.read(stored_["expression"])


_of_expression = lru_cache(1024)(lambda value: stored(timed.expression(value, sensors=True, named=True)))


def _encode_expression(value: Any) -> Any:
    try:
        if not getattr(value, "free_symbols", None):
            return number(value)
        return dict((_of_expression if isinstance(value, se.Basic) else _of_expression.__wrapped__)(value))
    except Exception:  # the statement that is recorded reports the mistake when it runs
        return {"unreadable": shown(value)}


def _encode_law(law: Law, own: Own | None) -> dict[str, Any]:
    values = {key: encode(getattr(law, key), own) for key in (*type(law).params, *type(law).options)}
    if isinstance(law, Coupling):
        of = {c: at if isinstance(at, str) else ".".join(at) for c, at in law.of.items()}
        return {"coupling": stored_name(type(law), own), "name": law.name, "of": of, "values": values}
    places = {key: encode(getattr(law, key), own) for key in ("k", "l", *PLACES)}
    if len(law.frames) > 2:
        points = {f"at_{side}": encode(point, own) for side, point in law.points.items()}
        places["others"] = {"by": {side: encode(getattr(law, side), own) for side in law.frames[2:]} | points}
    return {"law": stored_name(type(law), own), "name": law.name, **places, "values": values}


def stored_name(thing: type | FunctionType, own: Own | None = None) -> str:
    """The name "module:qualname" of a class or function, "mbdae:qualname" of mbdae's own, wherever in the package it is defined;
    another one of the same name gets a number after it."""
    path = without_module(f"{thing.__module__}:{thing.__qualname__}")
    if own is None:
        return path
    name, number = path, 1
    while own.setdefault(name, thing) is not thing:
        number += 1
        name = f"{path} ({number})"
    return name


def without_module(name: str) -> str:
    """The name "module:qualname" of a class; for classes of mbdae "mbdae:qualname". Files of older versions name the module of
    mbdae in which a class was defined, which may have changed."""
    module, _, own = name.partition(":")
    return f"{PACKAGE}:{own}" if module.startswith(f"{PACKAGE}.") else name


READ: dict[str, Reader] = {"name": reading.name, "space": reading.one_of("auto", "planar", "spatial"),
        "gravity": lambda arg, value: fixed(reading.vector("m/s^2")(arg, value))}

KEPT = {"recording", "_shares", "_known", "_sent", "_as_named"}  #: attributes by which a scene keeps what it found


class SceneItems(NamesAttributes):
    """The items of a scene by name (bodies, joints, forces, loads, signals, controllers), the statements made, the mistakes
    found."""

    def __init__(self, name: str = "scene", gravity: Any = (0.0, 0.0, 0.0), space: str = "auto") -> None:
        """`gravity` (3,) in m/s^2; `space` "auto" (planar where that can be proved), "planar" or "spatial"."""
        self.problems: list[str] = []
        self.name, self.space, self.gravity = name, space, gravity  # read by __setattr__
        self.statements: list[Statement] = []  #: the statements made on the scene, in order, as plain data (see `record.py`)
        self.own: Own = {}  #: classes and functions by the names they have in `statements`
        self.recording = True
        self.numbers: dict[str, float] = {}  #: values of the named numbers in statements (`mb.number`), by name
        self._as_named: dict[str, Any] = {}  #: arguments of the statement under way that contain named numbers
        eye, zero = np.eye(3), np.zeros(3)
        self.ground = Body("ground", math.inf, None, zero, eye, zero, zero, is_ground=True, scene=self)
        self.bodies: list[Body] = []
        self.connections: list[Connection] = []
        self.line_loads: list[BeamLoad] = []
        self.signals: list[Signal] = []  #: states, named expressions, outputs of controllers
        self.controllers: list[Controller] = []
        self._known: dict[str, Any] = {"ground": self.ground}  #: items by name, as far as `_by_name` has read the lists
        self._read = [0] * 5  #: how many entries of each list `_by_name` has read
        self.frames: dict[str, FrameOnBody] = {}  #: named frames on bodies
        self.told: list[str] = []  #: what a scene that was read from a file says otherwise than the file
        self._shares: tuple[Any, ...] = ()  #: scenes with which it shares items
        self._wanted: dict[str, set[str]] = {}  #: joint's name -> its quantities that sensors read, see `keep_read_coordinates`
        self.attachments: dict[Beam, tuple[float, ...]] = {}  #: places on beams where something is attached, see `nearest_place`

    def __setattr__(self, name: str, value: Any) -> None:
        """Read what may be set after the scene was made too; AttributeError for everything else, which would have no effect."""
        own, read = vars(self), READ.get(name)
        made, known = "attachments" in own, len(own.get("problems", ()))
        if read is not None:
            head = f"scene '{own['name']}'" if "name" in own else "scene"
            value = read(Argument(self, head, name), value)
            if made and len(self.problems) > known:
                raise SceneError([self.problems.pop()])
        elif made and self.recording and name not in KEPT and (name in own or type(self).__module__.startswith("mbdae.")):
            raise AttributeError(f"scene '{self.name}': {meant(name, READ)}{name} = {shown(value)} would have no effect: of a "
                                 f"scene only {', '.join(READ)} are set, all else is stated (s.link, ...)")
        super().__setattr__(name, value)

    @property
    def _items(self) -> list[Any]:
        return [*self.bodies, *self.connections, *self.line_loads, *self.signals, *self.controllers]

    @property
    def joints(self) -> list[Connection]:
        """The joints, in the order of their statement."""
        return [c for c in self.connections if c.is_joint]

    @property
    def _by_name(self) -> dict[str, Any]:
        """Items by name; of equal names the one stated first."""
        lists: tuple[list[Any], ...] = self.bodies, self.connections, self.line_loads, self.signals, self.controllers
        for n, items in enumerate(lists):
            for item in items[self._read[n] :]:
                self._known.setdefault(item.name, item)
            self._read[n] = len(items)
        return self._known

    def __getitem__(self, name: str) -> Any:
        if (found := self._by_name.get(name)) is not None:
            return found
        raise SceneError([f"there is no item '{name}' in scene '{self.name}'; it has {self._names()}"])

    def _names(self) -> str:
        frames = [name for name, f in self.frames.items() if not f.body.is_ground]
        names = list(dict.fromkeys([*(item.name for item in self._items), *frames]))
        return ", ".join(repr(n) for n in names[:12]) + (", ..." if len(names) > 12 else "") or "none"

    def _touched(self, others: list[Statement]) -> dict[int, str] | None:
        """Numbers of the statements that are not those of `others`, and of all that name their items, with the names of these.
        None where one of them makes neither a body nor a connection."""
        left = [i for i, (a, b) in enumerate(zip(self.statements, others, strict=True)) if a is not b]
        names, touched = self._named, dict.fromkeys(left, "")
        while left:
            i = left.pop()
            if i not in names:
                return None
            left += (new := [j for j in names[i][1] if j not in touched])
            touched |= dict.fromkeys(new, "") | {i: names[i][0]}
        return touched

    @property
    def _named(self) -> dict[int, tuple[str, list[int]]]:
        """Number of every statement that makes a body or a connection -> its name, and the numbers of those that name it."""
        count, found = vars(self).get("_mentions", (0, {}))
        if len(self.statements) != count:
            texts, found = [repr(s[1:]) for s in self.statements], {}
            items = {*(b.name for b in self.bodies), *(c.name for c in self.connections)}
            for i, s in enumerate(self.statements):
                if (name := item_name(s)) in (self.frames if s[0] == "frame" else items):
                    alike = re.compile(rf"(?<!\w){re.escape(name)}(?!\w)")
                    found[i] = name, [j for j, text in enumerate(texts) if j != i and alike.search(text)]
            vars(self)["_mentions"] = len(self.statements), found
        return found  # type: ignore[no-any-return]

    def _keep_read_coordinates(self, item: Any) -> None:
        """Make unknowns of the coordinates that a new item reads, and of its own that others read."""
        keep_read_coordinates(self, read_by(item))
        keep_wanted(self, item)

    def _claim(self, name: str) -> None:
        """Report a name that another item has already."""
        if name != reading.NAMELESS and name in self._by_name:
            self.problems.append(f"two items have the name '{name}'; give each its own")

    def _add_body(self, body: Body) -> Body:
        body.scene = self
        self._claim(body.name)
        self.bodies.append(body)
        return body


def models_of(scene: SceneItems) -> WeakValueDictionary[Any, Any]:
    """The model that was made last, of a scene or one that shares its items, by what else it depends on, while it is in use."""
    known: WeakValueDictionary[Any, Any] | None = vars(scene).get("_models")
    return vars(scene).setdefault("_models", WeakValueDictionary()) if known is None else known


def apart(scene: SceneItems, other: SceneItems) -> set[str] | None:
    """Names of the items that a scene does not share with another one, where both come from the same one by `changed`; else
    None."""
    if len(scene.statements) != len(other.statements) or models_of(scene) is not models_of(other):
        return None
    touched = scene._touched(other.statements)
    return None if touched is None else set(touched.values())
