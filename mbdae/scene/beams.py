"""Statements about flexible beams."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mbdae.deferred import later
from mbdae.errors import MbdaeError, OptionError
from mbdae.inputs.reduced import ReducedBody
from mbdae.laws.bodies import (
    ORDERS,
    InertiaPoint,
    InterfaceOfBody,
    ModalElasticity,
    SecondDisplacement,
    modes_of_body,
    with_modes,
)
from mbdae.notation import counted
from mbdae.scene import reading
from mbdae.scene.components import Beam, BeamLoad, Body, Classical, Connection
from mbdae.scene.reading import Argument, reads
from mbdae.scene.record import SceneItems, statement
from mbdae.scene.shapes import Section
from mbdae.values import Array, fixed, nearest, several, shown

if TYPE_CHECKING:
    from mbdae.laws.beam import LineLoad, node_positions
    from mbdae.laws.line_mesh import LineMesh, arc, curved, polyline
else:
    LineLoad, node_positions = later("mbdae.laws.beam", "LineLoad", "node_positions")
    arc, curved, polyline = later("mbdae.laws.line_mesh", "arc", "curved", "polyline")

#: points, m, and section used in place of wrong ones, so that the other arguments are checked too
HARMLESS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
HARMLESS_SECTION = Section(1, 1, 1, 1, 1, 1, 1, 1)
FOLDED = 1e-6  #: rad, a beam with a corner that differs by less from half a turn is refused: the line folds back on itself
TURNED = 0.9 * np.pi  #: rad, largest rotation between neighbouring nodes of a curve; a beam with a larger one is refused
#: number of pieces of a curve, by which it is drawn, its rotation between nodes is estimated, and the place nearest to a point is
#: first sought; also number of elements used in place of a wrong one
SAMPLES = 64


def _curve(arg: Argument, value: Any) -> Any:
    """Reader of the curve of a beam: a function, or the word "arc"."""
    if callable(value) or (isinstance(value, str) and value == "arc"):
        return value
    arg.wrong(f"{shown(value)} is no curve", "give 'arc' and three points, or a function of a parameter from 0 to 1")
    return None


def _ratios(arg: Argument, value: Any) -> Any:
    """Reader of a ratio of damping, or of a tuple of them."""
    read = reading.quantity("1", "not negative")
    return tuple(read(arg, ratio) for ratio in value) if several(value) else read(arg, value)


def _beam(arg: Argument, value: Any) -> Any:
    """Reader of a beam of the scene, given by itself or its name."""
    before, found = len(arg.scene.problems), reading.body(arg, value)
    if not isinstance(found, Beam) and len(arg.scene.problems) == before:
        arg.wrong(f"{shown(found.name)} is not a beam of this scene", "give a beam, or use s.force for a rigid body")
    return found


class BeamStatements(SceneItems):
    """`beam` and its distributed loads."""

    @reads(name=reading.name, points=reading.point, section=reading.instance(Section, "cross-section", "give mb.Section(...)"),
           elements=reading.counts, order=reading.integer(min(ORDERS), max(ORDERS)), curve=_curve, axis2=reading.direction,
           velocity=reading.vector("m/s"), angular_velocity=reading.vector("rad/s"))
    @statement
    def beam(self, name: str, *points: Any, section: Any, elements: Any = 4, order: int = 2, curve: Any = None, axis2: Any = None,
             velocity: Any = None, angular_velocity: Any = None) -> Beam:
        """A flexible beam through `points` (m; corners are rigid) with a `section` (mb.Section), in `elements` of an `order` from
        1 to 4: a number per segment, or one number spread by length.

        curve: "arc" for the circular arc through three points, or a function of a parameter from 0 to 1 that returns a point
        (no points then). axis2: direction of section axis 2; by default it lies in the plane of the beam. velocity (m/s, of
        the centre) and angular_velocity (rad/s) of its start as a rigid body, inertial frame."""
        outline, function = self._line(name, points, curve)
        section = section if section is not None else HARMLESS_SECTION
        if section.rigid:
            self.problems.append(f"beam '{name}': section.{section.rigid[0]} is infinite, and a beam needs finite stiffnesses; "
                                 f"give a large value, such as 1e4 times that of a real cross-section")
            section = HARMLESS_SECTION
        v, w = (np.zeros(3) if given is None else given for given in (velocity, angular_velocity))
        if elements is None:
            elements = len(outline) - 1 if function is None else SAMPLES
        lengths = np.linalg.norm(np.diff(outline, axis=0), axis=1)
        center = lengths @ (outline[1:] + outline[:-1]) / (2 * lengths.sum())
        body = Beam(name, section.mass_per_length * float(lengths.sum()), None, center, np.eye(3), v, w,
                    given_velocity=bool(np.any(v) or np.any(w)), outline=outline, section=section, elements=elements,
                    order=order, curve=function, axis2=axis2, scene=self)
        self._check_mesh(body)
        if body.curve is not None:
            mesh = mesh_of(body)
            body.mass = section.mass_per_length * mesh.length
            centre = np.einsum("ma,mai->i", mesh.lumped, mesh.curve) / mesh.length
            body.drawn = replace(body.drawn, position=fixed(centre))
        self._add_body(body)
        return body

    def _check_mesh(self, beam: Beam) -> None:
        """Report every reason why a beam has no mesh; wrong values are replaced, so that the others are checked too."""
        for _ in range(3):
            try:
                mesh_of(beam)
                return
            except MbdaeError as error:
                if (problem := f"beam '{beam.name}': {error}") in self.problems:
                    return
                self.problems.append(problem)
                option = str(error).split(" ", 1)[0]
                if option == "elements":
                    beam.elements = len(beam.outline) - 1 if beam.curve is None else SAMPLES
                else:
                    beam.axis2, beam.curve = None, beam.curve if option == "axis2" else None

    def _line(self, name: str, points: Any, curve: Any) -> tuple[Array, Any]:
        """Outline (k, 3), m, and the curve; None in its place for a polyline."""
        outline, head = np.array(points).reshape(-1, 3), Argument(self, f"beam '{name}'", "curve")
        if isinstance(curve, str):  # it is "arc", the only word that is accepted
            if len(outline) == 3:
                try:
                    return self._sampled(head, arc(*outline))
                except OptionError as error:
                    self.problems.append(f"beam '{name}': {error}")
            else:
                head.wrong(f"'arc' with {counted(len(outline), 'point')}", "give three points")
        elif curve is not None:
            if len(points):
                head.wrong(f"{shown(curve)} with {counted(len(outline), 'point')}",
                           "leave the points out, the curve gives them all")
            return self._sampled(head, curve)
        if len(outline) < 2 or not np.all(np.linalg.norm(np.diff(outline, axis=0), axis=1) > 0):
            self.problems.append(f"beam '{name}': needs at least two points, each different from the one before")
            outline = HARMLESS
        return outline, None

    def _sampled(self, head: Argument, curve: Any) -> tuple[Array, Any]:
        """Points (k, 3) of a curve and the curve itself; a straight line without curve where it cannot be evaluated."""
        points: list[Array] = []
        for s in np.linspace(0, 1, SAMPLES + 1):
            before = len(self.problems)
            try:
                points.append(np.asarray(reading.point(head.part(f"curve({s:g})"), curve(s))))
            except Exception as error:  # a function of the user's own may raise anything
                head.wrong(f"{shown(curve)} fails at the parameter {s:g} ({type(error).__name__}: {error})",
                           "give a function of a parameter from 0 to 1 that returns 2 or 3 coordinates, m")
            if len(self.problems) > before:
                return HARMLESS, None
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if not np.all(lengths > 0):
            stop = float(np.argmin(lengths)) / SAMPLES
            head.wrong(f"{shown(curve)} returns the same point at the parameters {stop:g} and {stop + 1 / SAMPLES:g}",
                       "give a function that moves on between them")
            return HARMLESS, None
        return np.array(points), curve

    @reads(name=reading.name, beam=_beam, per_length=reading.components("N/m"), frame=reading.one_of("inertial", "section"))
    @statement
    def line_load(self, name: str, beam: Beam, per_length: Any, frame: str = "inertial") -> BeamLoad:
        """A force per reference length on the axis of a beam, N/m: dead (frame="inertial"), or following (frame="section")."""
        values = {f"f{i + 1}": v for i, v in enumerate(per_length)}
        law = LineLoad(name, following=frame == "section", **{key: v for key, v in values.items() if v != 0})
        self._claim(name)
        load = BeamLoad(name, beam, law)
        self.line_loads.append(load)
        return load

    @reads(name=reading.name, body=reading.instance(ReducedBody, "reduced body", "give mb.ReducedBody.craig_bampton(...)"),
           at=reading.point, damping=_ratios, velocity=reading.vector("m/s"), angular_velocity=reading.vector("rad/s"))
    @statement
    def reduced_body(self, name: str, body: Any, at: Any = (0, 0, 0), damping: Any = 0.0, velocity: Any = None,
                     angular_velocity: Any = None) -> Body:
        """A flexible body of another program's matrices (mb.ReducedBody), the origin of its nodes at `at` (m); its interfaces are
        bodies "<name>.<interface>", which joints and forces take; its own motion is that of its floating frame.

        damping: ratio to critical damping of every mode of the free body, or a list of one for each, the last for all further
        ones; as mounted it is another one, of a cantilever's lowest vibration 14 times less (`s.linearize().damping`). velocity
        (m/s, of the centre), angular_velocity (rad/s): of its start as a rigid body, inertial frame. Displacements are small in
        the floating frame."""
        v, w = (np.zeros(3) if given is None else np.array(given) for given in (velocity, angular_velocity))
        if not isinstance(body, ReducedBody):
            return self._add_body(Body(name, 1.0, np.eye(3), at, np.eye(3), v, w))
        if not 0 < np.size(damping) <= max(len(body.modal_mass), 1):
            self.problems.append(f"reduced body '{name}': damping has {counted(np.size(damping), 'ratio')} for "
                                 f"{counted(len(body.modal_mass), 'mode')}: give one for all, or at most one for each")
        origin, places = at + body.center, [at + x for x in body.interfaces.values()]
        frame = self._add_body(Body(name, 0.0, np.zeros((3, 3)), origin, np.eye(3), v, w, bool(np.any(v) or np.any(w)),
                                    np.array([*places[:1], origin, *places[1:]])))
        for interface, x in zip(body.interfaces, places, strict=True):
            self._part_of(frame, interface, x, np.zeros((3, 3)))
        self._enter_modes(frame, body, damping or 0.0)
        if self.space == "auto":
            self.space = "spatial"
        return frame

    def _part_of(self, frame: Body, of: str, place: Array, inertia: Any, **more: Any) -> Body:
        """A body "<name>.<of>" at a place (3,), m, that starts as the floating frame of a reduced body moves."""
        start = frame.drawn
        speed = start.velocity + np.cross(start.angular_velocity, place - start.position)
        return self._add_body(Body(f"{frame.name}.{of}", more.pop("mass", 0.0), inertia, place, np.eye(3), speed,
                                   start.angular_velocity, frame.given_velocity, shapes=(), **more))

    def _enter_modes(self, frame: Body, body: ReducedBody, damping: Any) -> None:
        """Enter the modes of a reduced body, the rows of its interfaces, and its inertia."""
        name, origin = frame.name, frame.drawn.position
        modes, count, bends = f"{name}.modes", len(body.modal_mass), len(body.bends)
        place = {"k": frame, "l": frame, "at": origin, "axis": (0.0, 0.0, 1.0), "axis_x": (1.0, 0.0, 0.0)}
        of_modes = np.append(damping, np.repeat(np.ravel(damping)[-1:], count))[:count]
        dashpot = 2 * of_modes * np.sqrt(body.modal_mass * body.modal_stiffness)
        laws = [ModalElasticity(modes, (modes, f"mode{n + 1}"), stiffness=float(body.modal_stiffness[n]),
                                damping=float(dashpot[n]) if np.any(of_modes) else None, **place) for n in range(count)]
        second = [SecondDisplacement(f"{modes} {i + 1}", modes, f"bend{i + 1}",
                                     {f"bend_{a + 1}_{b + 1}": float(body.bends[i, a, b]) for a in range(count)
                                      for b in range(a + 1)}, count=count, **place) for i in range(bends)]
        joint = modes_of_body(count, bends)(modes, kept=True, **place)
        joint.reduced, joint.ratio = body, damping
        still = dict.fromkeys(joint.coordinates, 0.0)  # it starts as drawn, without vibration
        self._enter(Connection(modes, "reduced body", frame, frame, [joint, *laws, *second], True, still, dict(still),
                               model=Classical()))
        for interface, shape in body.interface_shapes.items():
            node = self._by_name[f"{name}.{interface}"]
            shape = np.hstack([shape, body.interface_bends[interface]])
            law = InterfaceOfBody(f"{name}.interface {interface}", modes, _by_axes(shape=shape[:3], turn=shape[3:]), count=count,
                                  bends=bends, **{**place, "l": node, "at": node.drawn.position})
            self._enter(Connection(law.name, "interface", frame, node, [law]))
        for i, point in enumerate(body.points):
            node = self._part_of(frame, f"inertia {i + 1}", origin + point[:, 0], None, is_point=True,
                                 mass=body.mass / len(body.points))
            numbers = _by_axes(shape=np.column_stack([point[:, 1:], *(A @ point[:, 0] for A in body.stretches)]))
            rows = InertiaPoint(f"{name}.rows {i + 1}", modes, numbers, count=count, bends=bends,
                                **{**place, "l": node, "at": node.drawn.position})
            self._enter(Connection(rows.name, "inertia", frame, node, [rows]))

    def _enter(self, item: Connection) -> None:
        self._claim(item.name)
        self.connections.append(item)


def _by_axes(**vectors: Array) -> dict[str, float]:
    """Parameters "<name>_<axis>_<mode>" of vectors (3, n)."""
    return {f"{name}_{a}_{n + 1}": float(x) for name, vector in vectors.items() for a, row in zip("xyz", vector, strict=True)
            for n, x in enumerate(row)}


def check_attachments(scene: SceneItems, item: Connection) -> None:
    """Report a joint or force that attaches to a beam too near to a node: it must be at a node, or far enough from the nodes for
    a further node at its place."""
    for side, beam in (("k", item.k), ("l", item.l)):
        if isinstance(beam, Beam):
            point = item.places.get(side, item.joint.point_on(side))
            known = scene.attachments.setdefault(beam, ())
            place = nearest_place(beam, point)
            try:
                mesh_of(beam, (*known, place))
                scene.attachments[beam] = (*known, place)
            except MbdaeError:
                nodes = mesh_of(beam, known).positions
                apart = np.linalg.norm(nodes - place_of(beam, place), axis=1)
                closest = np.round(nodes[np.argmin(apart)], 12).tolist()
                scene.problems.append(f"{item.kind} '{item.name}': its place {point.tolist()} m on beam '{beam.name}' is "
                                     f"{apart.min():.3g} m from a node and would leave an element as short as that: attach "
                                     f"at the node, {closest} m, or move it away from there")


def mesh_of(beam: Beam, at: tuple[float, ...] = ()) -> LineMesh:
    """The mesh of a beam with nodes at some places: lengths along the outline, or parameters of its curve."""
    if beam.curve is not None:
        mesh = curved(beam.curve, beam.elements, beam.order, beam.axis2, at)
        _check_turning(beam)
        return mesh
    steps = np.diff(beam.outline, axis=0)
    first = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    back = np.flatnonzero(np.linalg.norm(first[1:] + first[:-1], axis=1) < FOLDED)
    if len(back):
        corner = beam.outline[back[0] + 1]
        raise OptionError(f"points: the line turns back by 180 deg at ({corner[0]:g}, {corner[1]:g}, {corner[2]:g}) m, about an "
                          f"unknown axis; make two beams of it, joined by s.weld")
    return polyline(beam.outline, beam.elements, beam.order, beam.axis2, at)


def place_of(beam: Beam, place: float) -> Array:
    """Position (3,), m, of a place on the axis of a beam: length along the outline, or parameter of its curve."""
    if beam.curve is not None:
        value = np.asarray(beam.curve(place), dtype=float)
        return np.pad(value, (0, 3 - len(value)))
    lengths = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(beam.outline, axis=0), axis=1))]
    return np.array([np.interp(place, lengths, beam.outline[:, i]) for i in range(3)])


def _check_turning(beam: Beam) -> None:
    """OptionError where neighbouring nodes of a curve are turned by nearly half a turn or more: rotations between them are
    interpolated the short way, which is then not unique."""
    steps = np.diff(beam.outline, axis=0)
    first = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    bends = 2 * np.arcsin(np.clip(np.linalg.norm(np.diff(first, axis=0), axis=1) / 2, 0, 1))
    places, so_far = np.linspace(0, 1, len(bends) + 1), np.r_[0.0, np.cumsum(bends)]
    turned = np.interp(np.linspace(0, 1, int(beam.elements) + 1), places, so_far)
    largest = float(np.max(np.diff(turned)) * np.max(np.diff(node_positions(beam.order))))
    if largest > TURNED:
        raise OptionError(f"elements = {beam.elements}: the curve turns by {np.degrees(largest):.0f} deg between "
                          f"neighbouring nodes, more than the {np.degrees(TURNED):.0f} deg that a beam can follow; give "
                          f"more elements")


def nearest_place(beam: Beam, point: Array) -> float:
    """The place on the axis of a beam nearest to a point: length along the outline, or parameter of its curve."""
    a, b = beam.outline[:-1], beam.outline[1:]
    d = b - a
    share = np.clip(np.einsum("ij,ij->i", point - a, d) / np.einsum("ij,ij->i", d, d), 0, 1)
    # of several equally near pieces the first, such as at the point where a closed line begins and ends
    i = nearest(np.linalg.norm(a + share[:, None] * d - point, axis=1), float(np.max(np.abs(d))))
    if beam.curve is None:
        lengths = np.linalg.norm(d, axis=1)
        return float(lengths[:i].sum() + share[i] * lengths[i])
    return _on_curve(beam.curve, point, (i + share[i]) / len(d), 1 / len(d))


def _on_curve(curve: Any, point: Array, s: float, width: float) -> float:
    """Parameter of the nearest point of a smooth curve near s, by a bounded scalar search."""
    from scipy.optimize import minimize_scalar

    def distance(x: float) -> float:
        p = np.zeros(3)
        value = np.asarray(curve(x), dtype=float)
        p[: len(value)] = value
        return float(np.linalg.norm(p - point))

    low, high = max(0.0, s - width), min(1.0, s + width)
    found = float(minimize_scalar(distance, bounds=(low, high), method="bounded", options={"xatol": 1e-13}).x)
    ends = [x for x in (low, high) if x in (0.0, 1.0)]
    return min([found, *ends], key=lambda x: (round(distance(x), 12), x not in ends))


def enter_more_modes(scene: BeamStatements) -> None:
    """Give every reduced body, of a copy of a scene, modes beyond its own."""
    for item in with_modes(scene.connections):
        own = [c for c in scene.connections if c is item or (c.k is item.k and isinstance(c.laws[0], InertiaPoint))]
        inertia = [c.l for c in own if c.kind == "inertia"]
        scene.connections[:] = [c for c in scene.connections if c not in own]
        scene.bodies[:] = [b for b in scene.bodies if b not in inertia]
        scene._known.clear()
        scene._read[:] = [0] * len(scene._read)
        scene._enter_modes(item.k, item.laws[0].reduced.finer(), item.laws[0].ratio)
