"""Consistent positions: bodies are placed along a tree of joints, as drawn or with the coordinates at which the user holds them;
then the loops are closed."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mbdae.deferred import later, sp
from mbdae.errors import StartError
from mbdae.inputs import timed
from mbdae.scene.components import Body, Connection
from mbdae.scene.models import Tree, spanning_tree
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.outputs import Target, coordinate, scatter_pair
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.changes import RigidMotions, largest_violation, least_change, sparse_least_change, violations
from mbdae.system.model.nodes import JointMotion, drawn_quaternion, quaternion_product, rotation_matrices
from mbdae.system.motion.mechanics import Mechanics, in_units

if TYPE_CHECKING:
    from mbdae.system.start_of_beams import can_bend, closed_by_bending
else:
    can_bend, closed_by_bending = later("mbdae.system.start_of_beams", "can_bend", "closed_by_bending")

Held = tuple[Connection, str, float]  #: a joint, one of its coordinates, and the value at which it is held
CLOSED = 1e-12  #: largest violation (over the scene's length, or rad) at which the iteration that closes loops stops
#: largest violation (as CLOSED) up to which loops count as closed where the iteration gets no further; also largest motion of a
#: joint from the drawing (rad, or over the scene's size) up to which it counts as drawn
REACHED = 1e-9


def coordinate_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """The coordinates of a joint, their rates, and the derivatives of the rates by the velocities: targets ("C", side, column,
    name)."""
    out, v = coordinate(d), d.variation
    for name, value in d.coordinates.items():
        for f in d.frames:
            pair = tuple(type(part)(*map(v.resolve, part)) for part in v.gradient(f, value))
            out += [(("C", *t[1:], name), e) for t, e in scatter_pair(f, pair)]  # type: ignore[arg-type]
    return out


def branch_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Expressions of a joint that are positive on the intended branch of its constraints, for example where axes are not
    reversed."""
    if not isinstance(d.law, Joint) or not all(f.kind.oriented for f in d.sides):
        return []
    return [(("branch", name), d.variation.resolve(d.variation.name(e))) for name, e in d.law.positives(*d.sides).items()]


class ConsistentPositions:
    """Finds consistent positions of a model by Gauss-Newton iterations with the smallest mass-weighted displacements.

    t0: time, s; holding: whether coordinates at which the user holds joints are conditions too; changes: list to which sentences
    on what was changed are appended."""

    def __init__(self, mechanics: Mechanics, t0: float = 0.0, holding: bool = True,
                 changes: list[str] | None = None) -> None:
        self.holding, self.drawn = holding, False  # drawn: whether the start was found to be as drawn, whatever the masses
        self.mechanics, self.model, self.t = mechanics, mechanics.model, np.array([t0])
        self.scene = self.model.scene
        self.changes = changes if changes is not None else []
        self._roots: tuple[Any, Array] | None = None
        self._motions: dict[Connection, JointMotion] = {}

    @cached_property
    def tree(self) -> Tree:
        """The joints along which bodies are placed."""
        return spanning_tree(self.scene)

    @cached_property
    def rigid(self) -> RigidMotions:
        """The coordinates of motions in which beams are rigid."""
        return RigidMotions(self.model)

    def placed(self) -> Array:
        """Positions (nq,) of bodies placed along the tree of joints, with every held or prescribed coordinate at its value; loops
        may be open."""
        motion = {b: (np.eye(4)[0], np.zeros(3)) for b in self.tree.roots}
        for parent, joint, child in self.tree.edges:
            P, r = motion[parent]
            held = self.held_values(joint)
            if not held:  # the joint is as drawn
                motion[child] = motion[parent]
                continue
            dP, dr = self._motion(joint).drawn(held, joint.l is child)
            motion[child] = (quaternion_product(P, dP), rotation_matrices(P) @ dr + r)
        q, turns = np.zeros(self.model.nq), self._turns()
        for node, body in self.model.bodies:
            P, r = motion[body.owner]
            n = node.kind.translations
            q[node.q : node.q + n] = (rotation_matrices(P) @ body.drawn.position + r)[:n]
            if node.kind is NodeKind.PLANAR:
                q[node.q + 2] = body.heading + turns[body.owner]  # from the coordinates, because P has no whole turns
            elif node.kind is NodeKind.SPATIAL:
                q[node.q + 3 : node.q + 7] = quaternion_product(P, drawn_quaternion(body))
        joints = {c.name: c for c in self.scene.joints}
        for node in self.model.joint_coordinates:
            q[node.q] = self.held_values(joints[node.joint]).get(node.coordinate, float(node.kind is NodeKind.ROTATION))
        return q

    def _turns(self) -> dict[Body, float]:
        """Rotation of every planar body from its drawn angle, rad: the sum of the joints' angles along the tree, whole turns
        included."""
        turns = dict.fromkeys(self.tree.roots, 0.0)
        for parent, joint, child in self.tree.edges if self.model.planar else ():
            held = self.held_values(joint)
            turn = self._motion(joint).planar_turn(held) if held else 0.0
            turns[child] = turns[parent] + turn * (1 if joint.l is child else -1)
        return turns

    def _motion(self, joint: Connection) -> JointMotion:
        if joint not in self._motions:
            self._motions[joint] = JointMotion(joint, self.t[0])
        return self._motions[joint]

    def held_values(self, joint: Connection) -> dict[str, float]:
        """Name of a coordinate of a joint -> start value at which the user holds or prescribes it."""
        return joint.hold | {c: timed.value_at(value, self.t[0]) for c, value in joint.prescribed.items()}

    def held_rates(self, joint: Connection) -> dict[str, float]:
        """Name of a coordinate of a joint -> start rate at which the user holds or prescribes it."""
        return joint.hold_rate | {c: timed.rate_at(value, self.t[0]) for c, value in joint.prescribed.items()}

    def close(self, q: Array) -> Array:
        """As `closed`; a sentence on the body that moves most is appended to `changes`."""
        found = self.closed(q)
        most, moved = self._most_moved(q, found)
        if moved > 1e-9 * self.model.length:
            self.changes.append(f"to close the loops body '{most}' moved by {moved:.3g} m")
        return found

    def closed(self, q: Array) -> Array:
        """Positions (nq,) near q with closed loops, beams moving as rigid bodies: by Gauss-Newton steps of smallest mass-weighted
        size with backtracking, for constraints and held coordinates. StartError where the loops stay open."""
        g = self._closure(q)
        for _ in range(50):
            A = self._closure_jacobian(q)
            B = in_units(self.mechanics, A)
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
        if size > REACHED:
            raise StartError([self._cannot_close(int(np.argmax(violations(g, B))), g, A)])
        return q

    def closing_error(self, q: Array) -> float:
        """Largest violation of constraints and held coordinates at q, over the scene's length, or rad."""
        return largest_violation(self._closure(q), in_units(self.mechanics, self._closure_jacobian(q)))

    def close_or_bend(self, q: Array) -> Array:
        """As `close`; where beams moving as rigid bodies cannot close the loops, by bending them with the least elastic
        energy."""
        try:
            return self.close(q)
        except StartError:
            can = bool(self.model.lines) and can_bend(self.mechanics)
            found = closed_by_bending(self.mechanics, q, self._closure, self._closure_jacobian, CLOSED) if can else None
            if found is None:
                raise
        energy = sum(float(line.energy(found[None], np.zeros((1, self.model.nu)))[0][0]) for line in self.model.lines)
        self.changes.append(f"the beams start bent, with an elastic energy of {energy:.3g} J, because no rigid motion of "
                            f"them closes the loops")
        return found

    def _cannot_close(self, worst: int, g: Array, A: Any) -> str:
        if worst >= self.mechanics.m:
            joint, c, value = self._held(self.held_values)[worst - self.mechanics.m]
            return (f"the held value {value:.6g} of '{joint.name}' cannot be reached: the loop stays off by "
                    f"{abs(g[worst]):.3g} {joint.unit(c)}; change it, or the lengths of the loop")
        name = self.mechanics.rows[worst].name
        joint_name = name.rsplit(".", 1)[0]
        row = A[[worst]].toarray()[0] if self.mechanics.large else A[worst]
        unit = "m" if np.any(row[~self.mechanics.rotational]) else "rad"
        stated = self._stated_in_loop(joint_name)
        values_stated = f"{stated}: the loop may not reach that, state another value; or " if stated else ""
        return (f"the loop through joint '{joint_name}' cannot close: row {name} stays off by {abs(g[worst]):.3g} "
                f"{unit}; {values_stated}check the points of the bodies it connects")

    def _stated_in_loop(self, name: str) -> str:
        """The values at which coordinates in the loops through a joint are held or prescribed at the start, where they are not as
        drawn; empty where there are none."""
        loops = [loop for loop in map(self.tree.loop, self.tree.closing) if any(joint.name == name for joint in loop)]
        joints = dict.fromkeys(joint for loop in loops for joint in loop)
        told = [f"{c} of '{joint.name}' starts at {value:.6g} {joint.unit(c)}"
                for joint in joints for c, value in self.held_values(joint).items() if value]
        return " and ".join(told)

    def _held(self, values: Callable[[Connection], dict[str, float]]) -> list[Held]:
        """Coordinates that the user holds, each with what values(joint) gives for it; none without `holding`. Prescribed ones are
        left out: their constraint rows hold them already."""
        return [(joint, c, value) for joint in self.scene.joints if self.holding
                for c, value in values(joint).items() if c not in joint.prescribed]

    def _coordinates(self, q: Array, u: Array, held: list[Held]) -> tuple[Array, Array, Any]:
        """Values (j,), rates (j,) and derivatives (j, nu) by displacements of the joint coordinates in `held`."""
        order = {(joint.name, c): i for i, (joint, c, _) in enumerate(held)}
        value, speed, shape = np.zeros(len(held)), np.zeros(len(held)), (len(held), self.mechanics.nu)
        C: Any = sp.lil_matrix(shape) if self.mechanics.large else np.zeros(shape)
        for g, p, values in self.mechanics.evaluate(coordinate_outputs, self.t, q[None], u[None]) if held else []:
            for i, instance in enumerate(self.model.groups[g].instances):
                for o, (head, *place) in enumerate(p.targets):
                    j = order.get((instance.item, place[-1]))
                    if j is None:
                        continue
                    if head == "C":
                        C[j, self.mechanics.numbering.velocity(("u", *place[:-1]), g, i)] += values[0, i, o]
                    else:
                        (value if head == "c" else speed)[j] = values[0, i, o]
        return value, speed, C

    def _closure(self, q: Array) -> Array:
        held = self._held(self.held_values)
        value, _, _ = self._coordinates(q, np.zeros(self.mechanics.nu), held)
        off: Array = value - np.array([wanted for _, _, wanted in held], dtype=float)
        turns = np.array([2 * np.pi if joint.unit(c) == "rad" and self.model.coordinate_node(joint.name, c) is None else 0.0
                          for joint, c, _ in held])
        off -= turns * np.round(off / (2 * np.pi))
        return np.concatenate([self.mechanics.position_residual(self.t, q[None])[0], off])

    def _closure_jacobian(self, q: Array) -> Any:
        _, _, C = self._coordinates(q, np.zeros(self.mechanics.nu), self._held(self.held_values))
        found = self.below(self.mechanics.closing_matrix(self.t, q), C)
        values = found.data if self.mechanics.large else found
        values[~np.isfinite(values)] = 0.0  # a row has no derivatives where its joint is half a turn off
        return found

    def below(self, G: Any, C: Any) -> Any:
        """Rows G (m, nu) with the rows C (j, nu) of held coordinates below them; sparse in large scenes."""
        return sp.vstack([G, C], format="csr") if self.mechanics.large else np.vstack([G, C])

    def _least_change(self, A: Any, right: Array, q: Array, stated: Array | None = None, off: Array | None = None) -> Array:
        """x in the coordinates of `RigidMotions`, whose basis is B, with A B x = right, and of smallest mass-weighted size; where
        `stated` is given, before that with stated @ x as near to `off` as possible. See `least_change`."""
        if stated is None or off is None:
            stated, off = np.zeros((0, self.rigid.size)), np.zeros(0)
        if self.mechanics.large and not self.model.lines:
            return sparse_least_change(A, right, self.mechanics.weight, self.mechanics.velocity_units, stated, off)
        B, root = self._metric(q)
        return least_change(A if B is None else A @ B, right, root, self.rigid.massless, stated, off)

    def _metric(self, q: Array) -> tuple[Array | None, Array]:
        """Basis of `RigidMotions` at q (None in scenes without beams: all displacements), and the Cholesky factor of the mass
        matrix in it, without massless coordinates."""
        heavy = ~self.rigid.massless
        if not self.model.lines:
            if self._roots is None:
                self._roots = None, np.linalg.cholesky(self.mechanics.weight[np.ix_(heavy, heavy)])
            return self._roots
        B = self.rigid.basis(q)
        M = (B.T @ (self.mechanics.mass @ B))[np.ix_(heavy, heavy)]
        return B, np.linalg.cholesky(M + np.diag(1e-6 * np.max(np.diag(M)) + np.zeros(len(M))))

    def units(self, q: Array) -> Array:
        """(size,) unit displacements of the coordinates of `RigidMotions`: the scene's length, or 1 rad."""
        if not self.model.lines:
            return self.mechanics.velocity_units
        single = [self.mechanics.velocity_units[n.u : n.u + n.kind.sizes[1]] for n in self.rigid.single]
        beams = [self.mechanics.velocity_units[nodes[0].u :][: nodes[0].kind.sizes[1]] for nodes in self.rigid.beams]
        return np.concatenate([*single, *beams])

    def moved(self, q: Array, x: Array) -> Array:
        """Positions (nq,) after displacements x (size,) from q in the coordinates of `RigidMotions`."""
        if not self.model.lines:
            return self.mechanics.integrate_positions(q, x)
        d, column = np.zeros(self.model.nu), 0
        for node in self.rigid.single:
            nu = node.kind.sizes[1]
            d[node.u : node.u + nu], column = x[column : column + nu], column + nu
        return self.rigid.moved(q, x, self.mechanics.integrate_positions(q, d))

    def _most_moved(self, before: Array, after: Array) -> tuple[str, float]:
        """Name of the body that moves most between two positions, and how far, m."""
        moved = {b.name: float(np.linalg.norm(n.position(after) - n.position(before))) for n, b in self.model.bodies}
        most = max(moved, key=moved.__getitem__)
        return most, moved[most]

    def check_branches(self, q: Array) -> None:
        """Raise StartError where a joint is on another branch of its constraints than stated: its axes are reversed, or a
        prescribed angle is wrong by pi."""
        problems = []
        for g, p, values in self.mechanics.evaluate(branch_outputs, self.t, q[None], np.zeros((1, self.mechanics.nu))):
            for i, instance in enumerate(self.model.groups[g].instances):
                for o, target in enumerate(p.targets):
                    if values[0, i, o] <= 0:
                        problems.append(f"joint '{instance.item}' starts on the wrong branch, another solution of its equations "
                                        f"than it stands for ({target[1]}: {values[0, i, o]:.3g}, must be positive); draw the "
                                        "bodies nearer to the start that is meant")
        if problems:
            raise StartError(problems)
