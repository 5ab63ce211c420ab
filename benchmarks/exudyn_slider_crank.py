"""The slider-crank of benchmarks/beams.py in exudyn, to be run by an interpreter that has it: one run per step size.

    <python with exudyn> exudyn_slider_crank.py '{"elements": 8, "steps": [1e-3, 1e-4], "output": "out.json", ...}'

Writes for every step size CPU s (one thread, process time, the solver alone) and the nodes of the rod at exudyn's own times.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    CoordinateConstraint,
    MarkerBodyPosition,
    MarkerNodeCoordinate,
    MarkerNodePosition,
    NodePointGround,
    NodeRigidBody2D,
    ObjectBeamGeometricallyExact2D,
    ObjectJointRevolute2D,
    ObjectRigidBody2D,
    SensorNode,
)


def model(p: dict[str, Any]) -> tuple[Any, Any, list[Any]]:
    """The mechanism with linear elements, and a sensor of displacements per node of the rod; the rod's first node is driven."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    r, l, n, s, rate = p["crank"], p["rod"], p["elements"], p["section"], p["rate"]
    ground = mbs.AddNode(NodePointGround())
    zero = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    fixed = mbs.AddMarker(MarkerNodePosition(nodeNumber=ground))

    def held(node: int, coordinate: int, **options: Any) -> None:
        marker = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
        mbs.AddObject(CoordinateConstraint(markerNumbers=[zero, marker], **options))

    crank = mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[r / 2, 0, 0], initialVelocities=[0, rate * r / 2, rate]))
    body = mbs.AddObject(ObjectRigidBody2D(physicsMass=1.0, physicsInertia=r**2 / 12, nodeNumber=crank))
    inner, outer = (mbs.AddMarker(MarkerBodyPosition(bodyNumber=body, localPosition=[x, 0, 0])) for x in (-r / 2, r / 2))
    mbs.AddObject(ObjectJointRevolute2D(markerNumbers=[fixed, inner]))
    held(crank, 2, velocityLevel=True, offset=rate)
    nodes = []
    for i in range(n + 1):
        x = r + l * i / n
        v = rate * r * (1 - i / n)
        nodes.append(mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[x, 0, 0], initialVelocities=[0, v, -rate * r / l])))
    for i in range(n):
        mbs.AddObject(ObjectBeamGeometricallyExact2D(
            nodeNumbers=nodes[i : i + 2], physicsLength=l / n, physicsMassPerLength=s["mass_per_length"],
            physicsCrossSectionInertia=s["rotary_inertia"], physicsBendingStiffness=s["EI"], physicsAxialStiffness=s["EA"],
            physicsShearStiffness=s["GA"]))
    start = mbs.AddMarker(MarkerNodePosition(nodeNumber=nodes[0]))
    mbs.AddObject(ObjectJointRevolute2D(markerNumbers=[outer, start]))
    block = mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[r + l, 0, 0]))
    slider = mbs.AddObject(ObjectRigidBody2D(physicsMass=p["block"], physicsInertia=0.01, nodeNumber=block))
    on_block = mbs.AddMarker(MarkerBodyPosition(bodyNumber=slider))
    end = mbs.AddMarker(MarkerNodePosition(nodeNumber=nodes[-1]))
    mbs.AddObject(ObjectJointRevolute2D(markerNumbers=[end, on_block]))
    held(block, 1)
    held(block, 2)
    kind = exu.OutputVariableType.Displacement
    sensors = [mbs.AddSensor(SensorNode(nodeNumber=i, storeInternal=True, writeToFile=False, outputVariableType=kind))
               for i in nodes]
    mbs.Assemble()
    return container, mbs, sensors


def run(p: dict[str, Any], h: float) -> dict[str, Any]:
    """CPU s and motion with steps of h; an empty motion where the solver fails."""
    _, mbs, sensors = model(p)
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps = round(p["t_end"] / h)
    settings.timeIntegration.endTime = p["t_end"]
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.generalizedAlpha.spectralRadius = p["radius"]
    settings.timeIntegration.newton.useModifiedNewton = p["modified"]
    settings.solutionSettings.writeSolutionToFile = False
    settings.solutionSettings.sensorsWritePeriod = max(h, p["t_end"] / 100)
    settings.parallel.numberOfThreads = 1
    begin = time.process_time()
    try:
        mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.GeneralizedAlpha)
    except Exception as error:
        return {"h": h, "cpu_s": time.process_time() - begin, "failed": str(error)[:200]}
    cpu = time.process_time() - begin
    stored = [np.array(mbs.GetSensorStoredData(sensor)) for sensor in sensors]
    return {"h": h, "cpu_s": cpu, "t": stored[0][:, 0].tolist(), "nodes": [d[:, 1:3].tolist() for d in stored]}


if __name__ == "__main__":
    problem = json.loads(sys.argv[1])
    found = {"version": exu.__version__, "runs": [run(problem, h) for h in problem["steps"]]}
    Path(problem["output"]).write_text(json.dumps(found))
