"""The geometry of a result: shapes of bodies, joints and forces.

A body is drawn by its outline; without one by lines from its centre of mass to the points where something is attached, and in
space by the ellipsoid of its mass and inertia. Rigid bodies move by position and rotation, beams by the interpolation of their
elements; what is attached to a beam moves with the section there. Joints are drawn by the motion they leave (`joint_shapes.py`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.inputs import timed
from mbdae.results.result import Result
from mbdae.scene.components import Array, BeamLoad, Body, Connection, Place
from mbdae.show import symbols
from mbdae.show.collected import ends
from mbdae.show.geometry import INK, Geometry, Label, Shape
from mbdae.show.joint_shapes import JointShapes
from mbdae.show.plots import COLOURS
from mbdae.symbolic.coupling import Coupling

ARROWS = 9  #: number of arrows of a distributed load
UNMARKED = ("force", "torque", "spring", "pointspring")  #: forces without a marker at their point


def geometry(result: Result) -> Geometry:
    """Shapes and names of a result at its times."""
    return _Builder(result).build()


class _Builder(JointShapes):
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
            self._add(body.name, "mass", body.drawn.position[None], body, colour)
            return self._name(body.name, body, body.drawn.position, True)
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

    # -- forces and couplings

    def _connection(self, item: Connection) -> None:
        at, at_l = ends(item)
        if isinstance(item.joint, Coupling):
            self._coupling(item, item.joint)
        elif item.is_joint:
            self._joint(item)
        else:
            self._force(item, item.joint)
        if np.linalg.norm(at_l - at) > self.mark:
            middle = (self._over_time(item.k, at) + self._over_time(item.l, at_l)) / 2
            return self._name(item.name, self.scene.ground, middle)
        return self._name(item.name, item.l, at_l)

    def _force(self, item: Connection, law: Any) -> None:
        at, at_l = ends(item)
        if item.kind not in UNMARKED:
            self._marked(item, "dot" if item.kind == "bushing" else "pin", item.k)
        draw = {"spring": self._spring, "pointspring": self._spring, "bushing": self._bushing, "force": self._load,
                "torque": self._load}  # fmt: skip
        if item.kind in draw:
            draw[item.kind](item, law)
        if item.k.is_ground and item.kind not in ("force", "torque", "bushing"):
            self._ground(item.name, at)
        if item.l.is_ground:
            self._ground(item.name, at_l)

    def _coupling(self, item: Connection, law: Coupling) -> None:
        """A dashed line through the joints whose coordinates it couples, a dashed ring where they are at one point."""
        joints = [self.scene[joint] for joint, _ in law.coordinates_in(item.name)]
        path = np.stack([self._place_of(joint) for joint in joints], axis=1)
        if np.max(np.ptp(path[0], axis=0)) < self.mark:
            e1, e2 = (2 * self.mark * e for e in symbols.plane_of(law.axis))
            path = path[:, :1] + symbols.circle(np.zeros(3), e1, e2)
        self._add(item.name, "dashed", path)

    def _place_of(self, joint: Connection) -> Array:
        """(nt, 3), m, of a joint's point on l."""
        at = ends(joint)[1]
        return self.result[Place(joint.l, at)].position if joint.l in self.lines else self._over_time(joint.l, at)

    def _spring(self, item: Connection, law: Any) -> None:
        self._spring_between(item, law.at, law.at_l)

    def _bushing(self, item: Connection, law: Any) -> None:
        """A spring along every elastic axis of k."""
        for i, stiffness in enumerate("xyz"):
            if not getattr(law, f"k{stiffness}", None):
                continue
            axis = item.k.drawn.rotation[:, i]
            axis = -axis if axis @ self.down < -0.5 else axis * (1 if axis @ self.down > 0.5 else -1)
            anchor = law.at + 6 * self.mark * axis
            self._spring_between(item, anchor, law.at)
            if item.k.is_ground:
                self._ground(item.name, anchor, axis)

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
