"""Steps of a run are there at every instant: where Ctrl-C comes between two lines, and where the disk for them is full."""

from __future__ import annotations

import errno
import logging
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.integrators import kept_rows, loop
from mbdae.integrators.kept_rows import Rows

SIZES = (1, 20, 3, 50, 1, 1, 30)  #: rows that are added at a time: one by one and as blocks, so that some go to disk


@pytest.fixture(autouse=True)
def little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_rows, "IN_MEMORY", 1000)
    monkeypatch.setattr(kept_rows, "AT_ONCE", 256)


def filled(rows: Rows, made: list[int]) -> None:
    """Add rows that count up from 1, behind the one of number 0; made: gets the number of rows before and after each call."""
    for size in SIZES:
        made.append(made[-1] + size)
        rows.extend(made[-2] + np.arange(size)[:, None] * np.ones(4))
        made[:-1] = [made[-1]]
        if size == 50:
            rows.array(made[-1])


def interrupting(number: int, *modules: Any) -> Callable[..., Any]:
    """A trace function that raises KeyboardInterrupt before the line with this number, counted in the files of some modules."""
    files, left = {module.__file__ for module in modules}, [number]

    def trace(frame: FrameType, event: str, argument: Any) -> Any:
        if frame.f_code.co_filename not in files or frame.f_code.co_name == "__del__":  # Python drops what is raised in there
            return None
        if event == "line":
            left[0] -= 1
            if left[0] == 0:
                sys.settrace(None)
                raise KeyboardInterrupt
        return trace

    return trace


def interrupted_at(number: int, call: Callable[[], Any], *modules: Any) -> bool:
    """Whether the call was interrupted before the line with this number; an exception of its own comes out."""
    before = sys.gettrace()
    sys.settrace(interrupting(number, *modules))
    try:
        call()
    except KeyboardInterrupt as error:
        interrupted_at.error = error  # type: ignore[attr-defined]
        return True
    finally:
        sys.settrace(before)
    return False


def lines(step: int, call: Callable[[int], bool]) -> Iterator[int]:
    """Numbers of lines, `step` apart, up to the end of what is called."""
    number = 1
    while call(number):
        yield number
        number += step


def test_rows_are_there_once_whichever_line_is_interrupted() -> None:
    def at(number: int) -> bool:
        rows, made = Rows("y", np.zeros(4)), [1]
        stopped = interrupted_at(number, lambda: filled(rows, made), kept_rows)
        count = len(rows)
        assert made[0] <= count <= made[-1]
        found = np.array(rows.array(count))
        assert np.array_equal(found[:, 0], np.arange(count))
        rows.extend(np.full((40, 4), 7.0))
        assert np.array_equal(rows.array(count + 40)[:, 0], [*range(count), *[7.0] * 40])
        assert np.array_equal([row[0] for row in rows.since(count - 1)], [count - 1, *[7.0] * 40])
        return stopped

    assert len(list(lines(1, at))) > 100


@pytest.mark.parametrize("room", [0, 1000, 2500, 5000])
def test_a_full_disk_leaves_rows_in_memory(room: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """The disk has room for some bytes of the 4 kB."""
    put = kept_rows._put

    def full(file: Any, place: int, rows: Any) -> None:
        if place + rows.nbytes > room:
            if fit := max(room - place, 0) // rows[0].nbytes:
                put(file, place, rows[:fit])
            raise OSError(errno.ENOSPC, "No space left on device")
        put(file, place, rows)

    monkeypatch.setattr(kept_rows, "_put", full)
    kept_rows._say_full.cache_clear()
    rows, made = Rows("y", np.zeros(4)), [1]
    with caplog.at_level(logging.WARNING, "mbdae"):
        filled(rows, made)
        assert np.array_equal(rows.array(made[-1])[:, 0], np.arange(made[-1]))
    assert len(caplog.records) == (room < 5000)
    assert all("No space left on device" in text and "TMPDIR" in text for text in caplog.messages)


def double() -> mb.Scene:
    s = mb.Scene("double pendulum", gravity=(0, -9.81, 0))
    a, b = s.link("a", (0, 0), (1, 0), mass=1.0), s.link("b", (1, 0), (2, 0), mass=1.0)
    s.revolute("A", s.ground, a, at=(0, 0), model=mb.Kinematic())
    s.revolute("B", a, b, at=(1, 0), model=mb.Kinematic())
    return s


def test_without_a_folder_for_temporary_files_the_run_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    before = double().simulate(1.0, 1e-4)
    monkeypatch.setattr(tempfile, "tempdir", str(Path("no", "such", "folder")))
    after = double().simulate(1.0, 1e-4)
    assert np.array_equal(before.solution.y, after.solution.y)


def test_memory_that_is_used_up_ends_a_run_with_what_was_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    real, count = Rows.extend, [0]

    def extend(self: Rows, rows: Any) -> None:
        count[0] += 1
        if count[0] == 12:
            raise MemoryError
        real(self, rows)

    monkeypatch.setattr(Rows, "extend", extend)
    monkeypatch.setattr("mbdae.integrators.radau.ROWS", 8)
    with pytest.raises(mb.SolverError, match="the memory is used up") as stop:
        double().simulate(5.0, solver=mb.RadauIIA(3))
    assert np.isfinite(stop.value.solution["A"].angle).all()


@pytest.mark.parametrize("solver", [mb.RadauIIA(3, rtol=1e-4), mb.DOP853(rtol=1e-4), mb.IDA(rtol=1e-4)], ids=lambda s: s.label)
def test_a_run_interrupted_at_any_line_is_the_whole_one_until_there(solver: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines of the loop and of its storage, every 41st."""
    monkeypatch.setattr("mbdae.integrators.radau.ROWS", 8)
    monkeypatch.setattr("mbdae.integrators.dop853.ROWS", 8)
    form = mb.Index1() if isinstance(solver, mb.DOP853) else None
    scene = double()
    whole = scene.simulate(1.0, solver=solver, form=form)

    def at(number: int) -> bool:
        if not interrupted_at(number, lambda: scene.simulate(1.0, solver=solver, form=form), kept_rows, loop):
            return False
        found = getattr(interrupted_at.error, "solution", None)  # type: ignore[attr-defined]
        if found is not None:
            t = np.asarray(found.solution.t)
            assert np.array_equal(t, whole.solution.t[: len(t)])
            assert np.array_equal(found.solution.y, whole.solution.y[: len(t)])
            inside = np.linspace(0.0, t[-1], 7)
            assert np.allclose(found.solution(inside), whole.solution(inside), rtol=1e-9, atol=1e-9)
            assert np.isfinite(found["A"].force).all()
        return True

    assert len(list(lines(41, at))) > 10
