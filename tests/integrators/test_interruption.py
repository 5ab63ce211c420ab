"""Ctrl-C at any instant comes out at once, as what it is, with what was computed: also inside callbacks of SUNDIALS."""

from __future__ import annotations

import re
import signal
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest

import mbdae as mb

SAID = re.compile(r"was interrupted at t = |interrupted: the run attached .*is complete|interrupted before the first step")
RUNS: dict[str, dict[str, Any]] = {
    "IDA": {"solver": mb.IDA()}, "CVODE": {"solver": mb.CVODE(), "form": mb.Index1()}, "Radau": {"solver": mb.RadauIIA(3)},
    "HHT": {"solver": mb.HHT(), "accuracy": 1e-3}, "default": {},
}
pytestmark = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="timers of POSIX")


def pendulum() -> mb.Scene:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    return s


@pytest.fixture
def alarm() -> Iterator[None]:
    """The alarm is Ctrl-C."""
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)


def after(wait: float, call: Callable[[], Any]) -> Any:
    """What is called, with an alarm after some seconds. A busy machine may ring it before the next statement of a test."""
    signal.setitimer(signal.ITIMER_REAL, wait)
    return call()


@pytest.mark.slow  # Python itself loses an interrupt that falls into a destructor or a callback of a weak reference
@pytest.mark.usefixtures("alarm")
@pytest.mark.parametrize("name", RUNS)
def test_at_any_instant(name: str) -> None:
    pendulum().simulate(0.1, **RUNS[name])  # imported
    random = np.random.default_rng(len(name))
    with_result = 0
    for wait in 10 ** random.uniform(-2.5, -0.7, size=12):
        begin = time.perf_counter()
        scene = pendulum()
        with pytest.raises(KeyboardInterrupt) as stop:
            after(wait, partial(scene.simulate, 1e4, **RUNS[name]))
        assert time.perf_counter() - begin < wait + 1.0
        assert SAID.search(str(stop.value))
        found = getattr(stop.value, "solution", None)
        if found is not None:
            assert np.isfinite(found["A"].angle).all()
            assert len(found.solution.t) == len(found.solution.y) == len(found.solution.yp)
            with_result += 1
    assert with_result


def test_what_a_handler_of_the_user_raises_carries_the_result_too() -> None:
    class Ended(SystemExit):
        pass

    def end(t: float, t_end: float, stats: Any) -> None:
        if t > 1.0:
            raise Ended(143)

    with pytest.raises(Ended) as stop:
        pendulum().simulate(1e4, progress=end)
    assert stop.value.code == 143
    assert stop.value.solution.solution.t[-1] > 1.0  # type: ignore[attr-defined]


@pytest.mark.usefixtures("alarm")
@pytest.mark.parametrize("solver", [mb.RadauIIA(3, rtol=1e-10), mb.RadauIIA(3, step=1e-3)], ids=["adaptive", "constant step"])
def test_no_signal_is_lost_in_a_function_that_c_calls(solver: Any) -> None:
    """It falls before the first instruction of the function now and then, where no `try` of the function catches it."""
    system = mb.DAE(lambda t, y, yp, out: np.subtract(yp, [y[1], -y[0]], out=out), [1.0, 0.0], [0.0, -1.0])
    for wait in np.linspace(0.005, 0.02, 60):
        with pytest.raises(KeyboardInterrupt):
            after(wait, partial(solver.solve, system, 1e4, max_residuals=30_000))
