"""Robots that packages of the registry carry, beside Pinocchio and MuJoCo: dynamics at random states, and runs."""

from __future__ import annotations

import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from runner import Found

import mbdae as mb

STATES = 100
AT = np.array([0.1, -0.2, 0.3])  #: point of a link, in its axes, whose Jacobian is compared
END, TIMES = 0.5, 6  #: s, and instants of runs
URDF = {"ur5": "ur_description/urdf/ur5_robot.urdf", "panda": "panda_description/urdf/panda.urdf",
        "bolt": "bolt_description/robots/bolt.urdf", "anymal": "anymal_b_simple_description/robots/anymal.urdf",
        "go1": "go1_description/urdf/go1.urdf", "hyq": "hyq_description/robots/hyq_no_sensors.urdf",
        "z1": "z1_description/urdf/z1.urdf", "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
        "talos": "talos_data/robots/talos_reduced.urdf"}
FLOATING = ("bolt", "anymal", "talos", "go1", "hyq")
#: joints that move with others, which Pinocchio keeps apart: of which one, by which factor and offset
MIMICS = {"panda_finger_joint2": ("panda_finger_joint1", 1.0, 0.0)}
MJCF = {"humanoid": "gymnasium/envs/mujoco/assets/humanoid.xml", "ant": "gymnasium/envs/mujoco/assets/ant.xml",
        "hopper": "gymnasium/envs/mujoco/assets/hopper.xml", "walker": "dm_control/suite/walker.xml",
        "cheetah": "gymnasium/envs/mujoco/assets/half_cheetah.xml", "cmu": "dm_control/suite/humanoid_CMU.xml"}


def off(a: Any, b: Any, least: float = 1e-12) -> float:
    """Largest difference over the largest entry, or over `least` where that is larger."""
    return float(np.max(np.abs(a - b)) / max(np.max(np.abs(b)), least))


def place(package: str, *inside: str) -> Path | None:
    """A folder or file of an installed package."""
    spec = find_spec(package)
    found = Path(spec.submodule_search_locations[0]).joinpath(*inside) if spec and spec.submodule_search_locations else None
    return found if found is not None and found.exists() else None


def descriptions() -> Path | None:
    """The folder of the robots that example-robot-data carries; its packages share one folder beside Pinocchio's."""
    ups = (place("pinocchio") or Path()).parents
    folders = [up / inside / "share/example-robot-data/robots" for up in ups for inside in ("", "cmeel.prefix")]
    return next((folder for folder in folders if folder.is_dir()), None)


def robot(name: str) -> Any:
    """The scene of a robot, and its file."""
    if name in URDF:
        file = (descriptions() or Path()) / URDF[name]
        return mb.read_urdf(file, floating=name in FLOATING, limits=False, meshes=False, keep_inertias=True), file
    file = place(*MJCF[name].split("/", 1))
    return mb.read_mjcf(file, limits=False, keep_inertias=True), file


class Beside:
    """The tree of a robot and Pinocchio's model of the same file: velocities of this one are T times those of the tree."""

    def __init__(self, s: Any, file: Path, floats: bool, mimics: dict[str, tuple[str, float, float]]) -> None:
        import pinocchio as pin

        self.pin, self.tree, self.floats, self.mimics = pin, s.tree(), floats, mimics
        self.model = model = pin.buildModelFromUrdf(str(file), *((pin.JointModelFreeFlyer(),) if self.floats else ()))
        model.gravity.linear = np.array([0, 0, -9.81])
        self.data, self.first = model.createData(), 6 if self.floats else 0
        self.own = range(2 if self.floats else 1, model.njoints)
        self.T = np.zeros((model.nv, self.tree.nv))
        for i in self.own:
            of, factor, _ = mimics.get(model.names[i], (model.names[i], 1.0, 0.0))
            number = self.tree.names.index(of) - (1 if self.floats else 0)
            self.T[model.joints[i].idx_v, self.first + number] = factor
        bodies = [f.name for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint > 0]
        moving = [name for name in bodies if name in self.tree.links]
        self.links = [moving[len(moving) // 2], moving[-1]]

    def state(self, rng: Any) -> tuple[Any, Any, Any]:
        """q, v, a of the tree, drawn."""
        tree, q = self.tree, self.tree.zero + 0.0
        q[tree.nq - (tree.nv - self.first) :] = rng.uniform(-1, 1, size=tree.nv - self.first)
        if self.floats:
            turned = rng.normal(size=4)
            q[:3], q[3:7] = rng.normal(size=3), turned / np.linalg.norm(turned)
        return q, *rng.normal(size=(2, tree.nv))

    def there(self, q: Any, u: Any, w: Any) -> tuple[Any, Any, Any, Any]:
        """The same state for Pinocchio, and the rate of T: its base moves along its own axes."""
        pin, T, rate = self.pin, self.T, np.zeros_like(self.T)
        other = pin.neutral(self.model)
        for i in self.own:
            joint, angles = self.model.joints[i], q[len(q) - len(u) + self.first :]
            angle = float(T[joint.idx_v, self.first :] @ angles) + self.mimics.get(self.model.names[i], ("", 1.0, 0.0))[2]
            other[joint.idx_q : joint.idx_q + joint.nq] = angle if joint.nq == 1 else (np.cos(angle), np.sin(angle))
        if self.floats:
            other[:3], other[3:7] = q[:3], q[[4, 5, 6, 3]]
            R = pin.Quaternion(other[3:7]).toRotationMatrix()
            T[:3, :3], T[3:6, 3:6] = R.T, np.eye(3)
            rate[:3, :3] = -pin.skew(u[3:6]) @ R.T
        return other, T @ u, T @ w + rate @ u, rate

    def frames(self, q: Any, u: Any, other: Any, v: Any, rate: Any) -> tuple[float, float]:
        """Differences of Jacobians and of their rates, of the origins of links and of points on them."""
        pin, worst, axes = self.pin, np.zeros(2), self.pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        pin.computeJointJacobiansTimeVariation(self.model, self.data, other, v)
        pin.updateFramePlacements(self.model, self.data)
        for link in self.links:
            frame = self.model.getFrameId(link, pin.FrameType.BODY)
            J0, dJ0 = (f(self.model, self.data, frame, axes) for f in (pin.getFrameJacobian, pin.getFrameJacobianTimeVariation))
            J0, dJ0 = J0.reshape(6, -1), dJ0.reshape(6, -1)  # of one joint Pinocchio returns vectors
            J, dJ = J0 @ self.T, dJ0 @ self.T + J0 @ rate
            for at in (np.zeros(3), AT):
                arm = pin.skew(self.data.oMf[frame].rotation @ at)
                turning = pin.skew(np.cross((J @ u)[3:], self.data.oMf[frame].rotation @ at))
                point, changed = J.copy(), dJ.copy()
                point[:3] -= arm @ J[3:]
                changed[:3] -= arm @ dJ[3:] + turning @ J[3:]
                worst = np.maximum(worst, (off(self.tree.jacobian(link, q, at), point),
                                           off(self.tree.jacobian_rate(link, q, u, at), changed, np.max(np.abs(point)))))
        return float(worst[0]), float(worst[1])


def against_pinocchio(name: str) -> list[Found]:
    """M, inverse and forward dynamics, Jacobians and their rates at random states of a robot."""
    return compared(Beside(*robot(name), name in FLOATING, MIMICS), STATES)


def compared(both: Beside, states: int) -> list[Found]:
    """The largest differences of a tree from Pinocchio's model."""
    tree, pin, T, rng, worst = both.tree, both.pin, both.T, np.random.default_rng(1), np.zeros(5)
    for _ in range(states):
        q, u, w = both.state(rng)
        other, v, a, rate = both.there(q, u, w)
        M = pin.crba(both.model, both.data, other)
        tau = T.T @ pin.rnea(both.model, both.data, other, v, a)
        found = (off(tree.mass_matrix(q), T.T @ (np.triu(M) + np.triu(M, 1).T) @ T), off(tree.inverse_dynamics(q, u, w), tau),
                 off(tree.forward_dynamics(q, u, tau), w), *both.frames(q, u, other, v, rate))
        worst = np.maximum(worst, found)
    names = ("M", "inverse dynamics", "forward dynamics", "Jacobians", "their rates")
    return [Found(x, quantity=what) for x, what in zip(worst, names, strict=True)]


def against_mujoco(name: str) -> Found:
    """Accelerations at random states, without limits, friction, equalities, contacts, springs and dampers."""
    import mujoco

    s, file = robot(name)
    tree, rng, worst = s.tree(), np.random.default_rng(3), 0.0
    model = mujoco.MjModel.from_xml_path(str(file))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data, floats, turn = mujoco.MjData(model), tree.nq > tree.nv, np.eye(tree.nv)
    if floats:  # MuJoCo's base turns along the axes of its frame, which may be drawn turned
        R = np.zeros(9)
        mujoco.mju_quat2Mat(R, model.qpos0[3:7])
        turn[3:6, 3:6] = R.reshape(3, 3)
    for _ in range(STATES):
        mujoco.mj_resetData(model, data)
        q, v = tree.zero + 0.0, rng.normal(size=tree.nv)
        scalar = slice(7, None) if floats else slice(None)
        q[scalar] = rng.normal(size=len(q[scalar]))
        data.qpos[scalar] += q[scalar]
        data.qvel[:] = turn.T @ v
        mujoco.mj_forward(model, data)
        worst = max(worst, off(tree.forward_dynamics(q, v, turn @ data.qfrc_passive), turn @ data.qacc))
    return Found(worst, 1e-9)


def run_beside_mujoco(name: str) -> Found:
    """Joint coordinates and the base's position of a run from a key frame at random speeds, against SciPy on MuJoCo's
    accelerations without limits, friction, equalities and contacts. The file is MuJoCo's own, with the key frame added."""
    import mujoco
    from scipy.integrate import solve_ivp

    spec, rng = mujoco.MjSpec.from_file(str(place(*MJCF[name].split("/", 1)))), np.random.default_rng(5)
    model = spec.compile()
    q = model.qpos0 + np.where(np.repeat(model.jnt_type >= 2, SIZES[model.jnt_type]), 0.3 * rng.normal(size=model.nq), 0)
    spec.add_key(name="thrown", qpos=q, qvel=rng.normal(size=model.nv))
    spec.compile()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "model.xml"
        file.write_text(spec.to_xml())
        s, model = mb.read_mjcf(file, limits=False, keep_inertias=True, key="thrown"), mujoco.MjModel.from_xml_path(str(file))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT) | int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    data, times, key = mujoco.MjData(model), np.linspace(0, END, TIMES), model.key("thrown")
    start = np.concatenate((key.qpos, key.qvel))

    def slope(_: float, y: Any) -> Any:
        data.qpos[:], data.qvel[:] = y[: model.nq], y[model.nq :]
        mujoco.mj_forward(model, data)
        v = data.qvel
        rates = [v[d : d + 1] if kind else np.concatenate((v[d : d + 3], turning(y[i + 3 : i + 7], v[d + 3 : d + 6])))
                 for kind, i, d in zip(model.jnt_type, model.jnt_qposadr, model.jnt_dofadr, strict=True)]
        return np.concatenate((*rates, data.qacc))

    found = solve_ivp(slope, (0, END), start, "DOP853", times, rtol=1e-11, atol=1e-11).y.T
    r, worst = s.simulate(END, accuracy=1e-8, outputs=times), 0.0
    for i, kind in enumerate(model.jnt_type):
        at, named = int(model.jnt_qposadr[i]), model.joint(i).name
        one = r[f"{named} joint" if named in {model.body(b).name for b in range(model.nbody)} else named] if kind else None
        if one is not None:
            mine, other = (one.angle if kind == 3 else one.displacement) + model.qpos0[at], found[:, at]
        else:
            body = int(model.jnt_bodyid[i])
            quat = found[:, at + 3 : at + 7] / np.linalg.norm(found[:, at + 3 : at + 7], axis=1)[:, None]
            mine = r[model.body(body).name].position
            other = found[:, at : at + 3] + np.array([rotated(p, model.body_ipos[body]) for p in quat])
        worst = max(worst, float(np.max(np.abs(mine - other))))
    return Found(worst, 1e-6, "m or rad")


SIZES = np.array([7, 4, 1, 1])  #: numbers of a joint in qpos, by its type


def turning(p: Any, w: Any) -> Any:
    """Rate of a quaternion (w, x, y, z) at an angular velocity in the moving axes."""
    return np.concatenate(([-p[1:] @ w], p[0] * w + np.cross(p[1:], w))) / 2


def rotated(p: Any, x: Any) -> Any:
    """A vector turned by a quaternion."""
    return x + 2 * np.cross(p[1:], np.cross(p[1:], x) + p[0] * x)
