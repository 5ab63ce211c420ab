"""Statements about flexible beams."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.elements.line_mesh import LineMesh, arc, curved, polyline
from mbdae.elements.line_shape import ORDERS
from mbdae.errors import MbdaeError
from mbdae.forces.line_load import LineLoad
from mbdae.scene.components import Array, Beam
from mbdae.scene.reading import Reading
from mbdae.scene.record import statement
from mbdae.scene.section import Section

SAMPLES = 64  #: pieces of a curve for drawing and for finding the place nearest to a point


@dataclass(frozen=True, eq=False)
class BeamLoad:
    """A load distributed along a beam; its components by name, numbers or expressions of time."""

    name: str
    beam: Beam
    law: LineLoad


class BeamStatements(Reading):
    """`beam` and its distributed loads."""

    line_loads: list[BeamLoad]

    @statement
    def beam(self, name: str, *points: Any, section: Any, elements: Any = 4, order: int = 2, curve: Any = None, axis2: Any = None,
             velocity: Any = None, angular_velocity: Any = None) -> Beam:  # fmt: skip
        """A flexible beam through `points` (corners are rigid) with a `section` (mb.Section), in `elements` of an `order` from
        1 to 4: a number per segment, or one number spread by length.

        curve: "arc" for the circular arc through three points, or a function of a parameter from 0 to 1 that returns a point
        (no points then). axis2: direction of section axis 2; by default it lies in the plane of the beam. velocity (m/s, of
        the centre) and angular_velocity (rad/s) of its start as a rigid body, inertial frame."""
        outline, function = self._line(name, points, curve)
        if not isinstance(section, Section):
            self.problems.append(f"beam '{name}': section={section!r} is not a cross-section; give mb.Section(...)")
            section = Section(1, 1, 1, 1, 1, 1, 1, 1)
        rates = (("velocity", velocity, "m/s"), ("angular_velocity", angular_velocity, "rad/s"))
        v, w = (np.zeros(3) if given is None else self._vector(name, what, given, unit) for what, given, unit in rates)
        direction = None if axis2 is None else self._vector(name, "axis2", axis2, "")
        if order not in ORDERS:
            self.problems.append(f"beam '{name}': order = {order!r}: give 1, 2, 3 or 4")
            order = 2
        lengths = np.linalg.norm(np.diff(outline, axis=0), axis=1)
        center = lengths @ (outline[1:] + outline[:-1]) / (2 * lengths.sum())
        body = Beam(name, section.mass_per_length * float(lengths.sum()), None, center, np.eye(3), v, w,
                    given_velocity=bool(np.any(v) or np.any(w)), outline=outline, section=section, elements=elements,
                    order=order, curve=function, axis2=direction, scene=self)  # fmt: skip
        try:
            mesh_of(body)
        except MbdaeError as error:
            self.problems.append(f"beam '{name}': {error}")
            body.elements, body.axis2, body.curve = len(outline) - 1, None, None
        return self._add_body(body)  # type: ignore[attr-defined, no-any-return]

    def _line(self, name: str, points: Any, curve: Any) -> tuple[Array, Any]:
        """Outline (k, 3) and the curve, if it is one."""
        outline = np.array([self._vector(name, f"point {i + 1}", p, "m") for i, p in enumerate(points)]).reshape(-1, 3)
        function = None
        try:
            if callable(curve):
                function = curve
            elif curve == "arc" and len(outline) == 3:
                function = arc(*outline)
            elif curve is not None:
                self.problems.append(f"beam '{name}': curve={curve!r} with {len(outline)} points: give 'arc' and three points, "
                                     f"or a function of a parameter from 0 to 1")  # fmt: skip
        except MbdaeError as error:
            self.problems.append(f"beam '{name}': {error}")
        if function is not None:
            return np.array([self._vector(name, "curve", function(s), "m") for s in np.linspace(0, 1, SAMPLES + 1)]), function
        if len(outline) < 2 or not np.all(np.linalg.norm(np.diff(outline, axis=0), axis=1) > 0):
            self.problems.append(f"beam '{name}': needs at least two points, each different from the one before")
            outline = np.array([np.zeros(3), np.eye(3)[0]])
        return outline, None

    @statement
    def line_load(self, name: str, beam: Beam, per_length: Any, frame: str = "inertial") -> BeamLoad:
        """A force per reference length on the axis of a beam, N/m: dead (frame="inertial"), or following (frame="section")."""
        if frame not in ("inertial", "section"):
            self.problems.append(f"load '{name}': frame={frame!r} is unknown; use 'inertial' or 'section'")
        entries = list(per_length) + [0.0] * (3 - len(per_length))
        values = {f"f{i + 1}": self._timed(name, f"per_length[{i}]", v, "N/m") for i, v in enumerate(entries)}
        law = LineLoad(name, follows=frame == "section", **{key: v for key, v in values.items() if v != 0})
        self._claim(name)  # type: ignore[attr-defined]
        load = BeamLoad(name, beam, law)
        self.line_loads.append(load)
        return load


def mesh_of(beam: Beam, at: tuple[float, ...] = ()) -> LineMesh:
    """The mesh of a beam with nodes at some places: lengths along the outline, or parameters of its curve."""
    if beam.curve is not None:
        return curved(beam.curve, beam.elements, beam.order, beam.axis2, at)
    return polyline(beam.outline, beam.elements, beam.order, beam.axis2, at)


def nearest_place(beam: Beam, point: Array) -> float:
    """The place on the axis of a beam nearest to a point: length along the outline, or parameter of its curve."""
    a, b = beam.outline[:-1], beam.outline[1:]
    d = b - a
    share = np.clip(np.einsum("ij,ij->i", point - a, d) / np.einsum("ij,ij->i", d, d), 0, 1)
    i = int(np.argmin(np.linalg.norm(a + share[:, None] * d - point, axis=1)))
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
