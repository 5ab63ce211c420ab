"""Gears by hand: accelerations by Lagrange with the reduced inertia, torques on the ground by the balance of angular momentum.

Couplings act by torques about the axes of their joints, so that all rates below are constant accelerations times the time. The
torque of a joint is all that goes through it, the part of a coupling too; over all joints on the ground these parts cancel.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import mbdae as mb

T_END = 0.5  # s
TIMES = np.linspace(0, T_END, 4)
SUN, PLANET, RING = 18, 24, 66  #: teeth
PLANETS, ARM, PLANET_MASS = 3, 0.042, 0.3  # -, m, kg
J_SUN, J_PLANET, J_CARRIER, J_RING = 2e-4, 1e-4, 3e-3, 8e-3  # kg m^2 about the axes


def wheel(s: mb.Scene, name: str, inertia: float, at: tuple[float, ...] = (0, 0, 0), mass: float = 1.0) -> object:
    """A wheel about z."""
    return s.rigid_body(name, mass, (0.6 * inertia, 0.6 * inertia, inertia), at=at)


def planetary(motor: float, load: float, on_ring: float | None = None) -> mb.Scene:
    """Sun with a motor, carrier with a load, three planets, and a ring that is held, or has a torque."""
    s = mb.Scene("planetary gear")
    sun, carrier, ring = wheel(s, "sun", J_SUN), wheel(s, "carrier", J_CARRIER), wheel(s, "ring", J_RING)
    s.revolute("S", s.ground, sun, at=(0, 0), torque=motor)
    s.revolute("C", s.ground, carrier, at=(0, 0), torque=load)
    s.revolute("R", s.ground, ring, at=(0, 0), **({"angle": 0.0} if on_ring is None else {"torque": on_ring}))
    for i in range(PLANETS):
        a = 2 * np.pi * i / PLANETS
        at = (ARM * np.cos(a), ARM * np.sin(a))
        planet = wheel(s, f"planet {i}", J_PLANET, at, PLANET_MASS)
        s.revolute(f"P{i}", carrier, planet, at=at)
        s.couple(f"mesh with the sun {i}", {"S.angle": SUN, "C.angle": -SUN, f"P{i}.angle": PLANET})
        s.couple(f"mesh with the ring {i}", {"R.angle": RING, "C.angle": -RING, f"P{i}.angle": -PLANET})
    return s


def planetary_errors() -> Iterator[tuple[str, float]]:
    """Ring held: freedom of the carrier. Ring free: freedoms of carrier and sun."""
    motor, load = 1.7, -4.0
    r = planetary(motor, load).simulate(T_END, outputs=TIMES)
    sun, spin = 1 + RING / SUN, 1 - RING / PLANET  # angles of the sun and of the planets, from the ground, over the carrier's
    carried = J_CARRIER + PLANETS * PLANET_MASS * ARM**2
    reduced = carried + PLANETS * J_PLANET * spin**2 + J_SUN * sun**2
    second = (motor * sun + load) / reduced
    for joint, ratio in (("C", 1.0), ("S", sun), ("P0", spin - 1), ("P2", spin - 1)):
        yield f"ring held, {joint}: acceleration", off(r[joint].rate, ratio * second * TIMES)
    momentum = (carried + PLANETS * J_PLANET * spin + J_SUN * sun) * second
    yield "ring held: torque on the ground", off(-total(r, "S", "C", "R") + motor + load, motor + load - momentum)
    held = r.multipliers[:, r.multiplier_names.index("R.drive")]
    yield "ring held: torque that holds it", off(held, momentum - motor - load)
    yield "ring held: all torques on the sun", off(on_axis(r, "S"), J_SUN * sun * second)
    on_ring = 2.5
    r = planetary(motor, load, on_ring).simulate(T_END, outputs=TIMES)
    # rates of sun, planets (from the ground) and ring, of those of carrier and sun
    rows = np.array([[0.0, 1.0], [1 + SUN / PLANET, -SUN / PLANET], [1 + SUN / RING, -SUN / RING], [1.0, 0.0]])
    mass = rows.T @ np.diag([J_SUN, PLANETS * J_PLANET, J_RING, carried]) @ rows
    second = np.linalg.solve(mass, np.array([load, motor]) + on_ring * rows[2])
    for joint, row in zip(("S", "R", "C"), rows[[0, 2, 3]], strict=True):
        yield f"ring free, {joint}: acceleration", off(r[joint].rate, row @ second * TIMES)
    yield "ring free: torque on the ground", off(total(r, "S", "C", "R"), motor + load + on_ring)


def differential_errors() -> Iterator[tuple[str, float]]:
    """J' = T + lambda of both outputs, J' = T - 2 lambda of the carrier."""
    J, T = np.array([0.02, 0.05, 0.11]), np.array([-1.5, -0.4, 6.0])
    s = mb.Scene("differential")
    for name, inertia, torque in zip("ABC", J, T, strict=True):
        s.revolute(name, s.ground, wheel(s, f"wheel {name}", inertia), at=(0, 0), torque=torque)
    s.differential("D", "A", "B", "C")
    r = s.simulate(T_END, outputs=TIMES)
    share = (2 * T[2] / J[2] - T[0] / J[0] - T[1] / J[1]) / (1 / J[0] + 1 / J[1] + 4 / J[2])
    for name, second in zip("ABC", (T + share * np.array([1, 1, -2])) / J, strict=True):
        yield f"differential, {name}: acceleration", off(r[name].rate, second * TIMES)


def rack_errors() -> Iterator[tuple[str, float]]:
    """(J + m r^2) angle'' = torque + r force."""
    J, m, radius, torque, force = 0.003, 2.0, 0.05, 0.9, -7.0
    s = mb.Scene("rack", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, wheel(s, "pinion", J, (0, radius, 0)), at=(0, radius), torque=torque)
    s.prismatic("S", s.ground, s.rigid_body("rack", m, 0.01, at=(0.3, 0)), at=(0, 0), axis=(1, 0, 0), force=force)
    s.rack("mesh", "A", "S", radius=radius)
    r = s.simulate(T_END, outputs=TIMES)
    second = (torque + radius * force) / (J + m * radius**2)
    yield "rack: angle", off(r["A"].angle, second * TIMES**2 / 2)
    yield "rack: displacement", off(r["S"].displacement, radius * second * TIMES**2 / 2)
    yield "rack: weight", off(r["S"].force[:, 1], m * 9.81)


def arm_errors() -> Iterator[tuple[str, float]]:
    """Two wheels that mesh on an arm that turns freely: angles of the arm and, relative to it, of the first wheel."""
    for ratio in (-2.0, 0.7):
        first, second, arm, m, length = 0.01, 0.04, 0.3, 1.5, 0.6
        motor, on_arm = 0.8, -0.5
        s = mb.Scene("gear on an arm")
        body = wheel(s, "arm", arm)
        s.revolute("C", s.ground, body, at=(0, 0), torque=on_arm)
        s.revolute("A", body, wheel(s, "a", first), at=(0, 0), torque=motor)
        s.revolute("B", body, wheel(s, "b", second, (length, 0, 0), m), at=(length, 0))
        s.gear("G", "A", "B", ratio=ratio)
        r = s.simulate(T_END, outputs=TIMES)
        mixed = first + ratio * second
        mass = np.array([[arm + m * length**2 + first + second, mixed], [mixed, first + ratio**2 * second]])
        rates = np.linalg.solve(mass, [on_arm, motor])
        for name, value in (("C", rates[0]), ("A", rates[1]), ("B", ratio * rates[1])):
            yield f"gear on an arm, ratio {ratio:g}, {name}: acceleration", off(r[name].rate, value * TIMES)
        yield f"gear on an arm, ratio {ratio:g}: torque on the ground", off(on_axis(r, "C"), on_arm)


def mill_errors() -> Iterator[tuple[str, float]]:
    """A wheel rolls round a post, its axis on a turning arm: J spin speed is the rate of its angular momentum."""
    J, radius, way, speed, weight = 0.08, 0.2, 0.5, 4.0, 30.0
    s = mb.Scene("mill", gravity=(0, 0, -weight / 3.0))
    arm = s.rigid_body("arm", 1.0, (0.1, 0.1, 0.1), at=(0, 0, 0))
    roll = s.rigid_body("wheel", 3.0, (J, 0.05, 0.05), at=(way, 0, 0))
    s.revolute("C", s.ground, arm, at=(0, 0, 0), axis=(0, 0, 1), angle=speed * mb.t)
    s.revolute("B", arm, roll, at=(way, 0, 0), axis=(1, 0, 0))
    s.couple("rolls", {"B.angle": radius, "C.angle": way})
    r = s.simulate(T_END, accuracy=1e-9, outputs=TIMES)
    spin, tangent = -way / radius * speed, np.column_stack([-np.sin(speed * TIMES), np.cos(speed * TIMES), 0 * TIMES])
    yield "mill: spin", off(r["B"].rate, spin)
    yield "mill: gyroscopic torque", off(np.sum(r["B"].torque * tangent, axis=1), J * spin * speed)
    yield "mill: load on the ground", off(r["C"].force[:, 2], weight * (1 + 1 / 3.0))
    lever = weight * way  # the weight of the wheel on its arm, about the tangent
    yield "mill: bearing of the arm", off(np.sum(r["C"].torque * tangent, axis=1), J * spin * speed - lever)


def on_axis(r: mb.Result, joint: str) -> np.ndarray:
    """Torque of a joint on its body l about z."""
    return np.asarray(r[joint].torque[:, 2])


def total(r: mb.Result, *joints: str) -> np.ndarray:
    """Sum of the torques of joints about z."""
    return np.sum([on_axis(r, joint) for joint in joints], axis=0)


def off(found: np.ndarray, expected: np.ndarray | float) -> float:
    """Largest difference over the largest expected value."""
    return float(np.max(np.abs(found - expected)) / np.max(np.abs(expected)))


def errors() -> Iterator[tuple[str, float]]:
    """All of them."""
    for each in (planetary_errors, differential_errors, rack_errors, arm_errors, mill_errors):
        yield from each()
