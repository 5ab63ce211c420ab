"""What readers see of the pages that are written, on a desk and in a hand, in light and in the dark: nothing scrolls sideways, no
text is cut or lies over other text, and all of it stands out from its ground as WCAG 2 asks (4.5 to 1, large letters 3 to 1)."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import mbdae as mb
from mbdae.arena.page import Arena, Entry
from mbdae.notation import plain

ROOT = Path(__file__).parents[1]
WIDTHS = (1280, 390)

#: everything wrong with a page, one line each; boxes that match `scrolls` may be wider than what is seen of them
LOOK = r"""
const scrolls = arguments[0] || ":not(*)", wrong = [];
const seen = {opacityProperty: true, visibilityProperty: true};
const shown = (e) => e.checkVisibility(seen) && !e.closest(".unseen, .visually-hidden");
const parts = (text) => text.match(/[\d.]+/g).map(Number).concat(1).slice(0, 4);
const over = (a, b) => [0, 1, 2].map((i) => a[i] * a[3] + b[i] * (1 - a[3])).concat(1);
const light = (c) => c.slice(0, 3).map((v) => v / 255).map((v) => v <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4)
  .reduce((sum, v, i) => sum + v * [.2126, .7152, .0722][i], .05);
const turned = (c, by) => {  // a colour behind invert(by) hue-rotate(180deg)
  const v = c.slice(0, 3).map((x) => 255 * by + x * (1 - 2 * by));
  const m = [[-.574, 1.43, .144], [.426, .43, .144], [.426, 1.43, -.856]];
  return m.map((row) => Math.max(0, Math.min(255, row.reduce((sum, k, i) => sum + k * v[i], 0)))).concat(1);
};
function* above(e) { for (let x = e; x; x = x.parentElement) yield x; }
const root = getComputedStyle(document.documentElement);
const dark = matchMedia("(prefers-color-scheme: dark)").matches && root.colorScheme.includes("dark");
function ground(e) {
  const layers = [];
  for (const x of above(e)) { layers.push(parts(getComputedStyle(x).backgroundColor)); if (layers.at(-1)[3] >= 1) break; }
  return layers.reverse().reduce((under, one) => over(one, under), dark ? [18, 18, 18, 1] : [255, 255, 255, 1]);
}
const kind = (e) => e.tagName.toLowerCase() + (typeof e.className === "string" && e.className ? "." + e.className : "");
if (document.documentElement.scrollWidth > innerWidth) wrong.push(`the page is ${document.documentElement.scrollWidth} px wide`);
for (const e of document.querySelectorAll("body *"))
  if (shown(e) && e.clientWidth && getComputedStyle(e).overflowX !== "visible" && e.scrollWidth > e.clientWidth + 1
      && !e.matches("input, select, textarea, .headerlink") && !e.matches(scrolls))
    wrong.push(`cut by ${e.scrollWidth - e.clientWidth} px: ${kind(e)} ${e.textContent.trim().slice(0, 40)}`);
const boxes = [], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
for (let node; (node = walk.nextNode());) {
  const e = node.parentElement, text = node.textContent.trim(), range = document.createRange();
  if (!text || e.closest("script, style, title, desc, metadata, noscript") || !shown(e)) continue;
  range.selectNodeContents(node);
  const lines = [...range.getClientRects()].filter((r) => r.width > 1 && r.height > 1);
  if (!lines.length) continue;
  const style = getComputedStyle(e), colour = parts(e.closest("svg") && style.fill !== "none" ? style.fill : style.color);
  for (const x of above(e)) colour[3] *= getComputedStyle(x).opacity;
  let back = ground(e), front = over(colour, back);
  const filter = [...above(e)].map((x) => getComputedStyle(x).filter.match(/invert\(([\d.]+)\)/)).find(Boolean);
  if (filter) [back, front] = [turned(back, +filter[1]), turned(front, +filter[1])];
  const [low, high] = [light(front), light(back)].sort((a, b) => a - b), size = parseFloat(style.fontSize);
  const asked = size >= 24 || (size >= 18.66 && style.fontWeight >= 700) ? 3 : 4.5;
  if (high / low < asked) wrong.push(`contrast ${(high / low).toFixed(2)}: ${kind(e)} ${text.slice(0, 40)}`);
  for (const r of lines) {
    const apart = [...above(e)].some((x) => getComputedStyle(x).position === "fixed" || x.matches(scrolls));
    if (!apart && r.right > innerWidth + 1) wrong.push(`outside: ${text.slice(0, 40)}`);
    boxes.push([r, e, text]);
  }
}
boxes.sort((a, b) => a[0].top - b[0].top);
const layer = (e) => [...above(e)].find((x) => ["fixed", "sticky"].includes(getComputedStyle(x).position));
boxes.forEach(([p, e, text], i) => {
  for (const [q, other, more] of boxes.slice(i + 1)) {
    if (q.top > p.bottom) break;
    const wide = Math.min(p.right, q.right) - Math.max(p.left, q.left), high = Math.min(p.bottom, q.bottom) - q.top;
    if (wide > 2 && high > .45 * Math.min(p.height, q.height) && e !== other && layer(e) === layer(other)
        && !(e.closest("math") && other.closest("math")))
      wrong.push(`over each other: ${text.slice(0, 30)} | ${more.slice(0, 30)}`);
  }
});
return JSON.stringify([...new Set(wrong)]);
"""


def wrong(browser, file, width, scrolls=""):
    """What is wrong with a page in a window of this width (px), in light and in the dark."""
    browser.show(file, width)
    found = []
    for scheme in ("light", "dark"):
        browser.cdp("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        told = json.loads(browser.call("/execute/sync", {"script": LOOK, "args": [scrolls]}))
        found += [f"{file.stem} at {width}, {scheme}: {line}" for line in told]
    return found


# ---- the measure itself -------------------------------------------------------------------------------------------------


HEAD = '<!DOCTYPE html><meta name="viewport" content="width=device-width"><style>:root { color-scheme: light dark; }</style>'
BROKEN = {
    "the page is": '<div style="width: 2000px; height: 1px"></div>',
    "outside": '<p style="white-space: nowrap">' + "a long line " * 200 + "</p>",
    "cut by": '<pre style="overflow: auto">' + "x" * 400 + "</pre>",
    "over each other": '<p>one line of text</p><p style="margin-top: -2.2em">and another one</p>',
    "light: contrast": '<p style="color: #999">pale</p>',
    "dark: contrast": '<p style="color: #333; background: Canvas">dim</p>',
}


@pytest.mark.parametrize("said", BROKEN)
def test_what_is_wrong_is_seen(said, browser, tmp_path):
    (tmp_path / "good.html").write_text(HEAD + "<p>text</p>", encoding="utf-8")
    (tmp_path / "bad.html").write_text(HEAD + BROKEN[said], encoding="utf-8")
    assert wrong(browser, tmp_path / "good.html", 390) == []
    assert any(said in line for line in wrong(browser, tmp_path / "bad.html", 390))


# ---- the pages that are written -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """A small one of every kind, with long names, failed runs, and a text as notebooks show it."""
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    runs = [mb.Run(mb.IDA()), mb.Run(mb.RadauIIA(3), model=mb.Classical()), mb.Run(mb.IDA(), mb.Index3()),
            mb.Run(mb.RadauIIA(3), mb.GGL(), label="the same, with a label of a length that no column has")]
    w = mb.compare(s, 0.3, runs, [1e-3, 1e-5], measure=["hinge.angle", "rod.velocity"])
    folder = tmp_path_factory.mktemp("pages")
    w.to_html(folder / "comparison.html")
    values = {"rod.mass": (1e-6, 1e-4, 1e-2, 1.0, 1e2, 1e4, 1e6), "accuracy": (1e-3, 1e-6, 1e-12)}
    mb.extremes(s, 0.1, values, runs[2:], accuracy=1e-3).to_html(folder / "extremes.html")
    hashes = dict.fromkeys(("statements", "equations"), "0123456789abcdef" * 4)
    entries = tuple(Entry(name, "own", w if name == "pendulum" else None, "" if name == "pendulum" else "a reason", hashes)
                    for name in ("pendulum", "one that could not be compared"))
    Arena("arena of pendulums", 0.3, entries, {"engines": ["scipy 1.17.1"]}, w.environment).to_html(folder / "arena.html")
    (folder / "notebook.html").write_text(HEAD + plain(w.table()), encoding="utf-8")
    mb.report("revolute").save(folder / "report.html")
    mb.report("revolute", level="lecture").save(folder / "lecture.html")
    mb.report(s).save(folder / "sheet.html")
    s.simulate(0.3, accuracy=1e-3).animate(folder / "player.html", sensors=["hinge.angle"])
    return folder


#: what may be wider than its box: formulas and tables of a derivation in a hand, and text in columns as notebooks show it
SCROLL = {("report", 390): ".lines, .scroll", ("sheet", 390): ".lines, .scroll", ("lecture", 390): ".lines, .scroll",
          ("notebook", 390): "pre", ("notebook", 1280): "pre"}


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", ["comparison", "extremes", "arena", "report", "lecture", "sheet", "player", "notebook"])
def test_pages_fit_and_can_be_read(name, width, pages, browser):
    assert wrong(browser, pages / f"{name}.html", width, SCROLL.get((name, width), "")) == []


def test_a_sentence_breaks_and_columns_do_not(browser, tmp_path):
    """In text of notebooks, however short the line."""
    text = "a sentence of less than eighty letters, in a window less wide\nname    value\n" + "a" * 60 + "  1.0"
    (tmp_path / "text.html").write_text(plain(text), encoding="utf-8")
    browser.show(tmp_path / "text.html", 390)
    kinds = "return [...document.querySelectorAll('pre')].map(e => getComputedStyle(e).whiteSpace)"
    assert browser.script(kinds) == ["pre-wrap", "pre"]


# ---- pages of the site --------------------------------------------------------------------------------------------------


SITE = ("architecture", "command-line", "engines", "features", "limits", "measured", "speed", "words")  # tables, code, a drawing


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Some pages of the site, without what takes long to be made."""
    if any(importlib.util.find_spec(name) is None for name in ("sphinx", "myst_nb", "furo")):
        pytest.skip("the extra 'docs' is needed to build pages of the site; install it to run this")
    docs = tmp_path_factory.mktemp("site") / "docs"
    for name in ("_ext", "_static", "img"):
        shutil.copytree(ROOT / "docs" / name, docs / name)
    (docs / "made" / "site").mkdir(parents=True)
    for name in ("conf.py", *(f"{page}.md" for page in SITE)):
        shutil.copy(ROOT / "docs" / name, docs)
    (docs / "index.md").write_text("# Pages\n\n```{toctree}\n" + "\n".join(SITE) + "\n```\n", encoding="utf-8")
    build = [sys.executable, "-m", "sphinx", "-q", "-D", "extensions=myst_nb,sphinx.ext.autodoc,formulas,docstrings,narrow",
             "-b", "html", str(docs), str(docs / "out")]
    done = subprocess.run(build, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)}, timeout=300)
    assert done.returncode == 0, done.stderr
    return docs / "out"


@pytest.mark.slow
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", SITE)
def test_pages_of_the_site_fit_and_can_be_read(name, width, site, browser):
    assert wrong(browser, site / f"{name}.html", width, ".sidebar-scroll, .toc-scroll, .sidebar-drawer, .toc-drawer") == []
