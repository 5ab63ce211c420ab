"""The limit of wall time holds in every phase of a call, and what was computed until then comes with the error."""

from __future__ import annotations

import re
import time
from typing import Any

import numpy as np
import pytest
import sympy as sp

import mbdae as mb
from mbdae import threads
from mbdae.errors import WallClockError


class Clock:
    """A clock that goes on by a tick (s) with every look at it."""

    def __init__(self, tick: float) -> None:
        self.now, self.tick = 0.0, tick

    def __call__(self) -> float:
        self.now += self.tick
        return self.now


def rod(**drive: Any) -> mb.Scene:
    s = mb.Scene("rod", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), model=mb.Kinematic(), **drive)
    return s


def stopped_after(looks: int, scene: mb.Scene, monkeypatch: pytest.MonkeyPatch, **options: Any) -> WallClockError:
    with monkeypatch.context() as patch:
        patch.setattr(threads.time, "perf_counter", Clock(1.0 / looks))
        with pytest.raises(WallClockError, match="max_wall = 1 s of wall time is used up") as stop:
            scene.simulate(20.0, max_wall=1.0, **options)
    return stop.value


def test_while_inputs_are_examined(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is refused for its speed, after a long search for its changes."""
    error = stopped_after(40, rod(angle=0.1 * sp.sin(300 * mb.t**2)), monkeypatch)
    assert "while inputs of time were examined" in str(error)


class Steep(mb.Force):
    """A law that no other test compiles."""

    params = mb.params(c=("N/m^6", "stiffness"))

    def energy(self, k: Any, l: Any) -> Any:
        return 0.1234567 * self.c * ((l.r - k.r) @ (l.r - k.r)) ** 3


def test_while_equations_are_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    s = rod()
    s.add(Steep("steep", s.ground, "rod", at=(0, 0, 0), at_l=(1, 0, 0), c=1.0))
    assert re.search("equations were (compiled|evaluated|put together)", str(stopped_after(2, s, monkeypatch)))


def test_functions_of_ones_own_are_not_called_any_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each call of the residual takes 0.2 s of a limit of 1 s."""
    clock, late = Clock(0.0), list[float]()

    def residual(t: float, y: Any, yp: Any, out: Any) -> None:
        clock.now += 0.2
        late.append(clock.now)
        out[:] = yp[0] - y[1], yp[1] + y[0]

    dae = mb.DAE(residual, [1.0, 0.0], [0.0, -1.0])
    monkeypatch.setattr(threads.time, "perf_counter", clock)
    for solver in (None, "ida", "radau3"):
        begin = clock.now
        with pytest.raises(WallClockError, match="max_wall = 1 s"):
            dae.simulate(20.0, solver=solver, max_wall=1.0)
        assert late[-1] - begin < 1.3


def test_in_every_later_phase_with_what_was_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    s, with_result = rod(), 0
    whole, clock = s.simulate(20.0, 1e-4), Clock(1e-9)
    with monkeypatch.context() as patch:
        patch.setattr(threads.time, "perf_counter", clock)
        s.simulate(20.0, 1e-4, max_wall=1.0)
    for looks in np.unique(np.linspace(2, 0.8e9 * clock.now, 9).astype(int)).tolist():
        error = stopped_after(looks, s, monkeypatch, accuracy=1e-4)
        r = error.solution
        if r is not None:
            with_result += 1
            assert np.isfinite(r["A"].angle).all()
            assert r.solution.t[-1] <= whole.solution.t[-1]
    assert with_result > 3


def test_a_call_inside_another_has_no_more_time_than_that() -> None:
    with threads.limited(1e-9), threads.limited(None):
        time.sleep(0.001)
        with pytest.raises(WallClockError):
            threads.check("tested")
    threads.check("there is no call")
