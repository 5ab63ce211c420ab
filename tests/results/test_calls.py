"""The way of `accuracy` and `solver` from `Scene.simulate` to the step goes down: nothing on it calls a layer above its own."""

from __future__ import annotations

import gc
import sys
import threading
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import mbdae as mb
from mbdae.run import checkpoint, choice
from mbdae.system import prepare

sys.path.insert(0, str(Path(__file__).parents[1]))

from test_layers import LEVEL

ROOT = Path(mb.__file__).parent
BELOW = ("run", "results", "integrators")


@cache
def folder(file: str) -> str:
    """Folder of mbdae, or module beside the folders, of a file; "" elsewhere."""
    return Path(file).relative_to(ROOT).parts[0].removesuffix(".py") if ROOT in Path(file).parents else ""


def layer(frame: FrameType | None) -> str:
    """The folder whose code a frame runs."""
    return folder(frame.f_code.co_filename) if frame is not None else ""


@pytest.mark.parametrize("options", [
    {}, {"solver": mb.IDA()}, {"solver": mb.HHT(), "accuracy": 1e-3}, {"solver": mb.RadauIIA(3), "verify": True},
], ids=["default", "IDA", "HHT", "verified"])
def test_no_call_leads_back_up(options: dict[str, Any]) -> None:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    up: set[str] = set()

    def watch(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and (here := layer(frame)):
            caller = frame.f_back
            while caller is not None and not layer(caller):
                caller = caller.f_back
            if (above := layer(caller)) in BELOW and LEVEL[here] > LEVEL[above]:
                up.add(f"{above} calls {frame.f_code.co_qualname} of {here}")

    sys.setprofile(watch)
    try:
        s.simulate(0.2, **options)
    finally:
        sys.setprofile(None)
    assert not up


# ---- what a call keeps for the next one --------------------------------------------------------------------------------------


def swinging(length: float = 0.5, mass: float = 0.4, stiffness: float = 30.0, table: tuple[float, ...] = (0.0, 1.0),
             closed: bool = True) -> mb.Scene:
    s = mb.Scene("kept", gravity=(0, -9.81, 0))
    crank = s.link("crank", (0, 0), (0, 0.2), mass=mass)
    s.revolute("A", s.ground, crank, at=(0, 0), torque=mb.table([0.0, 1.0], table))
    s.spring("spring", s.ground, crank, (0.3, 0.3), (0, 0.2), stiffness=stiffness)
    if closed:
        rod, rocker = s.link("rod", (0, 0.2), (length, 0.4), mass=0.3), s.link("rocker", (0.6, 0), (length, 0.4), mass=0.3)
        s.revolute("B", crank, rod, at=(0, 0.2))
        s.revolute("C", rod, rocker, at=(length, 0.4))
        s.revolute("D", s.ground, rocker, at=(0.6, 0))
    return s


def end_of(s: mb.Scene, **options: Any) -> list[Any]:
    r = s.simulate(0.1, **options)
    return [r.q.tolist(), r["A"].force.tolist(), r.info.accuracy.motion, r.warnings, r.info.choice]


@pytest.fixture
def prepared(monkeypatch: pytest.MonkeyPatch) -> list[mb.Scene]:
    """The scenes that are prepared from here on, by a process that has kept none."""
    found: list[mb.Scene] = []
    monkeypatch.setattr(checkpoint, "_waiting", {})
    real = choice.prepare
    monkeypatch.setattr(choice, "prepare", lambda scene, *given, **named: (found.append(scene), real(scene, *given, **named))[1])
    return found


@pytest.mark.parametrize("closed", [True, False])
def test_the_same_statement_is_prepared_once(closed: bool, prepared: list[mb.Scene]) -> None:
    """To the last bit, for the same scene, an equal one, and another accuracy in between."""
    s = swinging(closed=closed)
    first = end_of(s)
    assert [end_of(s), end_of(s, accuracy=1e-4) and end_of(s)] == [first, first]
    assert len(prepared) == 1
    assert [end_of(swinging(closed=closed)) for _ in range(2)] == [first, first]
    assert len(prepared) == 1 + closed  # the scene of a loop is the user's own, so that a copy is prepared for others


def test_a_large_scene_waits_as_long_as_a_result_of_it_is_used(prepared: list[mb.Scene],
                                                               monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "NODES", 1)
    monkeypatch.setattr(prepare, "KEPT", 1)
    s = swinging()
    r = s.simulate(0.1)
    r = s.simulate(0.1)
    assert len(prepared) == len(checkpoint._waiting) == 1
    del r
    gc.collect()
    assert not checkpoint._waiting
    end_of(s)
    assert len(prepared) == 2


@pytest.mark.parametrize("changed", [{"length": 0.55}, {"mass": 0.5}, {"stiffness": 40.0}, {"stiffness": -0.0},
                                     {"table": (0.0, 2.0)}, {"closed": False}])
def test_another_number_counts(changed: dict[str, Any], prepared: list[mb.Scene]) -> None:
    for _ in range(2):  # the second time it is prepared for all equal scenes
        end_of(swinging())
    kept = end_of(swinging(**changed))
    checkpoint._waiting.clear()
    assert end_of(swinging(**changed)) == kept
    assert kept != end_of(swinging())


def test_what_is_set_on_a_law_counts(prepared: list[mb.Scene]) -> None:
    s = swinging()
    before = end_of(s)
    s["spring"].laws[0].stiffness = 40.0
    assert end_of(s) == end_of(swinging(stiffness=40.0)) != before
    assert end_of(swinging()) == before


def test_further_statements_do_not_reach_earlier_results(prepared: list[mb.Scene]) -> None:
    first, again = swinging(), swinging()
    before = end_of(first)
    r = again.simulate(0.1)
    first.spring("other", first.ground, first["crank"], (0.3, 0), (0, 0.2), stiffness=300.0)
    assert end_of(first) != before
    assert [c.name for c in r.prepared.model.scene.connections] == [c.name for c in again.connections]
    assert end_of(again) == before


FACTOR = [2.0]


class Pull(mb.Force):
    params = mb.params(c=("N", "force at factor 1"))

    def energy(self, k: Any, l: Any) -> Any:
        return self.c * FACTOR[0] * (l.r - k.r) @ k.y


def test_beside_another_thread_a_call_prepares_anew(prepared: list[mb.Scene]) -> None:
    """It may read an earlier result while this run uses what that is read from."""
    scene, go = swinging(), threading.Event()
    scene.simulate(0.1)
    other = threading.Thread(target=go.wait)
    other.start()
    try:
        scene.simulate(0.1)
    finally:
        go.set()
        other.join()
    assert len(prepared) == 2


def test_an_own_law_counts_by_what_it_states(prepared: list[mb.Scene], monkeypatch: pytest.MonkeyPatch) -> None:
    def pulled() -> mb.Scene:
        s = swinging()
        s.add(Pull("pull", s.ground, s["crank"], at=(0, 0.2), c=1.0))
        return s

    s = pulled()
    before = end_of(s)
    assert end_of(s) == before
    assert len(prepared) == 1
    monkeypatch.setattr(sys.modules[__name__], "FACTOR", [3.0])
    assert end_of(s) != before
    assert len(prepared) == 2
