"""Joint-space dynamics against kinematics alone, Pinocchio and MuJoCo, and files that are written and read back."""

from __future__ import annotations

import tempfile
import warnings
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from robots.own import Chain
from runner import Case, Claim, Found

import mbdae as mb

claim = Claim("robots", "mass matrices, inverse and forward dynamics and Jacobians of trees are those of other programs, and "
              "what is written as MJCF is the same mechanism", 1e-10, "of the largest entry",
              "kinematics with complex steps; Pinocchio and MuJoCo where they are installed, on robots that packages of the "
              "registry carry")
STATES = 20
URDF = {"ur5": "ur_description/urdf/ur5_robot.urdf", "panda": "panda_description/urdf/panda.urdf",
        "bolt": "bolt_description/robots/bolt.urdf", "anymal": "anymal_b_simple_description/robots/anymal.urdf",
        "go1": "go1_description/urdf/go1.urdf", "hyq": "hyq_description/robots/hyq_no_sensors.urdf",
        "z1": "z1_description/urdf/z1.urdf", "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
        "talos": "talos_data/robots/talos_reduced.urdf"}
FLOATING = ("bolt", "anymal", "talos", "go1", "hyq")
MIMICS = {"panda_finger_joint2": "panda_finger_joint1"}  #: joints that turn with others, which Pinocchio keeps apart
MJCF = {"humanoid": "gymnasium/envs/mujoco/assets/humanoid.xml", "ant": "gymnasium/envs/mujoco/assets/ant.xml",
        "hopper": "gymnasium/envs/mujoco/assets/hopper.xml", "walker": "dm_control/suite/walker.xml"}


def off(a: Any, b: Any) -> float:
    """Largest difference over the largest entry."""
    return float(np.max(np.abs(a - b)) / max(np.max(np.abs(b)), 1e-12))


def chain(seed: int) -> list[Found]:
    """A chain of revolute and prismatic joints about any axes against `own`."""
    own, rng = Chain(seed), np.random.default_rng(seed)
    s = mb.Scene("chain", gravity=tuple(own.g))
    k = s.ground
    for i, slides in enumerate(own.slides):
        body = s.rigid_body(f"b{i}", own.masses[i], own.J[i], at=own.centres[i])
        s.joint(mb.Prismatic if slides else mb.Revolute, f"J{i}", k, body, at=own.at[i], axis=own.axes[i], rotor=own.rotors[i])
        k = body
    tree, worst = s.tree(), np.zeros(3)
    for _ in range(STATES):
        q, v = rng.normal(size=(2, tree.nv))
        M, X = own.mass(q)
        worst = np.maximum(worst, (off(tree.mass_matrix(q), M), off(tree.bias(q, v), own.bias(q, v)),
                                   off(tree.jacobian(k.name, q)[:3], X[-1])))
    return [Found(worst[0], quantity="M"), Found(worst[1], 1e-8, quantity="bias, by differences"),
            Found(worst[2], quantity="Jacobian")]


def place(package: str, *inside: str) -> Path | None:
    """A folder or file of an installed package."""
    spec = find_spec(package)
    found = Path(spec.submodule_search_locations[0]).joinpath(*inside) if spec and spec.submodule_search_locations else None
    return found if found is not None and found.exists() else None


def robot(name: str) -> Any:
    """The scene of a robot, and its file."""
    if name in URDF:
        file = (place("pinocchio") or place("yourdfpy") or Path()).parent / "none"
        data = next(up for up in file.parents if (up / "cmeel.prefix").is_dir() or up.name == "cmeel.prefix")
        file = (data if data.name == "cmeel.prefix" else data / "cmeel.prefix") / "share/example-robot-data/robots" / URDF[name]
        return mb.read_urdf(file, floating=name in FLOATING, limits=False, meshes=False, keep_inertias=True), file
    file = place(*MJCF[name].split("/", 1))
    return mb.read_mjcf(file, limits=False, keep_inertias=True), file


def against_pinocchio(name: str) -> list[Found]:
    """M and inverse dynamics at random states of a robot on a fixed base (a floating one has the rows of its base apart)."""
    import pinocchio as pin

    s, file = robot(name)
    tree, rng = s.tree(), np.random.default_rng(1)
    base = (pin.JointModelFreeFlyer(),) if name in FLOATING else ()
    model = pin.buildModelFromUrdf(str(file), *base)
    model.gravity.linear = np.array([0, 0, -9.81])
    data, worst = model.createData(), np.zeros(3)
    T, first = np.zeros((model.nv, tree.nv)), 6 if base else 0  # velocities of Pinocchio by those of the tree
    for i in range(2 if base else 1, model.njoints):
        joint = MIMICS.get(model.names[i], model.names[i])
        T[model.joints[i].idx_v, first + tree.names.index(joint) - (1 if base else 0)] = 1.0
    for _ in range(STATES):
        mine, u, w = tree.zero + 0.0, *rng.normal(size=(2, tree.nv))
        angles = rng.uniform(-1, 1, size=tree.nv - first)
        mine[len(mine) - len(angles):] = angles
        q = pin.neutral(model)
        for i in range(2 if base else 1, model.njoints):
            turned = float(T[model.joints[i].idx_v, first:] @ angles)
            at = model.joints[i].idx_q
            q[at:at + model.joints[i].nq] = turned if model.joints[i].nq == 1 else (np.cos(turned), np.sin(turned))
        a = w + 0.0
        if base:  # Pinocchio's base moves along its own axes
            turned = rng.normal(size=4)
            mine[:3], mine[3:7] = rng.normal(size=3), turned / np.linalg.norm(turned)
            q[:3], q[3:7] = mine[:3], mine[[4, 5, 6, 3]]
            R = pin.Quaternion(q[3:7]).toRotationMatrix()
            T[:3, :3], T[3:6, 3:6] = R.T, np.eye(3)
            a[:3] -= np.cross(R @ u[3:6], u[:3])
        v, a = T @ u, T @ a
        M = pin.crba(model, data, q)
        tau = T.T @ pin.rnea(model, data, q, v, a)
        worst = np.maximum(worst, (off(tree.mass_matrix(mine), T.T @ (np.triu(M) + np.triu(M, 1).T) @ T),
                                   off(tree.inverse_dynamics(mine, u, w), tau), off(tree.forward_dynamics(mine, u, tau), w)))
    return [Found(x, 1e-8 if what == "forward dynamics" else None, quantity=what)
            for x, what in zip(worst, ("M", "inverse dynamics", "forward dynamics"), strict=True)]


def against_mujoco(name: str) -> Found:
    """Accelerations at random states, without limits, friction, equalities, contacts, springs and dampers."""
    import mujoco

    s, file = robot(name)
    tree, rng, worst = s.tree(), np.random.default_rng(3), 0.0
    model = mujoco.MjModel.from_xml_path(str(file))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    floats = tree.nq > tree.nv
    for _ in range(STATES):
        mujoco.mj_resetData(model, data)
        q, v = tree.zero + 0.0, rng.normal(size=tree.nv)
        scalar = slice(7, None) if floats else slice(None)
        q[scalar] = rng.normal(size=len(q[scalar]))
        data.qpos[scalar] += q[scalar]
        data.qvel[:] = v
        mujoco.mj_forward(model, data)
        worst = max(worst, off(tree.forward_dynamics(q, v, data.qfrc_passive.copy()), data.qacc))
    return Found(worst, 1e-9)


def written(name: str) -> Found:
    """M and bias of a robot that is written and read back; the writing compares them too."""
    s, _ = robot(name)
    with tempfile.TemporaryDirectory() as folder:
        s.write_mjcf(Path(folder) / "out.xml")
        again, tree = mb.read_mjcf(Path(folder) / "out.xml", limits=False, keep_inertias=True).tree(), s.tree()
    rng, worst = np.random.default_rng(2), 0.0
    for _ in range(STATES):
        q, v = tree.zero + 0.0, rng.normal(size=tree.nv)
        scalar = slice(7, None) if tree.nq > tree.nv else slice(None)
        q[scalar] = rng.normal(size=len(q[scalar]))
        worst = max(worst, off(again.mass_matrix(q), tree.mass_matrix(q)), off(again.bias(q, v), tree.bias(q, v)))
    return Found(worst, 1e-9)


def quiet(measure: Any, *args: Any) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        return measure(*args)


def cases() -> list[Case]:
    """Robots where the packages that carry and judge them are installed; chains everywhere."""
    found = [Case(f"chain {seed}", "tree", partial(chain, seed), slow=seed > 1) for seed in range(10)]
    if place("pinocchio") is not None and place("yourdfpy") is not None:
        found += [Case(name, "Pinocchio", partial(quiet, against_pinocchio, name), slow=True) for name in URDF]
    if place("mujoco") is not None and place("gymnasium") is not None and place("dm_control") is not None:
        found += [Case(name, way, partial(quiet, measure, name), slow=True) for name in MJCF
                  for way, measure in (("MuJoCo", against_mujoco), ("written as MJCF", written))]
    return found
