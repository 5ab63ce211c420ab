"""Feedback, events and sampled controllers in runs that are kept in a folder."""

import numpy as np
import pytest

import mbdae as mb
from mbdae.integrators import stored_runs


class Killed(BaseException):
    """In place of the end of the process."""


def pendulum():
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    e = s.state("e", rate=s.sensor("J.angle") - s.sensor("e"))
    s.revolute("J", s.ground, rod, at=(0, 0), torque=-0.5 * s.sensor("J.rate") + e + mb.table([0, 1, 2], [0, 1, 0]))
    return s


OPTIONS = {"record": ["J.rate == 0", "e < -1"], "accuracy": 1e-8}


class Files:
    """Files that runs write, counted; the write with number `stop` is the last one."""

    def __init__(self):
        self.count = self.stop = 0

    def after(self, stop, call):
        self.count, self.stop = 0, stop
        return call()

    def counting(self, original):
        def write(*args):
            original(*args)
            self.count += 1
            if self.count == self.stop:
                raise Killed

        return write


@pytest.fixture
def killed(monkeypatch):
    files = Files()
    for owner, name in ((stored_runs.RunFiles, "write"), (stored_runs.RunFiles, "write_chunk"), (stored_runs, "write_tree")):
        monkeypatch.setattr(owner, name, files.counting(getattr(owner, name)))
    monkeypatch.setattr(stored_runs, "PAUSE", 0.0)
    return files


def same_after_kills(run, folder, files):
    """Runs that are killed after a file and go on have the bits of one that is not."""

    def made(name):
        r = run(folder / name)
        return r.t.tobytes(), r.q.tobytes(), r.events

    whole = made("whole")
    count = files.count
    assert count > 3
    for i, stop in enumerate(np.unique(np.linspace(1, count - 1, 4).astype(int)).tolist()):
        with pytest.raises(Killed):
            files.after(stop, lambda: made(str(i)))  # noqa: B023
        assert files.after(0, lambda: made(str(i))) == whole  # noqa: B023
    return whole


@pytest.mark.parametrize("solver", [mb.RadauIIA(3), mb.DOP853(), None])
@pytest.mark.parametrize("until", [None, "J.angle < -1.5"])
def test_events_of_a_run_that_was_killed_have_the_same_bits(solver, until, tmp_path, killed):
    def run(folder):
        return pendulum().simulate(2.0, solver=solver, until=until, checkpoint=folder, every=20, **OPTIONS)

    whole = same_after_kills(run, tmp_path, killed)
    assert len(whole[2]) > 0


def test_another_event_is_another_call(tmp_path):
    s = pendulum()
    s.simulate(1.0, until="J.angle < -0.3", checkpoint=tmp_path)
    with pytest.raises(mb.OptionError, match="holds another run: until"):
        s.simulate(1.0, until="J.angle < -0.2", checkpoint=tmp_path)


def controlled(gain):
    def integral(t, angle, held, memory):
        memory = memory + 0.05 * angle
        return -gain * angle - memory - 0.1 * held, memory

    s = pendulum()
    s.controller("pid", integral, every=0.05, reads=["J.angle", "u"], sets=["u"], memory=0.0)
    s.torque("motor", s["rod"], (0, 0, s.sensor("u")))
    return s


@pytest.mark.parametrize(("solver", "end"), [
    (mb.DOP853(), 2.0), (mb.IDA(), 0.1), (None, 2.0), pytest.param(mb.RadauIIA(3), 1.0, marks=pytest.mark.slow)])
def test_sampled_controllers_go_on(solver, end, tmp_path, killed):
    def run(folder):
        return controlled(3.0).simulate(end, solver=solver, accuracy=1e-4, checkpoint=folder, every=20)

    same_after_kills(run, tmp_path, killed)


def test_another_function_is_told(tmp_path, killed):
    with pytest.raises(Killed):
        killed.after(5, lambda: controlled(3.0).simulate(2.0, checkpoint=tmp_path, every=20))
    with pytest.raises(mb.errors.ControllerError, match=r"'pid' returned .* at its last sampling instant, but .* when"):
        controlled(4.0).simulate(2.0, checkpoint=tmp_path, every=20)


def test_a_function_without_a_name_is_refused(tmp_path):
    s = pendulum()
    s.controller("pid", lambda t, angle: -angle, every=0.1, reads=["J.angle"], sets=["u"])
    with pytest.raises(mb.OptionError, match=r"checkpoint: .*this scene cannot be stored.*a lambda has no name"):
        s.simulate(1.0, checkpoint=tmp_path / "folder")
