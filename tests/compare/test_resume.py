"""A comparison that was stopped goes on from its file; another comparison never does."""

from __future__ import annotations

import json

import pytest

import mbdae as mb

RUNS = [mb.Run(mb.IDA()), mb.Run(mb.RadauIIA(3), model=mb.Classical()), mb.Run(mb.IDA(), mb.Index3())]
ASKED = [1e-3, 1e-5]
PARTS = ("derive_s", "compile_s", "start_s", "companions_s", "judgement_s")


def pendulum(mass=1.0):
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=mass)
    s.revolute("hinge", s.ground, rod, at=(0, 0))
    return s


class Recorder:
    """Notes the runs begun; Ctrl-C as run number `stop` begins."""

    def __init__(self, stop=None):
        self.begun, self.stop = [], stop

    def __call__(self, done, total, label):
        if done == self.stop:
            raise KeyboardInterrupt
        self.begun.append(done)


def facts(w):
    timed = ("cpu_s", "cpu_spread_s", "cpu_first_s", "call_s", "peak_bytes", "pareto", *PARTS)
    return [{k: v for k, v in row.items() if k not in timed} for row in w.to_dict()["runs"]]


@pytest.mark.parametrize("stop", [0, 1, 3, 6])
def test_an_interrupted_comparison_ends_as_if_it_had_never_been_stopped(stop, tmp_path):
    file = tmp_path / "w.json"
    with pytest.raises(KeyboardInterrupt, match=f"{max(stop - 1, 0)} of 6 runs are done and kept in .*w.json"):
        mb.compare(pendulum(), 0.5, RUNS, ASKED, progress=Recorder(stop), resume=file)
    if stop:
        assert len(json.loads(file.read_text(encoding="utf-8"))["rows"]) == stop - 1
    rest = Recorder()
    resumed = mb.compare(pendulum(), 0.5, RUNS, ASKED, progress=rest, resume=file)
    assert rest.begun == list(range(stop, 7))
    whole = mb.compare(pendulum(), 0.5, RUNS, ASKED)
    assert facts(resumed) == facts(whole)
    assert resumed.pairwise == whole.pairwise
    assert resumed.reference.label == whole.reference.label
    assert resumed.total_cpu_s >= resumed.cpu_s > 0


def test_a_finished_comparison_is_read_and_the_same(tmp_path):
    first = mb.compare(pendulum(), 0.5, RUNS, ASKED, measure="hinge.angle", resume=tmp_path / "w.json")
    again = Recorder()
    second = mb.compare(pendulum(), 0.5, RUNS, ASKED, measure="hinge.angle", progress=again, resume=tmp_path / "w.json")
    assert again.begun == []
    assert second == first
    assert [path.name for path in tmp_path.iterdir()] == ["w.json"]


@pytest.mark.parametrize(("change", "named"), [
    ({"scene": pendulum(2.0)}, r"scene.statements\[0\]\[2\].mass is 1.0 as stored and 2.0 in this call"),
    ({"t_end": 0.4}, "t_end is 0.5 as stored and 0.4 in this call"),
    ({"accuracies": [1e-3]}, r"accuracies is \[0.001, 1e-05\] as stored and \[0.001\] in this call"),
    ({"runs": [mb.Run(mb.IDA(max_order=2)), *RUNS[1:]]}, r"runs\[0\].solver.fields.max_order is 5 as stored and 2 in this call"),
    ({"measure": "hinge.angle"}, r'measures is \["motion", .*\] as stored and \["hinge.angle"\] in this call'),
])
def test_another_comparison_is_refused_and_the_difference_named(change, named, tmp_path):
    asked = {"scene": pendulum(), "t_end": 0.5, "runs": RUNS, "accuracies": ASKED}
    with pytest.raises(KeyboardInterrupt):
        mb.compare(**asked, progress=Recorder(2), resume=tmp_path / "w.json")
    before = (tmp_path / "w.json").read_text(encoding="utf-8")
    with pytest.raises(mb.OptionError, match=named):
        mb.compare(**(asked | change), resume=tmp_path / "w.json")
    assert (tmp_path / "w.json").read_text(encoding="utf-8") == before


def test_equations_as_such_go_on_and_are_told_apart(tmp_path):
    def decay(rate):
        return mb.DAE(lambda t, y, yp, out: yp + rate * y + 0.0 * t, [1.0], [-rate])

    runs, file = [mb.Run(mb.RadauIIA(2)), mb.Run(mb.RadauIIA(3))], tmp_path / "w.json"
    with pytest.raises(KeyboardInterrupt):
        mb.compare(decay(1.0), 1.0, runs, [1e-4], progress=Recorder(2), resume=file)
    assert len(mb.compare(decay(1.0), 1.0, runs, [1e-4], resume=file).runs) == 2
    with pytest.raises(mb.OptionError, match="holds another comparison: scene"):
        mb.compare(decay(2.0), 1.0, runs, [1e-4], resume=file)


def test_a_given_reference_belongs_to_the_comparison(tmp_path):
    file, zero = tmp_path / "w.json", lambda t: 0 * t
    mb.compare(pendulum(), 0.1, RUNS[:1], [1e-3], measure="hinge.angle", reference=zero, resume=file)
    with pytest.raises(mb.OptionError, match="reference is"):
        mb.compare(pendulum(), 0.1, RUNS[:1], [1e-3], measure="hinge.angle", reference=lambda t: 0 * t + 1, resume=file)


@pytest.mark.parametrize(("content", "said"), [("{", "cannot be read"), ("{}", "not a comparison kept by resume")])
def test_a_file_of_something_else_is_refused(content, said, tmp_path):
    (tmp_path / "w.json").write_text(content)
    with pytest.raises(mb.OptionError, match=said):
        mb.compare(pendulum(), 0.5, RUNS, ASKED, resume=tmp_path / "w.json")


def test_a_place_that_cannot_be_written_is_refused_before_the_runs(tmp_path):
    with pytest.raises(mb.OptionError, match="a folder that exists"):
        mb.compare(pendulum(), 0.5, RUNS, ASKED, resume=tmp_path / "absent" / "w.json")
