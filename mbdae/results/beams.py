"""Sensors of flexible beams: the motion of places on them from the interpolated fields, strains and stress resultants."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import symengine as se
from numpy.polynomial.legendre import legvander

from mbdae.kernels.line import derived_beam, reference_positions, turns
from mbdae.kernels.line_nodes import Nodes
from mbdae.laws.beam import ShapeTable, table
from mbdae.laws.line_mesh import LineMesh
from mbdae.notation import quantity
from mbdae.results.clearance import Fibre
from mbdae.results.sensors import BodySensor, judged, turned_about_z
from mbdae.results.states import RunStates
from mbdae.scene.components import Body
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.model.beams import Line, nodal_inputs
from mbdae.system.model.nodes import rotation_matrices

STRESSES = ("N1", "N2", "N3", "M1", "M2", "M3")
#: distances from the axis that differ by less than this times the length of the longest element count as equal, and a place xi
#: from 0 to 1 that is nearer to an end of its element is rounded
NEAR = 1e-9
CHUNK = 20_000  #: largest number of elements times states evaluated at once, but at least one state
Foot = tuple[int, float]  #: number of an element, and the place xi in it from 0 to 1


def foot(mesh: LineMesh, point: Array) -> Foot:
    """The place on the interpolated reference curve nearest to a point (3,), m; at a node the earlier element."""
    at = table(mesh.order, np.linspace(0, 1, 9))
    apart = np.linalg.norm(np.einsum("ga,mai->mgi", at.values, mesh.curve) - point, axis=2)
    nearby = np.argsort(apart.min(axis=1), kind="stable")[:4]
    found = [(int(e), _nearest(mesh, int(e), point, float(at.xi[np.argmin(apart[e])]))) for e in sorted(nearby)]
    distance = [float(np.linalg.norm(_on_curve(mesh, place, False) - point)) for place in found]
    tolerance = NEAR * float(np.max(mesh.measure(at)))
    return next(place for place, d in zip(found, distance, strict=True) if d <= min(distance) + tolerance)


def _nearest(mesh: LineMesh, e: int, point: Array, xi: float) -> float:
    """xi in 0..1 of element e nearest to a point, by Gauss-Newton from a start value."""
    for _ in range(30):
        d, tangent = _on_curve(mesh, (e, xi), False) - point, _on_curve(mesh, (e, xi), True)
        moved = float(np.clip(xi - d @ tangent / (tangent @ tangent), 0, 1))
        if abs(moved - xi) < 1e-14:
            break
        xi = moved
    return round(xi, 12) if min(xi, 1 - xi) < NEAR else xi


def _on_curve(mesh: LineMesh, place: Foot, slope: bool) -> Array:
    at = table(mesh.order, np.array([place[1]]))
    return np.asarray((at.slopes if slope else at.values)[0] @ mesh.curve[place[0]])


class Fields:
    """Positions, velocities and section axes of a beam at points xi (points,) of every element, or of one element."""

    def __init__(self, line: Line, at: ShapeTable, element: int | None = None) -> None:
        self.line, self.at = line, at
        self.elements = np.arange(len(line.mesh.elements)) if element is None else np.array([element])
        given = turns(line.mesh, line.kind)[self.elements]
        self.nodes = Nodes(line.kind, line.mesh.order + 1, given)

    def _nodal(self, head: str, values: Array) -> Array:
        """Values at the nodes of the elements (nt * elements, p + 1, size), from values (nt, n) of q or u (head: "q", "u")."""
        at = self.line.places(head)[self.elements]
        return np.asarray(values[:, at].reshape(-1, *at.shape[1:]))

    def _spread(self, nodal: Array, nt: int) -> Array:
        """Nodal values interpolated: (nt, elements, points, components)."""
        found: Array = np.einsum("ga,nai->ngi", self.at.values, nodal)
        return found.reshape(nt, len(self.elements), *found.shape[1:])

    def positions(self, q: Array) -> Array:
        """r, and theta or the quaternion, of the sections: (nt, elements, points, components)."""
        return self._spread(self.nodes.sections(self._nodal("q", q)), len(q))

    def rotations(self, positions: Array) -> Array:
        """R (nt, elements, points, 3, 3), section axes to inertial frame, from `positions`."""
        if self.line.kind is NodeKind.SPATIAL:
            return rotation_matrices(positions[..., 3:])
        return np.asarray(turned_about_z(positions[..., 2]) @ axes_in_plane(self.line, self.elements)[:, None])

    def rates(self, q: Array, u: Array) -> Array:
        """Time derivatives of `positions`: those of the nodes with the same shape functions."""
        rates = self.nodes.rates(self._nodal("q", q), self._nodal("u", u))
        return self._spread(self.nodes.turned(rates), len(q))


    def second_rates(self, q: Array, u: Array, acceleration: Array) -> Array:
        """Second time derivatives of `positions`: those of quaternions are bilinear in quaternion and spin."""
        nodal, speeds = self._nodal("q", q), self._nodal("u", u)
        second = self.nodes.rates(nodal, self._nodal("u", acceleration))
        if not self.nodes.flat:
            second[..., 3:] += self.nodes.rates(self.nodes.rates(nodal, speeds), speeds)[..., 3:]
        return self._spread(self.nodes.turned(second), len(q))


def axes_in_plane(line: Line, elements: Any = slice(None)) -> Array:
    """Section axes (elements, 3, 3) of a planar beam, columns, in axes that turn with it: along it, across it, z."""
    mesh = line.mesh
    first = mesh.elements[elements, 0]
    heading = mesh.headings[first] + mesh.offsets[elements, 0]
    drawn = rotation_matrices(mesh.quaternions[first]) @ rotation_matrices(mesh.turns[elements, 0])
    return np.asarray(np.round(turned_about_z(heading).swapaxes(-1, -2) @ drawn))



def in_space(line: Line, values: Array) -> Array:
    """Vectors (..., 3) from the translations of a node; z = 0 in the plane."""
    n = line.kind.translations
    return np.concatenate([values[..., :n], np.zeros((*values.shape[:-1], 3 - n))], axis=-1)


def angular_accelerations(line: Line, positions: Array, rates: Array, second: Array) -> Array:
    """Angular accelerations (..., 3), inertial, rad/s^2: the rate of `angular_velocities`; P' o conj(P') has no vector part."""
    found = angular_velocities(line, positions, second)
    if line.kind is NodeKind.PLANAR:
        return found
    P, Pt = positions[..., 3:], rates[..., 3:]
    stretch = 2 * np.sum(P * Pt, axis=-1, keepdims=True) / np.sum(P**2, axis=-1, keepdims=True)
    return np.asarray(found - stretch * angular_velocities(line, positions, rates))


def angular_velocities(line: Line, positions: Array, rates: Array) -> Array:
    """Angular velocities (..., 3), inertial, rad/s: theta', or 2 P' o conj(P) / |P|^2."""
    if line.kind is NodeKind.PLANAR:
        return np.concatenate([np.zeros((*rates.shape[:-1], 2)), rates[..., 2:]], axis=-1)
    w, v, wt, vt = positions[..., 3:4], positions[..., 4:], rates[..., 3:4], rates[..., 4:]
    return np.asarray(2 * (w * vt - wt * v - np.cross(vt, v)) / np.sum(positions[..., 3:] ** 2, axis=-1, keepdims=True))


def gauss_strains(line: Line, q: Array, u: Array, z: Array | None = None) -> tuple[Array, Array]:
    """Elastic strains and stress resultants (nt, elements, p, 6) at the Gauss points, section axes, in the order `STRESSES`;
    in the plane those out of it are zero. z (nt, stresses of the beam): the stresses, where they were unknowns of the run
    (computed from strains they would have the error of the positions times the stiffness)."""
    kernel, m = line.displacement, len(line.mesh.elements)
    elastic, names = _elastic(line.kind), [name for name, _ in kernel.derived.resultants]
    expressions = [*(elastic[name] for name in names), *(e for _, e in kernel.derived.resultants)]
    size = max(1, CHUNK // m)
    parts = [kernel.at_points(nodal_inputs(kernel, [line], q[i : i + size], u[i : i + size], np.zeros((len(q[i : i + size]), 0))),
                              expressions) for i in range(0, len(q), size)]
    values = np.concatenate([np.zeros((0, kernel.points, len(expressions))), *parts]).reshape(len(q), m, kernel.points, 2, -1)
    if z is not None:
        values[..., 1, :] = z.reshape(len(q), m, kernel.points, -1)
    found = np.zeros((*values.shape[:4], 6))
    found[..., [STRESSES.index(name) for name in names]] = values
    if line.kind is NodeKind.PLANAR:
        axes = axes_in_plane(line)
        found = np.concatenate([np.einsum("tegki,eij->tegkj", part, axes) for part in np.split(found, 2, axis=-1)], axis=-1) + 0.0
    return found[:, :, :, 0], found[:, :, :, 1]


def _elastic(kind: NodeKind) -> dict[str, Expr]:
    """Elastic strains, without those of the reference curve, by name: stresses without damping times the compliances."""
    undamped = derived_beam({}, kind, mixed=False)
    return {name: stress * se.Symbol(f"compliance_{name}") for name, stress in undamped.resultants}


class _OnBeam(BodySensor):
    """What sensors of a beam and of places on it have in common."""

    def __init__(self, result: RunStates, beam: Body, point: Array | None = None) -> None:
        super().__init__(result, beam, point)
        line = result.prepared.model.line(beam)
        assert line is not None
        self._line = line

    def _place(self, point: Array) -> BodySensor:
        return BeamPlace(self._result, self._body, point)


class BeamPlace(_OnBeam):
    """A place on a beam: a section of it, or a point rigidly joined to the section nearest to it as drawn.

    `rotation` (nt, 3, 3) has the section's axes 1, 2, 3 as columns. At a corner, or at a node two elements share, the
    section is that of the earlier element."""

    def __init__(self, result: RunStates, beam: Body, point: Array) -> None:
        super().__init__(result, beam, point)
        line = self._line
        self.arm: Array  #: (3,) from the axis to the place in section axes, m
        self.drawn_position: Array  #: position of the place as drawn (3,), m
        self.drawn_rotation: Array  #: rotation of the section at the place as drawn (3, 3), section axes to inertial frame
        self._element, self._xi = foot(line.mesh, point)
        self._fields = Fields(line, table(line.mesh.order, np.array([self._xi])), self._element)
        q = np.zeros((1, sum(n.kind.sizes[0] for n in result.prepared.model.nodes)))
        q[0, line.places("q")] = reference_positions(line.mesh, line.kind)[line.mesh.elements]
        drawn = self._fields.positions(q)
        self.drawn_position, self.drawn_rotation = point, self._fields.rotations(drawn)[0, 0, 0]
        self.arm = self.drawn_rotation.T @ (point - in_space(line, drawn)[0, 0, 0])

    @cached_property
    def _positions(self) -> Array:
        return self._fields.positions(self._result.q)

    @cached_property
    def _rates(self) -> Array:
        return self._fields.rates(self._result.q, self._result.u)

    @cached_property
    def rotation(self) -> Array:
        """R (nt, 3, 3), section axes to inertial frame."""
        return self._fields.rotations(self._positions)[:, 0, 0]

    @cached_property
    def position(self) -> Array:
        """Position of the place (nt, 3), m, inertial frame."""
        return self.on_axis + self.rotation @ self.arm

    @cached_property
    def on_axis(self) -> Array:
        """Position (nt, 3), m, inertial frame, of the point of the axis that the place is rigidly joined to."""
        return in_space(self._line, self._positions)[:, 0, 0]

    @cached_property
    def velocity(self) -> Array:
        """Velocity of the place (nt, 3), m/s, inertial frame."""
        return in_space(self._line, self._rates)[:, 0, 0] + np.cross(self.angular_velocity, self.rotation @ self.arm)

    @cached_property
    def angular_velocity(self) -> Array:
        """Angular velocity of the section (nt, 3), rad/s, inertial frame."""
        return angular_velocities(self._line, self._positions, self._rates)[:, 0, 0]

    @cached_property
    def _second(self) -> Array:
        return self._fields.second_rates(self._result.q, self._result.u, self._result.acceleration)

    @judged
    def angular_acceleration(self) -> Array:
        """Angular acceleration of the section (nt, 3), rad/s^2, inertial frame, from the equations of motion."""
        return angular_accelerations(self._line, self._positions, self._rates, self._second)[:, 0, 0]

    @judged
    def acceleration(self) -> Array:
        """Acceleration of the place (nt, 3), m/s^2, inertial frame, from the equations of motion."""
        arm, w = self.rotation @ self.arm, self.angular_velocity
        turning = np.cross(self.angular_acceleration, arm) + np.cross(w, np.cross(w, arm))
        return in_space(self._line, self._second)[:, 0, 0] + turning

    @judged
    @quantity("Pa")
    def fibre_stress(self) -> Array:
        """(nt,) Pa: normal stress along the beam at this place of its section, N1/A + M2 x3/I2 - M3 x2/I3, tension positive."""
        return self._fibre.normal(self._strains[1])

    @judged
    @quantity("Pa")
    def von_mises(self) -> Array:
        """Von Mises stress (nt,), Pa, at this place, from the normal stress and the shear stresses of shear forces and torque."""
        return self._fibre.von_mises(self._strains[1])

    @cached_property
    def _fibre(self) -> Fibre:
        return Fibre(self._line.beam.section, float(self.arm[1]), float(self.arm[2]), f"beam '{self._body.name}'")

    def _extrapolated(self, values: Array) -> Array:
        """(nt, 6) at this place, of the polynomial of order p - 1 through the values at the Gauss points of the element."""
        p = self._line.mesh.order
        points = legvander(2 * self._line.displacement.at.xi - 1, p - 1)
        weights = legvander(np.array([2 * self._xi - 1]), p - 1) @ np.linalg.inv(points)
        return np.asarray(np.einsum("g,tgi->ti", weights[0], values[:, self._element]))

    @cached_property
    def _strains(self) -> tuple[Array, Array]:
        r, first = self._result, 0
        for line in r.prepared.model.lines[: r.prepared.model.lines.index(self._line)]:
            first += len(line.stresses)
        z = r.stresses(r.t)
        own = None if z is None else z[:, first : first + len(self._line.stresses)]
        strain, stress = gauss_strains(self._line, r.q, r.u, own)
        return self._extrapolated(strain), self._extrapolated(stress)

    @judged
    @quantity("-, 1/m")
    def strain(self) -> Array:
        """(nt, 6) in section axes, less the strain of the beam as drawn: N1 extension, N2 and N3 shear along axes 2 and 3
        (no unit), M1 twist, M2 and M3 curvature about axes 2 and 3 (1/m).

        Strains of an element of order p are accurate at its p Gauss points only; elsewhere this is the polynomial of order
        p - 1 through them, so that two elements differ at the node they share by the error of either."""
        return self._strains[0]

    @judged
    @quantity("N, N m")
    def stress_resultants(self) -> Array:
        """(nt, 6) in section axes: N1 axial force, N2 and N3 shear forces (N), M1 torque, M2 and M3 bending moments (N m),
        of the part of the beam beyond the section on the part before it; with damping the part from the strain rate
        included. Extrapolated from the Gauss points as `strain` is."""
        return self._strains[1]


class BeamSensor(_OnBeam):
    """A beam as a whole: position and velocity of its centre of mass, rotation and angular velocity of its middle."""

    def _mean(self, head: str, values: Array) -> Array:
        n, mesh = self._line.kind.translations, self._line.mesh
        at = self._line.places(head)[..., :n]
        out = np.zeros((len(values), 3))
        out[:, :n] = np.einsum("teai,ea->ti", values[:, at], mesh.lumped) / mesh.length
        return out

    @cached_property
    def position(self) -> Array:
        """Position of the centre of mass (nt, 3), m, inertial frame."""
        return self._mean("q", self._result.q)

    @cached_property
    def velocity(self) -> Array:
        """Velocity of the centre of mass (nt, 3), m/s, inertial frame."""
        return self._mean("u", self._result.u)

    @judged
    def acceleration(self) -> Array:
        """Acceleration of the centre of mass (nt, 3), m/s^2, inertial frame, from the equations of motion."""
        return self._mean("u", self._result.acceleration)

    @judged
    def angular_acceleration(self) -> Array:
        """Angular acceleration (nt, 3), rad/s^2, of the section in the middle of the length, inertial frame."""
        return np.asarray(self._middle.angular_acceleration)

    @cached_property
    def _middle(self) -> Any:
        return self.at(0.5)

    @cached_property
    def rotation(self) -> Array:
        """R (nt, 3, 3) of the section in the middle of the length, section axes to inertial frame."""
        return np.asarray(self._middle.rotation)

    @cached_property
    def angular_velocity(self) -> Array:
        """Angular velocity (nt, 3), rad/s, of the section in the middle of the length, inertial frame."""
        return np.asarray(self._middle.angular_velocity)


def polylines(result: RunStates, line: Line, pieces: int) -> Array:
    """The deformed axis of a beam by `pieces` chords per element: points (nt, n, 3), m, inertial frame."""
    fields = Fields(line, table(line.mesh.order, np.linspace(0, 1, pieces + 1)))
    r = in_space(line, fields.positions(result.q))
    return np.concatenate([r[:, :1, 0], r[:, :, 1:].reshape(len(r), -1, 3)], axis=1)
