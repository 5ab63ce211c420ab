"""Drawn lines are the mechanism: rigid, attached where the joints are, at every time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.results.stored_parts import started
from mbdae.show.drawing import LOOKS
from mbdae.show.shapes import geometry
from mbdae.system.prepare import prepare

TIGHT = 1e-9  # m, round-off of positions of about 1 m


def lines(seen: Any, item: str, kind: str) -> list[Any]:
    return [seen.polyline(s) for s in seen.shapes if s.item == item and s.kind == kind]


def test_shapes_of_bodies_keep_their_lengths(zoo_run: Any) -> None:
    seen = geometry(zoo_run)
    rigid = [seen.polyline(s) for s in seen.shapes if s.body]
    assert len(rigid) > 10
    for points in rigid:
        lengths = np.linalg.norm(np.diff(points, axis=1), axis=2)
        np.testing.assert_allclose(lengths, np.broadcast_to(lengths[0], lengths.shape), atol=TIGHT)


def test_links_end_in_their_joints(bar: Any) -> None:
    seen = geometry(bar)
    crank, coupler, rocker = (lines(seen, name, "bar")[0] for name in ("crank", "coupler", "rocker"))
    pins = {name: lines(seen, name, "pin")[0][:, 0] for name in "ABCD"}
    for end, pin in ((crank[:, 0], "A"), (crank[:, -1], "B"), (coupler[:, 0], "B"), (coupler[:, -1], "C"),
                     (rocker[:, 0], "C"), (rocker[:, -1], "D")):
        np.testing.assert_allclose(end, pins[pin], atol=1e-5)  # m, drift of the run at accuracy 1e-3
    assert np.max(np.abs(crank[:, -1] - crank[0, -1])) > 0.1


def test_springs_end_where_they_are_attached(zoo_run: Any) -> None:
    seen, scene = geometry(zoo_run), zoo_run.prepared.model.scene
    (spring,) = lines(seen, "S", "thin")
    np.testing.assert_allclose(spring[:, 0], zoo_run[scene["arm"].at((1, 0.5))].position, atol=TIGHT)
    np.testing.assert_allclose(spring[:, -1], zoo_run.read("cart.position"), atol=TIGHT)
    (rod,) = lines(seen, "rod", "dashed")
    np.testing.assert_allclose(np.linalg.norm(rod[:, 1] - rod[:, 0], axis=1), 1.0, atol=1e-5)


def test_every_item_has_a_shape_and_a_look(zoo_run: Any) -> None:
    seen, scene = geometry(zoo_run), zoo_run.prepared.model.scene
    names = {item.name for item in (*scene.bodies, *scene.connections)}
    assert {shape.item for shape in seen.shapes} == names
    assert {shape.kind for shape in seen.shapes} <= set(LOOKS)
    assert {name for label in seen.labels for name in label.text.split(", ")} == names
    assert all(np.all(np.isfinite(seen.polyline(shape))) for shape in seen.shapes)


def test_the_force_arrow_points_along_the_force(zoo_run: Any) -> None:
    (arrow,) = lines(geometry(zoo_run), "push", "arrow")
    d = arrow[:, 1] - arrow[:, 0]
    np.testing.assert_allclose(np.cross(d, (5, 2, 0)), 0, atol=TIGHT)
    assert np.all(d @ (5, 2, 0) > 0)


def test_a_body_without_outline_is_the_plate_of_its_joints() -> None:
    s = mb.Scene()
    body = s.rigid_body("plate", 1.0, 0.1, at=(1, 0.2))
    s.revolute("A", s.ground, body, at=(0, 0))
    s.spring("S", s.ground, body, at_k=(2, 3), at_l=(2, 0), stiffness=1.0)
    seen = geometry(started(prepare(s)))
    (plate,) = lines(seen, "plate", "plate")
    corners = {tuple(np.round(p, 9)) for p in plate[0]}
    assert corners == {(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (1.0, 0.2, 0.0)}


def test_the_ellipsoid_of_a_body_in_space() -> None:
    """Half-axes a, b, c of a uniform ellipsoid: J = m/5 (b^2 + c^2, ...)."""
    m, a = 2.0, np.array([0.3, 0.2, 0.1])
    s = mb.Scene(space="spatial")
    s.rigid_body("egg", m, m / 5 * (a @ a - a**2), at=(1, 2, 3))
    seen = geometry(started(prepare(s)))
    reach = np.max(np.vstack([line[0] for line in lines(seen, "egg", "ring")]), axis=0) - (1, 2, 3)
    np.testing.assert_allclose(reach, a, rtol=1e-6)


def test_the_start_shows_held_angles() -> None:
    s = mb.Scene()
    rod = s.link("rod", (0, 0), (0, -1), mass=1.0)
    s.revolute("hinge", s.ground, rod, at=(0, 0), angle0=np.pi / 2)
    (line,) = lines(geometry(started(prepare(s))), "rod", "bar")
    np.testing.assert_allclose(line[0], [[0, 0, 0], [1, 0, 0]], atol=TIGHT)


@pytest.mark.parametrize("free", [True, False])
def test_a_free_body_alone_is_seen(free: bool) -> None:
    s = mb.Scene()
    s.rigid_body("stone", 1.0, 0.1 if free else 0.0, at=(0, 0)) if free else s.point_mass("stone", 1.0, at=(0, 0))
    seen = geometry(started(prepare(s)))
    assert seen.size > 0
    assert {shape.item for shape in seen.shapes} == {"stone"}
