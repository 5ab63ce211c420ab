"""Scenes drawn at random, a few of every family; those that once failed; and what must be noticed is noticed."""

from __future__ import annotations

import importlib.util
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, find, given, settings
from hypothesis import strategies as st
from strangers import judge as judged
from strangers import session as session_module
from strangers.changes import WAYS, check, compare, failed
from strangers.draw import FAMILIES
from strangers.judge import Verdict, attempt, judge
from strangers.session import Counts, session, verdict_of
from strangers.story import Input, Said, Story, build, script

FOUND = sorted((Path(__file__).parent / "found").glob("*.py"))
LONG = ("light_contact",)  #: another contact that failed is among the others
FEW = settings(max_examples=1, derandomize=True, deadline=None, database=None, phases=[Phase.generate],
               suppress_health_check=list(HealthCheck))


@pytest.mark.parametrize("family", FAMILIES)
def test_a_drawn_run_is_right_or_says_that_it_is_not(family):
    @FEW
    @given(FAMILIES[family])
    def run(story):
        found = judge(story)
        assert not found.wrong, f"{found}\n{script(story)}"

    run()


@pytest.mark.parametrize("family", FAMILIES)
def test_a_drawn_scene_stated_in_another_way_moves_alike(family):
    @FEW
    @given(FAMILIES[family], st.sampled_from(sorted(WAYS)), st.sampled_from(sorted(WAYS)))
    def run(story, one, other):
        wrong = {name: verdict for name, verdict in check(story, {one, other}).items() if failed(verdict)}
        assert not wrong, f"{wrong}\n{script(story)}"

    run()


@pytest.mark.parametrize("path", [pytest.param(path, id=path.stem, marks=[pytest.mark.slow] * (path.stem in LONG))
                                  for path in FOUND])
def test_what_once_failed(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found = verdict_of(module.CHECK, module.STORY)
    assert found.verdict in ("right", "same"), f"{found}\n{script(module.STORY)}"


SWING = Story("swing", (
    Said("rigid_body", {"name": "b1", "mass": 1.0, "inertia": (0.02, 0.1, 0.1), "at": (0.5, 0.0, 0.0)}),
    Said("revolute", {"name": "J", "k": "ground", "l": "b1", "at": (0.0, 0.0, 0.0), "axis": (0.0, 0.6, 0.8), "rate0": 3.0,
                      "torque": Input("box", "sp.Heaviside({t} - 0.2) - sp.Heaviside({t} - 0.25)",
                                      ((-np.inf, "0"), (0.2, "1"), (0.25, "0")), scale=8.0)}),
    Said("rigid_body", {"name": "b2", "mass": 0.5, "inertia": (0.01, 0.03, 0.03), "at": (1.2, 0.0, 0.0)}),
    Said("spherical", {"name": "K", "k": "b1", "l": "b2", "at": (1.0, 0.0, 0.0)}),
), 0.5, 1e-5, (0.0, 0.0, -9.81))


def test_the_script_is_the_scene(tmp_path):
    """What is printed states the same scene as what is run."""
    names = {"__name__": "script"}
    exec(script(SWING), names)
    assert names["scene"]().statements == build(SWING).statements


@pytest.mark.parametrize("missing", ["torque", "rate0"])
def test_the_reference_notices_what_a_run_leaves_out(monkeypatch, missing):
    """A run without its short load is silent; one without the rate that its statement holds has a wrong start."""
    other = SWING.but(statements=tuple(Said(a.verb, {k: v for k, v in a.args.items() if k != missing}) for a in SWING.statements))
    assert judge(SWING).verdict == "right"
    monkeypatch.setattr(judged, "attempt", lambda story: attempt(other))
    assert judge(SWING).verdict == {"torque": "silent", "rate0": "wrong start"}[missing]


def test_the_checks_notice_another_motion():
    """Other ways are compared with a run whose first body is a thousandth heavier."""
    b1 = SWING.statements[0]
    base = attempt(SWING.but(statements=(b1.but(mass=b1.args["mass"] * 1.001), *SWING.statements[1:])))
    assert {name: compare(SWING, base, name).verdict for name in ("turned", "units", "ggl")} == dict.fromkeys(
        ("turned", "units", "ggl"), "differs")


def test_scenes_shrink_to_what_can_be_read():
    """The smallest loop with a slide that has a stop, and its script."""
    story = find(FAMILIES["tree"], lambda s: any("Stop" in str(a) for a in s.statements), random=random.Random(1),
                 settings=settings(FEW, max_examples=300, phases=[Phase.generate, Phase.shrink]))
    assert len(story.statements) == 2
    assert len(script(story).splitlines()) < 20


def test_a_session_goes_on_where_it_ended(tmp_path, monkeypatch):
    monkeypatch.setattr(session_module, "judge", lambda story: Verdict("right"))
    first = session(1.0, tmp_path, ("run",), ("tree",), most=1)
    again = session(1.0, tmp_path, ("run",), ("tree",), most=1)
    assert len(first.done) == 1
    assert len(again.done) == 2
    assert again.scenes("run") > first.scenes("run")
    assert Counts.read(tmp_path / "strangers.json").done == again.done
