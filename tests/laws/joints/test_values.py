"""Rows, coordinates and branches of every joint in random states of two bodies, against the same geometry written with NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mbdae.contracts.states import RandomStates, columns, rotation
from mbdae.kernels.plan import plan
from mbdae.laws import joints
from mbdae.symbolic.derive import Derived, derive
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.outputs import Target, position
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array

SPATIAL = (NodeKind.SPATIAL, Axes.GENERAL)
#: joints by rows of positions; those of velocities are in test_rolling.py
LAWS = [law for law in (getattr(joints, name) for name in joints.__all__)
        if law.velocity_constraints is joints.Joint.velocity_constraints]
KEPT = [law for law in LAWS if law.states_motion() and law.coordinates]
BOTH = [(law, False) for law in LAWS if not law.must_keep()] + [(law, True) for law in KEPT]
OWN = {"length": 0.7, "lead": 0.9}


def derived(law: Any, kept: bool = False) -> Derived:
    """The joint with its coordinates prescribed, as the frames show them or as unknowns."""
    stated = law("J", None, None, kept=kept, **{n: OWN.get(n, 0.4) for n in law.params if n in (*law.drives(), *OWN)})
    kinds = (NodeKind.COORDINATE if c in law.scalars() else NodeKind.ROTATION for c in stated.own_coordinates)
    return derive(law, stated.structure(), (SPATIAL, SPATIAL, *((kind, Axes.GENERAL) for kind in kinds)))


def unknowns(d: Derived) -> dict[str, str]:
    """Symbols of the coordinates that are unknowns, by name."""
    return {name: str(f.q[0]) for name, f in zip(d.law.own_coordinates, d.frames[2:], strict=True) if name in d.law.scalars()}


def by_motion(law: Any) -> bool:
    """Whether its rows with the coordinates as unknowns are the differences of l from its place by the motion."""
    return law is joints.Screw or law.scalars() != law.coordinates


def geometry(d: Derived, values: dict[str, Array], i: int) -> tuple[Array, Array, Array]:
    """d from k's point to l's, axes of k and of l (columns), inertial."""
    points, axes = [], []
    for f in d.sides:
        R, p = rotation(f, values)[i], np.array([values[f"{f.side}_p{j}"][i] for j in (1, 2, 3)])
        points.append(columns(f.q, values)[i, :3] + R @ p)
        axes.append(R @ np.array([[values[f"{f.side}_Q{a}{j}"][i] for a in "xyz"] for j in (1, 2, 3)]))
    return points[1] - points[0], axes[0], axes[1]


def rotated(axis: int, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    about = {0: [[1, 0, 0], [0, c, -s], [0, s, c]], 1: [[c, 0, s], [0, 1, 0], [-s, 0, c]], 2: [[c, -s, 0], [s, c, 0], [0, 0, 1]]}
    return np.array(about[axis])


def tied(name: str, along: Array, S: Array, c: float) -> float:
    """What is left of a coordinate that has the value c."""
    if name in ("x", "y", "z", "displacement"):
        return float(c - along[2 if name == "displacement" else "xyz".find(name)])
    axis = {"angle": 2, "angle_k": 0, "angle_l": 1}[name]  # a pin of k about x, a pin of l about y, both about z
    back = rotated(axis, c)
    if name == "angle":
        return float((S @ back.T)[0, 1])
    return float(-(back.T @ S[:, 1])[2]) if name == "angle_k" else float(-(S @ back.T)[0, 2])


def expected(law: Any, kept: bool, u: Array, K: Array, L: Array, drive: dict[str, float],
             own: dict[str, float], R: Array) -> dict[str, float]:
    """All rows any joint has: displacements along axes, cosines between axes, what is left of a coordinate."""
    S, along = K.T @ L, K.T @ u  # l's axes and d, seen from k
    rows = dict(zip("xyz", u, strict=True)) | {"offset_x": along[0], "offset_y": along[1], "axial": along[2], "offset": along[2]}
    rows |= {"tilt_y": S[2, 0], "tilt_x": S[2, 1], "twist": S[0, 1], "length": float(np.linalg.norm(u)) - OWN["length"]}
    rows["pins"] = S[0, 1]
    if kept and by_motion(law):
        z = OWN["lead"] * own["angle"] / (2 * np.pi) if law is joints.Screw else own.get("z", own.get("displacement", 0.0))
        back = (rotated(2, own["angle"]) if law is joints.Screw else R).T @ S
        rows |= dict(zip("xyz", u - K @ [own.get("x", 0.0), own.get("y", 0.0), z], strict=True))
        rows |= {"tilt_y": back[2, 0], "tilt_x": back[2, 1], "twist": back[0, 1]}
    for name, c in law.drives().items():
        rows[name] = drive[name] - own[c] if kept else tied(c, along, S, drive[name])
    return rows | ({} if by_motion(law) else {c: tied(c, along, S, own[c]) for c in own})


@pytest.mark.parametrize(("law", "kept"), BOTH)
def test_rows(law: Any, kept: bool) -> None:
    d = derived(law, kept)
    values = RandomStates(d, OWN, np.random.default_rng(15), 6).values
    p = plan(d, position)
    found = p.kernel.values(columns(p.all_inputs.symbols, values))
    for i in range(len(found)):
        own = {name: float(values[symbol][i]) for name, symbol in unknowns(d).items()}
        turned = [rotation(f, values)[i] for f in d.frames[2:] if f.kind is NodeKind.ROTATION] or [np.eye(3)]
        rows = expected(law, kept, *geometry(d, values, i), {n: float(values[n][i]) for n in law.drives()}, own, turned[0])
        assert found[i] == pytest.approx([rows[name] for name in d.rows], abs=1e-12)


@pytest.mark.parametrize(("law", "kept"), BOTH)
def test_what_a_joint_holds(law: Any, kept: bool) -> None:
    """Six rows less what is free; a coordinate as an unknown adds the row that ties it, a prescribed one a row."""
    free = {"Distance": 5, "ClearanceRevolute": 3}.get(law.__name__, law.freedoms())
    d = derived(law, kept)
    assert len(d.rows) == 6 - free + len(law.drives()) + (free if kept else 0)
    assert len(set(d.rows)) == len(d.rows)
    assert set(law.drives()) <= set(d.rows)


def read(d: Derived) -> list[tuple[Target, Expr]]:
    """The coordinates and what is positive on the branch that is meant."""
    v = d.variation
    return [*(((f"coordinate {name}",), e) for name, e in d.coordinates.items()),
            *(((name,), v.resolve(v.name(e))) for name, e in d.law.positives(*d.sides).items())]


@pytest.mark.parametrize("angle", [0.3, 2.8, -2.9])
@pytest.mark.parametrize(("law", "kept"), [(joints.Revolute, False), (joints.Revolute, True), (joints.ClearanceRevolute, False)])
def test_angles_and_their_branches(law: Any, kept: bool, angle: float) -> None:
    """On the axis the angle reads what l was turned by; branches are positive there, and half a turn off they are not."""
    d = derived(law, kept)
    for off in (0.0, np.pi):
        values = RandomStates(d, {"drive": angle}, np.random.default_rng(16), 1).special(angle + off, True)
        for symbol in unknowns(d).values():
            values[symbol][:] = angle
        p = plan(d, read)
        angle_read, *branches = p.kernel.values(columns(p.all_inputs.symbols, values))[0]
        assert np.exp(1j * angle_read) == pytest.approx(np.exp(1j * (angle if kept else angle + off)), abs=1e-12)
        assert branches == pytest.approx([1.0, np.cos(off)], abs=1e-12)


@pytest.mark.parametrize("angle", [0.0, np.pi])
def test_branches_of_a_universal_joint_as_drawn_and_with_the_pin_of_l_turned_over(angle: float) -> None:
    """Both angles are 0 as unknowns: where l is turned about k.z by pi the cross and l are half a turn off."""
    d = derived(joints.Universal, True)
    values = RandomStates(d, {}, np.random.default_rng(16), 1).special(angle, True)
    for symbol in unknowns(d).values():
        values[symbol][:] = 0.0
    p = plan(d, read)
    found = p.kernel.values(columns(p.all_inputs.symbols, values))[0]
    branches = [value for target, value in zip(p.targets, found, strict=True) if not target[0].startswith("coordinate")]
    assert branches == pytest.approx([np.cos(angle)] * 2, abs=1e-12)


@pytest.mark.parametrize(("law", "kept"), [(joints.Prismatic, False), (joints.Prismatic, True), (joints.FixedOrientation, False),
                                           (joints.Weld, False)])
def test_half_turns_that_the_rows_would_admit(law: Any, kept: bool) -> None:
    """The rows vanish upright and after half a turn about k.z; one of the branches tells them apart."""
    d, rows = derived(law, kept), [i for i, name in enumerate(derived(law, kept).rows) if name in ("tilt_y", "tilt_x", "twist")]
    for angle in (0.0, np.pi):
        values = RandomStates(d, OWN, np.random.default_rng(19), 1).special(angle, True)
        p, held = plan(d, read), plan(d, position)
        branches = dict(zip(p.targets, p.kernel.values(columns(p.all_inputs.symbols, values))[0], strict=True))
        for target in [target for target in branches if target[0].startswith("coordinate")]:
            branches.pop(target)
        assert sorted(branches.values()) == pytest.approx(sorted([1.0, np.cos(angle)]), abs=1e-12)
        assert branches["z axes in the same sense",] == pytest.approx(1.0)
        g = held.kernel.values(columns(held.all_inputs.symbols, values))[0]
        assert g[rows] == pytest.approx(0.0, abs=1e-12)


def test_displacement_is_along_the_axis_of_k() -> None:
    d = derived(joints.Prismatic)
    values = RandomStates(d, OWN, np.random.default_rng(21), 6).values
    p = plan(d, read)
    found = p.kernel.values(columns(p.all_inputs.symbols, values))[:, p.targets.index(("coordinate displacement",))]
    for i, displacement in enumerate(found):
        u, K, _ = geometry(d, values, i)
        assert displacement == pytest.approx(K[:, 2] @ u, rel=1e-12)
