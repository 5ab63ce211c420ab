"""Checks of classes of laws and parts: names when the class is defined, results whenever one of its methods is called.

Every method of the contract (see `symbolic/law.py`, friction and normal laws) is wrapped where a class defines it. An exception
in the user's code, or a result of another kind than the contract says, becomes a LawError that names class and method.
"""

from __future__ import annotations

import math
import re
import traceback
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np
import symengine as se

from mbdae.errors import LawError, MbdaeError
from mbdae.notation import counted
from mbdae.symbolic.rebuild import is_condition
from mbdae.values import SMALLEST, BadValueError, number, shown

Check = Callable[[Any], Any]
UNDEFINED = ("half turn", "points together", "some places")  #: states in which a law may say that it is not defined
#: arguments of a law between bodies that say where its frames are
PLACES = ("at", "axis", "at_l", "axis_x", "axis_l", "axis_x_l")
OF_STATES = ("rate", "rates", "initial")  #: methods called only where there are states
FRAME = "r (point), v (its velocity), x, y, z (axes) and w (angular velocity)"
DERIVED_NAME = re.compile(r"named\d+|(q|u|up)_c?\d+_\d+|clock_\d+_\d+|[kl]_P0")  #: names of derivations, refused in a class
_COMPLEX: Any = type(2 * se.I)  #: exact complex numbers; those of complex steps are of another type
_NO_EXPRESSIONS = (bool, np.bool_, str, bytes, complex, Mapping, Sequence, set, frozenset, np.ndarray, type)


class _ReturnError(Exception):
    """A result of another kind than the contract says; the text describes it."""


# ---- what a method must return ----------------------------------------------------------------------------------------------


def _expression(e: Any) -> Any:
    if e is None or callable(getattr(e, "cross", None)) or isinstance(e, _NO_EXPRESSIONS):
        raise _ReturnError(f"{shown(e)}, which is no expression or number")
    try:
        if isinstance(e, int | float | np.number) or type(e).__module__.partition(".")[0] == "sympy" or hasattr(e, "_symengine_"):
            e = se.sympify(number(e) if not getattr(e, "free_symbols", None) else e)
    except BadValueError as error:
        raise _ReturnError(f"{shown(e)}, which is no real, finite number of usual magnitude") from error
    except Exception as error:
        raise _ReturnError(f"{shown(e)}, which is no expression that symengine knows") from error
    known = type(e).__module__.partition(".")[0] in ("symengine", "mbdae")
    if isinstance(e, _COMPLEX):
        raise _ReturnError(f"{shown(e)}, which is not real")
    if not known or is_condition(e):
        raise _ReturnError(f"{shown(e)}, which is no expression or number")
    return e


def _vector(v: Any) -> Any:
    if not callable(getattr(v, "cross", None)):
        raise _ReturnError(f"{shown(v)}, which is no vector: combine those of the frames, as in l.r - k.r, or use Vec(x, y, z)")
    return v


def _by_name(entry: Check) -> Check:
    def read(found: Any) -> Any:
        if not isinstance(found, Mapping):
            raise _ReturnError(f"{shown(found)}, which is no dictionary; return {{'name': expression, ...}}")
        for name in found:
            if not isinstance(name, str) or not name:
                raise _ReturnError(f"the name {shown(name)}; names are text")
        return {name: _part(entry, e, f"'{name}'") for name, e in found.items()}

    return read


def _part(entry: Check, e: Any, name: str) -> Any:
    try:
        return entry(e)
    except _ReturnError as value_and_fault:
        raise _ReturnError(f"{name} = {value_and_fault}") from value_and_fault.__cause__


def _several(entry: Check, count: int | None = None) -> Check:
    def read(found: Any) -> Any:
        if isinstance(found, str | bytes | Mapping) or not isinstance(found, Sequence):
            raise _ReturnError(f"{shown(found)}, which is no list")
        if count is not None and len(found) != count:
            raise _ReturnError(f"{counted(len(found), 'part')}, where {count} are needed: {shown(found)}")
        return [_part(entry, e, f"part {i + 1}") for i, e in enumerate(found)]

    return read


def _pair(entry: Check) -> Check:
    several = _several(entry, 2)
    return lambda found: tuple(several(found))


def _or_none(read: Check) -> Check:
    return lambda found: None if found is None else read(found)


def _word(found: Any) -> Any:
    if found not in UNDEFINED:
        raise _ReturnError(f"{shown(found)}, which is none of {', '.join(map(repr, UNDEFINED))}")
    return found


def _coordinates(found: Any) -> Any:
    return _by_name(_expression)(found) if isinstance(found, Mapping) else _or_none(_expression)(found)


def _tie(found: Any) -> Any:
    return tuple(_several(_expression, 2)(found)) if isinstance(found, tuple | list) else _expression(found)


def _motion(found: Any) -> Any:
    if not callable(getattr(found, "along", None)):
        raise _ReturnError(f"{shown(found)}, which is no motion of l relative to k")
    return found


def _size(found: Any) -> Any:
    """A number, or an array of numbers. It may be infinite or below `SMALLEST`, as the penetration of an impact at almost no
    speed is."""
    try:
        if np.ndim(found) == 0:
            small = isinstance(found, float) and abs(found) < SMALLEST
            return found if small or (isinstance(found, float) and math.isinf(found)) else number(found)
    except BadValueError as wrong:
        raise _ReturnError(str(wrong)) from None
    return found


RETURNS: dict[str, tuple[Check, str]] = {
    **dict.fromkeys(("constraints", "velocity_constraints"), (_by_name(_expression), "a dictionary of rows that vanish, "
                                                              "{'name': expression}")),
    "branches": (_by_name(_expression), "a dictionary of expressions by name"),
    "losses": (_by_name(_expression), "a dictionary of powers by cause, {'friction': expression}"),
    "rates": (_by_name(_expression), "a dictionary with the time derivative of every state"),
    "rate": (_by_name(_expression), "a dictionary with the time derivative of every state"),
    "initial": (_by_name(_expression), "a dictionary with the start value of every state"),
    "strains": (_by_name(_expression), "a dictionary of strains by the name of their stress"),
    "observed": (_by_name(_several(_expression)), "a dictionary of lists of expressions"),
    "coordinate": (_coordinates, "an expression (rad or m), a dictionary of them by coordinate, or None"),
    "ties": (_by_name(_tie), "a dictionary by coordinate of rows, or of pairs (row, positive expression)"),
    "motion": (_motion, "a motion, such as from_k.along('z', self.displacement).about('z', self.angle)"),
    "thrust": (_or_none(_pair(_expression)), "(coordinate, force on it), two expressions, or None"),
    "energy": (_expression, "an expression, J"), "dissipation": (_expression, "an expression, W"),
    "kinetic_energy": (_expression, "an expression, J"), "damping_force": (_expression, "an expression, N"),
    "elastic_force": (_expression, "an expression, N"), "coefficient": (_expression, "an expression, a pure number"),
    "stored": (_expression, "an expression, m"),
    "wrench": (_or_none(_pair(_vector)), "(force, torque), two vectors, or None"),
    "resistance": (_or_none(_pair(_vector)), "(force, torque), two vectors, or None"),
    "load": (_vector, "a vector, N/m"),
    "gaps": (_several(_pair(_expression)), "a list of pairs (gap, its rate)"),
    "approach": (_several(_expression), "a list of expressions, m"),
    "undefined_at": (lambda found: tuple(_several(_word)(found)), "a tuple of texts"),
    "penetration": (_size, "a number, m"), "contact_duration": (_size, "a number, s"),
    "impact": (_pair(_size), "(penetration m, duration s)"), "smallest_velocity": (_or_none(_size), "a number, m/s, or None"),
}


# ---- classes ----------------------------------------------------------------------------------------------------------------


def check_class(cls: Any, instance: Sequence[str]) -> None:
    """Check the names a class declares, and wrap the methods it defines. instance: attributes that all its objects have."""
    _check_names(cls, instance)
    for name in RETURNS.keys() & vars(cls).keys():
        method = vars(cls)[name]
        if callable(method):
            setattr(cls, name, _checked(name, method))


def _check_names(cls: Any, instance: Sequence[str]) -> None:
    if not isinstance(cls.options, tuple | list) or not all(isinstance(o, str) for o in cls.options):
        raise LawError(f"{cls.__name__}: options = {shown(cls.options)}: give a tuple of names, such as ('friction',)")
    tables = {"params": cls.params, "states": cls.states, "coordinates": getattr(cls, "coordinates", {})}
    for attribute, table in tables.items():
        if not isinstance(table, Mapping) or not all(hasattr(entry, "unit") for entry in table.values()):
            raise LawError(f"{cls.__name__}: {attribute} = {shown(table)}: write {attribute} = mb.params(name=('unit', "
                           "'meaning'))")
    known = dict.fromkeys(instance, "an attribute that every object of this kind has")
    for base in cls.__mro__[:-1]:
        known |= {name: f"{base.__name__}.{name} of the class" for name in vars(base)
                  if not name.startswith("__") and (cls.states or name not in OF_STATES)}
    for attribute, names in (*tables.items(), ("options", cls.options)):
        for name in names:
            if name in known:
                raise LawError(f"{cls.__name__}: '{name}' in {attribute} is taken by {known[name]}; choose another name")
            if name == "t" and attribute == "coordinates":
                raise LawError(f"{cls.__name__}: 't' in {attribute} is the time; choose another name")
            if DERIVED_NAME.fullmatch(name):
                raise LawError(f"{cls.__name__}: '{name}' in {attribute} is a name that derivations use; choose another one")
            known[name] = f"its {attribute}"


def _checked(name: str, method: Callable[..., Any]) -> Callable[..., Any]:
    read, allowed = RETURNS[name]
    # whether this is a default of a base class: it states nothing and takes k and l only, however many frames the law has
    unstated = method.__module__ in ("mbdae.symbolic.law", "mbdae.symbolic.joint")

    @wraps(method)
    def checked(self: Any, *args: Any, **kwargs: Any) -> Any:
        if unstated and len(self.frames) > 2:
            args = (*args[:2], *args[len(self.frames) :])
        class_and_method = f"{type(self).__name__}.{name}"
        try:
            found = method(self, *args, **kwargs)
        except NotImplementedError:
            raise
        except MbdaeError as error:
            if str(error).startswith(f"{name}: "):  # of a tool that the method uses, as the motion of a joint does
                raise LawError(f"{class_and_method}{str(error).removeprefix(name)}{_line(error)}") from None
            raise
        except Exception as error:
            raise LawError(f"{class_and_method} fails: {type(error).__name__}: {error}{_hint(self, error)}"
                           f"{_line(error)}") from error
        try:
            return read(found)
        except _ReturnError as what_and_fault:
            raise LawError(f"{class_and_method} returns {what_and_fault}; it must return {allowed}") from what_and_fault.__cause__

    return checked


def _line(error: Exception) -> str:
    """Words for the last line of the user's own code that led to an error, as in " (line 3 of swing.py)"."""
    package = str(Path(__file__).parents[1])
    own = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith(package)]
    return f" (line {own[-1].lineno} of {Path(own[-1].filename).name})" if own else ""


def _hint(law: Any, error: Exception) -> str:
    """Words for what to write instead, where the error shows it; else empty."""
    text = str(error)
    if isinstance(error, AttributeError) and "'Frame'" in text:
        return f"; a frame has {FRAME}"
    if isinstance(error, AttributeError) and type(law).__name__ in text:
        by_itself = law.derived() if hasattr(law, "derived") else ()
        names = (*getattr(law, "coordinates", ()), *law.params, *law.options, *law.states)
        known = ", ".join(name for name in names if name not in by_itself) or "none"
        return f"; its coordinates, parameters, options and states: {known}; declare others in params = mb.params(name=" \
               f"('unit', 'meaning'))"
    absent = [key for key in law.params if getattr(law, key, None) is None]
    if "NoneType" in text and absent:
        return f"; {', '.join(absent)} {'is' if len(absent) == 1 else 'are'} left out (None) here: give a value, or say what " \
               f"the law is without it"
    if "ufunc" in text or "loat" in text or "truth value" in text or "oolean" in text or "Cannot convert" in text:
        return "; values are symbols here: use the functions of symengine (import symengine as se; se.sin(x), " \
               "se.Piecewise((a, x > 0), (b, True)))"
    return ""
