"""Rigid joints carry their body: no unknowns, no rows, and everything that can be read stays what it is with them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.scene.components import Connection
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.prepare import prepare


def flail(space: str = "auto", driven: bool = False) -> mb.Scene:
    """Two arms welded to one, a point on its end, a bob on a hinge and a spring to the ground; a stand on the ground."""
    spatial = space == "spatial"
    s = mb.Scene("flail", gravity=(0, -9.81, 1.0 if spatial else 0), space=space)
    arm = s.rigid_body("arm", 1.0, (0.01, 0.02, 0.03), at=(0.5, 0.1))
    turned = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
    fork = s.rigid_body("fork", 2.0, (0.03, 0.01, 0.02), at=(1.2, 0.4, 0.2 if spatial else 0), rotation=turned)
    tip, bob = s.point_mass("tip", 0.5, at=(1.5, 0.5)), s.link("bob", (1.5, 0.2), (1.5, -0.5), mass=0.7)
    stand = s.point_mass("stand", 3.0, at=(0, -1))
    s.revolute("A", s.ground, arm, at=(0, 0), angle=3 * mb.t if driven else None)
    s.weld("seam", fork, arm, at=(1, 0.2))
    s.spherical("ball", tip, fork, at=(1.5, 0.5))
    s.revolute("B", fork, bob, at=(1.5, 0.2), axis=(0, 0, 1) if not spatial else (0, 1, 1))
    s.weld("foot", s.ground, stand)
    s.spring("spring", stand, tip, at_k=(0, -1), at_l=(1.5, 0.5), stiffness=20.0, damping=0.3)
    return s


def by_rows(monkeypatch: Any, scene: mb.Scene) -> Any:
    """The scene prepared with the rows of its welds and the unknowns of every body."""
    with monkeypatch.context() as m:
        m.setattr(Connection, "rigid", property(lambda self: False))
        return prepare(scene)


@pytest.mark.parametrize("space", ["auto", "spatial"])
def test_bodies_that_are_welded_have_no_unknowns(space: str, monkeypatch: Any) -> None:
    prepared, full = prepare(flail(space)), by_rows(monkeypatch, flail(space))
    assert set(flail(space).check().rigid) == {"seam", "ball", "foot"}
    point, body = (3, 7) if space == "spatial" else (2, 3)
    assert full.all_bodies.nq - prepared.all_bodies.nq == 2 * point + body
    rows = len(full.rows) - len(prepared.rows)
    assert rows == 2 * point + (6 if space == "spatial" else 3)
    assert prepared.rank.degrees_of_freedom == full.rank.degrees_of_freedom


@pytest.mark.parametrize("space", ["auto", "spatial"])
@pytest.mark.parametrize("driven", [False, True])
def test_reactions_of_welds_are_exact(space: str, driven: bool, monkeypatch: Any) -> None:
    """The same states, the same accelerations and multipliers: from leaf to root, and from the constrained equations."""
    prepared = prepare(flail(space, driven))
    full = by_rows(monkeypatch, flail(space, driven))
    result = flail(space, driven).simulate(0.5, accuracy=1e-6, outputs=7, solver=mb.IDA())
    t, (q, u, s) = result.t, result._states
    assert type(full.mechanics) is Mechanics
    assert type(prepared.mechanics) is not Mechanics
    for found, known in zip(prepared.mechanics.accelerations(t, q, u, s), full.mechanics.accelerations(t, q, u, s), strict=True):
        np.testing.assert_allclose(found, known, atol=1e-10 * np.max(np.abs(known)))


def test_a_run_with_welds_reads_like_one_with_rows(monkeypatch: Any) -> None:
    carried = flail("spatial").simulate(1.0, accuracy=1e-8)
    with monkeypatch.context() as m:
        m.setattr(Connection, "rigid", property(lambda self: False))
        rows = flail("spatial").simulate(1.0, accuracy=1e-8)
    assert carried.multiplier_names == rows.multiplier_names
    for sensor in ("seam.force", "seam.torque", "ball.force", "foot.force", "fork.velocity", "tip.position", "bob.rotation"):
        known = rows.read(sensor)
        np.testing.assert_allclose(carried.read(sensor), known, atol=2e-6 * max(1.0, float(np.max(np.abs(known)))))
    assert np.max(np.abs(carried.energy.balance)) < 1e-6
    assert np.max(carried.drift.position) < 1e-8


def test_a_file_with_unknowns_of_welded_bodies_is_read(tmp_path: Path, monkeypatch: Any) -> None:
    with monkeypatch.context() as m:
        m.setattr(Connection, "rigid", property(lambda self: False))
        stored = flail().simulate(0.2, solver=mb.IDA())
        stored.save(tmp_path / "rows.npz")
        known = stored["seam"].force
    np.testing.assert_allclose(mb.load(tmp_path / "rows.npz")["seam"].force, known)


def test_where_nothing_else_moves_a_weld_keeps_its_rows() -> None:
    s = mb.Scene("still", gravity=(0, -9.81, 0))
    s.weld("foot", s.ground, s.link("post", (0, 0), (0, 1), mass=2.0), at=(0, 0))
    r = s.simulate(0.1)
    assert s.check().degrees_of_freedom == 0
    np.testing.assert_allclose(r["foot"].force, np.tile([0, 2 * 9.81, 0], (len(r.t), 1)), atol=1e-9)


def test_a_point_joins_two_bodies_that_turn() -> None:
    """A point cannot carry a body: the second ball keeps its rows, and both bodies turn freely about it."""
    s = mb.Scene("two rods", gravity=(0, -9.81, 0))
    a, b = s.link("a", (0, 0), (1, 0), mass=1.0), s.link("b", (1, 0), (2, 0), mass=1.0)
    pin = s.point_mass("pin", 0.1, at=(1, 0))
    s.revolute("A", s.ground, a, at=(0, 0))
    s.spherical("first", pin, a, at=(1, 0))
    s.spherical("second", pin, b, at=(1, 0))
    assert s.check().rigid == ("first",)
    assert s.check().degrees_of_freedom == 2
    r = s.simulate(0.5, accuracy=1e-7)
    assert np.max(np.abs(r["a"].rotation[-1] - r["b"].rotation[-1])) > 0.1


def test_a_loop_of_welds_leaves_its_last_one_redundant() -> None:
    s = mb.Scene("frame", gravity=(0, -9.81, 0))
    bars = [s.link(f"bar{i}", (np.cos(i), np.sin(i)), (np.cos(i + 1), np.sin(i + 1)), mass=1.0) for i in range(3)]
    s.revolute("A", s.ground, bars[0], at=(1, 0))
    for i in range(3):
        s.weld(f"w{i}", bars[i], bars[(i + 1) % 3], at=(np.cos(i + 1), np.sin(i + 1)))
    found = s.check()
    assert found.degrees_of_freedom == 1
    assert found.rigid == ("w0", "w1")
    assert {row.rsplit(".", 1)[0] for row in found.redundant} == {"w2"}
