"""An arena: the same scenes for everybody, what is read of it, a folder to cite, going on after an interruption."""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.arena import SUITES, drawn
from mbdae.arena.page import missed, profiles, program, programs, stays
from mbdae.compare.table import Row
from mbdae.system.prepare import prepare

FEW: dict[str, Any] = {"runs": [mb.RadauIIA(3)], "accuracies": [1e-4]}


def pendulum(length: float = 1.0) -> mb.Scene:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (length, 0), mass=1.0), at=(0, 0))
    return s


@pytest.fixture(scope="module")
def small() -> Any:
    return mb.arena({"short": (pendulum(0.5), 0.2), "long": (pendulum(), 0.2)}, ["scipy"], **FEW)


def test_a_seed_draws_the_same_scenes_and_another_one_others() -> None:
    def stated(seed: int) -> list[Any]:
        return [(name, scene.statements, t_end) for _, (name, scene, t_end) in drawn(len(SUITES), seed)]

    assert stated(3) == stated(3)
    assert all(a != b for a, b in zip(stated(3), stated(4), strict=True))


@pytest.mark.parametrize("kind", SUITES)
def test_scenes_of_the_suites_can_be_run(kind: str) -> None:
    _, scene, t_end = SUITES[kind](np.random.default_rng(7))
    assert not scene.problems
    assert prepare(scene, t_end=t_end).model.nodes


def test_every_program_has_its_row(small: Any) -> None:
    assert [row["program"] for row in programs(small.comparisons)] == ["mbdae", "scipy"]
    assert all(row["scenes stated"] == "2 of 2" for row in programs(small.comparisons))
    assert str(small).startswith("Arena: 2 scenes: 2 of 2 scenes compared")


def test_a_folder_to_cite(small: Any, tmp_path: Path) -> None:
    folder = small.save(tmp_path / "arena")
    data = (folder / "arena.json").read_text()
    assert {p.name for p in folder.iterdir()} == {"index.html", "arena.json", "summary.txt", "environment.json", "CITATION.cff",
                                                  "scenes"}
    cited = (folder / "CITATION.cff").read_text()
    assert hashlib.sha256(data.encode()).hexdigest() in cited
    assert all(one in cited for one in small.asked["engines"])  # with their versions
    entries = json.loads(data)["entries"]
    assert {len(h) for e in entries for h in e["hashes"].values()} == {64}
    assert entries[0]["hashes"] != entries[1]["hashes"]
    page = (folder / "index.html").read_text()
    assert page.count("<svg") == 4  # the profiles twice, and a diagram for each scene
    assert "prefers-color-scheme: dark" in page
    assert "src=" not in page  # it loads no other file
    assert all(one in page for one in small.asked["engines"])


def test_finished_scenes_are_not_computed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept, scenes = tmp_path / "kept", {"a": (pendulum(0.5), 0.1), "b": (pendulum(), 0.1)}

    def stop(done: int, total: int, name: str) -> None:
        if name == "b":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match="1 of 2 scenes are done") as caught:
        mb.arena(scenes, resume=kept, progress=stop, **FEW)
    assert [e.name for e in caught.value.solution.entries] == ["a"]
    module = sys.modules["mbdae.compare"]
    ran, own = list[str](), module.executed
    monkeypatch.setattr(module, "executed", lambda problem, *rest: (ran.append(problem.name), own(problem, *rest))[1])
    assert [e.name for e in mb.arena(scenes, resume=kept, **FEW).entries] == ["a", "b"]
    assert len(ran) == 1  # of b alone


def test_an_arena_that_was_asked_for_something_else_is_not_gone_on_with(tmp_path: Path) -> None:
    mb.arena([(pendulum(), 0.1)], resume=tmp_path, **FEW)
    mb.arena([(pendulum(), 0.1), (pendulum(0.5), 0.1)], resume=tmp_path, **FEW)  # more scenes of the same
    with pytest.raises(mb.OptionError, match="holds another arena"):
        mb.arena([(pendulum(), 0.1)], resume=tmp_path, runs=FEW["runs"], accuracies=[1e-5])


def test_scenes_of_a_folder(tmp_path: Path) -> None:
    text = ("import mbdae as mb\nt_end = 0.1\ndef scene():\n    s = mb.Scene('swing', gravity=(0, -9.81, 0))\n"
            "    s.revolute('A', s.ground, s.link('rod', (0, 0), (1, 0), mass=1.0), at=(0, 0))\n    return s\n")
    (tmp_path / "swing.py").write_text(text)
    (tmp_path / "other.py").write_text("x = 1\n")
    assert [e.name for e in mb.arena(tmp_path, **FEW).entries] == ["swing"]


def test_a_scene_that_cannot_be_compared_does_not_end_the_others() -> None:
    wrong = mb.Scene("wrong")
    wrong.revolute("A", wrong.ground, wrong.ground, at=(0, 0))
    a = mb.arena([(wrong, 0.1), (pendulum(), 0.1)], **FEW)
    assert "SceneError" in a.entries[0].error
    assert a.entries[1].comparison is not None
    assert "wrong: SceneError" in str(a)


@pytest.mark.parametrize(("given", "said"), [
    ({"scenes": 3}, "scenes = 3"), ({"scenes": []}, "there is none"), ({"scenes": [(pendulum(), "x")]}, "entry 1"),
    ({"count": 0}, "count = 0"), ({"seed": -1}, "seed = -1"), ({"workers": 0}, "workers = 0"),
    ({"engines": ["absent"]}, "absent"), ({"accuracies": [2]}, "accuracies")])
def test_wrong_options_are_refused_at_once(given: dict[str, Any], said: str) -> None:
    with pytest.raises(mb.OptionError) as error:
        mb.arena(**given)
    assert said in str(error.value)


# -- what the comparisons say together, on rows that are made up


def made(*rows: Row, difference: float = 1e-9) -> tuple[str, Any]:
    return "scene", SimpleNamespace(runs=rows, reference=SimpleNamespace(difference=difference), converged=())


def row(label: str, error: float, cpu: float, accuracy: float | None = None, engine: str = "", **more: Any) -> Row:
    return Row(label, label, "", None, accuracy, error=error, cpu_s=cpu, engine=engine, **more)


def test_profiles_compare_the_cheapest_runs_below_an_error() -> None:
    scenes = [made(row("A", 1e-6, 1.0, 1e-6), row("A", 1e-4, 0.1, 1e-4), row("x", 1e-6, 3.0, engine="other 1.0")),
              made(row("A", 1e-6, 4.0, 1e-6), row("x", 1e-2, 1.0, engine="other 1.0"), row("x", 1e-6, 2.0, engine="other 1.0"))]
    assert profiles(scenes, 1e-5, program) == {"mbdae": [1.0, 2.0], "other": [1.0, 3.0]}
    assert profiles(scenes, 1e-3, program)["other"] == [1.0, 30.0]


def test_what_is_silently_missed_is_counted_by_whom() -> None:
    scenes = [made(row("A", 5e-4, 1.0, 1e-6), row("A", 2e-6, 1.0, 1e-6),
                   row("x", 1e-3, 1.0, None, "other 1.0", setting="rtol 1e-06", rtol=1e-6),
                   row("y", 1e-1, 1.0, None, "other 1.0", setting="step 1e-03 s", rtol=1e-3),
                   row("z", 1e-1, 1.0, 1e-6, failure="it said so"))]
    found = {one["method"]: one for one in missed(scenes)}
    assert [one["method"] for one in missed(scenes)] == ["other x", "mbdae A"]
    assert found["mbdae A"]["silently missed"] == "1 of 2"
    assert found["other x"]["worst, times"] == "1000"
    assert missed([made(row("A", 5e-4, 1.0, 1e-6), difference=1e-3)]) == []  # the reference does not know better
    assert stays(scenes) == []
