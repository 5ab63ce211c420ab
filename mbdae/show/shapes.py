"""The geometry of a result: shapes of bodies, joints and forces.

A body is drawn by its outline; without one by lines from its centre of mass to the points where something is attached, and in
space by the ellipsoid of its mass and inertia. Rigid bodies move by position and rotation, beams by the interpolation of their
elements; what is attached to a beam moves with the section there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np

from mbdae.inputs import timed
from mbdae.results.beams import polylines
from mbdae.results.result import Result
from mbdae.scene.components import Array, BeamLoad, Body, Connection, Place
from mbdae.show import symbols
from mbdae.show.geometry import INK, Geometry, Label, Pose, Shape, moved
from mbdae.show.plots import COLOURS
from mbdae.system.model.beams import Line

MARK = 0.03  #: size of symbols over the size of the scene
ARROWS = 9  #: number of arrows of a distributed load
SMOOTH = 32  #: least number of chords of a beam
MARKERS = {"revolute": "pin", "spherical": "ball", "weld": "weld", "fixedorientation": "lock", "distance": "dot",
           "bushing": "dot"}  # fmt: skip
#: kinds without a marker at their point
UNMARKED = ("prismatic", "force", "torque", "spring", "pointspring")


def geometry(result: Result) -> Geometry:
    """Shapes and names of a result at its times."""
    return _Builder(result).build()


class _Collected:
    """What is collected of one result: poses, deformed axes of beams, sizes, and the shapes and names made so far."""

    def __init__(self, result: Result) -> None:
        self.result, self.scene, self.planar = result, result.prepared.model.scene, result.prepared.model.planar
        self.poses = {name: Pose(result.read(f"{name}.position"), result.read(f"{name}.rotation"))
                      for name in (body.name for body in self.scene.bodies)}  # fmt: skip
        self.lines: dict[Body, Array] = {line.beam: polylines(result, line, _pieces(line))
                                         for line in result.prepared.model.lines}  # fmt: skip
        self.attached = {b.name: self._attached(b) for b in self.scene.bodies}
        self.size = self._size()
        self.mark = MARK * self.size
        g = self.scene.gravity
        self.down = symbols.unit(g) if np.any(g) else np.array([0.0, -1.0, 0.0]) if self.planar else -symbols.Z
        self.shapes: list[Shape] = []
        self.labels: list[Label] = []
        self._grounded: list[Array] = []

    def _attached(self, body: Body) -> Array:
        """Points (n, 3) of a body at which something is attached, in its own axes, each once."""
        points: list[Array] = []
        for item in self.scene.connections if body not in self.lines else []:
            for side in (item.k, item.l):
                p = self._local(body, [ends(item)[0 if side is item.k else 1]])[0]
                if side is body and item.kind not in ("force", "torque") and not any(np.allclose(p, o) for o in points):
                    points.append(p)
        return np.array(points).reshape(-1, 3)

    def _size(self) -> float:
        """Largest extent (m) of all bodies, their attachments, and the points of joints on the ground."""
        parts = [moved(self.poses[b.name], np.vstack([self._local(b, b.outline), self.attached[b.name]]))
                 for b in self.scene.bodies if b not in self.lines]  # fmt: skip
        parts += list(self.lines.values())
        fixed = [p for c in self.scene.connections for side, p in zip((c.k, c.l), ends(c), strict=True)
                 if side.is_ground and c.kind not in ("force", "torque")]  # fmt: skip
        extent = float(np.max(np.ptp(np.vstack([*(p.reshape(-1, 3) for p in parts), *fixed]), axis=0)))
        return extent if extent > 1e-9 else self.result.prepared.model.length

    @staticmethod
    def _local(body: Body, points: Sequence[Array] | Array) -> Array:
        """Points (n, 3) given as drawn, in the body's axes from its centre of mass."""
        return np.asarray((np.asarray(points).reshape(-1, 3) - body.position) @ body.rotation)

    def _over_time(self, body: Body, point: Array) -> Array:
        """(nt, 3) of a point given as drawn."""
        if body.is_ground:
            return np.broadcast_to(point, (len(self.result.t), 3))
        return moved(self.poses[body.name], self._local(body, [point]))[:, 0]

    def _on_sections(self, item: Connection) -> Connection:
        """The item with a body in place of every beam: one that moves with the section nearest to the item's point as drawn."""
        sides = {"k": item.k, "l": item.l}
        for (side, body), at in zip(sides.items(), ends(item), strict=True):
            if body in self.lines:
                place = self.result[Place(body, item.places.get(side, at))]
                sides[side] = Body(f"{body.name} at {side} of {item.name}", 0.0, None, place.drawn_position, place.drawn_rotation,
                                   np.zeros(3), np.zeros(3))  # fmt: skip
                self.poses[sides[side].name] = Pose(place.position, place.rotation)
                arm = np.stack([place.on_axis, self._over_time(sides[side], at)], axis=1)
                if np.linalg.norm(arm[0, 1] - arm[0, 0]) > 0.3 * self.mark:
                    self._add(item.name, "line", arm)
        return replace(item, **sides)

    def _add(self, item: str, kind: str, points: Array, body: Body | None = None, colour: str = INK) -> None:
        """A shape by points (n, 3) as drawn on a body, or (nt, n, 3) in the inertial frame."""
        if body is None or body.is_ground:
            self.shapes.append(Shape(item, kind, colour, points if points.ndim == 3 else points[None]))
        else:
            self.shapes.append(Shape(item, kind, colour, self._local(body, points)[None], body.name))

    def _name(self, text: str, body: Body, point: Array, of_body: bool = False) -> None:
        on = "" if body.is_ground else body.name
        self.labels.append(Label(text, self._local(body, [point]) if on else point.reshape(-1, 3), on, of_body))

    def _gather(self) -> None:
        """Join the names at one point to one text, such as those of joints that share a pin."""
        groups: dict[tuple[Any, ...], list[Label]] = {}
        for label in self.labels:
            where = tuple(np.round(self.place_of(label) / (0.5 * self.mark)).astype(int))
            groups.setdefault((label.of_body, *where), []).append(label)
        merged = ([Label(", ".join(dict.fromkeys(x.text for x in group)), group[0].points, group[0].body, group[0].of_body)]
                  for group in groups.values())  # fmt: skip
        self.labels = list(chain.from_iterable(merged))

    def place_of(self, label: Label) -> Array:
        """Point (3,), m, of a name at the first time."""
        return moved(self.poses[label.body], label.points)[0, 0] if label.body else np.asarray(label.points[0])


class _Builder(_Collected):
    """Draws bodies, joints and forces."""

    def build(self) -> Geometry:
        for i, body in enumerate(self.scene.bodies):
            self._body(body, COLOURS[i % (len(COLOURS) - 1)])
        for item in self.scene.connections:
            self._connection(self._on_sections(item))
        for load in self.scene.line_loads:
            self._distributed(load)
        self._gather()
        found = (tuple(self.shapes), tuple(self.labels))
        return Geometry(self.scene.name, self.result.t, self.planar, self.size, self.scene.gravity, self.poses, *found)

    # -- bodies

    def _body(self, body: Body, colour: str) -> None:
        if body.is_point:
            self._add(body.name, "mass", body.position[None], body, colour)
            return self._name(body.name, body, body.position, True)
        if body in self.lines:
            points = self.lines[body]
            self._add(body.name, "bar", points, colour=colour)
            return self._name(body.name, self.scene.ground, points[:, points.shape[1] // 2], True)
        if len(body.outline) > 1:
            self._add(body.name, "bar", body.outline, body, colour)
            return self._name(body.name, body, body.at(0.5).point, True)
        local = self.attached[body.name]
        corners = [p for p in local if np.linalg.norm(p) > 0.02 * self.size]
        parts = [*_frame(np.array(corners), self.planar), *self._extent(body, bool(corners)), ("centre", np.zeros((1, 3)))]
        for kind, points in parts:
            self.shapes.append(Shape(body.name, kind, colour if kind != "centre" else INK, points[None], body.name))
        anchor = np.mean([np.zeros(3), *corners], axis=0) if corners else np.zeros(3)
        self.labels.append(Label(body.name, anchor[None], body.name, True))
        return None

    def _extent(self, body: Body, framed: bool) -> list[tuple[str, Array]]:
        """The body's ellipsoid; in the plane a disc, unless it is drawn as a plate or bars (framed); a box where it is tiny."""
        axes = half_axes(body, self.planar)
        if self.planar and framed:
            return []
        if max(axes) < 0.02 * self.size:
            edge = 2.4 * self.mark
            return [] if framed else [("box", symbols.slider(np.zeros(3), np.array([1.0, 0, 0]), edge, edge, self.planar))]
        _, directions = np.linalg.eigh(body.inertia if body.inertia is not None else np.eye(3))
        e = [a * d for a, d in zip(axes, directions.T, strict=True)]
        if self.planar:
            x, y = axes[0] * np.eye(3)[:2]
            return [("disc", symbols.circle(np.zeros(3), x, y)), ("line", np.array([np.zeros(3), x]))]
        rings = [symbols.circle(np.zeros(3), e[i], e[j]) for i, j in ((0, 1), (1, 2), (2, 0))
                 if min(axes[i], axes[j]) > 0.02 * max(axes)]  # fmt: skip
        kind = "disc" if len(rings) == 1 else "ring"
        return [(kind, ring) for ring in rings] + [("line", np.array([-v, v])) for v in e]

    # -- joints and forces

    def _connection(self, item: Connection) -> None:
        law: Any = item.joint
        at, at_l = ends(item)
        if item.kind in MARKERS or item.kind not in UNMARKED:
            self._add(item.name, MARKERS.get(item.kind, "pin"), np.array([at]), item.k)
        draw = {"revolute": self._revolute, "prismatic": self._prismatic, "spring": self._spring, "pointspring": self._spring,
                "distance": self._distance, "bushing": self._bushing, "force": self._load, "torque": self._load}  # fmt: skip
        draw.get(item.kind, self._other)(item, law)
        if item.k.is_ground and item.kind not in ("force", "torque", "bushing", "fixedorientation", "prismatic"):
            self._ground(item.name, at)
        if item.l.is_ground:
            self._ground(item.name, at_l)
        if np.linalg.norm(at_l - at) > self.mark:
            middle = (self._over_time(item.k, at) + self._over_time(item.l, at_l)) / 2
            return self._name(item.name, self.scene.ground, middle)
        return self._name(item.name, item.l, at_l)

    def _ground(self, item: str, point: Array, down: Array | None = None) -> None:
        """Draw the symbol of the ground under a point, unless there is one."""
        if any(np.linalg.norm(point - p) < self.mark for p in self._grounded):
            return
        self._grounded.append(point)
        direction = self.down if down is None else down
        self._add(item, "ground", symbols.hatching(point, direction, 1.5 * self.mark, down is None))

    def _revolute(self, item: Connection, law: Any) -> None:
        if not self.planar:
            e1, e2 = (1.2 * self.mark * e for e in symbols.plane_of(law.axis))
            self._add(item.name, "line", symbols.circle(law.at, e1, e2), item.k)
            self._add(item.name, "line", law.at + np.outer([-2.5, 2.5], self.mark * law.axis), item.k)
        if any(type(extra).__name__ == "JointSpring" for extra in item.laws):
            self._add(item.name, "thin", symbols.spiral(law.at, law.axis, 1.8 * self.mark), item.k)
        self._driven(item, law)

    def _driven(self, item: Connection, law: Any) -> None:
        """A turning arrow where the angle is prescribed or a torque acts."""
        turned = getattr(item.prescribed, "free_symbols", None) or any(type(x).__name__ == "JointTorque" for x in item.laws)
        if turned:
            self._add(item.name, "arrow", symbols.turning_arrow(law.at, law.axis, 2.6 * self.mark), item.k)

    def _prismatic(self, item: Connection, law: Any) -> None:
        travel = self._travel(item, law)
        reach = np.array([travel.min() - 2.5 * self.mark, travel.max() + 2.5 * self.mark])
        self._add(item.name, "guide", law.at + np.outer(reach, law.axis), item.k)
        self._add(item.name, "box", symbols.slider(law.at, law.axis, 3 * self.mark, 1.8 * self.mark, self.planar), item.l)
        spring = any(type(extra).__name__ == "JointSpring" for extra in item.laws)
        anchor = law.at + (reach[0] - (7 * self.mark if spring else 0)) * law.axis
        if spring:
            self._spring_between(item, anchor, law.at)
        if item.k.is_ground:
            self._ground(item.name, anchor, -law.axis if spring else self._aside(law.axis))

    def _aside(self, axis: Array) -> Array:
        side = symbols.across(axis)
        return -side if side @ self.down < 0 else side

    def _travel(self, item: Connection, law: Any) -> Array:
        """Displacement (nt,) of l along the axis, m."""
        apart = self._over_time(item.l, law.at) - self._over_time(item.k, law.at)
        along = self._over_time(item.k, law.at + law.axis) - self._over_time(item.k, law.at)
        return np.asarray(np.einsum("ti,ti->t", apart, along))

    def _spring_between(self, item: Connection, k: Array, l: Array) -> None:
        a, b = self._over_time(item.k, k), self._over_time(item.l, l)
        self._add(item.name, "thin", symbols.zigzag(a, b, 0.7 * self.mark))

    def _spring(self, item: Connection, law: Any) -> None:
        self._spring_between(item, law.at, law.at_l)

    def _distance(self, item: Connection, law: Any) -> None:
        self._add(item.name, "dot", np.array([law.at_l]), item.l)
        self._add(item.name, "dashed", np.stack([self._over_time(item.k, law.at), self._over_time(item.l, law.at_l)], 1))

    def _bushing(self, item: Connection, law: Any) -> None:
        """A spring along every elastic axis of k."""
        for i, stiffness in enumerate("xyz"):
            if not getattr(law, f"k{stiffness}", None):
                continue
            axis = item.k.rotation[:, i]
            axis = -axis if axis @ self.down < -0.5 else axis * (1 if axis @ self.down > 0.5 else -1)
            anchor = law.at + 6 * self.mark * axis
            self._spring_between(item, anchor, law.at)
            if item.k.is_ground:
                self._ground(item.name, anchor, axis)

    def _other(self, item: Connection, law: Any) -> None:
        if item.is_joint and not self.planar and item.kind not in MARKERS:
            self._add(item.name, "guide", law.at + np.outer([-5, 5], self.mark * law.axis), item.k)

    def _load(self, item: Connection, law: Any) -> None:
        values = self.result.read(f"{item.name}.{item.kind}")
        share = np.linalg.norm(values, axis=1) / (np.max(np.linalg.norm(values, axis=1)) or 1.0)
        at, lines = self._over_time(item.l, law.at), []
        for p, value, s in zip(at, values, share, strict=True):
            reach = symbols.unit(value) * s
            if item.kind == "force":
                lines.append(symbols.arrow(p, p + 6 * self.mark * reach, 1.5 * self.mark))
            else:
                lines.append(symbols.turning_arrow(p, reach if np.any(reach) else symbols.Z, 2.6 * self.mark * s**0.5))
        self._add(item.name, "arrow", np.array(lines))

    def _distributed(self, load: BeamLoad) -> None:
        """A row of arrows along the beam, as long as the load is large, joined at their tails."""
        t = self.result.t
        parts = [getattr(load.law, f"f{i}") or 0.0 for i in (1, 2, 3)]
        values = np.stack([timed.values(timed.expression(part), t) for part in parts], axis=1)
        largest = np.max(np.linalg.norm(values, axis=1)) or 1.0
        places = [self.result[load.beam.at(s)] for s in np.linspace(0.0, 1.0, ARROWS)]
        lines = []
        for k in range(len(t)):
            row = []
            for place in places:
                f = place.rotation[k] @ values[k] if load.law.following else values[k]
                tip = place.position[k]
                row.append(symbols.arrow(tip - 4 * self.mark * f / largest, tip, 0.8 * self.mark))
            back = [arrow[[0, 1, 2, 1, 4, 1, 0]] for arrow in row]
            lines.append(np.concatenate(back))
        self._add(load.name, "thin", np.array(lines))
        middle = np.array(lines)[:, 7 * (ARROWS // 2)]
        self._name(load.name, self.scene.ground, middle)


def ends(item: Connection) -> tuple[Array, Array]:
    """Points (3,) of k and of l a connection attaches to, as drawn, m."""
    return item.joint.point_on("k"), item.joint.point_on("l")


def _pieces(line: Line) -> int:
    """Number of chords per element with which a beam is drawn."""
    return 1 if line.mesh.order == 1 else max(2, -(-SMOOTH // len(line.mesh.elements)))


def half_axes(body: Body, planar: bool) -> list[float]:
    """Half-axes (m) of the uniform ellipsoid with the body's mass and inertia; in the plane the radius of a disc."""
    if body.inertia is None or not 0 < body.mass < np.inf:
        return [0.0, 0.0, 0.0]
    if planar or body.principal_plane:
        return [float(np.sqrt(2 * max(body.inertia[2, 2], 0.0) / body.mass))] * 3
    J = np.linalg.eigvalsh(body.inertia)
    return [float(np.sqrt(max(2.5 * (J.sum() - 2 * j) / body.mass, 0.0))) for j in J]


def _frame(corners: Array, planar: bool) -> list[tuple[str, Array]]:
    """A body without outline by its attachments (n, 3) and its centre of mass: a plate, or bars."""
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
