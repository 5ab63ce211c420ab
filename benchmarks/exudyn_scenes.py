"""The scenes of benchmarks/peer.py in exudyn, to be run by an interpreter that has it: one run per method and step size.

    <python with exudyn> exudyn_scenes.py '{"scene": "planar chain", "options": {...}, "t_end": 1.0, "methods": [...], "output": "out.json"}'

A method is {"name": "generalised-alpha" | "kinematic tree" | ..., "steps": [s, ...] or "tolerances": [...]}. Writes for every run
CPU s (one thread, process time, the solver alone, the smallest of some repeats) and the centres of mass at exudyn's own times.
"""  # noqa: E501

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.advancedUtilities import CreateSymbolicUserFunction
from exudyn.itemInterface import (
    LoadForceVector,
    LoadMassProportional,
    LoadTorqueVector,
    MarkerBodyMass,
    MarkerBodyPosition,
    MarkerBodyRigid,
    MarkerNodeRigid,
    NodeGenericODE2,
    NodeRigidBody2D,
    NodeRigidBodyEP,
    NodeRigidBodyRotVecLG,
    ObjectBeamGeometricallyExact2D,
    ObjectConnectorCartesianSpringDamper,
    ObjectConnectorSpringDamper,
    ObjectGround,
    ObjectJointGeneric,
    ObjectJointRevolute2D,
    ObjectJointSpherical,
    ObjectKinematicTree,
    ObjectRigidBody,
    ObjectRigidBody2D,
    SensorBody,
    SensorKinematicTree,
    SensorNode,
)
from exudyn.rigidBodyUtilities import RotationMatrix2EulerParameters, RotationMatrix2RotationVector

Built = tuple[Any, list[Any]]  #: the system and sensors of positions, one per body
GRAVITY = 9.81  # m/s^2


def position_of(mbs: Any, body: int, at: Any = (0, 0, 0)) -> Any:
    """A sensor of the position of a point of a body."""
    return mbs.AddSensor(SensorBody(bodyNumber=body, localPosition=list(at), storeInternal=True, writeToFile=False,
                                    outputVariableType=exu.OutputVariableType.Position))


# -- rigid bodies in the plane


class Planar:
    """Rigid bodies and hinges in the plane."""

    def __init__(self, container: Any) -> None:
        self.mbs = container.AddSystem()
        self.ground = self.mbs.AddObject(ObjectGround())
        self.sensors: list[Any] = []
        self.placed: dict[int, tuple[np.ndarray, np.ndarray]] = {self.ground: (np.zeros(2), np.eye(2))}

    def body(self, mass: float, inertia: float, at: Any, angle: float = 0.0, velocity: Any = (0, 0, 0), gravity: float = 0.0
             ) -> int:
        """A body with its centre of mass at a point; velocity (vx, vy, omega)."""
        node = self.mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[*at, angle], initialVelocities=list(velocity)))
        body = int(self.mbs.AddObject(ObjectRigidBody2D(physicsMass=mass, physicsInertia=inertia, nodeNumber=node)))
        c, s = np.cos(angle), np.sin(angle)
        self.placed[body] = np.array(at, dtype=float), np.array([[c, -s], [s, c]])
        if gravity:
            marker = self.mbs.AddMarker(MarkerBodyMass(bodyNumber=body))
            self.mbs.AddLoad(LoadMassProportional(markerNumber=marker, loadVector=[0, -gravity, 0]))
        self.sensors.append(position_of(self.mbs, body))
        return body

    def marker(self, body: int, at: Any, kind: Any = MarkerBodyPosition) -> int:
        """A marker of a body at a point of the drawing."""
        centre, axes = self.placed[body]
        local = axes.T @ (np.asarray(at, dtype=float) - centre)
        return int(self.mbs.AddMarker(kind(bodyNumber=body, localPosition=[*local, 0.0])))

    def hinge(self, k: int, l: int, at: Any) -> None:
        """A revolute joint at a point of the drawing."""
        self.mbs.AddObject(ObjectJointRevolute2D(markerNumbers=[self.marker(k, at), self.marker(l, at)]))

    def done(self) -> Built:
        """The assembled system."""
        self.mbs.Assemble()
        return self.mbs, self.sensors


def planar_chain(container: Any, p: dict[str, Any]) -> Built:
    """Rods released horizontally."""
    m, rod = Planar(container), p["length"]
    before = m.ground
    for i in range(p["n"]):
        body = m.body(p["mass"], p["mass"] * rod**2 / 12, ((i + 0.5) * rod, 0), gravity=GRAVITY)
        m.hinge(before, body, (i * rod, 0))
        before = body
    return m.done()


def planar_linkage(container: Any, p: dict[str, Any]) -> Built:
    """Bodies, hinges between them, springs and torques, as data (Andrews' mechanism)."""
    m = Planar(container)
    bodies = [m.body(b["mass"], b["inertia"], b["at"], b["angle"], gravity=p.get("gravity", 0.0)) for b in p["bodies"]]
    at = {-1: m.ground} | dict(enumerate(bodies))
    for k, l, point in p["hinges"]:
        m.hinge(at[k], at[l], point)
    for s in p["springs"]:
        ends = [m.marker(at[s["k"]], s["at_k"]), m.marker(at[s["l"]], s["at_l"])]
        m.mbs.AddObject(ObjectConnectorSpringDamper(markerNumbers=ends, stiffness=s["stiffness"], referenceLength=s["length"]))
    for body, torque in p["torques"]:
        marker = m.mbs.AddMarker(MarkerBodyRigid(bodyNumber=at[body]))
        m.mbs.AddLoad(LoadTorqueVector(markerNumber=marker, loadVector=[0, 0, torque]))
    return m.done()


def ground_resonance(container: Any, p: dict[str, Any]) -> Built:
    """Four blades on a hub that turns freely; block and hub are one body, because neither has forces of rotation."""
    m, w = Planar(container), p["omega"]
    hub = m.body(p["block"], p["inertia"], (0, 0), velocity=(0, 0, w))
    ends = [m.marker(m.ground, (0, 0)), m.marker(hub, (0, 0))]
    m.mbs.AddObject(ObjectConnectorCartesianSpringDamper(markerNumbers=ends, stiffness=[p["stiffness"]] * 2 + [0],
                                                         damping=[p["damping"]] * 2 + [0]))
    for i in range(4):
        root, tip = (np.array(end) for end in p["blades"][i])
        centre, d = (root + tip) / 2, tip - root
        blade = m.body(p["mass"], p["mass"] * float(d @ d) / 12, centre, float(np.arctan2(d[1], d[0])),
                       (-w * centre[1], w * centre[0], w))
        m.hinge(hub, blade, root)
    return m.done()


# -- rigid bodies in space


def spatial_body(mbs: Any, p: dict[str, Any], mass: float, inertia: Any, at: Any, spin: Any = (0, 0, 0), velocity: Any = (0, 0, 0)
                 ) -> int:
    """A rigid body drawn in the axes of the ground: Euler parameters, or rotation vectors (Lie group)."""
    if p.get("rotation") == "lie group":
        node = mbs.AddNode(NodeRigidBodyRotVecLG(referenceCoordinates=[*at, *RotationMatrix2RotationVector(np.eye(3))],
                                                 initialVelocities=[*velocity, *spin]))
    else:
        quaternion = RotationMatrix2EulerParameters(np.eye(3))
        rates = [0.0, *(np.asarray(spin) / 2)]
        node = mbs.AddNode(NodeRigidBodyEP(referenceCoordinates=[*at, *quaternion], initialVelocities=[*velocity, *rates]))
    return int(mbs.AddObject(ObjectRigidBody(physicsMass=mass, physicsInertia=[*np.diag(inertia), 0, 0, 0], nodeNumber=node)))


def falls(mbs: Any, body: int) -> None:
    """Gravity along -z on a body."""
    marker = mbs.AddMarker(MarkerBodyMass(bodyNumber=body))
    mbs.AddLoad(LoadMassProportional(markerNumber=marker, loadVector=[0, 0, -GRAVITY]))


def axes_with_z(axis: Any) -> np.ndarray:
    """A rotation matrix whose third column is an axis."""
    z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    x = np.cross([0, 1, 0] if abs(z[1]) < 0.9 else [1, 0, 0], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def rod_inertia(mass: float, length: float) -> np.ndarray:
    """Of a slender rod along x, kg m^2."""
    return np.diag([0.0, 1.0, 1.0]) * mass * length**2 / 12


def spatial_chain(container: Any, p: dict[str, Any]) -> Built:
    """Rods with alternating axes, released horizontally; gravity along -z."""
    mbs, rod = container.AddSystem(), p["length"]
    ground = mbs.AddObject(ObjectGround())
    before, at_before, sensors = ground, [0.0, 0, 0], []
    for i in range(p["n"]):
        body = spatial_body(mbs, p, p["mass"], rod_inertia(p["mass"], rod), ((i + 0.5) * rod, 0, 0))
        falls(mbs, body)
        ends = [mbs.AddMarker(MarkerBodyRigid(bodyNumber=before, localPosition=at_before)),
                mbs.AddMarker(MarkerBodyRigid(bodyNumber=body, localPosition=[-rod / 2, 0, 0]))]
        A = axes_with_z(p["axes"][i % len(p["axes"])])
        mbs.AddObject(ObjectJointGeneric(markerNumbers=ends, constrainedAxes=[1, 1, 1, 1, 1, 0],
                                         rotationMarker0=A, rotationMarker1=A))
        sensors.append(position_of(mbs, body))
        before, at_before = body, [rod / 2, 0, 0]
    mbs.Assemble()
    return mbs, sensors


def heavy_top(container: Any, p: dict[str, Any]) -> Built:
    """A body with a fixed point."""
    mbs = container.AddSystem()
    ground = mbs.AddObject(ObjectGround())
    body = spatial_body(mbs, p, p["mass"], np.diag(p["inertia"]), p["at"], p["spin"], np.cross(p["spin"], p["at"]))
    falls(mbs, body)
    ends = [mbs.AddMarker(MarkerBodyPosition(bodyNumber=ground)),
            mbs.AddMarker(MarkerBodyPosition(bodyNumber=body, localPosition=[-x for x in p["at"]]))]
    mbs.AddObject(ObjectJointSpherical(markerNumbers=ends))
    sensors = [position_of(mbs, body)]
    mbs.Assemble()
    return mbs, sensors


def tree(container: Any, axes: list[Any], steps: list[Any], links: list[tuple[float, Any, Any]], gravity: Any, rates: list[float]
         ) -> Built:
    """A chain of revolute joints in minimal coordinates: axes, steps from joint to joint, (mass, inertia, centre) of the links,
    all in the axes of the drawing; a sensor at the centre of every link with mass."""
    mbs, n = container.AddSystem(), len(axes)
    node = mbs.AddNode(NodeGenericODE2(referenceCoordinates=[0.0] * n, initialCoordinates=[0.0] * n, initialCoordinates_t=rates,
                                       numberOfODE2Coordinates=n))
    turned = [axes_with_z(axis) for axis in axes]
    before = [np.eye(3), *turned[:-1]]
    centres = [A.T @ np.asarray(c, dtype=float) for A, (_, _, c) in zip(turned, links, strict=True)]
    body = mbs.AddObject(ObjectKinematicTree(
        nodeNumber=node, jointTypes=[exu.JointType.RevoluteZ] * n, linkParents=[i - 1 for i in range(n)],
        jointTransformations=exu.Matrix3DList([B.T @ A for A, B in zip(turned, before, strict=True)]),
        jointOffsets=exu.Vector3DList([B.T @ np.asarray(d, dtype=float) for B, d in zip(before, steps, strict=True)]),
        linkInertiasCOM=exu.Matrix3DList([A.T @ J @ A for A, (_, J, _) in zip(turned, links, strict=True)]),
        linkCOMs=exu.Vector3DList(centres), linkMasses=[m for m, _, _ in links], gravity=gravity))
    kind = exu.OutputVariableType.Position
    sensors = [mbs.AddSensor(SensorKinematicTree(objectNumber=body, linkNumber=i, localPosition=list(centres[i]),
                                                 storeInternal=True, writeToFile=False, outputVariableType=kind))
               for i in range(n) if links[i][0]]
    mbs.Assemble()
    return mbs, sensors


def chain_tree(container: Any, p: dict[str, Any]) -> Built:
    """The planar or spatial chain in minimal coordinates."""
    n, rod, mass = p["n"], p["length"], p["mass"]
    axes = [p["axes"][i % len(p["axes"])] if "axes" in p else (0, 0, 1) for i in range(n)]
    steps = [(0, 0, 0)] + [(rod, 0, 0)] * (n - 1)
    link = (mass, rod_inertia(mass, rod), (rod / 2, 0, 0))
    gravity = [0, 0, -GRAVITY] if "axes" in p else [0, -GRAVITY, 0]
    return tree(container, axes, steps, [link] * n, gravity, [0.0] * n)


def top_tree(container: Any, p: dict[str, Any]) -> Built:
    """The heavy top on three hinges in one point, the last about its spin; singular where its axis lies along x, where it never
    comes (the vertical it does pass)."""
    nothing = (0.0, np.zeros((3, 3)), (0, 0, 0))
    links = [nothing, nothing, (p["mass"], np.diag(p["inertia"]), p["at"])]
    rates = [p["spin"][i] for i in (0, 2, 1)]
    return tree(container, [(1, 0, 0), (0, 0, 1), (0, 1, 0)], [(0, 0, 0)] * 3, links, [0, 0, -GRAVITY], rates)


# -- a flexible beam


def flying_beam(container: Any, p: dict[str, Any]) -> Built:
    """A free beam of linear elements along x with a force and a torque, smooth pulses, at its first end."""
    mbs, n, s = container.AddSystem(), p["n"], p["section"]
    h = p["length"] / n
    nodes = [mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[i * h, 0, 0])) for i in range(n + 1)]
    for i in range(n):
        mbs.AddObject(ObjectBeamGeometricallyExact2D(
            nodeNumbers=nodes[i : i + 2], physicsLength=h, physicsMassPerLength=s["mass_per_length"],
            physicsCrossSectionInertia=s["rotary_inertia"], physicsBendingStiffness=s["EI"], physicsAxialStiffness=s["EA"],
            physicsShearStiffness=s["GA"]))
    marker = mbs.AddMarker(MarkerNodeRigid(nodeNumber=nodes[0]))
    force = mbs.AddLoad(LoadForceVector(markerNumber=marker, loadVector=[p["force"], 0, 0]))
    torque = mbs.AddLoad(LoadTorqueVector(markerNumber=marker, loadVector=[0, 0, p["torque"]]))
    esym, span = exu.symbolic, p["pulse"]

    def pulse(mbs: Any, t: Any, load: Any) -> Any:
        on = esym.IfThenElse(t < span, esym.sin(np.pi * t / span), esym.Real(0))
        square = on * on
        return square * square * load

    for load in (force, torque):
        function = CreateSymbolicUserFunction(mbs, pulse, "loadVectorUserFunction", load)
        mbs.SetLoadParameter(load, "loadVectorUserFunction", function)
    kind = exu.OutputVariableType.Position
    sensors = [mbs.AddSensor(SensorNode(nodeNumber=i, storeInternal=True, writeToFile=False, outputVariableType=kind))
               for i in nodes]
    mbs.Assemble()
    return mbs, sensors


SCENES: dict[str, Callable[[Any, dict[str, Any]], Built]] = {
    "planar chain": planar_chain, "spatial chain": spatial_chain, "linkage": planar_linkage, "ground resonance": ground_resonance,
    "heavy top": heavy_top, "chain tree": chain_tree, "top tree": top_tree, "flying beam": flying_beam}


def run(p: dict[str, Any], method: dict[str, Any], value: float) -> dict[str, Any]:
    """CPU s and motion of one run."""
    seconds, stored = [], []
    while len(seconds) < (2 if not seconds or min(seconds) > 0.1 else 5):
        container = exu.SystemContainer()
        mbs, sensors = SCENES[method.get("scene", p["scene"])](container, p["options"] | method.get("options", {}))
        settings = exu.SimulationSettings()
        t = settings.timeIntegration
        t.endTime, t.verboseMode = p["t_end"], 0
        settings.parallel.numberOfThreads = 1
        settings.solutionSettings.writeSolutionToFile = False
        settings.linearSolverType = getattr(exu.LinearSolverType, method.get("linear", "EXUdense"))
        if "tolerances" in method:
            t.numberOfSteps, t.absoluteTolerance, t.relativeTolerance = 10, value, value
            settings.solutionSettings.sensorsWritePeriod = p["t_end"] / 10
        else:
            t.numberOfSteps = max(round(p["t_end"] / value), 1)
            settings.solutionSettings.sensorsWritePeriod = max(p["t_end"] / t.numberOfSteps, p["t_end"] / 100)
            t.generalizedAlpha.spectralRadius = method.get("radius", 0.8)
            t.generalizedAlpha.useIndex2Constraints = method.get("index 2", False)
            t.newton.useModifiedNewton = method.get("modified", True)
        begin = time.process_time()
        try:
            mbs.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, method.get("solver", "GeneralizedAlpha")))
        except Exception as error:
            return {"value": value, "cpu_s": time.process_time() - begin, "failed": str(error)[:200]}
        seconds.append(time.process_time() - begin)
        stored = [np.array(mbs.GetSensorStoredData(sensor)) for sensor in sensors]
        if seconds[-1] > 0.3:
            break
    positions = [d[:, 1:4].tolist() for d in stored]
    return {"value": value, "cpu_s": min(seconds), "t": stored[0][:, 0].tolist(), "positions": positions}


def ladder(p: dict[str, Any], method: dict[str, Any]) -> list[dict[str, Any]]:
    """Runs of a method from loose to tight, until one takes longer than asked."""
    runs = []
    for value in method.get("steps", method.get("tolerances")):
        runs.append(run(p, method, value))
        if runs[-1]["cpu_s"] > p["longest"]:
            break
    return runs


if __name__ == "__main__":
    given = sys.argv[1]  # or @ and the name of a file: a command line has no room for large scenes
    problem = json.loads(Path(given[1:]).read_text() if given.startswith("@") else given)
    found = [{"method": m["name"], "runs": ladder(problem, m)} for m in problem["methods"]]
    Path(problem["output"]).write_text(json.dumps({"version": exu.__version__, "methods": found}))
