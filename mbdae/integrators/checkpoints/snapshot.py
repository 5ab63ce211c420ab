"""The state of a method between two steps, collected from its objects, so that a new object continues with equal results.

State are the numbers, texts, arrays, lists, tuples and further objects that an object of `integrators` holds. Of an object of
`native` only its arrays and the numbers of its table are state; its other numbers are addresses. Constants (frozen data, systems,
equations, functions) are taken from the new object. Objects with other state have methods `snapshot` and `go_back`.
"""

from __future__ import annotations

import ctypes
from dataclasses import is_dataclass
from inspect import isroutine
from typing import Any

import numpy as np

from mbdae.integrators.checkpoints.trees import NotPlainError, Tree, packed
from mbdae.integrators.solution import Stats
from mbdae.native.contacts import Contacts
from mbdae.native.elimination import Entries, Order
from mbdae.native.equations import Equations, Number, Whole
from mbdae.system.base import System

#: classes whose objects are not part of the state; `Contacts` are made again from `ContactSteps`
CONSTANT = (System, Equations, Stats, Contacts, Entries, Order)
OWN = ("mbdae.integrators.", "mbdae.native.")
OBJECT = "object"


def snapshot(method: Any) -> Tree:
    """The state of a method (an object that makes steps) as plain values and arrays in nested dictionaries and lists."""
    return _of_object(method, set())


def _of_object(thing: Any, seen: set[int]) -> Tree:
    seen.add(id(thing))
    if hasattr(thing, "snapshot"):
        return {OBJECT: thing.snapshot()}
    found = {name: _of_value(value, seen, _native(thing)) for name, value in vars(thing).items()}
    return {OBJECT: {name: kept for name, kept in found.items() if kept is not Ellipsis}}


def _of_value(value: Any, seen: set[int], native: bool) -> Tree:
    """A value as part of the tree; Ellipsis where it is not part of the state. seen: ids of objects that are in the tree already;
    native: whether the value belongs to an object of `native`."""
    if id(value) in seen:
        return ...
    if isinstance(value, ctypes.Structure):
        seen.add(id(value))
        return {OBJECT: {name: getattr(value, name) for name in _numbers(value)}}
    if isinstance(value, list) and value and all(_is_object(part) for part in value):
        return [_of_object(part, seen) for part in value]
    if _is_object(value):
        return _of_object(value, seen)
    if native and not isinstance(value, np.ndarray):
        return ...
    try:
        packed(value, {})
    except NotPlainError:
        return ...
    return value


def go_back(method: Any, state: Tree) -> None:
    """Set the state of a new method to a stored one, so that it makes the same steps as the method that was stored."""
    kept = state[OBJECT]
    if hasattr(method, "snapshot"):
        method.go_back(kept)
        return
    plain = {name: value for name, value in kept.items() if not _holds_object(value)}
    for name, value in plain.items():
        _put(method, name, value)
    if hasattr(method, "revive"):
        method.revive(kept)
    for name in kept.keys() - plain.keys():
        _go_back_inside(getattr(method, name), kept[name])


def _go_back_inside(there: Any, kept: Tree) -> None:
    if isinstance(kept, list):
        for one, state in zip(there, kept, strict=True):
            go_back(one, state)
    elif isinstance(there, ctypes.Structure):
        for name, value in kept[OBJECT].items():
            setattr(there, name, value)
    else:
        go_back(there, kept)


def _put(thing: Any, name: str, value: Tree) -> None:
    """Set an attribute of `thing`; arrays are filled in place, because C code and other objects have their address."""
    there = getattr(thing, name, None)
    if isinstance(there, np.ndarray) and isinstance(value, np.ndarray) and there.shape == value.shape and there.flags.writeable:
        there[...] = value
        return
    if isinstance(there, np.ndarray) and isinstance(value, np.ndarray):
        value.setflags(write=there.flags.writeable)
    setattr(thing, name, _like(value, there))


def _like(value: Tree, there: Any) -> Any:
    """A stored value in the types of `there`, the value of a new object: lists become named tuples where `there` has them."""
    if isinstance(value, list) and isinstance(there, list) and there:
        return [_like(part, there[0]) for part in value]
    if isinstance(value, tuple) and hasattr(there, "_fields"):
        return type(there)(*value)
    return value


def _is_object(value: Any) -> bool:
    kind = type(value)
    constant = isinstance(value, CONSTANT) or (is_dataclass(value) and kind.__dataclass_params__.frozen)
    named = isinstance(value, tuple | type) or isroutine(value)
    return kind.__module__.startswith(OWN) and not constant and not named and not _is_loop(value)


def _is_loop(value: Any) -> bool:
    return hasattr(value, "run_end")  # a StepLoop is no part of the state of a method, since `Record` stores its steps


def _holds_object(value: Tree) -> bool:
    if isinstance(value, list):
        return bool(value) and _holds_object(value[0])
    return isinstance(value, dict) and OBJECT in value


def _native(thing: Any) -> bool:
    return any(kind.__module__.startswith(OWN[1]) for kind in type(thing).__mro__)


def _numbers(table: ctypes.Structure) -> list[str]:
    return [field[0] for field in table._fields_ if field[1] in (Number, Whole)]
