"""Forces and moments of every force law in random states of two bodies in space, against the same physics written with NumPy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.contracts.case import starts
from mbdae.contracts.states import RandomStates, columns, rotation
from mbdae.kernels.plan import plan
from mbdae.laws import forces, joints
from mbdae.laws.journal import JournalContact
from mbdae.symbolic.derive import Derived, derive
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.outputs import Target, loads
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array

SPATIAL = (NodeKind.SPATIAL, Axes.GENERAL)
GROUND = (NodeKind.GROUND, Axes.GENERAL)
COORDINATE = (NodeKind.COORDINATE, Axes.GENERAL)  #: a coordinate of a joint as an unknown
Values = dict[str, float]
Wrench = tuple[Array, Array]  #: force and torque on l at its point, inertial
MU, V_C = 0.3, 0.4


@dataclass
class Side:
    """One side of a law in numbers: centre, point and its velocity, axes (columns of A), angular velocity; inertial."""

    c: Array
    r: Array
    v: Array
    A: Array
    w: Array
    R: Array


def side(d: Derived, i: int, values: dict[str, Array], point: int) -> Side:
    f = d.frames[i]
    R, q, u = rotation(f, values)[point], columns(f.q, values)[point], columns(f.u, values)[point]
    p = np.array([values[f"{f.side}_p{j}"][point] for j in (1, 2, 3)])
    Q = np.array([[values[f"{f.side}_Q{a}{j}"][point] for a in "xyz"] for j in (1, 2, 3)])
    if not f.kind.moves:
        return Side(np.zeros(3), p, np.zeros(3), Q, np.zeros(3), np.eye(3))
    w = R @ u[3:]
    return Side(q[:3], q[:3] + R @ p, u[:3] + np.cross(w, R @ p), R @ Q, w, R)


def compare(d: Derived, values: dict[str, Array], wrench: Callable[[Side, Side, Values], Wrench]) -> None:
    """Rows of both bodies (- force, - moment about the centre in body axes) against a wrench at the point of l, reversed on k."""
    p = plan(d, loads)
    found = dict(zip(p.targets, p.kernel.values(columns(p.all_inputs.symbols, values)).T, strict=True))
    count = len(next(iter(values.values())))
    largest = 0.0
    for point in range(count):
        k, l = (side(d, i, values, point) for i in (0, 1))
        force, torque = wrench(k, l, {name: float(v[point]) for name, v in values.items()})
        for name, body, sense in (("l", l, 1), ("k", k, -1)):
            if name == "k" and not d.frames[0].kind.moves:
                continue
            rows = -sense * np.r_[force, body.R.T @ (torque + np.cross(l.r - body.c, force))]
            stated = [float(found[("u", name, i)][point]) if ("u", name, i) in found else 0.0 for i in range(6)]
            assert stated == pytest.approx(rows, rel=1e-9, abs=1e-9 * (1 + np.abs(rows).max())), (name, point)
            largest = max(largest, float(np.abs(rows).max()))
    assert largest > 0.1  # the states do load the bodies


def derived(law: Any, sides: Any = (SPATIAL, SPATIAL), **values: Any) -> Derived:
    stated = law("F", None, None, **values)
    return derive(law, stated.structure(), (*sides, *[COORDINATE] * len(stated.own_coordinates)))


# -- between points


def spring(k: Side, l: Side, p: Values) -> Wrench:
    """-(stiffness extension + damping its rate) along the line from k's point to l's; central, so no moment."""
    d = l.r - k.r
    length = np.linalg.norm(d)
    n = d / length
    return -(p["stiffness"] * (length - p["length"]) + p["damping"] * (n @ (l.v - k.v))) * n, np.zeros(3)


def test_spring_and_damper_between_points() -> None:
    d = derived(forces.PointSpring, stiffness=3.0, damping=2.0, length=0.5)
    compare(d, RandomStates(d, {"stiffness": 3.0, "damping": 2.0, "length": 0.5}, np.random.default_rng(1), 8).values, spring)


def test_spring_of_no_length() -> None:
    d = derived(forces.PointSpring, stiffness=3.0)
    values = RandomStates(d, {}, np.random.default_rng(2), 8).values
    compare(d, values, lambda k, l, p: (-p["stiffness"] * (l.r - k.r), np.zeros(3)))


def test_bushing() -> None:
    """Force along the axes of k on the displacement and on the velocity seen from k."""

    def bushing(k: Side, l: Side, p: Values) -> Wrench:
        d = k.A.T @ (l.r - k.r)
        v = k.A.T @ (l.v - k.v - np.cross(k.w, l.r - k.r))
        c, damping = (np.array([p[f"{letter}{a}"] for a in "xyz"]) for letter in "kc")
        return -k.A @ (c * d + damping * v), np.zeros(3)

    d = derived(forces.Bushing, kx=1.0, ky=2.0, kz=3.0, cx=0.1, cy=0.2, cz=0.3)
    compare(d, RandomStates(d, {}, np.random.default_rng(3), 8).values, bushing)


def test_rotational_bushing() -> None:
    """V = sum c_i rho_i^2 / 2 of the Rodrigues vector rho = 2 g; d(rho) = (1 - g x + g g^T) d(psi) in the axes of k."""

    def bushing(k: Side, l: Side, p: Values) -> Wrench:
        S = k.A.T @ l.A
        g = np.array([S[2, 1] - S[1, 2], S[0, 2] - S[2, 0], S[1, 0] - S[0, 1]]) / (1 + np.trace(S))
        c, damping = (np.array([p[f"{letter}{a}"] for a in "xyz"]) for letter in "rs")
        m = c * 2 * g
        torque = m + np.cross(g, m) + g * (g @ m) + damping * (k.A.T @ (l.w - k.w))
        return np.zeros(3), -k.A @ torque

    d = derived(forces.RotationalBushing, rx=1.0, ry=2.0, rz=3.0, sx=0.1, sy=0.2, sz=0.3)
    compare(d, RandomStates(d, {}, np.random.default_rng(4), 8).values, bushing)


# -- applied


@pytest.mark.parametrize("following", [False, True])
@pytest.mark.parametrize(("law", "letters", "part"), [(forces.AppliedForce, "f", 0), (forces.AppliedTorque, "m", 1)])
def test_applied(law: Any, letters: str, part: int, following: bool) -> None:
    def applied(k: Side, l: Side, p: Values) -> Wrench:
        value = np.array([p[letters + a] for a in "xyz"])
        wrench = [np.zeros(3), np.zeros(3)]
        wrench[part] = l.A @ value if following else value
        return wrench[0], wrench[1]

    d = derived(law, (GROUND, SPATIAL), following=following, **{letters + a: 1.0 for a in "xyz"})
    compare(d, RandomStates(d, {}, np.random.default_rng(5), 8).values, applied)


def test_gravity() -> None:
    """The weight acts at the centre of mass, wherever the point of the law is."""

    def weight(k: Side, l: Side, p: Values) -> Wrench:
        force = p["mass"] * np.array([p["gx"], p["gy"], p["gz"]])
        return force, np.cross(l.c - l.r, force)

    d = derived(forces.Gravity, (GROUND, SPATIAL), mass=2.0, gx=1.0, gy=2.0, gz=3.0)
    compare(d, RandomStates(d, {}, np.random.default_rng(6), 4).values, weight)


# -- on the axis of a joint: l turned by an angle about k.z, its point on that of k


ANGLE = 0.7


def on_axis(d: Derived, seed: int, given: dict[str, float]) -> dict[str, Array]:
    states = RandomStates(d, given, np.random.default_rng(seed), 1)
    points = [states.special(ANGLE, True) for _ in range(6)]
    return {name: np.concatenate([p[name] for p in points]) for name in points[0]}


def test_joint_spring_and_damper() -> None:
    given = {"stiffness": 3.0, "rest": 0.2, "damping": 2.0, "turns": 0.0}
    spring = derived(forces.JointSpring, stiffness=3.0, rest=0.2, turns=0.0, joint=joints.Revolute)
    values = on_axis(spring, 7, given)
    values["state_followed"][:] = ANGLE + 2 * np.pi  # a turn further than the attitude shows
    compare(spring, values, lambda k, l, p: (np.zeros(3), -k.A[:, 2] * 3.0 * (ANGLE + 2 * np.pi - 0.2)))
    p = plan(spring, starts)
    values["turns"][:] = 4 * np.pi  # the start angle was given as two turns more than the attitude shows
    assert p.kernel.values(columns(p.all_inputs.symbols, values)) == pytest.approx(ANGLE + 4 * np.pi)
    damper = derived(forces.JointDamper, damping=2.0, joint=joints.Revolute)
    compare(damper, on_axis(damper, 8, given), lambda k, l, p: (np.zeros(3), -k.A[:, 2] * 2.0 * (k.A[:, 2] @ (l.w - k.w))))


def test_joint_drives() -> None:
    torque = derived(forces.JointLoad, load=1.0, joint=joints.Revolute)
    compare(torque, on_axis(torque, 9, {}), lambda k, l, p: (np.zeros(3), p["load"] * k.A[:, 2]))
    for law, coordinate in ((joints.Prismatic, None), (joints.Cylindrical, "displacement")):
        force = derived(forces.JointLoad, load=1.0, joint=law, coordinate=coordinate)
        values = RandomStates(force, {}, np.random.default_rng(10), 6).values
        compare(force, values, lambda k, l, p: (p["load"] * k.A[:, 2], np.zeros(3)))


def test_forces_on_a_coordinate_that_is_an_unknown_act_on_it_alone() -> None:
    """The rows that tie the coordinate to the bodies carry them there: -load, stiffness (c - rest), damping c'."""
    given = {"load": 3.0, "stiffness": 2.0, "rest": 0.2, "turns": 0.0, "damping": 0.7}
    laws = {forces.JointLoad: lambda c, cd: -3.0, forces.JointSpring: lambda c, cd: 2.0 * (c - 0.2),
            forces.JointDamper: lambda c, cd: 0.7 * cd}
    for law, expected in laws.items():
        d = derived(law, **{name: value for name, value in given.items() if name in law.params}, joint=joints.Revolute, kept=True)
        values = RandomStates(d, given, np.random.default_rng(22), 6).values
        p = plan(d, loads)
        (c,) = d.frames[2:]
        assert p.targets == [("u", "c", 0)]
        found = p.kernel.values(columns(p.all_inputs.symbols, values))[:, 0]
        assert found == pytest.approx(expected(values[str(c.q[0])], values[str(c.u[0])]) + 0 * found)


def rate_along(k: Side, l: Side) -> float:
    """Velocity of l's point along k.z as k sees it, m/s."""
    return float(k.A[:, 2] @ (l.v - k.v - np.cross(k.w, l.r - k.r)))


def test_slide_under_a_given_normal_force() -> None:
    d = derived(forces.JointFriction, normal_force=5.0, friction=mb.Coulomb(MU, V_C), joint=joints.Prismatic)
    values = RandomStates(d, {"friction_mu": MU, "friction_v_c": V_C}, np.random.default_rng(11), 6).values

    def friction(k: Side, l: Side, p: Values) -> Wrench:
        return -k.A[:, 2] * MU * np.tanh(rate_along(k, l) / V_C) * p["normal_force"], np.zeros(3)

    compare(d, values, friction)


def test_bearing_pressed_by_its_reaction() -> None:
    """-mu N radius about k.z, N the reaction normal to k.z."""
    d = derived(joints.Revolute, friction_radius=0.8, friction=mb.Coulomb(MU, V_C))
    values = on_axis(d, 12, {"friction_radius": 0.8, "friction_mu": MU, "friction_v_c": V_C})
    rows = [str(s) for s, name in zip(d.multipliers, d.rows, strict=True) if name in ("x", "y", "z")]

    def friction(k: Side, l: Side, p: Values) -> Wrench:
        z, reaction = k.A[:, 2], np.array([p[name] for name in rows])
        N = np.linalg.norm(reaction - z * (z @ reaction))
        return np.zeros(3), -z * 0.8 * MU * N * np.tanh(0.8 * (z @ (l.w - k.w)) / V_C)

    compare(d, values, friction)


def test_bearing_of_an_angle_that_is_an_unknown() -> None:
    """The same torque on the angle alone, by its rate: the row that ties the angle carries it to the bodies."""
    d = derived(joints.Revolute, friction_radius=0.8, friction=mb.Coulomb(MU, V_C), kept=True)
    values = on_axis(d, 12, {"friction_radius": 0.8, "friction_mu": MU, "friction_v_c": V_C})
    p = plan(d, loads)
    assert {target[1] for target in p.targets} == {"c"}
    found = p.kernel.values(columns(p.all_inputs.symbols, values))[:, 0]
    for point, torque in enumerate(found):
        z, reaction = side(d, 0, values, point).A[:, 2], np.array([values[f"lambda_{row}"][point] for row in "xyz"])
        N, rate = np.linalg.norm(reaction - z * (z @ reaction)), values[str(d.frames[2].u[0])][point]
        assert torque == pytest.approx(0.8 * MU * N * np.tanh(0.8 * rate / V_C))


def test_guide_pressed_by_its_reaction() -> None:
    d = derived(joints.Prismatic, friction=mb.Coulomb(MU, V_C))
    values = RandomStates(d, {"friction_mu": MU, "friction_v_c": V_C}, np.random.default_rng(13), 6).values
    rows = [str(s) for s, name in zip(d.multipliers, d.rows, strict=True) if name in ("offset_x", "offset_y")]

    def friction(k: Side, l: Side, p: Values) -> Wrench:
        N = np.hypot(*(p[name] for name in rows))
        return -k.A[:, 2] * MU * N * np.tanh(rate_along(k, l) / V_C), np.zeros(3)

    compare(d, values, friction)


# -- a pin in its race


HERTZ = {"normal_stiffness": 200.0, "normal_damping": 0.3, "friction_mu": MU, "friction_v_c": V_C, "inner": 0.5}
INNER = 0.5


@dataclass
class Touch:
    """The contact in the plane through l.r + shift: unit normal and tangent, sliding velocity, forces on l and where they act."""

    depth: float
    rate: float
    t: Array
    sliding: Array
    normal: float
    friction: Array
    force: Array
    point: Array


def touch(k: Side, l: Side, shift: Array, outer: float) -> Touch:
    """It acts where the pin meets the race, outer from k's axis; a pin that may tilt rubs along its whole sliding velocity."""
    z, u = k.A[:, 2], l.r + shift - k.r
    radial = u - z * (z @ u)
    distance = float(np.linalg.norm(radial))
    n = radial / distance
    t, depth, point = np.cross(z, n), distance - (outer - INNER), k.r + z * (z @ u) + outer * n
    v = l.v + np.cross(l.w, point - l.r) - k.v - np.cross(k.w, point - k.r)
    rate, sliding = float(v @ n), v - n * (v @ n)
    normal = max(0.0, 200.0 * max(0.0, depth) ** 1.5 * (1 + 0.3 * rate))
    along = sliding / np.linalg.norm(sliding) if np.any(shift) else t
    friction = -MU * np.tanh((v @ along) / V_C) * normal * along
    return Touch(depth, rate, t, sliding, normal, friction, friction - n * normal, point)


DEPTHS = np.array([1e-4, -1e-4, 0.01, -0.1, 0.05, 0.1, 0.2, 0.3])  #: m, of the pin in the race in the plane of l.r


def pin(length: float | None, seed: int) -> tuple[Derived, dict[str, Array]]:
    """A pin of 0.5 m in races of other radii, so that where the force acts shows in the moments, at these depths."""
    d = derived(JournalContact, outer=1.0, inner=INNER, length=length, normal=mb.Hertz(200.0, damping=0.3),
                friction=mb.Coulomb(MU, V_C))
    values = RandomStates(d, HERTZ | {"length": 0.4}, np.random.default_rng(seed), len(DEPTHS)).values
    for i, depth in enumerate(DEPTHS):
        k, l = side(d, 0, values, i), side(d, 1, values, i)
        values["outer"][i] = np.linalg.norm(np.cross(k.A[:, 2], l.r - k.r)) + INNER - depth
    return d, values


def ends(l: Side, length: float | None) -> list[Array]:
    """Where the planes of contact are: l.r, or the near and the far end along the pin."""
    return [np.zeros(3)] if length is None else [-length / 2 * l.A[:, 2], length / 2 * l.A[:, 2]]


@pytest.mark.parametrize("length", [None, 0.4], ids=["one plane", "two ends"])
def test_pin_in_its_race(length: float | None) -> None:
    def both(k: Side, l: Side, p: Values) -> Wrench:
        parts = [touch(k, l, shift, p["outer"]) for shift in ends(l, length)]
        return sum(c.force for c in parts), sum(np.cross(c.point - l.r, c.force) for c in parts)

    compare(*pin(length, 14), both)


def seen(d: Derived) -> list[tuple[Target, Expr]]:
    """What sensors of a contact read at its ends, and the powers it takes by cause."""
    v, named = d.variation, d.law.observed(*d.sides) | {name: [e] for name, e in d.law.losses(*d.sides).items()}
    return [((name, i), v.resolve(v.name(e))) for name, parts in named.items() for i, e in enumerate(parts)]


@pytest.mark.parametrize("length", [None, 0.4], ids=["one plane", "two ends"])
def test_what_is_seen_of_a_pin_in_its_race(length: float | None) -> None:
    """Velocities along the normal and along t = axis x normal; powers lost are positive; the near end comes first."""
    d, values = pin(length, 17)
    p = plan(d, seen)
    numbers = dict(zip(p.targets, p.kernel.values(columns(p.all_inputs.symbols, values)).T, strict=True))
    for i, outer in enumerate(values["outer"]):
        k, l = side(d, 0, values, i), side(d, 1, values, i)
        parts = [touch(k, l, shift, outer) for shift in ends(l, length)]
        expected = {("orbit", 0): k.A[:, 0] @ (l.r - k.r), ("orbit", 1): k.A[:, 1] @ (l.r - k.r),
                    ("friction", 0): sum(-c.friction @ c.sliding for c in parts),
                    ("impact", 0): sum((c.normal - 200.0 * max(0.0, c.depth) ** 1.5) * c.rate for c in parts)}
        for end, c in enumerate(parts):
            read = {"gap": -c.depth, "gap_rate": -c.rate, "normal_force": c.normal, "slip": c.sliding @ c.t,
                    "friction_force": c.friction @ c.t, "friction_power": -c.friction @ c.sliding}
            expected |= {(name, end): value for name, value in read.items()}
        assert {target: column[i] for target, column in numbers.items()} == pytest.approx(expected, rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("outputs", [loads, seen])
def test_pin_that_cannot_tilt_touches_twice(outputs: Any) -> None:
    """In the plane both ends of a bearing do the same: twice the forces of one plane of contact, the same geometry."""
    plane = ((NodeKind.PLANAR, Axes.NORMAL),) * 2
    laws = {"normal": mb.Hertz(200.0, damping=0.3), "friction": mb.Coulomb(MU, V_C)}
    once, twice = (derived(JournalContact, plane, outer=0.6, inner=INNER, length=end, **laws) for end in (None, 0.4))
    values = RandomStates(twice, HERTZ | {"outer": 0.6, "length": 0.4}, np.random.default_rng(18), 12).values
    found = []
    for d in (once, twice):
        p = plan(d, outputs)
        numbers = p.kernel.values(columns(p.all_inputs.symbols, values))
        found.append({target: numbers[:, i] for i, target in enumerate(p.targets)})
    same = {("gap", 0), ("gap_rate", 0), ("slip", 0), ("orbit", 0), ("orbit", 1)}
    assert max(np.abs(column).max() for column in found[0].values()) > 1
    for target, column in found[0].items():
        assert found[1][target] == pytest.approx(column if target in same else 2 * column, rel=1e-12), target


def test_a_load_on_a_coordinate_is_the_drive_of_its_joint() -> None:
    """Told as such, beside springs and dampers, which are not; a torque needs a body that can turn."""
    s = mb.Scene("rail")
    block = s.rigid_body("block", 2.0, (1, 1, 1), at=(0, 0, 0))
    s.prismatic("P", s.ground, block, at=(0, 0, 0), axis=(1, 0, 0), force=3.0 + mb.t, spring=10.0, damper=1.0)
    r = s.simulate(0.5)
    np.testing.assert_allclose(r["P"].drive, 3.0 + r.t, rtol=1e-12)
    point = mb.Scene("point")
    point.point_mass("m", 1.0, at=(0, 0, 0))
    point.revolute("R", point.ground, "m", at=(0, 0, 0), torque=1.0)
    with pytest.raises(mb.SceneError, match="a torque does nothing on the point mass 'm'"):
        point.check()
