"""Run by an interpreter that has exudyn: bodies reduced by its Hurty-Craig-Bampton modes and joined at their faces, see `beside`.

python exudyn_run.py problem.json answer.json"""

import json
import sys

import exudyn as exu
import numpy as np
from exudyn import utilities as items
from exudyn.FEM import FEMinterface, HCBstaticModeSelection, ObjectFFRFreducedOrderInterface
from scipy.sparse import csr_matrix


def reduced(p):
    """The body with the modes of its faces, each of which moves as a rigid body."""
    fem = FEMinterface()
    fem.nodes = {"Position": np.array(p["nodes"])}
    n = 3 * len(p["nodes"])
    fem.massMatrix, fem.stiffnessMatrix = (csr_matrix((v, (i, j)), shape=(n, n)) for v, i, j in (p["M"], p["K"]))
    fem.ComputeHurtyCraigBamptonModes(boundaryNodesList=[np.array(f) for f in p["faces"]], nEigenModes=p["modes"],
                                      useSparseSolver=True, computationMode=HCBstaticModeSelection.RBE2)
    return fem


def run(p, fem, steps):
    """Places over time of the nodes that are looked at, (nodes, times, 3), m."""
    nodes, masses = np.array(p["nodes"]), np.asarray(fem.massMatrix.sum(axis=1)).ravel()[::3]
    mbs = exu.SystemContainer().AddSystem()
    ground = mbs.AddObject(items.ObjectGround(referencePosition=[0, 0, 0]))
    bodies, held = [], []
    for at in p["at"]:
        made = ObjectFFRFreducedOrderInterface(fem).AddObjectFFRFreducedOrder(
            mbs, positionRef=at, initialVelocity=[0, 0, 0], initialAngularVelocity=[0, 0, 0])
        bodies.append(made["oFFRFreducedOrder"])
        # weight of every node: a LoadMassProportional acts at the centre of mass of the undeformed body, and on no mode
        mean = mbs.AddMarker(items.MarkerSuperElementPosition(
            bodyNumber=bodies[-1], meshNodeNumbers=np.arange(len(nodes)), weightingFactors=masses / masses.sum()))
        mbs.AddLoad(items.Force(markerNumber=mean, loadVector=masses.sum() * np.array(p["gravity"])))
        held.append([mbs.AddMarker(items.MarkerSuperElementRigid(
            bodyNumber=bodies[-1], meshNodeNumbers=np.array(f), weightingFactors=np.ones(len(f)) / len(f),
            useAlternativeApproach=True)) for f in p["faces"]])
    for a, i, b, j, axes in p["joints"]:
        place = nodes[p["faces"][j]].mean(axis=0) + p["at"][b]
        k = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=place)) if a < 0 else held[a][i]
        mbs.AddObject(items.GenericJoint(markerNumbers=[k, held[b][j]], constrainedAxes=axes))
    seen = [mbs.AddSensor(items.SensorSuperElement(bodyNumber=bodies[b], meshNodeNumber=n, storeInternal=True,
                                                   outputVariableType=exu.OutputVariableType.Position)) for b, n in p["seen"]]
    mbs.Assemble()
    s = exu.SimulationSettings()
    s.timeIntegration.numberOfSteps, s.timeIntegration.endTime = steps, p["end"]
    s.timeIntegration.verboseMode = 0
    s.solutionSettings.writeSolutionToFile = False
    s.solutionSettings.sensorsWritePeriod = p["end"] / p["outputs"]
    s.timeIntegration.generalizedAlpha.spectralRadius = p["radius"]
    s.timeIntegration.newton.relativeTolerance, s.timeIntegration.newton.absoluteTolerance = 1e-10, 1e-12
    s.timeIntegration.newton.useModifiedNewton = True
    mbs.SolveDynamic(s)
    return [np.asarray(mbs.GetSensorStoredData(x))[:, 1:].tolist() for x in seen]


with open(sys.argv[1]) as file:
    problem = json.load(file)
body = reduced(problem)
found = {"frequencies": np.asarray(body.GetEigenFrequenciesHz()).tolist(),
         "runs": [run(problem, body, steps) for steps in problem["steps"]]}
with open(sys.argv[2], "w") as file:
    json.dump(found, file)
