"""Scenes from plain data: statements called again with their arguments, and nothing else.

The data may come from a file that anybody wrote. Only methods marked as statements are called, with arguments of the kinds they
take; only classes and functions that mbdae defines or that the caller hands over are used; laws and their parts are made by their
constructors; expressions are read by `inputs.text`. No name from the data is imported, looked up as an attribute or evaluated.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from functools import cache, cached_property
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np

from mbdae.deferred import Later
from mbdae.errors import MbdaeError, OptionError, SceneError
from mbdae.inputs.reduced import ReducedBody
from mbdae.laws import exported
from mbdae.scene.components import AsGiven, Body, Classical, Clearance, JointModel, Kinematic, Place, Recursive, Stop
from mbdae.scene.record import STATEMENTS, Own, Statement, arguments_of, item_name, read, stored_name, without_module
from mbdae.scene.shapes import Box, Cylinder, Plane, Point, Section, Shape, Sphere
from mbdae.symbolic.class_checks import PLACES
from mbdae.symbolic.joint import Coupling, Joint
from mbdae.symbolic.law import Force, Law, TwoBodyLaw
from mbdae.symbolic.part import Part
from mbdae.threads import check
from mbdae.values import array, shown

if TYPE_CHECKING:
    from mbdae.laws.contact import Normal
    from mbdae.laws.friction import Friction
else:
    Normal, Friction = Later("mbdae.laws.contact", "Normal"), Later("mbdae.laws.friction", "Friction")

Stated = tuple[dict[str, Any], dict[str, Any]]  #: arguments of a statement by name, as recorded and as read
#: kinds of arguments by name; the others are numbers, expressions of time, places, and lists of these
KINDS: dict[str, tuple[type, ...]] = {
    "name": (str,), "frame": (str,), "k": (str, Body, Place), "l": (str, Body, Place), "body": (str, Body, Place, ReducedBody),
    "over": (list,), "beam": (str, Body), "law": (Joint, Force, Coupling), "joint": (type,), "model": (JointModel,),
    "friction": (Friction, dict), "stop": (Stop, dict), "section": (Section,), "shape_k": (Shape,), "shape_l": (Shape,),
    "shape": (Shape, list), "color": (str, list), "normal": (Normal, list), "free": (list, str),
    "curve": (str, FunctionType), "as_given": (bool,), **dict.fromkeys(("f", "derivative", "memory"), (AsGiven,)),
    **dict.fromkeys(("reads", "sets"), (list, str)), "of": (dict,),
    **dict.fromkeys(("driving", "driven", "pinion", "rack", "first", "second", "carrier"), (str,)),
}

_OF_ITEMS = {"over", "of", "further"} | {name for name, kinds in KINDS.items() if {Body, Place, Joint, Coupling} & {*kinds}}


# ---- classes by name ---------------------------------------------------------------------------------------------------------

@cache
def _built_in() -> Own:
    """Laws, parts of laws, joint models and cross-sections that mbdae defines, by name."""
    models, shapes = (Kinematic, Classical, Recursive, Clearance, Stop), (Plane, Sphere, Point, Cylinder, Box)
    return {stored_name(cls): cls for cls in (*exported().values(), Section, ReducedBody, *models, *shapes)}


class Known:
    """The classes and functions that stored names may stand for: mbdae's own and those of the caller."""

    def __init__(self, own: Own | None = None, loose: bool = False) -> None:
        """own: by the names that statements give them; loose: the last part of a stored name suffices to find one."""
        self._given, self.loose = own or {}, loose

    @cached_property
    def own(self) -> Own:
        """All of them by name."""
        return {**self._given, **_built_in()}

    @classmethod
    def among(cls, laws: Any, further: Own | None = None) -> Known:
        """mbdae's own, `further` ones, and a caller's `laws`; OptionError where these are no list of classes and functions."""
        if isinstance(laws, str | Mapping) or not isinstance(laws, Iterable):
            raise OptionError(f"laws = {shown(laws)}: give a list of your own classes, and of functions given as curve= of "
                              f"beams, such as [MyJoint, my_curve]")
        own: Own = dict(further or {})
        for one in laws:
            if not isinstance(one, type | FunctionType):
                raise OptionError(f"laws holds {shown(one)}: give your own classes themselves (MyJoint, not its name or an "
                                  f"object), and functions given as curve= of beams")
            stored_name(one, own)
        return cls(own, loose=True)

    def find(self, name: Any, *kinds: type) -> Any:
        """What a stored name stands for; SceneError where there is nothing of that name, or nothing of these kinds."""
        if not isinstance(name, str):
            raise SceneError([f"{shown(name)} stands where the name of a class is expected: correct the stored scene"])
        name = without_module(name)
        short = name.rpartition(":")[2].rpartition(".")[2]
        known = self._given if name in self._given and not self.loose else self.own  # a copy needs no list of all laws
        found = [known[name]] if name in known else []
        if not found and self.loose:
            alike = [one for one in self._given.values() if one.__name__ == short and not one.__module__.startswith("mbdae.")]
            found = list({id(one): one for one in alike}.values())
        if len(found) != 1 or (self.loose and f"{name} (2)" in self.own):
            if found:
                raise SceneError([f"several of `laws` are called {shown(short)}: pass laws=[...] with the right one alone"])
            raise SceneError([f"{shown(name)} is neither mbdae's nor in `laws`: pass laws=[...] with {_word(short)} in it"])
        one = found[0]
        classes = tuple(kind for kind in kinds if kind is not FunctionType)
        is_class = bool(classes) and isinstance(one, type) and issubclass(one, classes)
        if not (is_class or (FunctionType in kinds and isinstance(one, FunctionType))):
            raise SceneError([f"{shown(name)} stands where {_in_words(kinds)} is expected: correct the stored scene, or pass "
                              f"laws=[...] with the right class or function"])
        return one


#: words for kinds in messages; other kinds are called by the name of their class
_KINDS_IN_WORDS: dict[type, str] = {
    str: "text", list: "a list", dict: "a dictionary", type: "a class", FunctionType: "a function", AsGiven: "a kept object",
    Part: "a friction law or another part of a law", JointModel: "a joint model", Section: "a cross-section",
    Normal: "a normal law", ReducedBody: "a reduced body", Law: "a joint, force or coupling",
}


def _in_words(kinds: Iterable[type]) -> str:
    """Kinds of arguments in a message."""
    return " or ".join(_KINDS_IN_WORDS.get(kind, f"a {kind.__name__.lower()}") for kind in kinds)


def _expected(name: str) -> str:
    """What an argument of a statement is, in a message."""
    return _in_words(KINDS[name]) if name in KINDS else "a number, an expression of mb.t, a place, or a list of these"


def _word(name: str) -> str:
    """The name of a class for a remedy; "the class" where the stored text is no name."""
    return name if name.isidentifier() and len(name) <= 60 else "the class"


def decoded(value: Any, scene: Any, known: Known) -> Any:
    """A value from its plain data."""
    return _decode(value, scene, known)


def _decode(value: Any, scene: Any, known: Known) -> Any:
    """The argument for which an encoded value stands; names of bodies in it are those of `scene`."""
    if isinstance(value, list):
        return [_decode(v, scene, known) for v in value]
    if not isinstance(value, dict):
        return value
    reader = _READERS.get(frozenset(value))
    if reader is None:
        if "unreadable" in value:
            raise SceneError([f"the argument {shown(value['unreadable'])} cannot be stored, nor the statement repeated: give "
                              f"numbers, texts, expressions of mb.t, laws or their parts"])
        raise SceneError([f"the stored argument {shown(value)} is of no kind that this version of mbdae writes: "
                          f"store the scene again"])
    return reader(value, scene, known)


def _body(name: Any, scene: Any) -> Any:
    found = scene._by_name.get(name) if isinstance(name, str) else None
    if not isinstance(found, Body):
        raise SceneError([f"it names the body {shown(name)}, which no statement before it makes: correct the stored scene"])
    return found


def _expression(value: Any, scene: Any, known: Known) -> Any:
    try:
        return read(value)
    except (ValueError, AttributeError) as reason:
        raise SceneError([f"the stored {shown(value['expression'])} is no expression of t: {reason}"]) from None


def _as_given(value: Any, scene: Any, known: Known) -> AsGiven:
    """An object of the user's own, such as the memory of a controller: the object itself where a scene of this process is
    repeated, else one made from the plain data of a file."""
    own = known.own.get(value["kept"]) if isinstance(value["kept"], str) else None
    return own if isinstance(own, AsGiven) else AsGiven(_decode(value["plain"], scene, known))


def _place(value: Any, scene: Any, known: Known) -> Place:
    return Place(_body(value["place"], scene), array(value["point"], (3,)))


def _options(value: Any, scene: Any, known: Known) -> dict[str, Any]:
    """Values of a law, or fields of a part; lists in them become tuples, because options of laws must be hashable."""

    def fixed(v: Any) -> Any:
        return tuple(fixed(x) for x in v) if isinstance(v, list) else v

    if not isinstance(value, dict):
        raise SceneError([f"{shown(value)} stands where values by their names are expected, such as {{'radius': 0.1}}: "
                          f"correct the stored scene"])
    return {key: fixed(_decode(v, scene, known)) for key, v in value.items()}


def _object(value: Any, scene: Any, known: Known) -> Any:
    cls = known.find(value["object"], Part, Section, JointModel, Stop, Shape, ReducedBody)
    given = _options(value["fields"], scene, known)
    if not issubclass(cls, Part):
        return _made(cls, given)
    for key, stored in given.items():
        if key in cls.params and not _is_number(stored):
            raise SceneError([f"{cls.__name__}: the stored {key} = {shown(stored)} is no number: correct the stored scene"])
    return _rebuilt(cls, Part, given, lambda part: {key: v for key, v in part.values().items() if v is not None} == given)


def _law(value: Any, scene: Any, known: Known) -> Law:
    cls = known.find(value["law"], Joint, Force)
    sides = {key: _decode(value.get(key), scene, known) for key in PLACES[2:]}
    sides = {key: np.asarray(one, dtype=float) if isinstance(one, list) else one for key, one in sides.items() if one is not None}
    places = {key: _decode(value[key], scene, known) for key in ("k", "l", "at", "axis")}
    for key, one in {"name": value["name"], **places}.items():
        if not (isinstance(one, KINDS[key]) if key in KINDS else _is_number(one)):
            raise SceneError([f"{key} = {shown(one)}, where {_expected(key)} is expected: correct the stored scene"])
    given = _options(value["values"], scene, known)
    stated = {key: v for key, v in given.items() if key in cls.params or key in cls.options or not _of_part(cls, key)}
    sides |= _decode(value["others"], scene, known) if "others" in value else {}
    law: Law = _rebuilt(cls, TwoBodyLaw, {"name": value["name"], **places, **sides, **stated},
                        lambda law: all(getattr(law, key, None) == v for key, v in stated.items()))
    return law


def _coupling(value: Any, scene: Any, known: Known) -> Coupling:
    cls, of = known.find(value["coupling"], Coupling), value["of"]
    if not (isinstance(of, dict) and all(isinstance(at, str) for at in of.values()) and isinstance(value["name"], str)):
        raise SceneError([f"of = {shown(of)}, where names of joints' coordinates are expected, such as "
                          f"{{'driving': 'A.angle', ...}}: correct the stored scene"])
    return _made(cls, {"name": value["name"], "of": of, **_options(value["values"], scene, known)})  # type: ignore[no-any-return]


def _of_part(cls: type[Law], key: str) -> bool:
    """Whether a value is named "<option>_<parameter>": it belongs to a part of the law and is set with that."""
    return any(key.startswith(f"{option}_") for option in cls.options)


def _made(cls: Callable[..., Any], arguments: dict[str, Any]) -> Any:
    """The object a constructor returns; SceneError with the reason where it fails."""
    try:
        return cls(**arguments)
    except MbdaeError:
        raise
    except Exception as error:  # a constructor of a user's own may raise anything
        kind = getattr(cls, "__name__", "the law")
        raise SceneError([f"{kind} refuses its stored values with {shown(error)}: correct them, or let its __init__ take "
                          f"them"]) from error


def _rebuilt(cls: type, base: type, arguments: dict[str, Any], equal: Callable[[Any], bool]) -> Any:
    """A law or part with its values, made by its constructor. Where a user's own constructor takes other arguments, or sets other
    values (equal(object) is false), it is made by the constructor of `base`, which takes parameters and options by name."""
    maker = next(c for c in cls.__mro__ if "__init__" in vars(c))
    if maker.__module__.split(".")[0] == "mbdae":
        return _made(cls, arguments)
    if _takes(cls, arguments):
        found = _made(cls, arguments)
        if equal(found):
            return found
    bare: Any = object.__new__(cls)
    _made(lambda **given: vars(base)["__init__"](bare, **given), arguments)
    return bare


def _takes(cls: type, arguments: dict[str, Any]) -> bool:
    try:
        inspect.signature(cls).bind(**arguments)
    except (TypeError, ValueError):
        return False
    return True


_READERS: dict[frozenset[str], Callable[[Any, Any, Known], Any]] = {
    frozenset({"body"}): lambda value, scene, known: _body(value["body"], scene),
    frozenset({"kept", "plain"}): _as_given, frozenset({"place", "point"}): _place,
    frozenset({"expression"}): _expression, frozenset({"expression", "tables"}): _expression,
    frozenset({"class"}): lambda value, scene, known: known.find(value["class"], Law, Part, FunctionType),
    frozenset({"object", "fields"}): _object,
    frozenset({"coupling", "name", "of", "values"}): _coupling,
    frozenset({"by"}): lambda value, scene, known: {str(k): _decode(v, scene, known) for k, v in value["by"].items()},
    **{frozenset({"law", "name", "k", "l", "at", "axis", "at_l", "values", *more}): _law
       for more in ((), ("axis_x",), ("axis_x", "others"), PLACES[3:], (*PLACES[3:], "others"))},
}


# ---- statements ----------------------------------------------------------------------------------------------------------


def replay(data: Mapping[str, Any], scene_class: Callable[..., Any], known: Known | None = None) -> Any:
    """A scene from its data: {"name", "gravity", "space", "statements"}; SceneError where a statement cannot be made."""
    scene = scene_class(data["name"], gravity=data["gravity"], space=data["space"])
    known = known if known is not None else Known()
    for i, entry in enumerate(data["statements"]):
        check("a scene was made from its statements")
        try:
            repeat(scene, entry, known)
        except SceneError as error:
            raise SceneError([f"statement {i + 1}, {_described(entry)}: {problem}" for problem in error.problems]) from error
        except MbdaeError as mistake:
            raise SceneError([f"statement {i + 1}, {_described(entry)}: {mistake}"]) from mistake
        except Exception as error:  # a stored value that no check foresaw may make a statement raise anything
            raise SceneError([f"statement {i + 1}, {_described(entry)}, cannot be repeated with its stored values, which raise "
                              f"{shown(error)}: correct them"]) from error
    return scene


def repeat(scene: Any, entry: Statement, known: Known, before: Stated = ({}, {})) -> Stated:
    """Make a recorded statement on a scene, and return its arguments as recorded and as read; SceneError where that is not
    possible. before: those of the same statement with other numbers; what is the same object in both is not read again."""
    method, args, kwargs = entry
    if method not in STATEMENTS:
        raise SceneError([f"{shown(method)} is no statement that this version of mbdae knows; it knows {', '.join(STATEMENTS)}"])
    arguments = arguments_of(method)
    try:
        stated = arguments.by_name(args, kwargs)
    except TypeError as difference:
        raise SceneError([f"{method} takes other arguments than those stored ({difference}): correct the stored scene"]) from None
    taken = {name: before[1][name] for name, value in stated.items() if name in before[1] and name not in _OF_ITEMS
             and (value is before[0][name] or (type(value) is tuple and [*map(id, value)] == [*map(id, before[0][name])]))}
    fresh = {name: value for name, value in stated.items() if name not in taken}
    further = {name: _decode(value, scene, known) for name, value in fresh.pop("further", {}).items()}
    given = {name: _decode([*value] if type(value) is tuple else value, scene, known) for name, value in fresh.items()}
    options = {name for law in given.values() if isinstance(law, type) for name in getattr(law, "options", ())}
    for name, value in {**given, **further}.items():
        if value is None or (name in arguments.names and arguments.signature.parameters[name].default is value):
            continue
        word = name in options and isinstance(value, str | bool)
        if not (isinstance(value, KINDS[name]) if name in KINDS else word or _is_number(value)):
            raise SceneError([f"{name} = {shown(value)} cannot be stored or repeated, {_expected(name)} is expected: "
                              f"change it in the statement or in the stored scene"])
    args, kwargs = arguments.as_call({**taken, **given, **further})
    vars(scene)["_taken"] = taken
    getattr(type(scene), method)(scene, *args, **kwargs)
    return stated, taken


def _is_number(value: Any) -> bool:
    """Whether a stored value is a number, an expression of time, a place, or a list of these."""
    if isinstance(value, list | tuple):
        return all(_is_number(v) for v in value)
    if isinstance(value, dict):
        return all(_is_number(v) for v in value.values())
    if isinstance(value, bool):
        return False
    return value is None or isinstance(value, int | float | Place) or hasattr(value, "free_symbols")


def _described(entry: Any) -> str:
    """A statement in a message: its method and the name of its item."""
    return f"{shown(entry[0])} of {shown(item_name(entry))}"
