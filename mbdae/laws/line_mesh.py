"""A line divided into elements: nodes with section axes, and constants of the elements.

An element of order p has p + 1 nodes; neighbouring elements share one. Where the line has a corner, or where a node has
axes of its own, a constant rotation per node of an element (`turns`) leads from the node's axes to the section's, so that
corners are rigid. Quaternions are interpolated: those of an element's sections have positive dot products.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import OptionError
from mbdae.laws.beam import ShapeTable, headings, mass_points, node_positions, quaternions, relative, section_axes
from mbdae.notation import counted
from mbdae.values import Array, largest

NEAR = 1e-9  #: distance up to which two places count as one: over the segment's length, or in the parameter of a curve
#: an attachment that would cut an element is refused if a part got shorter than this times the longest of the two parts and the
#: elements beside them in the same segment
SHORTEST = 1e-3
Curve = Callable[[float], Any]  #: position (3,) by a parameter from 0 to 1


@dataclass(frozen=True, eq=False)
class LineMesh:
    """Nodes and elements of a line, as drawn. n nodes, m elements of p + 1 nodes."""

    order: int  #: p, of the interpolation
    positions: Array  #: positions of the nodes (n, 3), m
    quaternions: Array  #: (n, 4) axes of the nodes, unit length
    headings: Array  #: (n,) angle of axis 1 in the plane z = 0, rad, continuous along the line
    elements: NDArray[np.intp]  #: (m, p + 1) nodes of every element
    turns: Array  #: (m, p + 1, 4) rotation from the node's axes to the section's; (1, 0, 0, 0) where they are equal
    offsets: Array  #: (m, p + 1) angle from the node's axes to the section's in the plane z = 0, rad
    places: Array  #: (n,) where the nodes are on the line: length along the polyline, m, or parameter of the curve, 0 to 1

    @property
    def curve(self) -> Array:
        """(m, p + 1, 3) positions of the nodes of every element."""
        return np.asarray(self.positions[self.elements])

    def measure(self, at: ShapeTable) -> Array:
        """(m, points) ds/dxi of the interpolated reference curve, m."""
        return np.asarray(np.linalg.norm(np.einsum("ga,mai->mgi", at.slopes, self.curve), axis=-1))

    @cached_property
    def length(self) -> float:
        """Length of the interpolated reference curve, m."""
        at = mass_points(self.order)
        return float(np.sum(self.measure(at) @ at.weights))

    @cached_property
    def stations(self) -> Array:
        """(n,) length along the line at every node, m."""
        at = mass_points(self.order)
        ends = np.r_[0.0, np.cumsum(self.measure(at) @ at.weights)]
        found = np.empty(len(self.positions))
        for element, start, end in zip(self.elements, ends[:-1], ends[1:], strict=True):
            found[element] = start + (end - start) * node_positions(self.order)
        return found

    def with_axes(self, node: int, P: Array, heading: float) -> LineMesh:
        """The same line with other axes of one node (quaternion, angle in the plane): its sections stay as they are."""
        sections = _turned(self.quaternions[self.elements], self.turns)
        angles = self.headings[self.elements] + self.offsets
        nodes, theta = self.quaternions.copy(), self.headings.copy()
        nodes[node], theta[node] = P, heading
        turns = relative(nodes[self.elements], sections)
        return replace(self, quaternions=nodes, headings=theta, turns=turns, offsets=angles - theta[self.elements])

    def shared(self, at: ShapeTable) -> Array:
        """(m, p + 1, p + 1) integrals of products of shape functions over every element, m."""
        return np.asarray(np.einsum("mg,g,ga,gb->mab", self.measure(at), at.weights, at.values, at.values))

    @cached_property
    def lumped(self) -> Array:
        """(m, p + 1) integral of every shape function, m: nodal forces of a unit dead load per length."""
        at = mass_points(self.order)
        return np.asarray(np.einsum("mg,g,ga->ma", self.measure(at), at.weights, at.values))

    @cached_property
    def normal_axis(self) -> int | None:
        """Which section axis (2 or 3) is normal to the plane z = 0 everywhere; None where none is."""
        w, x, y, z = self.quaternions.T
        second, third = 2 * (y * z + w * x), w * w - x * x - y * y + z * z  # z components of axes 2 and 3
        found = [axis for axis, c in ((2, second), (3, third)) if np.all(np.abs(np.abs(c) - 1) < 1e-12)]
        return found[0] if found else None


def _turned(P: Array, turns: Array) -> Array:
    """Quaternion products P o turn (..., 4): the section's axes from the node's."""
    w = P[..., :1] * turns[..., :1] - np.sum(P[..., 1:] * turns[..., 1:], axis=-1, keepdims=True)
    v = P[..., :1] * turns[..., 1:] + turns[..., :1] * P[..., 1:] + np.cross(P[..., 1:], turns[..., 1:])
    return np.concatenate([w, v], axis=-1)


def polyline(points: Any, elements: int | Sequence[int], order: int = 2, axis2: Any = None,
             through: Sequence[float] = ()) -> LineMesh:
    """Straight segments between points (k, 3), k >= 2, rigid at corners.

    elements: per segment, or one number spread by length, at least one each. axis2: direction of section axis 2; by
    default it lies in the plane of the points, with axis 3 normal to it. through: lengths along the line, m, where a node
    must be; they cut elements where there is none.
    """
    corners = _points(points)
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    counts = _counts(lengths, elements)
    starts = np.r_[0.0, np.cumsum(lengths)]
    edges = [_with_nodes(np.linspace(0, 1, n + 1), order, (np.asarray(through) - s) / length)
             for n, s, length in zip(counts, starts, lengths, strict=False)]
    xi = node_positions(order)
    ends = [a + e[:, None] * (b - a) for a, b, e in zip(corners[:-1], corners[1:], edges, strict=True)]
    curve = np.concatenate([e[:-1, None] + np.diff(e, axis=0)[:, None] * xi[:, None] for e in ends])
    direction = np.repeat(np.diff(corners, axis=0), [len(e) - 1 for e in edges], axis=0)
    places = np.concatenate([s + length * _nodes(e, order) for s, length, e in zip(starts[:-1], lengths, edges, strict=True)])
    return _mesh(order, curve, np.repeat(direction[:, None], order + 1, axis=1), axis2, places)


def curved(curve: Curve, elements: int, order: int = 2, axis2: Any = None, through: Sequence[float] = ()) -> LineMesh:
    """A smooth curve: its position (2 or 3 components, m) by a parameter from 0 to 1, equal parts of which are elements.

    through: parameters where a node must be."""
    edges = _with_nodes(np.linspace(0.0, 1.0, _counts(np.ones(1), elements)[0] + 1), order, np.asarray(through, dtype=float))
    parameters = _nodes(edges, order)
    positions = _vectors([curve(s) for s in parameters.ravel()]).reshape(*parameters.shape, 3)
    tangents = np.array([_tangent(curve, s) for s in parameters.ravel()]).reshape(positions.shape)
    return _mesh(order, positions, tangents, axis2, parameters)


def arc(start: Any, through: Any, end: Any) -> Curve:
    """The circular arc through three points, by a parameter from 0 to 1."""
    a, b, c = _points([start, through, end])
    u, v = b - a, c - a
    w = np.cross(u, v)
    if np.linalg.norm(v) <= 1e-12 * np.linalg.norm(u):
        raise OptionError("the arc ends where it starts: give two arcs for a full circle")
    if np.linalg.norm(w) < 1e-12 * np.linalg.norm(u) * np.linalg.norm(v):
        raise OptionError("the three points of an arc lie on a straight line: give a point off it, or a straight beam")
    center = a + np.cross((u @ u) * v - (v @ v) * u, w) / (2 * (w @ w))
    first, normal = a - center, w / np.linalg.norm(w)
    second = np.cross(normal, first)
    angle = np.arctan2((c - center) @ second, (c - center) @ first) % (2 * np.pi)
    return lambda s: center + np.cos(s * angle) * first + np.sin(s * angle) * second


def _vectors(points: Any) -> Array:
    """(k, 3) positions from points of 2 or 3 coordinates."""
    return np.array([np.pad(np.asarray(p, dtype=float), (0, 3 - len(p))) for p in points])


def _points(points: Any) -> Array:
    """Positions (k, 3), no two neighbours equal."""
    found = _vectors(points)
    if len(found) < 2 or not np.all(np.linalg.norm(np.diff(found, axis=0), axis=1) > 0):
        raise OptionError("a beam needs at least two points, each different from the one before")
    return found


def _counts(lengths: Array, elements: int | Sequence[int]) -> list[int]:
    """Elements of every segment; one number is spread so that the longest element is as short as possible."""
    counts, n = np.asarray(elements), len(lengths)
    least = 1 if counts.ndim else n
    if counts.shape not in ((), (n,)) or not np.issubdtype(counts.dtype, np.integer) or counts.min() < least:
        several = "" if n == 1 else f", or a list of {n}, one positive integer for every segment"
        raise OptionError(f"elements = {elements}: the beam has {counted(n, 'segment')}; give an integer of at least {n}"
                          f"{several}")
    if counts.ndim:
        return [int(count) for count in counts]
    found = [1] * n
    for _ in range(int(counts) - n):
        found[largest(lengths / found)] += 1
    return found


def _with_nodes(edges: Array, order: int, wanted: Array) -> Array:
    """Edges of elements over [0, 1] cut where a wanted place is no node yet; raises OptionError where one becomes too short."""
    for place in np.sort(wanted[(wanted > -NEAR) & (wanted < 1 + NEAR)]):
        nodes = _nodes(edges, order).ravel()
        nearest = float(nodes[np.argmin(np.abs(nodes - place))])
        if abs(nearest - place) <= NEAR:
            continue
        cut = np.sort(np.append(edges, place))
        sizes = np.diff(cut)
        at = int(np.searchsorted(cut, place))
        smallest = min(sizes[at - 1], sizes[at])
        if smallest < SHORTEST * max(sizes[max(at - 2, 0) : at + 2]):
            raise OptionError(f"an attachment at {place:.9g} of its segment would leave an element of {smallest:.3g} of it: "
                              f"attach at the node at {nearest:.9g} of the segment, or farther from that node")
        edges = cut
    return edges


def _nodes(edges: Array, order: int) -> Array:
    """(m, p + 1) places of the nodes of elements between edges (m + 1,)."""
    return np.asarray(edges[:-1, None] + np.diff(edges)[:, None] * node_positions(order))


def _tangent(curve: Curve, s: float) -> Array:
    """Derivative of the curve by its parameter, by differences over five points, which all lie on the curve's parameters 0 to
    1."""
    h = 2e-3
    inside = min(max(s, 2 * h), 1 - 2 * h)
    stencil = inside + h * np.arange(-2, 3)
    values = _vectors([curve(t) for t in stencil])
    weights = np.linalg.solve(np.vander(stencil - s, 5, increasing=True).T, np.eye(5)[1])
    return np.asarray(weights @ values)


def _mesh(order: int, curve: Array, tangents: Array, axis2: Any, places: Array) -> LineMesh:
    """The mesh from the positions of nodes (m, p + 1, 3) of m elements, tangents there (m, p + 1, 3) and places (m, p + 1);
    consecutive elements share a node."""
    m = len(curve)
    elements = order * np.arange(m)[:, None] + np.arange(order + 1)
    sections = quaternions(section_axes(tangents.reshape(-1, 3), curve.reshape(-1, 3), axis2)).reshape(m, order + 1, 4)
    angles = headings(tangents.reshape(-1, 3)).reshape(m, order + 1)
    # a shared node has the section axes of the element before it
    positions, nodes, theta, at = (np.concatenate([a[0], a[1:, 1:].reshape(-1, *a.shape[2:])])
                                   for a in (curve, sections, angles, places))
    turns = relative(nodes[elements], sections)
    return LineMesh(order, positions, nodes, theta, elements, turns, angles - theta[elements], at)
