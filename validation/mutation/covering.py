"""A plugin of pytest: which lines of the package every test executes, its CPU time, and whether it starts processes.

Loaded by `covers.py` in a process of its own for every test file, so that the first test that needs a law derives it there.
Untraced, tests count as those that start processes: of both it is not known what they execute.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from pathlib import Path

import coverage
import pytest

PLACE = Path(os.environ["MBDAE_COVERS"])  #: the data of coverage; beside it, ending in .json, what is known of the tests
STARTS = {"subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn", "os.exec"}
lines = coverage.Coverage(data_file=str(PLACE), include=["*/mbdae/*"], config_file=False)
IS_TRACED = os.environ.get("MBDAE_UNTRACED") is None
if IS_TRACED:
    lines.start()
found: dict[str, dict[str, object]] = {}
started = [0]


def _heard(event: str, _: object) -> None:
    started[0] += event in STARTS


sys.addaudithook(_heard)
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in what a shell starts in the background; tests interrupt


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item):  # type: ignore[no-untyped-def]
    """Lines that are executed from here on belong to this test."""
    if IS_TRACED:
        lines.switch_context(item.nodeid)
    before, begin, children = started[0], time.process_time(), sum(os.times()[2:4])
    yield
    inside, outside = time.process_time() - begin, sum(os.times()[2:4]) - children
    found.setdefault(item.nodeid, {}).update(cpu=inside + outside, starts=started[0] > before or outside > 0 or not IS_TRACED)
    if IS_TRACED:
        lines.switch_context("")


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """A test that fails or is skipped judges nothing."""
    one = found.setdefault(report.nodeid, {})
    one["passed"] = one.get("passed", True) and report.passed


def pytest_sessionfinish() -> None:
    """Keep both."""
    if IS_TRACED:
        lines.stop()
    lines.save()
    PLACE.with_suffix(".json").write_text(json.dumps(found), encoding="utf-8")
