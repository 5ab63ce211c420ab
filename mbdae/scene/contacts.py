"""Statements of contact between bodies: two shapes, and the laws that act where they touch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from mbdae.laws.contact import BallOnBall, BallOnCylinder, BallOnPlane, CylinderOnPlane
from mbdae.laws.contact.base import Contact
from mbdae.scene import reading
from mbdae.scene.appearance import placed, shape
from mbdae.scene.components import Connection
from mbdae.scene.connections import where
from mbdae.scene.items import SceneItems
from mbdae.scene.models import friction_law, normal_law
from mbdae.scene.reading import reads
from mbdae.scene.record import statement
from mbdae.scene.shapes import Box, Cylinder, Plane, Point, Shape, Sphere
from mbdae.symbolic.law import TwoBodyLaw

TWO = "a plane touches spheres, points, boxes and cylinders; a sphere touches spheres, points and cylinders"
STANDING = 1e-9  #: difference of a component of a unit vector from 0, or from 1 or -1, that counts as rounding


class ContactStatements(SceneItems):
    """`contact`."""

    _connect: Callable[[Connection], Connection]

    @reads(name=reading.name, k=reading.body, l=reading.body, shape_k=shape, shape_l=shape, normal=normal_law,
           friction=friction_law)  # fmt: skip
    @statement
    def contact(self, name: str, k: Any, l: Any, shape_k: Shape, shape_l: Shape, normal: Any, friction: Any = None) -> Connection:
        """Contact of a shape of body k with one of body l: nothing acts where they are apart, a normal force and friction where
        they overlap, and no step goes over a contact. Shapes as drawn (m): mb.Plane, mb.Cylinder, mb.Sphere, mb.Point,
        mb.Box; without a point `at` they are at the centre of mass, or at the place `body.at(...)` given for the body.
        normal: mb.Hertz(...) or a normal law of one's own; friction: mb.Coulomb(...), one's own, or None. Sensors: `gap`,
        `normal_force`, `friction_force`, `slip`, `contacts`; force and torque are those on the body of the sphere, point, box,
        or of the cylinder on a plane."""
        item = f"contact '{name}'"
        first, second = ((b, placed(shape, where(self, item, b, shape.at))) for b, shape in ((k, shape_k), (l, shape_l)))
        if _rank(shape_k) > _rank(shape_l):
            first, second = second, first
        (k, one), (l, other) = first, second
        made = PAIRS.get((type(one), type(other)))
        laws = [] if made is None else made(self._without_ends(one), other)
        if made is None:
            kinds = f"mb.{type(one).__name__} and mb.{type(other).__name__}"
            self.problems.append(f"{item}: there is no contact of {kinds}; {TWO}")
            laws = [(BallOnBall, {"at": one.at, "at_l": other.at, "radius_k": 1.0})]
        made_of: list[TwoBodyLaw] = [law(name, k, l, normal=normal, friction=friction, **values) for law, values in laws]
        return self._connect(Connection(name, "contact", k, l, made_of, shapes=(one, other)))

    def _without_ends(self, one: Any) -> Any:
        """The shape; without its ends where it is a cylinder that stands on the plane of a planar scene and is a disc there."""
        disc = self.space == "planar" and isinstance(one, Cylinder) and abs(abs(one.axis[2]) - 1) < STANDING
        return replace(one, length=None) if disc else one


def _rank(one: Shape) -> int:
    return next((i for i, kind in enumerate((Plane, Cylinder)) if isinstance(one, kind)), 2)


Made = list[tuple[type[Contact], dict[str, Any]]]  #: classes of laws, each with its places and numbers by name


def _ball_on_plane(plane: Plane, ball: Any) -> Made:
    return [(BallOnPlane, {"at": plane.at, "at_l": ball.at, "axis": plane.normal, "radius": getattr(ball, "radius", None)})]


def _box_on_plane(plane: Plane, box: Box) -> Made:
    """The contact of every corner of the box."""
    axes = np.eye(3) if box.rotation is None else np.asarray(box.rotation)
    signs = product(*((-0.5, 0.5) if edge else (0.0,) for edge in box.size))
    corners = [box.at + axes @ (np.array(sign) * box.size) for sign in signs]
    return [part for corner in corners for part in _ball_on_plane(plane, Point(corner))]


def _cylinder_on_plane(plane: Plane, cylinder: Cylinder) -> Made:
    """The contact of a cylinder with a plane. The x axis of the law's frame is along the part of the cylinder's axis that lies in
    the plane. Where normal and axis both lie in the plane z = 0, y is along that part instead, because x is then normal to the
    planar scene."""
    z = np.asarray(plane.normal)
    up = float(cylinder.axis @ z)
    across = cylinder.axis - up * z
    lying = float(np.linalg.norm(across))
    flat = max(abs(z[2]), abs(cylinder.axis[2])) < STANDING
    upright = np.eye(3)[2]
    x = upright if flat else across / lying if lying > STANDING else None
    parts = {"along_x": 0.0 if flat else lying, "along_y": np.cross(z, upright) @ across if flat else 0.0, "along_z": up}
    place = {"at": plane.at, "at_l": cylinder.at, "axis": z, "axis_x": x}
    components = {name: float(part) if abs(part) > STANDING else None for name, part in parts.items()}
    return [(CylinderOnPlane, {**place, "radius": cylinder.radius, "length": cylinder.length, **components})]


def _ball_on_cylinder(cylinder: Cylinder, ball: Any) -> Made:
    return [(BallOnCylinder, {"at": cylinder.at, "at_l": ball.at, "axis": cylinder.axis, "radius_k": cylinder.radius,
                              "radius_l": getattr(ball, "radius", None), "length": cylinder.length})]  # fmt: skip


def _ball_on_ball(one: Any, other: Any) -> Made:
    return [(BallOnBall, {"at": one.at, "at_l": other.at, "radius_k": getattr(one, "radius", None),
                          "radius_l": getattr(other, "radius", None)})]  # fmt: skip


#: two kinds of shapes -> function that makes the laws of their contact
PAIRS: dict[tuple[type[Shape], type[Shape]], Callable[[Any, Any], Made]] = {
    (Plane, Sphere): _ball_on_plane, (Plane, Point): _ball_on_plane, (Plane, Box): _box_on_plane,
    (Plane, Cylinder): _cylinder_on_plane, (Cylinder, Sphere): _ball_on_cylinder, (Cylinder, Point): _ball_on_cylinder,
    (Sphere, Sphere): _ball_on_ball, (Sphere, Point): _ball_on_ball, (Point, Sphere): _ball_on_ball,
}  # fmt: skip
