"""Large trees beside constraints: loops, joints that stay kinematic, couplings."""

import numpy as np
import pytest

import mbdae as mb
from mbdae.formulations import GGL
from mbdae.system.prepare import prepare

from .scenes import R, chain
from .test_ordered import as_in


def held_at_both_ends(model):
    """A spatial chain of 12 bodies whose last one a spherical joint holds, and a pendulum that hangs on the sixth."""
    s = chain(12, model=model)
    bodies = {b.name: b for b in s.bodies}
    last = s.rigid_body("last", 1.0, (0.01, 0.02, 0.03), at=(1.25, 0, 0))
    s.spherical("j12", bodies["b11"], last, at=(1.2, 0, 0), model=model)
    s.spherical("held", last, s.ground, at=(1.3, 0.1, 0), model=mb.Kinematic())
    hanging = s.rigid_body("hanging", 0.5, (0.01, 0.01, 0.02), at=(0.6, -0.2, 0))
    s.revolute("hung", bodies["b5"], hanging, at=(0.6, 0, 0), axis=(1, 0, 0.2), model=mb.Kinematic(), spring=1.0)
    return s


def on_a_free_body(model):
    """The same chain on a body that a spherical joint holds."""
    s = mb.Scene("on a body", gravity=(0, -9.81, 0))
    last = s.rigid_body("root", 3.0, (0.1, 0.2, 0.3), at=(0, 0, 0))
    s.spherical("held", last, s.ground, at=(0.1, 0.2, 0), model=mb.Kinematic())
    for i in range(10):
        body = s.rigid_body(f"b{i}", 1.0, (0.01, 0.02, 0.03), at=(0.1 * i + 0.05, 0, 0))
        s.revolute(f"j{i}", last, body, at=(0.1 * i, 0, 0), axis=(0, 0, 1) if i % 2 else (0, 1, 0.3), model=model)
        last = body
    s.point_on_plane("slides", last, s.ground, at=(1.0, 0, 0), axis=(0, 1, 0), model=mb.Kinematic())
    return s


SCENES = [held_at_both_ends, on_a_free_body]


@pytest.mark.parametrize("form", [GGL(), mb.Index1()], ids=["GGL", "Index1"])
@pytest.mark.parametrize("scene", SCENES)
def test_the_equations_hold_where_kinematic_joints_move(scene, form):
    """At states, accelerations and multipliers of the scene with kinematic joints, all rows vanish."""
    p, other = prepare(scene(R)), prepare(scene(mb.Kinematic()))
    assert p.all_bodies.moved.ordered
    system = scene(R).system(form)
    assert system.assembly.moved.ordered
    F = np.empty(system.n)
    system.residual(0.0, system.y0, system.yp0, F)
    assert np.max(np.abs(F)) < 1e-9
    start = other.start
    assert np.max(np.abs(as_in(other, p, p.start.acceleration[None], "u")[0] - start.acceleration)) < 1e-9


@pytest.mark.parametrize(("scene", "form"), [(held_at_both_ends, GGL()), (on_a_free_body, GGL()), (on_a_free_body, mb.Index1())])
def test_the_jacobian_is_that_of_differences(scene, form):
    system = scene(R).system(form)
    rng = np.random.default_rng(1)
    y, yp = system.y0 + 0.1 * rng.normal(size=system.n), system.yp0 + 0.1 * rng.normal(size=system.n)
    h, n = 1e-5, system.n
    for k, exact in enumerate(system.jacobian_parts(0.0, y, yp)):
        D, found = np.empty((n, n)), np.empty((4, n))
        for j, step in enumerate(h * np.eye(n)):
            for row, by in zip(found, (1, -1, 2, -2), strict=True):
                system.residual(0.0, y + by * step * (k == 0), yp + by * step * (k == 1), row)
            D[:, j] = (8 * (found[0] - found[1]) - (found[2] - found[3])) / (12 * h)
        assert np.max(np.abs(exact - D)) < 1e-8 * np.max(np.abs(exact))


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("solver", [pytest.param(mb.RadauIIA(3), marks=pytest.mark.slow), None])
def test_runs_agree_with_kinematic_joints(scene, solver):
    runs = [scene(model).simulate(0.2, accuracy=1e-6, solver=None) if solver is None else
            scene(model).simulate(0.2, solver=mb.RadauIIA(3, rtol=1e-8)) for model in (R, mb.Kinematic())]
    for name in ("b5", "b9"):
        np.testing.assert_allclose(runs[0][name].position, runs[1][name].position, atol=3e-6)
    forces = [r["held"].force for r in runs]
    assert np.max(np.abs(forces[0] - forces[1])) < 1e-4 * np.max(np.abs(forces[1]))


def small():
    """A free body, a spherical joint, a slider and a hinge behind each other, held by constraints at both ends."""
    rng, s = np.random.default_rng(2), mb.Scene("small", gravity=(0.2, -9.81, 1))
    bodies = [s.rigid_body(f"b{i}", 1.0 + 0.2 * i, rng.uniform(0.2, 0.3, 3), at=rng.normal(size=3)) for i in range(4)]
    at, axis = rng.normal(size=(5, 3)), rng.normal(size=(3, 3))
    s.spherical("a", bodies[0], bodies[1], at=at[0], model=R)
    s.prismatic("b", bodies[2], bodies[1], at=at[1], axis=axis[0], model=R, spring=3.0)
    s.revolute("c", bodies[2], bodies[3], at=at[2], axis=axis[1], model=R, torque=0.3)
    s.point_on_plane("first", bodies[0], s.ground, at=at[3], axis=axis[2], model=mb.Kinematic())
    s.point_on_line("last", s.ground, bodies[3], at=at[4], axis=axis[2], model=mb.Kinematic())
    return s


def test_all_rows_and_derivatives_are_those_of_the_passes_as_one_function(monkeypatch):
    """At any y and y', stabilising multipliers included."""
    whole = small().system(GGL())
    monkeypatch.setattr("mbdae.system.model.moved_bodies.FUSED", 0)
    ordered = small().system(GGL())
    assert (whole.assembly.moved.ordered, ordered.assembly.moved.ordered) == (False, True)
    rng, (F, H) = np.random.default_rng(3), np.empty((2, whole.n))
    for _ in range(3):
        y, yp = whole.y0 + 0.2 * rng.normal(size=whole.n), rng.normal(size=whole.n)
        whole.residual(0.0, y, yp, F)
        ordered.residual(0.0, y, yp, H)
        assert np.max(np.abs(F - H)) < 1e-12 * np.max(np.abs(F))
        for A, B in zip(whole.jacobian_parts(0.0, y, yp), ordered.jacobian_parts(0.0, y, yp), strict=True):
            assert np.max(np.abs(A - B)) < 1e-12 * np.max(np.abs(A))


def test_contacts_see_the_motion_of_large_trees():
    """A hanging chain whose last body hits the floor, against kinematic joints."""
    found = []
    for model in (R, mb.Kinematic()):
        s, last = mb.Scene("chain over a floor", gravity=(0, 0, -9.81)), None
        for i in range(6):
            body = s.rigid_body(f"b{i}", 1.0, (0.01, 0.02, 0.03), at=(0.1 * i + 0.05, 0, 0.2))
            s.revolute(f"j{i}", last or s.ground, body, at=(0.1 * i, 0, 0.2), axis=(0.2 * (i % 2), 1, 0), model=model, damper=0.1)
            last = body
        s.contact("floor", s.ground, last, mb.Plane(), mb.Sphere(radius=0.1), normal=mb.Hertz(1e6))
        found.append(s.simulate(0.3, accuracy=1e-5))
    assert found[0].prepared.all_bodies.moved.ordered
    assert found[0].solution.stats.contacts == found[1].solution.stats.contacts > 0
    np.testing.assert_allclose(found[0]["b5"].position, found[1]["b5"].position, atol=3e-5)
