"""Equilibria of beams against closed forms and converged solutions of the rod equations."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mbdae.laws.line_mesh import curved, polyline
from mbdae.scene.shapes import Section

E = 1e7  #: of the 45 degree bend (Bathe and Bolourchi 1979): unit square, nu = 0, radius 100
BEND = {"EA": E, "GA2": E / 2 * 5 / 6, "GA3": E / 2 * 5 / 6, "GJ": E / 2 / 6, "EI2": E / 12, "EI3": E / 12}
BEND_TIP = np.array([47.1500962403429, 15.68468947898003, 53.475477998225315])  #: P = 600, converged shooting, 1e-11
RIGID_BEND_TIP = np.array([47.151294400305964, 15.68507816215816, 53.468598489447444])  #: the same, EA = GA = infinite
INERTIA = {"mass_per_length": 1.0, "rotary_inertia": 1.0}
PRINCETON = json.loads((Path(__file__).parent / "princeton_beam.json").read_text(encoding="utf-8"))
#: Mattiasson 1981, cantilever elastica: P L^2 / EI, sag / L, shortening / L, tip angle
ELASTICA = [(1.0, 0.30172077379981355, 0.056433236283377264, 0.4613519497118786),
            (10.0, 0.8106090248802966, 0.5549955977537513, 1.4302855388038587)]


def bend(s):
    return (100 * np.sin(s * np.pi / 4), 100 * (1 - np.cos(s * np.pi / 4)), 0)


def slender(ratio, EI=1.0):
    """Section of a beam of length 1 with L/h = ratio."""
    EA = 12 * EI * ratio**2
    return Section(EA, EA / 2.6, EA / 2.6, EI, EI, EI, **INERTIA).numbers


def bend_error(structure, order, elements, section=BEND, tip=BEND_TIP):
    S = structure(curved(bend, elements, order), Section(**section, **INERTIA).numbers)
    q, _, iterations = S.equilibrium(S.tip_load(0, 0, 600, 0, 0, 0), steps=2)
    assert iterations <= 16
    return np.linalg.norm(q[-1, :3] - tip) / np.linalg.norm(tip)


@pytest.mark.parametrize(("order", "elements", "bound"), [(2, 8, 5e-5), (3, 8, 1e-7), (3, 16, 2e-9), (4, 8, 2e-10)])
def test_bend_of_45_degrees(structure, order, elements, bound):
    assert bend_error(structure, order, elements) < bound


@pytest.mark.parametrize("order", [1, 2, 3])
def test_error_falls_with_the_power_2p_of_the_mesh(structure, order):
    coarse, fine = bend_error(structure, order, 8), bend_error(structure, order, 16)
    assert np.log2(coarse / fine) == pytest.approx(2 * order, abs=0.3)


def test_zero_compliance(structure):
    """Inextensible and rigid in shear: strains become constraints, their stresses stay unknowns."""
    rigid = {**BEND, "EA": np.inf, "GA2": np.inf, "GA3": np.inf}
    assert bend_error(structure, 3, 16, rigid, RIGID_BEND_TIP) < 2e-9


@pytest.mark.parametrize(("order", "elements"), [(2, 16), (3, 4)])
def test_princeton_beam(structure, order, elements):
    """21 cases of load and angle: converged Cosserat shooting (reference values, relative 1e-6 of the length)."""
    L, mesh = PRINCETON["L"], polyline([(0, 0, 0), (PRINCETON["L"], 0, 0)], elements, order)
    S = structure(mesh, Section(**PRINCETON["section"], **INERTIA).numbers)
    for case in PRINCETON["cases"]:
        angle = np.radians(case["theta_deg"])
        q, _, _ = S.equilibrium(S.tip_load(0, case["P"] * np.sin(angle), case["P"] * np.cos(angle), 0, 0, 0))
        assert q[-1, :3] - S.q0[-1, :3] == pytest.approx(np.array(case["u"]), abs=1e-6 * L)


@pytest.mark.parametrize(("order", "elements", "bound"), [(2, 16, 2e-5), (3, 16, 1e-8)])
@pytest.mark.parametrize("ratio", [10, 1e2, 1e4])
def test_roll_up_into_a_full_circle(structure, order, elements, bound, ratio):
    S = structure(polyline([(0, 0), (1, 0)], elements, order), slender(ratio))
    q, _, iterations = S.equilibrium(S.tip_load(0, 0, 0, 0, 0, 2 * np.pi))
    assert np.linalg.norm(q[-1, :3]) < bound
    assert iterations <= 11


@pytest.mark.parametrize("ratio", [10, 1e2, 1e4])
@pytest.mark.parametrize(("order", "bound"), [(1, 2e-3), (2, 2e-6), (3, 1e-9)])
def test_planar_roll_up_into_a_half_circle(structure, ratio, order, bound):
    S = structure(polyline([(0, 0), (1, 0)], 16, order), slender(ratio), planar=True)
    q, z, _ = S.equilibrium(S.tip_load(0, 0, np.pi))
    assert q[-1] == pytest.approx([0, 2 / np.pi, np.pi], abs=bound)
    assert z[:, 2::3] == pytest.approx(np.pi, rel=1e-9)  # the moment is the same everywhere


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize(("load", "sag", "shortening", "angle"), ELASTICA)
def test_elastica_under_a_tip_load(structure, planar, load, sag, shortening, angle):
    rigid = Section(np.inf, np.inf, np.inf, 1, 1, 1, **INERTIA).numbers
    S = structure(polyline([(0, 0), (1, 0)], 16, 3), rigid, planar)
    q, _, _ = S.equilibrium(S.tip_load(0, load, *(0,) * (S.nu - 2)), steps=4)
    turned = q[-1, 2] if planar else 2 * np.arctan2(q[-1, 6], q[-1, 3])
    assert [q[-1, 1], 1 - q[-1, 0], turned] == pytest.approx([sag, shortening, angle], abs=1e-6)


@pytest.mark.parametrize(("planar", "order"), [*((True, order) for order in (1, 2, 3)), (False, 1), (False, 2),
                                               pytest.param(False, 3, marks=pytest.mark.slow)])
def test_slenderness_does_not_lock(structure, planar, order):
    """Tip load P L^2 / EI = 3: the error is that of bending, whatever the thickness."""
    errors = []
    for ratio in (10, 1e2, 1e4):
        tips = []
        for elements in (8, 32):
            S = structure(polyline([(0, 0), (1, 0)], elements, order), slender(ratio), planar)
            q, _, _ = S.equilibrium(S.tip_load(0, 3, *(0,) * (S.nu - 2)), steps=2)
            tips.append(q[-1, :2])
        errors.append(np.linalg.norm(tips[0] - tips[1]))
    assert errors[2] < 1.1 * errors[0]
    assert errors[0] < {1: 4e-3, 2: 3e-5, 3: 1e-7}[order]


@pytest.mark.parametrize("planar", [True, False])
def test_tangent_is_symmetric_in_equilibrium_under_dead_loads(structure, planar):
    mesh = polyline([(0, 0), (1, 0), (1.3, 0.8)], 6, 2)  # a corner too
    S = structure(mesh, slender(20), planar)
    load = np.random.default_rng(2).uniform(-0.2, 0.2, (S.nodes, S.nu))
    load[:, 2 if planar else 3 :] = 0
    q, z, _ = S.equilibrium(load, steps=2)
    K = S.tangent(q, z)[S.nu :, S.nu :]
    assert np.abs(K - K.T).max() < 1e-9 * np.abs(K).max()


@pytest.mark.parametrize("planar", [True, False])
def test_reference_is_free_of_stress(structure, planar):
    S = structure(curved(lambda s: (s, s**2 - s**3), 3, 2), slender(20), planar)
    forces, rows = S.internal(S.q0, np.zeros((S.m, S.nz)))
    assert not forces.any()
    assert np.abs(rows).max() < 1e-16


@pytest.mark.parametrize("planar", [True, False])
def test_rigid_corner(structure, planar):
    """L-shaped cantilever, linear theory: u = F (a b^2 + b^3 / 3) / EI + F b / GA + F a / EA across the second leg."""
    a, b, F = 2.0, 1.0, 1e-6
    section = Section(50.0, 20.0, 20.0, 1.0, 1.0, 2.0, **INERTIA)
    S = structure(polyline([(0, 0), (a, 0), (a, b)], [2, 2], 2), section.numbers, planar)
    q, _, _ = S.equilibrium(S.tip_load(F, *(0,) * (S.nu - 1)))
    assert (q[-1, 0] - S.q0[-1, 0]) / F == pytest.approx((a * b**2 + b**3 / 3) / 2 + b / 20 + a / 50, rel=1e-4)
    assert (q[-1, 1] - S.q0[-1, 1]) / F == pytest.approx(-(a**2) * b / 2 / 2, rel=1e-4)


def test_lateral_buckling_of_a_strip(structure):
    """Timoshenko and Gere: P = 4.0126 sqrt(EI_soft GJ) / L^2, raised by the sag before it buckles; good to 1-3 %."""
    section = PRINCETON["section"]
    soft, stiff, GJ, L = section["EI3"], section["EI2"], section["GJ"], PRINCETON["L"]
    expected = 4.0126 * np.sqrt(soft * GJ) / L**2 / np.sqrt((1 - soft / stiff) * (1 - GJ / stiff))
    S = structure(polyline([(0, 0, 0), (L, 0, 0)], 6, 3), Section(**section, **INERTIA).numbers)

    def stable(P):
        q, z, _ = S.equilibrium(S.tip_load(0, 0, P, 0, 0, 0), steps=2)
        K = S.tangent(q, z)[S.nu :, S.nu :]
        n = (S.nodes - 1) * S.nu
        condensed = K[:n, :n] - K[:n, n:] @ np.linalg.solve(K[n:, n:], K[n:, :n])
        return np.linalg.eigvalsh((condensed + condensed.T) / 2)[0] > 0

    assert stable(0.97 * expected)
    assert not stable(1.03 * expected)
