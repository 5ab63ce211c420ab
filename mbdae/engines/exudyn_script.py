"""What the script of the engine Exudyn does, in an environment that has exudyn: its source is written into the script."""

from __future__ import annotations

from typing import Any


def exudyn_runs() -> Any:
    """The scene of `scene.json` in exudyn: its start, and runs."""
    import json
    import math

    import exudyn as exu
    import numpy as np
    from exudyn import itemInterface as items  # noqa: N813

    with open("scene.json", encoding="utf-8") as file:
        s = json.load(file)
    (t0, t_end), kinds = s["t"], exu.OutputVariableType
    quantities = [kinds.Position, kinds.RotationMatrix, kinds.Velocity, kinds.AngularVelocity]

    def of_time(text: str) -> Any:
        return eval(f"lambda t: {text}", {"math": math})

    def absolute(mbs: Any, lie: bool) -> list[Any]:
        kind = "NodeRigidBody2D" if s["planar"] else "NodeRigidBodyRotVecLG" if lie else "NodeRigidBodyEP"
        nodes = [mbs.AddNode(getattr(items, kind)(referenceCoordinates=at, initialVelocities=v))
                 for at, v in (b["nodes"][kind] for b in s["bodies"])]
        ground, bodies = mbs.AddObject(items.ObjectGround()), list[Any]()

        def falls(body: int, g: Any) -> None:
            if any(g):
                marker = mbs.AddMarker(items.MarkerBodyMass(bodyNumber=body))
                mbs.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=g))

        for b, node in zip(s["bodies"], nodes, strict=True):
            if s["planar"]:
                made = items.ObjectRigidBody2D(mass=b["mass"], inertia=b["inertia"][2], nodeNumber=node)
            else:
                made = items.ObjectRigidBody(mass=b["mass"], inertia=b["inertia"], nodeNumber=node)
            bodies.append(None if b["beam"] else mbs.AddObject(made))
            if not b["beam"]:
                falls(bodies[-1], b["gravity"])
        for beam in s["beams"]:
            for (i, j), length in zip(beam["elements"], beam["length"], strict=True):
                falls(mbs.AddObject(items.ObjectBeamGeometricallyExact2D(
                    nodeNumbers=[nodes[i], nodes[j]], length=length, massPerLength=beam["mass"],
                    crossSectionInertia=beam["rotary"], bendingStiffness=beam["EI"], axialStiffness=beam["EA"],
                    shearStiffness=beam["GA"])), beam["gravity"])

        def marker(side: dict[str, Any]) -> int:
            if side["body"] >= 0 and bodies[side["body"]] is None:
                return int(mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=nodes[side["body"]])))
            body = ground if side["body"] < 0 else bodies[side["body"]]
            return int(mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=side["point"])))

        for one in s["connectors"]:
            more = {name: np.array(value) if isinstance(value, list) else value for name, value in one["values"].items()}
            if one["offset"]:
                entry, value = one["offset"][0], of_time(one["offset"][1])

                def offset(mbs: Any, t: float, number: int, values: Any, entry: int = entry, value: Any = value) -> list[float]:
                    return [value(t) if i == entry else 0.0 for i in range(6)]

                more["offsetUserFunction"] = offset
            if "Torsional" in one["item"]:
                more["nodeNumber"] = mbs.AddNode(items.NodeGenericData(initialCoordinates=[0.0], numberOfDataCoordinates=1))
            mbs.AddObject(getattr(items, one["item"])(markerNumbers=[marker(one["k"]), marker(one["l"])], **more))
        for load in s["loads"]:
            if load["l"]["body"] < 0:
                continue
            parts = [of_time(text) for text in load["parts"]]
            kind = items.LoadTorqueVector if load["torque"] else items.LoadForceVector
            mbs.AddLoad(kind(markerNumber=marker(load["l"]), bodyFixed=load["follows"], loadVector=[p(t0) for p in parts],
                             loadVectorUserFunction=lambda mbs, t, vector, parts=parts: [p(t) for p in parts]))
        return [[mbs.AddSensor(items.SensorNode(nodeNumber=node, storeInternal=True, writeToFile=False, outputVariableType=kind))
                 for kind in quantities] for node in nodes]

    def tree(mbs: Any) -> list[Any]:
        links, lists = s["tree"]["links"], (exu.Matrix3DList, exu.Vector3DList)
        n = len(links)

        def of(name: str, kind: int) -> Any:
            return lists[kind]([np.array(link[name]) for link in links])

        node = mbs.AddNode(items.NodeGenericODE2(referenceCoordinates=[0.0] * n, initialCoordinates=[link["q"] for link in links],
                                              initialCoordinates_t=[link["v"] for link in links], numberOfODE2Coordinates=n))
        body = mbs.AddObject(items.ObjectKinematicTree(
            nodeNumber=node, jointTypes=[(exu.JointType.PrismaticZ, exu.JointType.RevoluteZ)[link["turns"]] for link in links],
            linkParents=[link["parent"] for link in links], jointTransformations=of("rotation", 0), jointOffsets=of("offset", 1),
            linkInertiasCOM=of("inertia", 0), linkCOMs=of("centre", 1), linkMasses=[link["mass"] for link in links],
            gravity=s["tree"]["gravity"], jointPControlVector=[link["stiffness"] for link in links],
            jointDControlVector=[link["damping"] for link in links], jointPositionOffsetVector=[link["rest"] for link in links],
            jointVelocityOffsetVector=[0.0] * n, jointForceVector=[link["load"] for link in links]))
        return [[mbs.AddSensor(items.SensorKinematicTree(
            objectNumber=body, linkNumber=i, localPosition=links[i]["centre"], storeInternal=True, writeToFile=False,
            outputVariableType=kind)) for kind in quantities] for i in s["tree"]["order"]]

    def motion(mbs: Any, sensors: list[Any], last: bool = False, R: Any = None) -> Any:
        """(nt, nodes, 13) from what the sensors stored, or from what they show now."""
        out = []
        for i, one in enumerate(sensors):
            r, A, v, w = (np.atleast_2d(mbs.GetSensorValues(x)) if last else mbs.GetSensorStoredData(x)[:, 1:] for x in one)
            A = np.reshape(A, (-1, 3, 3)) if R is None else np.reshape(A, (-1, 3, 3)) @ R[i]
            K = np.zeros((len(A), 4, 4))
            K[:, 0, 0] = np.trace(A, axis1=1, axis2=2)
            K[:, 1:, 1:] = A + A.transpose(0, 2, 1) - K[:, :1, :1] * np.eye(3)
            for row, (j, k) in enumerate(((2, 1), (0, 2), (1, 0)), 1):
                K[:, 0, row] = K[:, row, 0] = A[:, j, k] - A[:, k, j]
            out.append(np.hstack([r, np.linalg.eigh(K)[1][..., -1], v, w]))
        return np.stack(out, axis=1)

    def built(method: str) -> Any:
        mbs = exu.SystemContainer().AddSystem()
        own = method.startswith("tree")
        sensors = tree(mbs) if own else absolute(mbs, "Lie" in method)
        mbs.Assemble()
        return mbs, sensors, [np.array(s["tree"]["links"][i]["body"]) for i in s["tree"]["order"]] if own else None

    def start() -> dict[str, Any]:
        mbs, sensors, R = built("")
        masses = [math.nan if b["beam"] else b["mass"] for b in s["bodies"]]
        return {"motion": motion(mbs, sensors, True, R)[0], "mass": masses}

    def solve(method: str, setting: float) -> Any:
        mbs, sensors, R = built(method)
        settings = exu.SimulationSettings()
        time, out = settings.timeIntegration, settings.solutionSettings
        time.startTime, time.endTime, time.verboseMode = t0, t_end, 0
        out.writeSolutionToFile, settings.parallel.numberOfThreads = False, 1
        if len(s["bodies"]) > 6:
            settings.linearSolverType = exu.LinearSolverType.EigenSparse
        name = {"trapezoidal, index 2": "TrapezoidalIndex2", "tree, RK44": "RK44", "tree, RK67": "RK67"}.get(method)
        time.numberOfSteps, time.automaticStepSize = round((t_end - t0) / setting), False
        out.sensorsWritePeriod = (t_end - t0) / min(time.numberOfSteps, s["intervals"])
        time.generalizedAlpha.spectralRadius, time.newton.useModifiedNewton = 0.8, True
        time.adaptiveStep = False
        if not s["beams"]:  # with beams, and their large stiffnesses, Newton iterations end at the defaults
            time.newton.relativeTolerance, time.newton.absoluteTolerance = 1e-11, 1e-13

        def read() -> Any:
            found = motion(mbs, sensors, R=R)
            if len(found) - 1 != min(time.numberOfSteps, s["intervals"]):
                raise ValueError(f"it gave its motion at {len(found)} times, not at those that were asked for")
            return found, {"steps": int(time.numberOfSteps)}

        def run() -> Any:
            mbs.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, name or "GeneralizedAlpha"))
            return read

        return run

    return start, solve
