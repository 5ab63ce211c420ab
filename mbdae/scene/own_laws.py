"""Laws that a user adds as objects: the scene keeps a copy with plain values."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from mbdae.scene import reading
from mbdae.scene.reading import Argument
from mbdae.symbolic.coupling import Coupling
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Force
from mbdae.values import shown

NEEDED = ("name", "k", "l", "at", "axis", "at_l", "axis_x")


def own_copy(arg: Argument, law: Any) -> Joint | Force | Coupling:
    """A copy of a law with checked bodies, places and parameters; a force law without effect where `law` is no law."""
    if not isinstance(law, Joint | Force | Coupling):
        arg.wrong(f"{shown(law)} is no joint, force or coupling", "give an object of a class derived from mb.Joint, mb.Force or "
                   "mb.Coupling, with its name, bodies and parameters")  # fmt: skip
        return _nothing(arg)
    kind = type(law).__name__
    needed = ("name", "of") if isinstance(law, Coupling) else NEEDED
    missing = [key for key in (*needed, *law.params, *law.options) if key not in vars(law)]
    if missing:
        arg.wrong(f"a {kind} without {missing[0]}", f"let {kind}.__init__ call super().__init__(name, k, l, at=at, axis=axis, "
                   f"**parameters)")  # fmt: skip
        return _nothing(arg)
    found: Any = copy.copy(law)
    found.name = reading.name(Argument(arg.scene, kind, "name"), law.name)
    head = Argument(arg.scene, f"{kind} '{found.name}'", "")
    if not isinstance(law, Coupling):
        _read_places(head, law, found)
    for key, parameter in law.params.items():
        value = getattr(law, key)
        sensors = isinstance(law, Force)
        read = reading.quantity(parameter.unit) if law.timeless else reading.driven(parameter.unit, sensors)
        setattr(found, key, None if value is None else read(head.part(key), value))
    for key in law.options:
        _refuse_unhashable(head.part(key), getattr(law, key))
    return found  # type: ignore[no-any-return]


def _read_places(head: Argument, law: Joint | Force, found: Any) -> None:
    """Bodies, points and directions of a law into its copy."""
    found.k, found.l = (reading.body(head.part(side), getattr(law, side)) for side in "kl")
    found.at = None if law.at is None else reading.point(head.part("at"), law.at)
    found.axis = reading.direction(head.part("axis"), law.axis)
    if law.axis_x is not None:
        found.axis_x = reading.direction(head.part("axis_x"), law.axis_x)
    for side in law.frames[2:]:
        setattr(found, side, reading.body(head.part(side), getattr(law, side)))
    found.points = {side: reading.point(head.part(f"at_{side}"), point) for side, point in law.points.items()}
    if law.at_l is not None:
        found.at_l = reading.point(head.part("at_l"), law.at_l)


def _refuse_unhashable(arg: Argument, value: Any) -> None:
    """Derived equations are cached by the options of their law, so options must be hashable."""
    try:
        hash(value)
    except Exception:  # a hash of the user's own may raise anything
        arg.wrong(f"{shown(value)} cannot be an option of a law", "give a number, text, a tuple of them, a class, or a part, "
                                                                   "such as mb.Coulomb(mu, v_c)")  # fmt: skip


def _nothing(arg: Argument) -> Force:
    return Force(reading.NAMELESS, reading.nobody(arg.scene), reading.nobody(arg.scene), at=np.zeros(3))
