"""Joints that carry a body along and about axes: revolute, prismatic, cylindrical, screw, spherical, universal and planar joints,
and the weld. Each class is the whole statement of its joint.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import symengine as se

from mbdae.errors import LawError
from mbdae.laws.joint_rows import (
    ClearanceRevolute,
    Distance,
    FixedOrientation,
    Free,
    KnifeEdge,
    PointOnLine,
    PointOnPlane,
    Rolling,
    RollingBall,
    on_axis,
    same_attitude,
    same_axis,
    same_point,
    tied_angle,
    upright,
)
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import SLIGHT, Joint
from mbdae.symbolic.law import AUGMENTED, params
from mbdae.symbolic.motion import Motion
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import Expr, Vec
from mbdae.values import BadValueError, number

__all__ = ["ClearanceRevolute", "Cylindrical", "Distance", "FixedOrientation", "Free", "KnifeEdge", "Planar", "PointOnLine",
           "PointOnPlane", "Prismatic", "Revolute", "Rolling", "RollingBall", "Screw", "Spherical", "Universal", "Weld"]


class Revolute(Joint):
    """l turns about k.z. Paper Eqs. 1, 10 to 12 (`drive` is phi(t), `angle` the unknown phi of the classical model).

    The row that holds the angle, x_k.(x_l sin phi + y_l cos phi) = sin(phi - theta), vanishes at theta = phi + pi too;
    the start refuses that branch (x_k.(x_l cos phi - y_l sin phi) > 0 is required there).
    The multipliers of `drive` and of `angle` are torques on l about k.z, N m: that of `drive` is the torque of the drive.
    """

    coordinates = params(angle=("rad", "rotation of l about k.z"))
    params = AUGMENTED
    loose = ClearanceRevolute
    optional = tuple(AUGMENTED)

    def motion(self, from_k: Motion) -> Motion:
        return from_k.about("z", self.angle)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return same_point(k, l) | same_axis(k, l)

    def coordinate(self, k: Frame, l: Frame) -> Expr:
        return self.relative_angle(k, l)

    def ties(self, k: Frame, l: Frame) -> dict[str, tuple[Expr, Expr]]:
        return {"angle": tied_angle(k, l, self.angle)}

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"axes in the same sense": k.z @ l.z}


class Prismatic(Joint):
    """l slides along k.z without turning. The multiplier of `drive` is the force of the drive on l along k.z, N."""

    coordinates = params(displacement=("m", "displacement of l along k.z"))

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("z", self.displacement)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return on_axis(k, l) | same_attitude(k, l)

    def coordinate(self, k: Frame, l: Frame) -> Expr:
        return k.z @ (l.r - k.r)

    def ties(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"displacement": self.displacement - k.z @ (l.r - k.r)}

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return upright(k, l)


class Cylindrical(Joint):
    """l slides along k.z and turns about it."""

    coordinates = params(displacement=("m", "displacement of l along k.z"), angle=("rad", "rotation of l about k.z"))

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("z", self.displacement).about("z", self.angle)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return on_axis(k, l) | same_axis(k, l)

    def coordinate(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"displacement": k.z @ (l.r - k.r), "angle": self.relative_angle(k, l)}

    def ties(self, k: Frame, l: Frame) -> dict[str, Expr | tuple[Expr, Expr]]:
        return {"displacement": self.displacement - k.z @ (l.r - k.r), "angle": tied_angle(k, l, self.angle)}

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"axes in the same sense": k.z @ l.z}


class Spherical(Joint):
    """The points of k and l coincide, all rotations are free."""

    coordinates = params(rotation=("rotation", "rotation of l relative to k"))

    def motion(self, from_k: Motion) -> Motion:
        return from_k.turned(self.rotation)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return same_point(k, l)


class Universal(Joint):
    """A cross with two pins at right angles: one along k.x on k, one along l.y on l. The points of k and l coincide.

    The angles are those of the cross about k.x and of l about l.y. At angle_l = +-90 degrees the pins leave a direction free that
    the angles do not describe (gimbal lock): the shafts are at right angles there."""

    coordinates = params(angle_k=("rad", "rotation of the cross about the pin of k"),
                         angle_l=("rad", "rotation of l about its pin"))

    def motion(self, from_k: Motion) -> Motion:
        return from_k.about("x", self.angle_k).about("y", self.angle_l)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return same_point(k, l) | {"pins": k.x @ l.y}

    def coordinate(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"angle_k": se.atan2(k.z @ l.y, k.y @ l.y), "angle_l": se.atan2(k.x @ l.z, k.x @ l.x)}

    def ties(self, k: Frame, l: Frame) -> dict[str, tuple[Expr, Expr]]:
        (ck, sk), (cl, sl) = ((se.cos(a), se.sin(a)) for a in (self.angle_k, self.angle_l))
        return {"angle_k": (l.y @ (k.y * sk - k.z * ck), l.y @ (k.y * ck + k.z * sk)),
                "angle_l": (k.x @ (l.x * sl - l.z * cl), k.x @ (l.x * cl + l.z * sl))}


class Planar(Joint):
    """l slides in the plane normal to k.z, along k.x and k.y, and turns about k.z."""

    coordinates = params(x=("m", "displacement of l along k.x"), y=("m", "displacement of l along k.y"),
                         angle=("rad", "rotation of l about k.z"))

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("x", self.x).along("y", self.y).about("z", self.angle)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"offset": k.z @ (l.r - k.r)} | same_axis(k, l)

    def coordinate(self, k: Frame, l: Frame) -> dict[str, Expr]:
        d = l.r - k.r
        return {"x": k.x @ d, "y": k.y @ d, "angle": self.relative_angle(k, l)}

    def ties(self, k: Frame, l: Frame) -> dict[str, Expr | tuple[Expr, Expr]]:
        d = l.r - k.r
        return {"x": self.x - k.x @ d, "y": self.y - k.y @ d, "angle": tied_angle(k, l, self.angle)}

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"axes in the same sense": k.z @ l.z}


class Screw(Joint):
    """l turns about k.z and travels along it by `lead` a turn, right-handed where that is positive.

    Its angle counts whole turns, which the frames do not show, so that it is an unknown in every model.

    Friction acts along the helix of a square thread at its mean radius r (`friction_radius`). With the travel a radian
    p = lead / (2 pi), the lead angle phi, tan phi = p / r, and a sliding velocity sqrt(r^2 + p^2) angle', the axial force F of
    the joint on l is that of the normal force N and of the friction c N (c: signed coefficient of friction) along the helix,

        F = +-N cos phi - c N sin phi,   N = sqrt(r^2 + p^2) (r |F| + c p F) / (r^2 - c^2 p^2)

    (+ or -: which flank of the thread carries).

    A load F is lifted by a torque F r tan(phi + rho) and lowered by F r tan(phi - rho), tan rho = c. Forces normal to the axis
    and tilting torques do not press the thread."""

    coordinates = params(angle=("rad", "rotation of l about k.z"))
    params = params(lead=("m", "travel a turn"))

    def compose(self) -> None:
        super().compose()
        steepness = self._steepness()
        if steepness and steepness * (self._coefficient() or 0.0) >= 1:
            raise LawError(f"screw '{self.name}': friction coefficient {self._coefficient():g} at a lead angle of "
                           f"{math.degrees(math.atan(self._steepness())):.3g} degrees: no torque turns it against an axial "
                           f"force; give a smaller friction coefficient or lead, or a larger radius")

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("z", self._travel() * self.angle).about("z", self.angle)

    def pressing(self, k: Frame, l: Frame, force: Vec) -> Vec:
        along: Vec = k.z * (k.z @ force)
        return along

    def lever(self) -> Expr:
        return se.sqrt(self.friction_radius**2 + self._travel() ** 2)

    def normal_force(self, k: Frame, l: Frame, force: Vec, coefficient: Expr) -> Expr:
        r, p, F = self.friction_radius, self._travel(), let(k.z @ force)
        return let(self.lever() * (r * let(se.sqrt(F**2 + SLIGHT**2)) + coefficient * p * F) / (r**2 - (coefficient * p) ** 2))

    def remarks(self) -> list[str]:
        mu, steepness = self._coefficient(), self._steepness()
        if mu is None or not mu > steepness > 0:
            return []
        return [f"self-locking: its friction coefficient {mu:g} is above tan(lead angle) = {steepness:.4g}; an axial force alone "
                f"does not turn it, and with smoothed friction it creeps"]

    def _travel(self) -> Expr:
        """Travel along k.z per radian of the angle, m."""
        return self.lead / (2 * se.pi)

    def _steepness(self) -> float:
        """Tangent of the lead angle at the radius of friction, without sign; 0 where it is not known."""
        try:
            lead, radius = number(self.lead), number(self.friction_radius)
        except BadValueError:
            return 0.0
        return abs(lead) / (2 * math.pi * radius) if radius > 0 else 0.0

    def _coefficient(self) -> float | None:
        """The largest coefficient of friction; None where it is not known."""
        found: float | None = None if self.friction is None else self.friction.largest()
        return found


class Weld(Joint):
    """l is fixed to k."""

    def motion(self, from_k: Motion) -> Motion:
        return from_k

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return same_point(k, l) | same_attitude(k, l)

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return upright(k, l)


#: directions that a generic joint may leave free, with their units and meanings
FREE = {**{a: ("m", f"displacement of l along k.{a}") for a in "xyz"},
        **{f"angle_{a}": ("rad", f"rotation of l about its {a} axis") for a in "xyz"}}


class Generic(Joint):
    """l moves relative to k along and about those of the joint's axes that are its coordinates: displacements along the axes of
    k, then rotations in their order, each about an axis that those before it have turned."""

    def motion(self, from_k: Motion) -> Motion:
        for name in sorted(self.coordinates, key=lambda c: c in FREE and FREE[c][0] == "rad"):
            move = from_k.about if name.startswith("angle_") else from_k.along
            from_k = move(name[-1], getattr(self, name))
        return from_k


@cache
def generic(free: tuple[str, ...]) -> type[Joint]:
    """The class of generic joints with these free directions (names of `FREE`)."""
    stated = {"coordinates": params(**{c: FREE[c] for c in free}), "__module__": __name__, "__doc__": Generic.__doc__}
    return type("Generic__" + "__".join(free), (Generic,), stated)


def __getattr__(name: str) -> Any:
    """Classes of generic joints by their names, as pickles and stored laws ask for them."""
    head, *free = name.split("__")
    if head != "Generic" or not free or not set(free) <= FREE.keys():
        raise AttributeError(f"module {__name__} has no attribute {name}")
    return generic(tuple(free))
