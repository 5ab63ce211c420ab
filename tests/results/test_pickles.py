"""Results, scenes and what is computed of them go through pickle and deepcopy with every bit."""

from __future__ import annotations

import copy
import gc
import pickle
import subprocess
import sys
import warnings
from pathlib import Path

import interrupted_scenes as scenes
import numpy as np
import pytest

import mbdae as mb

sys.path.insert(0, str(Path(__file__).parent))
from joint_scenes import MODELS, every_joint

COPIES = {"pickle": lambda r: pickle.loads(pickle.dumps(r)), "deepcopy": copy.deepcopy}
RUNS = ["Radau IIA", "Radau IIA, impacts", "Radau IIA, breaks and friction", "Radau IIA, rows in force", "Radau IIA, beam",
        "DOP853", "HHT", "IDA", "CVODE", "a method of one's own", "collocation of one's own"]


def sensors(r: mb.Result) -> dict[str, np.ndarray]:
    """Values of all sensors of all items that can be read."""
    scene = r.prepared.model.scene
    items = [(b.name, ("position", "velocity", "acceleration")) for b in scene.bodies]
    items += [(c.name, (*c.coordinates, "force", "torque", "power")) for c in scene.joints]
    return {f"{item}.{name}": r.read(f"{item}.{name}") for item, names in items for name in names}


@pytest.mark.parametrize(("name", "way"), [
    pytest.param(name, way, marks=[pytest.mark.slow] * ((i + k) % 3 > 0), id=f"{name}-{way}")
    for i, name in enumerate(RUNS) for k, way in enumerate(COPIES)])
def test_runs_keep_every_bit(name: str, way: str) -> None:
    make, end, options = scenes.RUNS[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        r = make().simulate(min(end, 0.3), **options)
    if "rows" in name:  # the equations of such a run are several
        r = make().simulate(end, **options)
        assert len(r.solution.systems) > 1
    bits, told, accuracy, outputs = scenes.bits(r), repr(r), r.accuracy, r(0.01)
    found = COPIES[way](r)
    del r
    gc.collect()
    assert (scenes.bits(found), repr(found), found.accuracy) == (bits, told, accuracy)
    assert np.array_equal(found(0.01).q, outputs.q)


@pytest.mark.parametrize("model", MODELS, ids=lambda m: type(m).__name__)
def test_sensors_of_all_joints(model: mb.JointModel) -> None:
    first = every_joint(model).simulate(0.2, solver=mb.RadauIIA(3, rtol=1e-6), outputs=7)
    for r in (first, every_joint(model).simulate(0.3, solver=mb.RadauIIA(3, rtol=1e-6), outputs=4, start=first)):
        read = sensors(r)
        for way in COPIES.values():
            again = sensors(way(r))
            assert all(np.array_equal(again[name], values) for name, values in read.items())


def test_a_run_goes_on_from_a_copy() -> None:
    r = scenes.chain().simulate(0.3, solver=mb.RadauIIA(3))
    ends = [scenes.chain().simulate(0.6, solver=mb.RadauIIA(3), start=start).q.tobytes() for start in (r, COPIES["pickle"](r))]
    assert ends[0] == ends[1]


def test_another_process_reads_it(tmp_path: Path) -> None:
    r = scenes.chain().simulate(0.3)
    (tmp_path / "r.pickle").write_bytes(pickle.dumps(r))
    script = "import pickle, sys; r = pickle.load(open(sys.argv[1], 'rb')); print(r.read('A.force').tobytes().hex())"
    out = subprocess.run([sys.executable, "-c", script, str(tmp_path / "r.pickle")], capture_output=True, text=True, check=True)
    assert bytes.fromhex(out.stdout.strip()) == r.read("A.force").tobytes()


def resting() -> mb.Scene:
    s = mb.Scene("resting")
    s.revolute("J", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), spring=5.0, damper=0.1)
    return s


@pytest.mark.parametrize("what", [
    lambda s: s, lambda s: s.check(), lambda s: s.equilibrium(), lambda s: s.linearize(), lambda s: s.floquet(1.0),
    lambda s: mb.sweep(s, {"rod.mass": [1.0, 2.0]}, t_end=0.1, workers=1),
    lambda s: mb.compare(s, 0.1, runs=["RadauIIA(3)"]), lambda s: mb.extremes(s, 0.1, vary={"rod.mass": [1.0, 2.0]}),
], ids=["scene", "check", "equilibrium", "linearize", "floquet", "sweep", "compare", "extremes"])
def test_what_else_is_returned(what) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = what(resting())
    for way in COPIES.values():
        assert str(way(found)) == str(found)
