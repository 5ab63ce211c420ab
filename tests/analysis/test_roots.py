"""Roots with bounds of their errors, and verdicts that follow from them: against closed forms and exact equations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sympy as sp
from known_roots.check import judge

import mbdae as mb
from mbdae.analysis.roots import EPS, roots, sign

G = 9.81


def test_random_scenes_against_their_exact_equations() -> None:
    """Every fifth seed is one of five kinds of scenes, from 1000 on of three; the claim `known_roots` measures 600."""
    for found in judge([*range(15), *range(1000, 1006)]):
        assert found.error == 0, found.note


def test_a_stiff_damper_beside_hides_no_growth() -> None:
    """An inverted pendulum beside 1 g on a damper of 1e5 N s/m, whose root is 2.6e7 times as large."""
    s = mb.Scene("beside", gravity=(0, -G, 0))
    s.revolute("A", s.ground, s.link("a", (0, 0), (0, 1), mass=1.0), at=(0, 0))
    s.prismatic("B", s.ground, s.rigid_body("b", 1e-3, 1e-6, at=(1, 0)), at=(1, 0), axis=(1, 0, 0), damper=1e5, spring=1e3)
    found = s.linearize()
    c = 1e5 / 1e-3
    exact = np.sort([-np.sqrt(1.5 * G), np.sqrt(1.5 * G), -(c + np.sqrt(c * c - 4e6)) / 2, -2e6 / (c + np.sqrt(c * c - 4e6))])
    off = np.abs(np.sort(found.growth) - exact)
    assert np.all(off <= found.errors[np.argsort(found.growth)])
    assert found.stable is False
    assert np.all(found.errors <= 1e-13 * np.abs(found.eigenvalues))


@pytest.mark.parametrize("up", [1, -1])
def test_creep_of_a_damped_hinge(up: int) -> None:
    """J x'' + c x' - up m g l x = 0: one slow root, m g l / c, and its sign is known."""
    s = mb.Scene("creep", gravity=(0, -G, 0))
    s.revolute("A", s.ground, s.link("a", (0, 0), (0, up), mass=1.0), at=(0, 0), damper=1e8)
    found = s.linearize()
    assert found.eigenvalues[1].real == pytest.approx(up * G / 2 / 1e8, rel=1e-9)
    assert found.stable is (up < 0)


def test_what_rounding_leaves_open_is_none() -> None:
    """A standing pendulum on a stiff spring whose stiffness is that of its weight: the difference is below rounding."""
    s = mb.Scene("open", gravity=(0, -G, 0))
    s.revolute("A", s.ground, s.rigid_body("a", 0.3, 1.0, at=(0, 0.7)), at=(0, 0), spring=0.3 * G * 0.7)
    found = s.linearize()
    assert found.stable is None
    assert np.all(np.abs(found.growth) <= found.errors)


@pytest.mark.parametrize("ratio", [1.0, 1e8, 1e16])
def test_conservative_scenes_are_never_undecided(ratio: float) -> None:
    """A chain of masses, one of whose springs is `ratio` times as stiff: the soft ones may be lost, the verdict is not."""
    s, before = mb.Scene("chain"), None
    for i, k in enumerate((1.0, ratio, 2.0)):
        body = s.rigid_body(f"b{i}", 1.0 + i, 1.0, at=(i, 0))
        s.prismatic(f"P{i}", before or s.ground, body, at=(i, 0), axis=(1, 0, 0), spring=k)
        before = body
    found = s.linearize()
    assert found.stable is True
    assert np.all(found.growth == 0)


@pytest.mark.parametrize(("axis", "stable"), [(0, True), (1, False), (2, True)])
def test_free_body_in_its_own_axes(axis: int, stable: bool) -> None:
    """Shifts of a free body turn with its axes and drift: they do not grow. Its spin about the middle axis does."""
    s = mb.Scene("free", space="spatial")
    body = s.rigid_body("b", 1.0, tuple(np.roll([1.0, 2.0, 3.0], -axis)), angular_velocity=(5.0, 0, 0))
    assert s.linearize(frame=body).stable is stable


def test_equal_and_missing_vectors() -> None:
    """Critical damping, a double root with one vector: its bound is of the size of the root of the errors, and contains it."""
    E, A = np.eye(2), np.array([[0.0, -1.0], [1.0, 2.0]])
    found = roots(E, A, 0 * E, EPS * np.abs(A))
    assert np.all(np.abs(found.values + 1) <= found.errors)
    assert np.all(found.errors < 1e-6)
    assert not found.alone.any()


def test_signs_of_matrices_with_errors() -> None:
    S = np.diag([1e16, 1.0])
    assert sign(S, EPS * S) == 1
    assert sign(np.diag([1e16, -1.0]), EPS * S) == -1
    assert sign(np.array([[1e16, 1e16], [1e16, 1e16]]), np.full((2, 2), 2.0)) == 0
    assert sign(np.zeros((2, 2)), np.zeros((2, 2))) == 1


def test_a_stiff_spring_hides_no_stiffness_from_an_equilibrium() -> None:
    """A standing pendulum on a soft spring beside 1 g on a spring of 1e14 N/m: at rest, by itself."""
    s = mb.Scene("beside", gravity=(0, -G, 0))
    s.revolute("A", s.ground, s.link("a", (0, 0), (0, 1), mass=1.0), at=(0, 0), spring=20.0)
    s.prismatic("B", s.ground, s.rigid_body("b", 1e-3, 1e-6, at=(1, 0)), at=(1, 0), axis=(1, 0, 0), spring=1e14)
    rest = s.equilibrium()
    assert rest.unstable == 0
    found = s.linearize(at=rest)
    assert found.frequencies[0] * 2 * np.pi == pytest.approx(np.sqrt(3 * (20 - G / 2)), rel=1e-12)
    assert found.stable is True


def test_slow_growth_beside_a_short_stiff_beam() -> None:
    """An inverted pendulum beside a beam of 20 mm, whose lowest frequency is 4e4 times its growth."""
    tube = mb.Section.tube(outer=0.012, inner=0.010, E=210e9, nu=0.3, rho=7850.0)
    s = mb.Scene("beside", gravity=(0, -G, 0))
    s.weld("root", s.ground, s.beam("beam", (0, 0), (0.02, 0), section=tube, elements=2), at=(0, 0))
    s.revolute("A", s.ground, s.link("a", (2, 0), (2, 1), mass=1.0), at=(2, 0))
    found = s.linearize(at=s.equilibrium(), count=3)
    assert np.max(found.growth) == pytest.approx(np.sqrt(1.5 * G), rel=1e-10)
    assert found.stable is False


def held(force: Any = None, **joint: Any) -> mb.Scene:
    """A mass of 2 kg on a spring of 20 N/m with something else that acts on it."""
    s = mb.Scene("kinks")
    s.prismatic("J", s.ground, s.rigid_body("b", 2.0, 1.0, at=(0, 0)), at=(0, 0), axis=(1, 0, 0), spring=20.0, **joint)
    if force is not None:
        s.force("F", "b", (force(s.sensor("J.displacement")), 0, 0))
    return s


@pytest.mark.parametrize(("scene", "name", "squares"), [
    (held(limits=(None, 0.0), stop=mb.Stop(180.0)), "J", (100, 10)),
    (held(lambda x: -10 * sp.Abs(x)), "F", (15, 5)),
    (held(lambda x: sp.Piecewise((-60 * x, x > 0), (-20 * x, True))), "F", (40, 20)),
    (held(mb.curve([-1, 0, 1], [20, 0, -60])), "F", (40, 20)),
], ids=["stop that just touches", "Abs", "Piecewise", "curve"])
def test_a_kink_at_the_state_is_told(scene: mb.Scene, name: str, squares: tuple[float, float]) -> None:
    """w^2 = k / m on either side of x = 0."""
    with pytest.warns(mb.AccuracyWarning, match=f"'{name}' has a kink exactly at this state"):
        found = scene.linearize()
    assert found.stable is None
    got = [abs(side.eigenvalues[0]) ** 2 for side in found.sides]
    assert sorted(got) == pytest.approx(sorted(squares), rel=1e-6)
    with pytest.warns(mb.AccuracyWarning, match="kink"):
        assert scene.floquet(0.3).stable is None
    with pytest.warns(mb.AccuracyWarning, match="kink"):
        scene.equilibrium()


@pytest.mark.parametrize("scene", [
    held(limits=(None, 1e-6), stop=mb.Stop(180.0)), held(lambda x: -10 * x * sp.Abs(x)), held(lambda x: -sp.tanh(x / 1e-4)),
    held(mb.curve([-1, 0, 1], [60, 0, -60])),
], ids=["stop beside", "x |x|", "tanh", "straight curve"])
def test_what_is_smooth_is_no_kink(scene: mb.Scene) -> None:
    found = scene.linearize()  # warnings are errors
    assert found.stable is True
    assert found.sides == ()
