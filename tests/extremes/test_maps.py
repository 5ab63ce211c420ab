"""Maps of extremes: verdicts on measured errors, what is run, what is kept, the command line."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace

import pytest
import sympy as sp

import mbdae as mb
from mbdae.cli import main
from mbdae.compare.problem import new_problem
from mbdae.extremes.cell import FAILED, MET, NEAR, SILENT, TOLD, UNKNOWN, VERDICTS, verdict
from mbdae.extremes.page import Extremes
from mbdae.extremes.ways import ways

RUNS = [mb.Run(mb.IDA(), mb.GGL()), mb.Run(mb.RadauIIA(3), mb.GGL(), model=mb.Classical()), mb.Run(mb.IDA(), mb.Index3())]


def pendulum(length=1.0):
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (length, 0), mass=1.0)
    s.revolute("hinge", s.ground, rod, at=(0, 0), rate0=1.0)
    return s


@pytest.mark.parametrize(("error", "told", "known", "expected"), [
    (0.9e-5, False, 1e-9, MET), (0.9e-5, True, 1e-9, MET), (2.9e-5, False, 1e-9, NEAR), (2.9e-5, True, 1e-9, TOLD),
    (3.1e-5, False, 1e-9, SILENT), (3.1e-5, True, 1e-9, TOLD), (2e-4, False, 1e-9, SILENT), (2e-4, True, 1e-9, TOLD),
    (math.nan, False, 1e-9, SILENT), (math.nan, True, None, TOLD),
    (1e-9, False, None, UNKNOWN), (1e-9, True, None, UNKNOWN), (2e-3, False, 5e-5, SILENT), (2e-4, False, 1.5e-4, UNKNOWN),
    (0.1e-5, False, 0.5e-5, MET), (0.9e-5, False, 0.5e-5, UNKNOWN), (1e-9, False, 0.0, MET),
])
def test_verdicts(error, told, known, expected):
    assert verdict(error, 1e-5, told, known) == expected


@pytest.fixture(scope="module")
def small():
    return mb.extremes(pendulum, 0.5, {"rod.mass": [1e-9, 1e9], "step": [1e-1, 1e-4], "length": [0.0, 1.0]}, RUNS, accuracy=1e-4)


def test_every_way_runs_at_every_value(small):
    mass, step, length = small.blocks
    assert mass.labels == ("IDA GGL", "RadauIIA(3) GGL Classical", "IDA Index3", "chosen by mbdae")
    assert [cell.verdict for cell in mass.cells] == 2 * [MET, MET, FAILED, MET]
    assert "index 3" in mass.at("IDA Index3", 1e9).failure
    assert step.labels == ("RadauIIA(3) GGL Classical",)
    assert all(cell.error < 1e-4 and cell.steps == 20 for cell in step.cells if cell.value == 1e-4)
    assert [cell.verdict for cell in length.cells if cell.value == 0.0] == 4 * [FAILED]
    assert "needs at least two points" in length.cells[0].failure
    assert small.counts == {name: sum(cell.verdict == name for cell in small.cells) for name in VERDICTS}
    assert not small.silent


def test_errors_are_measured_and_not_estimated(small):
    cell = small.blocks[0].at("IDA GGL", 1e-9)
    assert cell.error != cell.estimated
    assert 0 < cell.error <= 1e-4
    assert cell.cpu_s > 0
    assert cell.steps > 0


def test_a_silent_miss_is_found(monkeypatch):
    """A run that is 1e-2 off and says nothing."""
    simulate = mb.Scene.simulate

    def wrong(self, *args, **kwargs):
        r = simulate(self, *args, **kwargs)
        exact = r.solution
        off = {"__call__": lambda s, t: exact(t) + 1e-2, "__getattr__": lambda s, n: getattr(exact, n)}
        vars(r)["solution"] = type("Off", (), off)()
        return r

    monkeypatch.setattr(mb.Scene, "simulate", wrong)
    m = mb.extremes(pendulum, 0.5, {"accuracy": [1e-4]}, RUNS[:1])
    assert [cell.verdict for cell in m.cells] == [SILENT, SILENT]
    assert len(m.silent) == 2
    assert "missed silently" in m.table()


def test_without_trust_in_the_reference_nothing_is_judged(monkeypatch):
    module = sys.modules[mb.extremes.__module__]
    computed = module.reference_at
    monkeypatch.setattr(module, "reference_at",
                        lambda *given: replace(computed(*given), uncertainty=1.0, label="doubtful"))
    m = mb.extremes(pendulum, 0.5, {"accuracy": [1e-4]}, RUNS[:1])
    assert [cell.verdict for cell in m.cells] == [UNKNOWN, UNKNOWN]
    assert m.blocks[0].references == ("doubtful",)


def test_default_parameters_and_ways_come_from_the_scene():
    m = mb.extremes(pendulum(), 0.05, runs=RUNS[:1], accuracy=1e-3)
    assert [block.parameter for block in m.blocks] == ["accuracy", "step", "rod.mass", "hinge.speed"]
    labels = [way.label for way in ways(new_problem(pendulum(), 0.05, None, None), None)]
    assert len(labels) == len(set(labels))
    assert {"IDA GGL", "RadauIIA(2) Index3", "RadauIIA(3) GGL Classical", "CVODE (Adams) ODE Recursive"} <= set(labels)
    assert {"chosen by mbdae", "chosen by mbdae Recursive"} <= set(labels)
    assert m.blocks[-1].at("IDA GGL", 100.0).t_end == pytest.approx(0.05 / 100)
    assert not m.silent


def test_a_stopped_map_goes_on(tmp_path):
    asked = {"scene": pendulum, "t_end": 0.1, "vary": {"rod.mass": [1.0, 2.0]}, "runs": RUNS[:1], "accuracy": 1e-3}

    def stop(done, total, label):
        if label.startswith("rod.mass = 2: IDA"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        mb.extremes(**asked, progress=stop, resume=tmp_path / "m.json")
    begun = []
    m = mb.extremes(**asked, progress=lambda done, total, label: begun.append(label), resume=tmp_path / "m.json")
    assert begun == ["rod.mass = 2: reference", "rod.mass = 2: IDA GGL", "rod.mass = 2: chosen by mbdae"]
    assert len(m.cells) == 4
    with pytest.raises(mb.OptionError, match=r"holds another map: accuracies\[0\] is 0.001 as stored and 0.0001 in this call"):
        mb.extremes(**(asked | {"accuracy": 1e-4}), resume=tmp_path / "m.json")


FILE = """
import mbdae as mb

t_end = 0.2
accuracy = 1e-3
vary = {"length": [0.5, 1.0], "rod.mass": (1e-3, 1e0)}
runs = [mb.Run(mb.IDA(), mb.GGL())]

def scene(length=1.0):
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (length, 0), mass=1.0), at=(0, 0))
    return s
"""


def test_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "swing.py").write_text(FILE)
    assert main(["extremes", "swing.py", "--json", "--out", "out"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["accuracy"] == 1e-3
    assert data["counts"] == {MET: 12, NEAR: 0, TOLD: 0, SILENT: 0, FAILED: 0, UNKNOWN: 0}
    assert [block["parameter"] for block in data["blocks"]] == ["length", "rod.mass"]
    assert data["blocks"][1]["values"] == [1e-3, 1e-2, 1e-1, 1.0]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"swing_extremes.html", "swing_extremes.json"}
    monkeypatch.setattr(Extremes, "silent", property(lambda self: self.cells[:1]))
    assert main(["extremes", "swing.py", "--accuracy", "1e-2"]) == 1
    assert "within 3 times" in capsys.readouterr().out


def test_a_method_does_not_confirm_itself(monkeypatch):
    """At the tolerance of round-off two runs of one method are the same run."""
    module = sys.modules["mbdae.extremes.cell"]
    monkeypatch.setattr(module, "METHODS", ((mb.RadauIIA(3), 10.0), (mb.RadauIIA(3), 10.0)))
    assert module.reference_at(new_problem(pendulum(), 0.1, None, None), 1e-4).uncertainty is None
    monkeypatch.setattr(module, "METHODS", ((mb.RadauIIA(3), 10.0), (mb.IDA(), 10.0)))
    assert 0 < module.reference_at(new_problem(pendulum(), 0.1, None, None), 1e-4).uncertainty < 1e-4 / 3


def remembering(t, angle, rate, memory):
    return 30 * (0.5 - angle) - 4 * rate + memory, memory + 0.01 * (0.5 - angle)


@pytest.mark.parametrize("sampled", [False, True])
def test_scenes_under_control_are_mapped(sampled):
    """Also with a pulse, at whose edges the reference is begun anew: a controller goes on there."""
    s = mb.Scene("driven", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    feedback = 30 * (0.5 - s.sensor("J.angle")) - 4 * s.sensor("J.rate")
    if sampled:
        s.controller("c", remembering, every=0.01, reads=["J.angle", "J.rate"], sets=["u"], memory=0.0)
    s.revolute("J", s.ground, rod, at=(0, 0), torque="u" if sampled else feedback)
    s.force("F", rod, (sp.Piecewise((0, mb.t < 0.1), (5, mb.t < 0.2037), (0, True)), 0, 0))
    found = mb.extremes(s, 0.4, vary={"rod.mass": [0.5, 2.0]}, runs=RUNS[:2])
    assert {cell.verdict for block in found.blocks for cell in block.cells} == {MET}
