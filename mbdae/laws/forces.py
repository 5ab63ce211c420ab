"""Forces on and between bodies: applied forces and torques, gravity, the spring between two points, bushings of points and of
attitudes, and ropes over pulleys.
"""

from __future__ import annotations

from functools import cache
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
import symengine as se

from mbdae.errors import LawError
from mbdae.laws.on_coordinates import (
    Differential,
    Gear,
    JointDamper,
    JointFriction,
    JointLoad,
    JointSpring,
    JointStop,
    Rack,
    WeightedSum,
)
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Force, params
from mbdae.symbolic.part import Parameter
from mbdae.symbolic.variation import let, nearest_turn, rate
from mbdae.symbolic.vectors import UNIT, ZERO, Expr, Vec, components
from mbdae.values import Array

__all__ = ["AppliedForce", "AppliedTorque", "Bushing", "Differential", "Gear", "Gravity", "JointDamper", "JointFriction",
           "JointLoad", "JointSpring", "JointStop", "PointSpring", "Rack", "RotationalBushing", "WeightedSum"]


_FORCE = params(fx=("N", "force, x"), fy=("N", "force, y"), fz=("N", "force, z"))
_TORQUE = params(mx=("N m", "torque, x"), my=("N m", "torque, y"), mz=("N m", "torque, z"))


def _resolved(l: Frame, value: Vec, following: bool) -> Vec:
    """The value in inertial axes, or along the axes of the body it follows."""
    return l.x * value[0] + l.y * value[1] + l.z * value[2] if following else value


class AppliedForce(Force):
    """Force at a point of l; with `following` its components turn with the body. k is the ground."""

    params = _FORCE
    options = ("following",)
    external = True
    axes_of = "l"
    loads = True

    def wrench(self, k: Frame, l: Frame) -> tuple[Vec, Vec]:
        return _resolved(l, components(self.fx, self.fy, self.fz), self.following), ZERO


class AppliedTorque(Force):
    """Torque on l; with `following` its components turn with the body. k is the ground."""

    params = _TORQUE
    options = ("following",)
    external = True
    axes_of = "l"
    loads = True

    def wrench(self, k: Frame, l: Frame) -> tuple[Vec, Vec]:
        return ZERO, _resolved(l, components(self.mx, self.my, self.mz), self.following)


class Gravity(Force):
    """Gravity on a body.

    V = - m g.r of the centre of mass; k is the ground; components left out are zero."""

    params = params(
        mass=("kg", "mass"), gx=("m/s^2", "field, x"), gy=("m/s^2", "field, y"), gz=("m/s^2", "field, z")
    )

    external = True
    loads = True
    at_nodes = True

    def energy(self, k: Frame, l: Frame) -> Expr:
        return -self.mass * (components(self.gx, self.gy, self.gz) @ l.center)


class PointSpring(Force):
    """Spring and damper between two points.

    V = stiffness (|d| - length)^2 / 2, Rayleigh function damping (d|d|/dt)^2 / 2, d from k's point to l's.

    Without `length` (a spring of zero natural length) V = stiffness d.d / 2, smooth where the points meet. The damper acts
    along d, which has no direction where the points meet; for points that may meet use a bushing.
    """

    params = params(stiffness=("N/m", "stiffness"), damping=("N s/m", "damping"), length=("m", "natural length"))

    def undefined_at(self) -> tuple[str, ...]:
        return () if self.length is None else ("points together",)

    def energy(self, k: Frame, l: Frame) -> Expr:
        d = l.r - k.r
        return self.stiffness * (d @ d if self.length is None else (d.norm() - self.length) ** 2) / 2

    def dissipation(self, k: Frame, l: Frame) -> Expr:
        if self.damping is None:
            return super().dissipation(k, l)
        if self.length is None:
            raise LawError("a damper between two points needs a natural length: give length > 0 (m), or use a bushing where the "
                           "points may meet")
        d, v = l.r - k.r, l.v - k.v
        return self.damping * (d @ v) ** 2 / (d @ d) / 2


class Bushing(Force):
    """Bushing: elastic and damped connection of two points in all directions.

    V = sum k_i d_i^2 / 2 along the axes of k, d the displacement of l's point; damping of the velocity of this
    point as seen from k."""

    params = params(
        kx=("N/m", "stiffness along k.x"), ky=("N/m", "stiffness along k.y"), kz=("N/m", "stiffness along k.z"),
        cx=("N s/m", "damping along k.x"), cy=("N s/m", "damping along k.y"), cz=("N s/m", "damping along k.z"),
    )
    axes_of = "k"

    def energy(self, k: Frame, l: Frame) -> Expr:
        return se.Integer(0) if self.kx is None else along(k, l.r - k.r, (self.kx, self.ky, self.kz))

    def dissipation(self, k: Frame, l: Frame) -> Expr:
        if self.cx is None:
            return se.Integer(0)
        return along(k, l.v - k.v - k.w.cross(l.r - k.r), (self.cx, self.cy, self.cz))


def along(k: Frame, a: Vec, weights: tuple[Expr, Expr, Expr]) -> Expr:
    """Half the weighted sum of squares of the components of a along the axes of k."""
    return sum((w * let(axis @ a) ** 2 / 2 for w, axis in zip(weights, (k.x, k.y, k.z), strict=True)), se.Integer(0))


class RotationalBushing(Force):
    """Rotational bushing: elastic and damped connection of two attitudes about all axes.

    V = sum c_i rho_i^2 / 2 about the axes of k; damping on the relative angular velocity.

    rho is the Rodrigues vector 2 tan(theta/2) n of the relative rotation by the angle theta about the axis n: it differs
    from the rotation vector theta n by terms of third order, and is finite below half a turn.
    """

    params = params(
        rx=("N m/rad", "stiffness about k.x"), ry=("N m/rad", "stiffness about k.y"), rz=("N m/rad", "stiffness about k.z"),
        sx=("N m s/rad", "damping about k.x"), sy=("N m s/rad", "damping about k.y"), sz=("N m s/rad", "damping about k.z"),
    )
    axes_of = "k"

    def undefined_at(self) -> tuple[str, ...]:
        return ("half turn",)

    def energy(self, k: Frame, l: Frame) -> Expr:
        if self.rx is None:
            return se.Integer(0)
        twice_sine = Vec(k.y @ l.z - k.z @ l.y, k.z @ l.x - k.x @ l.z, k.x @ l.y - k.y @ l.x)
        trace = let(k.x @ l.x + k.y @ l.y + k.z @ l.z)
        squares = sum((c * let(s) ** 2 / 2 for c, s in zip((self.rx, self.ry, self.rz), twice_sine, strict=True)), se.Integer(0))
        return let(2 / (1 + trace)) ** 2 * let(squares)

    def dissipation(self, k: Frame, l: Frame) -> Expr:
        return se.Integer(0) if self.sx is None else along(k, l.w - k.w, (self.sx, self.sy, self.sz))


class Rope(Force):
    """Rope that pulls only, from k's point to l's.

    V = stiffness e^2 / (2 (length - wound)) where its path is longer than the rope by e > 0, else 0; with a damper the tension is
    (stiffness e + damping de/dt) / (length - wound) where both e and it are positive, else 0. On the pulleys between the ends
    (`rope_over`) it slides without friction. An end with a radius is wound on a drum about the z axis of its body, without slip;
    wound is what the drums have taken up since the drawing: what is left is the shorter and the stiffer. On a drum it pulls with
    tension times radius. What is wound takes its energy along: with drums there is no V, all that the rope does is power.

    Radii are positive where the rope, on its way from k to l, goes about z with the right hand, negative against it. The path
    goes along the common tangents of circles about points of the bodies: exact where their axes are parallel."""

    params = params(
        stiffness=("N", "tension over strain, EA"), damping=("N s", "tension over rate of strain"),
        length=("m", "natural length"),
        radius_k=("m", "radius of the drum on k"), radius_l=("m", "radius of the drum on l"),
        angle_k=("rad", "direction of the rope about k.z as drawn"), angle_l=("rad", "direction of the rope about l.z as drawn"),
    )
    states = {"turned_k": Parameter("rad", "angle of the rope about the drum on k, turn after turn"),  # noqa: RUF012
              "turned_l": Parameter("rad", "angle of the rope about the drum on l, turn after turn")}
    dissipative = True
    sticks = False
    must_stay = MappingProxyType({"on_pulleys": "the rope has left a pulley, on which the equations keep it as if it were glued "
                                                "there: end the run before, or leave that pulley out"})
    pulleys: ClassVar[int] = 0  #: number of frames between k and l on the way of the rope, p1, p2, ...

    def undefined_at(self) -> tuple[str, ...]:
        return ("points together", "some places")  # circles that overlap have no tangent

    def _route(self, frames: tuple[Frame, ...]) -> tuple[Expr, list[Expr], tuple[Expr | None, Expr | None]]:
        """Length of all spans between the circles; wrap of every pulley between the ends, rad; directions at both ends about
        their drums."""
        k, l, *between = frames
        on_way = [k, *between, l]
        radii = [self.radius_k, *(getattr(self, f"radius_{n + 1}") for n in range(self.pulleys)), self.radius_l]
        axis = next((f.z for f in on_way if f.kind.oriented), UNIT[2])
        axes = [f.z if f.kind.oriented else axis for f in on_way]
        spans, ways = [], []
        for n in range(len(on_way) - 1):
            halfway = _between(axes[n], axes[n + 1], on_way[n : n + 2])
            length, way = _tangent(on_way[n + 1].r - on_way[n].r, radii[n], radii[n + 1], halfway)
            spans.append(length)
            ways.append(way)
        wraps = [_from_drawn(_turn(axes[n], ways[n - 1], ways[n]), getattr(self, f"wrap_{n}")) for n in range(1, len(ways))]
        ends = tuple(None if radius is None else _angle_of(f, way)
                     for f, way, radius in ((k, ways[0], self.radius_k), (l, ways[-1], self.radius_l)))
        return sum(spans, se.Integer(0)), wraps, ends  # type: ignore[return-value]

    def _path(self, frames: tuple[Frame, ...]) -> tuple[Expr, Expr, list[Expr]]:
        """Length of the path from where the rope touched the drums as drawn; of it, what is wound on the drums; wraps."""
        spans, wraps, (at_k, at_l) = self._route(frames)
        between = sum((getattr(self, f"radius_{n + 1}") * wrap for n, wrap in enumerate(wraps)), se.Integer(0))
        wound = se.Integer(0)
        if at_k is not None:
            wound += self.radius_k * (nearest_turn(at_k, self.turned_k) - self.angle_k)
        if at_l is not None:
            wound -= self.radius_l * (nearest_turn(at_l, self.turned_l) - self.angle_l)
        return let(spans + between + wound), let(wound) if wound != 0 else wound, wraps

    def _pull(self, frames: tuple[Frame, ...]) -> tuple[Expr, Expr, Expr, Expr]:
        """Path; by how much it is longer than the rope, 0 where it is slack; free length; part of the tension from the damper."""
        path, wound, _ = self._path(frames)
        over, free = let(path - self.length), let(self.length - wound)
        taut = let(se.Piecewise((over, over > 0), (0, True)))
        if self.damping is None:
            return path, taut, free, se.Integer(0)
        total = let(self.stiffness * taut + self.damping * rate(over))
        pulling = let(se.Piecewise((total, total > 0), (0, True)))
        return path, taut, free, let(se.Piecewise((pulling - self.stiffness * taut, over > 0), (0, True))) / free

    @property
    def _on_drum(self) -> bool:
        return self.radius_k is not None or self.radius_l is not None

    def energy(self, *frames: Frame) -> Expr:
        _, taut, free, _ = self._pull(frames)
        return se.Integer(0) if self._on_drum else self.stiffness * taut**2 / (2 * free)

    def _tension(self, frames: tuple[Frame, ...]) -> tuple[Expr, Expr]:
        """Path and tension."""
        path, taut, free, damped = self._pull(frames)
        return path, self.stiffness * taut / free + damped

    def thrust(self, *frames: Frame) -> tuple[Expr, Expr] | None:
        if self._on_drum:
            path, tension = self._tension(frames)
            return path, -tension
        path, _, _, damped = self._pull(frames)
        return None if self.damping is None else (path, -damped)

    def observed(self, *frames: Frame) -> dict[str, list[Expr]]:
        path, tension = self._tension(frames)
        on_pulleys = [getattr(self, f"radius_{n + 1}") * wrap for n, wrap in enumerate(self._path(frames)[2])]
        return {"tension": [tension], "length": [path]} | ({"on_pulleys": on_pulleys} if on_pulleys else {})

    def rates(self, *frames: Frame) -> dict[str, Expr]:
        return {f"turned_{side}": rate(at) for side, at in zip("kl", self._route(frames)[2], strict=True) if at is not None}

    def initial(self, *frames: Frame) -> dict[str, Expr]:
        """Start value of the angles at the drums: within half a turn of the drawing."""
        found = zip("kl", self._route(frames)[2], strict=True)
        return {f"turned_{side}": nearest_turn(at, getattr(self, f"angle_{side}")) for side, at in found if at is not None}


def _between(a: Vec, b: Vec, frames: list[Frame]) -> Vec:
    """Unit vector halfway between two axes; that of the body that has one, where the other is a point."""
    first, second = (f.kind.oriented for f in frames)
    if not (first and second) or any(f.kind.flat for f in frames):
        return a if first else b
    both = (a + b).named()
    halfway: Vec = both / let(both.norm())
    return halfway


def _tangent(d: Vec, first: Expr | None, second: Expr | None, axis: Vec) -> tuple[Expr, Vec]:
    """Length of the common tangent of two circles about an axis, d from the centre of the first to that of the second, and its
    direction across the axis; radii None: points, between which it goes straight."""
    if first is None and second is None:
        length = let(d.norm())
        return length, (d / length).named()
    along, wider = let(d @ axis), (second or 0) - (first or 0)
    across = (d - axis * along).named()
    squared = let(across @ across)
    reach = let(se.sqrt(squared - wider**2))
    return let(se.sqrt(reach**2 + along**2)), ((across * reach - axis.cross(across) * wider) / squared).named()


def _turn(axis: Vec, a: Vec, b: Vec) -> tuple[Expr, Expr]:
    """Sine and cosine of the angle from a to b about an axis, both times the same length."""
    return axis @ a.cross(b), a @ b - (a @ axis) * (b @ axis)


def _from_drawn(turn: tuple[Expr, Expr], drawn: Expr) -> Expr:
    """The angle with a sine and cosine that is nearest to that as drawn."""
    s, c, sd, cd = *turn, se.sin(drawn), se.cos(drawn)
    return let(drawn + se.atan2(s * cd - c * sd, c * cd + s * sd))


def _angle_of(f: Frame, way: Vec) -> Expr:
    """Direction of a vector about the z axis of a frame, from its x axis, in (-pi, pi]."""
    return se.atan2(f.y @ way, f.x @ way)


@cache
def rope_over(pulleys: int) -> type[Rope]:
    """The class of ropes over so many pulleys, whose radii are radius_1, ... and wraps as drawn wrap_1, ... (rad, of the sign of
    the radius); their frames p1, p2, ... follow k and l."""
    if not pulleys:
        return Rope
    own = {f"{name}_{n + 1}": Parameter(unit, f"{meaning} of pulley {n + 1}") for n in range(pulleys)
           for name, unit, meaning in (("radius", "m", "radius"), ("wrap", "rad", "wrap as drawn"))}
    values: dict[str, Any] = {"frames": (*Rope.frames, *(f"p{n + 1}" for n in range(pulleys))), "pulleys": pulleys,
                              "params": {**Rope.params, **own}, "__module__": __name__, "__doc__": Rope.__doc__}
    made = type(f"RopeOver{pulleys}", (Rope,), values)
    globals()[made.__name__] = made  # where pickle looks for it
    return made


def tangents(points: Array, radii: Array, axis: Array) -> tuple[Array, Array]:
    """Numbers of a rope's spans over circles of the radii (s,), 0: points, about centres `points` (..., s, 3), m, and a common
    axis (3,): where each begins and ends (..., s - 1, 2, 3), and its direction (..., s - 1, 3); nan where circles overlap."""
    d, wider = np.diff(points, axis=-2), np.diff(radii)[:, None]
    along = (d @ axis)[..., None] * axis
    across = d - along
    squared = np.sum(across**2, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        way = (across * np.sqrt(squared - wider**2) - np.cross(axis, across) * wider) / squared
    aside = np.cross(axis, way)
    begin, end = points[..., :-1, :] - radii[:-1, None] * aside, points[..., 1:, :] - radii[1:, None] * aside
    return np.stack([begin, end], axis=-2), way


def wraps_of(ways: Array, radii: Array, axis: Array) -> Array:
    """Angles (..., s - 2), rad, by which directions (..., s - 1, 3) turn about the axis at the circles between, with the sign of
    the radii (s,), less than a turn."""
    before, after, sense = ways[..., :-1, :], ways[..., 1:, :], np.sign(radii[1:-1])
    turn = np.arctan2(np.cross(before, after) @ axis, np.sum(before * after, axis=-1))
    return np.asarray(sense * np.mod(sense * turn, 2 * np.pi))
