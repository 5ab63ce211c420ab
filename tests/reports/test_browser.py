"""Reports in a real browser: no complaint, no missing glyph, no sideways scrolling of the page."""

from __future__ import annotations

import runpy
import shutil
import subprocess
from pathlib import Path

import pytest

import mbdae as mb
from mbdae.reports import names

EXAMPLES = Path(__file__).parents[2] / "examples"
FLAT = "return [...document.querySelectorAll('math')].filter(m => m.getBoundingClientRect().height < 3).length"
CUT = "return [...document.querySelectorAll('.lines')].filter(e => e.scrollWidth > e.clientWidth + 1).map(e => e.textContent)"
SIZE = "return Math.min(99, ...[...document.querySelectorAll('.lines math')].map(m => parseFloat(getComputedStyle(m).fontSize)))"
WIDE = "return [...document.querySelectorAll('.lines, .scroll')].filter(e => e.scrollWidth > e.clientWidth + 1).length"


def looked_at(browser, file, width):
    browser.show(file, width)
    inner, scrolled = browser.script("return [innerWidth, document.documentElement.scrollWidth]")
    assert inner == width
    assert scrolled <= inner
    assert browser.script("return performance.getEntriesByType('resource').filter(e => !e.name.startsWith('data:')).length") == 0
    assert browser.log() == []


@pytest.mark.slow
@pytest.mark.parametrize("name", names())
def test_reports_fit_their_window(name, browser, tmp_path):
    file = mb.report(name).save(tmp_path / "report.html")
    for width in (390, 1280):
        looked_at(browser, file, width)
        assert browser.script(SIZE) >= 12.0  # px, of the smallest formula
        assert width == 390 or browser.script(CUT) == []  # on a telephone a wide matrix scrolls in its own box
    assert browser.script(FLAT) == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["four_bar", "ground_resonance", "flapping_wing"])
def test_sheets_fit_their_window(name, browser, tmp_path):
    file = mb.report(runpy.run_path(str(EXAMPLES / f"{name}.py"))["scene"]()).save(tmp_path / "sheet.html")
    for width in (390, 1280):
        looked_at(browser, file, width)


@pytest.mark.slow
def test_equations_fit_a_desk_and_a_page(browser, tmp_path):
    """Equations break between their terms: at 1280 px none needs to be scrolled."""
    for name in ("revolute", "prismatic", "recursive", "beam", "lugre", "clearance"):
        browser.show(mb.report(name).save(tmp_path / f"{name}.html"), 1280)
        assert browser.script(WIDE) == 0, name


@pytest.mark.slow
def test_every_character_has_a_glyph(browser, tmp_path):
    """By the fonts the browser really used for the page, and by what fontconfig knows of every character."""
    finder = shutil.which("fc-list")
    if finder is None:
        pytest.skip("fc-list (fontconfig) is needed to ask for glyphs")
    letters = {c for name in names() for c in mb.report(name).to_html() if ord(c) > 126}
    fonts = {c: subprocess.run([finder, f":charset={ord(c):x}"], capture_output=True, check=True).stdout for c in letters}
    assert [c for c, found in fonts.items() if not found] == []
    browser.show(mb.report("revolute").save(tmp_path / "r.html"), 1280)
    browser.cdp("DOM.enable")
    browser.cdp("CSS.enable")
    root = browser.cdp("DOM.getDocument", depth=0)["root"]["nodeId"]
    body = browser.cdp("DOM.querySelector", nodeId=root, selector="body")["nodeId"]
    fonts = browser.cdp("CSS.getPlatformFontsForNode", nodeId=body)["fonts"]
    assert all("LastResort" not in font["familyName"] and "tofu" not in font["familyName"].lower() for font in fonts)
