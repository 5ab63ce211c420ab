"""Two examples of Exudyn with reduced bodies, drawn by lot (seed 51) of the ten that run without a mesher, on the same matrices.

ObjectFFRFconvergenceTestHinge: a plate with a bolt and a bushing; its switches for joint at the bolt, weight and second
interface are on, since nothing moves otherwise. superElementRigidJointTest: two rotors joined at a face, a mass beside the axis,
under their weight; with interfaces that are rigid, as in the other example, where it joins means over a face. The
matrices in exudyn_matrices.b64 (npz of lower halves, SI, as text) are those of Exudyn's repository, copyright 2018-2025
Johannes Gerstmayr, University of Innsbruck, under the licence of that program, which allows redistribution with this notice."""

from __future__ import annotations

import base64
import importlib.util
import io
import json
import os
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix, diags

import mbdae as mb

HERE = Path(__file__).parent
BOLT = [0, 1, *range(18, 24), *range(92, 100), *range(119, 146)]
BUSHING = [10, 12, 31, *range(33, 38), *range(111, 119), *range(181, 209)]
LEFT, RIGHT = [36, 37, 38, 39, 44, 45, 46, 47, 77], [32, 33, 34, 35, 40, 41, 42, 43, 76]
#: joints: body and face (-1: the ground), body and face, the axes of space along and about which nothing moves; seen: body, node
EXAMPLES: dict[str, dict[str, Any]] = {
    "hinge": {"faces": [BOLT, BUSHING], "modes": 8, "gravity": [0, 0, -9.81], "at": [[0, 0, 0]],
              "joints": [[-1, -1, 0, 0, [1, 1, 1, 1, 0, 1]]], "seen": [[0, 10]], "end": 0.25, "outputs": 25,
              "steps": [2000, 4000], "radius": 0.8},
    "rotor": {"faces": [LEFT, RIGHT], "modes": 8, "gravity": [0, -9.81, 0], "at": [[0, 0, 0], [0, 0, 0.5]],
              "joints": [[-1, -1, 0, 0, [1] * 6], [0, 1, 1, 0, [1] * 6]], "seen": [[0, 110], [1, 32]], "end": 0.005,
              "outputs": 5, "steps": [1600, 3200], "radius": 0.5}}


def exudyn() -> str | None:
    """An interpreter that has exudyn: that named in EXUDYN_PYTHON, or the running one."""
    named = os.environ.get("EXUDYN_PYTHON")
    return named or (sys.executable if importlib.util.find_spec("exudyn") else None)


def matrices(name: str, stiffer: float = 1.0) -> tuple[Any, Any, Any]:
    """M, K times `stiffer`, and nodes of an example."""
    data, found = np.load(io.BytesIO(base64.b64decode((HERE / "exudyn_matrices.b64").read_text()))), []
    for which in "MK":
        entries = data[f"{name}_{which}_values"], (data[f"{name}_{which}_rows"], data[f"{name}_{which}_columns"])
        half = coo_matrix(entries).tocsc()
        found.append(half + half.T - diags(half.diagonal()))
    return found[0], stiffer * found[1], data[f"{name}_nodes"]


def theirs(name: str, stiffer: float = 1.0) -> dict[str, Any]:
    """Frequencies (Hz) of the modes with held interfaces, and places over time with every number of steps, by Exudyn."""
    M, K, nodes = matrices(name, stiffer)
    entries = {key: (A.data.tolist(), A.row.tolist(), A.col.tolist()) for key, A in (("M", coo_matrix(M)), ("K", coo_matrix(K)))}
    return answered(json.dumps(EXAMPLES[name] | entries | {"nodes": nodes.tolist()}))


def answered(problem: str) -> dict[str, Any]:
    """What Exudyn finds of a problem, see `exudyn_run.py`."""
    with tempfile.TemporaryDirectory() as folder:
        asked, answer = Path(folder) / "problem.json", Path(folder) / "answer.json"
        asked.write_text(problem)
        subprocess.run([str(exudyn()), str(HERE / "exudyn_run.py"), str(asked), str(answer)], check=True, cwd=folder,
                       capture_output=True, timeout=600)
        found: dict[str, Any] = json.loads(answer.read_text())
    return found


def ours(name: str, stiffer: float = 1.0) -> tuple[mb.ReducedBody, Any]:
    """The same body, and places over time; stiffer: a factor on K."""
    p = EXAMPLES[name]
    M, K, nodes = matrices(name, stiffer)
    body = mb.ReducedBody.craig_bampton(M, K, nodes, {"0": p["faces"][0], "1": p["faces"][1]}, p["modes"])
    s = mb.Scene(name, gravity=p["gravity"])
    for i, at in enumerate(p["at"]):
        s.reduced_body(f"body {i}", body, at=at)
    for a, i, b, j, axes in p["joints"]:
        ends = s.ground if a < 0 else f"body {a}.{i}", f"body {b}.{j}"
        where = nodes[p["faces"][j]].mean(axis=0) + p["at"][b]
        if all(axes):
            s.weld(f"joint {b}", *ends, at=where)
        else:
            s.revolute(f"joint {b}", *ends, at=where, axis=np.eye(3)[axes.index(0) - 3])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        r = s.simulate(p["end"], 1e-5, outputs=np.arange(p["outputs"] + 1) * p["end"] / p["outputs"])
    places = []
    for b, n in p["seen"]:
        moved = body.displacement(r[f"body {b}.modes"])[:, n, :3] + nodes[n] - body.center
        places.append(r[f"body {b}"].position + np.einsum("tij,tj->ti", r[f"body {b}"].rotation, moved))
    return body, np.array(places)


def apart(name: str, stiffer: float = 1.0) -> tuple[float, float, str]:
    """Largest difference of frequencies, relative, and of places over the largest displacement; what Exudyn's last digits are."""
    other = theirs(name, stiffer)
    coarse, fine = (np.array(run) for run in other["runs"])
    body, found = ours(name, stiffer)
    size = float(np.max(np.linalg.norm(fine - fine[:, :1], axis=2)))
    off, own = (float(np.max(np.linalg.norm(x - fine, axis=2))) for x in (found, coarse))
    frequencies = np.array(other["frequencies"])
    return (float(np.max(np.abs(body.held_frequencies[: len(frequencies)] / frequencies - 1))), off / size,
            f"{off:.1e} m of {size:.1e} m; Exudyn's last halving of the step changes {own:.1e} m")
