"""How far joints are from where they are drawn. The start measures by this which positions are near to the drawing.

Each joint between two bodies k and l contributes six numbers: the rotation of l relative to k from the drawing, as the vector
2 sin(angle / 2) times its axis (for small angles the rotation vector, rad), and the displacement of the joint's point on l from
that on k, over the extent of the scene; both in axes fixed to k. They do not depend on joint models, on the order in which the
scene is stated, or on the position of the inertial frame.

The smallest change of positions or velocities, weighted by mass, that satisfies linear conditions; the start closes loops by
it.

Changes of positions or velocities that satisfy linear conditions and minimise a quadratic function, by sparse matrices. Beams
move as rigid bodies in them, where rigid motions can close the loops.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from mbdae.deferred import as_full, sp, splu
from mbdae.scene.components import Body, Connection
from mbdae.scene.shapes import joint_axes
from mbdae.symbolic.frames import NodeKind
from mbdae.system.base import Array
from mbdae.system.model.model import Model
from mbdae.system.model.nodes import Node, quaternion, quaternion_product, rotation_matrices, rotation_of, turned
from mbdae.system.motion.constrained import largest_entries, row_lengths
from mbdae.system.motion.mechanics import LARGE

#: weight of the masses in the sum of squares that is minimised, relative to that of the joints: it makes the minimum unique where
#: bodies can move without any joint moving
INERTIA = 1e-6

#: number of coordinates up to which the rows that give the stated velocities of bodies are full arrays; above it they are sparse
FULL = 400


class JointMotions:
    """The relative motions of the joints of a model, without those with clearance and those between more than two bodies."""

    def __init__(self, model: Model) -> None:
        self.model = model
        joints = [c for c in model.scene.joints if not (c.loose or c.others)]
        ends = {c.name: model.ends(c) for c in joints}
        self.names = list(ends)
        bodies = list(dict.fromkeys(body for pair in ends.values() for body in pair))
        self._number = {body: i for i, body in enumerate(bodies)}
        self._of = np.array([[self._number[b] for b in pair] for pair in ends.values()], dtype=np.intp).reshape(-1, 2).T
        drawn = np.array([[c.joint.point_on(side) for c in joints] for side in "kl"], dtype=float).reshape(2, -1, 3)
        points = [*drawn.reshape(-1, 3), *(b.drawn.position for _, b in model.bodies)]
        extent = float(np.max(np.linalg.norm(np.array(points) - np.mean(points, axis=0), axis=1), initial=0.0))
        self.extent = extent if extent > 0 else 1.0  #: size of the scene, m: largest distance of a point from the mean of all
        self._apart = drawn[1] - drawn[0]
        self._oriented = np.array([not (k.is_point or l.is_point) for k, l in ends.values()], dtype=bool)
        # of each of the n bodies: `_axes` rotates vectors from inertial axes into its own axes as drawn; `_q`, `_u` are the
        # numbers of its positions and velocities among all, padded to those of a spatial body with the number of an appended 0;
        # `_moves`, `_spins` map these velocities to the velocity of its centre of mass and to its angular velocity
        n = len(bodies)
        self._axes, self._origin = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
        self._q, self._u = np.full((n, 7), model.nq), np.full((n, 6), model.nu)
        self._moves, self._spins = np.zeros((n, 3, 6)), np.zeros((n, 3, 6))
        self._spatial, self._planar = (np.zeros(n, dtype=bool) for _ in range(2))
        for i, (body, node) in enumerate((body, model.node(body)) for body in bodies):
            if node is None:
                continue
            kind, at = node.kind, node.kind.translations
            self._spatial[i], self._planar[i] = kind is NodeKind.SPATIAL, kind is NodeKind.PLANAR
            self._origin[i], self._axes[i] = body.drawn.position, body.drawn.rotation.T if kind.turns else np.eye(3)
            self._q[i, :at], self._u[i, : kind.sizes[1]] = node.q + np.arange(at), node.u + np.arange(kind.sizes[1])
            self._moves[i, :, :at] = np.eye(3, at)
            if kind is NodeKind.PLANAR:
                self._q[i, 3], self._spins[i, 2, 2] = node.q + 2, 1.0
            elif kind is NodeKind.SPATIAL:
                self._q[i, 3:] = node.q + 3 + np.arange(4)
        self._arms = drawn - self._origin[self._of]

    def far(self, q: Array) -> Array:
        """The six numbers of each of the j joints, (6 j,), see the module: rotation and displacement from the drawing."""
        return self._placed(q)[0]

    def at(self, q: Array, rates: bool = False) -> tuple[Array, Any]:
        """`far`, (6 j,), and its derivatives (6 j, nu) by virtual displacements, sparse where the scene is large. rates: True
        returns instead of these the matrix (6 j, nu) that maps velocities to relative angular velocities and to relative
        velocities of the joint's points over the extent."""
        far, (R, turned, position, points, P) = self._placed(q)
        back = np.swapaxes(turned[self._of[0]], 1, 2)
        turning = back if rates else (P[:, :1, None] * np.eye(3) - _cross(P[:, 1:])) @ back
        spins = self._spins.copy()
        spins[self._spatial, :, 3:] = R[self._spatial]
        joints, nu = len(self.names), self.model.nu
        blocks = np.empty((2, joints, 6, 6))
        blocks[:, :, :3] = turning @ spins[self._of] * self._oriented[:, None, None]
        blocks[:, :, 3:] = back @ (self._moves[self._of] - _cross(points[1] - position[self._of]) @ spins[self._of]) / self.extent
        blocks[0] *= -1
        rows, columns = np.arange(6 * joints).reshape(-1, 6, 1), self._u[self._of][:, :, None, :]
        if nu > LARGE:
            places = np.broadcast_to(rows, blocks.shape), np.broadcast_to(columns, blocks.shape)
            there = places[1] < nu
            return far, sp.csr_matrix((blocks[there], (places[0][there], places[1][there])), shape=(6 * joints, nu))
        D = np.zeros((6 * joints, nu + 1))
        for column, block in zip(columns, blocks, strict=True):
            D[rows, column] += block
        return far, D[:, :nu]

    def weight(self, D: Any, masses: Any, units: Array) -> Any:
        """Matrix (n, n) of the sum of squares to be minimised: D^T D of derivatives D (6 j, n), plus the masses (n, n) with the
        small weight INERTIA; units (n,): unit displacements."""
        matrix = sp.csc_matrix if self.model.nu > LARGE else as_full
        return matrix(D.T @ D) + matrix(masses) * (INERTIA / np.max(masses.diagonal() * (units / self.extent) ** 2))

    def rotation(self, joint: Connection, q: Array) -> Array:
        """Quaternion (4,) of the rotation of l relative to k from the drawing, in components along the joint's axes."""
        k, l = self.model.ends(joint)
        a, b = self._poses(q)[1][[self._number[k], self._number[l]]]
        return quaternion(joint_axes(joint.joint, k).T @ a.T @ b @ joint_axes(joint.joint, k, "l"))

    def _poses(self, q: Array) -> tuple[Array, Array, Array]:
        """For the n bodies of all joints: rotation matrices of their axes (n, 3, 3), rotations from the drawing (n, 3, 3),
        positions (n, 3), m."""
        here = np.append(q, 0.0)[self._q]
        R = np.tile(np.eye(3), (len(here), 1, 1))
        R[self._spatial] = rotation_matrices(here[self._spatial, 3:])
        for i in np.flatnonzero(self._planar):
            R[i] = rotation_of(NodeKind.PLANAR, here[i, 1:])
        return R, R @ self._axes, here[:, :3]

    def _placed(self, q: Array) -> tuple[Array, tuple[Array, Array, Array, Array, Array]]:
        """The result of `far`; then that of `_poses`, the joints' points on k and l (2, j, 3), m, and unit quaternions (j, 4) of
        the relative rotations from the drawing."""
        R, turned, position = self._poses(q)
        of = turned[self._of]
        points = position[self._of] + (of @ self._arms[..., None])[..., 0]
        back = np.swapaxes(of[0], 1, 2)
        P = np.where(self._oriented[:, None], quaternion(back @ of[1]), np.eye(4)[0])
        way = (back @ (points[1] - points[0])[..., None])[..., 0] - self._apart
        return np.hstack([2 * P[:, 1:], way / self.extent]).ravel(), (R, turned, position, points, P)


def _cross(a: Array) -> Array:
    """The matrices (..., 3, 3) of the cross products a x of vectors (..., 3)."""
    x, y, z = np.moveaxis(a, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*a.shape[:-1], 3, 3)


DEPENDENT = 1e-9  #: singular value of rows of unit length (in least squares: over the largest) up to which it counts as 0


def least_change(A: Array, right: Array, root: Array, massless: Any, stated: Array, off: Array) -> Array:
    """x (n,) by three requirements, each as far as those before it allow: A x = right (least squares), then stated @ x as near to
    `off` (s,) as possible, then x of the smallest size, sqrt(x^T M x).

    A (rows, n); stated (s, n): conditions that are only to be met as well as possible; root: Cholesky factor of the mass matrix M
    of the coordinates that have mass; massless (n,) bool: joint coordinates, which have no mass of their own and follow from the
    rows of A that contain them."""
    heavy, x = ~massless, np.zeros(len(massless))
    rows, values, pivots = _without(A, right, np.flatnonzero(massless))
    left = np.array([row for row in range(len(A)) if row not in set(pivots.values())], dtype=np.intp)
    scaled, wanted = (np.asarray(np.linalg.solve(root, part.T).T) for part in (rows[np.ix_(left, heavy)], stated[:, heavy]))
    sizes, lengths = row_lengths(scaled), row_lengths(wanted)
    scaled, wanted = scaled / sizes, wanted / lengths
    # y = root^T x, so that |y| is the size of x; free: stated rows, projected on the motions that A x = right leaves free
    found = np.linalg.lstsq(scaled, np.column_stack([values[left] / sizes[:, 0], scaled @ wanted.T]), rcond=DEPENDENT)[0]
    y, free = found[:, 0], wanted - found[:, 1:].T
    y = y + _pseudo_inverse(free) @ (off / lengths[:, 0] - wanted @ y)
    x[heavy] = np.linalg.solve(root.T, y)
    for column, p in pivots.items():
        x[column] = (values[p] - rows[p, heavy] @ x[heavy]) / rows[p, column]
    return x


def violations(g: Array, B: Any) -> Array:
    """(m,) violation of constraints g (m,) as a displacement: |g| over the magnitude of the largest entry of the row of B (m, n),
    the constraint Jacobian in unit displacements, sparse or not."""
    size = largest_entries(B)
    return np.asarray(np.abs(g) / np.where(size > 0, size, 1.0))


def largest_violation(g: Array, B: Any) -> float:
    """The largest of the violations of constraints g (m,), see `violations`; 0 where there are no constraints."""
    return float(np.max(violations(g, B), initial=0.0))


def _without(A: Array, right: Array, columns: Any) -> tuple[Array, Array, dict[int, int]]:
    """The equations A x = right after eliminating these columns: each remains in one row only. Returns matrix, right-hand side,
    and column -> number of this row."""
    A, right = A.copy(), right.copy()
    pivots: dict[int, int] = {}
    for column in columns:
        size = np.abs(A[:, column])
        size[list(pivots.values())] = 0.0
        p = int(np.argmax(size)) if len(size) else 0
        if not len(size) or size[p] == 0:
            continue
        factor = A[:, column] / A[p, column]
        factor[p] = 0.0
        A -= np.outer(factor, A[p])
        A[:, column][np.arange(len(A)) != p] = 0.0
        right -= factor * right[p]
        pivots[int(column)] = p
    return A, right, pivots


def _pseudo_inverse(A: Array) -> Array:
    """Pseudo-inverse (n, rows) of A, with singular values below `DEPENDENT` taken as zero."""
    U, sizes, V = np.linalg.svd(A, full_matrices=False)
    kept = sizes > DEPENDENT
    return np.asarray(V[kept].T @ (U[:, kept] / sizes[kept]).T)


CORRECTIONS = 5
#: conditions get this compliance, relative to that of the stiffest unknown (1 over the largest diagonal entry of W), which keeps
#: the matrix regular if they are redundant; iterations remove the error
GIVEN = 1e-10
STATED = 1e-5  #: the same for stated velocities: larger, so that conditions prevail where stated velocities contradict them


def cheapest(W: Any, units: Array, A: Any, right: Array, pull: Array, give: Array | None = None) -> Array:
    """x (nu,) with A x = right (m,) that minimises x^T W x / 2 - pull^T x; rows of A (m, nu) may be redundant.

    W (nu, nu) is positive definite, sparse or full; units (nu,): unit displacements, by which unknowns are scaled; give (m,):
    compliances of the conditions, by default `GIVEN`. Where conditions contradict each other, those with the larger compliance
    are violated."""
    whole, pull = isinstance(W, np.ndarray), pull * units
    A, W = (as_full(A) * units, units[:, None] * W * units) if whole else (
        sp.csr_matrix(A) @ sp.diags(units), sp.diags(units) @ W @ sp.diags(units))
    size = largest_entries(A)
    size[size == 0] = 1.0
    stiff = float(np.max(W.diagonal()))
    share = stiff / size  # rows get entries as large as those of W
    A, right = share[:, None] * A if whole else sp.diags(share) @ A, share * right
    corner = -stiff * (np.full(A.shape[0], GIVEN) if give is None else give)
    solve = partial(np.linalg.solve, np.block([[W, A.T], [A, np.diag(corner)]])) if whole else (
        splu(sp.bmat([[W, A.T], [A, sp.diags(corner)]], format="csc")).solve)
    x, forces = np.zeros(len(units)), np.zeros(A.shape[0])
    for _ in range(CORRECTIONS):
        step = solve(np.r_[pull - W @ x - A.T @ forces, right - A @ x])
        x, forces = x + step[: len(x)], forces + step[len(x) :]
    return np.asarray(x * units)


def sparse_least_change(A: Any, right: Array, weight: Any, units: Array, stated: Any, off: Array,
                        pull: Array | None = None) -> Array:
    """As `least_change.least_change`, for many bodies: x (n,) with A x = right, then with stated @ x nearest to `off`, then with
    the smallest x^T W x / 2 - pull^T x, where W is `weight` (n, n) and pull (n,) by default 0. units (n,): unit displacements."""
    give = np.r_[np.full(A.shape[0], GIVEN), np.full(stated.shape[0], STATED)]
    return cheapest(weight, units, sp.vstack([A, stated]), np.r_[right, off],
                    np.zeros(len(units)) if pull is None else pull, give)


class RigidMotions:
    """Coordinates of the motions in which beams are rigid: the velocities of every node that belongs to no beam (single nodes),
    and for every beam the velocity of its first node and its angular velocity, six numbers, or three in the plane."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.beams: list[list[Node]] = [line.nodes for line in model.lines]
        of_beams = {n.name for nodes in self.beams for n in nodes}
        self.single = [n for n in model.nodes if n.name not in of_beams]
        self.size = sum(n.kind.sizes[1] for n in self.single) + sum(nodes[0].kind.sizes[1] for nodes in self.beams)

    @property
    def massless(self) -> Any:
        """(size,) bool: joint coordinates, which have no mass of their own."""
        counts = [n.kind.sizes[1] for n in self.single]
        mask = np.repeat([n.body is None for n in self.single], counts)
        return np.r_[mask, np.zeros(self.size - len(mask), dtype=bool)].astype(bool)

    def given(self, q: Array) -> list[tuple[Body, Any, Any]]:
        """Bodies whose velocity the user states, each with the derivatives of the velocity of its centre of mass, (2 or 3, size),
        and of its angular velocity, (0, 1 or 3, size), by the coordinates."""
        moving: list[tuple[Node, Body | None, Array]] = [(n, n.body, np.zeros(3)) for n in self.single]
        for nodes in self.beams:
            own = nodes[0].body
            assert own is not None
            beam = own.owner
            turn = rotation_of(nodes[0].kind, q[nodes[0].q : nodes[0].q + nodes[0].kind.sizes[0]]) @ own.drawn.rotation.T
            moving.append((nodes[0], beam, turn @ (beam.drawn.position - own.drawn.position)))
        column = 0
        found: list[tuple[Body, Any, Any]] = []
        for node, body, arm in moving:
            n, end = node.kind.translations, column + node.kind.sizes[1]
            if body is not None and body.given_velocity:
                moves, turns = (self._ones(first, last) for first, last in ((column, column + n), (column + n, end)))
                spins = (np.eye(3)[[2]] if n == 2 else np.eye(3))[: end - column - n]
                arms = np.cross(spins, arm)[:, :n].T
                found.append((body, moves + (arms if isinstance(turns, np.ndarray) else sp.csr_array(arms)) @ turns, turns))
            column = end
        return found

    def _ones(self, first: int, last: int) -> Any:
        """Rows `first` to `last` of the identity matrix of this size; sparse where `size` is above FULL."""
        if self.size > FULL:
            return sp.eye_array(last - first, self.size, k=first, format="csr")
        return np.eye(last - first, self.size, k=first)

    def basis(self, q: Array) -> Array:
        """B (nu, size) at q: the velocities of all nodes are B times these coordinates. Those of beams, velocity of the first
        node and angular velocity, are in inertial axes."""
        B, column = np.zeros((self.model.nu, self.size)), 0
        for node in self.single:
            nu = node.kind.sizes[1]
            B[node.u : node.u + nu, column : column + nu] = np.eye(nu)
            column += nu
        for nodes in self.beams:
            n, nu = nodes[0].kind.translations, nodes[0].kind.sizes[1]
            spins = np.eye(3)[[2]] if n == 2 else np.eye(3)
            at, by = (np.array([[place] for place in of]) for of in ([x.q for x in nodes], [x.u for x in nodes]))
            r = np.zeros((len(nodes), 3))
            r[:, :n] = q[at + np.arange(n)]
            B[by + np.arange(n), column + np.arange(n)] = 1.0
            for j, spin in enumerate(spins, start=column + n):
                B[by + np.arange(n), j] = np.cross(spin, r - r[0])[:, :n]
            turning = rotation_matrices(q[at + np.arange(3, 7)]).transpose(0, 2, 1) if n == 3 else np.ones((len(nodes), 1, 1))
            rows, columns = by[:, :, None] + np.arange(n, nu)[:, None], column + np.arange(n, nu)
            B[rows, columns] = turning
            column += nu
        return B

    def moved(self, q: Array, x: Array, free: Array) -> Array:
        """Positions (nq,) after displacements x (size,) of the coordinates. free: positions in which single nodes are displaced
        already, so that only beams remain to be moved."""
        q, column = free.copy(), self.size - sum(nodes[0].kind.sizes[1] for nodes in self.beams)
        before = free
        for nodes in self.beams:
            n, nu = nodes[0].kind.translations, nodes[0].kind.sizes[1]
            move, turn = np.zeros(3), np.zeros(3)
            move[:n] = x[column : column + n]
            turn[3 - (nu - n) :] = x[column + n : column + nu]
            P = turned(np.array([1.0, 0, 0, 0]), turn)
            R, pivot = rotation_matrices(P), nodes[0].position(before)
            for node in nodes:
                q[node.q : node.q + n] = (pivot + move + R @ (node.position(before) - pivot))[:n]
                if node.kind is NodeKind.PLANAR:
                    q[node.q + 2] += turn[2]
                else:
                    q[node.q + 3 : node.q + 7] = quaternion_product(P, before[node.q + 3 : node.q + 7])
            column += nu
        return q
