"""Files are written whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

import mbdae as mb
from mbdae import files
from mbdae.files import replacing, write_file


class Stopped(BaseException):
    """An interruption, as Ctrl-C is one."""


def test_a_file_appears_whole_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    assert write_file(str(path), "eins\n") == path
    write_file(path, b"zwei\n")
    assert path.read_bytes() == b"zwei\n"
    assert os.listdir(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("stop", [Stopped, KeyboardInterrupt, ValueError, OSError, MemoryError])
def test_what_was_there_stays_where_writing_stops(tmp_path: Path, stop: type[BaseException]) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")

    def stopped() -> None:
        with replacing(path) as part:
            part.write_text("half")
            raise stop("stop")

    with pytest.raises(mb.OptionError if stop is OSError else stop):
        stopped()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("step", ["open", "fsync", "replace"])
def test_a_full_disk_leaves_what_was_there(tmp_path: Path, step: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    path = tmp_path / "a.txt"
    path.write_text("old")
    monkeypatch.setattr(files.os, step, full)
    with pytest.raises(mb.OptionError, match=r"a\.txt' cannot be written: No space left"):
        write_file(path, "new")
    monkeypatch.undo()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_rights_and_links_stay(tmp_path: Path) -> None:
    path, link = tmp_path / "a.txt", tmp_path / "link.txt"
    path.write_text("old")
    path.chmod(0o640)
    link.symlink_to(path)
    write_file(link, "new")
    assert link.is_symlink()
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o640
    write_file(os.devnull, "gone")
    assert not Path(os.devnull).is_file()


def test_what_cannot_be_written_is_told_with_its_name(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "no" / "x.txt", tmp_path / ("x" * 300)):
        with pytest.raises(mb.OptionError, match="cannot be written"):
            write_file(path, "")
    for nothing in (None, 3, b"x\0", "a\0b", ["x"]):
        with pytest.raises(mb.OptionError, match="path = "):
            write_file(nothing, "")
    locked = tmp_path / "locked.txt"
    locked.write_text("old")
    locked.chmod(0o400)
    if not os.access(locked, os.W_OK):  # the superuser may write to anything
        with pytest.raises(mb.OptionError, match="may not be changed"):
            write_file(locked, "new")
    assert locked.read_text() == "old"


def chain() -> mb.Scene:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    return s


def square(x: float) -> float:
    return x * x


CALLS = {
    "compare": lambda place: mb.compare(chain(), 0.1, ["IDA"], [1e-3], resume=place),
    "extremes": lambda place: mb.extremes(chain(), 0.1, vary={"rod.mass": (1.0, 2.0)}, resume=place),
    "sweep": lambda place: mb.sweep(square, {"x": [1.0]}, resume=place),
    "run": lambda place: chain().simulate(0.1, checkpoint=place.parent),
    "sweep of a scene": lambda place: mb.sweep(chain(), {"rod.mass": [1.0]}, t_end=0.1, resume=place.parent),
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes with names")
@pytest.mark.parametrize("call", CALLS)
def test_a_pipe_is_not_waited_for(call: str, tmp_path: Path) -> None:
    """Where a file is expected to go on with; nobody writes to the pipe."""
    place = tmp_path / ("statement.json" if call in ("run", "sweep of a scene") else "kept")
    os.mkfifo(place)
    with pytest.raises(mb.OptionError, match="no regular file"):
        CALLS[call](place)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes with names")
def test_a_pipe_among_the_files_of_a_run_is_not_waited_for(tmp_path: Path) -> None:
    chain().simulate(0.1, checkpoint=tmp_path)
    place = tmp_path / "run00001.state.npz"
    place.unlink()
    os.mkfifo(place)
    with pytest.raises(mb.OptionError, match="no regular file"):
        chain().simulate(0.1, checkpoint=tmp_path)
