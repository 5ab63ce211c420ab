"""Accelerations, drives, lengths and stresses of fibres against formulas of their own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sympy as sp

import mbdae as mb
from mbdae.laws.beam import table
from mbdae.results.beams import Fields, angular_accelerations, angular_velocities
from mbdae.results.clearance import Fibre

t, G = mb.t, 9.81


def rate(r: Any, path: str, at: float) -> Any:
    """The derivative of a sensor by central differences of the dense output, order 4."""
    h = 1e-4
    a, b, c, d = r(np.array([at - 2 * h, at - h, at + h, at + 2 * h])).read(path)
    return (a - 8 * b + 8 * c - d) / (12 * h)


def test_accelerations_in_the_plane() -> None:
    s = mb.Scene("arm", gravity=(0, -G, 0))
    a, b = s.link("a", (0, 0), (1, 0.2), mass=1.0), s.link("b", (1, 0.2), (2, 0), mass=2.0)
    s.revolute("A", s.ground, a, at=(0, 0), torque=3 * sp.sin(2 * t))
    s.revolute("B", a, b, at=(1, 0.2), spring=5.0, damper=0.1)
    s.spring("k", s.ground, b, (0, 1), (2, 0), 20.0, damping=0.3, length=0.5)
    r = s.simulate(2.0, accuracy=1e-9, outputs=11)
    for at in (0.4, 1.3):
        here = r(at)
        for place in ("a", "b", "b.at(2, 0)"):
            np.testing.assert_allclose(here[place].acceleration[0], rate(r, f"{place}.velocity", at), atol=2e-5)
            np.testing.assert_allclose(here[place].angular_acceleration[0], rate(r, f"{place}.angular_velocity", at), atol=2e-5)
    # Newton on the whole: mass times acceleration is gravity, bearing and spring
    total = 1.0 * r["a"].acceleration + 2.0 * r["b"].acceleration
    np.testing.assert_allclose(total, np.array([0, -3.0 * G, 0]) + r["A"].force + r["k"].force, atol=1e-9)
    d = r["b.at(2, 0)"].position - [0, 1, 0]
    length = np.linalg.norm(d, axis=1)
    np.testing.assert_allclose(r["k"].length, length, rtol=1e-14)
    np.testing.assert_allclose(r["k"].rate, np.sum(d * r["b.at(2, 0)"].velocity, axis=1) / length, atol=1e-12)
    np.testing.assert_allclose(r["A"].drive, 3 * np.sin(2 * r.t), atol=1e-14)
    pull = 20.0 * (length - 0.5) + 0.3 * r["k"].rate
    np.testing.assert_allclose(r["k"].force, -pull[:, None] * d / length[:, None], atol=1e-10)
    with pytest.raises(mb.OptionError, match="'B' has no drive: none of its coordinates is prescribed or loaded"):
        r["B"].drive  # noqa: B018


@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical(), mb.Recursive()])
def test_the_drive_of_a_prescribed_angle(model: Any) -> None:
    """Angular momentum of both links about the bearing."""
    s = mb.Scene("driven", gravity=(0, -G, 0))
    a, b = s.link("a", (0, 0), (1, 0), mass=3.0), s.link("b", (1, 0), (2, 0), mass=1.0)
    s.revolute("A", s.ground, a, at=(0, 0), angle=0.3 * sp.sin(2 * t), model=model)
    s.revolute("B", a, b, at=(1, 0), damper=2.0)
    r = s.simulate(2.0, accuracy=1e-8, outputs=51)
    torque = sum(m * np.cross(r[n].position, r[n].acceleration)[:, 2] + m / 12 * r[n].angular_acceleration[:, 2]
                 + m * G * r[n].position[:, 0] for n, m in (("a", 3.0), ("b", 1.0)))
    np.testing.assert_allclose(r["A"].drive, torque, atol=1e-6)
    assert np.max(np.abs(torque)) > 20
    assert "drive" in dir(r["A"])
    assert "drive" not in dir(r["B"])


def test_the_drives_of_several_coordinates() -> None:
    s = mb.Scene("sleeve")
    body = s.rigid_body("m", 2.0, (0.1, 0.1, 0.1), at=(0, 0, 0))
    s.cylindrical("C", s.ground, body, at=(0, 0, 0), axis=(0, 0, 1), prescribed={"angle": t**2}, load={"displacement": 3.0})
    r = s.simulate(1.0, accuracy=1e-7)
    np.testing.assert_allclose(r["C"].drive_angle, 0.1 * 2, atol=1e-7)
    np.testing.assert_allclose(r["C"].drive_displacement, 3.0, atol=1e-12)
    with pytest.raises(mb.OptionError, match="has no drive: it has drive_displacement, drive_angle"):
        r["C"].drive  # noqa: B018


def test_accelerations_in_space() -> None:
    """A top: Euler's equations in the body's axes."""
    J = np.array([0.02, 0.05, 0.06])
    s = mb.Scene("top", gravity=(0, 0, -G))
    s.rigid_body("b", 2.0, tuple(J), at=(0.1, 0, 0.3), angular_velocity=(1, 2, 30))
    s.spherical("S", s.ground, s["b"], at=(0, 0, 0))
    r = s.simulate(1.0, accuracy=1e-8, outputs=41)
    R, w, alpha = r["b"].rotation, r["b"].angular_velocity, r["b"].angular_acceleration
    inertia = np.einsum("tij,j,tkj->tik", R, J, R)
    moment = np.cross(-r["b"].position, r["S"].force)
    spin = np.einsum("tij,tj->ti", inertia, w)
    np.testing.assert_allclose(np.einsum("tij,tj->ti", inertia, alpha) + np.cross(w, spin), moment, atol=1e-8)
    np.testing.assert_allclose(r["b"].acceleration, r["S"].force / 2.0 + [0, 0, -G], atol=1e-9)
    np.testing.assert_allclose(r["b"].at((0, 0, 0)).acceleration, 0, atol=1e-6)  # the pivot


@pytest.mark.parametrize("flat", [True, False])
def test_accelerations_of_beams(flat: bool) -> None:
    """The second rates are the rate of the rates, moved by velocities and accelerations; Newton on the whole beam."""
    section = mb.Section.rectangular(0.02, 0.01, 7e10, 0.3, 2700)
    s = mb.Scene("beam", gravity=(0, -G, 0 if flat else 3.0))
    beam = s.beam("b", (0, 0), (1, 0), section=section, elements=3)
    s.weld("W", s.ground, beam.at(0))
    r = s.simulate(0.02, accuracy=1e-4, outputs=5)
    line = r.prepared.model.lines[0]
    fields, h = Fields(line, table(line.mesh.order, np.array([0.3])), 1), 1e-6
    q, u, a = r.q, r.u, r.acceleration
    nodes = r.prepared.model.nodes
    qd = np.zeros_like(q)
    for node in nodes:
        at_q, at_u = slice(node.q, node.q + node.kind.sizes[0]), slice(node.u, node.u + node.kind.sizes[1])
        qd[:, at_q] = fields.nodes.rates(q[:, None, at_q], u[:, None, at_u])[:, 0]
    before, after = (fields.rates(q + d * qd, u + d * a) for d in (-h, h))
    second = fields.second_rates(q, u, a)
    scale = np.max(np.abs(second))
    np.testing.assert_allclose(second, (after - before) / (2 * h), atol=1e-7 * scale)
    P = [fields.positions(q + d * qd) for d in (-h, 0, h)]
    spins = [angular_velocities(line, p, v) for p, v in ((P[0], before), (P[2], after))]
    alpha = angular_accelerations(line, P[1], fields.rates(q, u), second)
    np.testing.assert_allclose(alpha, (spins[1] - spins[0]) / (2 * h), atol=1e-6 * np.max(np.abs(alpha)))
    mass = section.mass_per_length
    force = mass * r["b"].acceleration
    np.testing.assert_allclose(force[:, 1], -mass * G + r["W"].force[:, 1], atol=1e-6 * np.max(np.abs(force)))
    assert r["b.at(1.0)"].acceleration.shape == (5, 3)


def test_stress_of_fibres() -> None:
    """A short stiff cantilever under small forces: stresses by the formulas of a textbook, at a point 0.5 m from the load."""
    w, h, E = 0.04, 0.02, 2e11
    section = mb.Section.rectangular(w, h, E, 0.3, 7800)
    s = mb.Scene("cantilever")
    beam = s.beam("b", (0, 0, 0), (1, 0, 0), section=section, elements=4)
    s.weld("W", s.ground, beam.at(0))
    s.force("F", beam.at(1.0), (100.0, 10.0, 5.0))
    r = s.simulate(1e-4, accuracy=1e-3, outputs=3)
    for y, z in ((h / 2, w / 2), (-h / 2, 0), (0.3 * h, -0.2 * w)):
        place = r[f"b.at(0.5, {y}, {z})"]
        N1, _, _, _, M2, M3 = place.stress_resultants.T
        sigma = N1 / (w * h) + M2 * z / (h * w**3 / 12) - M3 * y / (w * h**3 / 12)
        np.testing.assert_allclose(place.fibre_stress, sigma, rtol=1e-12)
    with pytest.raises(mb.OptionError, match=r"outside of its section, a rectangle of 0.04 m by 0.02 m"):
        r["b.at(0.5, 0.2, 0)"].fibre_stress  # noqa: B018


def test_shear_stress_has_the_resultants() -> None:
    """Normal and shear stresses integrated over a section give forces and moments back; von Mises of pure states."""
    R = np.array([[120.0, 30.0, -20.0, 0.0, 4.0, 7.0]])
    n = 400
    w, h = 0.04, 0.02
    section = mb.Section.rectangular(w, h, 2e11, 0.3, 7800)
    x2, x3 = ((np.arange(n) + 0.5) / n - 0.5) * h, ((np.arange(n) + 0.5) / n - 0.5) * w
    dA = (h / n) * (w / n)
    grid2, grid3 = np.meshgrid(x2[::20] + 9.5 * h / n, x3[::20] + 9.5 * w / n, indexing="ij")
    sigma = np.array([[Fibre(section, a, b, "").normal(R)[0] for b in grid3[0]] for a in grid2[:, 0]])
    assert np.sum(sigma) * dA * 400 == pytest.approx(120.0)
    assert np.sum(sigma * grid3) * dA * 400 == pytest.approx(4.0, rel=5e-3)
    assert -np.sum(sigma * grid2) * dA * 400 == pytest.approx(7.0, rel=5e-3)
    along2 = np.array([Fibre(section, a, 0, "").shear(R)[0, 0] for a in x2])
    assert np.sum(along2) * w * h / n == pytest.approx(30.0, rel=1e-4)
    assert Fibre(section, 0, 0, "").shear(R)[0, 0] == pytest.approx(1.5 * 30.0 / (w * h))
    outer, inner = 0.02, 0.012
    tube = mb.Section.tube(outer, inner, 2e11, 0.3, 7800)
    twisted = np.array([[0.0, 0.0, 0.0, 5.0, 0.0, 0.0]])
    polar = np.pi / 2 * (outer**4 - inner**4)
    assert Fibre(tube, 0, outer, "").von_mises(twisted)[0] == pytest.approx(np.sqrt(3) * 5.0 * outer / polar)
    x = (np.arange(4000) + 0.5) / 4000 * outer
    width = 2 * (np.sqrt(outer**2 - x**2) - np.sqrt(np.maximum(inner**2 - x**2, 0)))
    shear = np.array([Fibre(tube, a, np.sqrt(max(inner**2 - a**2, 0)), "").shear(R)[0, 0] for a in x])
    assert 2 * np.sum(shear * width) * outer / 4000 == pytest.approx(30.0, rel=1e-4)
    assert Fibre(tube, outer, 0, "").von_mises(R)[0] == pytest.approx(
        np.sqrt(Fibre(tube, outer, 0, "").normal(R)[0] ** 2 + 3 * Fibre(tube, outer, 0, "").shear(R)[0, 1] ** 2))
    bare = mb.Section(EA=1e6, GA2=1e6, GA3=1e6, GJ=1e3, EI2=1e3, EI3=1e3, mass_per_length=1.0, rotary_inertia=1e-3)
    with pytest.raises(mb.OptionError, match="stiffnesses and no shape"):
        Fibre(bare, 0, 0, "beam 'b'").normal(R)
