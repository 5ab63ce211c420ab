"""Only what a scene requires: kernels and groups that it does not need do not exist."""

from __future__ import annotations

from typing import Any

import pytest

import mbdae as mb
from mbdae.run.choice import absent, size_of
from mbdae.symbolic.frames import NodeKind


def slider(gravity: bool = False, friction: Any = None, space: str = "auto", bodies: int = 1) -> mb.Scene:
    s = mb.Scene("slider", gravity=(0, -9.81, 0) if gravity else (0, 0, 0), space=space)
    for i in range(bodies):
        block = s.rigid_body(f"block{i}", 1.0, (1.0, 1.0, 1.0), at=(0, 0))
        s.prismatic(f"rail{i}", s.ground, block, at=(0, 0), axis=(1, 0, 0), friction=friction)
    return s


def laws(s: mb.Scene) -> set[str]:
    """Classes of the laws of the scene's equations."""
    return {group.key[0].__name__ for group in s.system().model.groups}


def test_gravity_and_friction_are_absent_where_they_are_not_stated() -> None:
    assert laws(slider()) == {"RigidBody", "Prismatic"}
    assert laws(slider(gravity=True)) == {"RigidBody", "Prismatic", "Gravity"}
    assert absent(slider()) == ["gravity", "friction", "contact", "values prescribed in time"]
    assert absent(slider(gravity=True, friction=mb.Coulomb(0.1, 0.1))) == ["contact", "values prescribed in time"]


@pytest.mark.parametrize("space", ["auto", "spatial"])
def test_constant_terms_need_no_kernel(space: str) -> None:
    """Gravity is a constant; the mass of a body in the plane is one too, and of equal laws there is one kernel."""
    plain, heavy = (size_of(slider(gravity, space=space).system().assembly) for gravity in (False, True))
    assert (heavy.kernels, heavy.operations) == (plain.kernels, plain.operations)
    several = size_of(slider(space=space, bodies=3).system().assembly)
    assert several.kernels == plain.kernels
    assert several.operations == 3 * plain.operations
    rubbing = size_of(slider(friction=mb.Coulomb(0.1, 0.1), space=space).system().assembly)
    assert rubbing.operations > plain.operations


def test_a_side_on_the_ground_has_no_unknowns_and_no_columns() -> None:
    """One body on a rail: three positions, three velocities and two rows of the plane, twice."""
    system = slider().system()
    assert system.n == 3 + 3 + 2 * 2
    assert {side for group in system.model.groups for side, _ in group.key[2]} == {NodeKind.PLANAR, NodeKind.PLANAR_GROUND}
