"""The motion that a joint allows, as elementary motions one after the other: along an axis, about an axis.

A joint states it by a chain that begins at the axes of k and ends at those of l, as in

    def motion(self, from_k):
        return from_k.along("z", self.displacement).about("z", self.angle)

Every axis is fixed in the axes reached so far; an amount may be any function of the joint's coordinates and parameters. The pose
of l relative to k, its velocity, the forces on the coordinates and the inverse motion follow from the chain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from math import nan
from typing import Any

import symengine as se

from mbdae.errors import LawError
from mbdae.notation import counted
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.rebuild import is_condition, nodes, unusable
from mbdae.symbolic.vectors import UNIT, ZERO, Expr, Vec, rotation_columns
from mbdae.values import BadValueError, array, shown

_TIME = se.Symbol("t")
AXES = dict(zip("xyz", UNIT, strict=True))
Triad = tuple[Vec, Vec, Vec]  #: three axes, inertial components


@dataclass(frozen=True)
class Rotation:
    """A free rotation. P: its quaternion; columns: the axes it leads to, in components along the axes before it; spin: its
    angular velocity, in components along the axes it leads to; inverse: whether it is taken backwards."""

    P: tuple[Expr, ...]
    columns: Triad
    spin: Vec
    inverse: bool = False

    @classmethod
    def of(cls, P: Sequence[Expr], spin: Vec) -> Rotation:
        """A free rotation by its quaternion and angular velocity."""
        return cls(tuple(P), rotation_columns(P), spin)

    @property
    def quaternion(self) -> list[Expr]:
        """Quaternion of the rotation, or of its inverse."""
        return [self.P[0], *(-p if self.inverse else p for p in self.P[1:])]

    @property
    def matrix_columns(self) -> Triad:
        """Columns of its matrix, or of the inverse one."""
        rows = tuple(Vec(*(c[i] for c in self.columns)) for i in range(3))
        return rows if self.inverse else self.columns  # type: ignore[return-value]


@dataclass(frozen=True)
class Step:
    """An elementary motion: by `amount` (m or rad) along an axis or, where it `turns`, about it, or a free `rotation`. axis: unit
    vector in components along the axes reached so far."""

    turns: bool
    axis: Vec
    amount: Expr
    rotation: Rotation | None = None

    def direction(self, axes: Triad) -> Vec:
        """The axis in inertial components."""
        x, y, z = self.axis
        found: Vec = axes[0] * x + axes[1] * y + axes[2] * z
        return found


class Motion:
    """A chain of elementary motions."""

    def __init__(self, steps: Sequence[Step] = ()) -> None:
        self.steps = tuple(steps)

    def along(self, axis: Any, amount: Expr) -> Motion:
        """This motion followed by a displacement along an axis ("x", "y", "z", or three numbers) by an amount, m."""
        return Motion((*self.steps, Step(False, _axis(axis), _amount(amount))))

    def about(self, axis: Any, amount: Expr) -> Motion:
        """This motion followed by a rotation about an axis ("x", "y", "z", or three numbers) by an angle, rad."""
        return Motion((*self.steps, Step(True, _axis(axis), _amount(amount))))

    def turned(self, rotation: Rotation) -> Motion:
        """This motion followed by a free rotation: a coordinate whose unit is "rotation"."""
        if not isinstance(rotation, Rotation):
            raise LawError(f"motion: {shown(rotation)} is no rotation: give a coordinate whose unit is 'rotation'")
        return Motion((*self.steps, Step(True, ZERO, se.Integer(0), rotation)))

    def inverse(self) -> Motion:
        """The motion that takes l back to k."""
        return Motion([Step(s.turns, s.axis, -s.amount, s.rotation and replace(s.rotation, inverse=not s.rotation.inverse))
                       for s in reversed(self.steps)])

    def substituted(self, table: Any) -> Motion:
        """The motion with symbols in its amounts replaced."""
        return Motion([replace(s, amount=s.amount.subs(table)) for s in self.steps])

    @property
    def slides(self) -> bool:
        """Whether it contains a displacement."""
        return any(not step.turns for step in self.steps)

    def pose(self, axes: Triad) -> tuple[Vec, Triad]:
        """Displacement and axes at the end of the motion, for given axes at its start; inertial components."""
        moved = ZERO
        for step in self.steps:
            if step.turns:
                axes = turned(axes, step)
            else:
                moved = moved + step.direction(axes) * step.amount
        return moved, axes


def turned(axes: Triad, step: Step) -> Triad:
    """Axes turned about an axis fixed in them (Rodrigues' formula), or by a free rotation."""
    if step.rotation is not None:
        x, y, z = (axes[0] * c[0] + axes[1] * c[1] + axes[2] * c[2] for c in step.rotation.matrix_columns)
        return x, y, z
    cos, sin, n = se.cos(step.amount), se.sin(step.amount), step.axis
    found = []
    for e in UNIT:
        image = e * cos + n.cross(e) * sin + n * ((n @ e) * (1 - cos))
        found.append(axes[0] * image[0] + axes[1] * image[1] + axes[2] * image[2])
    return found[0], found[1], found[2]


def half_turn(step: Step) -> list[Expr]:
    """Quaternion of an elementary rotation."""
    if step.rotation is not None:
        return step.rotation.quaternion
    return [se.cos(step.amount / 2), *(step.axis * se.sin(step.amount / 2))]


def _axis(axis: Any) -> Vec:
    if isinstance(axis, str) and axis in AXES:
        return AXES[axis]
    try:
        given = array(axis, (3,))
    except BadValueError:
        given = None
    if given is None or not (given @ given) > 0:
        raise LawError(f"motion: axis = {shown(axis)}: give 'x', 'y', 'z' or three numbers of a direction in the joint's axes")
    unit = given / (given @ given) ** 0.5
    return Vec(*(int(c) if c in (0.0, 1.0, -1.0) else float(c) for c in unit))


def _amount(amount: Any) -> Expr:
    try:
        found = se.sympify(amount)
        if found.args and (why := unusable(found, None)):
            raise LawError(f"motion: amount = {shown(amount)} contains {why}")
        return found
    except LawError:
        raise
    except Exception as error:
        raise LawError(f"motion: amount = {shown(amount)} is no expression of coordinates and parameters, such as "
                       f"self.angle") from error


def motion_of(law: Any, values: Mapping[str, Any]) -> Motion | None:
    """The motion of a joint at values of its coordinates; None where it states none."""
    if not law.states_motion():
        return None
    at = copy(law)
    vars(at).update(values)
    found: Motion = at.motion(Motion())
    return found


def symbolic_motion(law: Any) -> Motion | None:
    """The motion of a joint with a symbol of its name for every coordinate."""
    symbols = {c: se.Symbol(c) for c in law.scalars()}
    return motion_of(law, symbols | {c: no_rotation() for c in law.coordinates.keys() - symbols.keys()})


def symbolic_steps(law: Any) -> tuple[Step, ...] | None:
    """The elementary motions of a joint with symbols for its coordinates, those of free rotations included; None where the law
    states no motion."""
    if not hasattr(law, "states_motion"):
        return None
    turns = {c: Rotation.of(se.symbols(f"{c}_P1:5"), Vec(*se.symbols(f"{c}_W1:4"))) for c in law.coordinates}
    motion = motion_of(law, turns | {c: se.Symbol(c) for c in law.scalars()})
    return None if motion is None else motion.steps


def refuse_amounts(law: Any) -> None:
    """Raise LawError where the motion of a law with symbols for its parameters contains the time or undeclared symbols, or a
    function whose derivatives are not known."""
    motion = symbolic_motion(law)
    where = f"{type(law).__name__}.motion"
    declared = {se.Symbol(name) for name in (*law.scalars(), *law.params)}
    for step in motion.steps if motion is not None else ():
        for symbol in sorted(step.amount.free_symbols - declared, key=str):
            if symbol == _TIME:
                raise LawError(f"{where} contains mb.t: state a parameter (params = mb.params(...)) and give that an expression "
                               f"of mb.t")
            raise LawError(f"{where} contains the symbol {symbol}, which the class does not declare; write "
                           f"params = mb.params({symbol}=('unit', 'meaning')) and self.{symbol}")
        unknown = _without_derivatives(step.amount)
        if unknown is not None:
            raise LawError(f"{where} contains {unknown}, whose derivatives are not known: state it by other functions, one with "
                           f"cases by se.Piecewise((a, x > 0), (b, True)) whose cases meet without a kink")


def _without_derivatives(amount: Expr) -> Expr | None:
    """A part of an expression whose first two derivatives symengine cannot form or evaluate; None where there is none."""
    at = {s: se.RealDouble(0.31 + 0.17 * i) for i, s in enumerate(sorted(amount.free_symbols, key=str))}
    for part in nodes(amount):
        for symbol in part.free_symbols if not is_condition(part) else ():
            first = se.diff(part, symbol)
            if not all(_is_known(e, at) for e in (part, first, se.diff(first, symbol))):
                return part
    return None


def _is_known(e: Expr, at: dict[Expr, Expr]) -> bool:
    """Whether symengine formed all derivatives in an expression and can evaluate it at given values of its symbols."""
    if any(type(node).__name__ in ("Derivative", "Subs") for node in nodes(e)):
        return False
    return value_of(e.subs(at)) is not None


def value_of(e: Expr) -> complex | None:
    """The value of an expression without symbols, complex or infinite where it is so; None where symengine cannot evaluate it."""
    if e.args and any(type(node).__name__ == "PyFunction" for node in nodes(e)):
        return None  # to evaluate a function of SymPy that has no value ends the process
    for read in (complex, float):  # each of these fails for some functions of symengine
        try:
            return complex(read(e))
        except (RuntimeError, TypeError):
            continue
    return None


def real_value(e: Expr) -> float:
    """The value of an expression without symbols where it is real; NaN elsewhere."""
    found = value_of(e)
    return found.real if found is not None and found.imag == 0 else nan


def no_rotation() -> Rotation:
    """The identity, as a free rotation."""
    return Rotation.of([se.Integer(i == 0) for i in range(4)], ZERO)


# ---- axes along and about which a joint lets l move: its reactions do no work along and about them ---------------------------


def free_axes(law: Any, k: Frame, l: Frame, coordinate: str) -> list[Vec]:
    """Unit vectors, inertial, along which reactions do not press the rubbing surfaces together: the axis of the coordinate with
    friction, and the directions in which any coordinate slides l, each once. An axis of rotation is left out where all of them
    together would span space."""
    motion = symbolic_motion(law)
    assert motion is not None
    own = [i for i, step in enumerate(motion.steps) if se.Symbol(coordinate) in step.amount.free_symbols]
    if len(own) != 1:
        raise LawError(f"friction on '{coordinate}' of a {type(law).__name__}: {counted(len(own), 'step')} of its motion "
                       f"{'contains' if len(own) == 1 else 'contain'} this coordinate, where one is needed to tell which part of "
                       f"the joint's force presses the surfaces together: state `pressing(self, k, l, force)` in its class, or "
                       f"give normal_force=... (N)")
    slides = [i for i, step in enumerate(motion.steps) if not step.turns and step.amount.free_symbols & _names(law)]
    found: list[Vec] = []
    for i in (own[0], *slides):
        axis = _axis_of(law, k, l, motion.steps, i)
        if not any(all(a == b for a, b in zip(axis, other, strict=True)) for other in found):
            found.append(axis)
    # a planar joint is pressed by the reaction along its axis of rotation
    return found[1:] if len(found) > 2 and motion.steps[own[0]].turns else found


def _names(law: Any) -> set[Any]:
    return {se.Symbol(c) for c in law.scalars()}


def _axis_of(law: Any, k: Frame, l: Frame, steps: Sequence[Step], i: int) -> Vec:
    """Axis of elementary motion i, inertial: from the axes of k where no motion before it turns, from those of l where no motion
    after it turns, else from the joint's coordinates, which must then be unknowns."""

    def turn(some: Sequence[Step]) -> bool:
        return any(s.rotation is not None or (s.turns and s.amount.free_symbols & _names(law)) for s in some)

    if not turn(steps[:i]):
        return steps[i].direction(_axes_after(steps[:i], k))
    if not turn(steps[i + 1 :]):
        return steps[i].direction(_axes_after(Motion(steps[i + 1 :]).inverse().steps, l))
    if not law.kept:
        raise LawError(f"{type(law).__name__}: friction needs the force that presses the joint together, across each of its "
                       f"axes of motion; one of them lies between two rotations whose angles are no unknowns of this joint "
                       f"model: use model=mb.Classical(), or give normal_force=... (N)")
    own: tuple[Step, ...] = law.motion(Motion()).steps
    return own[i].direction(_axes_after(own[:i], k))


def _axes_after(steps: Sequence[Step], f: Frame) -> Triad:
    """The axes of a frame after some elementary motions."""
    axes: Triad = Motion(steps).pose((f.x, f.y, f.z))[1]
    return axes


def across(force: Vec, axes: Sequence[Vec]) -> Vec:
    """The part of a vector that is normal to one or two axes; for three axes 0."""
    if len(axes) == 1:
        along: Vec = axes[0] * (axes[0] @ force)
        return force - along
    if len(axes) > 2:
        return ZERO
    normal: Vec = axes[0].cross(axes[1])
    part: Vec = normal * ((normal @ force) / (normal @ normal))
    return part
