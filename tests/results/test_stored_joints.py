"""Stored runs of all joints in all models: sensors, starts by coordinate, files of earlier versions."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mbdae as mb

sys.path.insert(0, str(Path(__file__).parent))
from joint_scenes import MODELS, Slot, every_joint


@pytest.mark.parametrize("model", MODELS, ids=lambda m: type(m).__name__)
def test_runs_and_runs_that_go_on_come_back(model: mb.JointModel, tmp_path: Path) -> None:
    first = every_joint(model).simulate(0.6, solver=mb.RadauIIA(3, rtol=1e-6), outputs=7)
    second = every_joint(model).simulate(0.9, solver=mb.RadauIIA(3, rtol=1e-6), outputs=4, start=first)
    for n, r in enumerate((first, second)):
        r.save(tmp_path / f"{n}.npz")
        again = mb.load(tmp_path / f"{n}.npz", laws=[Slot])
        assert again.prepared.model.scene.statements == r.prepared.model.scene.statements
        assert again.start.coordinates == r.start.coordinates
        for joint in r.prepared.model.scene.joints:
            assert (joint.model, joint.coordinates) == (again.prepared.model.scene[joint.name].model, joint.coordinates)
            for name in (*joint.coordinates, *(f"{c}_rate" for c in joint.coordinates), "force", "torque", "power"):
                sensor = f"{joint.name}.{name}"
                np.testing.assert_allclose(again.read(sensor), r.read(sensor), rtol=1e-12, atol=1e-12, err_msg=sensor)
    assert {("C", "angle"), ("C", "displacement"), ("E", "x"), ("S", "travel")} <= second.start.coordinates.keys()
    assert second.read("C.angle")[0] == pytest.approx(first.read("C.angle")[-1], abs=1e-9)
    assert abs(second.read("C.angle")[0]) > np.pi  # a turn that the frames do not show


def with_coordinates(path: Path, coordinates: Any) -> None:
    """Put other start values of coordinates into a stored result."""
    with np.load(path) as file:
        arrays = dict(file)
    header = json.loads(str(arrays["header"]))
    header["start"]["coordinates"] = coordinates
    np.savez(path, **(arrays | {"header": np.array(json.dumps(header))}))


def wheel() -> mb.Scene:
    s = mb.Scene("wheel", space="spatial")
    body = s.rigid_body("body", 1.0, (1, 1, 2))
    s.revolute("hub", s.ground, body, at=(0, 0, 0), axis=(0, 0, 1), rate0=8.0)
    return s


def test_files_with_one_number_for_a_joint_are_read(tmp_path: Path) -> None:
    """Earlier versions knew one coordinate of a joint."""
    second = wheel().simulate(2.0, start=wheel().simulate(1.0))
    path = tmp_path / "r.npz"
    second.save(path)
    with np.load(path) as file:
        assert json.loads(str(file["header"]))["start"]["coordinates"] == {"hub": {"angle": pytest.approx(8.0, abs=1e-4)}}
    with_coordinates(path, {"hub": 8.0})
    old = mb.load(path)
    assert old.start.coordinates == {("hub", "angle"): 8.0}
    np.testing.assert_allclose(old["hub"].angle[[0, -1]], [8.0, 16.0], atol=1e-4)


@pytest.mark.parametrize("wrong", [{"nave": 8.0}, {"hub": {"turn": 8.0}}, {"hub": {}}, {"hub": "8"}, {"hub": [8.0]},
                                   {"hub": {"angle": None}}])
def test_coordinates_that_the_scene_does_not_have_are_refused(wrong: Any, tmp_path: Path) -> None:
    path = tmp_path / "r.npz"
    wheel().simulate(0.1).save(path)
    with_coordinates(path, wrong)
    with pytest.raises(mb.OptionError, match="start"):
        mb.load(path)
