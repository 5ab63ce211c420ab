"""Runs kept in a folder: every file that is written may be the last, what ended is not repeated, another call is refused."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import interrupted_scenes as scenes
import numpy as np
import pytest

import mbdae as mb
from mbdae.integrators import stored_runs
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.record import go_back, snapshot
from mbdae.integrators.stored_runs import packed, read_tree, write_tree
from mbdae.system import redundancy

OWN = [name for name, (_, _, options) in scenes.RUNS.items() if not ("solver" in options and options["solver"].restarts)]
SHORT = ["Radau IIA", "Radau IIA, impacts", "Radau IIA, stops", "Radau IIA, breaks and friction", "DOP853, breaks and friction",
         "DOP853, rows in force", "generalised-alpha", "CVODE"]
LONG = ("Radau IIA, stops", "DOP853, breaks and friction", "Radau IIA")  # another run has the same kinds of values to keep


class Killed(BaseException):
    """In place of the end of the process."""


@pytest.fixture
def written(monkeypatch):
    """Counts the files written, and ends the run after number `stop`; states: what was kept, by run, steps and whether the run
    was under way."""
    count = {"files": 0, "stop": 0, "states": {}}

    def counting(original):
        def write(self, *args):
            original(self, *args)
            if isinstance(args[0], dict):
                count["states"][self.name, args[0]["count"], args[0]["method"] is not None] = content(args[0])
            count["files"] += 1
            if count["files"] == count["stop"]:
                raise Killed

        return write

    for name in ("write", "write_chunk"):
        monkeypatch.setattr(stored_runs.RunFiles, name, counting(getattr(stored_runs.RunFiles, name)))
    return count


def content(state):
    """A digest of a state that was kept, but for times of computing."""
    state = state | {"stats": {name: value for name, value in state["stats"].items() if name not in ("cpu_s", "wall_s")}}
    arrays = {}
    text = json.dumps(packed(state, arrays))
    return hashlib.sha256(text.encode() + b"".join(np.ascontiguousarray(a).tobytes() for a in arrays.values())).hexdigest()


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n in LONG)) for n in SHORT])
def test_after_any_file_the_run_goes_on_with_the_same_bits(name, tmp_path, written):
    """The result, and every state kept on the way: masses of impacts and positions at which rows were looked at are among them,
    which change the result of few runs."""
    whole = scenes.run(name, tmp_path / "whole")
    files, states = written["files"], dict(written["states"])
    assert files > 5
    for i, stop in enumerate(np.unique(np.linspace(1, files - 1, 3).astype(int)).tolist()):
        written.update(files=0, stop=stop)
        with pytest.raises(Killed):
            scenes.run(name, tmp_path / str(i))
        written.update(files=0, stop=0, states={})
        assert scenes.run(name, tmp_path / str(i)) == whole
        assert written["states"].items() <= states.items()
        assert written["files"] < files or i == 0


def test_rows_change_again_where_they_changed_whatever_was_seen(tmp_path, monkeypatch):
    make, end, options = scenes.RUNS["Radau IIA, rows in force"]
    whole = make().simulate(end, checkpoint=tmp_path, **options)
    monkeypatch.setattr(redundancy, "SHARE", np.inf)  # what was looked at once is not looked at again
    again = make().simulate(end, checkpoint=tmp_path, **options)
    times = [t for t, _ in whole.solution.systems]
    assert len(times) > 2
    assert [t for t, _ in again.solution.systems] == times


@pytest.mark.parametrize("name", ["Radau IIA", "DOP853", "HHT", pytest.param("Radau IIA, clearance", marks=pytest.mark.slow),
                                  "a method of one's own"])  # fmt: skip)
def test_keeping_changes_no_bit_of_our_own_methods(name, tmp_path):
    assert name in OWN
    assert scenes.run(name, tmp_path / "kept") == scenes.run(name, None)


def test_what_ended_is_not_made_again(tmp_path, monkeypatch):
    """Companions, verification and the judgement: a call whose folder is complete makes no step."""
    whole = scenes.run("chosen, verified", tmp_path)

    def refuse(*_):
        raise AssertionError("a step")

    monkeypatch.setattr("mbdae.integrators.dop853.DOP853.integrate", refuse)
    monkeypatch.setattr("mbdae.integrators.radau.CollocationMethod.integrate", refuse)
    monkeypatch.setattr("mbdae.run.job.assessed", refuse)
    monkeypatch.setattr("mbdae.run.job.rechecked", refuse)
    assert scenes.run("chosen, verified", tmp_path) == whole


def test_a_run_that_failed_fails_in_the_same_way(tmp_path):
    s = scenes.chain()
    told = []
    for _ in range(2):
        with pytest.raises(mb.SolverError) as failed:
            s.simulate(30.0, solver=mb.HHT(step=1.0), checkpoint=tmp_path)
        told.append((str(failed.value), failed.value.time, failed.value.solution.solution.y.tobytes()))
    assert told[0] == told[1]


@pytest.mark.parametrize(("change", "told"), [
    ({"accuracy": 1e-5}, r"holds another run: accuracy is 1e-06 as stored and 1e-05 in this call"),
    ({"every": 7}, r"holds another run: every is 1000 as stored and 7 in this call"),
    ({"solver": mb.IDA()}, r"holds another run: solver is .* as stored and \"IDA"),
    ({"form": mb.Index3()}, r"holds another run: form is"), ({"t_end": 0.3}, "holds another run: t_end is 0.2 as stored and 0.3"),
    ({"outputs": 7}, "holds another run: outputs is"), ({"verify": True}, "holds another run: verify is false as stored"),
])
def test_another_call_is_refused(change, told, tmp_path):
    call = {"t_end": 0.2, "solver": mb.RadauIIA(3)}
    scenes.chain().simulate(**call, checkpoint=tmp_path)
    with pytest.raises(mb.OptionError, match=told):
        scenes.chain().simulate(**call | change, checkpoint=tmp_path)


def test_another_scene_or_version_is_refused(tmp_path):
    scenes.chain().simulate(0.2, checkpoint=tmp_path)
    with pytest.raises(mb.OptionError, match=r"holds another run: scene\.name is \"two rods\" as stored"):
        scenes.stick_slip().simulate(0.2, checkpoint=tmp_path)
    place = tmp_path / "statement.json"
    stated = json.loads(place.read_text(encoding="utf-8"))
    stated["call"]["versions"]["mbdae"] = "0.0.9"
    place.write_text(json.dumps(stated), encoding="utf-8")
    with pytest.raises(mb.OptionError, match=r'versions.mbdae is "0.0.9" as stored'):
        scenes.chain().simulate(0.2, checkpoint=tmp_path)
    place.write_text("{", encoding="utf-8")
    with pytest.raises(mb.OptionError, match="cannot be read"):
        scenes.chain().simulate(0.2, checkpoint=tmp_path)


def test_bad_folders(tmp_path):
    file = tmp_path / "file"
    file.write_text("x", encoding="utf-8")
    for given, told in ((file, "is no folder"), (tmp_path, "holds other files"), (3, "checkpoint = 3 is not a path")):
        with pytest.raises(mb.OptionError, match=told):
            scenes.chain().simulate(0.2, checkpoint=given)
    with pytest.raises(mb.OptionError, match="every = 5 without a checkpoint"):
        scenes.chain().simulate(0.2, every=5)
    with pytest.raises(mb.OptionError, match="every = 0"):
        scenes.chain().simulate(0.2, checkpoint=tmp_path / "new", every=0)


@pytest.mark.parametrize("solver", [mb.RadauIIA(3), None], ids=["named", "chosen"])
@pytest.mark.parametrize("name", ["run00001.state", "value00001"])
def test_a_damaged_file_is_told(name, solver, tmp_path):
    """Also by a call that tries another solver where one fails: a damaged file is no failure of a solver."""
    scenes.chain().simulate(0.2, solver=solver, checkpoint=tmp_path)
    state = tmp_path / f"{name}.npz"
    state.write_bytes(state.read_bytes()[:100])
    with pytest.raises(mb.OptionError, match=rf"{name}.npz' cannot be read or is damaged"):
        scenes.chain().simulate(0.2, solver=solver, checkpoint=tmp_path)


def test_files_of_a_killed_process_are_removed(tmp_path):
    scenes.chain().simulate(0.2, checkpoint=tmp_path)
    left = tmp_path / ".0123456789abcdef.npz"
    left.touch()
    scenes.chain().simulate(0.2, checkpoint=tmp_path)
    assert not left.exists()


SCRIPT = """
import sys
import mbdae as mb
import interrupted_scenes as scenes
from mbdae.integrators import stored_runs as keeper
keeper.PAUSE = 0.0
def tell(t, t_end, stats):
    print(t, flush=True)
make, end, options = scenes.RUNS["IDA"] if sys.argv[2] == "ida" else scenes.RUNS["Radau IIA"]
scenes.chain().simulate(1000.0, checkpoint=sys.argv[1], progress=tell, every=50, **options)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs signals of POSIX")
@pytest.mark.parametrize("which", ["radau", "ida"])
def test_sigterm_ends_a_script_with_a_plain_message(which, tmp_path):
    path = os.pathsep.join([str(Path(mb.__file__).parents[1]), str(Path(scenes.__file__).parent)])
    run = subprocess.Popen([sys.executable, "-c", SCRIPT, str(tmp_path / "kept"), which], stdout=subprocess.PIPE,
                           stderr=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": path})
    assert run.stdout is not None
    while float(run.stdout.readline()) < 1.0:
        pass
    run.terminate()
    said = run.communicate(timeout=60)[1]
    assert run.returncode == 1
    assert f"StoppedError: stopped by SIGTERM: what was computed is kept in '{tmp_path / 'kept'}'" in said
    assert list((tmp_path / "kept").glob("run00001.0*.npz"))
    handler = signal.getsignal(signal.SIGTERM)
    scenes.chain().simulate(0.1, checkpoint=tmp_path / "other")
    assert signal.getsignal(signal.SIGTERM) is handler


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs signals of POSIX")
def test_sigterm_waits_for_a_value_that_is_written(tmp_path, monkeypatch):
    original = stored_runs.write_tree

    def write(path, tree):
        if path.name.startswith("value"):
            os.kill(os.getpid(), signal.SIGTERM)
        original(path, tree)

    monkeypatch.setattr(stored_runs, "write_tree", write)
    with pytest.raises(mb.StoppedError):
        scenes.chain().simulate(0.2, solver=mb.RadauIIA(3), checkpoint=tmp_path)
    assert (tmp_path / "value00001.npz").exists()


def test_a_law_of_ones_own_that_changed_is_refused(tmp_path):
    def scene(power):
        class Own(mb.Force):
            params = mb.params(c=("N/m", "stiffness"))

            def energy(self, k, l):
                d = l.r - k.r
                return self.c * (1 + d @ d) ** power

        Own.__qualname__ = "Own"
        s = mb.Scene("own", gravity=(0, -9.81, 0))
        s.add(Own("S", s.ground, s.point_mass("bob", 1.0, at=(1, 0)), at=(1, 0), c=20.0))
        return s

    scene(1).simulate(0.1, checkpoint=tmp_path)
    with pytest.raises(mb.OptionError, match=r"holds another run: laws"):
        scene(2).simulate(0.1, checkpoint=tmp_path)


def test_trees_hold_every_bit(tmp_path):
    tree = {"a": [1, -0.0, np.inf, None, True, "x"], "b": (np.array([np.nan, 5e-324]), np.arange(3)), "c": {"d": ()}}
    write_tree(tmp_path / "t.npz", tree)
    found = read_tree(tmp_path / "t.npz")
    assert repr(found["a"]) == repr(tree["a"])
    assert found["b"][0].tobytes() == tree["b"][0].tobytes()
    assert found["b"][1].dtype == tree["b"][1].dtype
    assert found["c"] == {"d": ()}


def test_what_a_snapshot_of_radau_holds():
    """All that its table in C counts: what is forgotten here shows in the bits of the runs above, if they use it."""
    held = {}

    class Looking(RadauIIA):
        def integrate(self, system, loop, h0):
            loop.keep = lambda method: held.update(last=snapshot(method), method=method)
            super().integrate(system, loop, h0)

    Looking(3, rtol=1e-6).solve(scenes.chain().system("ggl"), 20.0)
    run = held["last"]["object"]["step"]["object"]["run"]["object"]
    numbers = {"h", "accepted", "accepted_error", "last_h", "factored", "stale", "fresh", "rejected", "noise"}
    assert numbers <= set(run["table"]["object"])
    assert {"y", "yp", "last"} <= set(run)
    go_back(held["method"], held["last"])
