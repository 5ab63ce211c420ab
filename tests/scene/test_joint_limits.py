"""Limits of joints with stops: statements, mistakes, variants, storage, what check and results say."""

# ruff: noqa: E501
from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.laws.on_coordinates import JointStop

STOP = mb.Stop(stiffness=3e4, damping=0.1)
INF = math.inf


def rod(**given: Any) -> mb.Scene:
    s = mb.Scene("rod", gravity=(0, -9.81, 0))
    s.revolute("J", s.ground, s.link("a", (0, 0), (1, 0), mass=1.0), at=(0, 0), **given)
    return s


def slider(**given: Any) -> mb.Scene:
    s = mb.Scene("slider")
    s.prismatic("J", s.ground, s.rigid_body("a", 2.0, 1.0, at=(0, 0)), at=(0, 0), axis=(1, 0, 0), **given)
    return s


def tube(**given: Any) -> mb.Scene:
    s = mb.Scene("tube")
    s.cylindrical("J", s.ground, s.rigid_body("a", 1.0, (0.1, 0.1, 0.2), at=(0, 0, 0)), at=(0, 0, 0), axis=(0, 0, 1), **given)
    return s


@pytest.mark.parametrize(
    ("scene", "finding"),
    [
        (lambda: rod(limits=(-0.2, 0.9)), "revolute 'J': limits = (-0.2, 0.9) rad have no stop; give stop=mb.Stop(stiffness, damping)"),
        (lambda: rod(stop=STOP), "does nothing without limits of its angle; give limits=(lowest, highest), or omit it"),
        (lambda: rod(limits=(0.9, -0.2), stop=STOP), "limits = (0.9, -0.2): the lower limit is not below the upper one"),
        (lambda: rod(limits=(0.5, 0.5), stop=STOP), "limits = (0.5, 0.5): the lower limit is not below the upper one"),
        (lambda: rod(limits=(None, INF), stop=STOP), "it limits nothing; give a number, or omit limits and stop"),
        (lambda: rod(limits=(INF, None), stop=STOP), "limits = (inf, None) has a wrong entry, inf is not finite; give a pair (lowest, highest), rad"),
        (lambda: rod(limits=(math.nan, 1), stop=STOP), "limits = (nan, 1) has a wrong entry, nan is not finite; give a pair"),
        (lambda: rod(limits=0.5, stop=STOP), "limits = 0.5 is no pair of limits; give a pair (lowest, highest), rad; None for a side"),
        (lambda: rod(limits=(0, 1, 2), stop=STOP), "limits = (0, 1, 2) is no pair"),
        (lambda: rod(limits=("a", 1), stop=STOP), "limits = ('a', 1) has a wrong entry, 'a' is not a number; give a pair"),
        (lambda: rod(limits=(mb.t, 1), stop=STOP), "limits = (t, 1) has a wrong entry, t "),
        (lambda: slider(limits=(-1, True), stop=STOP), "limits = (-1, True) has a wrong entry, True "),
        (lambda: rod(limits=(-1, 1), stop=3e4), "stop = 30000.0 is no stop; give stop=mb.Stop(stiffness, damping)"),
        (lambda: rod(limits=(-1, 1), stop=mb.Stop(0.0)), "stop.stiffness = 0 N m/rad is not positive; give a positive number in N m/rad"),
        (lambda: slider(limits=(-1, 1), stop=mb.Stop(-5.0)), "stop.stiffness = -5 N/m is negative; give a positive number in N/m"),
        (lambda: slider(limits=(-1, 1), stop=mb.Stop(5.0, -1.0)), "stop.damping = -1 N s/m is negative: it would feed energy"),
        (lambda: slider(limits=(-1, 1), stop=mb.Stop(INF)), "stop.stiffness = inf is not finite"),
        (lambda: rod(limits=(-1, 1), stop=mb.Stop("hard")), "stop.stiffness = 'hard' is not a number"),
        (lambda: rod(angle0=1.5, limits=(-1, 1), stop=STOP), "angle0 = 1.5 rad is outside limits = (-1, 1) rad; start between them"),
        (lambda: rod(angle=mb.t, limits=(-1, 1), stop=STOP), "its angle is prescribed, so that no stop can hold it; omit limits and stop"),
        (lambda: rod(limits=(0.1, 1), stop=STOP), "its angle is outside its limits (0.1, 1) rad: start it inside them"),
        (lambda: tube(limits=(-1, 1), stop=STOP), "say for which coordinate, as in {'displacement': ...}"),
        (lambda: tube(limits={"turn": (-1, 1)}, stop=STOP), "there is no coordinate 'turn'; the joint has displacement, angle"),
        (lambda: tube(limits={"angle": (-1, 1)}, stop={"displacement": STOP}), "limits = (-1, 1) rad have no stop"),
        (lambda: rod(limits=(-1, 1), stop=STOP, model=mb.Clearance(0.02, 0.019, mb.Hertz(1e9))), "limits of a joint with clearance"),
    ],
)
def test_mistakes_are_told(scene, finding):
    with pytest.raises((mb.SceneError, mb.StartError)) as caught:
        scene().check()
    assert finding in str(caught.value), str(caught.value)


def laws(s: mb.Scene) -> list[JointStop]:
    return [law for law in s["J"].laws if isinstance(law, JointStop)]


@pytest.mark.parametrize("given", [(None, 0.9), (-INF, 0.9), [-np.inf, np.float64(0.9)], np.array([-np.inf, 0.9])])
def test_a_limit_may_have_one_side(given):
    (law,) = laws(rod(limits=given, stop=STOP))
    assert (law.lower, law.upper, law.stiffness, law.damping) == (None, 0.9, 3e4, 0.1)


def test_one_stop_serves_all_limits_and_each_may_have_its_own():
    limits = {"angle": (-1, 1), "displacement": (None, 0.1)}
    assert [(law.coordinate, law.stiffness) for law in laws(tube(limits=limits, stop=STOP))] == [("displacement", 3e4), ("angle", 3e4)]
    own = tube(limits=limits, stop={"angle": mb.Stop(5.0), "displacement": STOP})
    assert [(law.coordinate, law.stiffness, law.damping) for law in laws(own)] == [("displacement", 3e4, 0.1), ("angle", 5.0, None)]


@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical(), mb.Recursive()])
def test_variants_and_files_keep_limits(model, tmp_path):
    s = tube(limits={"angle": (-10, None), "displacement": (-0.1, 0.2)}, stop=mb.Stop(1e5, 3.0), start_rate={"displacement": 1.0})
    again = s.replace("J", model=model)
    assert [law.structure().absent for law in laws(again)] == [law.structure().absent for law in laws(s)]
    r = again.simulate(0.3, accuracy=1e-4)
    assert len(r["J"].contacts) == 1
    r.save(tmp_path / "run.npz")
    stored = mb.load(tmp_path / "run.npz")
    assert stored.contacts == r.contacts
    assert np.array_equal(stored["J"].displacement, r["J"].displacement)
    assert np.array_equal(stored.energy.impact, r.energy.impact)


def test_check_and_results_speak_of_the_limits():
    s = rod(limits=(-0.5, 0.9), stop=STOP)
    (text,) = s.check().contacts
    assert text.startswith("'J' with limits (-0.5, 0.9) rad of angle, an unknown of its own so that whole turns count, stop of 3e+04 N m/rad")
    r = s.simulate(0.6, accuracy=1e-4)
    assert list(r.contacts) == ["J"]
    assert r.contacts["J"]["contacts"] == len(r["J"].contacts) == 1
    assert r.contacts["J"]["deepest"] == r["J"].contacts.deepest > 0
    assert r.energy.impact[-1] == pytest.approx(r.energy.dissipated[-1])
    assert not r.warnings
    with pytest.raises(mb.OptionError, match="revolute 'J' has no contacts"):
        rod().simulate(0.1, accuracy=1e-3)["J"].contacts  # noqa: B018


def test_a_run_continues_inside_a_stop():
    """0.203 s from its start the body is past the limit; the two parts of the run are one."""
    s = slider(rate0=1.0, limits=(None, 0.2), stop=mb.Stop(1e4))
    first = s.simulate(0.203, accuracy=1e-7)
    assert first["J"].displacement[-1] > 0.2
    second = s.simulate(0.4, accuracy=1e-7, start=first)
    assert "starts with a penetration of" in second.start.changes[0]
    assert second["J"].displacement[-1] == pytest.approx(0.2 - (0.4 - 0.2 - math.pi * math.sqrt(2e-4)), abs=1e-6)


def test_the_example_of_the_docs_runs():
    page = (Path(__file__).parents[2] / "docs" / "contact.md").read_text(encoding="utf-8").split("## Limits of joints")[1]
    (text, *_) = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    exec(compile(text, "contact.md", "exec"), {"__name__": "contact"})


def test_rest_on_a_stop_is_found():
    """A rod rests on its stop: stiffness times the way past the limit is its weight's moment."""
    e = rod(angle0=0.3, limits=(0.0, None), stop=mb.Stop(3e4, 20.0)).equilibrium()
    assert e["J"].angle[-1] == pytest.approx(-9.81 / 2 / 3e4, rel=1e-6)
