"""How the tests run: on several processors, the quick and the slow ones by their lists. What tests of pages read them with: a
parser, and Chromium over chromedriver's own protocol."""

from __future__ import annotations

import base64
import gc
import json
import os
import shutil
import socket
import subprocess
import tempfile
import time
import urllib.request
from html.parser import HTMLParser
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
MOST = 4  #: workers: each holds some hundred MB
os.environ.setdefault("MPLBACKEND", "Agg")  # no window, also where there is a display
if "PYTEST_XDIST_WORKER" not in os.environ:  # workers share the folder: what one of them derives and compiles serves them all
    KEPT = tempfile.TemporaryDirectory(prefix="mbdae-tests-")
    os.environ["MBDAE_CACHE"] = str(Path(KEPT.name) / "kept")  # new for every run; tests of the cache have folders of their own
if "PYTEST_XDIST_WORKER" in os.environ:  # before NumPy is imported: workers with several BLAS threads each wait for each other
    os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")

DERIVE = ("mbdae.symbolic", "mbdae.laws", "mbdae.kernels", "mbdae.disk")  #: what derives and compiles

FLAGS = ["--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
         "--disable-quic", "--no-first-run", "--disable-sync",
         "--disable-background-networking", "--disable-component-update"]


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config):
    """Folders of tests run on several processors, unless -n says how many; a file or a single test in this process, at once."""
    option, is_worker = config.option, "PYTEST_XDIST_WORKER" in os.environ
    folders = any(Path(str(argument).split("::")[0]).is_dir() for argument in config.args)
    if getattr(option, "numprocesses", 0) is None and folders and not is_worker:
        processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        option.numprocesses = 0 if option.usepdb or option.collectonly else min(MOST, processors)
        option.dist = "worksteal"
    if getattr(option, "numprocesses", 0) and not is_worker:  # as users have it: each of some hundred processes that tests start
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # would compile all modules anew


def _replaced(self, target, *rest, _set=pytest.MonkeyPatch.setattr, **options):
    """`monkeypatch.setattr`. The keys of the cache do not see functions that are replaced while Python runs: as long as one of
    those that derive or compile is, nothing is read from it or written to it."""
    _set(self, target, *rest, **options)
    names = (target, getattr(target, "__module__", None), getattr(target, "__name__", None))
    if next(name for name in names if isinstance(name, str)).startswith(DERIVE):
        from mbdae.disk import store

        if hasattr(store, "cache_info"):  # else the test has a store of its own
            _set(self, store(), "why", "a test replaces what derives")


pytest.MonkeyPatch.setattr = _replaced


def pytest_collection_modifyitems(items):
    """The markers `quick` and `slow` for what tests/quick.txt and tests/slow.txt list."""
    listed = {name: set((HERE / f"{name}.txt").read_text(encoding="utf-8").splitlines()) for name in ("quick", "slow")}
    for item in items:
        if HERE in item.path.parents:
            file = item.path.relative_to(HERE).as_posix()
            for name, lines in listed.items():
                if not lines.isdisjoint({f"{file}::{item.originalname}", f"{file}::{item.name}"}):
                    item.add_marker(name)


def pytest_collection_finish():
    """What is imported and collected stays to the end: the collector of Python need not look at it over and over."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 20, 20)


class Reader(HTMLParser):
    """Tags, attributes, and whether every element is closed."""

    VOID = ("meta", "link", "br", "img")

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.attributes = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture
def read_html():
    return Reader


class Browser:
    """A window of a given width."""

    def __init__(self, port, profile):
        self.port, self.session = port, ""
        wanted = {"goog:chromeOptions": {"args": [*FLAGS, f"--user-data-dir={profile}"]}, "goog:loggingPrefs": {"browser": "ALL"}}
        self.session = "/" + self.call("", {"capabilities": {"alwaysMatch": wanted}})["sessionId"]

    def call(self, path, body=None, method="POST"):
        data = None if body is None else json.dumps(body).encode()
        url = f"http://127.0.0.1:{self.port}/session{self.session}{path}"
        request = urllib.request.Request(url, data, {"Content-Type": "application/json"}, method=method)
        with urllib.request.urlopen(request, timeout=60) as answer:
            return json.load(answer)["value"]

    def cdp(self, command, **params):
        return self.call("/goog/cdp/execute", {"cmd": command, "params": params})

    def show(self, path, width, mobile=None):
        mobile = width < 500 if mobile is None else mobile
        self.cdp("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=mobile)
        self.call("/url", {"url": path.as_uri()})

    def script(self, text):
        return self.call("/execute/sync", {"script": text, "args": []})

    def log(self):
        return self.call("/se/log", {"type": "browser"})

    def picture(self):
        return base64.b64decode(self.call("/screenshot", method="GET"))


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    driver = shutil.which("chromedriver")
    if driver is None or shutil.which("chromium") is None:
        pytest.skip("chromium and chromedriver are needed to look at the page; install them to run this")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    process = subprocess.Popen([driver, f"--port={port}"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        for _ in range(100):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.1)
        shown = Browser(port, tmp_path_factory.mktemp("profile"))
        yield shown
        shown.call("", method="DELETE")
    finally:
        process.terminate()
        process.wait()
