"""Checks of the arguments of statements: each becomes a plain value, each mistake a problem of the scene.

`@reads(...)` names a reader for every argument of a statement. A reader returns the plain value (float, text, array of its own,
expression of time); where it cannot, it adds a problem to the scene and returns a harmless value, so that the checks go on.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any, TypeVar

import numpy as np

from mbdae.inputs import timed
from mbdae.inputs.sensed import numbers_in, symbol, with_values
from mbdae.notation import Arguments
from mbdae.scene.components import Body, Place
from mbdae.symbolic.joint import Joint
from mbdae.values import Array, BadValueError, array, entries, flag, number, shown, text, whole, word

F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")
NAMELESS = "without a name"  #: name given to an item whose own is no text, so that reading goes on; also used in messages
ORTHOGONAL = 1e-9  #: a matrix R is refused as a rotation where the magnitude of an entry of R R^T - 1 is as large
MOST_ELEMENTS = 100_000
FEEDS = "it would feed energy"  #: effect of negative damping, for messages


@dataclass(frozen=True)
class Argument:
    """One argument of a statement: its scene, item and name, by which a mistake in it is reported."""

    scene: Any
    item: str  #: such as "revolute 'R'"
    option: str

    def wrong(self, refused: Any, remedy: str) -> None:
        """Add a problem: what is wrong (it begins with the value), and what to give."""
        self.scene.problems.append(f"{self.item}: {self.option} = {refused}; {remedy}")

    def part(self, option: str) -> Argument:
        """A component of the argument, such as one of several points."""
        return Argument(self.scene, self.item, option)


Reader = Callable[[Argument, Any], Any]


def reads(**readers: Reader) -> Callable[[F], F]:
    """Decorator: a statement gets plain values only. readers: of all arguments by name; None stays where it is the default."""

    def decorate(method: F) -> F:
        signature = inspect.signature(method)
        parameters = list(signature.parameters.values())[1:]
        assert {p.name for p in parameters} == set(readers), f"{method.__name__}: arguments and readers differ"
        kind, arguments = method.__name__.replace("_", " "), Arguments(signature)

        @wraps(method)
        def read(self: Any, *args: Any, **given: Any) -> Any:
            found, taken = arguments.by_name(args, given), vars(self).pop("_taken", {})  # taken: those read before, see `repeat`
            item = f"{kind} {_named(found.get('name', getattr(found.get('law'), 'name', None)))}"
            for p in parameters:
                if p.name not in found or p.name in taken:
                    continue
                if _read(Argument(self, item, p.name), found[p.name], lambda v: numbers_in(v, self.numbers),
                                             "give every value a name of its own", dict[str, float]()):
                    self._as_named |= found[p.name] if p.kind is p.VAR_KEYWORD else {p.name: found[p.name]}
                    found[p.name] = with_values(found[p.name])
                if not (found[p.name] is None and p.default is None):
                    found[p.name] = _plain(Argument(self, item, p.name), readers[p.name], p, found[p.name])
            taken.update(found)
            placed, named = arguments.as_call(found)
            return method(self, *placed, **named)

        return read  # type: ignore[return-value]

    return decorate


def _plain(arg: Argument, reader: Reader, parameter: inspect.Parameter, value: Any) -> Any:
    """The plain value of an argument; of `*points` each point by its number."""
    if parameter.kind is not inspect.Parameter.VAR_POSITIONAL:
        return reader(arg, value)  # arguments in **further pass unchanged (as_given); they are read when the joint is known
    return tuple(reader(arg.part(f"{arg.option[:-1]} {i + 1}"), v) for i, v in enumerate(value))


def _named(stated: Any) -> str:
    return f"'{stated}'" if isinstance(stated, str) and stated.strip() else NAMELESS


# ---- readers ----------------------------------------------------------------------------------------------------------------


def _read(arg: Argument, value: Any, read: Callable[[Any], T], remedy: str, instead: T) -> T:
    """`read(value)`; where that raises BadValueError, a problem of the scene and the value `instead`."""
    try:
        return read(value)
    except BadValueError as value_and_reason:
        arg.wrong(value_and_reason, remedy)
        return instead


def name(arg: Argument, value: Any) -> str:
    """Reader of the name of an item."""
    return _read(arg, value, text, "give every item a name of its own, text such as 'rod'", NAMELESS)


def quantity(unit: str, bound: str = "", why: str = "") -> Reader:
    """Reader of a number in a unit; bound: "" for any, "not negative" or "positive"; why: consequence of a negative one."""
    kind = {"": "a number", "not negative": "a number from 0", "positive": "a positive number"}[bound]
    number_in_unit = kind + (f" in {unit}" if unit not in ("", "1") else "")

    def read(arg: Argument, value: Any) -> float:
        try:
            found = number(value)
        except BadValueError as value_and_reason:
            arg.wrong(value_and_reason, f"give {number_in_unit}")
            return 1.0 if bound == "positive" else 0.0
        if (bound and found < 0) or (bound == "positive" and found == 0):
            arg.wrong(f"{_with_unit(found, unit)} is {'negative' if found < 0 else 'not positive'}{why and f': {why}'}",
                       f"give {number_in_unit}")
            return 1.0 if bound == "positive" else 0.0
        return found

    return read


def _with_unit(value: float, unit: str) -> str:
    return f"{value:g} {unit}" if unit not in ("", "1") else f"{value:g}"


def _misshapen(value: Any, found: Any) -> str:
    """Part of a message: the value, and the wrong shape that it has as the array `found`."""
    return f"{shown(value)} has shape {found.shape}" if found.ndim else f"{shown(value)} is no list"


def vector(unit: str) -> Reader:
    """Reader of a vector (3,) from two or three numbers in a unit; two mean z = 0."""

    def read(value: Any) -> Array:
        found = array(value)
        if found.shape not in ((2,), (3,)):
            raise BadValueError(_misshapen(value, found))
        return np.append(found, np.zeros(3 - len(found)))

    remedy = f"give 2 or 3 numbers{f', {unit}' if unit else ''} (2 mean z = 0)"
    return lambda arg, value: _read(arg, value, read, remedy, np.zeros(3))


def point(arg: Argument, value: Any) -> Array:
    """Reader of a point (3,), m: coordinates, or a place of a body."""
    return np.array(value.point, dtype=float) if isinstance(value, Place) else np.asarray(vector("m")(arg, value))


def direction(arg: Argument, value: Any) -> Array:
    """Reader of a vector (3,) that is not zero, of any length."""
    before = len(arg.scene.problems)
    found = np.asarray(vector("")(arg, value))
    if np.any(found):
        return found
    if len(arg.scene.problems) == before:
        arg.wrong(f"{found.tolist()} has length zero", "give a direction")
    return np.array([0.0, 0.0, 1.0])


def unit(direction: Any) -> Array:
    """The vector (3,) of length 1 in a direction."""
    found = np.array(direction, dtype=float)
    return np.asarray(found / np.linalg.norm(found))


def rotation(arg: Argument, value: Any) -> Array:
    """Reader of a rotation matrix (3, 3)."""
    remedy = "give three columns of unit length, each normal to the others, right-handed (body to inertial)"
    return _read(arg, value, _orthogonal, remedy, np.eye(3))


def _orthogonal(value: Any) -> Array:
    R = array(value, (3, 3))
    off = float(np.max(np.abs(R @ R.T - np.eye(3))))
    if not off < ORTHOGONAL or np.linalg.det(R) < 0:
        raise BadValueError(f"{shown(value)} is not a rotation matrix (R R^T differs from 1 by {off:.2g}, det "
                            f"{np.linalg.det(R):.3g})")
    return R


def inertia(arg: Argument, value: Any) -> Any:
    """Reader of an inertia: one number, 3 values (3,) or a matrix (3, 3), kg m^2."""
    give_inertia = "give one number (about z), 3 principal values or a 3x3 matrix, kg m^2"
    try:
        found = array(value)
        if found.shape in ((), (3,), (3, 3)):
            return found if found.ndim else float(found)
        arg.wrong(_misshapen(value, found), give_inertia)
    except BadValueError as value_and_reason:
        arg.wrong("None: it is missing" if value is None else value_and_reason, give_inertia)
    return np.zeros((3, 3))


def driven(unit: str, sensors: bool = False, named: bool = False, least: str = "") -> Reader:
    """Reader of a number in a unit or an expression of time. sensors: expressions may contain sensors too; named: a text is taken
    as the path of a sensor; least: consequence of a negative number, where that is refused."""

    remedy = f"its unit is {unit}" if unit != "1" else f"give a number or an expression of mb.t{' and sensors' * sensors}"

    def read(value: Any) -> Any:
        path = named and isinstance(value, str) and value[:1].isalpha()
        found = timed.expression(symbol(value) if path else value, sensors)
        if not found.free_symbols and least and float(found) < 0:
            raise BadValueError(f"{_with_unit(float(found), unit)} is negative: {least}")
        return found if found.free_symbols else float(found)

    return lambda arg, value: _read(arg, value, read, remedy, 0.0)


def _several(arg: Argument, value: Any, remedy: str, *counts: int) -> Any:
    """The entries of a list with one of these lengths; three zeros where the value is no such list."""

    def read(given: Any) -> Any:
        found = entries(given)
        if found.shape not in [(n,) for n in counts]:
            raise BadValueError(_misshapen(given, found))
        return found

    return _read(arg, value, read, remedy, np.zeros(3))


def components(unit: str, sensors: bool = False) -> Reader:
    """Reader of three numbers or expressions of time (sensors: of sensors too); two mean that the third is 0."""

    def read(arg: Argument, value: Any) -> list[Any]:
        found = _several(arg, value, f"give 2 or 3 components, numbers or expressions of mb.t, {unit}", 2, 3)
        read_one = driven(unit, sensors)
        return [read_one(arg.part(f"{arg.option}[{i}]"), v) for i, v in enumerate(found)] + [0.0] * (3 - len(found))

    return read


def along_axes(unit: str, about: str, least: str = "") -> Reader:
    """Reader of 3 values in a unit along axes, or 6 with those about them: numbers or expressions of time and sensors. least: as
    in `driven`."""

    def read(arg: Argument, value: Any) -> list[Any]:
        found = _several(arg, value, f"give 3 values (along the axes of k, {unit}), or 6 (then about them, {about})", 3, 6)
        return [driven(one, True, least=least)(arg.part(f"{arg.option}[{i}]"), v)
                for i, (one, v) in enumerate(zip((unit,) * 3 + (about,) * 3, found, strict=False))]

    return read


def one_of(*words: str) -> Reader:
    """Reader of one of some words; the first of them where the value is none of them."""

    def read(arg: Argument, value: Any) -> str:
        try:
            return word(value, words)
        except BadValueError:
            arg.wrong(f"{shown(value)} is unknown", f"use {' or '.join(repr(w) for w in words)}")
            return words[0]

    return read


def switch(arg: Argument, value: Any) -> bool:
    """Reader of True or False; False where the value is neither."""
    return _read(arg, value, flag, "give True or False", False)


def counts(arg: Argument, value: Any) -> Any:
    """Reader of a whole number, or a tuple of them, each at least 1; None where the value is neither."""
    try:
        found = entries(value)
        if found.ndim > 1 or not found.size:
            raise BadValueError(_misshapen(value, found))
        many = tuple(whole(n, least=1, most=MOST_ELEMENTS) for n in found.flat)
        return many if found.ndim else many[0]
    except BadValueError as reason:
        names_value = str(reason).startswith(shown(value))
        arg.wrong(reason if names_value else f"{shown(value)}: {reason}",
                   f"give a whole number from 1 to {MOST_ELEMENTS}, or one for every segment")
        return None


def integer(least: int, most: int) -> Reader:
    """Reader of a whole number from `least` to `most`."""
    remedy = f"give a whole number from {least} to {most}"
    return lambda arg, value: _read(arg, value, lambda v: whole(v, least=least, most=most), remedy, least)


def instance(what: type, wanted: str, remedy: str, instead: Any = None) -> Reader:
    """Reader of an object of the class `what`; `instead` where the value is none. wanted, remedy: words of the message."""

    def read(arg: Argument, value: Any) -> Any:
        if isinstance(value, what):
            return value
        arg.wrong(f"{shown(value)} is no {wanted}", remedy)
        return instead

    return read


def as_given(arg: Argument, value: Any) -> Any:
    """Reader that returns the value as it is; the statement checks it itself."""
    return value


def joint_class(arg: Argument, value: Any) -> Any:
    """Reader of a class derived from mb.Joint."""
    if isinstance(value, type) and issubclass(value, Joint) and value is not Joint:
        return value
    arg.wrong(f"{shown(value)} is no class of a joint", "give a class derived from mb.Joint, such as mb.Revolute")
    return Nothing


class Nothing(Joint):
    """A joint used where no class of one is given, after the mistake has been reported."""

    def constraints(self, k: Any, l: Any) -> dict[str, Any]:
        return {}


def nobody(scene: Any) -> Body:
    """A body used where none of the scene is given, after the mistake has been reported; it is in no list of the scene."""
    zero, eye = np.zeros(3), np.eye(3)
    return Body("?", 0.0, eye, zero, eye, zero, zero, scene=scene)


def body(arg: Argument, value: Any) -> Any:
    """Reader of a body of the scene, given by itself, its name or a place on it."""
    if isinstance(value, Place):
        return Place(body(arg, value.body), np.array(value.point, dtype=float))
    scene = arg.scene
    if isinstance(value, Body) and (value.scene is scene or scene._by_name.get(value.name) is value):
        return value
    named = [b for b in [scene.ground, *scene.bodies] if isinstance(value, str) and b.name == value]
    if named:
        return named[0]
    known = ", ".join(repr(b.name) for b in [scene.ground, *scene.bodies][:12])
    if isinstance(value, Body) and value.scene is not None:
        other_scene = f"{'another ' if value.scene.name == scene.name else ''}scene '{value.scene.name}'"
        if value.is_ground:
            arg.wrong(f"the ground of {other_scene}, not of this scene", "use s.ground")
        else:
            arg.wrong(f"body '{value.name}' of {other_scene}, not of this scene", f"this one has {known}")
    else:
        arg.wrong(f"{shown(value)} is no body of this scene, which has {known}", "name one of these")
    return nobody(scene)
