"""Geometry of a scene over time, for drawings, GIFs and the player: shapes fixed to bodies, or given at every time."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np

from mbdae.results.beams import polylines
from mbdae.results.result import Result
from mbdae.scene.components import Body, Connection, Place
from mbdae.scene.shapes import Plane
from mbdae.show import symbols
from mbdae.system.model.beams import Line
from mbdae.values import Array

INK = "#222222"


@dataclass(frozen=True, eq=False)
class Outline:
    """A polyline or markers of one item. `points`, m: (1, n, 3) in axes of the named body, from its centre of mass; where `body`
    is "", in the inertial frame, (nt, n, 3), or (1, n, 3) if it does not move."""

    item: str
    kind: str  #: key of `drawing.LOOKS`
    colour: str
    points: Array
    body: str = ""
    faces: tuple[tuple[int, ...], ...] = ()  #: faces of a solid by point numbers, counter-clockwise from outside
    shades: tuple[int, ...] = ()  #: shade of each face, 0 or 1


@dataclass(frozen=True, eq=False)
class Pose:
    """Position (nt, 3), m, of the centre of mass and rotation matrix (nt, 3, 3), body to inertial."""

    position: Array
    rotation: Array


@dataclass(frozen=True, eq=False)
class Label:
    """A name and its point, m: (1, 3) in axes of the body, or (1, 3) or (nt, 3) in the inertial frame, as for an `Outline`."""

    text: str
    points: Array
    body: str
    of_body: bool


@dataclass(frozen=True, eq=False)
class Geometry:
    """Shapes and names of a scene at times t (nt,), s; `size`: extent of the scene, m."""

    name: str
    t: Array
    planar: bool
    size: float
    gravity: Array
    poses: dict[str, Pose]
    shapes: tuple[Outline, ...]
    labels: tuple[Label, ...]
    newtons: float  #: force of an arrow of 1 m, N: one scale for all forces; 0 where none is drawn

    def polyline(self, shape: Outline) -> Array:
        """Points (nt, n, 3) of a shape over time, m, inertial frame."""
        if shape.body:
            return moved(self.poses[shape.body], shape.points[0])
        return np.broadcast_to(shape.points, (len(self.t), *shape.points.shape[1:]))

    def place(self, label: Label) -> Array:
        """Positions (nt, 3), m, to which a name belongs."""
        if label.body:
            return moved(self.poses[label.body], label.points)[:, 0]
        return np.broadcast_to(label.points, (len(self.t), 3))

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest coordinates (3,), m, over all times; for a single point those of a cube of 1 m around it."""
        points: Array = np.concatenate([self.polyline(shape).reshape(-1, 3) for shape in self.shapes])
        low, high = points.min(axis=0), points.max(axis=0)
        return (low - 0.5, high + 0.5) if np.array_equal(low, high) else (low, high)


def moved(pose: Pose, local: Array) -> Array:
    """Positions (nt, n, 3), m, over time of a body's points (n, 3) given in its axes."""
    return np.asarray(pose.position[:, None] + np.einsum("tij,nj->tni", pose.rotation, local))


# -- Data from which all shapes of a result are made: poses of bodies over time, points of joints, sizes of symbols, names


MARK = 0.03  #: ratio of the size of symbols to the size of the scene
#: smallest number of straight pieces with which a beam of elements of order 2 or more is drawn; of order 1 each element is one
SMOOTH = 32


class Collected:
    """Data of one result: poses, deformed axes of beams, sizes, and the shapes and names made so far."""

    def __init__(self, result: Result, hide: Sequence[str] = ()) -> None:
        self.hidden = _hidden(result, hide)
        self.result, self.scene, self.planar = result, result.prepared.model.scene, result.prepared.model.planar
        self.poses = {name: Pose(result.read(f"{name}.position"), result.read(f"{name}.rotation"))
                      for name in (body.name for body in self.scene.bodies)}
        self.lines: dict[Body, Array] = {line.beam: polylines(result, line, _pieces(line))
                                         for line in result.prepared.model.lines}
        self.meshes = dict(_meshes(result, self.poses))  #: reduced body -> deformed lines (nt, n, 3), m
        self.attached = {b.name: self._attached(b) for b in self.scene.bodies}
        self.looks = looks_of(self.scene, self.lines)
        self.extents = {body.name: self._spanned(body) for body in self.shown(self.scene.bodies)}
        self.room, self.size = self._sizes()
        self.mark = MARK * self.size
        g = self.scene.gravity
        self.down = symbols.unit(g) if np.any(g) else np.array([0.0, -1.0, 0.0]) if self.planar else -symbols.Z
        self.shapes: list[Outline] = []
        self.forces: list[tuple[str, str, Array, Array]] = []  #: item, kind, points (nt, 3), m, and forces there (nt, 3), N
        self.labels: list[Label] = []
        self._grounded: list[Array] = []
        self.fixed: list[Any] = []  #: shapes on the ground that are already drawn
        self.colours: dict[str, str] = {}
        self.planes: list[tuple[str, Any, Body, list[str]]] = []  #: item, plane, its body, names of the bodies that touch it

    def shown(self, items: Iterable[Any]) -> list[Any]:
        """The items that are not hidden."""
        return [item for item in items if item.name not in self.hidden]

    def _attached(self, body: Body) -> Array:
        """Points (n, 3), m, of a body at which something is attached, in its own axes, without duplicates."""
        points: list[Array] = []
        for item in self.scene.connections if body not in self.lines else []:
            for side in (item.k, item.l) if not item.shapes else ():
                p = self._local(body, [ends(item)[0 if side is item.k else 1]])[0]
                if side is body and item.kind not in ("force", "torque") and not any(np.allclose(p, o) for o in points):
                    points.append(p)
        return np.array(points).reshape(-1, 3)

    def _sizes(self) -> tuple[float, float]:
        """Extent (m) of all bodies, their attachments, points of joints and shapes on the ground: as the limit for drawn bodies,
        and as the size for symbols; for a scene that is a single point no limit, and the length of the model."""
        fixed = [p for c in self.shown(self.scene.connections) if c.kind not in ("force", "torque")
                 for i, side in enumerate((c.k, c.l)) if side.is_ground
                 for p in (symbols.outline(c.shapes[i]) if c.shapes else [ends(c)[i]])]
        parts = [*(e.reshape(-1, 3) for e in self.extents.values()), *(p.reshape(-1, 3) for p in fixed), np.zeros((0, 3))]
        points = np.vstack(parts)
        extent = float(np.max(np.ptp(points, axis=0))) if len(points) else 0.0
        return (extent, extent) if extent > 1e-9 else (np.inf, self.result.prepared.model.length)

    def _spanned(self, body: Body) -> Array:
        """Points (nt, n, 3), m, whose bounding box contains a body over time."""
        if body in self.lines:
            return self.lines[body]
        if body in self.meshes:
            return np.concatenate(self.meshes[body], axis=1)
        shapes = [self._local(body, points) for one in self.looks[body.name] for points in symbols.outline(one)]
        return moved(self.poses[body.name], np.vstack([self._local(body, body.outline), self.attached[body.name], *shapes]))

    @staticmethod
    def _local(body: Body, points: Sequence[Array] | Array) -> Array:
        """Points (n, 3) as drawn, in the body's axes from its centre of mass, m."""
        return np.asarray((np.asarray(points).reshape(-1, 3) - body.drawn.position) @ body.drawn.rotation)

    def _over_time(self, body: Body, point: Array) -> Array:
        """Position over time (nt, 3), m, of a point given as drawn."""
        if body.is_ground:
            return np.broadcast_to(point, (len(self.result.t), 3))
        return moved(self.poses[body.name], self._local(body, [point]))[:, 0]

    def _on_sections(self, item: Connection) -> Connection:
        """The connection with every beam replaced by a body that moves with the section nearest to the connection's point."""
        sides = {"k": item.k, "l": item.l}
        for (side, body), at in zip(sides.items(), ends(item), strict=True):
            if body in self.lines:
                place = self.result[Place(body, item.places.get(side, at))]
                sides[side] = Body(f"{body.name} at {side} of {item.name}", 0.0, None, place.drawn_position, place.drawn_rotation,
                                   np.zeros(3), np.zeros(3))
                self.poses[sides[side].name] = Pose(place.position, place.rotation)
                arm = np.stack([place.on_axis, self._over_time(sides[side], at)], axis=1)
                if np.linalg.norm(arm[0, 1] - arm[0, 0]) > 0.3 * self.mark:
                    self._add(item.name, "line", arm)
        return replace(item, **sides)

    def _add(self, item: str, kind: str, points: Array, body: Body | None = None, colour: str = INK) -> None:
        """Add a shape: points (n, 3), m, as drawn on a body, or (nt, n, 3) in the inertial frame."""
        if body is None or body.is_ground:
            self.shapes.append(Outline(item, kind, colour, points if points.ndim == 3 else points[None]))
        else:
            self.shapes.append(Outline(item, kind, colour, self._local(body, points)[None], body.name))

    def _name(self, text: str, body: Body, point: Array, of_body: bool = False) -> None:
        on = "" if body.is_ground else body.name
        self.labels.append(Label(text, self._local(body, [point]) if on else point.reshape(-1, 3), on, of_body))

    def _marked(self, item: Connection, kind: str, body: Body) -> None:
        """Draw a marker at the joint's point on a body."""
        self._add(item.name, kind, np.array([ends(item)[1 if body is item.l else 0]]), body)

    def _ground(self, item: str, point: Array, down: Array | None = None) -> None:
        """Draw the ground symbol under a point, unless one is there already."""
        if any(np.linalg.norm(point - p) < self.mark for p in self._grounded):
            return
        self._grounded.append(point)
        direction = self.down if down is None else down
        self._add(item, "ground", symbols.hatching(point, direction, 1.5 * self.mark, down is None))

    def _spring_between(self, item: Connection, k: Array, l: Array) -> None:
        a, b = self._over_time(item.k, k), self._over_time(item.l, l)
        self._add(item.name, "thin", symbols.zigzag(a, b, 0.7 * self.mark))

    def _gather(self) -> None:
        """Join the names at one point into one text, such as those of joints that share a pin."""
        groups: dict[tuple[Any, ...], list[Label]] = {}
        for label in self.labels:
            where = tuple(np.round(self.place_of(label) / (0.5 * self.mark)).astype(int))
            groups.setdefault((label.of_body, *where), []).append(label)
        merged = ([Label(", ".join(dict.fromkeys(x.text for x in group)), group[0].points, group[0].body, group[0].of_body)]
                  for group in groups.values())
        self.labels = list(chain.from_iterable(merged))

    def place_of(self, label: Label) -> Array:
        """Position (3,), m, of a name at the first time."""
        return moved(self.poses[label.body], label.points)[0, 0] if label.body else np.asarray(label.points[0])


def looks_of(scene: Any, lines: Container[Body]) -> dict[str, list[Any]]:
    """Shapes of every rigid body by its name: those stated for it, else those by which it touches others, without duplicates.
    lines: the beams, which are drawn otherwise."""
    found: dict[str, list[Any]] = {b.name: list(b.shapes or ()) for b in scene.bodies}
    touching = [(body, one) for item in scene.connections if item.shapes
                for body, one in zip((item.k, item.l), item.shapes, strict=True)]
    for body, one in touching:
        drawn_otherwise = body.is_ground or body in lines or body.shapes is not None or isinstance(one, Plane)
        if not drawn_otherwise and not any(symbols.same(one, other) for other in found[body.name]):
            found[body.name].append(one)
    return found


def _hidden(result: Result, hide: Sequence[str]) -> set[str]:
    """Names of items to leave out; SceneError where there is no such item."""
    for name in hide:
        _ = result.prepared.model.scene[name]
    # what carries the modes and the inertia of a reduced body, and ties its interfaces to it, is no part of the machine
    own = [c for c in result.prepared.model.scene.connections if c.kind in ("reduced body", "inertia", "interface")]
    return {*hide, *(c.name for c in own), *(c.l.name for c in own if c.kind == "inertia")}


def _meshes(result: Result, poses: Mapping[str, Pose]) -> Iterator[tuple[Body, list[Array]]]:
    """Every reduced body with the deformed lines (nt, n, 3), m, along the edges of its mesh."""
    for item in result.prepared.model.scene.connections:
        body = getattr(item.joint, "reduced", None)
        if body is not None and len(body.edges):
            used, ends_of = np.unique(body.edges.astype(int), return_inverse=True)
            local = body.displacement(result[item.name], used)[..., :3] + body.nodes[used] - body.center
            pose = poses[item.k.name]
            points = pose.position[:, None] + np.einsum("tij,tnj->tni", pose.rotation, local)
            yield item.k, [points[:, trail] for trail in _trails(ends_of.reshape(-1, 2))]


def _trails(edges: Any) -> Iterator[list[int]]:
    """Edges (e, 2) joined to lines, each edge in one of them."""
    joined: dict[int, set[int]] = {}
    for a, b in edges.tolist():
        joined.setdefault(a, set()).add(b)
        joined.setdefault(b, set()).add(a)
    for start in sorted(joined, key=lambda node: (len(joined[node]) % 2 == 0, node)):
        while joined[start]:
            trail = [start]
            while joined[trail[-1]]:
                here = trail[-1]
                trail.append(joined[here].pop())
                joined[trail[-1]].discard(here)
            yield trail


def ends(item: Connection) -> tuple[Array, Array]:
    """Points (3,) on k and on l that a connection joins, as drawn, m."""
    return item.joint.point_on("k"), item.joint.point_on("l")


def _pieces(line: Line) -> int:
    """Number of straight pieces per element with which a beam is drawn."""
    return 1 if line.mesh.order == 1 else max(2, -(-SMOOTH // len(line.mesh.elements)))
