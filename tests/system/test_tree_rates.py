"""y' of trees: it solves the residual, in trees whose passes are one function and in those of single joints."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbdae as mb
from mbdae.laws.on_coordinates import JointSpring
from mbdae.native.program import CHOLESKY, PASS, POSITIVE
from mbdae.system.model.moved_bodies import FUSED
from mbdae.system.model.nodes import quaternion, quaternion_product, rotation_matrices

ONE = True, False, False  #: a kernel of the whole tree


def tree(s: mb.Scene, count: int = 3) -> mb.Scene:
    """Hinges, a spherical joint, a slider and a branch, with springs, dampers and a torque in time."""
    rng = np.random.default_rng(7)
    bodies = [s.ground]
    for i in range(count):
        body = s.rigid_body(f"{s.name}{i}", 1.1 + 0.3 * i, rng.uniform(0.2, 0.3, 3), at=rng.normal(size=3))
        parent, at, axis = bodies[i - i % 2], rng.normal(size=3), rng.normal(size=3)
        if i % 3 == 1:
            s.spherical(f"J{s.name}{i}", parent, body, at=at)
        elif i % 3 == 2:
            s.prismatic(f"J{s.name}{i}", parent, body, at=at, axis=axis, spring=30.0, damper=1.3)
        else:
            s.revolute(f"J{s.name}{i}", parent, body, at=at, axis=axis, damper=0.3, torque=0.7 * mb.t)
        bodies.append(body)
    return s


def prescribed() -> mb.Scene:
    s = tree(mb.Scene("a", gravity=(0, 0, -9.81)), 2)
    driven = s.rigid_body("driven", 0.7, (0.1, 0.2, 0.3), at=(1, 0, 0))
    last = s.rigid_body("last", 0.6, (0.1, 0.2, 0.3), at=(2, 0, 0))
    s.revolute("D", s.ground, driven, at=(0, 0, 0), axis=(0, 1, 0), angle=mb.t**2)
    s.revolute("E", driven, last, at=(1.5, 0, 0), axis=(1, 1, 0))
    return s


def loose() -> mb.Scene:
    s = tree(mb.Scene("a", gravity=(0, 0, -9.81)))
    s.rigid_body("free", 0.7, (0.1, 0.2, 0.3), at=(1, 0, 0))
    return s


def long() -> mb.Scene:
    s = mb.Scene("a", gravity=(0, -9.81))
    last = s.ground
    for i in range(FUSED // 9 + 1):
        rod = s.link(f"r{i}", (i, 0), (i + 1, 0), mass=1.1)
        s.revolute(f"J{i}", last, rod, at=(i, 0))
        last = rod
    return s


@pytest.mark.parametrize(("scene", "whole"), [
    (lambda: tree(mb.Scene("a", gravity=(0, 0, -9.81))), ONE), (lambda: tree(mb.Scene("a"), 4), ONE), (prescribed, ONE),
    (loose, ONE), (long, (True, False, True)),
])
def test_accelerations_solve_the_residual(scene, whole):
    system = scene().recursive().system(mb.ODE())
    kinds = [fields["kind"] for fields, *_ in system.assembly.evaluation.of_rates.steps]
    assert (POSITIVE in kinds, CHOLESKY in kinds, PASS in kinds) == whole
    rng, yp, F = np.random.default_rng(1), np.empty(system.n), np.empty(system.n)
    for _ in range(5):
        y = system.y0 + rng.normal(size=system.n) * 0.3
        system.rhs(0.3, y, yp)
        system.residual(0.3, y, yp, F)
        terms = np.empty(system.n)
        system.residual(0.3, y, np.zeros(system.n), terms)
        assert np.max(np.abs(F)) < 1e-12 * np.max(np.abs(terms))


def test_laws_outside_that_are_linear_in_the_bodies_of_a_tree():
    """A spring on the angle of a body whose rest follows a state: its force is read from the motion that the tree gives."""
    s = mb.Scene("actuator")
    rod = s.link("rod", (0, 0), (1, 0), mass=3.0)
    s.revolute("J", s.ground, rod, at=(0, 0), model=mb.Recursive())
    rest = s.state("rest", rate=-s.sensor("rest"))
    s.add(JointSpring("spring", "ground", rod, at=(0, 0), joint=mb.Revolute, coordinate="angle", kept=False, stiffness=4.0,
                      rest=rest, turns=0.0))
    system = s.system(mb.ODE())
    yp, F, y = np.empty(3), np.empty(3), np.array([0.3, -0.2, 0.5])
    system.rhs(0.0, y, yp)
    system.residual(0.0, y, yp, F)
    assert yp == pytest.approx([-0.2, 4.0 * (0.5 - 0.3), -0.5], rel=1e-12)
    assert np.max(np.abs(F)) < 1e-14


def test_a_mass_matrix_that_is_not_positive_definite_is_refused():
    system = tree(mb.Scene("a", gravity=(0, 0, -9.81))).recursive().system(mb.ODE())
    place = system.numbers(["a2.mass"])
    place.W[place.slots] = -100.0
    with pytest.raises(mb.SolverError, match=r"the motion of J\w+\.[\w.]+ has no inertia"):
        system.rhs(0.0, system.y0, np.empty(system.n))


def test_products_of_quaternions_are_rotations_one_after_the_other():
    """One by one and many at once, against SciPy."""
    rng = np.random.default_rng(1)
    a, b = Rotation.random(5, rng), Rotation.random(5, rng)
    P, Q, product = (np.roll(r.as_quat(), 1, axis=1) for r in (a, b, a * b))
    many = quaternion_product(P, Q)
    np.testing.assert_allclose(many * np.sign(np.sum(many * product, axis=1))[:, None], product, atol=1e-15)
    for p, q, expected in zip(P, Q, many, strict=True):
        np.testing.assert_allclose(quaternion_product(p, q), expected, atol=1e-15)


def test_quaternions_are_those_of_their_rotation_matrices():
    """One by one and many at once, in arrays of any shape."""
    P = np.roll(Rotation.random(12, np.random.default_rng(2)).as_quat(), 1, axis=1)
    P *= np.sign(P[:, :1])
    for shape in ((12,), (3, 4)):
        many = quaternion(rotation_matrices(P.reshape(*shape, 4)))
        np.testing.assert_allclose(many.reshape(12, 4), P, atol=1e-14)
    for p in P:
        np.testing.assert_allclose(quaternion(rotation_matrices(p)), p, atol=1e-14)
