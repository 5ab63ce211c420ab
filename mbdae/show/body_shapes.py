"""Shapes with which bodies are drawn.

A body is drawn by the shapes stated for it; without any by its outline and the shapes by which it touches others; else by lines
from its centre of mass to the points where something is attached, and by the ellipsoid of its mass and inertia.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.scene import shapes as solid
from mbdae.scene.components import Array, Body, Connection
from mbdae.show import solids, symbols
from mbdae.show.collected import Collected
from mbdae.show.geometry import INK, Label, Shape

GREY = "#8a8a8a"  #: colour of shapes fixed to the ground
#: smallest ratio that is drawn: of the distance of a connected point from its body's origin, and of an ellipsoid of inertia (a
#: box where it is smaller), to the size of the scene; and of the axes of a ring of that ellipsoid to its longest axis
TINY = 0.02


class BodyShapes(Collected):
    """Draws bodies and the shapes of contacts."""

    def _body(self, body: Body, colour: str) -> None:
        self.colours[body.name] = colour
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
            self.shapes.append(Shape(body.name, kind, colour if kind != "centre" else INK, points[None], body.name))
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
                 if min(axes[i], axes[j]) > TINY * max(axes)]  # fmt: skip
        kind = "disc" if len(rings) == 1 else "ring"
        return [(kind, ring) for ring in rings] + [("line", np.array([-v, v])) for v in e]

    # -- shapes

    def _solid(self, item: str, one: Any, body: Body, colour: str) -> Any:
        """Draw a shape fixed to a body; planes are drawn later, when it is known how far they must reach."""
        if isinstance(one, solid.Plane):
            self.planes.append((item, one, body, []))
            return one
        for part in solids.drawn(one, self.planar, self.size):
            points = part.points if body.is_ground else self._local(body, part.points)
            self.shapes.append(Shape(item, part.kind, colour, points[None], "" if body.is_ground else body.name, part.faces,
                                     part.shades))  # fmt: skip
        return one

    def _contact(self, item: Connection) -> None:
        """Draw those shapes of a contact that the drawing of the bodies lacks: shapes on the ground and on beams, and planes. A
        shape on the ground gets the name of the contact."""
        first, second = item.shapes
        one: Any
        for body, other, one in ((item.k, item.l, first), (item.l, item.k, second)):
            if isinstance(one, solid.Plane):
                known = next((p for p in self.planes if p[2] is body and solids.same(p[1], one)), None)
                if known is None and (body.is_ground or body.shapes is None):
                    known = (item.name, one, body, [])
                    self.planes.append(known)
                if known is not None:
                    known[3].append(other.name)
            elif body.is_ground and not any(solids.same(one, o) for o in self.fixed):
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
                    [e for name, e in self.extents.items() if name != body.name]  # fmt: skip
            reach = [*self._seen_from(body, reach), *(fixed if body.is_ground else ())]
            points = [np.zeros((0, 3)), *(e.reshape(-1, 3) for e in reach)]
            part = solids.plane(one, np.concatenate(points), self.size, self.planar)
            self._add(item, part.kind, part.points, body, GREY if body.is_ground else self.colours.get(body.name, INK))

    def _seen_from(self, body: Body, reach: list[Array]) -> list[Array]:
        """Points over time (nt, n, 3), m, as seen from a moving body, in the inertial frame with this body where it is drawn."""
        if body.is_ground:
            return reach
        pose = self.poses[body.name]
        return [body.drawn.position + np.einsum("tij,tnj->tni", body.drawn.rotation @ pose.rotation.transpose(0, 2, 1),
                                          e - pose.position[:, None]) for e in reach]  # fmt: skip


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
