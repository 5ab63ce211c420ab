"""The collector is paused while a scene is prepared, and in the end is as it was before."""

import gc
import subprocess
import sys

import pytest

import mbdae as mb
from mbdae.memory import building
from mbdae.system.prepare import prepare


@pytest.fixture(autouse=True)
def _collector():
    yield
    gc.enable()


@pytest.mark.parametrize("collects", [True, False])
def test_the_collector_is_as_it_was(collects):
    (gc.enable if collects else gc.disable)()
    assert building(gc.isenabled)() is False
    assert gc.isenabled() is collects


def test_the_collector_goes_on_after_an_error():
    with pytest.raises(mb.SceneError, match="has no bodies"):
        prepare(mb.Scene("empty"))
    assert gc.isenabled()


def test_no_pass_looks_through_all_modules_before_a_first_result():
    """Neither the import nor the first two runs bring the collector to its oldest generation."""
    code = """
import gc, numpy, symengine
gc.collect()
import mbdae as mb
before = gc.get_stats()[2]["collections"]
for _ in range(2):
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), damper=0.1)
    s.simulate(1.0)
print(gc.get_stats()[2]["collections"] - before, gc.isenabled())
"""
    found = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert found == ["0", "True"]
