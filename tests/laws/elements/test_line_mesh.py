"""Meshes of lines: nodes, shape functions, section axes, corners and what is constant in elements."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbdae.errors import OptionError
from mbdae.kernels.line import mass_blocks
from mbdae.kernels.line_nodes import GyroscopicKernel, Nodes
from mbdae.laws.beam import gauss, mass_points, node_positions, quaternions, strain_points, table
from mbdae.laws.line_mesh import arc, curved, polyline
from mbdae.symbolic.frames import NodeKind
from mbdae.system.model.nodes import rotation_matrices

NUMBERS = {"mass_per_length": 2.0, "J1": 0.5, "J2": 0.2, "J3": 0.3}
SPACE = [(0, 0, 0), (2, 0, 0), (2, 1, 0.5)]


def rotation(P):
    w, x, y, z = P / np.linalg.norm(P)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def circle(s):
    return (np.cos(2 * np.pi * s), np.sin(2 * np.pi * s))


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_shape_functions_reproduce_polynomials(order):
    xi = np.linspace(0, 1, 7)
    t, nodes = table(order, xi), node_positions(order)
    for k in range(order + 1):
        assert t.values @ nodes**k == pytest.approx(xi**k)
        assert t.slopes @ nodes**k == pytest.approx(k * xi ** max(k - 1, 0))
    assert table(order, nodes).values == pytest.approx(np.eye(order + 1), abs=1e-13)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_quadrature(order):
    assert len(strain_points(order).xi) == order
    at = mass_points(order)
    for k in range(2 * order + 2):
        assert at.weights @ at.xi**k == pytest.approx(1 / (k + 1))
    assert gauss(order, order) is strain_points(order)


def test_orders_beyond_four_are_refused():
    with pytest.raises(OptionError, match="order = 5"):
        node_positions(5)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_straight_line(order):
    mesh = polyline([(0, 0), (3, 4)], 4, order)
    assert mesh.elements.shape == (4, order + 1)
    assert mesh.elements[1:, 0] == pytest.approx(mesh.elements[:-1, -1])
    assert mesh.length == pytest.approx(5)
    assert mesh.stations == pytest.approx(np.linalg.norm(mesh.positions, axis=1))
    assert mesh.headings == pytest.approx(np.arctan2(4, 3))
    assert np.all(mesh.turns == [1, 0, 0, 0])
    assert not mesh.offsets.any()
    assert mesh.normal_axis == 3
    for P in mesh.quaternions:
        assert rotation(P) == pytest.approx(np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]]), abs=1e-14)


def test_elements_are_spread_by_length():
    assert len(polyline([(0, 0), (1, 0), (1, 3)], 8).elements) == 8
    ends = polyline([(0, 0), (1, 0), (1, 3)], 8, 1).positions
    assert np.sum(ends[:, 1] > 1e-9) == 6
    assert len(polyline([(0, 0), (1, 0), (1, 3)], [1, 4]).elements) == 5


@pytest.mark.parametrize("elements", [1, [1], [1, 0], 2.5, [1, 1, 1], "two"])
def test_elements_that_do_not_suit_the_points(elements):
    with pytest.raises(OptionError, match="elements = "):
        polyline([(0, 0), (1, 0), (1, 1)], elements)


def test_points_that_are_no_line():
    with pytest.raises(OptionError, match="two points"):
        polyline([(0, 0), (0, 0, 0)], 1)
    with pytest.raises(OptionError, match="on a straight line"):
        arc((0, 0), (1, 1), (2, 2))


def test_corners_are_rigid_rotations_of_element_ends():
    """Node axes are those of the earlier segment; the turn leads to those of the later one, in space and in the plane."""
    mesh = polyline(SPACE, [2, 3], 2)
    corner = mesh.elements[2, 0]
    turned = [tuple(place) for place in np.argwhere(np.any(mesh.turns != [1, 0, 0, 0], axis=-1))]
    assert turned == [(2, 0)]
    section = rotation(mesh.quaternions[corner]) @ rotation(mesh.turns[2, 0])
    direction = np.array([0, 1, 0.5]) / np.linalg.norm([0, 1, 0.5])
    assert section[:, 0] == pytest.approx(direction, abs=1e-14)
    assert rotation(mesh.quaternions[corner])[:, 0] == pytest.approx([1, 0, 0])
    planar = polyline([(0, 0), (1, 0), (1, 1)], 2, 1)
    assert planar.headings == pytest.approx([0, 0, np.pi / 2])
    assert planar.offsets == pytest.approx(np.array([[0, 0], [np.pi / 2, 0]]))


@pytest.mark.parametrize("mesh", [polyline(SPACE, 7, 2), curved(circle, 5, 3), curved(arc(*SPACE), 4, 4)])
def test_section_quaternions_of_an_element_are_on_one_side(mesh):
    nodes = Nodes(NodeKind.SPATIAL, mesh.order + 1, mesh.turns)
    q = np.concatenate([mesh.positions, mesh.quaternions], axis=1)[mesh.elements]
    P = nodes.sections(q)[..., 3:]
    assert np.einsum("mai,mbi->mab", P, P).min() > 0
    assert np.linalg.norm(P, axis=-1) == pytest.approx(1)


def test_circle():
    mesh = curved(circle, 12, 3)
    assert mesh.length == pytest.approx(2 * np.pi, rel=1e-6)
    assert mesh.headings == pytest.approx(np.pi / 2 + mesh.stations, abs=1e-4)  # once around, without a jump
    assert np.all(mesh.turns == [1, 0, 0, 0])
    tangents = np.column_stack([-mesh.positions[:, 1], mesh.positions[:, 0], np.zeros(len(mesh.positions))])
    for P, t, r in zip(mesh.quaternions, tangents, mesh.positions, strict=True):
        assert rotation(P) == pytest.approx(np.column_stack([t, -r, [0, 0, 1]]), abs=1e-8)


def test_arc_through_three_points():
    curve = arc((1, 0), (0, 1), (-1, 0))
    assert np.array([curve(s) for s in (0, 0.5, 1)]) == pytest.approx(np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0]]), abs=1e-14)
    long = arc((1, 0), (-1, 0), (0, -1))
    assert long(1 / 3) == pytest.approx([0, 1, 0], abs=1e-14)


def test_axis2():
    mesh = polyline([(0, 0), (1, 0)], 1, axis2=(0.5, 0, 2))
    assert rotation(mesh.quaternions[0])[:, 1] == pytest.approx([0, 0, 1])
    assert mesh.normal_axis == 2
    assert polyline([(0, 0), (1, 0)], 1, axis2=(0, 1, 1)).normal_axis is None
    with pytest.raises(OptionError, match=r"axis2 = .* is parallel"):
        polyline([(0, 0), (1, 0)], 1, axis2=(2, 0, 0))


@pytest.mark.parametrize("points", [
    [(0, 0, 0), (0, 0, 2)], [(0, 0, 0), (0, 0, 2), (0, 1, 3)], [(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1)],
])
def test_default_axes_exist_in_space(points):
    mesh = polyline(points, 4, 2)
    assert np.all(np.isfinite(mesh.quaternions))
    assert np.all(np.isfinite(mesh.turns))


@pytest.mark.parametrize("points", [SPACE, [(0, 0), (1, 0), (1, 1)]])
def test_mass_of_a_rigid_motion(points):
    """Twice the kinetic energy of a rigid rotation is that of slender rods with the rotary inertia of their sections."""
    mesh = polyline(points, [2, 3], 2)
    M, omega, velocity = mass_blocks(mesh, NUMBERS, NodeKind.SPATIAL), np.array([0.3, -0.7, 1.1]), np.array([1.0, 2.0, -1.0])
    u = np.array([np.r_[velocity + np.cross(omega, r), rotation(P).T @ omega]
                  for r, P in zip(mesh.positions, mesh.quaternions, strict=True)])
    local = u[mesh.elements].reshape(len(M), -1)
    energy = np.einsum("mi,mij,mj->", local, M, local)
    exact = 0.0
    for a, b in pairwise(points):
        a, b = np.pad(a, (0, 3 - len(a))), np.pad(b, (0, 3 - len(b)))
        L, ends = np.linalg.norm(b - a), [velocity + np.cross(omega, p) for p in (a, b)]
        exact += 2.0 * L * (ends[0] @ ends[0] + ends[0] @ ends[1] + ends[1] @ ends[1]) / 3
        node = mesh.elements[2 if np.any(a) else 0, 1]
        w = rotation(mesh.quaternions[node]).T @ omega
        exact += L * (0.5 * w[0] ** 2 + 0.2 * w[1] ** 2 + 0.3 * w[2] ** 2)
    assert energy == pytest.approx(exact, rel=1e-12)
    assert np.abs(M - M.transpose(0, 2, 1)).max() < 1e-14
    assert GyroscopicKernel(M, 3).J.shape == (5, 3, 3, 3, 3)


def test_planar_mass():
    mesh = polyline([(0, 0), (3, 4)], 2, 2)
    M = mass_blocks(mesh, NUMBERS, NodeKind.PLANAR).reshape(2, 3, 3, 3, 3)
    assert M[:, :, 0, :, 0].sum() == pytest.approx(10.0)
    assert M[:, :, 2, :, 2].sum() == pytest.approx(1.5)
    assert not M[:, :, 0, :, 2].any()


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 1, 0), (1, 0, 0)])
def test_default_axis_3_points_up_whichever_way_the_line_bends(up):
    """Normal to the plane of the line, with its z (else y, else x) positive."""
    first, up = np.roll(up, 1), np.array(up)
    second = np.cross(up, first)
    for side in (1, -1):
        mesh = polyline([0 * first, 1.0 * first, first + side * second], 2)
        assert rotation_matrices(mesh.quaternions)[:, :, 2] == pytest.approx(np.tile(up, (len(mesh.positions), 1)), abs=1e-12)


@pytest.mark.parametrize("direction", [(1, 0), (1, 1), (-1, 2), (0, -3)])
def test_axis_normal_to_the_plane(direction):
    """Lines in the plane z = 0: axis 3 is normal to it by default, axis 2 where it is said to be, neither where it is oblique."""
    ends = [(0, 0), direction]
    assert polyline(ends, 2).normal_axis == 3
    assert polyline(ends, 2, axis2=(0, 0, 1)).normal_axis == polyline(ends, 2, axis2=(0, 0, -1)).normal_axis == 2
    assert polyline(ends, 2, axis2=(-direction[1], direction[0], 1)).normal_axis is None


@pytest.mark.parametrize("seed", range(6))
def test_quaternions_of_any_axes_are_continuous_and_begin_with_a_positive_scalar(seed):
    """Axes turned step by step, through half turns too, where one component after the other is the largest."""
    rng = np.random.default_rng(seed)
    steps = Rotation.from_rotvec(rng.normal(size=(60, 3)) * 0.4)
    turned = [Rotation.from_rotvec(rng.normal(size=3) * 2)]
    for step in steps:
        turned.append(step * turned[-1])
    axes = np.array([r.as_matrix() for r in turned])
    P = quaternions(axes)
    np.testing.assert_allclose(Rotation.from_quat(P[:, [1, 2, 3, 0]]).as_matrix(), axes, atol=1e-14)
    assert P[0, 0] >= 0
    assert (np.einsum("ki,ki->k", P[1:], P[:-1]) > 0).all()


def test_nodes_stand_where_they_are_asked_for():
    """Lengths along two segments, of 2 and 3 m."""
    mesh = polyline([(0, 0, 0), (2, 0, 0), (2, 3, 0)], [2, 2], through=[0.3, 4.7])
    assert mesh.order == 2
    for length, place in ((0.3, (0.3, 0, 0)), (4.7, (2, 2.7, 0))):
        node = int(np.argmin(abs(mesh.places - length)))
        assert mesh.places[node] == pytest.approx(length, abs=1e-12)
        assert mesh.positions[node] == pytest.approx(place, abs=1e-12)
