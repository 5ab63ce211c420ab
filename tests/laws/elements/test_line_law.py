"""Laws on a line at a point and over elements: exact derivatives, invariance, power, planar and spatial alike."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
import symengine as se

from mbdae.errors import LawError, OptionError
from mbdae.kernels import Kernel
from mbdae.kernels.line import LineKernel, load_kernel, mass_blocks, merged, strain_kernel
from mbdae.kernels.line_nodes import GyroscopicKernel
from mbdae.laws.beam import Beam, LineLoad, strain_points
from mbdae.laws.line_mesh import polyline
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Structure
from mbdae.symbolic.line import derive_line, make_point

STRESSES = ("N1", "N2", "N3", "M1", "M2", "M3")
KINDS = (NodeKind.PLANAR, NodeKind.SPATIAL)
INERTIA = {"mass_per_length": 1.3, "J1": 0.3, "J2": 0.1, "J3": 0.2}
NUMBERS = INERTIA | {f"compliance_{n}": 0.1 * i + 0.1 for i, n in enumerate(STRESSES)}
VARIANTS = [(kind, damping, mixed, order) for kind, damping, mixed, order in product(KINDS, (0.0, 0.3), (True, False), (1, 2, 4))]


def bent(kind, order):
    """Two elements with a corner between them."""
    points = [(0, 0), (1, 0.2), (1.3, 1)] if kind is NodeKind.PLANAR else [(0, 0, 0), (1, 0.2, 0.3), (1.3, 1, 0.1)]
    return polyline(points, 2, order)


def random_inputs(kernel, elements, seed=3):
    return np.random.default_rng(seed).uniform(0.2, 1.0, (elements, len(kernel.inputs)))


def complex_step(f, x):
    columns = []
    for i in range(x.shape[1]):
        moved = x.astype(complex)
        moved[:, i] += 1e-30j
        columns.append(f(moved).imag / 1e-30)
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize(("kind", "damping", "mixed", "order"), VARIANTS)
def test_jacobian_of_elements(kind, damping, mixed, order):
    """Quaternions of unequal length, a corner, corner rotations on both ends."""
    kernel = strain_kernel(bent(kind, order), {**NUMBERS, "damping": damping}, kind, mixed)
    x = np.tile(random_inputs(kernel, 2), (3, 1))  # three stages at once
    exact = complex_step(kernel.values, x)
    J = kernel.full_jacobian(x)
    assert np.abs(J - exact).max() < 1e-10 * np.abs(exact).max()
    assert kernel.values(x) == pytest.approx(kernel.values(x.astype(complex)).real, rel=1e-12, abs=1e-12)
    rows, columns = zip(*kernel.jacobian_places, strict=True)
    places = [kernel.inputs.index(c) for c in columns]
    assert np.array_equal(kernel.jacobian(x), J[:, list(rows), places])
    J[:, list(rows), places] = 0
    assert not J.any()
    assert len(kernel.targets) == J.shape[1]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mixed", [True, False])
def test_jacobian_at_a_point(kind, mixed):
    d = derive_line(Beam, Structure(), kind, mixed)
    symbols = [*d.variables, *map(se.Symbol, d.parameters)]
    values, partials = Kernel(symbols, d.outputs), d.derivatives
    x = np.random.default_rng(5).uniform(0.3, 1, (4, len(symbols)))
    exact = complex_step(values.oracle, x)
    found = Kernel(symbols, list(partials.values())).values(x)
    for (o, i), column in zip(partials, found.T, strict=True):
        assert column == pytest.approx(exact[:, o, i], rel=1e-10, abs=1e-10)
        exact[:, o, i] = 0
    assert not exact[..., : len(d.variables)].any()


@pytest.mark.parametrize("kind", KINDS)
def test_following_load(kind):
    law = LineLoad("wind", f1=0.4, f2=-1.2, following=True)
    mesh = bent(kind, 2)
    kernel = load_kernel(mesh, law, kind, given=("f2",))
    x = random_inputs(kernel, 2)
    exact = complex_step(kernel.values, x)
    assert np.abs(kernel.full_jacobian(x) - exact[..., :-1]).max() < 1e-10
    assert kernel.inputs[-1] == ("p", "f2")


def test_dead_load_is_constant():
    law, mesh = LineLoad("snow", f2=-2.0, following=False), bent(NodeKind.PLANAR, 2)
    kernel = load_kernel(mesh, law, NodeKind.PLANAR)
    values = kernel.values(random_inputs(kernel, 2)).reshape(2, 3, 3)
    assert values[..., 1] == pytest.approx(2.0 * mesh.lumped)
    assert not values[..., [0, 2]].any()
    assert mesh.lumped.sum() == pytest.approx(mesh.length)


def test_gyroscopic_moments():
    mesh = bent(NodeKind.SPATIAL, 2)
    kernel = GyroscopicKernel(mass_blocks(mesh, NUMBERS, NodeKind.SPATIAL), 3)
    x = random_inputs(kernel, 2)
    assert np.abs(kernel.full_jacobian(x) - complex_step(kernel.values, x)).max() < 1e-12
    assert np.einsum("mi,mi->m", x, kernel.values(x)) == pytest.approx(0, abs=1e-14)  # no power


# ---- physics at a point ------------------------------------------------------------------------------------------------


def product_of_quaternions(a, b):
    w = a[0] * b[..., 0] - b[..., 1:] @ a[1:]
    return np.concatenate([w[..., None], a[0] * b[..., 1:] + b[..., :1] * a[1:] + np.cross(a[1:], b[..., 1:])], axis=-1)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_rigid_motion_leaves_the_strains(order):
    """A common rotation, translation and length of all quaternions; the nodes are anywhere."""
    mesh = bent(NodeKind.SPATIAL, order)
    kernel = strain_kernel(mesh, NUMBERS, NodeKind.SPATIAL)
    x = random_inputs(kernel, 2)
    q = x[:, : 7 * (order + 1)].reshape(2, order + 1, 7)
    turn = np.array([0.3, -0.5, 0.7, 0.2])
    R = np.stack([product_of_quaternions(product_of_quaternions(turn, np.r_[0, e]), np.r_[turn[0], -turn[1:]])[1:]
                  for e in np.eye(3)], axis=-1) / (turn @ turn)
    moved = np.concatenate([q[..., :3] @ R.T + [5.0, -3.0, 2.0], product_of_quaternions(turn, q[..., 3:])], axis=-1)
    y = np.hstack([moved.reshape(2, -1), x[:, 7 * (order + 1) :]])
    before, after = (kernel.values(a)[:, 6 * (order + 1) :] for a in (x, y))
    assert after == pytest.approx(before, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("damping", [0.0, 0.2])
def test_power_of_internal_forces(kind, damping):
    """Forces . velocities = d(energy)/dt + dissipated power, the latter not negative."""
    mesh = bent(kind, 2)
    kernel = strain_kernel(mesh, {**NUMBERS, "damping": damping}, kind, mixed=False)
    nq, nu = kind.sizes
    rng = np.random.default_rng(11)
    q, u = rng.uniform(0.2, 1, (2, 3, nq)), rng.uniform(-1, 1, (2, 3, nu))
    velocities = u.reshape(2, -1) if damping else np.zeros((2, 0))
    x = np.hstack([q.reshape(2, -1), velocities])
    power = np.einsum("mi,mi->m", kernel.values(x)[:, : 3 * nu], u.reshape(2, -1)).sum()
    ahead, behind = ((q + s * 1e-6 * kernel.nodes.rates(q, u)).reshape(2, -1) for s in (1, -1))
    energies = [kernel.at_points(np.hstack([p, velocities]), [kernel.derived.energy]).sum() for p in (ahead, behind)]
    dissipated = kernel.at_points(x, [kernel.derived.dissipated]).sum()
    assert power == pytest.approx((energies[0] - energies[1]) / 2e-6 + dissipated, rel=1e-7)
    assert dissipated > 0 if damping else dissipated == 0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("damping", [0.0, 0.2])
def test_displacement_form_is_the_mixed_one_with_stresses_eliminated(kind, damping):
    mesh = bent(kind, 2)
    mixed, plain = (strain_kernel(mesh, {**NUMBERS, "damping": damping}, kind, m) for m in (True, False))
    x = random_inputs(plain, 2)
    stresses = plain.at_points(x, [e for _, e in plain.derived.resultants])
    full = mixed.values(np.hstack([x, stresses.reshape(2, -1)]))
    n = len(plain.targets)
    assert full[:, :n] == pytest.approx(plain.values(x), rel=1e-10, abs=1e-10)
    assert full[:, n:] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_several_lines_in_one_kernel(kind):
    stiff = {**NUMBERS, "compliance_M3": 1e-3}
    one, two = strain_kernel(bent(kind, 2), NUMBERS, kind), strain_kernel(polyline([(0, 0), (2, 1)], 3, 2), stiff, kind)
    both, x = merged([one, two]), random_inputs(one, 5)
    assert both.elements == 5
    assert np.array_equal(both.values(x), np.vstack([one.values(x[:2]), two.values(x[2:])]))
    with pytest.raises(LawError, match="different laws, orders"):
        merged([one, strain_kernel(bent(kind, 3), NUMBERS, kind)])


def test_rigid_strains_need_their_stress():
    with pytest.raises(OptionError, match="compliance_N1 = 0"):
        strain_kernel(bent(NodeKind.PLANAR, 1), {**NUMBERS, "compliance_N1": 0.0}, NodeKind.PLANAR, mixed=False)


def test_planar_is_spatial_in_the_plane():
    spatial, planar = (derive_line(Beam, Structure(frozenset({"damping"})), kind) for kind in reversed(KINDS))
    assert planar.stresses == ("N1", "N2", "M3")
    assert planar.vanished == ("N3", "M1", "M2")
    theta, slope = 0.7, 1.9
    half, c, s = slope / 2, np.cos(theta / 2), np.sin(theta / 2)
    values = {"theta": theta, "theta_xi": slope, "r1_xi": 0.4, "r2_xi": 1.1, "r3_xi": 0.0, "ds": 1.3, "weight": 0.6,
              "P1": c, "P2": 0, "P3": 0, "P4": s, "P1_xi": -s * half, "P2_xi": 0, "P3_xi": 0, "P4_xi": c * half}
    values |= {f"{kind}_{n}": 0.3 for kind in ("compliance", "reference") for n in STRESSES} | dict.fromkeys(STRESSES, 0.0)
    rows = [dict(zip(d.stresses, (float(e.subs(values)) for e in d.rows), strict=True)) for d in (spatial, planar)]
    assert {n: rows[0][n] for n in planar.stresses} == pytest.approx(rows[1])
    assert planar.mass == {(0, 0): se.Symbol("mass_per_length"), (1, 1): se.Symbol("mass_per_length"), (2, 2): se.Symbol("J3")}


def test_lines_need_axes():
    with pytest.raises(LawError, match="needs nodes that turn"):
        make_point(NodeKind.POINT)


def test_every_parameter_has_unit_and_meaning():
    assert all(p.unit and p.meaning for law in (Beam, LineLoad) for p in law.params.values())


def test_numbers_per_element_and_point():
    """Damping and compliance may change along the beam."""
    d, at = derive_line(Beam, Structure(frozenset({"damping"})), NodeKind.PLANAR), strain_points(2)
    constants = dict.fromkeys(d.parameters, 1.0) | {"compliance_N1": np.array([1.0, 2.0]), "ds": np.full((2, 2), 0.5)}
    kernel = LineKernel(d, at, constants)
    x = np.zeros((2, len(kernel.inputs)))
    x[:, kernel.inputs.index(("z", 0))] = 1.0
    rows = kernel.values(x)[:, kernel.targets.index(("z", 0))]
    assert rows[0] - rows[1] == pytest.approx(1.0)
