"""The page of a map of extremes: everything on it, told apart without colours, fitting a desk and a hand."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest

import mbdae as mb
from mbdae.extremes.cell import VERDICTS
from mbdae.extremes.page import COLOURS, Block, Extremes, notes
from mbdae.notation import counted


@pytest.fixture(scope="module")
def m():
    """One measured map, its cells given every verdict in turn."""
    s = mb.Scene("pendulum <b>&amp; co", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    runs = [mb.Run(mb.IDA(), mb.GGL()), mb.Run(mb.IDA(), mb.Index3()), mb.Run(mb.RadauIIA(3), mb.GGL(), label="a <name>")]
    found = mb.extremes(s, 0.2, {"rod.mass": (1e-4, 1e5)}, runs, accuracy=1e-3)
    (block,) = found.blocks
    names = list(VERDICTS)
    cells = tuple(replace(c, verdict=names[i % 6]) if c.failure is None else c for i, c in enumerate(block.cells))
    return replace(found, blocks=(replace(block, cells=cells),))


def shown(html):
    html = re.sub(r'<span class="kept">([^<]*)</span>', r"\1", html)  # numbers that stay on one line
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", html)).split())


def test_page_is_well_formed_and_needs_nothing_else(m: Extremes, tmp_path, read_html):
    html = m.to_html(tmp_path / "m.html")
    assert (tmp_path / "m.html").read_text(encoding="utf-8") == html
    page = read_html(html)
    assert page.open == []
    assert [value for key, value in page.attributes if key in ("src", "href")] == ["data:,"]
    ids = [value for key, value in page.attributes if key == "id"]
    assert len(ids) == len(set(ids))
    assert {value for key, value in page.attributes if key == "aria-labelledby"} <= set(ids)
    assert '<html lang="en">' in html
    assert "pendulum &lt;b&gt;&amp;amp; co" in html


def test_page_tells_every_cell_every_count_and_every_remark(m: Extremes):
    text = shown(m.to_html())
    for name, n in m.counts.items():
        assert re.search(rf"\S+ {n} {name} : ", text), name
    (block,) = m.blocks
    for label in block.labels:
        assert label in text
    for value in block.values:
        assert f" {value:g} " in text
    for note in notes(block):
        assert note in text
    assert f"Silently wrong: {counted(len(m.silent), 'run')}." in text
    assert "No run was silently wrong." in shown(replace(m, blocks=()).to_html())


def test_remarks_that_differ_in_numbers_are_told_once(m: Extremes):
    (block,) = m.blocks
    cell = block.cells[0]
    said = [replace(cell, value=float(i), warnings=(f"the error is {i}.5e-3 at t = {i}",), failure=None) for i in range(5)]
    alike = Block("p", tuple(c.value for c in said), ("",) * 5, tuple(said))
    assert notes(alike) == [f"said: the error is 0.5e-3 at t = 0 ({cell.label} at 0 and 4 more runs)"]


def luminance(colour):
    parts = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(a, b):
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


def test_cells_can_be_read_and_told_apart_in_grey():
    for back, front in COLOURS.values():
        assert contrast(back, front) >= 4.5
    silent = COLOURS["missed silently"][0]
    assert all(contrast(silent, back) > 2.5 for name, (back, _) in COLOURS.items() if name != "missed silently")


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 390])
def test_page_fits_its_window_without_complaints(m: Extremes, browser, width, tmp_path: Path):
    file = tmp_path / "m.html"
    m.to_html(file)
    browser.show(file, width)
    inner, scrolled = browser.script("return [innerWidth, document.documentElement.scrollWidth]")
    assert inner == width
    assert scrolled <= inner
    spilled = "return [...document.querySelectorAll('table.map td')].filter(c => c.scrollWidth > c.clientWidth).length"
    assert browser.script(spilled) == 0
    browser.script("document.querySelector('details').open = true")
    assert browser.script("return document.documentElement.scrollWidth") <= inner
    assert browser.log() == []
