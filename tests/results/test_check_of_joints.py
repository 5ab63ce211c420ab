"""What check() says of joints: every one with its model and coordinates, and why coordinates are kept as unknowns."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import mbdae as mb

sys.path.insert(0, str(Path(__file__).parent))
from joint_scenes import MODELS, Dial, every_joint

SIZE = (0.02, 0.05, 0.04)


@pytest.mark.parametrize("model", [None, *MODELS], ids=lambda m: type(m).__name__)
def test_every_joint_is_listed_with_model_and_coordinates(model: mb.JointModel | None) -> None:
    found = every_joint(model).check()
    (line,) = [line for line in str(found).splitlines() if line.startswith("  joints, ")]
    assert line == (f"  joints, {type(model or mb.Kinematic()).__name__.lower()}: R, H, A (angle); P (displacement prescribed); "
                    f"C (displacement prescribed, angle); U (angle_k, angle_l); E (x, y, angle); S (travel, angle)")
    kept = dict.fromkeys("HS", "without them the joint has no constraint equations") if model in (None, mb.Kinematic()) else {}
    assert found.kept_coordinates == kept
    assert ("  coordinates kept as unknowns: H, S: without them the joint has no constraint "
            "equations" in str(found)) == bool(kept)


def test_the_reason_why_coordinates_are_kept_is_what_needs_them() -> None:
    s = mb.Scene("dials", space="spatial")
    given = {"plain": {}, "sprung": {"spring": 1.0, "damper": 0.1}, "driven": {"prescribed": mb.t}, "wheel": {},
             "rubbed": {"friction": mb.Coulomb(0.1, 0.01), "radius": 0.02}}
    for i, (name, options) in enumerate(given.items()):
        body = s.rigid_body(f"b{i}", 1.0, SIZE, at=(i, 0, 0))
        s.joint(Dial, name, s.ground, body, at=(i, 0, 0), **options)
    s.revolute("R", s.ground, s.rigid_body("b", 1.0, SIZE, at=(0, 3, 0)), at=(0, 3, 0), spring=1.0, angle0=0.1)
    s.revolute("T", s.ground, s.rigid_body("c", 1.0, SIZE, at=(0, 4, 0)), at=(0, 4, 0))
    s.gear("mesh", "wheel", "T", ratio=-1.0)
    found = s.check()
    assert found.kept_coordinates == {
        "sprung": "the joint has no method `coordinate` that computes from the bodies the one of its spring, damper",
        "driven": "without them the joint has no constraint equation that prescribes a coordinate",
        "rubbed": "the joint has no method `coordinate` that computes from the bodies the one of its friction",
        "wheel": "the coupling mesh counts their whole turns", "T": "the coupling mesh counts their whole turns"}
    assert "7 joints, 1 coupling, 0 force elements" in str(found)
