"""The consistent positions nearest to the drawing, for loops that do not close with their joints as drawn or as stated.

They are found by continuation from the drawing: held and prescribed joint coordinates grow in steps from 0 to their stated
values. At every step the sum of squares of all joints' relative motions from the drawing (`joint_motions.py`) is at a local
minimum among the positions that close the loops. Where this path passes a singular position, at which the loops may continue on
another branch, the other branches are followed too; the end nearest to the drawing is the result. It depends on bodies, points
and stated values alone: it is found once, with the positions of bodies as unknowns, and used for every joint model.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from math import asin, ceil, inf, pi
from typing import Any

import numpy as np

from mbdae.deferred import as_full, sp
from mbdae.errors import StartError
from mbdae.scene.components import Connection
from mbdae.scene.models import spanning_tree
from mbdae.symbolic.frames import NodeKind
from mbdae.system.base import Array
from mbdae.system.changes import DEPENDENT, JointMotions, cheapest
from mbdae.system.model.model import build
from mbdae.system.model.nodes import rotation_of
from mbdae.system.model.numbering import constraint_rows
from mbdae.system.motion.constrained import row_lengths
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.positions import REACHED, ConsistentPositions, Held
from mbdae.values import ALIKE

STEP = 0.1  #: largest change of a held or prescribed coordinate in one step of the continuation: rad, or over the scene's extent
REACH = 0.3  #: largest displacement in one iteration of Newton's method: rad, or over the scene's length
#: tolerance (size of the last displacement) and largest number of Newton iterations, in all steps of the continuation but the
#: last, and in the last one
ON_THE_WAY, AT_THE_END = (1e-2, 6), (1e-12, 40)
STUCK = 5  #: number of successive iterations that could not reduce the merit function after which Newton's method gives up
#: displacement of an iteration up to which the merit function changes by round-off only and is not compared; second derivatives
#: are used where the tolerance is smaller
EXACT = 1e-7
DIFFERENCE = 1e-6  #: displacement, in unit displacements, for finite differences that give second derivatives
FEW = 20  #: number of independent motions that the conditions allow, up to which second derivatives are computed
WEAK = 0.03  #: smallest singular value of conditions of unit length up to which another branch is looked for nearby
ASIDE = 0.1  #: displacement by which other branches are entered: rad, or over the scene's length


def start_positions(own: ConsistentPositions) -> Array:
    """Positions (nq,) at which a scene starts: bodies placed along the tree of joints, if this closes the loops with all other
    joints as drawn, else the nearest positions. StartError where none are found, or two are equally near."""
    q, model = own.placed(), own.model
    if own.closing_error(q) <= REACHED and _as_drawn(own, q):
        closed = own.close(q)
        own.drawn = bool(np.all(closed == q))
        return closed
    kept = {c.name: "the start is found between bodies" for c in model.scene.joints if c.recursive}
    between = build(model.scene, {**model.stay_kinematic, **kept})
    between.conditions.time = model.conditions.time
    rows = [row for row in constraint_rows(between) if not row.prescribes]
    found = NearestPositions(Mechanics(between, rows), float(own.t[0]), changes=own.changes)
    return found.taken_over(own, found.found())


def _as_drawn(own: ConsistentPositions, q: Array) -> bool:
    """Whether at q every joint is as drawn, except those of the tree with stated values, so that no other positions are
    nearer."""
    if not own.tree.closing:
        return True
    held = {joint.name for _, joint, _ in own.tree.edges if own.held_values(joint)}
    joints = JointMotions(own.model)
    far = joints.far(q).reshape(-1, 6)
    return all(name in held or np.max(np.abs(d)) <= REACHED for name, d in zip(joints.names, far, strict=True))


@dataclass
class Trial:
    """Positions q (nq,) tried by an iteration, with the residual g of the conditions and the joints' motions from the drawing,
    far."""

    q: Array
    g: Array
    far: Array

    def merit(self, weights: Array) -> float:
        """The merit function that an iteration has to reduce: squared distance from the drawing and weighted violations."""
        return float(self.far @ self.far) / 2 + float(weights @ np.abs(self.g))


@dataclass
class Look(Trial):
    """A trial with derivatives by displacements: A of the conditions, D of the joints' motions; units: unit displacements."""

    units: Array
    A: Any
    D: Any


@dataclass
class PathPoint:
    """A point of a path: share of the stated values, positions q, joint coordinates; unit displacements, and singular values and
    vectors of the conditions there, which tell whether it is near a singular position."""

    share: float
    q: Array
    angles: dict[tuple[str, str], float]
    units: Array
    sizes: Array
    V: Array


@dataclass
class PathEnd:
    """The end of a path: squared distance from the drawing, infinite where loops are open; positions q; joint coordinates."""

    far: float
    q: Array
    angles: dict[tuple[str, str], float]


class NearestPositions(ConsistentPositions):
    """Finds the nearest consistent positions by continuation from the drawing. The mechanics must have no rows that prescribe
    coordinates: prescribed coordinates are held here, like those that the user holds."""

    def __init__(self, mechanics: Mechanics, t0: float, changes: list[str] | None = None) -> None:
        super().__init__(mechanics, t0, changes=changes)
        self.tree = spanning_tree(self.scene, sorted(self.scene.joints, key=lambda c: c.name))  # by name: not by statement order
        self.joints = JointMotions(self.model)
        self.share = 0.0  #: present fraction of the stated values, and of the closing of loops that are drawn open (`open`)
        self.open = np.zeros(mechanics.m)
        self.passed: list[PathPoint] = []
        self.angles: dict[tuple[str, str], float] = {}  #: (joint, coordinate) -> its value, angles beyond one turn included

    def held_values(self, joint: Connection) -> dict[str, float]:
        return {c: self.share * value for c, value in super().held_values(joint).items()}

    def _held(self, values: Callable[[Connection], dict[str, float]]) -> list[Held]:
        return [(joint, c, value) for joint in self.scene.joints for c, value in values(joint).items()]

    def _closure(self, q: Array) -> Array:
        g = super()._closure(q)
        g[: self.mechanics.m] -= (1 - self.share) * self.open
        return g

    def found(self) -> Array:
        """The nearest positions (nq,); StartError where two are equally near."""
        drawn = self.placed()
        self.open = self.mechanics.position_residual(self.t, drawn[None])[0]
        self._follow(drawn)
        ways = [self._way(drawn, 0.0)]
        if not self.mechanics.large:
            for place, aside in self._crossings(ways[0]):
                for sign in (1.0, -1.0):
                    self.angles = dict(place.angles)
                    ways.append(self._way(self.moved(place.q, sign * aside), place.share))
        ways = [way for way in ways if way.far < inf]
        if not ways:
            return self._otherwise()
        least = min(way.far for way in ways)
        nearest = next(way for way in ways if way.far <= (1 + ALIKE) * least)
        others = [way for way in ways if self._apart(nearest.q, way.q)[0] > ALIKE]
        for other in others:
            if other.far <= (1 + ALIKE) * least:
                raise StartError([self._two_ways(nearest.q, other.q)])
        self.share, self.angles = 1.0, nearest.angles
        self._report(drawn, nearest.q, bool(others))
        return nearest.q

    def _crossings(self, way: PathEnd) -> list[tuple[PathPoint, Array]]:
        """Points of a path at which another branch may begin, each with a displacement into it: the point next to a singular
        position; the drawing, if it is singular and the path did not end in closed loops."""
        passed, first = list(self.passed), self.passed[0]
        if way.far == inf:
            rank = int(np.sum(first.sizes > DEPENDENT))
            aside = [ASIDE * first.units * v for v in first.V[rank:]]
            nearby = (self._loose(self.moved(first.q, x))[1] for x in aside)
            singular = any(np.sum(sizes > DEPENDENT) > rank for sizes in nearby)
            return [(first, x) for x in aside] if singular else []
        rank = max(int(np.sum(place.sizes > DEPENDENT)) for place in passed)
        weakest = min(passed, key=lambda place: place.sizes[rank - 1]) if rank else first
        if not rank or weakest.sizes[rank - 1] > WEAK:
            return []
        return [(weakest, ASIDE * weakest.units * weakest.V[rank - 1])]

    def _apart(self, q: Array, other: Array) -> tuple[float, str]:
        """Largest displacement (over the scene's length) or change of a rotation matrix of a body between q and other; its
        name."""
        gaps = []
        for node, body in self.model.bodies:
            at = slice(node.q, node.q + node.kind.sizes[0])
            turned = float(np.max(np.abs(rotation_of(node.kind, q[at]) - rotation_of(node.kind, other[at]))))
            moved = float(np.linalg.norm(node.position(q) - node.position(other)))
            gaps.append((max(turned, moved / self.model.length), body.name))
        return max(gaps)

    def _way(self, q: Array, first: float) -> PathEnd:
        """Follow a path from positions q, where the share of the stated values is `first`, to the share 1; returns its end."""
        self.share = 1.0
        held = [abs(v) / (self.joints.extent if joint.unit(c) == "m" else 1.0) for joint, c, v in self._held(self.held_values)]
        steps = max(1, ceil((1 - first) * max(held, default=0.0) / STEP))
        for step in range(1, steps + 1):
            before, self.share = self.share, first + (1 - first) * step / steps
            self.passed.append(PathPoint(before if step > 1 else first, q, dict(self.angles), *self._loose(q)))
            q = self._settled(q, *(AT_THE_END if step == steps else ON_THE_WAY))
            self._follow(q)
        if self.closing_error(q) > REACHED:  # try from any positions that close the loops
            with suppress(StartError):
                q = self._settled(self.closed(q), *AT_THE_END)
                self._follow(q)
        far = self.joints.far(q)
        return PathEnd(float(far @ far) if self.closing_error(q) <= REACHED else inf, q, dict(self.angles))

    def _settled(self, q: Array, exact: float, most: int) -> Array:
        """Positions near q that satisfy the conditions with the least distance from the drawing, by Newton's method. exact, most:
        see AT_THE_END."""
        here, stuck = self._look(q), 0
        for _ in range(most):
            x, weights = self._step(here, exact < EXACT)
            size = float(np.max(np.abs(x) / here.units, initial=0.0))
            factor, merit = min(1.0, REACH / max(size, 1e-300)), here.merit(weights)
            there = self._trial(self.moved(here.q, factor * x))
            while size > EXACT and factor > 1e-3 and there.merit(weights) > merit:
                factor /= 2
                there = self._trial(self.moved(here.q, factor * x))
            stuck = stuck + 1 if size > EXACT and there.merit(weights) > merit else 0
            if size <= exact or stuck == STUCK:
                return there.q
            here = self._look(there.q)
        return here.q

    def _trial(self, q: Array) -> Trial:
        return Trial(q, self._closure(q), self.joints.far(q))

    def _look(self, q: Array) -> Look:
        far, D = self.joints.at(q)
        A = self._closure_jacobian(q)
        if self.model.lines:
            B = self.rigid.basis(q)
            A, D = A @ B, D @ B
        return Look(q, self._closure(q), far, self.units(q), A, D)

    def _step(self, here: Look, curved: bool) -> tuple[Array, Array]:
        """Newton's step (n,) to positions that satisfy the conditions with the least distance from the drawing, and the weights
        of the conditions in the merit function. curved: use second derivatives; they are not used in large scenes anyway."""
        slope, W = here.D.T @ here.far, self.joints.weight(here.D, self._masses(here.q), here.units)
        if self.mechanics.large:
            return cheapest(W, here.units, here.A, -here.g, -slope), 10 / row_lengths(here.A @ sp.diags(here.units))[:, 0]
        A = as_full(here.A)
        lengths, (U, sizes, V) = _decomposed(A * here.units)
        rank = int(np.sum(sizes > DEPENDENT))
        forces = -(U[:, :rank] / sizes[:rank]) @ (V[:rank] @ (slope * here.units)) / lengths
        x, N = cheapest(W, here.units, A, -here.g, np.zeros(len(slope))), here.units[:, None] * V[rank:].T
        if N.size:
            H = N.T @ (W @ N) + (self._curvature(here, N, forces) if curved and N.shape[1] <= FEW else 0.0)
            values, axes = np.linalg.eigh((H + H.T) / 2)
            x = x - N @ (axes @ ((axes.T @ (N.T @ slope)) / np.maximum(np.abs(values), 1e-6)))
        return x, 2 * np.abs(forces) + 1 / lengths

    def _curvature(self, here: Look, N: Array, forces: Array) -> Array:
        """Second derivatives (f, f) of conditions (times their forces, the multipliers) and of the joints' motions along N (n,
        f), by finite differences; to be added to the Gauss-Newton matrix."""
        change, start = np.zeros((N.shape[1],) * 2), here.D.T @ here.far + here.A.T @ forces
        for i, n in enumerate(N.T):
            there = self._look(self.moved(here.q, DIFFERENCE * n))
            slope = there.D.T @ there.far + there.A.T @ forces
            change[:, i] = N.T @ ((slope - start) / DIFFERENCE - here.D.T @ (here.D @ n))
        return change

    def _loose(self, q: Array) -> tuple[Array, Array, Array]:
        """Unit displacements, and singular values and right singular vectors of the conditions at q; these empty in large
        scenes."""
        units = self.units(q)
        if self.mechanics.large:
            return units, np.zeros(0), np.zeros((0, 0))
        A = self._closure_jacobian(q)
        return units, *_decomposed(as_full(A @ self.rigid.basis(q) if self.model.lines else A) * units)[1][1:]

    def _masses(self, q: Array) -> Any:
        """Mass matrix (n, n) in the coordinates of `RigidMotions`."""
        if not self.model.lines:
            return self.mechanics.weight
        B = self.rigid.basis(q)
        return B.T @ (self.mechanics.mass @ B)

    def _follow(self, q: Array) -> None:
        """Set `angles` to the joint coordinates at q; angles get the whole turns with which they are nearest to their last
        values."""
        every = [(joint, c, 0.0) for joint in self.scene.joints if not joint.loose for c in joint.scalars]
        values, _, _ = self._coordinates(q, np.zeros(self.mechanics.nu), every)
        for (joint, c, _), value in zip(every, values, strict=True):
            last = self.angles.get((joint.name, c), 0.0)
            turns = 2 * pi * round((last - value) / (2 * pi)) if joint.unit(c) == "rad" else 0.0
            self.angles[joint.name, c] = float(value) + turns

    def _otherwise(self) -> Array:
        """Positions for scenes in which no path from the drawing closes the loops: found from bodies placed along the tree of
        joints, or by bending beams."""
        self.share = 1.0
        bent = len(self.changes)
        q = self.close_or_bend(self.placed())
        self._follow(q)
        if not any("start bent" in change for change in self.changes[bent:]):
            self.changes.append("the loops cannot follow the stated values from the drawing: of the ways to close them one is "
                                "found joint by joint, in the order of their names; draw the bodies nearer to the one that is "
                                "meant, or state where another joint starts")
        return q

    def taken_over(self, own: ConsistentPositions, q: Array) -> Array:
        """Positions in `own`, a model of the scene with other joint models, at which the bodies are as in this model at q
        (nq,)."""
        found, bodies = own.placed(), self.model.bodies
        for (node, _), (there, _) in zip(bodies, own.model.bodies, strict=True):
            found[there.q : there.q + there.kind.sizes[0]] = q[node.q : node.q + node.kind.sizes[0]]
        joints = {c.name: c for c in self.scene.joints}
        for node in own.model.joint_coordinates:
            if node.kind is NodeKind.ROTATION:
                found[node.q : node.q + 4] = self.joints.rotation(joints[node.joint], q)
            elif (node.joint, node.coordinate) in self.angles:
                found[node.q] = self.angles[node.joint, node.coordinate]
        return own.close(found)

    def _report(self, drawn: Array, q: Array, branching: bool) -> None:
        """Append a sentence to `changes`: which joint, of those not held, is farthest from the drawing, and which body moved
        most. branching: whether the path had other branches."""
        far = self.joints.far(q).reshape(-1, 2, 3)
        held = {joint.name for joint, _, _ in self._held(self.held_values)}
        free = {name: d for name, d in zip(self.joints.names, far, strict=True) if name not in held}
        by_joint = ""
        if free:
            name = max(free, key=lambda name: float(np.sum(free[name] ** 2)))
            turn, way = np.linalg.norm(free[name], axis=1)
            distance = f"{2 * asin(min(1.0, float(turn) / 2)):.3g} rad" if turn >= way else f"{way * self.joints.extent:.3g} m"
            by_joint = f"joint '{name}' leaves its drawn place by {distance}, "
        most, moved = self._most_moved(drawn, q)
        self.changes.append(f"to close the loops {by_joint}body '{most}' by {moved:.3g} m")
        if branching:
            self.changes.append("on their way from the drawing the loops pass a position from which they can go on in two ways: "
                                "the one that ends nearer to the drawing is taken")

    def _two_ways(self, q: Array, other: Array) -> str:
        return ("the loops can close in two ways that are equally near to the drawing, and differ most in the place of "
                f"'{self._apart(q, other)[1]}': draw the bodies nearer to the way that is meant, or state where another joint "
                "starts")


def _decomposed(B: Array) -> tuple[Array, Any]:
    """Lengths (m,) of the rows of B (m, n), and the singular value decomposition of these rows scaled to unit length."""
    lengths = row_lengths(B)[:, 0]
    return lengths, np.linalg.svd(B / lengths[:, None])
