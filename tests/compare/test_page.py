"""The page of a comparison: one file, everything on it, readable on a desk and in a hand."""

from __future__ import annotations

import json
import re
import socket
from html import unescape

import pytest

import mbdae as mb
from mbdae.compare.table import cells

NAME = "pendulum <b>&amp; co"


@pytest.fixture(scope="module")
def w():
    """Two models, and a run that fails on purpose."""
    s = mb.Scene(NAME, gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("hinge", s.ground, rod, at=(0, 0))
    runs = [mb.Run(mb.IDA()), mb.Run(mb.RadauIIA(3), model=mb.Classical()), mb.Run(mb.IDA(), mb.Index3())]
    return mb.compare(s, 0.5, runs, [1e-3, 1e-5], measure="hinge.angle")


def text_of(html):
    html = re.sub(r'<span class="kept">([^<]*)</span>', r"\1", html)  # numbers that stay on one line
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", html)).split())


def test_page_is_well_formed_and_needs_nothing_else(w, tmp_path, read_html):
    html = w.to_html(tmp_path / "w.html")
    assert (tmp_path / "w.html").read_text(encoding="utf-8") == html
    page = read_html(html)
    assert page.open == []
    links = [value for key, value in page.attributes if key in ("src", "href", "xlink:href")]
    assert all(link.startswith(("#", "data:,")) for link in links)
    assert "@import" not in html
    ids = [value for key, value in page.attributes if key == "id"]
    assert len(ids) == len(set(ids))
    assert {link[1:] for link in links if link.startswith("#")} <= set(ids)
    assert {found for key, value in page.attributes if key == "aria-labelledby" for found in value.split()} <= set(ids)


def test_page_is_accessible(w):
    html = w.to_html()
    assert '<html lang="en">' in html
    assert "<title>Solvers compared: pendulum &lt;b&gt;&amp;amp; co</title>" in html
    assert html.count('<svg role="img" aria-labelledby=') == 2
    assert '<th scope="col"' in html
    assert '<th scope="row"' in html


def test_page_tells_what_table_and_json_tell(w):
    shown = text_of(w.to_html())
    columns = [set(column) != {"-"} for column in zip(*map(cells, w.runs), strict=True)]  # others hold nothing
    for row in w.runs:
        assert " ".join(text for text, known in zip(cells(row), columns, strict=True) if text and known) in shown
    data = json.loads(w.to_json())
    for text in (w.reference.label, w.reference.confirmed_by, w.decision, str(w.pairwise), data["runs"][-1]["failure"]):
        assert text in shown
    for name, value in data["environment"].items():
        assert f"{name} {value}" in shown
    assert data["environment"]["cpus"] >= 1
    assert socket.gethostname() not in f"{shown} {w.table()}".split()


# ---- in a browser ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 390])
def test_page_fits_its_window_without_complaints(w, browser, width, tmp_path):
    file = tmp_path / "w.html"
    w.to_html(file)
    browser.show(file, width)
    inner, scrolled = browser.script("return [innerWidth, document.documentElement.scrollWidth]")
    assert inner == width
    assert scrolled <= inner
    assert browser.script("return performance.getEntriesByType('resource').length") == 0
    seen = "return [...document.querySelectorAll('figure svg')].map(s => s.getBoundingClientRect().width)"
    shown = [size for size in browser.script(seen) if size]
    assert len(shown) == 1
    assert 0.8 * width <= shown[0] <= width
    assert browser.call("/se/log", {"type": "browser"}) == []


@pytest.mark.slow
def test_a_heading_sorts_the_runs(w, browser, tmp_path):
    w.to_html(tmp_path / "w.html")
    browser.show(tmp_path / "w.html", 1280)
    column = "[...document.querySelector('tbody').rows].map(r => r.cells[3].textContent)"
    press = "document.querySelectorAll('th button')[3].click(); return " + column
    texts = [cells(row)[3] for row in w.runs]
    key = lambda text: float("inf") if text == "-" else float(text)  # noqa: E731
    assert browser.script(press) == sorted(texts, key=key)
    assert browser.script(press) == sorted(texts, key=key, reverse=True)
    assert browser.call("/se/log", {"type": "browser"}) == []
