"""Feedback and events in runs that are kept in a folder; controllers, whose memory is not kept, are refused."""

import numpy as np
import pytest

import mbdae as mb
from mbdae.integrators.checkpoints import keeper


class Killed(BaseException):
    """In place of the end of the process."""


def pendulum():
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    e = s.state("e", rate=s.sensor("J.angle") - s.sensor("e"))
    s.revolute("J", s.ground, rod, at=(0, 0), torque=-0.5 * s.sensor("J.rate") + e + mb.table([0, 1, 2], [0, 1, 0]))
    return s


OPTIONS = {"record": ["J.rate == 0", "e < -1"], "accuracy": 1e-8}


@pytest.mark.parametrize("solver", [mb.RadauIIA(3), mb.DOP853(), None])
@pytest.mark.parametrize("until", [None, "J.angle < -1.5"])
def test_events_of_a_run_that_was_killed_have_the_same_bits(solver, until, tmp_path, monkeypatch):
    def made(folder):
        r = pendulum().simulate(2.0, solver=solver, until=until, checkpoint=folder, every=20, **OPTIONS)
        return r.t.tobytes(), r.q.tobytes(), r.events

    files = {"count": 0, "stop": 0}

    def counting(original):
        def write(*args):
            original(*args)
            files["count"] += 1
            if files["count"] == files["stop"]:
                raise Killed

        return write

    for owner, name in ((keeper.RunFiles, "write"), (keeper.RunFiles, "write_chunk"), (keeper, "write_tree")):
        monkeypatch.setattr(owner, name, counting(getattr(owner, name)))
    monkeypatch.setattr(keeper, "PAUSE", 0.0)
    whole = made(tmp_path / "whole")
    count = files["count"]
    assert count > 3
    assert len(whole[2]) > 0
    for i, stop in enumerate(np.unique(np.linspace(1, count - 1, 4).astype(int)).tolist()):
        files.update(count=0, stop=stop)
        with pytest.raises(Killed):
            made(tmp_path / str(i))
        files.update(count=0, stop=0)
        assert made(tmp_path / str(i)) == whole


def test_another_event_is_another_call(tmp_path):
    s = pendulum()
    s.simulate(1.0, until="J.angle < -0.3", checkpoint=tmp_path)
    with pytest.raises(mb.OptionError, match="holds another run: until"):
        s.simulate(1.0, until="J.angle < -0.2", checkpoint=tmp_path)


def test_sampled_controllers_are_refused(tmp_path):
    s = pendulum()
    s.controller("pid", lambda t, angle: -angle, every=0.1, reads=["J.angle"], sets=["u"])
    with pytest.raises(mb.OptionError, match="checkpoint: what the function of controller 'pid' does and remembers is not kept"):
        s.simulate(1.0, checkpoint=tmp_path / "folder")
