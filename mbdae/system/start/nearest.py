"""The nearest consistent positions of loops that are not closed where their joints stand as drawn or as stated.

From the drawing, where the joints close, held and prescribed values grow to what is stated. On the way and at its end the joints
stay as near to their drawn places as the loops allow: the sum of the squares of their relative motions (`joint_motions.py`) is the
least nearby. That depends on bodies, points and stated values alone, so it is found once, between the coordinates of bodies, and
every joint model takes it over.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, inf, pi
from typing import Any

import numpy as np

from mbdae.deferred import as_full, sp
from mbdae.errors import StartError
from mbdae.scene.components import Connection
from mbdae.symbolic.frames import NodeKind
from mbdae.system.base import Array
from mbdae.system.model.model import build
from mbdae.system.model.numbering import constraint_rows
from mbdae.system.motion.constrained import row_lengths
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.start.joint_motions import JointMotions
from mbdae.system.start.least_change import DEPENDENT
from mbdae.system.start.positions import REACHED, ConsistentPositions, Held
from mbdae.system.start.sparse_change import cheapest

STEP = 0.1  #: largest growth of a held value at once: rad, or over the extent of the joints
REACH = 0.3  #: largest displacement of one iteration: rad, or over the scene's length
ON_THE_WAY, AT_THE_END = (1e-2, 20), (1e-12, 100)  #: last displacement of an iteration that has converged; most iterations
EXACT = 1e-7  #: displacement of an iteration below which what it lessens changes by rounding only
DIFFERENCE = 1e-6  #: displacement, over a unit, by which second derivatives are found
WEAK = 0.03  #: singular value of unit rows below which a loop is near a place where it can go on in two ways
ASIDE = 0.1  #: displacement by which the ways from there are tried: rad, or over the scene's length
ALIKE = 1e-6  #: relative difference of two distances that counts as none, and of positions that are the same


def start_positions(own: ConsistentPositions) -> Array:
    """Positions (nq,) at which a scene starts: those along its tree where these close its loops, else the nearest ones; StartError
    where none are found, or two are equally near."""
    q = own.placed()
    if own.closing_error(q) <= REACHED:
        return own.close(q)
    model = own.model
    kept = {c.name: "the start is found between bodies" for c in model.scene.joints if c.recursive}
    between = build(model.scene, {**model.stay_kinematic, **kept})
    between.conditions.time = model.conditions.time
    rows = [row for row in constraint_rows(between) if not row.prescribes]
    found = NearestPositions(Mechanics(between, rows), float(own.t[0]), changes=own.changes)
    return found.taken_over(own, found.found())


@dataclass
class Look:
    """Positions q, unit displacements, conditions g with their derivatives A, motions of joints with their derivatives D."""

    q: Array
    units: Array
    g: Array
    A: Any
    far: Array
    D: Any

    def merit(self, weights: Array) -> float:
        """What an iteration has to lessen: distance from the drawing, and weighted violations of the conditions."""
        return float(self.far @ self.far) / 2 + float(weights @ np.abs(self.g))


@dataclass
class Step:
    """A displacement x of one iteration; weights of the conditions in what it lessens; the direction in which loops near a
    singular position can leave it, None elsewhere."""

    x: Array
    weights: Array
    aside: Array | None = None


class NearestPositions(ConsistentPositions):
    """Consistent positions by growing held and prescribed values from the drawing; for mechanics without rows that prescribe."""

    def __init__(self, mechanics: Mechanics, t0: float, changes: list[str] | None = None) -> None:
        super().__init__(mechanics, t0, changes=changes)
        self.joints = JointMotions(self.model)
        self.share = 0.0  #: of the stated values, and of what is closed of that which is open as drawn
        self.open = np.zeros(mechanics.m)
        self.crossing: tuple[float, Array, Array] | None = None  #: share, positions and direction of the way where it was weakest
        self.angles: dict[tuple[str, str], float] = {}  #: joint coordinates with their whole turns, by joint and name

    def held_values(self, joint: Connection) -> dict[str, float]:
        return {c: self.share * value for c, value in super().held_values(joint).items()}

    def _held(self, values: Callable[[Connection], dict[str, float]]) -> list[Held]:
        return [(joint, c, value) for joint in self.scene.joints for c, value in values(joint).items()]

    def _closure(self, q: Array) -> Array:
        g = super()._closure(q)
        g[: self.mechanics.m] -= (1 - self.share) * self.open
        return g

    def found(self) -> Array:
        """The nearest positions (nq,)."""
        q = self.placed()
        self.open = self.mechanics.position_residual(self.t, q[None])[0]
        self._follow(q)
        ways = [self._way(q, 0.0)]
        if self.crossing is not None:
            share, at, aside = self.crossing
            ways += [self._way(self.moved(at, sign * aside), share) for sign in (-1.0, 1.0)]
        ways = [way for way in ways if way[0] < inf]
        if not ways:
            return self._otherwise()
        ways.sort(key=lambda way: way[0])
        for far, other, _ in ways[1:]:
            if far - ways[0][0] <= ALIKE * max(1.0, far) and np.max(np.abs(other - ways[0][1])) > ALIKE * self.model.length:
                raise StartError([self._two_ways(ways[0][1], other)])
        _, q, self.angles = ways[0]
        self._report(q)
        return q

    def _way(self, q: Array, first: float) -> tuple[float, Array, dict[tuple[str, str], float]]:
        """Distance from the drawing, infinite where it does not close, positions (nq,) and joint coordinates at the end of a way
        on from positions q at the share `first`."""
        self.share = 1.0
        held = [abs(v) / (self.joints.extent if joint.unit(c) == "m" else 1.0) for joint, c, v in self._held(self.held_values)]
        steps = max(1, ceil((1 - first) * max(held, default=0.0) / STEP))
        for step in range(1, steps + 1):
            self.share = first + (1 - first) * step / steps
            q = self._settled(q, *(AT_THE_END if step == steps else ON_THE_WAY))
            self._follow(q)
        far = self.joints.at(q)[0]
        return float(far @ far) if self.closing_error(q) <= REACHED else inf, q, dict(self.angles)

    def _settled(self, q: Array, exact: float, most: int) -> Array:
        """Positions nearby that satisfy the conditions, of these those with the joints nearest to their drawn places."""
        here = self._look(q)
        for _ in range(most):
            step = self._step(here, exact < EXACT)
            size = float(np.max(np.abs(step.x) / here.units, initial=0.0))
            factor, merit = min(1.0, REACH / max(size, 1e-300)), here.merit(step.weights)
            there = self._look(self.moved(here.q, factor * step.x))
            while size > EXACT and factor > 1e-3 and there.merit(step.weights) > merit:
                factor /= 2
                there = self._look(self.moved(here.q, factor * step.x))
            here = there
            if size <= exact:
                break
        return here.q

    def _look(self, q: Array) -> Look:
        far, D = self.joints.at(q)
        A = self._closure_jacobian(q)
        if self.model.lines:
            B = self.rigid.basis(q)
            A, D = A @ B, D @ B
        return Look(q, self.units(q), self._closure(q), A, far, D)

    def _step(self, here: Look, curved: bool) -> Step:
        """Newton's step to positions that satisfy the conditions and have the joints nearest to their drawn places; without the
        curvature of both where it is large, or not `curved`."""
        slope, W = here.D.T @ here.far, self.joints.weight(here.D, *self._masses(here))
        if self.mechanics.large:
            return Step(cheapest(W, here.units, here.A, -here.g, -slope), 10 / row_lengths(here.A)[:, 0])
        A = as_full(here.A)
        lengths = row_lengths(A * here.units)[:, 0]
        U, sizes, V = np.linalg.svd(A * here.units / lengths[:, None])
        rank = int(np.sum(sizes > DEPENDENT))
        forces = -(U[:, :rank] / sizes[:rank]) @ (V[:rank] @ (slope * here.units)) / lengths
        x, N = cheapest(W, here.units, A, -here.g, np.zeros(len(slope))), here.units[:, None] * V[rank:].T
        if N.size:
            H = N.T @ (W @ N) + (self._curvature(here, N, forces) if curved else 0.0)
            values, axes = np.linalg.eigh((H + H.T) / 2)
            x = x - N @ (axes @ ((axes.T @ (N.T @ slope)) / np.maximum(np.abs(values), 1e-6)))
        return Step(x, 2 * np.abs(forces) + 1 / lengths)

    def _curvature(self, here: Look, N: Array, forces: Array) -> Array:
        """What the curvature of the conditions and of the joints' motions adds to the second derivatives along N (n, f)."""
        change, start = np.zeros((N.shape[1],) * 2), here.D.T @ here.far + here.A.T @ forces
        for i, n in enumerate(N.T):
            there = self._look(self.moved(here.q, DIFFERENCE * n))
            slope = there.D.T @ there.far + there.A.T @ forces
            change[:, i] = N.T @ ((slope - start) / DIFFERENCE - here.D.T @ (here.D @ n))
        return change

    def _masses(self, here: Look) -> tuple[Any, Array]:
        if not self.model.lines:
            return self.mechanics.weight, here.units
        B = self.rigid.basis(here.q)
        return B.T @ (self.mechanics.mass @ B), here.units

    def _follow(self, q: Array) -> None:
        """Read the joint coordinates, with the whole turns that are nearest to their last values."""
        every = [(joint, c, 0.0) for joint in self.scene.joints if not joint.loose for c in joint.scalars]
        values, _, _ = self._coordinates(q, np.zeros(self.mechanics.nu), every)
        for (joint, c, _), value in zip(every, values, strict=True):
            last = self.angles.get((joint.name, c), 0.0)
            turns = 2 * pi * round((last - value) / (2 * pi)) if joint.unit(c) == "rad" else 0.0
            self.angles[joint.name, c] = float(value) + turns

    def _otherwise(self) -> Array:
        """Positions that are found from the tree of the joints, where the way from the drawing ends before the stated values."""
        self.share = 1.0
        return self.close_or_bend(self.placed())

    def taken_over(self, own: ConsistentPositions, q: Array) -> Array:
        """Positions of another model of the scene with the bodies as they are here at q (nq,)."""
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

    def _report(self, q: Array) -> None:
        pass

    def _two_ways(self, q: Array, other: Array) -> str:
        gaps = {b.name: float(np.linalg.norm(node.position(q) - node.position(other))) for node, b in self.model.bodies}
        most = max(gaps, key=gaps.__getitem__)
        return (f"the loops can close in two ways that are equally near to the drawing ('{most}' stands {gaps[most]:.3g} m apart in "
                f"them): draw the bodies nearer to the one that is meant, or state where another joint starts")  # fmt: skip
