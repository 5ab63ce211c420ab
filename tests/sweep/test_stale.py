"""What `resume=` keeps belongs to this job, scene and version, and is as it was stored; else it is refused or computed again."""

from __future__ import annotations

import functools
import json
import re
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.results.reads import reads

sys.path.insert(0, str(Path(__file__).parent))
import jobs

GRID = {"m": [1.0, 2.0, 3.0]}


class Weight:
    """A class of a job, with a constant of its own."""

    factor = 2.0

    def of(self, m: float) -> float:
        return self.factor * m


SCALE, PLACES, HELP = 9.81, np.arange(3.0), [lambda m: m + 1]


def helper(m: float) -> float:
    return HELP[0](m) * Weight().of(m) + float(PLACES.sum())


@functools.cache
def cached(m: float) -> float:
    return 0.0 * m


def job(m: float, power: float = 1.0) -> dict[str, Any]:
    return {"y": SCALE * helper(m) ** power + cached(m) + jobs.LAG}


def closing(c: float) -> Callable[..., dict[str, Any]]:
    def job(m: float) -> dict[str, Any]:
        return {"y": c * m}

    return job


def twice(m: float) -> dict[str, Any]:
    return {"y": [m for _ in range(2)]}


def thrice(m: float) -> dict[str, Any]:
    return {"y": [m for _ in range(3)]}


def swept(what: Any, file: Path, **options: Any) -> Any:
    with ThreadPoolExecutor(1) as threads:
        return mb.sweep(what, GRID, threads, resume=file, **options)


CHANGES: dict[str, Callable[[pytest.MonkeyPatch], Any]] = {
    "constant": lambda m: m.setitem(globals(), "SCALE", 9.82),
    "cached function": lambda m: m.setitem(globals(), "cached", functools.cache(lambda m: 1.0)),
    "constant of a module": lambda m: m.setattr(jobs, "LAG", 0.5),
    "array": lambda m: m.setitem(globals(), "PLACES", np.arange(4.0)),
    "helper": lambda m: m.setitem(globals(), "helper", lambda m: m),
    "function in a list": lambda m: m.setitem(globals(), "HELP", [lambda m: m + 2]),
    "attribute of a class": lambda m: m.setattr(Weight, "factor", 3.0),
    "method": lambda m: m.setattr(Weight, "of", lambda self, m: self.factor + m),
    "default": lambda m: m.setattr(job, "__defaults__", (2.0,)),
    "code": lambda m: m.setattr(job, "__code__", (lambda m, power=1.0: {"y": m}).__code__),
    "version": lambda m: m.setattr(sys.modules["mbdae.sweep"], "versions", lambda: {"mbdae": "0"}),
}


@pytest.mark.parametrize("what", CHANGES)
def test_a_changed_job_is_refused(what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    swept(job, tmp_path / "s")
    before = reads(job)
    CHANGES[what](monkeypatch)
    assert what == "version" or reads(job) != before
    with pytest.raises(mb.OptionError, match=r"holds another sweep: (reads|versions)"):
        swept(job, tmp_path / "s")


@pytest.mark.parametrize(("first", "second"), [
    (closing(1.0), closing(2.0)), (functools.partial(job, power=1.0), functools.partial(job, power=2.0)), (twice, thrice),
])
def test_another_job_is_refused(first: Any, second: Any, tmp_path: Path) -> None:
    swept(first, tmp_path / "s")
    with pytest.raises(mb.OptionError, match="holds another sweep"):
        swept(second, tmp_path / "s")


def test_the_same_job_goes_on_though_comments_and_lines_moved(tmp_path: Path) -> None:
    made = []
    for text in ("def job(m):\n    return {'y': 2 * m}\n", "\n\n# a comment\ndef job(m):\n\n    return {'y': 2 * m}  # twice\n"):
        space: dict[str, Any] = {"__name__": "jobs"}
        exec(text, space)
        made.append(reads(space["job"]))
    assert made[0] == made[1]


@pytest.mark.parametrize(("old", "new"), [('"y": ', '"y": NaN, "z": '), ('"y": ', '"y": 1'), ('"y": ', '"x": '), ("}\n", "\n")])
def test_an_edited_row_is_computed_again_and_named(old: str, new: str, tmp_path: Path) -> None:
    file = tmp_path / "s"
    first = swept(job, file)
    lines = file.read_text().splitlines(keepends=True)
    lines[2] = lines[2].replace(old, new, 1)
    file.write_text("".join(lines))
    named = r"the row of (point \d, \{.m.: \d\.0\},|a point) \(line 3\) was changed or damaged"
    with pytest.warns(mb.AccuracyWarning, match=named):
        again = swept(job, file)
    assert np.array_equal(again.array("y"), first.array("y"))
    assert np.array_equal(swept(job, file).array("y"), first.array("y"))  # and was stored: no warning any more


def test_a_row_of_another_sweep_is_not_taken_over(tmp_path: Path) -> None:
    swept(closing(1.0), tmp_path / "a")
    swept(closing(2.0), tmp_path / "b")
    lines = (tmp_path / "a").read_text().splitlines(keepends=True)
    lines[1] = (tmp_path / "b").read_text().splitlines(keepends=True)[1]
    (tmp_path / "a").write_text("".join(lines))
    with pytest.warns(mb.AccuracyWarning, match=r"the row of point \d"):  # rows are stored as they are done
        assert swept(closing(1.0), tmp_path / "a").array("y").tolist() == [1.0, 2.0, 3.0]


def test_nan_of_the_job_itself_stays(tmp_path: Path) -> None:
    nothing = closing(float("nan"))
    swept(nothing, tmp_path / "s")
    assert np.isnan(swept(nothing, tmp_path / "s").array("y")).all()


def pendulum(mass: float = 1.0) -> mb.Scene:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (1, 0), mass=mass), at=(0, 0))
    return s


def test_a_changed_part_of_a_scene_sweep_is_computed_again(tmp_path: Path) -> None:
    def run() -> Any:
        with ThreadPoolExecutor(1) as threads:
            return mb.sweep(pendulum(), {"rod.mass": [0.5, 2.0]}, threads, t_end=0.1, accuracy=1e-3, resume=tmp_path / "parts")

    first = run()
    part = next((tmp_path / "parts").glob("part*.npz"))
    with np.load(part) as stored:
        arrays = dict(stored)
    name = next(n for n, a in arrays.items() if a.ndim == 3)
    arrays[name] = arrays[name] + 1e-9
    np.savez(part, **arrays)
    with pytest.warns(mb.AccuracyWarning, match=rf"{part.name} of the points 0 to 1 was changed or damaged"):
        again = run()
    assert np.array_equal(again.array(again.names[0]), first.array(first.names[0]))


def test_an_edited_comparison_is_computed_again_from_there(tmp_path: Path) -> None:
    def run() -> Any:
        runs = [mb.Run(mb.RadauIIA(3), mb.GGL())]
        return mb.compare(pendulum(), 0.1, runs, accuracies=(1e-2, 1e-3), resume=tmp_path / "c.json")

    first = run()
    data = json.loads((tmp_path / "c.json").read_text())
    data["rows"][1]["error"] *= 1.001
    (tmp_path / "c.json").write_text(json.dumps(data))
    with pytest.warns(mb.AccuracyWarning, match=r"the run 'RadauIIA\(3\).*' at accuracy 0\.001 \(row 2\) was changed or damaged"):
        again = run()
    assert [r.error for r in again.runs] == pytest.approx([r.error for r in first.runs], rel=1e-6)
    data = json.loads((tmp_path / "c.json").read_text())
    data["references"][""]["reference"]["rtol"] = 1e-3
    (tmp_path / "c.json").write_text(json.dumps(data))
    with pytest.raises(mb.OptionError, match=r"c\.json' is damaged"):
        run()


def test_a_map_knows_the_function_of_its_scene_and_its_rows(tmp_path: Path) -> None:
    def run(scene: Any) -> Any:
        return mb.extremes(scene, 0.1, vary={"mass": [1.0, 2.0]}, runs=[mb.Run(mb.RadauIIA(3), mb.GGL())], accuracy=1e-3,
                           resume=tmp_path / "m.json")

    def other(mass: float = 1.0) -> mb.Scene:
        return pendulum(mass if mass == 1.0 else 5 * mass)

    first = run(pendulum)
    with pytest.raises(mb.OptionError, match="holds another map: scene function"):
        run(other)
    file = tmp_path / "m.json"
    file.write_text(re.sub(r'"error": ([\d.e-]+)', '"error": NaN', file.read_text(), count=1))
    with pytest.warns(mb.AccuracyWarning, match=r"'mass' = 1\.0 \(row 1\) was changed or damaged"):
        again = run(pendulum)
    assert [c.error for c in again.cells] == pytest.approx([c.error for c in first.cells], rel=1e-6)
