"""Mass properties: slender rods, inertia matrices and what makes them impossible.

How bodies look: their shapes and colours. No force follows from it; a contact states its own shapes.

Statements of contact between bodies: two shapes, and the laws that act where they touch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from mbdae.deferred import Later
from mbdae.scene import reading
from mbdae.scene.components import Body, Connection
from mbdae.scene.connections import where
from mbdae.scene.models import friction_law, normal_law
from mbdae.scene.reading import Argument, reads
from mbdae.scene.record import SceneItems, statement
from mbdae.scene.shapes import Box, Cylinder, Plane, Point, Shape, Sphere
from mbdae.symbolic.law import TwoBodyLaw
from mbdae.values import Array, BadValueError, array, shown

if TYPE_CHECKING:
    from mbdae.laws import surfaces
    from mbdae.laws.contact import Contact
else:
    surfaces = Later("mbdae.laws.surfaces")


def of_rods(points: Array, mass: float) -> tuple[Array, Array]:
    """Centre of mass (3,), m, and inertia (3, 3) about it, kg m^2, of uniform slender rods through points (n, 3); mass in kg."""
    ends = np.stack([points[:-1], points[1:]], axis=1)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    masses = mass * lengths / lengths.sum()
    middles = ends.mean(axis=1)
    center = (masses[:, None] * middles).sum(axis=0) / mass if mass else middles.mean(axis=0)
    J = np.zeros((3, 3))
    for m, (a, b), c in zip(masses, ends, middles, strict=True):
        for direction, weight in (((b - a), m / 12), (c - center, m)):
            J += weight * (direction @ direction * np.eye(3) - np.outer(direction, direction))
    return center, J


def matrix(value: Array) -> Array:
    """Inertia matrix (3, 3), kg m^2, from one number (about z), 3 principal values or 3x3."""
    if value.ndim == 0:
        return np.diag([0.0, 0.0, float(value)])
    return np.diag(value) if value.shape == (3,) else np.asarray(value, dtype=float)


def problems(name: str, J: Array, planar: bool, as_given: bool) -> list[str]:
    """Why an inertia matrix is impossible, one sentence each. as_given: whether one that no body has is taken all the same."""
    if not np.allclose(J, J.T, atol=1e-12 * (1 + np.abs(J).max())):
        return [f"body '{name}': inertia matrix is not symmetric (differs by {np.abs(J - J.T).max():.3g} kg m^2); "
                f"give equal products of inertia above and below the diagonal"]
    moments = np.linalg.eigvalsh(J)
    if moments[0] < -1e-12 * max(moments[-1], 1e-300):
        return [f"body '{name}': inertia has the negative principal moment {moments[0]:.6g} kg m^2; give that of a "
                f"body, whose principal moments are 0 or positive"]
    if not (planar or as_given) and moments[0] + moments[1] < moments[2] * (1 - 1e-9):
        return [f"body '{name}': principal moments {moments[0]:.10g}, {moments[1]:.10g}, {moments[2]:.10g} kg m^2 violate the "
                f"triangle inequality (the two smaller must add up to at least the largest); correct them, or pass as_given=True "
                f"to have them taken as they are"]
    return []


ROUNDING = 1e-15  #: a direction whose length deviates from 1 by at most this is not scaled to length 1 again
GIVE_A_SHAPE = "give mb.Plane, mb.Cylinder, mb.Sphere, mb.Point or mb.Box"
READERS: dict[str, Callable[[Any], str]] = {}  #: "color" -> function that reads a colour, entered by the package that draws


def shape(arg: Argument, value: Any) -> Shape:
    """Reader of a shape: returns it with plain values, a point, directions of length 1, and lengths above 0."""
    if not isinstance(value, Shape) or type(value) is Shape:
        arg.wrong(f"{shown(value)} is no shape", GIVE_A_SHAPE)
        return Point()
    found: dict[str, Any] = {}
    for key, given in vars(value).items():
        part = arg.part(f"{arg.option}.{key}")
        if key in ("radius", "length"):
            found[key] = None if given is None and key == "length" else reading.quantity("m", "positive")(part, given)
        elif key in ("normal", "axis"):
            # the direction at length 1; a unit vector is returned unchanged, so that a stored scene repeats its
            # numbers exactly
            direction = reading.direction(part, given)
            found[key] = direction if abs(np.linalg.norm(direction) - 1) <= ROUNDING else reading.unit(direction)
        elif key == "size":
            found[key] = _edges(part, given)
        elif given is not None:
            found[key] = (reading.rotation if key == "rotation" else reading.point)(part, given)
    return replace(value, **found)


def _edges(arg: Argument, value: Any) -> Array:
    """Reader of the lengths (3,), m, of the edges of a box; that along z is 0 where two are given."""
    try:
        found = array(value)
        if found.shape not in ((2,), (3,)) or (found < 0).any() or not found.any():
            raise BadValueError(shown(value))
    except BadValueError as value_and_reason:
        arg.wrong(value_and_reason, "give three lengths in m, 0 or more and not all 0, or two for a plate in the plane z = 0")
        return np.ones(3)
    return np.append(found, np.zeros(3 - len(found)))


def shapes(arg: Argument, value: Any) -> tuple[Shape, ...]:
    """Reader of the shapes of a body: one, or a list of them."""
    given = list(value) if isinstance(value, list | tuple) else [value]
    return tuple([shape(arg if len(given) == 1 else arg.part(f"{arg.option}[{i}]"), one) for i, one in enumerate(given)])


def color(arg: Argument, value: Any) -> str:
    """Reader of a colour: "#rrggbb", from a text that matplotlib knows or from 3 or 4 numbers (an opacity is ignored).
    matplotlib's grey levels, numbers written as texts, are refused: no argument takes numbers as texts."""
    try:
        named = isinstance(value, str) and not value.strip().replace(".", "").isdigit()
        return READERS["color"](value if named else tuple(array(value, (3,), (4,)).tolist()))
    except ValueError as refused:
        told = isinstance(refused, BadValueError) and shown(value) in str(refused)
        remedy = "give a colour as matplotlib does: 'tab:blue', 'red', '#1f77b4', 'C0', or (r, g, b) from 0 to 1"
        arg.wrong(refused if told else shown(value), remedy)
        return "#000000"


def placed(one: Any, point: Array) -> Any:
    """The shape with its point `at`; where it has none, at `point` (3,), m, as drawn."""
    return one if one.at is not None else replace(one, at=np.array(point, dtype=float))


def looking(body: Body, shape: tuple[Shape, ...] | None, color: str | None) -> Body:
    """The body with its shapes and colour."""
    body.shapes = None if shape is None else tuple(placed(one, body.drawn.position) for one in shape)
    body.color = color
    return body


TWO = "a plane touches spheres, points, boxes and cylinders; a sphere touches spheres, points and cylinders"
STANDING = 1e-9  #: difference of a component of a unit vector from 0, or from 1 or -1, that counts as rounding


class ContactStatements(SceneItems):
    """`contact`."""

    _connect: Callable[[Connection], Connection]

    @reads(name=reading.name, k=reading.body, l=reading.body, shape_k=shape, shape_l=shape, normal=normal_law,
           friction=friction_law)
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
            laws = [(surfaces.BallOnBall, {"at": one.at, "at_l": other.at, "radius_k": 1.0})]
        made_of: list[TwoBodyLaw] = [law(name, k, l, normal=normal, friction=friction, **values) for law, values in laws]
        return self._connect(Connection(name, "contact", k, l, made_of, shapes=(one, other)))

    def _without_ends(self, one: Any) -> Any:
        """The shape; without its ends where it is a cylinder that stands on the plane of a planar scene and is a disc there."""
        disc = self.space == "planar" and isinstance(one, Cylinder) and abs(abs(one.axis[2]) - 1) < STANDING
        return replace(one, length=None) if disc else one


def _rank(one: Shape) -> int:
    return next((i for i, kind in enumerate((Plane, Cylinder)) if isinstance(one, kind)), 2)


ContactLaws = list[tuple[type["Contact"], dict[str, Any]]]  #: classes of laws, each with its places and numbers by name


def _ball_on_plane(plane: Plane, ball: Any) -> ContactLaws:
    radius = getattr(ball, "radius", None)
    return [(surfaces.BallOnPlane, {"at": plane.at, "at_l": ball.at, "axis": plane.normal, "radius": radius})]


def _box_on_plane(plane: Plane, box: Box) -> ContactLaws:
    """The contact of every corner of the box."""
    axes = np.eye(3) if box.rotation is None else np.asarray(box.rotation)
    signs = product(*((-0.5, 0.5) if edge else (0.0,) for edge in box.size))
    corners = [box.at + axes @ (np.array(sign) * box.size) for sign in signs]
    return [part for corner in corners for part in _ball_on_plane(plane, Point(corner))]


def _cylinder_on_plane(plane: Plane, cylinder: Cylinder) -> ContactLaws:
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
    return [(surfaces.CylinderOnPlane, {**place, "radius": cylinder.radius, "length": cylinder.length, **components})]


def _ball_on_cylinder(cylinder: Cylinder, ball: Any) -> ContactLaws:
    return [(surfaces.BallOnCylinder, {"at": cylinder.at, "at_l": ball.at, "axis": cylinder.axis, "radius_k": cylinder.radius,
                              "radius_l": getattr(ball, "radius", None), "length": cylinder.length})]


def _ball_on_ball(one: Any, other: Any) -> ContactLaws:
    return [(surfaces.BallOnBall, {"at": one.at, "at_l": other.at, "radius_k": getattr(one, "radius", None),
                          "radius_l": getattr(other, "radius", None)})]


#: two kinds of shapes -> function that makes the laws of their contact
PAIRS: dict[tuple[type[Shape], type[Shape]], Callable[[Any, Any], ContactLaws]] = {
    (Plane, Sphere): _ball_on_plane, (Plane, Point): _ball_on_plane, (Plane, Box): _box_on_plane,
    (Plane, Cylinder): _cylinder_on_plane, (Cylinder, Sphere): _ball_on_cylinder, (Cylinder, Point): _ball_on_cylinder,
    (Sphere, Sphere): _ball_on_ball, (Sphere, Point): _ball_on_ball, (Point, Sphere): _ball_on_ball,
}
