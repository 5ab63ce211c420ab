"""Beams are drawn deformed, joined to what is attached to them, at every time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.results.stored_parts import started
from mbdae.show.drawing import LOOKS
from mbdae.show.shapes import geometry
from mbdae.system.prepare import prepare

DRIFT = 1e-6  # m, of the joints in the run at rtol 1e-6


def line(seen: Any, item: str, kind: str) -> Any:
    return next(seen.polyline(s) for s in seen.shapes if s.item == item and s.kind == kind)


def test_every_item_has_a_shape_and_a_name(flexible_run: Any) -> None:
    seen, scene = geometry(flexible_run), flexible_run.prepared.model.scene
    names = {item.name for item in (*scene.bodies, *scene.connections, *scene.line_loads)}
    assert {shape.item for shape in seen.shapes} == names
    assert {shape.kind for shape in seen.shapes} <= set(LOOKS)
    assert {name for label in seen.labels for name in label.text.split(", ")} == names
    assert all(np.all(np.isfinite(seen.polyline(shape))) for shape in seen.shapes)


def test_a_beam_is_a_smooth_line_that_bends_and_keeps_its_length(flexible_run: Any) -> None:
    rod = line(geometry(flexible_run), "rod", "bar")
    assert rod.shape[1] >= 33
    np.testing.assert_allclose(rod[0], np.linspace((0.3, 0, 0), (1.5, 0, 0), rod.shape[1]), atol=1e-12)
    chords = np.linalg.norm(np.diff(rod, axis=1), axis=2)
    np.testing.assert_allclose(chords.sum(axis=1), 1.2, rtol=5e-3)
    ends = np.linalg.norm(rod[:, -1] - rod[:, 0], axis=1)
    assert ends.min() < 1.15
    turns = np.einsum("tni,tni->tn", np.diff(rod, axis=1)[:, 1:], np.diff(rod, axis=1)[:, :-1]) / (chords[:, 1:] * chords[:, :-1])
    inside = np.arange(turns.shape[1]) % 8 != 7  # 8 chords per element: the others are kinks between elements
    assert np.min(turns[:, inside]) > 0.98  # cosine
    for k, x in ((0, 0.0), (rod.shape[1] // 2, 0.5), (-1, 1.0)):
        np.testing.assert_allclose(rod[:, k], flexible_run["rod"].at(x).position, atol=1e-12)


def test_corners_stay_sharp_and_rigid(flexible_run: Any) -> None:
    hook = line(geometry(flexible_run), "hook", "bar")
    corner = int(np.argmin(np.linalg.norm(hook[0] - (0.9, -0.4, 0), axis=1)))
    before, after = hook[:, corner] - hook[:, corner - 1], hook[:, corner + 1] - hook[:, corner]
    cosine = np.einsum("ti,ti->t", before, after) / np.linalg.norm(before, axis=1) / np.linalg.norm(after, axis=1)
    np.testing.assert_allclose(cosine, np.sqrt(0.5), atol=0.04)  # the sections are rigidly joined, chords turn a little


def test_what_is_attached_moves_with_the_section(flexible_run: Any) -> None:
    seen = geometry(flexible_run)
    pins = {name: line(seen, name, kind)[:, 0] for name, kind in (("B", "pin"), ("C", "pin"), ("E", "weld"))}
    np.testing.assert_allclose(pins["B"], line(seen, "rod", "bar")[:, 0], atol=DRIFT)
    np.testing.assert_allclose(pins["C"], flexible_run["block"].position, atol=DRIFT)
    np.testing.assert_allclose(pins["E"], line(seen, "hook", "bar")[:, 0], atol=DRIFT)
    scene = flexible_run.prepared.model.scene
    place = scene["rod"].at((0.6, 0.1))
    np.testing.assert_allclose(line(seen, "H", "thin")[:, -1], flexible_run[place].position, atol=1e-12)
    arm = line(seen, "H", "line")
    np.testing.assert_allclose(np.linalg.norm(arm[:, 1] - arm[:, 0], axis=1), 0.1, atol=1e-12)
    np.testing.assert_allclose(line(seen, "F", "thin")[:, -1], line(seen, "hook", "bar")[:, -1], atol=1e-12)
    np.testing.assert_allclose(line(seen, "G", "arrow")[:, 0], flexible_run["rod"].at(0.75).position, atol=1e-12)


def test_distributed_loads_follow_the_section(flexible_run: Any) -> None:
    wind = line(geometry(flexible_run), "wind", "thin")
    tail, tip = wind[:, 0], wind[:, 1]
    place = flexible_run["hook"].at(0.0)
    np.testing.assert_allclose(tip, place.position, atol=1e-12)
    force = np.einsum("tij,tj->ti", place.rotation, np.column_stack([np.ones(11), 0.5 * flexible_run.t, np.zeros(11)]))
    np.testing.assert_allclose(np.cross(tip - tail, force), 0, atol=1e-12)
    assert np.all(np.einsum("ti,ti->t", tip - tail, force) > 0)


@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Recursive()], ids=["kinematic", "recursive"])
def test_the_start_of_a_scene_is_drawn(model: Any, tmp_path: Path) -> None:
    s = mb.Scene("start")
    arm = s.link("arm", (0, 0), (1, 0), mass=1.0)
    tip = s.beam("tip", (1, 0), (2, 0), section=mb.Section.circular(0.01, 1e9, 0.3, 1000), elements=2)
    s.revolute("A", s.ground, arm, at=(0, 0), angle0=np.pi / 2, model=model)
    s.revolute("B", arm, tip, at=(1, 0), angle0=-np.pi / 2)
    seen = geometry(started(prepare(s)))
    np.testing.assert_allclose(line(seen, "arm", "bar")[0], [[0, 0, 0], [0, 1, 0]], atol=1e-9)
    np.testing.assert_allclose(line(seen, "tip", "bar")[0][[0, -1]], [[0, 1, 0], [1, 1, 0]], atol=1e-9)
    figure = s.draw(tmp_path / "start.png")
    assert {"arm", "tip", "A", "B"} == {name for text in figure.texts[1:] for name in text.get_text().split(", ")}


def test_gif_of_a_beam(flexible_run: Any, tmp_path: Path) -> None:
    from PIL import Image

    flexible_run.animate(tmp_path / "a.gif", fps=5, speed=0.5, trail="rod.at(0.5)", sensors="rod.at(0.5).stress_resultants")
    with Image.open(tmp_path / "a.gif") as image:
        assert image.n_frames == 5


def test_player_holds_the_shape_of_a_beam(flexible_run: Any, tmp_path: Path) -> None:
    import json

    flexible_run.animate(tmp_path / "a.html", sensors=["rod.at(0.5).stress_resultants"], trail=["hook.at(1.0)"])
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    film = json.loads(text.split('type="application/json">', 1)[1].split("</script>", 1)[0])
    (rod,) = (shape for shape in film["shapes"] if shape["kind"] == "bar" and len(shape["points"][0]) == 33 and not shape["body"]
              and abs(shape["points"][0][0][0] * film["unit"] - 0.3) < film["unit"])
    t = np.array(film["t"])
    tip = np.array(rod["points"])[:, -1] * film["unit"]
    np.testing.assert_allclose(tip, flexible_run(np.clip(t, 0, 0.4)).read("rod.at(1.0).position"), atol=0.6 * film["unit"])
    assert [curve["label"] for curve in film["curves"]] == [f"rod.at(0.5).stress_resultants [{unit}]" for unit in ("N", "N m")]
    assert film["trails"][0]["name"] == "hook.at(1.0)"
    assert len(text) < 1_500_000
