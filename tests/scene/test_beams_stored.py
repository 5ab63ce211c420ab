"""Scenes with beams on disk and in words: the same result after loading, the mesh and its unknowns in `check`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mbdae as mb

SECTION = mb.Section.circular(0.01, 2e9, 0.3, 1000, damping=1e-4)


def wave(s: float) -> Any:
    """A curve of the user's own."""
    return s, 0.1 * np.sin(2 * np.pi * s)


def scene(space: str = "auto", curve: Any = wave) -> mb.Scene:
    s = mb.Scene("stored", gravity=(0, -9.81, 0), space=space)
    a = s.beam("a", curve=curve, section=SECTION, elements=3, order=3)
    b = s.beam("b", (1, 0), (1.5, 0.5), (2, 0), curve="arc", section=SECTION)
    s.weld("W", s.ground, a, at=(0, 0))
    s.revolute("J", a, b, at=(1, 0))
    s.force("F", b.at(0.5), (0, 1))
    b.load((0, 2 * mb.t + 1), frame="section")
    return s


READ = ("a.at(0.3).position", "b.at(1.0).velocity", "b.at(0.2).stress_resultants", "b.at(1.2, 0.4).rotation", "J.force",
        "b.velocity")


@pytest.mark.parametrize(("space", "solver", "stresses"), [
    ("auto", mb.RadauIIA(3, rtol=1e-4), True), ("spatial", mb.RadauIIA(2, rtol=1e-3), True),
    ("auto", mb.IDA(rtol=1e-4, max_order=2), False),
], ids=["Radau", "Radau in space", "IDA"])
def test_a_loaded_result_is_the_result(space: str, solver: Any, stresses: bool, tmp_path: Path) -> None:
    r = scene(space).simulate(0.02, solver=solver, outputs=5)
    assert any(name.startswith("a.M3") for name in r.solution.names) == stresses
    r.save(tmp_path / "run.npz")
    again = mb.load(tmp_path / "run.npz", laws=[wave])
    assert again.prepared.model.scene.statements == r.prepared.model.scene.statements
    between = np.linspace(0, 0.02, 13)
    for path in READ:
        np.testing.assert_array_equal(again.read(path), r.read(path))
        np.testing.assert_array_equal(again(between).read(path), r(between).read(path))
    np.testing.assert_allclose(again.energy.balance, r.energy.balance, atol=1e-14)
    more = scene(space).simulate(0.025, solver=solver, start=again, outputs=2)
    np.testing.assert_allclose(more.read("b.at(1.0).position")[0], r.read("b.at(1.0).position")[-1], atol=1e-12)


def test_a_curve_that_cannot_be_found_again(tmp_path: Path) -> None:
    r = scene(curve=lambda s: (s, 0.1 * s * s - 0.1 * s)).simulate(1e-3, solver=mb.RadauIIA(3, rtol=1e-3))
    with pytest.raises(mb.OptionError, match=r"beam 'a': a lambda has no name .* define it with def"):
        r.save(tmp_path / "run.npz")
    assert not list(tmp_path.iterdir())


def test_check_names_the_mesh_and_its_unknowns() -> None:
    c = scene().check()
    assert c.beams == {"a": 3, "b": 4}
    assert c.unknowns["stresses"] == 3 * 3 * 3 + 4 * 2 * 3  # points times stresses in the plane
    said = str(c)
    assert "2 bodies, 2 flexible beams among them, 2 joints, 1 force element, 1 distributed load" in said
    assert "51 stresses" in said
    assert "beams: a (3 elements of order 3, 10 nodes); b (4 elements of order 2, 9 nodes)" in said
    assert "stresses: unknowns with Radau IIA; other solvers eliminate them by the compliance of the sections" in said
    assert {"J.x", "J.y"} <= set(c.shared) <= {"W.x", "W.y", "W.twist", "J.x", "J.y"}
    assert scene("spatial").check().unknowns["stresses"] == 2 * 51


def test_check_of_a_rigid_scene_says_nothing_of_beams() -> None:
    s = mb.Scene("rigid")
    s.link("a", (0, 0), (1, 0), mass=1.0)
    c = s.check()
    assert c.beams == {}
    assert "beam" not in str(c)
    assert "stresses" not in str(c)
