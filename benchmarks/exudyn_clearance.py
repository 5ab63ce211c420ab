"""The slider-crank with clearance of benchmarks/clearance.py in exudyn, to be run by an interpreter that has it.

    <python with exudyn> exudyn_clearance.py '{"steps": [1e-6], "radii": [0.8], "output": "out.json", ...}'

The contact law of mbdae is a user function of a connector with force and torque at the centre of the pin; what that
connector does to the crank is borne by its drive. Writes for every run CPU s (one thread, process time, the solver
alone), the position of the slider and that of the pin in the race at exudyn's own times.
"""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    CoordinateConstraint,
    MarkerBodyPosition,
    MarkerBodyRigid,
    MarkerNodeCoordinate,
    MarkerNodePosition,
    NodePointGround,
    NodeRigidBody2D,
    ObjectConnectorRigidBodySpringDamper,
    ObjectJointRevolute2D,
    ObjectRigidBody2D,
    SensorNode,
)


def contact_law(p: dict[str, Any], spin: float) -> Any:
    """Force and torque of a spring, as exudyn asks for them, from the contact of the pin in a race that spins with the crank."""
    outer, play = p["outer"], p["outer"] - p["inner"]
    stiffness, damping, mu, v_c = p["stiffness"], p["damping"], p["mu"], p["v_c"]

    def law(mbs: Any, t: float, item: int, u: Any, turn: Any, v: Any, w: Any, *_: Any) -> list[float]:
        x, y = u[0], u[1]
        distance = math.sqrt(x * x + y * y)
        depth = distance - play
        if depth <= 0:
            return [0.0] * 6
        nx, ny = x / distance, y / distance
        ax, ay, wl = outer * nx - x, outer * ny - y, w[2] + spin
        vx, vy = v[0] - wl * ay + spin * outer * ny, v[1] + wl * ax - spin * outer * nx
        normal = max(0.0, stiffness * depth * math.sqrt(depth) * (1 + damping * (vx * nx + vy * ny)))
        rubbing = mu * math.tanh((vy * nx - vx * ny) / v_c) * normal
        fx, fy = -normal * nx + rubbing * ny, -normal * ny - rubbing * nx  # on the pin
        return [-fx, -fy, 0.0, 0.0, 0.0, -(ax * fy - ay * fx)]

    return law


def model(p: dict[str, Any]) -> tuple[Any, Any, list[Any]]:
    """The mechanism, with sensors of the crank, the rod and the slider."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    r, l, rate, mass = p["crank"], p["rod"], p["rate"], p["masses"]
    ground = mbs.AddNode(NodePointGround())
    zero = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    fixed = mbs.AddMarker(MarkerNodePosition(nodeNumber=ground))

    def body(m: float, inertia: float, x: float, v: list[float]) -> tuple[Any, Any]:
        node = mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[x, 0, 0], initialVelocities=v))
        return node, mbs.AddObject(ObjectRigidBody2D(physicsMass=m, physicsInertia=inertia, nodeNumber=node))

    def held(node: int, coordinate: int, **options: Any) -> None:
        marker = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
        mbs.AddObject(CoordinateConstraint(markerNumbers=[zero, marker], **options))

    crank, crank_body = body(mass["crank"], mass["crank"] * r**2 / 12, r / 2, [0, rate * r / 2, rate])
    rod, rod_body = body(mass["rod"], mass["rod"] * l**2 / 12, r + l / 2, [0, rate * r / 2, -rate * r / l])
    slider, slider_body = body(mass["slider"], 1e-3, r + l, [0, 0, 0])
    inner = mbs.AddMarker(MarkerBodyPosition(bodyNumber=crank_body, localPosition=[-r / 2, 0, 0]))
    mbs.AddObject(ObjectJointRevolute2D(markerNumbers=[fixed, inner]))
    held(crank, 2, velocityLevel=True, offset=rate)
    race = mbs.AddMarker(MarkerBodyRigid(bodyNumber=crank_body, localPosition=[r / 2, 0, 0]))
    pin = mbs.AddMarker(MarkerBodyRigid(bodyNumber=rod_body, localPosition=[-l / 2, 0, 0]))
    law = contact_law(p, rate)
    mbs.AddObject(ObjectConnectorRigidBodySpringDamper(markerNumbers=[race, pin], springForceTorqueUserFunction=law))
    end = mbs.AddMarker(MarkerBodyPosition(bodyNumber=rod_body, localPosition=[l / 2, 0, 0]))
    on_slider = mbs.AddMarker(MarkerBodyPosition(bodyNumber=slider_body))
    mbs.AddObject(ObjectJointRevolute2D(markerNumbers=[end, on_slider]))
    held(slider, 1)
    held(slider, 2)
    kind = exu.OutputVariableType.Coordinates
    sensors = [mbs.AddSensor(SensorNode(nodeNumber=i, storeInternal=True, writeToFile=False, outputVariableType=kind))
               for i in (crank, rod, slider)]
    mbs.Assemble()
    return container, mbs, sensors


def run(p: dict[str, Any], h: float, radius: float, modified: bool) -> dict[str, Any]:
    """CPU s, slider (m) and pin in the race (m, inertial axes) with steps of h; no motion where the solver fails."""
    _, mbs, sensors = model(p)
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps = round(p["t_end"] / h)
    settings.timeIntegration.endTime = p["t_end"]
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.generalizedAlpha.spectralRadius = radius
    settings.timeIntegration.newton.useModifiedNewton = modified
    settings.timeIntegration.newton.relativeTolerance = p["newton"]
    settings.solutionSettings.writeSolutionToFile = False
    settings.solutionSettings.sensorsWritePeriod = p["t_end"] / 200
    settings.parallel.numberOfThreads = 1
    found: dict[str, Any] = {"h": h, "radius": radius, "modified": modified}
    begin = time.process_time()
    try:
        mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.GeneralizedAlpha)
    except Exception as error:
        return found | {"cpu_s": time.process_time() - begin, "failed": str(error)[:200]}
    cpu = time.process_time() - begin
    crank, rod, slider = (np.array(mbs.GetSensorStoredData(sensor)) for sensor in sensors)
    r, l = p["crank"], p["rod"]
    centre = [r / 2 + crank[:, 1] + r / 2 * np.cos(crank[:, 3]), crank[:, 2] + r / 2 * np.sin(crank[:, 3])]
    pin = [r + l / 2 + rod[:, 1] - l / 2 * np.cos(rod[:, 3]), rod[:, 2] - l / 2 * np.sin(rod[:, 3])]
    return found | {"cpu_s": cpu, "t": slider[:, 0].tolist(), "slider": (r + l + slider[:, 1]).tolist(),
                    "pin": (np.array(pin) - np.array(centre)).T.tolist()}


if __name__ == "__main__":
    problem = json.loads(sys.argv[1])
    runs = [run(problem, h, radius, modified) for h in problem["steps"] for radius in problem["radii"]
            for modified in problem["modified"]]
    Path(problem["output"]).write_text(json.dumps({"version": exu.__version__, "runs": runs}))
