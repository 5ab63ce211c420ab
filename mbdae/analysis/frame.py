"""The frame an analysis is resolved in, and the motions that are steady in it.

A motion is steady in a frame that turns at the constant rate omega where the velocity and the angular velocity of every
node, resolved in the frame, are constant: v' = omega x v, w' = omega x w.

Accelerations of scenes with beams, from stresses that are given: strains computed from positions would have their rounding
errors, which the stiffness of a beam turns into large forces.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from mbdae.errors import OptionError
from mbdae.scene.components import Beam, Body
from mbdae.scene.scene import SceneData
from mbdae.symbolic.frames import NodeKind
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.assembled.right_hand_side import state_rates
from mbdae.system.base import Array
from mbdae.system.model.model import Model
from mbdae.system.model.nodes import Node, quaternion_product, rotation_of, turned
from mbdae.system.motion.mechanics import Mechanics
from mbdae.values import largest, shown

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class RotatingFrame:
    """Axes (columns of `rotation`, inertial) that turn at `rate` (3,) rad/s, inertial; `node`: None for the ground."""

    name: str
    rotation: Array
    rate: Array
    node: Node | None = None

    @property
    def turns(self) -> bool:
        """Whether the axes turn at all."""
        return bool(np.any(self.rate))


def body_of(scene: SceneData, frame: Any) -> Body:
    """The body a `frame` option names; refuses what has no axes."""
    bodies = {body.name: body for body in (scene.ground, *scene.bodies)}
    name = frame.name if isinstance(frame, Body) else frame
    if not isinstance(name, str) or name not in bodies:
        with_axes = ", ".join([repr(n) for n, b in bodies.items() if not (b.is_point or isinstance(b, Beam))][:12])
        raise OptionError(f"frame = {shown(name)} is no body of scene '{scene.name}': give s.ground or one of {with_axes}")
    body = bodies[name]
    if body.is_point:
        raise OptionError(f"frame = '{body.name}': a point mass has no axes; give s.ground or a rigid body")
    if isinstance(body, Beam):
        raise OptionError(f"frame = '{body.name}': a beam bends and has no axes as a whole; give s.ground or a rigid body")
    return body


def frame_at(model: Model, frame: Any, q: Array, u: Array) -> RotatingFrame:
    """The frame of a body at positions q (nq,) and velocities u (nu,)."""
    body = body_of(model.scene, frame)
    node = model.node(body)
    if node is None:
        return RotatingFrame("ground", np.eye(3), np.zeros(3))
    rate = angular_velocity(node, q, u)
    size = float(np.max(np.abs(u), initial=0.0))
    rate = np.where(np.abs(rate) > 1e-10 * size, rate, 0.0)  # a smaller rate is a rounding error of the projected start
    return RotatingFrame(body.name, attitude(node, q), rate, node)


def attitude(node: Node, q: Array) -> Array:
    """R (3, 3) of a node, body to inertial."""
    return rotation_of(node.kind, q[node.q : node.q + node.kind.sizes[0]])


def position(node: Node, q: Array) -> Array:
    """r (3,), m, of a node; a planar one has z = 0."""
    r = np.zeros(3)
    r[: node.kind.translations] = q[node.q : node.q + node.kind.translations]
    return r


def velocity(node: Node, u: Array) -> Array:
    """v (3,), m/s, of a node."""
    v = np.zeros(3)
    v[: node.kind.translations] = u[node.u : node.u + node.kind.translations]
    return v


def angular_velocity(node: Node, q: Array, u: Array) -> Array:
    """omega (3,), rad/s, of a node, inertial components."""
    if node.kind is NodeKind.SPATIAL:
        return np.asarray(attitude(node, q) @ u[node.u + 3 : node.u + 6])
    return np.array([0.0, 0.0, u[node.u + 2]]) if node.kind is NodeKind.PLANAR else np.zeros(3)


def set_velocity(node: Node, q: Array, u: Array, v: Array, omega: Array) -> None:
    """Write v and omega (inertial) of a node into u (nu,); or accelerations of a node into u' (nu,)."""
    n = node.kind.translations
    u[node.u : node.u + n] = v[:n]
    if node.kind is NodeKind.SPATIAL:
        u[node.u + 3 : node.u + 6] = attitude(node, q).T @ omega
    elif node.kind is NodeKind.PLANAR:
        u[node.u + 2] = omega[2]


def nodes_in_space(model: Model) -> list[Node]:
    """Nodes that have a position in space: all except those whose unknown is a coordinate of a joint."""
    return [n for n in model.nodes if not n.kind.of_joint]


def steady_acceleration(model: Model, frame: RotatingFrame, q: Array, u: Array) -> Array:
    """u' (nu,) of the motion that is steady in the frame."""
    up = np.zeros(model.nu)
    for node in nodes_in_space(model) if frame.turns else ():
        v, omega = velocity(node, u), angular_velocity(node, q, u)
        set_velocity(node, q, up, np.cross(frame.rate, v), np.cross(frame.rate, omega))
    return up


def free_shifts(model: Model, frame: RotatingFrame, q: Array, w: Array) -> Array:
    """(nu, 7) motions along the frame's axes that a scene may be shifted along without forces: three translations and three
    rotations of everything, and its own motion w (nu,)."""
    found = np.zeros((model.nu, 7))
    for node in nodes_in_space(model):
        n, size = node.kind.translations, node.kind.sizes[1]
        arm = frame.rotation.T @ position(node, q)
        found[node.u : node.u + n, :3] = np.eye(3)[:n]
        found[node.u : node.u + n, 3:6] = -skew(arm)[:n]
        found[node.u + n : node.u + size, 3:6] = np.eye(3)[3 - (size - n) :]
    found[:, 6] = w
    return found


def spins(model: Model, frame: RotatingFrame, w: Array) -> list[Array]:
    """Turns (nu, 1) of single bodies, and of coordinates, at the rates of a motion w (nu,) along the frame's axes, beside the
    frame's own."""
    found = []
    for node in model.nodes:
        n, size = 0 if node.kind is NodeKind.COORDINATE else node.kind.translations, node.kind.sizes[1]
        rate = w[node.u + n : node.u + size].copy()
        if node.kind is NodeKind.SPATIAL:
            rate -= frame.rotation.T @ frame.rate
        if np.any(rate):
            found.append(np.zeros((model.nu, 1)))
            found[-1][node.u + n : node.u + size, 0] = rate
    return found


def advanced(mechanics: Mechanics, frame: RotatingFrame, q: Array, u: Array, tau: float) -> tuple[Array, Array]:
    """Positions and velocities a time tau (s) later on the motion that is steady in the frame."""
    q, u = q.copy(), u.copy()
    E, S = _turn(frame.rate, tau)
    for node in mechanics.model.nodes:
        if node.kind is NodeKind.COORDINATE:
            q[node.q] += tau * u[node.u]
            continue
        if node.kind is NodeKind.ROTATION:
            q[node.q : node.q + 4] = turned(q[node.q : node.q + 4], tau * u[node.u : node.u + 3])
            continue
        v, omega, n = velocity(node, u), angular_velocity(node, q, u), node.kind.translations
        q[node.q : node.q + n] += (S @ v)[:n]
        if node.kind is NodeKind.PLANAR:
            q[node.q + 2] += tau * omega[2]
        elif node.kind is NodeKind.SPATIAL:
            relative = quaternion_product(turned(IDENTITY, tau * frame.rate), turned(IDENTITY, tau * (omega - frame.rate)))
            q[node.q + 3 : node.q + 7] = quaternion_product(relative, q[node.q + 3 : node.q + 7])
        set_velocity(node, q, u, E @ v, E @ omega)
    return q, u


def _turn(rate: Array, tau: float) -> tuple[Array, Array]:
    """exp(rate~ tau) and its integral from 0 to tau, both (3, 3)."""
    size = float(np.linalg.norm(rate))
    if size == 0:
        return np.eye(3), tau * np.eye(3)
    n, angle = skew(rate / size), size * tau
    E = np.eye(3) + np.sin(angle) * n + (1 - np.cos(angle)) * n @ n
    S = tau * np.eye(3) + (1 - np.cos(angle)) / size * n + (tau - np.sin(angle) / size) * n @ n
    return E, S


def skew(a: Array) -> Array:
    """a~ (3, 3) with a~ b = a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def motion_in_words(model: Model, motion: Array, units: Array) -> str:
    """The body that moves most in a motion (nu,), components in the frame's axes, and how.

    Of bodies that move alike (a disc and its housing tilting together) it is the first of the scene, whatever the rounding.
    """
    size = np.abs(motion) / units
    worst = largest(size)
    node = next(n for n in model.nodes if n.u <= worst < n.u + n.kind.sizes[1])
    part = motion[node.u : node.u + node.kind.sizes[1]]
    if node.kind is NodeKind.COORDINATE:
        return f"the coordinate of joint '{node.name}'"
    n = node.kind.translations
    move = worst - node.u < n
    part = part[:n] if move else part[n:]
    part = part * np.sign(motion[worst]) / np.linalg.norm(part)
    direction = ", ".join(f"{c:.2g}" for c in np.where(np.abs(part) < 1e-9, 0.0, part))
    how = f"moving along ({direction})" if move else "turning" if len(part) == 1 else f"turning about ({direction})"
    return f"'{node.name}' {how}"


#: strain that rounding errors of positions may cause (1e-14), divided by the relative tolerance with which forces are compared
#: (`steady.STEADY`, 1e-4). In a scene with beams differences of forces are taken relative to the largest force, or to the force
#: that this strain causes in the stiffest beam, where that is larger
UNRESOLVED = 1e-10


@dataclass(frozen=True)
class Dynamics:
    """y and y' (n,) of a system in motion, its accelerations (nu,), and the largest force on a node in N m: a force times the
    scene's length, a torque times 1 rad."""

    y: Array
    yp: Array
    acceleration: Array
    force: float


def stresses_of(m: Mechanics, q: Array, u: Array) -> Array:
    """Stresses (nz,) of all beams, computed from positions and velocities."""
    return np.concatenate([np.zeros(0), *(line.stress(q, u) for line in m.model.lines)])


def dynamics(system: Assembly, m: Mechanics, t: float, q: Array, u: Array, s: Array, z: Array) -> Dynamics:
    """Accelerations and multipliers of a complete index-3 system at time t, positions q, velocities u, internal states s and
    given stresses z."""
    kinds, momentum, at = np.array(system.kinds), slice(m.nq, m.nq + m.nu), np.array([t])
    y, yp, F = np.zeros(system.n), np.zeros(system.n), np.empty(system.n)
    y[kinds == "q"], y[kinds == "v"], y[kinds == "s"], y[kinds == "z"] = q, u, s, z
    yp[kinds == "q"], yp[kinds == "s"] = m.rates(q, u), state_rates(m, t, q, u, s)
    system.residual(t, y, yp, F)
    G = sp.csc_matrix(m.constraint_jacobian(at, q[None])[0])
    K = sp.bmat([[m.mass, G.T], [G, None]], format="csc") if m.m else sp.csc_matrix(m.mass)
    x = splu(K).solve(np.r_[-F[momentum], -m.acceleration_bias(at, q[None], u[None])[0]])
    a, multipliers = x[: m.nu], x[m.nu :]
    yp[momentum] = a
    y[kinds == "lambda"] = multipliers / system.numbering.scaling()
    parts = (np.abs(F[momentum]), np.abs(m.mass @ a), abs(G.T) @ np.abs(multipliers), add_dead_loads(m, np.zeros(m.nu)))
    return Dynamics(y, yp, a, max(float(np.max(part * m.velocity_units, initial=0.0)) for part in parts))


def add_dead_loads(m: Mechanics, force: Array) -> Array:
    """Forces (nu,) with the absolute values of the dead loads of beams added in place: a measure of the size of all forces."""
    for line in m.model.lines:
        np.add.at(force, line.places("u").ravel(), np.abs(line.dead).ravel())
    return force


def unresolved(m: Mechanics) -> float:
    """Largest force, in N m as in `Dynamics`, that rounding errors of the positions can cause in the stiffest beam."""
    stiffest = [1 / min((v for n, v in line.numbers.items() if n.startswith("compliance_N") and v > 0), default=np.inf)
                for line in m.model.lines]
    return UNRESOLVED * max(stiffest, default=0.0) * m.model.length


def forces_off(m: Mechanics, acceleration: Array, found: Dynamics) -> Array:
    """(nu,) mass times the difference of the accelerations given and found, relative to the largest force."""
    off: Any = np.abs(m.mass @ (found.acceleration - acceleration)) * m.velocity_units
    return np.asarray(off / max(found.force, unresolved(m), 1e-300))
