"""The start: consistent positions, velocities, accelerations and multipliers, and what had to be changed for them.

The scene is drawn with every joint at 0. Prescribed and held values are kept; every other joint of the tree starts
at relative rest; loops close by the smallest mass-weighted change of what is not held.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mbdae.errors import StartError
from mbdae.inputs import timed
from mbdae.scene.components import Body, Connection
from mbdae.scene.topology import spanning_tree
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Element, Joint
from mbdae.symbolic.outputs import Target, coordinate, scatter_pair
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.least_change import least_change
from mbdae.system.lines import drawn_quaternion
from mbdae.system.mechanics import Mechanics
from mbdae.system.rigid import RigidMotions
from mbdae.system.rotations import quaternion_product, rotation_matrices, rotation_of, turned

CLOSED = 1e-12  #: relative to the scene's length and 1 rad: a closed loop


@dataclass
class Start:
    """Consistent start of a scene: q, u, s, accelerations, multipliers; `changes` in sentences. Of a run to be continued with
    other joint models also the names of its internal states `s`, and the coordinates (rad or m, turns counted) of its joints."""

    t: float
    q: Array
    u: Array
    s: Array
    acceleration: Array
    multipliers: Array
    changes: list[str] = field(default_factory=list)
    names: tuple[str, ...] | None = None
    coordinates: dict[str, float] = field(default_factory=dict)


def coordinate_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """The joint coordinate, its rate and its gradient."""
    out, v = coordinate(d), d.variation
    for f in d.frames if out else ():
        pair = tuple(type(part)(*map(v.resolve, part)) for part in v.gradient(f, d.coordinate))
        out += [(("C", *t[1:]), e) for t, e in scatter_pair(f, pair)]  # type: ignore[arg-type]
    return out


def branch_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Expressions that must be positive on the right branch of the constraints."""
    if not isinstance(d.law, Joint) or not all(f.kind.oriented for f in d.sides):
        return []
    return [(("branch", name), d.variation.resolve(d.variation.name(e))) for name, e in d.law.branches(*d.sides).items()]


def state_start_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Start values of internal states."""
    return [] if isinstance(d.law, Element) else [(("s", j), e) for j, e in enumerate(d.state_starts)]


class Starter:
    """Finds the start of a model by mass-weighted Gauss-Newton and projections."""

    def __init__(self, mechanics: Mechanics, t0: float = 0.0, holding: bool = True,
                 changes: list[str] | None = None) -> None:  # fmt: skip
        self.holding = holding
        self.mechanics, self.model, self.t = mechanics, mechanics.model, np.array([t0])
        self.scene, self.tree = self.model.scene, spanning_tree(self.model.scene)
        self.changes = changes if changes is not None else []
        self.rigid = RigidMotions(self.model)
        self._roots: tuple[Any, Array] | None = None

    def run(self, q: Array, u: Array | None = None) -> Start:
        """From closed positions and velocities, by default those of the tree: states, accelerations and multipliers."""
        self.check_branches(q)
        u = self.project_velocities(q, self.carried(q) if u is None else u)
        s = self.states(q, u)
        a, multipliers = self.mechanics.accelerations(self.t, q[None], u[None], s[None])
        return Start(float(self.t[0]), q, u, s, a[0], multipliers[0], self.changes)

    # -- positions

    def placed(self) -> Array:
        """Positions of the tree with every held coordinate at its value."""
        motion = {b: (np.eye(4)[0], np.zeros(3)) for b in self.tree.roots}
        for parent, joint, child in self.tree.edges:
            P, r = motion[parent]
            value = self.held_value(joint) or 0.0
            dP, dr = _motion(joint, value if joint.l is child else -value)
            motion[child] = (quaternion_product(P, dP), rotation_matrices(P) @ dr + r)
        q = np.zeros(self.model.nq)
        for node, body in self.model.bodies:
            P, r = motion[body.owner]
            n = node.kind.translations
            q[node.q : node.q + n] = (rotation_matrices(P) @ body.position + r)[:n]
            if node.kind is NodeKind.PLANAR:
                q[node.q + 2] = self._unwrapped_heading(body)
            elif node.kind is NodeKind.SPATIAL:
                q[node.q + 3 : node.q + 7] = quaternion_product(P, drawn_quaternion(body))
        for node in self.model.joint_coordinates:
            q[node.q] = self.held_value(self.scene[node.name]) or 0.0
        return q

    def _unwrapped_heading(self, body: Body) -> float:
        """Heading as drawn plus the turn along the tree, whole turns included."""
        turn, at = 0.0, body.owner
        while at not in self.tree.roots:
            parent, joint, _ = next(e for e in self.tree.edges if e[2] is at)
            if joint.kind == "revolute":
                turn += (self.held_value(joint) or 0.0) * (1 if joint.l is at else -1) * np.sign(joint.joint.axis[2])
            at = parent
        return body.heading + turn

    def held_value(self, joint: Connection) -> float | None:
        """Start value of a joint's coordinate, if the user fixed it."""
        if joint.prescribed is not None:
            return timed.value_at(joint.prescribed, self.t[0])
        if joint.hold is not None:
            return float(joint.hold)
        return None

    def held_rate(self, joint: Connection) -> float | None:
        """Start rate of a joint's coordinate, if the user fixed it."""
        if joint.prescribed is not None:
            return timed.rate_at(joint.prescribed, self.t[0])
        return None if joint.hold_rate is None else float(joint.hold_rate)

    def close(self, q: Array) -> Array:
        """Close loops: mass-weighted Gauss-Newton with backtracking on the constraints and the held coordinates."""
        before, g = q, self._closure(q)
        for _ in range(50):
            A = self._closure_jacobian(q)
            units = self._row_units(A)
            size = _largest(g, units)
            if size <= CLOSED:
                break
            step, factor = self._least_change(A, -g, q), 1.0
            while factor > 1e-4:
                candidate = self.moved(q, factor * step)
                g_new = self._closure(candidate)
                if _largest(g_new, units) < size:
                    break
                factor /= 2
            if factor <= 1e-4:
                break
            q, g = candidate, g_new
        if size > 1e-9:
            raise StartError([self._cannot_close(int(np.argmax(np.abs(g) / units)), g, A)])
        self._report_positions(before, q)
        return q

    def _cannot_close(self, worst: int, g: Array, A: Array) -> str:
        if worst >= self.mechanics.m:
            joint = self._held_joints(self.held_value)[worst - self.mechanics.m]
            unit = "rad" if joint.kind == "revolute" else "m"
            return (f"the held value {self.held_value(joint):.6g} of '{joint.name}' cannot be reached: the loop stays off by "
                    f"{abs(g[worst]):.3g} {unit}; change it, or the lengths of the loop")  # fmt: skip
        name = self.mechanics.rows[worst].name
        joint_name = name.rsplit(".", 1)[0]
        unit = "m" if np.any(A[worst][~self.mechanics.rotational]) else "rad"
        return (f"the loop through joint '{joint_name}' cannot close: row {name} stays off by {abs(g[worst]):.3g} "
                f"{unit}; check the points of the bodies it connects")  # fmt: skip

    def _held_joints(self, value: Any) -> list[Connection]:
        """Held joints whose value is not a constraint row already; none where the starter does not hold."""
        return [] if not self.holding else [c for c in self.scene.joints if c.prescribed is None and value(c) is not None]

    def _coordinates(self, q: Array, u: Array, joints: list[Connection]) -> tuple[Array, Array, Array]:
        """Values (j,), rates (j,) and gradients (j, nu) of joint coordinates."""
        order = {c.name: i for i, c in enumerate(joints)}
        value, speed, C = np.zeros(len(joints)), np.zeros(len(joints)), np.zeros((len(joints), self.mechanics.nu))
        for g, p, values in self.mechanics.evaluate(coordinate_outputs, self.t, q[None], u[None]) if joints else []:
            for i, instance in enumerate(self.model.groups[g].instances):
                j = order.get(instance.item)
                if j is None:
                    continue
                value[j], speed[j] = values[0, i, 0], values[0, i, 1]
                for o, target in enumerate(p.targets[2:], start=2):
                    C[j, self.mechanics.numbering.velocity(target, g, i)] += values[0, i, o]
        return value, speed, C

    def _closure(self, q: Array) -> Array:
        joints = self._held_joints(self.held_value)
        value, _, _ = self._coordinates(q, np.zeros(self.mechanics.nu), joints)
        off: Array = value - np.array([self.held_value(c) for c in joints], dtype=float)
        turns = np.array([2 * np.pi if c.kind == "revolute" else np.inf for c in joints])
        off -= np.where(np.isfinite(turns), turns * np.round(off / turns), 0.0)
        return np.concatenate([self.mechanics.position_residual(self.t, q[None])[0], off])

    def _closure_jacobian(self, q: Array) -> Array:
        _, _, C = self._coordinates(q, np.zeros(self.mechanics.nu), self._held_joints(self.held_value))
        return np.vstack([self.mechanics.constraint_jacobian(self.t, q[None])[0], C])

    def _row_units(self, A: Array) -> Array:
        """(rows,) what a row changes by over unit displacements: about the scene's length, or 1 rad."""
        size = np.max(np.abs(A) * self.mechanics.velocity_units, axis=1, initial=0.0)
        return np.asarray(np.where(size > 0, size, 1.0))

    def _least_change(self, A: Array, right: Array, q: Array, stated: Array | None = None, off: Array | None = None) -> Array:
        """x in the coordinates of rigid motions with A B x = right (least squares) of least mass-weighted size; where
        `stated` is given, of least change of those motions first."""
        B, root = self._metric(q)
        if stated is None or off is None:
            stated, off = np.zeros((0, self.rigid.size)), np.zeros(0)
        return least_change(A if B is None else A @ B, right, root, self.rigid.massless, stated, off)

    def _metric(self, q: Array) -> tuple[Array | None, Array]:
        """Basis of the rigid motions (None: all coordinates are free) and the Cholesky factor of the mass of bodies in it."""
        heavy = ~self.rigid.massless
        if not self.model.lines:
            if self._roots is None:
                self._roots = None, np.linalg.cholesky(self.mechanics.weight[np.ix_(heavy, heavy)])
            return self._roots
        B = self.rigid.basis(q)
        M = (B.T @ (self.mechanics.mass @ B))[np.ix_(heavy, heavy)]
        return B, np.linalg.cholesky(M + np.diag(1e-6 * np.max(np.diag(M)) + np.zeros(len(M))))

    def units(self, q: Array) -> Array:
        """(size,) unit displacements of the coordinates of rigid motions: the scene's length, 1 rad."""
        if not self.model.lines:
            return self.mechanics.velocity_units
        single = [self.mechanics.velocity_units[n.u : n.u + n.kind.sizes[1]] for n in self.rigid.single]
        beams = [self.mechanics.velocity_units[nodes[0].u :][: nodes[0].kind.sizes[1]] for nodes in self.rigid.beams]
        return np.concatenate([*single, *beams])

    def moved(self, q: Array, x: Array) -> Array:
        """Positions after displacements x in the coordinates of rigid motions."""
        if not self.model.lines:
            return self.mechanics.integrate_positions(q, x)
        d, column = np.zeros(self.model.nu), 0
        for node in self.rigid.single:
            nu = node.kind.sizes[1]
            d[node.u : node.u + nu], column = x[column : column + nu], column + nu
        return self.rigid.moved(q, x, self.mechanics.integrate_positions(q, d))

    def _report_positions(self, before: Array, after: Array) -> None:
        for node, body in self.model.bodies:
            n = node.kind.translations
            moved = float(np.linalg.norm(after[node.q : node.q + n] - before[node.q : node.q + n]))
            if moved > 1e-9 * self.model.length:
                self.changes.append(f"'{body.name}' moved by {moved:.4g} m to close the loops")

    def check_branches(self, q: Array) -> None:
        """Refuse the spurious branches of the constraints (axes reversed, driven angle off by pi)."""
        problems = []
        for g, p, values in self.mechanics.evaluate(branch_outputs, self.t, q[None], np.zeros((1, self.mechanics.nu))):
            for i, instance in enumerate(self.model.groups[g].instances):
                for o, target in enumerate(p.targets):
                    if values[0, i, o] <= 0:
                        problems.append(f"joint '{instance.item}' starts on the wrong branch ({target[1]}: "
                                        f"{values[0, i, o]:.3g}, must be positive); "
                                        f"draw the bodies nearer to their start")  # fmt: skip
        if problems:
            raise StartError(problems)

    # -- velocities

    def carried(self, q: Array) -> Array:
        """Velocities (nu,) of the tree: given ones, held rates, relative rest elsewhere."""
        twist: dict[Body, tuple[Array, Array]] = {}  # velocity of the centre of mass, angular velocity
        place = self._poses(q)
        for root in self.tree.roots:
            twist[root] = (root.velocity, root.angular_velocity)
        for parent, joint, child in self.tree.edges:
            by_itself = joint.loose and child.given_velocity
            twist[child] = (child.velocity, child.angular_velocity) if by_itself else (
                self._carry(twist[parent], parent, joint, child, place))  # fmt: skip
        u = np.zeros(self.mechanics.nu)
        for node, body in self.model.bodies:
            v, w = twist[body.owner]
            n = node.kind.translations
            if body is not body.owner:
                v = v + np.cross(w, node.position(q) - place[body.owner][0])
            u[node.u : node.u + n] = v[:n]
            if node.kind is NodeKind.PLANAR:
                u[node.u + 2] = w[2]
            elif node.kind is NodeKind.SPATIAL:
                u[node.u + 3 : node.u + 6] = rotation_of(node.kind, q[node.q : node.q + 7]).T @ w
        for node in self.model.joint_coordinates:
            u[node.u] = self.held_rate(self.scene[node.name]) or 0.0
        return u

    def _carry(self, twist: tuple[Array, Array], parent: Body, joint: Connection, child: Body,
               place: dict[Body, tuple[Array, Array]]) -> tuple[Array, Array]:  # fmt: skip
        (v, w), (r, R), (rc, _) = twist, place[parent], place[child]
        law: Any = joint.joint
        point = r + R @ parent.rotation.T @ (law.at - parent.position) if not parent.is_point else r
        axis = R @ parent.rotation.T @ law.axis
        rate = (self.held_rate(joint) or 0.0) * (1 if joint.l is child else -1)
        slide = rate * axis if joint.kind == "prismatic" else np.zeros(3)
        spin = w + (rate * axis if joint.kind == "revolute" else np.zeros(3))
        if np.any(child.angular_velocity):
            spin = child.angular_velocity
        carried = v + np.cross(w, point - r) + np.cross(spin, rc - point) + slide
        if joint.kind == "prismatic":
            carried = v + np.cross(w, rc - r) + slide
        return (child.velocity if np.any(child.velocity) else carried), spin

    def _poses(self, q: Array) -> dict[Body, tuple[Array, Array]]:
        poses = {self.scene.ground: (np.zeros(3), np.eye(3))}
        for node, body in self.model.bodies:
            r = node.position(q)
            R = rotation_of(node.kind, q[node.q : node.q + node.kind.sizes[0]])
            poses[body] = (r, R)
            if body is not body.owner and body.owner not in poses:  # a rigid beam moves with its first node
                R = R @ body.rotation.T
                poses[body.owner] = (r + R @ (body.owner.position - body.position), R)
        return poses

    def project_velocities(self, q: Array, u: Array) -> Array:
        """The nearest velocities (mass-weighted) that satisfy the joints and the held rates. What the user states of a body
        stays where they allow it, whatever else has to move; where they do not, it counts like any other velocity."""
        given = self.rigid.given(q) if self.holding else []
        projected, change = self._projected(q, u, given)
        fastest = max(float(np.max(np.abs(v) * self.mechanics.velocity_units, initial=0.0)) for v in (u, projected))
        slight = 1e-9 * fastest, 1e-9 * fastest / self.model.length
        wrong = [item for item in given if any(np.linalg.norm(rows @ change) > size
                                               for rows, size in zip(_stated(item), slight, strict=True))]  # fmt: skip
        if wrong:
            projected, change = self._projected(q, u, [item for item in given if item not in wrong])
        for body, moves, turns in wrong:
            v, w = (float(np.linalg.norm(rows @ change)) for rows in (moves, turns))
            self.changes.append(f"the given velocity of '{body.name}' contradicts the joints: changed by {v:.4g} m/s and "
                                f"{w:.4g} rad/s")  # fmt: skip
        return projected

    def _projected(self, q: Array, u: Array, given: list[tuple[Body, Array, Array]]) -> tuple[Array, Array]:
        """Velocities that satisfy the joints and the held rates, and their change in the coordinates of rigid motions: of given
        velocities first, then of all."""
        joints = self._held_joints(self.held_rate)
        _, _, C = self._coordinates(q, u, joints)
        A = np.vstack([self.mechanics.constraint_jacobian(self.t, q[None])[0], C])
        wanted = np.array([self.held_rate(c) for c in joints], dtype=float)
        stated = np.vstack([np.zeros((0, self.rigid.size)), *(rows for item in given for rows in _stated(item))])
        projected, change = u, np.zeros(self.rigid.size)
        for _ in range(3):  # the first pass projects, the others remove its rounding
            left = np.r_[self.mechanics.velocity_residual(self.t, q[None], projected[None])[0], C @ projected - wanted]
            change = change + self._least_change(A, -left, q, stated, -stated @ change)
            projected = u + (self.rigid.basis(q) @ change if self.model.lines else change)
        speed = float(np.max(np.abs(projected) * self.mechanics.velocity_units, initial=0.0)) + 1.0
        if len(left) and np.max(np.abs(left)) > 1e-8 * speed * max(1.0, self.model.length):
            worst = int(np.argmax(np.abs(left)))
            m = self.mechanics.m
            name = self.mechanics.rows[worst].name if worst < m else f"rate of {joints[worst - m].name}"
            raise StartError([f"the start velocities contradict the joints: {name} stays off by {left[worst]:.3g}; "
                              f"release one of the prescribed or held rates"])  # fmt: skip
        return projected, change

    # -- states

    def states(self, q: Array, u: Array) -> Array:
        """Start values of the internal states at q, u."""
        return np.asarray(self.mechanics.of_states(state_start_outputs, self.t, q[None], u[None])[0])


def _stated(given: tuple[Body, Array, Array]) -> tuple[Array, Array]:
    """The rows of the velocity and of the angular velocity of a body that the user states: those that are not zero."""
    body, moves, turns = given
    return moves[: None if np.any(body.velocity) else 0], turns[: None if np.any(body.angular_velocity) else 0]


def _largest(g: Array, units: Array) -> float:
    return float(np.max(np.abs(g) / units, initial=0.0))


def _motion(joint: Connection, value: float) -> tuple[Array, Array]:
    """Rigid motion (quaternion, displacement) that a joint's coordinate makes of its drawn place."""
    law: Any = joint.joint
    if value == 0 or joint.kind not in ("revolute", "prismatic"):
        return np.eye(4)[0], np.zeros(3)
    if joint.kind == "prismatic":
        return np.eye(4)[0], value * law.axis
    P = turned(np.eye(4)[0], value * law.axis)
    return P, law.at - rotation_matrices(P) @ law.at
