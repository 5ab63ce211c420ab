"""Constraint rows that several joints share, and joints that hold rows without axes of their own: distance, orientation, points
on lines and planes, the free joint, what remains of a revolute joint with clearance; rolling without slip and knife edges.
"""

from __future__ import annotations

import symengine as se

from mbdae.errors import LawError
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import params
from mbdae.symbolic.motion import Motion
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import Expr, Vec

__all__ = ["ClearanceRevolute", "Distance", "FixedOrientation", "Free", "KnifeEdge", "PointOnLine", "PointOnPlane", "Rolling",
           "RollingBall"]


def same_point(k: Frame, l: Frame) -> dict[str, Expr]:
    """Rows that vanish where the points of k and l coincide, in inertial axes. Multipliers: minus the components of the force on
    l, N."""
    d = l.r - k.r
    return {"x": d[0], "y": d[1], "z": d[2]}


def same_axis(k: Frame, l: Frame) -> dict[str, Expr]:
    """Rows that let l turn about k.z only (paper Eq. 1). Multipliers: the torques about k.y and k.x that keep the axes parallel,
    N m."""
    return {"tilt_y": k.z @ l.x, "tilt_x": k.z @ l.y}


def turned_by(k: Frame, l: Frame, angle: Expr) -> Expr:
    """sin(angle - theta), theta the angle of l about k.z (paper Eqs. 10 and 12): zero where both agree, and half a turn off."""
    return k.x @ (l.x * se.sin(angle) + l.y * se.cos(angle))


def tied_angle(k: Frame, l: Frame, angle: Expr) -> tuple[Expr, Expr]:
    """The row that vanishes where l is turned about k.z by `angle`, and an expression that is positive there and negative half a
    turn off, where the row vanishes too."""
    return turned_by(k, l, angle), k.x @ (l.x * se.cos(angle) - l.y * se.sin(angle))


def on_axis(k: Frame, l: Frame) -> dict[str, Expr]:
    """Rows that keep the point of l on the axis k.z. Multipliers: forces along k.x and k.y, N."""
    d = l.r - k.r
    return {"offset_x": k.x @ d, "offset_y": k.y @ d}


def same_attitude(k: Frame, l: Frame) -> dict[str, Expr]:
    """Rows that keep l from turning relative to k."""
    return {**same_axis(k, l), "twist": k.x @ l.y}


def upright(k: Frame, l: Frame) -> dict[str, Expr]:
    """Expressions that are positive where l has the attitude of k; one is negative half a turn off, where the rows of
    `same_attitude` vanish too."""
    return {"z axes in the same sense": k.z @ l.z, "x axes in the same sense": k.x @ l.x}


class Distance(Joint):
    """The points of k and l keep their distance `length` (> 0). The multiplier is the compression of the rod, N."""

    params = params(length=("m", "distance as drawn"))

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"length": (l.r - k.r).norm() - self.length}

    def undefined_at(self) -> tuple[str, ...]:
        return ("points together",)


class FixedOrientation(Joint):
    """l does not turn relative to k; its point moves freely, by displacements along k's axes."""

    coordinates = params(x=("m", "displacement of l along k.x"), y=("m", "displacement of l along k.y"),
                         z=("m", "displacement of l along k.z"))

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("x", self.x).along("y", self.y).along("z", self.z)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return same_attitude(k, l)

    def coordinate(self, k: Frame, l: Frame) -> dict[str, Expr]:
        d = l.r - k.r
        return {"x": k.x @ d, "y": k.y @ d, "z": k.z @ d}

    def ties(self, k: Frame, l: Frame) -> dict[str, Expr]:
        d = l.r - k.r
        return {"x": self.x - k.x @ d, "y": self.y - k.y @ d, "z": self.z - k.z @ d}

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return upright(k, l)


class Free(Joint):
    """l moves freely relative to k; the displacements are along k's axes."""

    coordinates = params(x=("m", "displacement of l along k.x"), y=("m", "displacement of l along k.y"),
                         z=("m", "displacement of l along k.z"),
                         rotation=("rotation", "rotation of l relative to k"))

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("x", self.x).along("y", self.y).along("z", self.z).turned(self.rotation)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {}

    def coordinate(self, k: Frame, l: Frame) -> dict[str, Expr]:
        d = l.r - k.r
        return {"x": k.x @ d, "y": k.y @ d, "z": k.z @ d}

    def ties(self, k: Frame, l: Frame) -> dict[str, Expr]:
        d = l.r - k.r
        return {"x": self.x - k.x @ d, "y": self.y - k.y @ d, "z": self.z - k.z @ d}


class PointOnLine(Joint):
    """The point of l slides along k.z; all rotations are free."""

    coordinates = params(displacement=("m", "displacement of the point along k.z"),
                         rotation=("rotation", "rotation of l relative to k"))

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("z", self.displacement).turned(self.rotation)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return on_axis(k, l)

    def coordinate(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"displacement": k.z @ (l.r - k.r)}

    def ties(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"displacement": self.displacement - k.z @ (l.r - k.r)}


class PointOnPlane(Joint):
    """The point of l stays in the plane normal to k.z; all rotations are free. The multiplier is minus the force on l along k.z,
    N."""

    coordinates = params(x=("m", "displacement of the point along k.x"), y=("m", "displacement of the point along k.y"),
                         rotation=("rotation", "rotation of l relative to k"))

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("x", self.x).along("y", self.y).turned(self.rotation)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"offset": k.z @ (l.r - k.r)}

    def coordinate(self, k: Frame, l: Frame) -> dict[str, Expr]:
        d = l.r - k.r
        return {"x": k.x @ d, "y": k.y @ d}

    def ties(self, k: Frame, l: Frame) -> dict[str, Expr]:
        d = l.r - k.r
        return {"x": self.x - k.x @ d, "y": self.y - k.y @ d}


class ClearanceRevolute(Joint):
    """The pin on l stays in the middle of the race on k along k.z and, unless `tilting`, parallel to it.

    Paper Eqs. 1 and 31: three rows in space, none in the plane; where pin and race meet is determined by the contact law. With
    `drive` the fourth row turns the pin as in the kinematic model (Eq. 12).
    """

    coordinates = params(angle=("rad", "rotation of l about k.z"))
    options = ("tilting",)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        rows = {"axial": k.z @ (l.r - k.r)}
        return rows if self.tilting else rows | same_axis(k, l)

    def coordinate(self, k: Frame, l: Frame) -> Expr:
        return self.relative_angle(k, l)

    def ties(self, k: Frame, l: Frame) -> dict[str, tuple[Expr, Expr]]:
        return {"angle": tied_angle(k, l, self.angle)}

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"axes in the same sense": k.z @ l.z}


def slip(k: Frame, l: Frame, arm: Vec) -> Vec:
    """Velocity, relative to k, of the point of l at l.r + arm, m/s."""
    if not (k.kind.oriented and l.kind.oriented):
        raise LawError("what rolls or cuts needs axes on its bodies, and a point mass has none: use s.rigid_body for it")
    return l.v + l.w.cross(arm) - k.v - k.w.cross(l.r + arm - k.r)


class Rolling(Joint):
    """The edge of a disc l, with the axle l.z through its centre l.r, rolls without slip on a plane of k.

    The normal n of the plane lies in the plane of k.x and k.z, at the angle `lean` from k.x. The lowest point of the edge is at
    d = -radius (n - s l.z) / c from the centre, s = n.l.z, c = sqrt(1 - s^2), and does not slip there: neither in the direction
    l.z x n of travel (row `along`) nor across it. Multipliers: minus the force of the plane on the disc along n (`height`), along
    the direction of travel and across it, N."""

    params = params(radius=("m", "radius of the disc"), lean=("rad", "angle of the axle to the plane as drawn"))
    optional = ("lean",)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        n, cosine, _ = self._contact(k, l)
        drawn = 1 if self.lean is None else se.cos(self.lean)
        return {"height": n @ (l.r - k.r) - self.radius * (cosine - drawn)}

    def velocity_constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        n, cosine, arm = self._contact(k, l)
        ahead, v = l.z.cross(n) * (1 / cosine), slip(k, l, arm)
        return {"along": ahead @ v, "across": n.cross(ahead) @ v}

    def _contact(self, k: Frame, l: Frame) -> tuple[Vec, Expr, Vec]:
        """Normal of the plane, cosine of the axle's angle to it, and the way from the centre to the lowest point."""
        n = k.x if self.lean is None else k.x * se.cos(self.lean) + k.z * se.sin(self.lean)
        sine = let(n @ l.z)
        cosine = let(se.sqrt(1 - sine**2))
        return n, cosine, (l.z * sine - n) * (self.radius / cosine)


class RollingBall(Joint):
    """A ball l with the centre l.r rolls without slip on a plane of k normal to k.z; it may spin about that normal. Multipliers:
    minus the force of the plane on the ball along k.z (`height`), k.x and k.y, N."""

    params = params(radius=("m", "radius of the ball"))

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"height": k.z @ (l.r - k.r)}

    def velocity_constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        v = slip(k, l, k.z * -self.radius)
        return {"along_x": k.x @ v, "along_y": k.y @ v}


class KnifeEdge(Joint):
    """The point of l moves relative to k along l.x, seen in the plane normal to k.z, and not across it, as a blade on ice does.
    The multiplier is minus the force on l across the blade, N, where the blade is normal to k.z."""

    def velocity_constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"across": k.z.cross(l.x) @ slip(k, l, Vec(0, 0, 0))}
