"""Rows, coordinates and branches of every joint in random states of two bodies, against the same geometry written with NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mbdae.contracts.states import States, columns, rotation
from mbdae.kernels import plan
from mbdae.laws import joints
from mbdae.symbolic.derive import Derived, derive
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.outputs import Target, position
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array

SPATIAL = (NodeKind.SPATIAL, Axes.GENERAL)
COORDINATE = (NodeKind.COORDINATE, Axes.GENERAL)  #: the unknown of a classical joint
LAWS = [getattr(joints, name) for name in joints.__all__ if not name.startswith("Rubbing")]
OWN = {"length": 0.7}


def derived(law: Any) -> Derived:
    """The joint with its motion prescribed, where it can be."""
    stated = law("J", None, None, **{name: OWN.get(name, 0.4) for name in law.params if name in ("drive", "length")})
    return derive(law, stated.structure(), (SPATIAL, SPATIAL, *[COORDINATE] * len(law.coordinates)))


def geometry(d: Derived, values: dict[str, Array], i: int) -> tuple[Array, Array, Array]:
    """d from k's point to l's, axes of k and of l (columns), inertial."""
    points, axes = [], []
    for f in d.sides:
        R, p = rotation(f, values)[i], np.array([values[f"{f.side}_p{j}"][i] for j in (1, 2, 3)])
        points.append(columns(f.q, values)[i, :3] + R @ p)
        axes.append(R @ np.array([[values[f"{f.side}_Q{a}{j}"][i] for a in "xyz"] for j in (1, 2, 3)]))
    return points[1] - points[0], axes[0], axes[1]


def expected(law: Any, u: Array, K: Array, L: Array, drive: float, own: float) -> dict[str, float]:
    """All rows any joint has: displacements along axes, cosines between axes, what is left of a prescribed motion."""
    S, along = K.T @ L, K.T @ u  # l's axes and d, seen from k
    rows = dict(zip("xyz", u, strict=True)) | {"offset_x": along[0], "offset_y": along[1], "axial": along[2]}
    rows |= {"tilt_y": S[2, 0], "tilt_x": S[2, 1], "twist": S[0, 1], "length": float(np.linalg.norm(u)) - OWN["length"]}
    turned = S @ np.array([np.sin(drive), np.cos(drive), 0])  # the direction of l that is k.y where l is turned by the drive
    coordinate = drive - own if law is joints.ClassicalRevolute else own - drive
    rows["drive"] = coordinate if law.coordinates else along[2] - drive if law is joints.Prismatic else turned[0]
    rows |= {"angle": float((S @ np.array([np.sin(own), np.cos(own), 0]))[0]), "displacement": along[2] - own}
    return rows


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_rows(law: Any) -> None:
    d = derived(law)
    values = States(d, OWN, np.random.default_rng(15), 6).values
    p = plan(d, position)
    found = p.kernel.values(columns(p.all_inputs.symbols, values))
    for i in range(len(found)):
        own = float(values[str(d.frames[2].q[0])][i]) if law.coordinates else 0.0
        drive = float(values["drive"][i]) if "drive" in values else 0.0
        rows = expected(law, *geometry(d, values, i), drive, own)
        assert found[i] == pytest.approx([rows[name] for name in d.rows], abs=1e-12)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_what_a_joint_holds(law: Any) -> None:
    """Six rows less what is free; a motion of its own adds an unknown and the row that ties it, a prescribed one a row."""
    free = {"Distance": 5, "FixedOrientation": 3, "Spherical": 3, "Weld": 0, "ClearanceRevolute": 3}
    names = derived(law).rows
    driven = "drive" in names
    assert len(names) == 6 - free.get(law.__name__, 1) + len(law.coordinates) + driven
    assert len(set(names)) == len(names)


def read(d: Derived) -> list[tuple[Target, Expr]]:
    """The coordinate and what is positive on the branch that is meant."""
    v = d.variation
    return [(("coordinate",), d.coordinate), *(((name,), v.resolve(v.name(e))) for name, e in d.law.branches(*d.sides).items())]


@pytest.mark.parametrize("angle", [0.3, 2.8, -2.9])
@pytest.mark.parametrize("law", [joints.Revolute, joints.ClassicalRevolute, joints.ClearanceRevolute])
def test_angles_and_their_branches(law: Any, angle: float) -> None:
    """On the axis the angle reads what l was turned by; branches are positive there, and half a turn off they are not."""
    d = derived(law)
    for off in (0.0, np.pi):
        values = States(d, {"drive": angle}, np.random.default_rng(16), 1).special(angle + off, True)
        if law.coordinates:
            values[str(d.frames[2].q[0])][:] = angle
        p = plan(d, read)
        angle_read, *branches = p.kernel.values(columns(p.all_inputs.symbols, values))[0]
        assert np.exp(1j * angle_read) == pytest.approx(np.exp(1j * (angle if law.coordinates else angle + off)), abs=1e-12)
        assert branches == pytest.approx([1.0, np.cos(off)], abs=1e-12)


@pytest.mark.parametrize("law", [joints.Prismatic, joints.ClassicalPrismatic, joints.FixedOrientation, joints.Weld])
def test_half_turns_that_the_rows_would_admit(law: Any) -> None:
    """The rows vanish upright and after half a turn about k.z; one of the branches tells them apart."""
    d, rows = derived(law), [i for i, name in enumerate(derived(law).rows) if name in ("tilt_y", "tilt_x", "twist")]
    for angle in (0.0, np.pi):
        values = States(d, OWN, np.random.default_rng(19), 1).special(angle, True)
        p, held = plan(d, read), plan(d, position)
        branches = dict(zip(p.targets, p.kernel.values(columns(p.all_inputs.symbols, values))[0], strict=True))
        branches.pop(("coordinate",))
        assert sorted(branches.values()) == pytest.approx(sorted([1.0, np.cos(angle)]), abs=1e-12)
        assert branches["z axes in the same sense",] == pytest.approx(1.0)
        g = held.kernel.values(columns(held.all_inputs.symbols, values))[0]
        assert g[rows] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("law", [joints.ClassicalRevolute, joints.ClassicalPrismatic])
def test_twist_is_the_motion_the_rows_admit(law: Any) -> None:
    """l carried by c times the twist (travel along k.z, turn about it) and the coordinate c satisfy all rows."""
    stated = law("J", None, None)
    d, (travel, turn), c = derive(law, stated.structure(), (SPATIAL, SPATIAL, COORDINATE)), law.twist, 0.6
    values = States(d, {}, np.random.default_rng(20), 1).special(turn * c, True)
    _, K, _ = geometry(d, values, 0)
    for symbol, along in zip(d.frames[1].q[:3], K[:, 2], strict=True):
        values[str(symbol)] = values[str(symbol)] + travel * c * along
    values[str(d.frames[2].q[0])][:] = c
    p = plan(d, position)
    assert p.kernel.values(columns(p.all_inputs.symbols, values)) == pytest.approx(0.0, abs=1e-12)
    assert (travel, turn) != (0, 0)


def test_displacement_is_along_the_axis_of_k() -> None:
    d = derived(joints.Prismatic)
    values = States(d, OWN, np.random.default_rng(21), 6).values
    p = plan(d, read)
    found = p.kernel.values(columns(p.all_inputs.symbols, values))[:, p.targets.index(("coordinate",))]
    for i, displacement in enumerate(found):
        u, K, _ = geometry(d, values, i)
        assert displacement == pytest.approx(K[:, 2] @ u, rel=1e-12)
