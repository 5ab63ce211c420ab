"""Sweeps: rows in order, failures kept, workers that die, resuming, a Dask cluster."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

import mbdae as mb

sys.path.insert(0, str(Path(__file__).parent))  # worker processes get this path from here
import jobs

GRID = {"a": [1, 2, 3], "b": np.linspace(0, 1, 2)}


def test_a_table_keeps_what_is_returned_under_the_name_of_another_column() -> None:
    pytest.importorskip("pandas")
    frame = mb.sweep(lambda a: {"a": 2 * a, "failure": 7}, {"a": [1, 2]}, ThreadPoolExecutor(1)).to_dataframe()
    assert list(frame["a"]) == [1, 2]
    assert list(frame["a returned"]) == [2, 4]
    assert list(frame["failure returned"]) == [7, 7]
    assert list(frame["failure"]) == ["", ""]


def test_rows_arrays_and_failures() -> None:
    seen: list[tuple[int, int]] = []
    found = mb.sweep(jobs.product, GRID, workers=2, progress=lambda done, total: seen.append((done, total)))
    assert found.complete
    assert [row.point for row in found.rows] == [{"a": a, "b": b} for a in (1, 2, 3) for b in (0.0, 1.0)]
    assert found.array("product") == pytest.approx(np.array([[0, 1], [np.nan, np.nan], [0, 3]]), nan_ok=True)
    assert found.array("pair").shape == (3, 2, 2)
    assert {row.error for row in found.failures} == {"ValueError: a = 2 is not wanted"}
    assert os.getpid() not in found.array("pid")
    assert seen == [(i, 6) for i in range(1, 7)]
    assert "ValueError: a = 2 is not wanted" in found.table()
    data = json.loads(found.to_json())
    assert data["rows"][5] == {"point": {"a": 3, "b": 1.0}, "values": found.rows[5].values, "error": None, "warnings": []}
    frame = found.to_dataframe()
    assert list(frame["product"].dropna()) == [0, 1, 0, 3]
    assert list(frame["pair[1]"].dropna()) == list(frame["b"][frame["a"] != 2])
    assert list(frame["failure"] == "") == list(frame["a"] != 2)
    with pytest.raises(mb.OptionError, match="key = 'sum' is no value of any row; they have pair, pid, product"):
        found.array("sum")


def test_what_a_job_is_told_in_a_worker_is_told_by_the_sweep(tmp_path: Path) -> None:
    """A force that its run does not cover: the warning of the worker is in the row, issued and kept, and counted in the table,
    which has the error of the peak beside it."""
    with pytest.warns(mb.AccuracyWarning, match="sweep: 1 point of 1 warned, .*B.force has an error of"):
        found = mb.sweep(jobs.largest_force, {"mass": [0.5]}, workers=1, resume=tmp_path / "rows")
    assert list(found.warnings) == [0]
    assert found.array("force error")[0] > 1e-3 * found.array("force")[0] > 0
    assert [line.split()[-1] for line in found.table().splitlines()] == ["warnings", "1"]
    assert json.loads(found.to_json())["rows"][0]["warnings"] == list(found.rows[0].warnings)
    assert mb.sweep(jobs.largest_force, {"mass": [0.5]}, workers=1, resume=tmp_path / "rows").warnings == found.warnings


def test_workers_use_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        monkeypatch.setenv(name, "2")
    assert mb.sweep(jobs.threads, {"number": [1]}).array("threads") == pytest.approx([1])


def test_list_of_points_and_any_executor() -> None:
    with ThreadPoolExecutor(2) as threads:
        found = mb.sweep(lambda x: {"double": 2 * x, "size": np.float64(x)}, [{"x": 2}, {"x": 1}, {"y": 3}], threads)
    assert found.array("double") == pytest.approx([4, 2, np.nan], nan_ok=True)
    assert found.failures[0].error.startswith("TypeError")  # type: ignore[union-attr]


@pytest.mark.parametrize("returned", [3.0, {1: 2}, {"z": 1j}, {"o": object()}])
def test_what_a_job_returns_is_checked(returned: Any) -> None:
    with ThreadPoolExecutor(1) as threads:
        found = mb.sweep(lambda x: returned, {"x": [1]}, threads)
    assert found.failures[0].error.startswith("TypeError: the job returned")  # type: ignore[union-attr]


@pytest.mark.parametrize("always", [pytest.param(0, marks=pytest.mark.slow), 1])
def test_a_worker_that_dies_costs_its_own_point(tmp_path: Path, always: int) -> None:
    found = mb.sweep(jobs.deadly, {"number": range(8), "folder": [str(tmp_path)], "always": [always]}, workers=2)
    squares = found.array("square").ravel()
    assert [row.point["number"] for row in found.failures] == ([3] if always else [])
    assert np.delete(squares, 3) == pytest.approx(np.delete(np.arange(8) ** 2, 3))
    assert jobs.calls(tmp_path).count(3) == 2
    if always:
        assert found.failures[0].died
        killed = "worker died: its process was killed by SIGKILL, as the system does where memory runs out"
        assert found.failures[0].error == killed


def test_what_an_executor_loses_is_computed_once_more() -> None:
    """As the one of Dask, which may ask a worker for a result that has just ended; what it loses again has failed."""
    class Losing(ThreadPoolExecutor):
        lost: ClassVar[list[int]] = []

        def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Any:
            number = args[1]["number"]
            if number in (3, 4) and (number == 4 or number not in self.lost):
                self.lost.append(number)
                future: Any = Future()
                future.set_exception(TypeError("cannot unpack a result"))
                return future
            return super().submit(fn, *args, **kwargs)

    def job(number: int) -> dict[str, Any]:
        return {"square": number * number}

    with Losing(2) as executor:
        found = mb.sweep(job, {"number": range(6)}, executor)
    assert [(row.point["number"], row.error) for row in found.failures] == [(4, "TypeError: cannot unpack a result")]
    assert Losing.lost == [3, 4, 4]
    assert sorted(row.values["square"] for row in found.rows if row.values) == [0, 1, 4, 9, 25]


def test_a_broken_executor_of_the_user_loses_no_row(tmp_path: Path) -> None:
    with ProcessPoolExecutor(1) as pool:
        found = mb.sweep(jobs.deadly, {"number": range(6), "folder": [str(tmp_path)], "always": [1]}, pool)
    assert found.complete
    assert all(row.died == (row.point["number"] >= 3) for row in found.rows)


def test_resume_computes_what_is_missing(tmp_path: Path) -> None:
    file, folder = tmp_path / "sweep.jsonl", tmp_path / "calls"
    folder.mkdir()
    grid = {"number": range(5), "folder": [str(folder)], "always": [1]}
    first = mb.sweep(jobs.deadly, grid, workers=1, resume=file)
    assert len(first.failures) == 1
    lines = file.read_text(encoding="utf-8").splitlines()
    file.write_text("\n".join(lines[:3]) + "\n" + lines[3][:7])  # stopped while the third row was written
    for mark in folder.iterdir():
        mark.unlink()
    kept = {json.loads(line)["number"] for line in lines[1:3]}
    again = mb.sweep(jobs.deadly, grid, workers=1, resume=file)
    assert set(jobs.calls(folder)) == set(range(5)) - kept
    assert [row.values for row in again.rows] == [row.values for row in first.rows]
    with pytest.raises(mb.OptionError, match=r"sweep: grid.number is \[0, 1, 2, 3, 4\] as stored and \[0, 1, 2, 3, 4, 5\]"):
        mb.sweep(jobs.deadly, grid | {"number": range(6)}, resume=file)
    with pytest.raises(mb.OptionError, match=r"sweep: job is \"jobs.deadly\" as stored and \"jobs.product\" in this call"):
        mb.sweep(jobs.product, grid, resume=file)
    file.write_text("{}\n")
    with pytest.raises(mb.OptionError, match="is not a sweep kept by resume"):
        mb.sweep(jobs.deadly, grid, resume=file)


def test_failed_points_again(tmp_path: Path) -> None:
    file = tmp_path / "sweep.jsonl"
    with ThreadPoolExecutor(1) as threads:
        for again, expected in ((False, 6), (False, 0), (True, 2)):
            seen: list[int] = []
            mb.sweep(jobs.product, GRID, threads, resume=file, again=again, progress=lambda done, total, s=seen: s.append(done))  # type: ignore[misc]
            assert len(seen) == expected


def test_ctrl_c_keeps_what_is_done(tmp_path: Path) -> None:
    def stop(done: int, total: int) -> None:
        if done == 2:
            signal.raise_signal(signal.SIGINT)

    grid = {"number": [0, 1, 2, 4, 5, 6], "folder": [str(tmp_path)], "always": [0], "wait": [0.2]}
    with pytest.raises(KeyboardInterrupt, match=r"2 of 6 points are done and kept in .*kept; the same call goes on") as stopped:
        mb.sweep(jobs.deadly, grid, workers=1, resume=tmp_path / "kept", progress=stop)
    found = stopped.value.solution  # type: ignore[attr-defined]
    assert not found.complete
    assert len(found.rows) == 2
    assert len((tmp_path / "kept").read_text(encoding="utf-8").splitlines()) == 3
    assert np.isnan(found.array("square")).sum() == 4


@pytest.mark.parametrize(
    ("job", "grid", "options", "message"),
    [
        (lambda x: {}, {"x": [1]}, {}, "cannot be sent to another process .* give a function at the top level of a file"),
        (3, {"x": [1]}, {}, "job = 3: give a mb.Scene, or a function"),
        (jobs.product, {}, {}, "grid has 0 names"),
        (jobs.product, {"a": []}, {}, "grid has 1 name and 0 points"),
        (jobs.product, [3], {}, r"grid = \[3\] has a wrong entry, 3 is not a dict"),
        (jobs.product, "ab", {}, "grid = 'ab' is not a list: give a mapping"),
        (jobs.product, GRID, {"workers": 0}, "workers = 0"),
        (jobs.product, GRID, {"resume": "/nowhere/x"}, "give a file in a folder that exists"),
        (partial(jobs.product, b=1), {"a": [print]}, {"resume": "x.jsonl"}, "points cannot be kept"),
    ],
)
def test_bad_options(job: Any, grid: Any, options: dict[str, Any], message: str, tmp_path: Path) -> None:
    if options.get("resume") == "x.jsonl":
        options = {"resume": tmp_path / "x.jsonl"}
    with pytest.raises(mb.OptionError, match=message):
        mb.sweep(job, grid, **options)


def test_a_script_without_guard_is_told(tmp_path: Path) -> None:
    script = tmp_path / "unguarded.py"
    script.write_text("import mbdae as mb\n\ndef job(x):\n    return {'x': x}\n\nmb.sweep(job, {'x': [1, 2]})\n")
    run = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=False)
    assert run.returncode == 1
    assert "OptionError: the worker processes do not start" in run.stderr
    assert run.stderr.rstrip().endswith("so keep what it runs under `if __name__ == '__main__':`")
    assert run.stderr.count("Traceback") == 1, "that of the script; workers end without a word"


def test_a_script_that_workers_cannot_import_is_told_with_their_message(tmp_path: Path) -> None:
    script = tmp_path / "once.py"
    script.write_text("import multiprocessing\n\nimport mbdae as mb\n\n"
                      "assert multiprocessing.current_process().name == 'MainProcess', 'once'\n\n"
                      "def job(x):\n    return {'x': x}\n\nif __name__ == '__main__':\n    mb.sweep(job, {'x': [1, 2]})\n")
    run = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=False)
    assert "AssertionError: once" in run.stderr
    assert run.stderr.rstrip().endswith("they import the script again, and end; their messages are printed above")


# ---- a cluster -------------------------------------------------------------------------------------------------------


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Address of a Dask scheduler, and its two workers: three processes of their own."""
    pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    address = f"tcp://127.0.0.1:{free_port()}"
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), str(Path(mb.__file__).parents[1])])}
    env |= {"PYTHONWARNINGS": "ignore"}

    def started(kind: str, *options: str) -> subprocess.Popen[bytes]:
        log = (tmp_path / f"{kind}.log").open("ab")
        return subprocess.Popen([sys.executable, "-m", "distributed.cli." + kind, *options], env=env, stdout=log, stderr=log)

    scheduler = started("dask_scheduler", "--host", address, "--no-dashboard", "--no-show", "--port", address.rsplit(":")[-1])
    one = ("--no-nanny", "--nthreads", "1", "--no-dashboard", "--local-directory", str(tmp_path), "--host", "127.0.0.1")
    workers = [started("dask_worker", address, *one) for _ in range(2)]
    yield address, workers
    for process in [*workers, scheduler]:
        process.kill()
        process.wait()


@pytest.mark.filterwarnings("ignore")
def test_a_dask_worker_killed_in_the_middle(cluster: Any, tmp_path: Path) -> None:
    from distributed import Client

    address, workers = cluster
    folder = tmp_path / "calls"
    folder.mkdir()
    with Client(address, timeout=30) as client:
        client.wait_for_workers(2, timeout=30)

        def kill() -> None:
            while len(jobs.calls(folder)) < 6:
                time.sleep(0.02)
            workers[0].kill()

        killer = threading.Thread(target=kill)
        killer.start()
        numbers = [*range(3), *range(4, 25)]
        grid = {"number": numbers, "folder": [str(folder)], "always": [0], "wait": [0.1]}
        found = mb.sweep(jobs.deadly, grid, client.get_executor(pure=False))
        killer.join()
        assert not found.failures
        assert found.array("square").ravel() == pytest.approx(np.array(numbers) ** 2)
        assert workers[0].wait(10) == -signal.SIGKILL
        assert len(client.scheduler_info()["workers"]) == 1
