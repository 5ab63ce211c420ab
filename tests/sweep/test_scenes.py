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
import sympy

import mbdae as mb
from mbdae.study.statements import changed
from mbdae.sweep import scene_sweep
from mbdae.sweep.scenes import Points

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


def test_derivatives_are_columns_of_every_run(tmp_path):
    """Of one point they are those of its run; errors and shapes are those of the grid; a point that fails has none."""
    grid, asked = {"a.mass": [0.5, 1.7, -1.0]}, {"of": ["A.force", "B.angle"], "derivatives": ["b.mass", "a.mass"]}
    found = here(arm(), grid, accuracy=1e-6, resume=tmp_path, **asked)
    value, error = found.derivatives("A.force", "b.mass")
    assert value.shape == (3, 2, 3)
    assert error.shape == (3,)
    r = changed(arm(), "a.mass", 1.7)[0].simulate(1.0, accuracy=1e-6, outputs=OUTPUTS, derivatives=True)
    own = r.sensitivity("A.force", to="b.mass")["A.force", "b.mass"]
    np.testing.assert_allclose(value[1], own.value, atol=own.error + error[1])
    assert error[1] < 1e-5 * np.abs(value[1]).max()
    assert np.isnan(value[2]).all()
    assert np.isnan(error[2])
    frame = found.to_dataframe()  # at the last output
    np.testing.assert_array_equal(frame["d A.force[1]/d b.mass"], value[:, -1, 1])
    np.testing.assert_array_equal(frame["d A.force/d b.mass error"], error)
    np.testing.assert_array_equal(frame["d B.angle/d a.mass"], found.derivatives("B.angle", "a.mass").value[:, -1])
    again = here(arm(), grid, accuracy=1e-6, resume=tmp_path, **asked)
    np.testing.assert_array_equal(again.derivatives("B.angle", "a.mass").value, found.derivatives("B.angle", "a.mass").value)
    with pytest.raises(mb.OptionError, match="there are no derivatives of"):
        found.derivatives("B.angle", "g.mass")
    for wrong in ({"derivatives": ["b.mass"]}, {"of": ["B.angle"], "derivatives": ["nobody.mass"]}):
        with pytest.raises(mb.OptionError):
            here(arm(), grid, **wrong)


def test_quantities_are_read_of_every_run_with_their_peaks(tmp_path):
    grid = {"a.mass": [0.5, 1.7, -1.0]}
    found = here(arm(), grid, accuracy=1e-6, of=["A.force", "B.angle - A.angle"], resume=tmp_path)
    assert not found.batched
    assert found.array("A.force").shape == (3, 2, 3)
    r = changed(arm(), "a.mass", 1.7)[0].simulate(1.0, accuracy=1e-9, outputs=OUTPUTS)
    off, errors = np.max(np.linalg.norm(found.array("A.force")[1] - r["A"].force, axis=1)), found.errors("A.force")
    assert off <= errors[1] < 2e-5  # of 43 N
    assert np.isfinite(errors[0])
    assert np.isnan(errors[2])
    value, t, error = (column[1] for column in found.peaks("B.angle - A.angle"))
    best = r.peak("B.angle - A.angle")
    assert abs(value - best.value) <= error < 1e-6
    assert t == pytest.approx(best.t, abs=1e-4)
    assert np.isnan(found.peaks("A.force").value[2])
    frame = found.to_dataframe()
    assert list(frame.columns) == ["a.mass", "estimate", "A.force peak", "A.force t", "A.force error", "B.angle - A.angle peak",
                                   "B.angle - A.angle t", "B.angle - A.angle error", "failure", "warnings"]
    assert "mass = -1 kg is negative" in frame["failure"][2]
    again = here(arm(), grid, accuracy=1e-6, of=["A.force", "B.angle - A.angle"], resume=tmp_path)
    np.testing.assert_array_equal(again.array("A.force"), found.array("A.force"))
    with pytest.raises(mb.OptionError, match="was not asked for"):
        found.errors("A.torque")
    assert "there is no sensor" in here(arm(), {"a.mass": [1.0]}, of="A.nothing").failures[0]


@pytest.mark.parametrize("grid", [
    {"B.damper": [0.1, 0.2]}, {"B.spring": [0.5, 3.0], "A.damper": [0.2, 0.4]}, {"a.mass": [0.5, 1.2], "B.spring": [1.5, 4.0]},
])
def test_stiffness_and_damping_vary_in_batches(grid):
    """They are constants of the equations of a single run."""
    found = here(arm(), grid, accuracy=1e-8)
    assert found.batched
    values = found.array("B.angle").reshape(len(found.grid), -1)
    for i, row in enumerate(values):
        scene = arm()
        for name, value in found.point(i).items():
            scene = changed(scene, name, value)[0]
        np.testing.assert_allclose(row, scene.simulate(1.0, accuracy=1e-9, outputs=OUTPUTS)["B"].angle, atol=1e-7)
    assert np.ptp(values[:, -1]) > 1e-3


@pytest.mark.parametrize(("grid", "why"), [
    ({"A.spring": [1.0]}, None), ({"b.mass": [0.0, 1.0]}, ""),
])
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


@pytest.mark.parametrize(("grid", "wrong"), [
    ({"a.mass": [-1.0, 0.5], "b.mass": [0.4, 0.7]}, [0, 1]), ({"b.mass": [0.4, -0.7], "a.mass": [0.5]}, [1]),
    ({"A.damper": [-1.0, 0.05], "b.mass": [0.5]}, [0]), ([{"a.mass": -1.0, "B.spring": 2.0, "b.mass": 0.5}], [0]),
])
def test_a_wrong_value_of_any_name_fails_as_simulate_refuses_it(grid, wrong):
    """A statement with a wrong value is kept with another value in its place: the next name may not be changed in that scene."""
    found = here(arm(), grid)
    assert list(found.failures) == wrong
    assert np.flatnonzero(np.isnan(found.estimate)).tolist() == wrong
    for i, told in found.failures.items():
        bad = next(name for name, value in found.point(i).items() if value < 0)
        with pytest.raises(mb.SceneError) as refused:
            changed(arm(), bad, found.point(i)[bad])[0].simulate(1.0)
        assert told == f"SceneError: {refused.value}"


@pytest.mark.parametrize("grid", [{"b.mass": [0.7, -1.0, 0.7]}, {"b.mass": [0.7, -1.0, 0.7], "a.mass": [1.0, 2.0]}])
def test_wrong_values_among_others_are_seen_in_no_batch(grid):
    """The same first and last value: what is between them decides too."""
    found = here(arm(), grid)
    wrong = [i for i in range(len(found.grid)) if found.point(i)["b.mass"] < 0]
    assert list(found.failures) == wrong
    assert not found.batched
    assert "mass = -1 kg is negative" in found.why


def test_values_that_are_wrong_only_together_are_seen():
    """Moments of inertia of which two are together less than the third: each of them is right beside the others' usual values."""
    s = mb.Scene("top")
    body = s.rigid_body("b", 1.0, [0.5, 0.5, 0.6], at=(1, 0, 0))
    s.revolute("S", s.ground, body, at=(0, 0, 0), axis=(0, 1, 1))
    pairs = [(0.5, 0.5), (0.2, 0.5), (0.5, 0.2), (0.2, 0.2), (0.5, 0.5), (0.5, 0.45)]
    found = here(s, [dict(zip(("b.inertia.0", "b.inertia.1"), pair, strict=True)) for pair in pairs])
    assert list(found.failures) == [3]
    assert "triangle inequality" in found.failures[3]
    assert "triangle inequality" in found.why
    right = here(s, [dict(zip(("b.inertia.0", "b.inertia.1"), pair, strict=True)) for pair in pairs if min(pair) > 0.2])
    assert right.batched, right.why


def test_a_wrong_scene_is_refused():
    s = arm()
    s.link("c", (0, 0), (0, 1), mass=-1.0)
    with pytest.raises(mb.SceneError, match="link 'c': mass = -1 kg is negative"):
        here(s, {"a.mass": [1.0, 2.0]})
    with pytest.raises(mb.OptionError, match=r"executor = 1\.0: .* the end of runs of a scene is t_end="):
        mb.sweep(arm(), {"a.mass": [1.0, 2.0]}, 1.0)


@pytest.mark.parametrize("i", [7, -1, 2, 0.5, "a"])
def test_points_that_are_not_there(i):
    found = here(arm(), {"b.mass": [-1.0, -2.0]})
    assert found.point(1) == {"b.mass": -2.0}
    with pytest.raises(mb.OptionError, match="give the number of a point, from 0 to 1"):
        found.point(i)


def test_where_every_point_failed_all_is_missing():
    found = here(arm(), {"b.mass": [-1.0, -2.0], "a.mass": [1.0]})
    assert list(found.failures) == [0, 1]
    assert found.array("A.angle").shape == (2, 1, 2)
    assert np.isnan(found.array("A.angle")).all()
    assert len(repr(found).splitlines()) == 1
    with pytest.raises(mb.OptionError, match=r"'A\.angel' is no unknown of these runs, .*: there are A"):
        here(arm(), {"b.mass": [-1.0, 1.0]}).array("A.angel")


def test_a_list_of_numbers_is_scaled_whatever_kind_of_list_it_is():
    """The points of a link are any number of arguments."""
    scene = changed(arm(), "b.points", 4.0)[0]
    assert scene.statements[1][1] == ["b", [2.0, 0.0, 0.0], [4.0, 0.0, 0.0]]


def lethal(folder, job, values):
    """Kills its process where the third mass is among the points, the first time or always."""
    from mbdae.sweep.scenes import solved

    mark = Path(folder) / "killed"
    if (np.abs(values[:, 0] - 1.7) < 1e-9).any() and (Path(folder) / "always" in Path(folder).iterdir() or not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return solved(job, values)


@pytest.mark.parametrize("always", [False, pytest.param(True, marks=pytest.mark.slow)])
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
    assert stopped.value.solution.missing() in ([(0, 2)], [(2, 4)], [(4, 6)])  # parts end in any order
    seen = []
    again = here(arm(), GRID, resume=tmp_path / "kept", progress=lambda done, total: seen.append(done))
    assert seen == [6]
    assert again.array("A.rate").tobytes() == whole.tobytes()
    assert all(isinstance(part, Path) for part in again._parts.values())  # on the disk, not in memory
    with pytest.raises(mb.OptionError, match=r"holds another sweep: grid.b.mass\[1\] is 0.7 as stored and 0.8 in this call"):
        here(arm(), GRID | {"b.mass": [0.4, 0.8]}, resume=tmp_path / "kept")
    with pytest.raises(mb.OptionError, match=r"revolute 'A', number 3.damper is 0.3 as stored and 0.9 in this call"):
        here(arm(damper=0.9), GRID, resume=tmp_path / "kept")


def test_parts_of_another_sweep_are_not_taken(tmp_path):
    """Every part says of which sweep it is, whatever became of the statement beside it."""
    first = here(arm(), GRID, resume=tmp_path).array("A.angle")
    (tmp_path / "statement.json").unlink()
    with pytest.raises(mb.OptionError, match=r"holds another sweep: part00000000-00000006\.npz is not of this one"):
        here(arm(damper=0.9), GRID, resume=tmp_path)
    assert not (tmp_path / "statement.json").exists()  # the folder does not become one of the other sweep
    seen = []
    again = here(arm(), GRID, resume=tmp_path, progress=lambda done, total: seen.append(done))
    assert not seen
    assert again.array("A.angle").tobytes() == first.tobytes()


def test_failed_points_again(tmp_path):
    points = [{"b.mass": 0.5}, {"b.mass": -1.0}]
    for again, seen in ((False, 1), (False, 0), (True, 1)):
        told = []
        here(arm(), points, resume=tmp_path, again=again, progress=lambda done, total, t=told: t.append(done))
        assert len(told) == seen


@pytest.mark.parametrize(("grid", "options", "told"), [
    ({}, {}, "grid has 0 names"), ({"a.mass": []}, {}, r"grid: 'a.mass' = \[\] is an empty list"),
    ({"nobody.mass": [1.0]}, {}, "no item 'nobody'"),
    ({"a": [1, 2]}, {}, "'a' names no number; add one"), ({"a.mass": 1.0}, {}, "'a.mass' = 1.0 is no list of numbers"),
    ({"a.mass": None}, {}, "= None is no list"), ({"a.mass": "12"}, {}, "= '12' is no list"), ({1: [2.0]}, {}, "1 is not text"),
    ({"a.mass": [[1, 2], [3, 4]]}, {}, r"has shape \(2, 2\), not that of a plain list"), ([{}], {}, "grid has 0 names"),
    ([{"a.mass": [1, 2]}], {}, r"'a.mass' = \[1, 2\] is not a number"),
    ([{"a.mass": 1.0}, {"b.mass": 1.0}], {}, "give a mapping of names such as"), (GRID, {"t_end": None}, "t_end"),
    (GRID, {"accuracy": 3}, "accuracy = 3"), (GRID, {"outputs": [5.0]}, "outputs"), (GRID, {"workers": 0}, "workers = 0"),
])
def test_bad_options(grid, options, told):
    with pytest.raises(mb.OptionError, match=told):
        mb.sweep(arm(), grid, **{"t_end": 1.0} | options)
    with pytest.raises(mb.OptionError, match=r"t_end = 1\.0 is for sweeps of a scene"):
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


def sampled(t, angle, rate, memory):
    return 30 * (0.5 - angle) - 4 * rate + memory, memory + 0.01 * (0.5 - angle)


def driven(kind):
    """An arm of one link under loads of which no batch takes some."""
    s = mb.Scene("driven", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    feedback = 30 * (0.5 - s.sensor("J.angle")) - 4 * s.sensor("J.rate")
    if kind in ("controller", "lambda"):
        f = sampled if kind == "controller" else lambda t, angle, rate, memory: (30 * (0.5 - angle) - 4 * rate, memory)
        s.controller("c", f, every=0.01, reads=["J.angle", "J.rate"], sets=["u"], memory=0.0)
    pieces = sympy.Piecewise((0, mb.t < 0.3), (2, True))
    torque = {"feedback": feedback, "limited": sympy.Max(-5, sympy.Min(5, feedback)), "piecewise": pieces,
              "table": mb.table([0, 0.3, 0.6, 2], [0, 5, -3, 0])}.get(kind, "u")
    s.revolute("J", s.ground, rod, at=(0, 0), torque=torque)
    return s


@pytest.mark.parametrize("kind", ["feedback", "limited", "piecewise", "table", "controller", "lambda"])
def test_scenes_under_control_are_swept(kind):
    found = here(driven(kind), {"rod.mass": [0.5, 2.0]})
    assert found.batched == (kind == "feedback")
    assert not found.failures
    for i, mass in enumerate((0.5, 2.0)):
        own = changed(driven(kind), "rod.mass", mass)[0].simulate(1.0, outputs=OUTPUTS)
        np.testing.assert_allclose(found.array("J.angle")[i], own["J"].angle, atol=1e-5)


def test_what_cannot_be_sent_to_processes_is_refused_before_solving():
    with pytest.raises(mb.OptionError, match=r"scene 'driven' cannot be sent to another process .*ThreadPoolExecutor\(\)"):
        mb.sweep(driven("lambda"), {"rod.mass": [0.5, 2.0]}, t_end=1.0)
    found = mb.sweep(driven("controller"), {"rod.mass": [0.5, 2.0]}, t_end=0.1, workers=1)
    assert not found.failures
