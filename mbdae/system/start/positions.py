"""Consistent positions: bodies placed joint by joint as drawn and held, and loops closed."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.errors import StartError
from mbdae.inputs import timed
from mbdae.scene.components import Body, Connection
from mbdae.scene.topology import spanning_tree
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Joint
from mbdae.symbolic.outputs import Target, coordinate, scatter_pair
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.model.beams import drawn_quaternion
from mbdae.system.model.rotations import quaternion_product, rotation_matrices, turned
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.start.bent_beams import can_bend, closed_by_bending
from mbdae.system.start.least_change import largest_violation, least_change, violations
from mbdae.system.start.rigid_beams import RigidMotions

CLOSED = 1e-12  #: relative to the scene's length and 1 rad: a closed loop


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


class ConsistentPositions:
    """Finds consistent positions of a model by mass-weighted Gauss-Newton.

    holding: whether start values that the user holds are conditions too; changes: sentences on what was changed."""

    def __init__(self, mechanics: Mechanics, t0: float = 0.0, holding: bool = True,
                 changes: list[str] | None = None) -> None:  # fmt: skip
        self.holding = holding
        self.mechanics, self.model, self.t = mechanics, mechanics.model, np.array([t0])
        self.scene, self.tree = self.model.scene, spanning_tree(self.model.scene)
        self.changes = changes if changes is not None else []
        self.rigid = RigidMotions(self.model)
        self._roots: tuple[Any, Array] | None = None

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
            if joint.turns:
                turn += (self.held_value(joint) or 0.0) * (1 if joint.l is at else -1) * np.sign(joint.joint.axis[2])
            at = parent
        return body.heading + turn

    def held_value(self, joint: Connection) -> float | None:
        """Start value of a joint's coordinate, if the user fixed it."""
        if joint.prescribed is not None:
            return timed.value_at(joint.prescribed, self.t[0])
        return None if joint.hold is None else float(joint.hold)

    def held_rate(self, joint: Connection) -> float | None:
        """Start rate of a joint's coordinate, if the user fixed it."""
        if joint.prescribed is not None:
            return timed.rate_at(joint.prescribed, self.t[0])
        return None if joint.hold_rate is None else float(joint.hold_rate)

    def close(self, q: Array) -> Array:
        """Close loops by rigid motions of the beams: mass-weighted Gauss-Newton with backtracking on the constraints and the held
        coordinates."""
        before, g = q, self._closure(q)
        for _ in range(50):
            A = self._closure_jacobian(q)
            B = A * self.mechanics.velocity_units
            size = largest_violation(g, B)
            if size <= CLOSED:
                break
            step, factor = self._least_change(A, -g, q), 1.0
            while factor > 1e-4:
                candidate = self.moved(q, factor * step)
                g_new = self._closure(candidate)
                if largest_violation(g_new, B) < size:
                    break
                factor /= 2
            if factor <= 1e-4:
                break
            q, g = candidate, g_new
        if size > 1e-9:
            raise StartError([self._cannot_close(int(np.argmax(violations(g, B))), g, A)])
        self._report_positions(before, q)
        return q

    def closing_error(self, q: Array) -> float:
        """Largest distance by which loops are open, over the scene's length, or rad."""
        return largest_violation(self._closure(q), self._closure_jacobian(q) * self.mechanics.velocity_units)

    def close_or_bend(self, q: Array) -> Array:
        """Close loops by rigid motions of the beams, or, where these do not suffice, by bending them as little as possible."""
        try:
            return self.close(q)
        except StartError:
            can = can_bend(self.mechanics)
            found = closed_by_bending(self.mechanics, q, self._closure, self._closure_jacobian, CLOSED) if can else None
            if found is None:
                raise
        energy = sum(float(line.energy(found[None], np.zeros((1, self.model.nu)))[0][0]) for line in self.model.lines)
        self.changes.append(f"the beams start bent, with an elastic energy of {energy:.3g} J, because no rigid motion of "
                            f"them closes the loops")  # fmt: skip
        return found

    def _cannot_close(self, worst: int, g: Array, A: Array) -> str:
        if worst >= self.mechanics.m:
            joint = self._held_joints(self.held_value)[worst - self.mechanics.m]
            unit = "rad" if joint.turns else "m"
            return (f"the held value {self.held_value(joint):.6g} of '{joint.name}' cannot be reached: the loop stays off by "
                    f"{abs(g[worst]):.3g} {unit}; change it, or the lengths of the loop")  # fmt: skip
        name = self.mechanics.rows[worst].name
        joint_name = name.rsplit(".", 1)[0]
        unit = "m" if np.any(A[worst][~self.mechanics.rotational]) else "rad"
        return (f"the loop through joint '{joint_name}' cannot close: row {name} stays off by {abs(g[worst]):.3g} "
                f"{unit}; check the points of the bodies it connects")  # fmt: skip

    def _held_joints(self, value: Any) -> list[Connection]:
        """Held joints whose value is not a constraint row already; none without `holding`."""
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
        turns = np.array([2 * np.pi if c.turns else 0.0 for c in joints])
        off -= turns * np.round(off / (2 * np.pi))
        return np.concatenate([self.mechanics.position_residual(self.t, q[None])[0], off])

    def _closure_jacobian(self, q: Array) -> Array:
        _, _, C = self._coordinates(q, np.zeros(self.mechanics.nu), self._held_joints(self.held_value))
        return np.vstack([self.mechanics.constraint_jacobian(self.t, q[None])[0], C])

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


def _motion(joint: Connection, value: float) -> tuple[Array, Array]:
    """Rigid motion (quaternion, displacement) that a joint's coordinate makes of its drawn place."""
    law: Any = joint.joint
    if value == 0 or not (joint.turns or joint.slides):
        return np.eye(4)[0], np.zeros(3)
    if joint.slides:
        return np.eye(4)[0], value * law.axis
    P = turned(np.eye(4)[0], value * law.axis)
    return P, law.at - rotation_matrices(P) @ law.at
