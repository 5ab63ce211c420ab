"""Worker processes: none outlives its parent however that ends, and Ctrl-C is told once."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

SCRIPT = """
import os, sys, time
from pathlib import Path
import mbdae as mb

def job(number, how):
    Path(f"worker.{os.getpid()}").touch()
    Path(f"point.{number}").touch()
    if how == "sleeps" and number > 1:
        time.sleep(60)
    if how == "computes" and number > 1:
        sum(range(10**12))  # minutes in C code that does not give the interpreter away
    return {"square": number * number}

def leave(done, total):
    if "exit" in sys.argv and done == 2:
        sys.exit(7)
    if "crash" in sys.argv and done == 2:
        os.abort()

if __name__ == "__main__":
    mb.sweep(job, {"number": range(6), "how": [sys.argv[1]]}, workers=2, resume="kept.jsonl", progress=leave)
    print("finished")
"""
posix = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
linux = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a worker ends when its C code does")


def started(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    (folder / "script.py").write_text(SCRIPT)
    command = [sys.executable, "script.py", *arguments]
    with (folder / "said").open("w") as said:  # not a pipe: a worker that stays would hold it open
        return subprocess.Popen(command, cwd=folder, stdout=said, stderr=said, text=True, start_new_session=True)


def wait_for(found: object, seconds: float = 30.0) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found():  # type: ignore[operator]
            return True
        time.sleep(0.02)
    return False


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return "Z" not in Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2][:3] if Path(f"/proc/{pid}").exists() else True


def workers(folder: Path) -> list[int]:
    return [int(path.suffix[1:]) for path in folder.glob("worker.*")]


@pytest.fixture
def gone(tmp_path: Path) -> Iterator[None]:
    """After the test all workers are gone within 3 s; whatever is left is killed."""
    yield
    pids = workers(tmp_path)
    left = [] if wait_for(lambda: not any(map(alive, pids)), 3.0) else [pid for pid in pids if alive(pid)]
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    assert pids
    assert not left


@posix
@pytest.mark.usefixtures("gone")
@pytest.mark.parametrize(("how", "number"), [
    ("sleeps", signal.SIGTERM), pytest.param("computes", signal.SIGKILL, marks=linux),
    pytest.param("sleeps", signal.SIGKILL, marks=pytest.mark.slow),
    pytest.param("computes", signal.SIGTERM, marks=[linux, pytest.mark.slow]),
])
def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path, how: str, number: int) -> None:
    process = started(tmp_path, how)
    assert wait_for(lambda: (tmp_path / "point.3").exists())
    process.send_signal(number)
    assert process.wait(10) == -number
    rows = [json.loads(line) for line in (tmp_path / "kept.jsonl").read_text().splitlines()[1:]]
    assert {row["number"]: row["values"] for row in rows} == {0: {"square": 0}, 1: {"square": 1}}


@posix
@pytest.mark.usefixtures("gone")
@pytest.mark.parametrize(("how", "code"), [("exit", 7), pytest.param("crash", -signal.SIGABRT, marks=pytest.mark.slow)])
def test_workers_end_with_a_parent_that_ends_itself(tmp_path: Path, how: str, code: int) -> None:
    process = started(tmp_path, "sleeps", how)
    assert process.wait(20) == code


@posix
@pytest.mark.usefixtures("gone")
@pytest.mark.parametrize("early", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_ctrl_c_is_told_once_and_ends_the_workers(tmp_path: Path, early: bool) -> None:
    process = started(tmp_path, "sleeps")
    assert wait_for(lambda: (tmp_path / ("point.0" if early else "point.3")).exists())  # early: others are just starting
    os.killpg(process.pid, signal.SIGINT)  # a terminal sends it to all
    assert process.wait(10) == -signal.SIGINT  # as of any script
    said = (tmp_path / "said").read_text()
    assert "finished" not in said
    assert said.count("KeyboardInterrupt") == 1, said
    assert "points are done and kept in kept.jsonl; the same call goes on from there" in said

