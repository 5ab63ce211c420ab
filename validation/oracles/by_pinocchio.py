"""A tree as a model of Pinocchio: accelerations by its composite-rigid-body algorithm, forces by its Newton-Euler recursion.

A joint of several coordinates is a chain of elementary joints with bodies without mass between them; a weld is a hinge that is
held. Prescribed coordinates have the accelerations they are given, the others follow from M a + h = tau."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from oracles.trees import DRIVE, FORCE, GROUND, LEAD, TORQUE, Answer, Array, Branch, State, Tree

JOINTS = {("turn", 0): pin.JointModelRX, ("turn", 1): pin.JointModelRY, ("turn", 2): pin.JointModelRZ,
          ("slide", 0): pin.JointModelPX, ("slide", 1): pin.JointModelPY, ("slide", 2): pin.JointModelPZ}


@dataclass
class Placed:
    """A branch in the model: its last joint, the frame of its body, the joint of every coordinate, of its free rotation, and of a
    weld."""

    last: int
    frame: int
    steps: list[int] = field(default_factory=list)
    ball: int | None = None
    held: int | None = None


class Reference:
    """The model of a tree."""

    def __init__(self, tree: Tree) -> None:
        self.tree, self.model = tree, pin.Model()
        self.model.gravity.linear = tree.gravity
        self.placed = [Placed(0, 0) for _ in tree.branches]
        self._grow(GROUND)
        self.data = self.model.createData()

    def _grow(self, parent: int) -> None:
        """Add what a body carries, each child with all of its own before the next: crba needs joints in this order."""
        for i, b in enumerate(self.tree.branches):
            if b.parent == parent:
                self.placed[i] = self._add(i, b)
                self._grow(i)

    def _add(self, i: int, b: Branch) -> Placed:
        parent = 0 if b.parent == GROUND else self.placed[b.parent].last
        drawn = pin.SE3.Identity() if b.parent == GROUND else _drawn(self.tree.branches[b.parent])
        place, made = drawn.inverse() * _drawn(b), Placed(0, 0)
        steps: list[tuple[str, Any]] = [(str(n), _joint(kind, axis)) for n, (_, kind, axis) in enumerate(b.of.steps)]
        steps += [("ball", pin.JointModelSpherical())] if b.of.rotates else []
        steps = steps or [("held", pin.JointModelRZ())]
        for name, joint in steps[:: b.sign]:
            parent = self.model.addJoint(parent, joint, place, f"{i} {name}")
            place = pin.SE3.Identity()
            if name in ("ball", "held"):
                setattr(made, name, parent)
            else:
                made.steps.append(parent)
        made.steps = made.steps[:: b.sign]
        made.last = parent
        body = _drawn(b).inverse() * pin.SE3(b.rotation, b.centre)
        inertia = np.zeros((3, 3)) if b.inertia is None else b.inertia
        self.model.appendBodyToJoint(parent, pin.Inertia(b.mass, np.zeros(3), inertia), body)
        made.frame = self.model.addFrame(pin.Frame(f"body {i}", parent, 0, body, pin.FrameType.OP_FRAME))
        return made

    def answer(self, state: State) -> Answer:
        """Accelerations and forces in a state."""
        q, v = self._coordinates(state)
        pin.forwardKinematics(self.model, self.data, q, v)
        pin.updateFramePlacements(self.model, self.data)
        tau, outside = self._on_coordinates(state), self._outside(state)
        held, second = self._prescribed(state)
        M = pin.crba(self.model, self.data, q)
        M = np.triu(M) + np.triu(M, 1).T
        bias = pin.rnea(self.model, self.data, q, v, np.zeros(self.model.nv), outside)
        a, free = second, ~held
        a[free] = np.linalg.solve(M[np.ix_(free, free)], (tau - bias - M @ second)[free])
        total = pin.rnea(self.model, self.data, q, v, a, outside).copy()
        forces = [f.copy() for f in self.data.f]
        pin.forwardKinematics(self.model, self.data, q, v, a)
        pin.updateFramePlacements(self.model, self.data)
        return self._answer(a, total - tau, forces)

    def _coordinates(self, state: State) -> tuple[Array, Array]:
        q, v = pin.neutral(self.model), np.zeros(self.model.nv)
        for i, (b, made) in enumerate(zip(self.tree.branches, self.placed, strict=True)):
            for joint, value, rate in zip(made.steps, state.values[i], state.rates[i], strict=True):
                q[self.model.joints[joint].idx_q], v[self.model.joints[joint].idx_v] = b.sign * value, b.sign * rate
            if made.ball is not None:
                ball = self.model.joints[made.ball]
                turn = state.rotations[i] if b.sign > 0 else state.rotations[i].T
                q[ball.idx_q : ball.idx_q + 4] = Rotation.from_matrix(turn).as_quat()
                v[ball.idx_v : ball.idx_v + 3] = state.spins[i]
        return q, v

    def _on_coordinates(self, state: State) -> Array:
        """Springs, dampers and loads of coordinates."""
        tau = np.zeros(self.model.nv)
        for i, (b, made) in enumerate(zip(self.tree.branches, self.placed, strict=True)):
            for n, joint in enumerate(made.steps):
                force = b.load[n] - b.spring[n] * state.values[i][n] - b.damper[n] * state.rates[i][n]
                tau[self.model.joints[joint].idx_v] = b.sign * force
        return tau

    def _prescribed(self, state: State) -> tuple[Array, Array]:
        """Which accelerations are given, and their values."""
        held, second = np.zeros(self.model.nv, dtype=bool), np.zeros(self.model.nv)
        for b, made in zip(self.tree.branches, self.placed, strict=True):
            joints = [(made.steps[n], b.sign * DRIVE(state.t)[2]) for n in b.driven]
            for joint, value in [*joints, *([(made.held, 0.0)] if made.held is not None else [])]:
                at = self.model.joints[joint].idx_v
                held[at], second[at] = True, value
        return held, second

    def _outside(self, state: State) -> Any:
        """Forces of point springs and loads on the joint of every body, in its axes."""
        total, tree = [pin.Force.Zero() for _ in self.tree.branches], self.tree

        def act(body: int, force: Array, point: Array, torque: Array | float = 0.0) -> None:
            if body != GROUND:
                total[body] += pin.Force(force, np.cross(point, force) + torque)

        for s in tree.springs:
            (rk, vk), (rl, vl) = self._point(s.k, s.at_k), self._point(s.l, s.at_l)
            size = np.linalg.norm(rl - rk)
            e = (rl - rk) / size
            pull = -(s.stiffness * (size - s.length) + s.damping * (e @ (vl - vk))) * e
            act(s.l, pull, rl)
            act(s.k, -pull, rk)
        if tree.pushed is not None:
            body, at = tree.pushed
            act(body, np.array([w(state.t)[0] for w in FORCE]) * self._in_plane(), self._point(body, at)[0])
        if tree.twisted is not None:
            R = self.data.oMf[self.placed[tree.twisted].frame].rotation
            torque = np.array([w(state.t)[0] for w in TORQUE]) * (1 - self._in_plane() if tree.flat else 1)
            act(tree.twisted, np.zeros(3), np.zeros(3), R @ torque)
        found = pin.StdVec_Force()
        found.extend([pin.Force.Zero() for _ in range(self.model.njoints)])
        for made, force in zip(self.placed, total, strict=True):
            found[made.last] = self.data.oMi[made.last].actInv(force)
        return found

    def _in_plane(self) -> Array:
        return np.array([1.0, 1.0, 0.0 if self.tree.flat else 1.0])

    def _point(self, body: int, drawn: Array) -> tuple[Array, Array]:
        """Place and velocity of a point of a body."""
        if body == GROUND:
            return drawn, np.zeros(3)
        b, frame = self.tree.branches[body], self.placed[body].frame
        place = self.data.oMf[frame]
        u = pin.getFrameVelocity(self.model, self.data, frame, pin.LOCAL_WORLD_ALIGNED)
        arm = place.rotation @ b.rotation.T @ (drawn - b.centre)
        return place.translation + arm, u.linear + np.cross(u.angular, arm)

    def _answer(self, a: Array, drives: Array, forces: list[Any]) -> Answer:
        n = len(self.placed)
        out = Answer(*(np.zeros((n, *size)) for size in ((3,), (3, 3), (3,), (3,), (6,), (6,))), [])
        for i, (b, made) in enumerate(zip(self.tree.branches, self.placed, strict=True)):
            place, ask = self.data.oMf[made.frame], (self.model, self.data, made.frame, pin.LOCAL_WORLD_ALIGNED)
            u, second = pin.getFrameVelocity(*ask), pin.getFrameClassicalAcceleration(*ask)
            out.r[i], out.R[i], out.v[i], out.w[i] = place.translation, place.rotation, u.linear, u.angular
            out.a[i] = np.r_[second.linear, second.angular]
            on_body = self.data.oMi[made.last].act(forces[made.last])
            point = self._point(i if b.outer == "l" else b.parent, b.at)[0]
            out.wrench[i] = b.sign * np.r_[on_body.linear, on_body.angular - np.cross(point, on_body.linear)]
            at = [self.model.joints[joint].idx_v for joint in made.steps]
            out.second.append(b.sign * a[at])
            out.drives |= {(i, k): b.sign * drives[at[k]] for k in b.driven}
        return out


def _drawn(b: Branch) -> Any:
    """Where the joint of a branch is drawn."""
    return pin.SE3(b.axes, b.at)


def _joint(kind: str, axis: int) -> Any:
    return pin.JointModelHZ(LEAD / (2 * np.pi)) if kind == "screw" else JOINTS[kind, axis]()
