"""Derivatives of simple eigenvalues and Floquet multipliers by numbers of the scene."""

import numpy as np
import pytest
import sympy

import mbdae as mb


def oscillators(spring=8.0, damper=0.3, mass=2.0, count=1):
    s = mb.Scene("oscillators")
    for i in range(count):
        b = s.rigid_body(f"b{i}", mass, 1.0, at=(0, i))
        s.prismatic(f"P{i}", s.ground, b, at=(0, i), axis=(1, 0, 0), spring=spring, damper=damper)
    return s


def within(found, exact, share=1e-6):
    """The value is right within its error, and that is small."""
    assert abs(found.value - exact) <= found.error
    assert found.error <= share * abs(exact)


@pytest.mark.parametrize("damper", [0.0, 0.3, 9.0])
def test_an_oscillator(damper):
    """m z^2 + c z + k = 0: undamped, damped, and without oscillation (critical damping is 8)."""
    for mode in oscillators(damper=damper).linearize():
        z, g = mode.eigenvalue, mode.gradient(["P0.spring", "b0.mass"] + ["P0.damper"] * bool(damper))
        for name, by in {"P0.spring": 1.0, "b0.mass": z**2, "P0.damper": z}.items():
            if name in g:
                within(g[name], -by / (4 * z + damper))


def test_the_equilibrium_moves_with_the_number():
    """A rod on a spring under its weight: k a + w cos a = 0 with w = m g / 2, J z^2 + c z + k - w sin a = 0."""
    m, k, c, g = 1.0, 20.0, 0.2, 9.81
    s = mb.Scene("rod", gravity=(0, -g, 0))
    s.revolute("A", s.ground, s.link("r", (0, 0), (1, 0), mass=m), at=(0, 0), spring=k, damper=c)
    e = s.equilibrium()
    a, mode = e["A"].angle[0], s.linearize(at=e).modes[0]
    z, stiff, w = mode.eigenvalue, k - m * g / 2 * np.sin(a), m * g / 2
    found = mode.gradient(["A.spring", "r.mass"])
    within(found["A.spring"], -(1 + w * np.cos(a) * a / stiff) / (2 * m / 3 * z + c))
    by_mass = -g / 2 * np.sin(a) + w * np.cos(a) * g / 2 * np.cos(a) / stiff
    within(found["r.mass"], -(by_mass + z**2 / 3) / (2 * m / 3 * z + c))


def test_roots_that_coincide_are_refused_by_name():
    for s in (oscillators(count=2), oscillators(damper=8.0)):  # two alike; critical damping
        with pytest.raises(mb.DerivativeError, match=r"mode 1 with the root .* it is not simple"):
            s.linearize().modes[0].gradient("P0.spring")


def test_close_roots_are_told_apart():
    """Two oscillators whose frequencies differ by a thousandth: each root depends on its own spring alone."""
    s = mb.Scene("two")
    for i, k in enumerate((8.0, 8.016)):
        b = s.rigid_body(f"b{i}", 2.0, 1.0, at=(0, i))
        s.prismatic(f"P{i}", s.ground, b, at=(0, i), axis=(1, 0, 0), spring=k)
    modes = s.linearize().modes
    for i, mode in enumerate(modes):
        g = mode.gradient(["P0.spring", "P1.spring"])
        within(g[f"P{i}.spring"], -1 / (4 * mode.eigenvalue), 1e-6)
        assert abs(g[f"P{1 - i}.spring"].value) <= g[f"P{1 - i}.spring"].error


def test_what_has_none_is_said():
    s = oscillators()
    r = s.simulate(0.1)
    with pytest.raises(mb.DerivativeError, match="a state of a run"):
        s.linearize(at=r).modes[0].gradient("P0.spring")
    with pytest.raises(mb.MbdaeError, match="nobody"):
        s.linearize().modes[0].gradient("nobody.mass")


def test_a_multiplier_of_constant_equations():
    """mu = exp(z T) of an oscillator, dmu = T mu dz; to the accuracy of multipliers."""
    T = 1.0
    mode = oscillators().floquet(T, accuracy=1e-9).modes[0]
    z = -0.075 + 1j * np.sqrt(4 - 0.075**2)
    g = mode.gradient(["P0.spring", "P0.damper"])
    within(g["P0.spring"], -T * mode.multiplier / (4 * z + 0.3), 1e-4)
    within(g["P0.damper"], -T * mode.multiplier * z / (4 * z + 0.3), 1e-4)


def test_a_multiplier_of_a_parametric_oscillator():
    """Against differences of multipliers themselves, of order 4 and further apart."""
    def made(depth):
        s = mb.Scene("parametric")
        b = s.rigid_body("b", 1.0, 1.0, at=(0, 0))
        s.prismatic("P", s.ground, b, at=(0, 0), axis=(1, 0, 0), spring=1.3, damper=0.1)
        s.force("F", b, (-mb.number("depth", depth) * sympy.cos(2 * mb.t) * s.sensor("P.displacement"), 0, 0))
        return s

    def largest(depth):
        return made(depth).floquet(np.pi, accuracy=1e-9).multipliers[0]

    mode = made(0.4).floquet(np.pi, accuracy=1e-9).modes[0]
    d, h = mode.gradient("depth")["depth"], 0.02
    near = (8 * (largest(0.4 + h) - largest(0.4 - h)) - largest(0.4 + 2 * h) + largest(0.4 - 2 * h)) / (12 * h)
    assert abs(d.value - near) <= d.error + 1e-4 * abs(near)
    assert d.error < 1e-4 * abs(near)
