"""Steady motions: the velocities of rest in a frame, and whether the motion from a state is steady."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from mbdae.analysis.frame import (
    RotatingFrame,
    add_dead_loads,
    advanced,
    angular_velocity,
    attitude,
    dynamics,
    forces_off,
    frame_at,
    nodes_in_space,
    position,
    set_velocity,
    steady_acceleration,
    velocity,
)
from mbdae.errors import OptionError, StartError
from mbdae.scene.components import Body
from mbdae.symbolic.outputs import loads
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.assembled.right_hand_side import state_rates
from mbdae.system.base import Array
from mbdae.system.model.nodes import JointMotion, Node
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.prepare import Prepared
from mbdae.system.start import Starter
from mbdae.values import largest

#: acceleration, in lengths of the scene and rad per s^2, of which the part that counts as rest is round-off
SMALLEST = 1e-6
#: relative change below which a motion counts as steady; also the largest angular velocity, relative to a natural frequency of
#: the scene, with which it counts as at rest. Eigenvalues change by about as much
STEADY = 1e-4


def reason_not_steady(prepared: Prepared, frame: RotatingFrame, t: float, q: Array, u: Array, s: Array,
              tolerance: float = STEADY, beams: tuple[Assembly, Array] | None = None) -> str | None:
    """Why the motion from a state is not steady in the frame; None where it is. beams: for a scene with beams its complete
    system with stresses, and their values, which a steady motion keeps."""
    m = prepared.mechanics
    rates = state_rates(m, t, q, u, s) if len(s) else s
    for tau in (0.0, *times_to_compare(m, frame, t, q, u, s)):
        qt, ut = advanced(m, frame, q, u, tau) if tau else (q, u)
        reason = _constraints_broken(m, t + tau, qt, ut, tolerance)
        if reason is None and beams is not None:
            reason = _accelerates_by_stresses(m, frame, beams, (t + tau, qt, ut, s + tau * rates), tolerance)
        elif reason is None:
            reason = _accelerates(m, frame, t + tau, qt, ut, s + tau * rates, tolerance)
        if reason:
            return reason + (f" after {tau:.3g} s" if tau else "")
    return None


def times_to_compare(m: Mechanics, frame: RotatingFrame, t: float, q: Array, u: Array, s: Array) -> tuple[float, ...]:
    """Times (s) after which a steady motion is evaluated again: the fastest body has then turned by 0.61 and 1.7 rad. No rotor
    looks the same after both angles, as one with three blades does after a third of a turn."""
    spins = [float(np.linalg.norm(angular_velocity(node, q, u))) for node in nodes_in_space(m.model)]
    fastest = max([*spins, float(np.linalg.norm(frame.rate))])
    timed = any(instance.timed for group in m.model.groups for instance in group.instances)
    natural = np.sqrt(np.max(acceleration_scale(m, np.array([t]), q, np.zeros_like(u), s), initial=0.0))
    if fastest <= STEADY * natural:  # slow enough to count as at rest
        moving = np.max(np.abs(u) / m.velocity_units, initial=0.0) > STEADY
        return (0.37, 1.3) if timed or moving else ()
    return (0.61 / fastest, 1.7 / fastest)


def _constraints_broken(m: Mechanics, t: float, q: Array, u: Array, tolerance: float) -> str | None:
    if not m.m:
        return None
    at, speed = np.array([t]), float(np.max(np.abs(u) / m.velocity_units, initial=0.0))
    size = np.max(np.abs(m.constraint_jacobian(at, q[None])[0]) * m.velocity_units, axis=1)
    size[size == 0] = 1.0
    for off, scale in ((m.position_residual(at, q[None])[0], 1.0), (m.velocity_residual(at, q[None], u[None])[0], speed)):
        worst = largest(np.abs(off) / size)
        if abs(off[worst]) > tolerance * size[worst] * scale:
            return f"a motion that is steady there violates constraint {m.rows[worst].name}"
    return None


def _accelerates(m: Mechanics, frame: RotatingFrame, t: float, q: Array, u: Array, s: Array, tolerance: float) -> str | None:
    at = np.array([t])
    a = m.accelerations(at, q[None], u[None], s[None])[0][0]
    off = (a - steady_acceleration(m.model, frame, q, u)) / m.velocity_units
    beyond = np.abs(off) / acceleration_scale(m, at, q, u, s)
    worst = largest(beyond) if len(off) else 0
    if np.max(beyond, initial=0.0) <= tolerance:
        return None
    unit = "rad/s^2" if m.rotational[worst] else "m/s^2"
    node = next(n for n in m.model.nodes if n.u <= worst < n.u + n.kind.sizes[1])
    return f"'{node.name}' accelerates there at {abs(off[worst] * m.velocity_units[worst]):.3g} {unit}"


def _accelerates_by_stresses(m: Mechanics, frame: RotatingFrame, beams: tuple[Assembly, Array],
                             state: tuple[float, Array, Array, Array], tolerance: float) -> str | None:
    t, q, u, s = state
    found = dynamics(beams[0], m, t, q, u, s, beams[1])
    off = forces_off(m, steady_acceleration(m.model, frame, q, u), found)
    worst = largest(off)
    if off[worst] <= tolerance:
        return None
    node = next(n for n in m.model.nodes if n.u <= worst < n.u + n.kind.sizes[1])
    return f"a force that is not balanced, {off[worst]:.2g} of the largest, accelerates '{node.name}' there"


def acceleration_scale(m: Mechanics, t: Array, q: Array, u: Array, s: Array | None) -> Array:
    """(nu,) sizes that accelerations (in units of the scene's length and 1 rad, 1/s^2) are compared with.

    The absolute values of the single forces on a node (their sum vanishes at rest) over its mass, at least a thousandth of the
    largest in the scene since joints transmit forces, and the largest where a node has no mass; plus the largest force on a node
    without mass, over the largest mass, since joints transmit that too; plus the squared speed, and SMALLEST: terms inside of a
    single force may cancel at rest."""
    units, force = m.velocity_units, np.zeros(m.nu)
    for g, p, values in m.evaluate(loads, t, q[None], u[None], None if s is None else s[None]):
        for o, target in enumerate(p.targets):
            for i in range(values.shape[1]):
                force[m.numbering.velocity(target, g, i)] += abs(values[0, i, o])
    force = add_dead_loads(m, force)
    heavy, inertia = m.mass.diagonal() > 0, m.weight.diagonal() * units**2
    carried = float(np.max((force * units)[~heavy], initial=0.0) / np.max(inertia, initial=SMALLEST))
    force = np.where(heavy, force * units / inertia, 0.0)
    scale = np.full(m.nu, np.max(force, initial=0.0))
    for node in m.model.nodes:
        own = slice(node.u, node.u + node.kind.sizes[1])
        if np.any(heavy[own]):
            scale[own] = max(float(np.max(force[own])), 1e-3 * float(np.max(force)))
    return np.asarray(scale + carried + float(np.max(np.abs(u) / units, initial=0.0)) ** 2 + SMALLEST)


class Rest:
    """Rest in a frame: the ground, or a body that turns steadily about a fixed axis through `center`."""

    def __init__(self, prepared: Prepared, frame: Any) -> None:
        self.prepared, self.mechanics, self.start = prepared, prepared.mechanics, prepared.start
        self.model, self.t = prepared.model, np.array([prepared.start.t])
        self.frame = frame_at(self.model, frame, self.start.q, self.start.u)
        self.center = self._center()

    def _center(self) -> Array:
        node, rate = self.frame.node, self.frame.rate
        if node is None:
            return np.zeros(3)
        r, v = position(node, self.start.q), velocity(node, self.start.u)
        size = float(np.linalg.norm(rate))
        along = float(np.linalg.norm(v)) if size == 0 else abs(float(v @ rate)) / size
        if along > 1e-8 * (float(np.linalg.norm(v)) + size * self.model.length):
            along_its_axis = "along its axis of rotation " if size else ""
            raise OptionError(f"frame = '{node.name}': it translates {along_its_axis}at {along:.4g} m/s; a frame may turn "
                              f"steadily about a fixed axis: take s.ground or another body, or start it without that "
                              f"velocity")
        return r + np.cross(rate, v) / size**2 if size else r

    @cached_property
    def starter(self) -> Starter:
        """Closes joints and projects velocities, at the start's time."""
        return Starter(self.mechanics, float(self.t[0]), holding=False, changes=[])

    def axes(self, q: Array) -> RotatingFrame:
        """The frame at positions q."""
        return RotatingFrame(self.frame.name, frame_at(self.model, self.frame.name, q, self.start.u).rotation, self.frame.rate,
                             self.frame.node)

    def velocities(self, q: Array) -> Array:
        """u (nu,): every node turns with the frame, and its body spins relative to it as at the start, about axes of the body."""
        u = self._coordinate_rates.copy()
        if not (self.frame.turns or any(np.any(spin) for _, spin in self._spins)):
            return u
        for node, spin in self._spins:
            self._turn(node, q, u, self.frame.rate + attitude(node, q) @ spin)
        return u

    @cached_property
    def _spins(self) -> list[tuple[Node, Array]]:
        """Angular velocity (3,) of every node relative to the frame, along the axes of its body."""
        q, u = self.start.q, self._at_start
        relative = [(node, angular_velocity(node, q, u) - self.frame.rate) for node in nodes_in_space(self.model)]
        return [(node, attitude(node, q).T @ spin if node.kind.turns else np.zeros(3)) for node, spin in relative]

    @cached_property
    def _coordinate_rates(self) -> Array:
        """(nu,) with the rates of the joints' own coordinates, zero elsewhere."""
        own = np.zeros(self.mechanics.nu)
        for node in self.model.joint_coordinates:
            own[node.u] = self._at_start[node.u]
        return own

    @cached_property
    def _at_start(self) -> Array:
        """u (nu,) at the start's positions, with the spins that joints and drives prescribe."""
        q, u = self.start.q, np.zeros(self.mechanics.nu)
        for node in nodes_in_space(self.model):
            self._turn(node, q, u, self.frame.rate)
        if self._fits(q, u):
            return u
        self._spin(q, u)
        if self._fits(q, u):
            return u
        try:
            return self.starter.project_velocities(q, u)
        except StartError as error:
            raise OptionError(f"no state is at rest in the frame of '{self.frame.name}': {error.problems[0]}; give another "
                              f"frame=, or prescribe rates that fit together") from error

    def _turn(self, node: Node, q: Array, u: Array, omega: Array) -> None:
        set_velocity(node, q, u, np.cross(self.frame.rate, position(node, q) - self.center), omega)

    def _fits(self, q: Array, u: Array, joint: str | None = None) -> bool:
        """Whether velocities satisfy all rows, or those of one joint."""
        off = np.abs(self.mechanics.velocity_residual(self.t, q[None], u[None])[0])
        if joint is not None:
            off = off[[row.name.rsplit(".", 1)[0] == joint for row in self.mechanics.rows]]
        return bool(np.max(off, initial=0.0) <= 1e-9 * (1e-9 + float(np.max(np.abs(u), initial=0.0))))

    def _spin(self, q: Array, u: Array) -> None:
        """Write spins into u, from the roots of the tree outwards: where a joint does not allow the frame's rotation, its body
        turns with the body before it, or as the joint is driven."""
        spin: dict[Body, Array] = {self.model.scene.ground: np.zeros(3)}
        nodes: dict[Body, list[Node]] = {}
        for node, body in self.model.bodies:
            nodes.setdefault(body.owner, []).append(node)
        for root in self.starter.tree.roots:
            spin.setdefault(root, self.frame.rate)
        poses = self.starter._poses(q)
        for parent, joint, child in self.starter.tree.edges:
            spin[child] = self.frame.rate
            if self._fits(q, u, joint.name):
                continue
            driven = {c: rate for c, rate in self.starter.held_rates(joint).items() if c in joint.prescribed}
            _, _, turning = JointMotion(joint, float(self.t[0])).rates(self.starter.held_values(joint), driven)
            turning = poses[joint.k.owner][1] @ joint.k.drawn.rotation.T @ turning
            spin[child] = spin[parent] + (turning if joint.l is child else -turning)
            for node in nodes[child]:
                self._turn(node, q, u, spin[child])

    def departs(self, q: Array, u: Array) -> str | None:
        """Why velocities are not those of rest in the frame; None where they are. A body may spin on the spot."""
        size = 1e-7 * (float(np.max(np.abs(u) / self.mechanics.velocity_units, initial=0.0)) + 1e-12)
        for node in nodes_in_space(self.model):
            off = velocity(node, u) - np.cross(self.frame.rate, position(node, q) - self.center)
            if np.linalg.norm(off) > size * self.model.length:
                return f"'{node.name}' moves there at {np.linalg.norm(off):.4g} m/s"
        return self._driven(q, u, size)

    def _driven(self, q: Array, u: Array, size: float) -> str | None:
        if not self.mechanics.m:
            return None
        rate = self.mechanics.velocity_residual(self.t, q[None], u[None])[0]
        worst = largest(np.abs(rate))
        if abs(rate[worst]) > size * max(1.0, self.model.length):
            return (f"joints or prescribed motions keep the scene moving there: constraint {self.mechanics.rows[worst].name} by "
                    f"{abs(rate[worst]):.4g} m/s or rad/s")
        up = steady_acceleration(self.model, self.frame, q, u)
        G, gamma = (f(self.t, q[None], *more)[0] for f, more in
                    ((self.mechanics.constraint_jacobian, ()), (self.mechanics.acceleration_bias, (u[None],))))
        off, terms = G @ up + gamma, np.abs(G) @ np.abs(up) + np.abs(gamma)
        spin = max(float(np.linalg.norm(angular_velocity(n, q, u))) for n in nodes_in_space(self.model))
        worst = largest(np.abs(off))
        if abs(off[worst]) <= 1e-7 * (terms[worst] + spin**2 * np.max(np.abs(G[worst]))) + 1e-12:
            return None
        return (f"constraint {self.mechanics.rows[worst].name} prescribes a motion that is not steady, with an acceleration of "
                f"{abs(off[worst]):.4g} m/s^2 or rad/s^2")
