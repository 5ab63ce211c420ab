"""The collector is paused while a scene is prepared, and in the end is as it was before."""

import gc
import subprocess
import sys

import pytest

import mbdae as mb
from mbdae.process import building
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


def test_the_import_makes_no_passes():
    """There is one afterwards, through what was imported."""
    code = """
import gc, numpy, symengine
import mbdae as mb
before = gc.get_stats()[0]["collections"]
mb.Scene
print(gc.get_stats()[0]["collections"] - before <= 1, gc.isenabled())
"""
    found = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert found == ["True", "True"]
