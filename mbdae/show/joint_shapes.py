"""Shapes of bodies; symbols of joints by the relative motion that a joint allows: axes of rotation, directions of sliding.

One axis is drawn as a pin, two as a cross in two forks, three as a ball; one direction as a guide with a slider, two as a plane.
A thread is drawn where one coordinate turns and slides. Joints that state no motion have symbols of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.laws.joint_rows import Distance
from mbdae.laws.on_coordinates import JointLoad, JointSpring
from mbdae.scene import shapes as solid
from mbdae.scene.components import Body, Connection
from mbdae.show import symbols
from mbdae.show.geometry import INK, Collected, Label, Outline, ends
from mbdae.symbolic.joint import Joint
from mbdae.system.model.nodes import JointMotion
from mbdae.values import Array

# -- Shapes with which bodies are drawn


GREY = "#8a8a8a"  #: colour of shapes fixed to the ground
#: smallest ratio that is drawn: of the distance of a connected point from its body's origin, and of an ellipsoid of inertia (a
#: box where it is smaller), to the size of the scene; and of the axes of a ring of that ellipsoid to its longest axis
TINY = 0.02


class BodyShapes(Collected):
    """Draws bodies and the shapes of contacts."""

    def _body(self, body: Body, colour: str) -> None:
        self.colours[body.name] = colour
        if body in self.meshes:
            for points in self.meshes[body]:
                self._add(body.name, "thin", points, colour=colour)
            return self._name(body.name, body, body.drawn.position, True)
        drawn = [self._solid(body.name, one, body, colour) for one in self.looks.get(body.name, ())]
        if body.shapes is not None:
            if not drawn:
                self._add(body.name, "centre", body.drawn.position[None], body)
            return self._name(body.name, body, body.drawn.position, True)
        if body in self.lines:
            points = self.lines[body]
            self._add(body.name, "bar", points, colour=colour)
            return self._name(body.name, self.scene.ground, points[:, points.shape[1] // 2], True)
        if len(body.outline) > 1:
            self._add(body.name, "bar", body.outline, body, colour)
            return self._name(body.name, body, body.at(0.5).point, True)
        if body.is_point:
            if not drawn:
                self._add(body.name, "mass", body.drawn.position[None], body, colour)
            return self._name(body.name, body, body.drawn.position, True)
        return self._by_mass(body, colour, bool(drawn))

    def _by_mass(self, body: Body, colour: str, shaped: bool) -> None:
        """Draw a body that has no shapes."""
        corners = [p for p in self.attached[body.name] if np.linalg.norm(p) > TINY * self.size]
        extent = [] if shaped else self._extent(body, bool(corners))
        centre = [] if shaped else [("centre", np.zeros((1, 3)))]
        parts = [*_frame(np.array(corners), self.planar), *extent, *centre]
        for kind, points in parts:
            self.shapes.append(Outline(body.name, kind, colour if kind != "centre" else INK, points[None], body.name))
        anchor = np.mean([np.zeros(3), *corners], axis=0) if corners else np.zeros(3)
        self.labels.append(Label(body.name, anchor[None], body.name, True))

    def _extent(self, body: Body, framed: bool) -> list[tuple[str, Array]]:
        """The body's ellipsoid of inertia, in the plane a disc unless drawn as plate or bars (framed). A box where it is tiny, or
        larger than the rest of the scene, in which case mass and inertia do not belong to a real body."""
        axes = half_axes(body, self.planar)
        if self.planar and framed:
            return []
        if max(axes) < TINY * self.size or max(axes) > self.room:
            edge = 2.4 * self.mark
            return [] if framed else [("box", symbols.slider(np.zeros(3), np.array([1.0, 0, 0]), edge, edge, self.planar))]
        _, directions = np.linalg.eigh(body.inertia if body.inertia is not None else np.eye(3))
        e = [a * d for a, d in zip(axes, directions.T, strict=True)]
        if self.planar:
            x, y = axes[0] * np.eye(3)[:2]
            return [("disc", symbols.circle(np.zeros(3), x, y)), ("line", np.array([np.zeros(3), x]))]
        rings = [symbols.circle(np.zeros(3), e[i], e[j]) for i, j in ((0, 1), (1, 2), (2, 0))
                 if min(axes[i], axes[j]) > TINY * max(axes)]
        kind = "disc" if len(rings) == 1 else "ring"
        return [(kind, ring) for ring in rings] + [("line", np.array([-v, v])) for v in e]

    # -- shapes

    def _solid(self, item: str, one: Any, body: Body, colour: str) -> Any:
        """Draw a shape fixed to a body; planes are drawn later, when it is known how far they must reach."""
        if isinstance(one, solid.Plane):
            self.planes.append((item, one, body, []))
            return one
        for part in symbols.drawn(one, self.planar, self.size):
            points = part.points if body.is_ground else self._local(body, part.points)
            self.shapes.append(Outline(item, part.kind, colour, points[None], "" if body.is_ground else body.name, part.faces,
                                     part.shades))
        return one

    def _contact(self, item: Connection) -> None:
        """Draw those shapes of a contact that the drawing of the bodies lacks: shapes on the ground and on beams, and planes. A
        shape on the ground gets the name of the contact."""
        first, second = item.shapes
        one: Any
        for body, other, one in ((item.k, item.l, first), (item.l, item.k, second)):
            if isinstance(one, solid.Plane):
                known = next((p for p in self.planes if p[2] is body and symbols.same(p[1], one)), None)
                if known is None and (body.is_ground or body.shapes is None):
                    known = (item.name, one, body, [])
                    self.planes.append(known)
                if known is not None:
                    known[3].append(other.name)
            elif body.is_ground and not any(symbols.same(one, o) for o in self.fixed):
                self.fixed.append(one)
                self._solid(item.name, one, body, GREY)
            elif not body.is_ground and body.name not in self.colours and body.name not in self.hidden:
                self._solid(item.name, one, body, INK)
            if body.is_ground:
                self._name(item.name, body, np.asarray(one.at))

    def _planes(self) -> None:
        """Draw planes as far as the bodies that touch them move."""
        fixed = [np.asarray(one.at) for _, one, body, _ in self.planes if body.is_ground]
        for item, one, body, others in self.planes:
            reach = [self.extents[name] for name in others if name in self.extents] or \
                    [e for name, e in self.extents.items() if name != body.name]
            reach = [*self._seen_from(body, reach), *(fixed if body.is_ground else ())]
            points = [np.zeros((0, 3)), *(e.reshape(-1, 3) for e in reach)]
            part = symbols.plane(one, np.concatenate(points), self.size, self.planar)
            self._add(item, part.kind, part.points, body, GREY if body.is_ground else self.colours.get(body.name, INK))

    def _seen_from(self, body: Body, reach: list[Array]) -> list[Array]:
        """Points over time (nt, n, 3), m, as seen from a moving body, in the inertial frame with this body where it is drawn."""
        if body.is_ground:
            return reach
        pose = self.poses[body.name]
        return [body.drawn.position + np.einsum("tij,tnj->tni", body.drawn.rotation @ pose.rotation.transpose(0, 2, 1),
                                          e - pose.position[:, None]) for e in reach]


def half_axes(body: Body, planar: bool) -> list[float]:
    """Half-axes (m) of the uniform ellipsoid with the body's mass and inertia; in the plane the radius of a disc."""
    if body.inertia is None or not 0 < body.mass < np.inf:
        return [0.0, 0.0, 0.0]
    if planar or body.principal_plane:
        return [float(np.sqrt(2 * max(body.inertia[2, 2], 0.0) / body.mass))] * 3
    J = np.linalg.eigvalsh(body.inertia)
    return [float(np.sqrt(max(2.5 * (J.sum() - 2 * j) / body.mass, 0.0))) for j in J]


def _frame(corners: Array, planar: bool) -> list[tuple[str, Array]]:
    """A body without outline, drawn by its attachment points (n, 3) and centre of mass: a plate, or bars."""
    points = np.vstack([np.zeros((1, 3)), corners.reshape(-1, 3)])
    if len(points) < 2:
        return []
    if planar:
        outline = symbols.hull(points)
        if len(outline) > 2 and _area(outline) > 0.02 * float(np.max(np.ptp(points, axis=0))) ** 2:
            return [("plate", np.vstack([outline, outline[:1]]))]
        along = points[:, int(np.argmax(np.ptp(points, axis=0)))]
        return [("bar", points[np.argsort(along, kind="stable")])]
    return [("bar", np.array([points[0], p])) for p in points[1:]]


def _area(outline: Array) -> float:
    x, y = outline[:, 0], outline[:, 1]
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))


SLIGHT = 1e-9  #: bound below which rates (m or rad per unit of a coordinate) and sines of angles count as zero


@dataclass(frozen=True)
class Freedom:
    """Motion of l relative to k that a joint allows, as drawn: for each coordinate the velocity (3,) of l's point (m/s) and the
    angular velocity (3,) (rad/s) per unit rate; ball: whether l turns about all axes."""

    rates: dict[str, tuple[Array, Array]]
    ball: bool

    @cached_property
    def slides(self) -> list[Array]:
        """Unit vectors (3,) along which l slides, without duplicates."""
        return _directions([v for v, _ in self.rates.values()])

    @cached_property
    def turns(self) -> list[Array]:
        """Unit vectors (3,) about which l turns, without duplicates."""
        return list(np.eye(3)) if self.ball else _directions([w for _, w in self.rates.values()])

    @property
    def thread(self) -> float:
        """1 or -1 where one coordinate turns l and moves it along the same axis, right- or left-handed; else 0."""
        return next((float(np.sign(v @ w)) for v, w in self.rates.values() if abs(v @ w) > SLIGHT**2), 0.0)


def freedom(item: Connection) -> Freedom | None:
    """The motion that a joint allows; None where it states no motion."""
    law: Any = (item.as_kinematic or item.laws)[0] if item.loose else item.joint
    if not isinstance(law, Joint) or not law.states_motion():
        return None
    motion = JointMotion(item)
    ball = law.scalars().keys() != law.coordinates.keys()
    return Freedom({c: motion.rates({}, {c: 1.0})[1:] for c in law.scalars()}, ball)


def _directions(vectors: list[Array]) -> list[Array]:
    found: list[Array] = []
    for v in vectors:
        if np.linalg.norm(v) > SLIGHT and not any(np.linalg.norm(np.cross(symbols.unit(v), e)) < SLIGHT for e in found):
            found.append(symbols.unit(v))
    return found


class JointShapes(Collected):
    """Draws joints."""

    def _joint(self, item: Connection) -> None:
        free = freedom(item)
        if free is None and item.joint.freedoms() == 6:
            return  # it holds nothing, as the modes of a reduced body
        if free is None:
            self._by_rows(item, item.joint)
        else:
            self._by_motion(item, free)
        at, at_l = ends(item)
        if item.k.is_ground and (free is None or len(free.slides) in (0, 2)):
            self._ground(item.name, at)
        if item.l.is_ground:
            self._ground(item.name, at_l)

    # -- joints that state no motion, drawn by the rows they hold

    def _by_rows(self, item: Connection, law: Any) -> None:
        if isinstance(law, Distance):
            self._marked(item, "dot", item.k)
            self._marked(item, "dot", item.l)
            ways = [self._over_time(body, at) for body, at in zip((item.k, item.l), ends(item), strict=True)]
            self._add(item.name, "dashed", np.stack(ways, 1))
        else:
            self._marked(item, "pin", item.k)
            if not self.planar:
                self._add(item.name, "guide", law.at + self.mark * np.outer([-5, 5], law.axis), item.k)

    # -- joints drawn by their motion

    def _by_motion(self, item: Connection, free: Freedom) -> None:
        slides, turns = free.slides, free.turns
        if len(slides) == 1:
            self._guide(item, slides[0], free.thread)
        elif len(slides) == 2:
            self._plane(item, slides)
        elif len(slides) == 3:
            self._marked(item, "dot" if turns else "lock", item.k)
        if not (slides or turns):
            self._marked(item, "weld", item.k)
        elif len(turns) == 1:
            self._pin(item, turns[0], slides)
        elif len(turns) == 2:
            self._cross(item, turns)
        elif turns and len(slides) < 3:
            self._marked(item, "ball", item.l if slides else item.k)
        if (len(slides) in (1, 2) and not turns) or _along(turns, slides):
            box = symbols.slider(item.joint.at, slides[0], 3 * self.mark, 1.8 * self.mark, self.planar)
            self._add(item.name, "box", box, item.l)
        for c, (v, w) in free.rates.items():
            self._on_coordinate(item, c, v, w)

    def _pin(self, item: Connection, axis: Array, slides: list[Array]) -> None:
        """Draw a pin, in space with a ring about its axis; only a ring for a sleeve that turns about its guide."""
        body, at = (item.l, ends(item)[1]) if slides else (item.k, ends(item)[0])
        sleeve = _along([axis], slides)
        if not sleeve:
            self._add(item.name, "pin", np.array([at]), body)
        if not self.planar:
            size = (1.7 if sleeve else 1.2) * self.mark
            e1, e2 = (size * e for e in symbols.plane_of(axis))
            self._add(item.name, "line", symbols.circle(at, e1, e2), body)
            if not sleeve:
                self._add(item.name, "line", at + np.outer([-2.5, 2.5], self.mark * axis), body)

    def _cross(self, item: Connection, turns: list[Array]) -> None:
        """Draw two crossed pins, the first in a fork of k, the second in a fork of l."""
        at, at_l = ends(item)
        normal = symbols.unit(np.cross(turns[0], turns[1]))
        away = at - item.k.drawn.position if item.l.is_ground else item.l.drawn.position - at_l
        back = (1.0 if normal @ away < 0 else -1.0) * 1.6 * self.mark * normal
        self._add(item.name, "line", symbols.yoke(at, 1.6 * self.mark * turns[0], back), item.k)
        self._add(item.name, "line", symbols.yoke(at_l, 1.6 * self.mark * turns[1], -back), item.l)
        self._marked(item, "dot", item.k)

    def _guide(self, item: Connection, along: Array, thread: float) -> None:
        """Draw the guide of a slider on k, with a ground symbol at its start, and a thread about it."""
        low, high = self._reach(item, along)
        at = item.joint.at
        self._add(item.name, "guide", at + np.outer([low, high], along), item.k)
        if thread:
            ends_of = (at + low * along, at + high * along)
            self._add(item.name, "thin", symbols.helix(*ends_of, 0.6 * self.mark, thread * self.mark), item.k)
        if item.k.is_ground and not any(isinstance(law, JointSpring) and law.unit == "m" for law in item.laws):
            self._ground(item.name, at + low * along, self._aside(along))

    def _plane(self, item: Connection, along: list[Array]) -> None:
        """Draw the plane on k in which l slides, as large as the displacement of l."""
        (a, b), (c, d) = (self._reach(item, e) for e in along)
        corners = [x * along[0] + y * along[1] for x, y in ((a, c), (b, c), (b, d), (a, d), (a, c))]
        self._add(item.name, "guide", item.joint.at + np.array(corners), item.k)

    def _aside(self, axis: Array) -> Array:
        side = symbols.across(axis)
        return -side if side @ self.down < 0 else side

    def _reach(self, item: Connection, along: Array) -> tuple[float, float]:
        """Smallest and largest position of l along a direction fixed to k, m from the joint as drawn, and room for its symbol."""
        at = item.joint.at
        apart = self._over_time(item.l, at) - self._over_time(item.k, at)
        axis = self._over_time(item.k, at + along) - self._over_time(item.k, at)
        way = np.einsum("ti,ti->t", apart, axis)
        return float(way.min() - 2.5 * self.mark), float(way.max() + 2.5 * self.mark)

    # -- springs, drives and loads on a coordinate

    def _on_coordinate(self, item: Connection, c: str, v: Array, w: Array) -> None:
        """Draw springs on a coordinate, and a turning arrow where its angle is prescribed or a torque acts."""
        acting = [law for law in item.laws if isinstance(law, JointSpring | JointLoad) and law.name_of_coordinate == c]
        sprung = any(isinstance(law, JointSpring) for law in acting)
        at = item.joint.at
        if item.unit(c) == "m" and sprung and np.any(v):
            along = symbols.unit(v)
            anchor = at + (self._reach(item, along)[0] - 7 * self.mark) * along
            self._spring_between(item, anchor, at)
            if item.k.is_ground:
                self._ground(item.name, anchor, -along)
        if item.unit(c) != "rad" or not np.any(w):
            return
        axis = symbols.unit(w)
        if sprung:
            self._add(item.name, "thin", symbols.spiral(at, axis, 1.8 * self.mark), item.k)
        if getattr(item.prescribed.get(c), "free_symbols", None) or any(isinstance(law, JointLoad) for law in acting):
            self._add(item.name, "arrow", symbols.turning_arrow(at, axis, 2.6 * self.mark), item.k)


def _along(turns: list[Array], slides: list[Array]) -> bool:
    """Whether the only axis of rotation is also the only direction of sliding, as of a sleeve."""
    return len(turns) == len(slides) == 1 and bool(np.linalg.norm(np.cross(turns[0], slides[0])) < SLIGHT)
