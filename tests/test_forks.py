"""Processes that are forked while other threads work, two threads on one System, and modules that go to other processes."""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable
from copy import deepcopy
from functools import cached_property
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae import process, threads
from mbdae.process import Signals

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="systems that fork")
PATIENCE = 60  #: s after which a forked process counts as one that hangs


def pendulum() -> mb.Scene:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), model=mb.Kinematic())
    return s


def forked(work: Callable[[], bool]) -> int:
    """How a forked process ends: 0 where the work returns True, minus the number of the signal that killed it where it hangs."""
    child = os.fork()
    if child == 0:
        answer = 1
        try:
            signal.alarm(PATIENCE)
            answer = 0 if work() else 2
        finally:
            os._exit(answer)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def beside(inside: Callable[[threading.Event, threading.Event], None], work: Callable[[], Any]) -> Any:
    """What the work returns while another thread is inside something: a function (reached, go on)."""
    reached, on = threading.Event(), threading.Event()
    thread = threading.Thread(target=inside, args=(reached, on))
    thread.start()
    assert reached.wait(PATIENCE)
    try:
        return work()
    finally:
        on.set()
        thread.join()


@needs_fork
def test_a_lock_that_another_thread_holds_is_open_in_a_forked_process() -> None:
    def held(reached: threading.Event, on: threading.Event) -> None:
        with threads._INSIDE.lock:
            reached.set()
            on.wait(PATIENCE)

    expected = pendulum().simulate(0.2).solution.y
    assert beside(held, lambda: forked(lambda: np.array_equal(pendulum().simulate(0.2).solution.y, expected))) == 0


@needs_fork
def test_a_property_that_another_thread_computes_can_be_computed_in_a_forked_process(monkeypatch: pytest.MonkeyPatch) -> None:
    reached, on = threading.Event(), threading.Event()

    class Slow:
        def __init__(self, wait: bool) -> None:
            self.wait = wait

        @cached_property
        def value(self) -> int:
            if self.wait:
                reached.set()
                on.wait(PATIENCE)
            return 3

    monkeypatch.setattr(threads, "Slow", Slow, raising=False)
    thread = threading.Thread(target=lambda: Slow(True).value)
    thread.start()
    reached.wait(PATIENCE)
    found = forked(lambda: Slow(False).value == 3)
    on.set()
    thread.join()
    assert found == 0


def test_forking_waits_for_imports_of_other_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """A module lock with an owner; nobody waits for what this thread imports itself, nor for ever."""
    class Lock:
        owner: Any = threading.get_ident()

    monkeypatch.setattr("importlib._bootstrap._module_locks", {"mbdae.x": Lock})
    assert not process._others_import()
    Lock.owner = -1
    assert process._others_import()
    slept: list[float] = []
    monkeypatch.setattr(process.time, "sleep", lambda s: slept.append(s) or setattr(Lock, "owner", None))
    monkeypatch.setattr(process, "active_count", lambda: 2)
    process._wait_for_imports()
    assert len(slept) == 1


@needs_fork
def test_ctrl_c_reaches_a_process_forked_while_c_ran_elsewhere() -> None:
    """Handlers of signals wait while C runs; in a process that another thread has forked it does not run."""
    def fork_in_thread(codes: list[int]) -> None:
        def work() -> bool:
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                return True
            return False

        codes.append(forked(work))

    codes: list[int] = []
    with Signals() as signals:
        signals.inside = True
        thread = threading.Thread(target=fork_in_thread, args=(codes,))
        thread.start()
        thread.join()
        signals.inside = False
    assert codes == [0]


@pytest.mark.parametrize("solver", [mb.RadauIIA(3), mb.IDA(), mb.CVODE(), mb.DOP853()], ids=lambda s: s.label)
def test_a_system_that_another_thread_runs_is_refused_by_name(solver: Any) -> None:
    """Also its copies with another start; not copies by pickle or deepcopy, and not after the other run."""
    reached, on, first = threading.Event(), threading.Event(), [True]

    def residual(t: float, y: Any, yp: Any, out: Any) -> None:
        if t > 0.1 and first:
            first.clear()
            reached.set()
            on.wait(PATIENCE)
        out[:] = yp + y

    def rates(t: float, y: Any, out: Any) -> None:
        residual(t, y, 0 * y, out)
        out *= -1

    system = mb.DAE(residual, [1.0], [-1.0], rhs=rates, names=["level"])
    found: list[Any] = []
    thread = threading.Thread(target=lambda: found.append(solver.solve(system, 1.0)(1.0)[0]))
    thread.start()
    assert reached.wait(PATIENCE)
    try:
        for one in (system, system.starting(0.0, np.ones(1), -np.ones(1))):
            with pytest.raises(mb.OptionError, match=r"the System DAE \(level, ...\) is run by another thread: .* its own"):
                solver.solve(one, 1.0)
    finally:
        on.set()
        thread.join()
    assert found == pytest.approx([np.exp(-1.0)], rel=1e-4)
    assert solver.solve(system, 1.0)(1.0)[0] == found[0]


def test_copies_of_a_system_have_owners_of_their_own() -> None:
    system = pendulum().system("ggl")
    assert system.starting(0.0, system.y0, system.yp0).owner is system.owner
    assert deepcopy(system).owner is not system.owner
    assert pickle.loads(pickle.dumps(system.owner)) is not system.owner


def test_the_package_goes_to_other_processes() -> None:
    """As functions of a notebook or script take it along: cloudpickle looks at modules by their class."""
    assert pickle.loads(pickle.dumps(mb)) is mb
    cloudpickle = pytest.importorskip("cloudpickle")
    found = cloudpickle.loads(cloudpickle.dumps(lambda: mb.Scene("x").name))
    assert found() == "x"
    assert sys.modules["mbdae"] is mb


def test_threads_wait_for_each_others_evaluations() -> None:
    """Of a System that has not been evaluated before: its tables are made by the first of them, and all write to one array."""
    for form in ("ggl", mb.Index1(multipliers="eliminated")):
        expected, system = (pendulum().system(form) for _ in range(2))
        states = [expected.y0 + 0.01 * k for k in range(2)]
        right = [expected.jacobian_parts(0.0, y, expected.yp0) for y in states]
        together, found, before = threading.Barrier(2), list[bool](), sys.getswitchinterval()

        def work(y: Any, right: Any, system: Any, found: list[bool], together: threading.Barrier) -> None:
            together.wait()
            for _ in range(20):
                found.append(all(map(np.array_equal, system.jacobian_parts(0.0, y, system.yp0), right)))

        sys.setswitchinterval(1e-6)
        threads = [threading.Thread(target=work, args=(states[k], right[k], system, found, together)) for k in (0, 1)]
        try:
            for thread in threads:
                thread.start()
        finally:
            for thread in threads:
                thread.join()
            sys.setswitchinterval(before)
        assert found == [True] * 40


class Dying:
    def __del__(self) -> None:
        signal.raise_signal(signal.SIGALRM)


class Alarmed(mb.Force):
    params = mb.params(c=("N/m", "stiffness"))
    how = staticmethod(lambda: None)

    def energy(self, k: Any, l: Any) -> Any:
        self.how()
        return self.c * ((l.r - k.r) @ (l.r - k.r)) / 2


@needs_fork
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("how", [lambda: signal.raise_signal(signal.SIGALRM), Dying, None])
def test_what_a_handler_raises_leaves_as_it_is(how: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    """From a law (whose mistakes are words), a destructor (where Python drops exceptions), steps, and while a file is written
    (where every OSError, which a TimeoutError is, means the disk); what was computed is attached."""
    monkeypatch.setattr(Alarmed, "how", staticmethod(how or (lambda: None)))
    s = mb.Scene("pulled")
    s.add(Alarmed("pull", s.ground, s.point_mass("b", 1.0, at=(0, 1.0, 0)), at=(0, 0, 0), at_l=(0, 1.0, 0), c=1.0))

    def late(*_: Any) -> None:
        raise TimeoutError("too late")

    before = signal.signal(signal.SIGALRM, late)
    try:
        if how is not None:
            with pytest.raises(TimeoutError, match=r"^too late$"):
                s.simulate(1.0)
        else:
            with pytest.raises(TimeoutError, match=r"^too late$") as stopped:
                s.simulate(1.0, progress=lambda *_: signal.raise_signal(signal.SIGALRM))
            r = s.simulate(0.1)
            assert isinstance(stopped.value.solution, type(r))
            monkeypatch.setattr("mbdae.files.os.replace", lambda *_: signal.raise_signal(signal.SIGALRM))
            with pytest.raises(TimeoutError, match=r"^too late$"):
                r.save(tmp_path / "run.npz")
            assert list(tmp_path.iterdir()) == []
        assert signal.getsignal(signal.SIGALRM) is late
    finally:
        signal.signal(signal.SIGALRM, before)
