"""The motion of a joint in numbers: where its coordinates put a body, and how fast."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import symengine as se

from mbdae.inputs import timed
from mbdae.scene.components import Connection
from mbdae.scene.scene import SceneData
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.motion import Step, real_value, symbolic_motion
from mbdae.system.base import Array
from mbdae.system.model.rotations import quaternion_product, rotation_matrices, turned
from mbdae.system.model.sides import joint_axes

NO_TURN = np.eye(4)[0]


class JointMotion:
    """The motion of a joint as a chain of rotations and translations about and along axes as drawn. t: time (s) at which
    parameters that depend on time are evaluated; the chain is empty where the law states no motion."""

    def __init__(self, item: Connection, t: float = 0.0) -> None:
        law: Any = (item.as_kinematic or item.laws)[0] if item.loose else item.joint
        motion = symbolic_motion(law) if isinstance(law, Joint) else None  # a force states no motion
        self._steps = motion.steps if motion is not None else ()
        self._t, self.at = t, np.asarray(law.at, dtype=float)
        self._axes = joint_axes(law, item.k)

    def _direction(self, step: Step) -> Array:
        """Axis (3,) of a step of the chain as drawn, inertial components."""
        return np.asarray(self._axes @ [float(c) for c in step.axis])

    def _amount(self, e: Any, values: dict[str, float]) -> float:
        if e.is_Symbol and str(e) != "t":  # the most frequent case, without substitution
            return float(values.get(str(e), 0.0))
        numbers = {s: values.get(str(s), 0.0) for s in e.free_symbols if str(s) != "t"}
        found = e.subs(numbers)
        number = timed.value_at(found, self._t) if found.free_symbols else real_value(found)
        return number if math.isfinite(number) else math.nan

    def drawn(self, values: dict[str, float], outwards: bool) -> tuple[Array, Array]:
        """Rigid motion (quaternion, displacement, m) of l from its drawn place, relative to k, at values of the coordinates;
        those not given are 0. outwards: False gives the inverse motion, of k relative to l."""
        P, r = NO_TURN, np.zeros(3)
        for step in self._steps:  # a free rotation is not turned: the amount of its step is 0
            amount = self._amount(step.amount, values)
            if not amount:
                continue
            axis = self._direction(step)
            if step.turns:
                dP = turned(NO_TURN, amount * axis)
                P, r = quaternion_product(P, dP), r + rotation_matrices(P) @ (self.at - rotation_matrices(dP) @ self.at)
            else:
                r = r + rotation_matrices(P) @ (amount * axis)
        if outwards:
            return P, r
        back = P * np.array([1.0, -1.0, -1.0, -1.0])
        return back, -rotation_matrices(back) @ r

    def leaves_plane(self, values: dict[str, float], rates: dict[str, float]) -> bool:
        """Whether a start with these values or rates lies or moves out of the plane z = 0."""
        (_, *p), r = self.drawn(values, True)
        _, v, w = self.rates(values, rates)
        return bool(np.any(np.abs([p[0], p[1], r[2], v[2], w[0], w[1]]) > 1e-12))

    def not_as_drawn(self, length: float) -> str:
        """Error message where the motion moves l from its drawn place although all coordinates are 0; "" where it does not.
        length: that of the scene, m."""
        P, r = self.drawn({}, True)
        if np.max(np.abs(P[1:])) <= 1e-9 and np.max(np.abs(r)) <= 1e-9 * length:
            return ""
        turned = 2 * np.arcsin(np.minimum(1.0, np.linalg.norm(P[1:])))
        return (f"its method `motion` moves the second body (l) by {np.linalg.norm(r):.3g} m and turns it by {turned:.3g} rad "
                "where its coordinates are 0, but there both bodies have to be as drawn; state the motion without this offset, "
                "or draw l there")  # fmt: skip

    def planar_turn(self, values: dict[str, float]) -> float:
        """Rotation of body l relative to k about z at these values of the coordinates, whole turns included, rad."""
        return sum(self._amount(s.amount, values) * float(self._direction(s)[2]) for s in self._steps if s.turns)

    def rates(self, values: dict[str, float], rates: dict[str, float]) -> tuple[Array, Array, Array]:
        """Relative motion of the bodies k and l: vector from the joint's point on k to that on l, its velocity, and the angular
        velocity of l relative to k, (3,) each, in axes fixed to k that were inertial as drawn."""
        P, way, v, w = NO_TURN, np.zeros(3), np.zeros(3), np.zeros(3)
        for step in self._steps:
            axis = rotation_matrices(P) @ self._direction(step)
            amount = self._amount(step.amount, values)
            rate = sum(self._amount(se.diff(step.amount, se.Symbol(c)), values) * r for c, r in rates.items())
            if step.turns:
                P = quaternion_product(P, turned(NO_TURN, amount * self._direction(step))) if amount else P
                w = w + rate * axis
            else:
                way, v = way + amount * axis, v + rate * axis + np.cross(w, amount * axis)
        return way, v, w


def out_of_plane_motions(scene: SceneData) -> dict[str, str]:
    """Recursive joints of a planar scene that are treated as kinematic, and why: some of their coordinates would move bodies out
    of the plane, or one is a free rotation. (A joint all of whose coordinates do so makes the scene spatial elsewhere.)"""
    found = {}
    for c in (c for c in scene.joints if c.recursive):
        across = [name for name in c.coordinates if JointMotion(c).leaves_plane({name: 1.0}, {name: 1.0})]
        if "rotation" in map(c.unit, c.coordinates):
            found[c.name] = "in the plane its rotation is an angle: state a revolute joint to make it recursive"
        elif 0 < len(across) < len(c.coordinates):
            found[c.name] = f"in a planar scene its {across[0]} stays 0: as a recursive joint it would move out of the plane"
    return found
