"""Sweeps over numbers of a scene: points of batches are those of scenes of their own; killed workers, folders, clusters."""

from __future__ import annotations

import itertools
import os
import pickle
import signal
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import mbdae as mb
from mbdae.sweep import scene_sweep
from mbdae.sweep.scene_sweep import Points
from mbdae.sweep.statements import changed

GRID = {"a.mass": [0.5, 1.0, 1.7], "b.mass": [0.4, 0.7]}
OUTPUTS = [0.5, 1.0]


def arm(damper=0.3):
    s = mb.Scene("arm", gravity=(0, -9.81, 0))
    a, b = s.link("a", (0, 0), (1, 0), mass=1.0), s.link("b", (1, 0), (2, 0), mass=0.7)
    s.revolute("A", s.ground, a, at=(0, 0), damper=damper)
    s.revolute("B", a, b, at=(1, 0), damper=0.2, spring=2.5)
    return s


def here(scene, grid, **options):
    """In this process."""
    with ThreadPoolExecutor(1) as threads:
        return mb.sweep(scene, grid, threads, t_end=1.0, outputs=OUTPUTS, **options)


def test_points_of_a_batch_are_those_of_their_own_scenes():
    """A mass brings the inertia with it, as in maps of extremes."""
    found = here(arm(), GRID, accuracy=1e-8)
    assert found.batched
    assert found.array("B.angle").shape == (3, 2, 2)
    assert not found.failures
    assert np.nanmax(found.estimate) < 1e-8
    for (i, a), (j, b) in itertools.product(enumerate(GRID["a.mass"]), enumerate(GRID["b.mass"])):
        scene = changed(changed(arm(), "a.mass", a)[0], "b.mass", b)[0]
        r = scene.simulate(1.0, accuracy=1e-9, outputs=OUTPUTS)
        np.testing.assert_allclose(found.array("B.angle")[i, j], r["B"].angle, atol=1e-7)
    assert found.point(3) == {"a.mass": 1.0, "b.mass": 0.7}


@pytest.mark.parametrize(("grid", "why"), [
    ({"B.damper": [0.1, 0.2]}, "part of a constant"), ({"A.spring": [1.0]}, None), ({"b.mass": [0.0, 1.0]}, ""),
])  # fmt: skip
def test_what_no_batch_takes_is_run_point_by_point(grid, why):
    if why is None:
        with pytest.raises(mb.OptionError, match="spring"):
            here(arm(), grid)
        return
    found = here(arm(), grid)
    assert not found.batched
    assert why in found.why
    r = changed(arm(), next(iter(grid)), next(iter(grid.values()))[1])[0].simulate(1.0, outputs=OUTPUTS)
    np.testing.assert_allclose(found.array("B.angle")[1], r["B"].angle, atol=1e-5)


def test_an_effect_that_the_laws_do_not_show_is_seen(monkeypatch):
    """Numbers that equations do not read are left out only where the equations are the same without them."""
    monkeypatch.setattr("mbdae.run.batch.Batches._read", lambda self, name: name not in ("b.Jyy", "b.Jzz"))
    found = here(arm(), {"b.mass": [0.4, 0.7]})
    assert not found.batched
    assert "differ by" in found.why


def test_a_point_that_fails_is_named(monkeypatch):
    found = here(arm(), [{"b.mass": 0.5}, {"b.mass": -1.0}, {"b.mass": 0.6}])
    assert list(found.failures) == [1]
    assert "mass" in found.failures[1]
    assert np.isnan(found.array("A.angle")).all(axis=1).tolist() == [False, True, False]


def lethal(folder, job, values):
    """Kills its process where the third mass is among the points, the first time or always."""
    from mbdae.sweep.scenes import solved

    mark = Path(folder) / "killed"
    if (np.abs(values[:, 0] - 1.7) < 1e-9).any() and (Path(folder) / "always" in Path(folder).iterdir() or not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return solved(job, values)


@pytest.mark.parametrize("always", [False, True])
def test_a_killed_worker_costs_its_points_only(always, tmp_path, monkeypatch):
    """They are computed again; with what kills always, the part is divided until the guilty point is alone."""
    if always:
        (tmp_path / "always").touch()
    masses = np.append(np.linspace(0.5, 1.6, 11), 1.7)
    whole = here(arm(), {"a.mass": masses})
    monkeypatch.setattr(scene_sweep, "solved", partial(lethal, str(tmp_path)))
    found = mb.sweep(arm(), {"a.mass": masses}, t_end=1.0, workers=2)
    assert list(found.failures) == ([11] if always else [])
    assert found.complete
    kept = slice(0, 11 if always else 12)
    assert np.array_equal(found.array("A.angle")[kept, -1], whole.array("A.angle")[kept, -1])
    if always:
        assert found.failures[11].startswith("worker died: its process was killed by SIGKILL")


def test_a_folder_keeps_parts_and_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(scene_sweep, "PART", 2)
    whole = here(arm(), GRID, resume=tmp_path / "whole").array("A.rate")

    def stop(done, total):
        if done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match="4 of 6 points are done and kept in") as stopped:
        here(arm(), GRID, resume=tmp_path / "kept", progress=stop)
    assert stopped.value.solution.missing() == [(4, 6)]
    seen = []
    again = here(arm(), GRID, resume=tmp_path / "kept", progress=lambda done, total: seen.append(done))
    assert seen == [6]
    assert again.array("A.rate").tobytes() == whole.tobytes()
    assert all(isinstance(part, Path) for part in again._parts.values())  # on the disk, not in memory
    with pytest.raises(mb.OptionError, match="holds another sweep: "):
        here(arm(), GRID | {"b.mass": [0.4, 0.8]}, resume=tmp_path / "kept")


def test_failed_points_again(tmp_path):
    points = [{"b.mass": 0.5}, {"b.mass": -1.0}]
    for again, seen in ((False, 1), (False, 0), (True, 1)):
        told = []
        here(arm(), points, resume=tmp_path, again=again, progress=lambda done, total, t=told: t.append(done))
        assert len(told) == seen


@pytest.mark.parametrize(("grid", "options", "told"), [
    ({}, {}, "grid has 0 names"), ({"a.mass": []}, {}, "grid has 1 names"), ({"nobody.mass": [1.0]}, {}, "no item 'nobody'"),
    ([{"a.mass": 1.0}, {"b.mass": 1.0}], {}, "give a mapping of names such as"), (GRID, {"t_end": None}, "t_end"),
    (GRID, {"accuracy": 3}, "accuracy = 3"), (GRID, {"outputs": [5.0]}, "outputs"), (GRID, {"workers": 0}, "workers = 0"),
])  # fmt: skip
def test_bad_options(grid, options, told):
    with pytest.raises(mb.OptionError, match=told):
        mb.sweep(arm(), grid, **{"t_end": 1.0} | options)
    with pytest.raises(mb.OptionError, match="t_end and outputs are for a sweep of a scene"):
        mb.sweep(arm, {"damper": [0.1]}, t_end=1.0)


def test_points_are_not_listed():
    """The outer product is never made as a whole."""
    points = Points.of({name: np.linspace(0, 1, 1000) for name in ("a", "b", "c")})
    assert len(points) == 10**9
    np.testing.assert_allclose(points.values(10**9 - 2, 10**9), [[1, 1, 998 / 999], [1, 1, 1]])
    assert len(pickle.dumps(points)) < 30_000


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_on_a_real_cluster_whose_worker_is_killed(tmp_path):
    """Dask with two worker processes on this machine, one of which is killed."""
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    masses = {"a.mass": np.linspace(0.5, 2, 60), "b.mass": np.linspace(0.4, 0.9, 50)}
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with distributed.LocalCluster(**options, local_directory=str(tmp_path)) as cluster, distributed.Client(cluster) as client:
        pids = list(client.run(os.getpid).values())
        killed = []

        def kill(done, total):
            if not killed:
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)

        executor = client.get_executor(pure=False)
        found = mb.sweep(arm(), masses, executor, t_end=1.0, resume=tmp_path / "kept", progress=kill)
    assert killed
    assert found.complete
    assert not found.failures
    assert found.array("A.angle").tobytes() == mb.sweep(arm(), masses, t_end=1.0, workers=1).array("A.angle").tobytes()
