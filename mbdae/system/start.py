"""The start: consistent positions, velocities, accelerations and multipliers, and changes to the drawn scene.

A scene is drawn with every joint coordinate at 0. Coordinates that the user prescribes or holds start at their values; all other
joints of a spanning tree start without relative motion. Loops are then closed by the smallest mass-weighted change of everything
that is not held.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from mbdae.deferred import as_full, later, sp
from mbdae.errors import StartError
from mbdae.scene.components import Body, Connection
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.changes import JointMotions, cheapest, least_change, sparse_least_change
from mbdae.system.model.nodes import rotation_of
from mbdae.system.motion.mechanics import Mechanics, row_sizes
from mbdae.system.positions import ConsistentPositions

if TYPE_CHECKING:
    from mbdae.system.start_of_beams import Bending, can_bend
else:
    Bending, can_bend = later("mbdae.system.start_of_beams", "Bending", "can_bend")

ROUNDING = 1e-11  #: error of velocities computed along a tree, over the largest speed, up to which it counts as round-off


class ChangedVelocity(str):
    """A sentence of `Start.changes` about velocities that joints changed: a run of such a start warns with it."""

    __slots__ = ()


@dataclass
class Start:
    """Consistent start of a scene at time t (s): q, u of all nodes, internal states s, accelerations u', multipliers of the rows
    in force; changes: sentences on what differs from the drawing.

    For a run that is continued, possibly with other joint models: names of the states s; coordinates: (joint, coordinate) ->
    value, m, or rad with whole turns; controllers: name -> state of those called before (`system.sampling.UnderWay`).
    relaxed: where elastic bodies are strained as in a motion without ringing, the estimated error of the velocities over the
    largest one."""

    t: float
    q: Array
    u: Array
    s: Array
    acceleration: Array
    multipliers: Array
    changes: list[str] = field(default_factory=list)
    names: tuple[str, ...] | None = None
    coordinates: dict[tuple[str, str], float] = field(default_factory=dict)
    controllers: dict[str, Any] = field(default_factory=dict)
    relaxed: float | None = None


def state_start_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Outputs of a law that are start values of its internal states."""
    return [] if isinstance(d.law, Element) else [(("s", j), e) for j, e in enumerate(d.state_starts)]


class Starter(ConsistentPositions):
    """Finds the start of a model: consistent positions, and velocities by projection."""

    #: in scenes with loops: gives the relative velocities of all joints, the sum of whose squares is minimised
    joints: JointMotions | None = None
    projected = False  #: whether velocities were projected: then they depend on the masses
    along: Array | None = None  #: the result of `velocities_of_tree` for the positions at which the scene starts, once known

    def run(self, q: Array, u: Array | None = None) -> Start:
        """The start at positions q (nq,) at which the loops are closed. u (nu,): velocities, which are projected on the
        constraints; None: `consistent_velocities`."""
        self.check_branches(q)
        u = self.consistent_velocities(q) if u is None else self.project_velocities(q, u)
        s = self.states(q, u)
        a, multipliers = self.mechanics.accelerations(self.t, q[None], u[None], s[None])
        return Start(float(self.t[0]), q, u, s, a[0], multipliers[0], self.changes)

    def consistent_velocities(self, q: Array) -> Array:
        """Velocities (nu,) at the start: those that the user states, held rates, and no relative motion at all other joints. In
        scenes with loops the sum of squares of the relative velocities of all joints is the least, so that it does not matter
        which joints the spanning tree leaves out."""
        along = self.along = self.velocities_of_tree(q) if self.along is None else self.along
        if not (along.any() or any(b.drawn.velocity.any() or b.drawn.angular_velocity.any() for b in self.scene.bodies)
                or any(rate for c in self.scene.joints for rate in self.held_rates(c).values())
                or self.mechanics.velocity_residual(self.t, q[None], along[None]).any()):
            return along  # nothing moves
        if not any(not c.loose and not c.others for c in self.tree.closing):
            return self.project_velocities(q, along)
        self.joints = JointMotions(self.model)
        stated = {b: (b.drawn.velocity, b.drawn.angular_velocity) for b in (self.scene.ground, *self.scene.bodies)}
        found = self.project_velocities(q, self._velocities(q, stated, self._poses(q)))
        return along if self.mechanics.speed(along - found) <= ROUNDING * self.mechanics.speed(found) else found

    def velocities_of_tree(self, q: Array) -> Array:
        """Velocities (nu,) computed along the spanning tree: those that the user states, held rates, and relative velocity 0 at
        all other joints of the tree."""
        twist: dict[Body, tuple[Array, Array]] = {}  # velocity of the centre of mass and angular velocity of each body
        place = self._poses(q)
        for root in self.tree.roots:
            twist[root] = (root.drawn.velocity, root.drawn.angular_velocity)
        for parent, joint, child in self.tree.edges:
            by_itself = joint.loose and child.given_velocity
            twist[child] = (child.drawn.velocity, child.drawn.angular_velocity) if by_itself else (
                self._twist_of(twist[parent], parent, joint, child, place))
        return self._velocities(q, twist, place)

    def _velocities(self, q: Array, twist: dict[Body, tuple[Array, Array]], place: dict[Body, tuple[Array, Array]]) -> Array:
        """Velocities (nu,) of all nodes at q. twist: body -> velocity of its centre of mass and angular velocity, inertial;
        place: body -> position and rotation matrix."""
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
        joints = {c.name: c for c in self.scene.joints}
        for node in self.model.joint_coordinates:
            u[node.u] = self.held_rates(joints[node.joint]).get(node.coordinate, 0.0)
        return u

    def _twist_of(self, twist: tuple[Array, Array], parent: Body, joint: Connection, child: Body,
               place: dict[Body, tuple[Array, Array]]) -> tuple[Array, Array]:
        """Velocity of the centre of mass and angular velocity of `child`, which a joint connects to `parent` with the velocities
        `twist`: by the held rates of the joint, or those that the user states of the child."""
        (v, w), (r, R), (rc, _) = twist, place[parent], place[child]
        if not (v.any() or w.any() or child.drawn.angular_velocity.any() or self.held_rates(joint)):
            return child.drawn.velocity, child.drawn.angular_velocity
        motion, outwards = self._motion(joint), joint.l is child
        way, slide, spin = motion.rates(self.held_values(joint), self.held_rates(joint))
        _, Rk = place[joint.k.owner]
        to_now = Rk @ joint.k.drawn.rotation.T  # from drawn axes fixed to k to the present inertial axes
        point = r if parent.is_point else r + R @ parent.drawn.rotation.T @ (motion.at - parent.drawn.position)
        point = point + to_now @ way if outwards else point
        sign = 1.0 if outwards else -1.0
        turning = w + sign * to_now @ spin
        if np.any(child.drawn.angular_velocity):
            turning = child.drawn.angular_velocity
        if not (w.any() or turning.any() or slide.any()):
            return (child.drawn.velocity if np.any(child.drawn.velocity) else v), turning
        carried = v + np.cross(w, point - r) + sign * to_now @ slide + np.cross(turning, rc - point)
        return (child.drawn.velocity if np.any(child.drawn.velocity) else carried), turning

    def _poses(self, q: Array) -> dict[Body, tuple[Array, Array]]:
        poses = {self.scene.ground: (np.zeros(3), np.eye(3))}
        for node, body in self.model.bodies:
            r = node.position(q)
            R = rotation_of(node.kind, q[node.q : node.q + node.kind.sizes[0]])
            poses[body] = (r, R)
            if body is not body.owner and body.owner not in poses:  # the pose of a beam is that of its first node, as if rigid
                R = R @ body.drawn.rotation.T
                poses[body.owner] = (r + R @ (body.owner.drawn.position - body.drawn.position), R)
        return poses

    def project_velocities(self, q: Array, u: Array) -> Array:
        """The velocities (nu,) nearest to u (mass-weighted) that satisfy the joints and the held rates. Velocities that the user
        states of a body are kept where joints and held rates allow it; where they do not, they are changed like all others."""
        if self.fits(q, u):
            return u
        self.projected = True
        given = self.rigid.given(q) if self.holding else []
        projected, change = self._projected(q, u, given)
        fastest = max(self.mechanics.speed(v) for v in (u, projected))
        slight = 1e-9 * fastest, 1e-9 * fastest / self.model.length
        wrong = [item for item in given if any(np.linalg.norm(rows @ change) > size
                                               for rows, size in zip(_stated(item), slight, strict=True))]
        # stated velocities that contradict the joints are dropped in scenes without loops. In scenes with loops they are still
        # met as well as possible, because the least relative motion of all joints would not depend on them at all
        if wrong and self.joints is None:
            projected, change = self._projected(q, u, [item for item in given if item not in wrong])
        for body, moves, turns in wrong:
            v, w = (float(np.linalg.norm(rows @ change)) for rows in (moves, turns))
            self.changes.append(ChangedVelocity(f"the given velocity of '{body.name}' contradicts the joints and was changed by "
                                                f"{v:.4g} m/s and {w:.4g} rad/s to fit them"))
        return projected

    def fits(self, q: Array, u: Array) -> bool:
        """Whether velocities u satisfy the joints up to round-off. False for mechanics with rows that belong to no tree, whose
        velocities are projected in any case."""
        if not self.mechanics.carries_bodies:
            return False
        off = self.mechanics.velocity_residual(self.t, q[None], u[None])[0]
        speed = max(self.mechanics.speed(u), 1e-300)
        return bool(np.max(np.abs(off), initial=0.0) <= ROUNDING * speed * max(1.0, 1 / self.model.length))

    def _projected(self, q: Array, u: Array, given: list[tuple[Body, Any, Any]]) -> tuple[Array, Array]:
        """Velocities (nu,) that satisfy the joints and the held rates, and their change from u in the coordinates of
        `RigidMotions`. The change of the velocities that the user states (given) is minimised first, then that of all."""
        held = self._held(self.held_rates)
        _, _, C = self._coordinates(q, u, held)
        A = self.below(self.mechanics.constraint_matrix(self.t, q), C)
        wanted = np.array([rate for _, _, rate in held], dtype=float)
        stated = self._rows_of([rows for item in given for rows in _stated(item)])

        def off(u: Array) -> Array:
            return np.concatenate([self.mechanics.velocity_residual(self.t, q[None], u[None])[0], C @ u - wanted])

        projected, change = u, np.zeros(self.rigid.size)
        for _ in range(3):  # the first pass projects, the others remove its round-off
            step = self._change(A, -off(projected), q, stated, -stated @ change, projected, change)
            if not step.any():  # then further steps would be 0 too
                break
            change = change + step
            projected = u + (self.rigid.basis(q) @ change if self.model.lines else change)
        left = off(projected)
        if not self._far(left, projected):
            return projected, change
        if self.model.lines and can_bend(self.mechanics):
            bending = Bending(self.mechanics, q)
            slow = bending.least(A, -off(np.zeros_like(u)), bending.inertia @ u)
            if not self._far(off(slow), slow):
                self.changes.append("the beams start bending, because no rigid motion of them has the rates given: they begin "
                                    "with velocities of least elastic power")
                return slow, np.zeros(self.rigid.size)
        worst, m = int(np.argmax(np.abs(left))), self.mechanics.m
        name = self.mechanics.rows[worst].name if worst < m else f"rate of {held[worst - m][0].name}"
        raise StartError([f"the start velocities contradict the joints: {name} stays off by {left[worst]:.3g} (m/s or rad/s); "
                          f"release one of the prescribed or held rates"])

    def _change(self, A: Any, right: Array, q: Array, stated: Any, off: Array, u: Array, change: Array) -> Array:
        """A further step of the change of velocities, u after the part `change` so far, in the coordinates of `RigidMotions`;
        arguments as in `_least_change`. In scenes with loops it minimises the relative velocities of the joints, and where these
        do not determine it, the mass-weighted size of the whole change."""
        if self.joints is None:
            return self._least_change(A, right, q, stated, off)
        V, masses, units = self.joints.at(q, rates=True)[1], self.mechanics.weight, self.units(q)
        moving = V @ u
        if self.model.lines:
            B = self.rigid.basis(q)
            A, V, masses = A @ B, V @ B, B.T @ (self.mechanics.mass @ B)
        W = self.joints.weight(V, masses, units)
        pull = -(V.T @ moving) - W @ change + V.T @ (V @ change)
        if self.mechanics.large:
            return sparse_least_change(A, right, W, units, stated, off, pull)
        heavy, W, x = ~self.rigid.massless, as_full(W), np.zeros(len(pull))
        root = np.linalg.cholesky(W[np.ix_(heavy, heavy)])
        x[heavy] = np.linalg.solve(root.T, np.linalg.solve(root, pull[heavy]))
        return x + least_change(as_full(A), right - A @ x, root, ~heavy, stated, off - stated @ x)

    def _rows_of(self, parts: list[Any]) -> Any:
        """Rows (k, size) put one below the other: as a sparse matrix in large scenes without beams, else as an array."""
        if self.mechanics.large and not self.model.lines:
            return sp.vstack([sp.csr_array((0, self.rigid.size)), *parts], format="csr")
        return np.vstack([np.zeros((0, self.rigid.size)), *map(as_full, parts)])

    def _far(self, left: Array, u: Array) -> bool:
        """Whether `left`, the violation of the constraints at velocities u, is more than round-off."""
        speed = self.mechanics.speed(u) + 1.0
        return bool(np.max(np.abs(left), initial=0.0) > 1e-8 * speed * max(1.0, self.model.length))

    def states(self, q: Array, u: Array) -> Array:
        """Start values (ns,) of the internal states of laws, at positions q (nq,) and velocities u (nu,)."""
        return np.asarray(self.mechanics.of_states(state_start_outputs, self.t, q[None], u[None])[0])


def _stated(given: tuple[Body, Any, Any]) -> tuple[Any, Any]:
    """Of an item of `RigidMotions.given` the rows of the velocity and of the angular velocity; empty for one of these that is
    stated as 0, which counts as not stated."""
    body, moves, turns = given
    return moves[: None if np.any(body.drawn.velocity) else 0], turns[: None if np.any(body.drawn.angular_velocity) else 0]


#: violation of the joints' rows (m or rad), over the scene's length or 1, whichever is larger, up to which a run can be continued
#: from the state where another run ended; as large as the error of a run may be. Where a rate of the rows is larger than this
#: times the largest speed over the same length, the joints stop that motion by impulses
FITS = 1e-4


def continued(mechanics: Mechanics, start: Start) -> Start:
    """The start of a continued run: the state at which another run ended, with accelerations and multipliers of this scene."""
    t, s = np.array([start.t]), start.s
    wanted = tuple(mechanics.numbering.states.values())
    if start.names is not None and start.names != wanted:
        s = Starter(mechanics, start.t).states(start.q, start.u)
        known = {wanted[n]: start.coordinates[key] for key, n in mechanics.followed.items() if key in start.coordinates}
        known |= dict(zip(start.names, start.s, strict=True))
        s = np.array([known.get(name, value) for name, value in zip(wanted, s, strict=True)])
    u, changes = _joined_suddenly(mechanics, start)
    changes += start.changes if start.relaxed is not None else []
    a, multipliers = mechanics.accelerations(t, start.q[None], u[None], s[None])
    return Start(start.t, start.q, u, s, a[0], multipliers[0], changes, coordinates=start.coordinates,
                 controllers=start.controllers, relaxed=start.relaxed)


def _joined_suddenly(mechanics: Mechanics, start: Start) -> tuple[Array, list[str]]:
    """Velocities (nu,) with which a run is continued, and sentences on what was changed. Where joints that the run before did not
    have stop a motion, they do so by impulses P: M (u+ - u-) + G^T P = 0, G u+ + g_t = 0, an impact without rebound."""
    t, q, u = np.array([start.t]), start.q[None], start.u[None]
    g, rate = mechanics.position_residual(t, q)[0], mechanics.velocity_residual(t, q, u)[0]
    if np.max(np.abs(g), initial=0.0) > FITS * max(1.0, mechanics.model.length):
        off = int(np.argmax(np.abs(g)))
        raise StartError([f"start: row {mechanics.rows[off].name} is off by {g[off]:.3g} (m or rad) where the run given ended: "
                          f"the joints of this scene do not fit that position; draw or prescribe them to fit it"])
    G, M = mechanics.constraint_matrix(t, start.q), mechanics.mass
    if np.all(np.abs(rate) <= FITS * mechanics.speed(start.u) / mechanics.model.length * row_sizes(mechanics, start.t, start.q)):
        return start.u, []
    if mechanics.large and not mechanics.carries_bodies:
        change = cheapest(M, mechanics.velocity_units, G, -rate, np.zeros(mechanics.nu))
    else:
        G, M = as_full(G), as_full(M)
        K = np.block([[M, G.T], [G, np.zeros((len(G), len(G)))]])
        change = np.linalg.lstsq(K, np.concatenate([np.zeros(len(M)), -rate]), rcond=1e-13)[0][: len(M)]
    worst = mechanics.rows[int(np.argmax(np.abs(rate)))].name
    lost = float(-(change @ (M @ (start.u + change / 2))))
    told = ChangedVelocity(f"joints that the run before did not have stop motions suddenly (most: {worst}): an impact without "
                           f"rebound that dissipates {lost:.4g} J")
    return start.u + change, [told]
