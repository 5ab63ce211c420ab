"""What the script of the engine Exudyn does, in an environment that has exudyn: its source is written into the script."""

from __future__ import annotations

from typing import Any


class ExudynRuns:
    """The scene of `scene.json` in exudyn: its start, and runs."""

    def __init__(self) -> None:
        import json

        import exudyn
        from exudyn import itemInterface

        self.exu, self.items = exudyn, itemInterface
        with open("scene.json", encoding="utf-8") as file:
            self.s = json.load(file)
        kinds = exudyn.OutputVariableType
        self.quantities = [kinds.Position, kinds.RotationMatrix, kinds.Velocity, kinds.AngularVelocity]

    def of_time(self, text: str) -> Any:
        """A function of time from its text."""
        import math

        return eval(f"lambda t: {text}", {"math": math})

    # -- absolute coordinates

    def absolute(self, mbs: Any, lie: bool) -> list[Any]:
        """Add the scene in absolute coordinates; returns its sensors."""
        s, items = self.s, self.items
        kind = "NodeRigidBody2D" if s["planar"] else "NodeRigidBodyRotVecLG" if lie else "NodeRigidBodyEP"
        nodes = [mbs.AddNode(getattr(items, kind)(referenceCoordinates=at, initialVelocities=v))
                 for at, v in (b["nodes"][kind] for b in s["bodies"])]
        ground, bodies = mbs.AddObject(items.ObjectGround()), list[Any]()
        for b, node in zip(s["bodies"], nodes, strict=True):
            if s["planar"]:
                made = items.ObjectRigidBody2D(mass=b["mass"], inertia=b["inertia"][2], nodeNumber=node)
            else:
                made = items.ObjectRigidBody(mass=b["mass"], inertia=b["inertia"], nodeNumber=node)
            bodies.append(None if b["beam"] else mbs.AddObject(made))
            if not b["beam"]:
                self.falls(mbs, bodies[-1], b["gravity"])
        for beam in s["beams"]:
            self.beam(mbs, beam, nodes)

        def marker(side: dict[str, Any]) -> int:
            if side["body"] >= 0 and bodies[side["body"]] is None:
                return int(mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=nodes[side["body"]])))
            body = ground if side["body"] < 0 else bodies[side["body"]]
            return int(mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=side["point"])))

        for one in s["connectors"]:
            self.connector(mbs, one, [marker(one["k"]), marker(one["l"])])
        for load in s["loads"]:
            if load["l"]["body"] >= 0:
                self.load(mbs, load, marker(load["l"]))
        return [[mbs.AddSensor(items.SensorNode(nodeNumber=node, storeInternal=True, writeToFile=False, outputVariableType=kind))
                 for kind in self.quantities] for node in nodes]

    def falls(self, mbs: Any, body: int, g: Any) -> None:
        """Gravity on a body."""
        if any(g):
            marker = mbs.AddMarker(self.items.MarkerBodyMass(bodyNumber=body))
            mbs.AddLoad(self.items.LoadMassProportional(markerNumber=marker, loadVector=g))

    def beam(self, mbs: Any, beam: dict[str, Any], nodes: list[Any]) -> None:
        """The elements of a planar beam."""
        for (i, j), length in zip(beam["elements"], beam["length"], strict=True):
            self.falls(mbs, mbs.AddObject(self.items.ObjectBeamGeometricallyExact2D(
                nodeNumbers=[nodes[i], nodes[j]], length=length, massPerLength=beam["mass"], crossSectionInertia=beam["rotary"],
                bendingStiffness=beam["EI"], axialStiffness=beam["EA"], shearStiffness=beam["GA"])), beam["gravity"])

    def connector(self, mbs: Any, one: dict[str, Any], markers: list[int]) -> None:
        """A joint, spring or bushing; with the function of time by which a coordinate is prescribed."""
        import numpy as np

        more = {name: np.array(value) if isinstance(value, list) else value for name, value in one["values"].items()}
        if one["offset"]:
            entry, value = one["offset"][0], self.of_time(one["offset"][1])

            def offset(mbs: Any, t: float, number: int, values: Any) -> list[float]:
                return [value(t) if i == entry else 0.0 for i in range(6)]

            more["offsetUserFunction"] = offset
        if "Torsional" in one["item"]:
            more["nodeNumber"] = mbs.AddNode(self.items.NodeGenericData(initialCoordinates=[0.0], numberOfDataCoordinates=1))
        mbs.AddObject(getattr(self.items, one["item"])(markerNumbers=markers, **more))

    def load(self, mbs: Any, load: dict[str, Any], marker: int) -> None:
        """A force or torque, a function of time."""
        parts = [self.of_time(text) for text in load["parts"]]
        kind = self.items.LoadTorqueVector if load["torque"] else self.items.LoadForceVector
        mbs.AddLoad(kind(markerNumber=marker, bodyFixed=load["follows"], loadVector=[p(self.s["t"][0]) for p in parts],
                         loadVectorUserFunction=lambda mbs, t, vector: [p(t) for p in parts]))

    # -- joint coordinates

    def tree(self, mbs: Any) -> list[Any]:
        """Add the scene in joint coordinates; returns its sensors."""
        import numpy as np

        exu, items, links = self.exu, self.items, self.s["tree"]["links"]
        lists, n = (exu.Matrix3DList, exu.Vector3DList), len(links)

        def of(name: str, kind: int) -> Any:
            return lists[kind]([np.array(link[name]) for link in links])

        node = mbs.AddNode(items.NodeGenericODE2(
            referenceCoordinates=[0.0] * n, initialCoordinates=[link["q"] for link in links],
            initialCoordinates_t=[link["v"] for link in links], numberOfODE2Coordinates=n))
        body = mbs.AddObject(items.ObjectKinematicTree(
            nodeNumber=node, jointTypes=[(exu.JointType.PrismaticZ, exu.JointType.RevoluteZ)[link["turns"]] for link in links],
            linkParents=[link["parent"] for link in links], jointTransformations=of("rotation", 0), jointOffsets=of("offset", 1),
            linkInertiasCOM=of("inertia", 0), linkCOMs=of("centre", 1), linkMasses=[link["mass"] for link in links],
            gravity=self.s["tree"]["gravity"], jointPControlVector=[link["stiffness"] for link in links],
            jointDControlVector=[link["damping"] for link in links], jointPositionOffsetVector=[link["rest"] for link in links],
            jointVelocityOffsetVector=[0.0] * n, jointForceVector=[link["load"] for link in links]))
        return [[mbs.AddSensor(items.SensorKinematicTree(
            objectNumber=body, linkNumber=i, localPosition=links[i]["centre"], storeInternal=True, writeToFile=False,
            outputVariableType=kind)) for kind in self.quantities] for i in self.s["tree"]["order"]]

    # -- runs

    def built(self, method: str) -> Any:
        """The system of a method, its sensors, and what turns the axes of links into those of bodies."""
        import numpy as np

        mbs, own = self.exu.SystemContainer().AddSystem(), method.startswith("tree")
        sensors = self.tree(mbs) if own else self.absolute(mbs, "Lie" in method)
        mbs.Assemble()
        tree = self.s["tree"]
        return mbs, sensors, [np.array(tree["links"][i]["body"]) for i in tree["order"]] if own else None

    def motion(self, mbs: Any, sensors: list[Any], R: Any, last: bool = False) -> Any:
        """(nt, nodes, 13) from what the sensors stored, or from what they show now."""
        import numpy as np

        out = []
        for i, one in enumerate(sensors):
            r, A, v, w = (np.atleast_2d(mbs.GetSensorValues(x)) if last else mbs.GetSensorStoredData(x)[:, 1:] for x in one)
            A = np.reshape(A, (-1, 3, 3)) if R is None else np.reshape(A, (-1, 3, 3)) @ R[i]
            K = np.zeros((len(A), 4, 4))  # whose eigenvector of the largest eigenvalue is the quaternion
            K[:, 0, 0] = np.trace(A, axis1=1, axis2=2)
            K[:, 1:, 1:] = A + A.transpose(0, 2, 1) - K[:, :1, :1] * np.eye(3)
            for row, (j, k) in enumerate(((2, 1), (0, 2), (1, 0)), 1):
                K[:, 0, row] = K[:, row, 0] = A[:, j, k] - A[:, k, j]
            out.append(np.hstack([r, np.linalg.eigh(K)[1][..., -1], v, w]))
        return np.stack(out, axis=1)

    def start(self) -> dict[str, Any]:
        """Motion and masses at the start."""
        mbs, sensors, R = self.built("")
        masses = [float("nan") if b["beam"] else b["mass"] for b in self.s["bodies"]]
        return {"motion": self.motion(mbs, sensors, R, last=True)[0], "mass": masses}

    def solve(self, method: str, setting: float) -> Any:
        """A function that makes a run."""
        mbs, sensors, R = self.built(method)
        (t0, t_end), settings = self.s["t"], self.exu.SimulationSettings()
        time, out = settings.timeIntegration, settings.solutionSettings
        time.startTime, time.endTime, time.verboseMode = t0, t_end, 0
        out.writeSolutionToFile, settings.parallel.numberOfThreads = False, 1
        if len(self.s["bodies"]) > 6:
            settings.linearSolverType = self.exu.LinearSolverType.EigenSparse
        name = {"trapezoidal, index 2": "TrapezoidalIndex2", "tree, RK44": "RK44", "tree, RK67": "RK67"}.get(method)
        time.numberOfSteps, time.automaticStepSize, time.adaptiveStep = round((t_end - t0) / setting), False, False
        out.sensorsWritePeriod = (t_end - t0) / min(time.numberOfSteps, self.s["intervals"])
        time.generalizedAlpha.spectralRadius, time.newton.useModifiedNewton = 0.8, True
        if not self.s["beams"]:  # with beams, and their large stiffnesses, Newton iterations end at the defaults
            time.newton.relativeTolerance, time.newton.absoluteTolerance = 1e-11, 1e-13

        def read() -> Any:
            found = self.motion(mbs, sensors, R)
            if len(found) - 1 != min(time.numberOfSteps, self.s["intervals"]):
                raise ValueError(f"it gave its motion at {len(found)} times, not at those that were asked for")
            return found, {"steps": int(time.numberOfSteps)}

        def run() -> Any:
            kinds = self.exu.DynamicSolverType
            mbs.SolveDynamic(settings, solverType=getattr(kinds, name) if name else kinds.GeneralizedAlpha)
            return read

        return run
