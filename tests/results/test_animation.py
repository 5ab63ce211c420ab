"""GIF and player: frames, times, data; the page works alone in a browser."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbdae as mb
from mbdae.show import player
from mbdae.show.shapes import frame_times, natural_speed


def data_of(page: str) -> dict[str, Any]:
    found = re.search(r'<script id="film" type="application/json">(.*?)</script>', page, re.S)
    assert found is not None
    return json.loads(found[1])  # type: ignore[no-any-return]


def test_gif_has_the_frames_and_pace_asked_for(bar: Any, tmp_path: Path) -> None:
    from PIL import Image

    bar.animate(tmp_path / "a.gif", sensors=["C.angle", "A.force"], fps=10, speed=1.0, trail="C")
    with Image.open(tmp_path / "a.gif") as image:
        assert image.n_frames == 7
        assert image.info["duration"] == 100  # ms
        first, last = (np.asarray(_frame(image, i)) for i in (0, 6))
    assert np.any(first != last)


def _frame(image: Any, i: int) -> Any:
    image.seek(i)
    return image.convert("RGB")


def test_a_gif_has_the_colours_of_bodies_that_others_hide_for_a_while(tmp_path: Path) -> None:
    """A crank that is behind its rod in the middle of the run, seen at the beginning and the end."""
    from PIL import Image

    s = mb.Scene("crank behind its rod")
    crank = s.link("crank", (0, 0), (0, 1), mass=1.0, color="#0072B2")
    rod = s.link("rod", (0, 1), (3, 0), mass=1.0, color="#D55E00")
    s.revolute("A", s.ground, crank, at=(0, 0), angle=np.pi * mb.t)
    s.revolute("B", crank, rod, at=(0, 1))
    s.point_on_line("C", s.ground, rod, at=(3, 0), axis=(1, 0, 0))
    s.simulate(1.0).animate(tmp_path / "a.gif", fps=10)
    with Image.open(tmp_path / "a.gif") as image:
        first = np.array(image.convert("RGB"), dtype=float)
    for colour in ((0, 0x72, 0xB2), (0xD5, 0x5E, 0)):
        assert np.min(np.max(np.abs(first - colour), axis=2)) < 12


def test_gif_in_space(tmp_path: Path) -> None:
    s = mb.Scene("top", gravity=(0, 0, -9.81))
    top = s.rigid_body("top", 1.0, (0.02, 0.04, 0.02), at=(0, 1, 0), angular_velocity=(0, 5, 0))
    s.spherical("tip", s.ground, top, at=(0, 0, 0))
    s.simulate(0.2, accuracy=1e-2).animate(tmp_path / "top.gif", fps=10, speed=1.0, sensors="top.position")
    assert (tmp_path / "top.gif").stat().st_size > 5_000


def test_player_holds_the_motion_and_nothing_from_outside(zoo_run: Any, tmp_path: Path) -> None:
    zoo_run.animate(tmp_path / "a.html", sensors=["P.rate", "arm.position"], trail=["bob", "S"])
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert """content="default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:">""" in page
    assert (player.THREE in page) == (not zoo_run.prepared.model.planar)
    assert not re.search(r"https?:|//[a-z]|\bsrc=|@import|url\(", page.replace(player.THREE, ""))
    film = data_of(page)
    t = np.array(film["t"])
    moved = np.array(film["bodies"]["cart"]["r"]) * film["unit"]
    np.testing.assert_allclose(moved, zoo_run(np.clip(t, 0, 0.4)).read("cart.position"), atol=0.6 * film["unit"])
    R = np.array(film["bodies"]["arm"]["R"]).reshape(-1, 3, 3) * film["grain"]
    np.testing.assert_allclose(R, zoo_run(np.clip(t, 0, 0.4)).read("arm.rotation"), atol=0.6 * film["grain"])
    assert [curve["label"] for curve in film["curves"]] == ["P.rate [m/s]", "arm.position [m]"]
    assert [trail["name"] for trail in film["trails"]] == ["bob", "S"]
    assert len(film["times"]) == len(film["curves"][0]["values"][0]) == len(film["trails"][0]["points"])


def test_a_name_cannot_break_the_page(bar: Any, tmp_path: Path) -> None:
    bar.animate(tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert page.count("</script>") == 2
    assert data_of(page)["name"] == "four-bar </script>"
    assert len(page) < 200_000


def test_times_and_speed() -> None:
    np.testing.assert_allclose(frame_times(1.0, 2.0, 0.1), 1 + np.arange(21) / 10)
    assert len(frame_times(0.0, 1e4, 0.01)) == 600
    assert [natural_speed(d) for d in (0.0, 2.0, 60.0, 0.03, 0.9, 1000.0)] == [1, 1, 1, 0.002, 0.1, 100]


def test_errors_of_animate(bar: Any, tmp_path: Path) -> None:
    with pytest.raises(mb.OptionError, match=r"a\.mp4. does not end in \.gif or \.html or \.glb: animate writes"):
        bar.animate(tmp_path / "a.mp4")
    with pytest.raises(mb.OptionError, match=r"in a folder .* that does not exist"):
        bar.animate(tmp_path / "nowhere" / "a.gif")
    with pytest.raises(mb.SceneError, match=r"there is no sensor 'C\.angel'"):
        bar.animate(tmp_path / "a.html", sensors=["C.angel"])
    with pytest.raises(mb.SceneError, match="there is no item 'Q'"):
        bar.animate(tmp_path / "a.html", trail="Q")
    with pytest.raises(mb.OptionError, match="speed = -1"):
        bar.animate(tmp_path / "a.html", speed=-1)
    assert not list(tmp_path.iterdir())


def test_a_glb_moves_as_the_run(flexible_run: Any, tmp_path: Path) -> None:
    """Read by trimesh (places at the start) and by the numbers of its keys (a crank that turns; a beam that bends)."""
    trimesh = pytest.importorskip("trimesh")
    made = flexible_run.animate(tmp_path / "a.glb", trail="hook.at(1.0)", hide="wind")
    content = (tmp_path / "a.glb").read_bytes()
    length = int.from_bytes(content[12:16], "little")
    head, data = json.loads(content[20:20 + length]), content[28 + length:]
    assert made.path == tmp_path / "a.glb"
    assert not made.left_out

    def array(n: int) -> Any:
        found = head["accessors"][n]
        begin = head["bufferViews"][found["bufferView"]]["byteOffset"]
        columns = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[found["type"]]
        return np.frombuffer(data, np.float32, found["count"] * columns, begin).reshape(-1, columns)

    (film,) = head["animations"]
    keys = {(c["target"]["node"], c["target"]["path"]): film["samplers"][c["sampler"]] for c in film["channels"]}
    names = [node["name"] for node in head["nodes"]]
    crank = names.index("crank")
    t = array(keys[crank, "rotation"]["input"])[:, 0]
    q = array(keys[crank, "rotation"]["output"])
    run = flexible_run(np.clip(t.astype(float), 0, 0.4))
    np.testing.assert_allclose(Rotation.from_quat(q).as_matrix(), run.read("crank.rotation"), atol=1e-5)
    np.testing.assert_allclose(array(keys[crank, "translation"]["output"]), run.read("crank.position"), atol=1e-6)
    rods = [i for i, name in enumerate(names) if name == "rod"]
    tips = [array(keys[i, "translation"]["output"]) for i in rods if (i, "translation") in keys]
    assert min(np.max(np.abs(tip - run.read("rod.at(0.5).position"))) for tip in tips) < 1e-5
    scene = trimesh.load(tmp_path / "a.glb")
    place, _ = scene.graph.get("crank")
    upright = Rotation.from_quat(head["nodes"][0]["rotation"]).as_matrix()
    np.testing.assert_allclose(place[:3, 3], upright @ run.read("crank.position")[0], atol=1e-6)
    assert upright @ flexible_run.prepared.model.scene.gravity == pytest.approx([0, -9.81, 0])


# ---- in a browser --------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 390])
def test_the_player_plays(zoo_run: Any, browser: Any, tmp_path: Path, width: int) -> None:
    zoo_run.animate(tmp_path / "a.html", sensors=["P.rate", "arm.position"], trail="bob", speed=0.02)
    browser.show(tmp_path / "a.html", width, mobile=False)
    read = "return Number(document.getElementById('time').textContent.match(/[0-9.]+/)[0])"
    assert browser.script(read) == 0
    browser.script("document.getElementById('play').click()")

    def later(than: float) -> float:
        """The first time that is shown after another one: playing takes as long as the machine is busy, up to its end."""
        end = time.monotonic() + 20
        while (seen := browser.script(read)) <= than and time.monotonic() < end:
            time.sleep(0.1)
        return float(seen)

    first = later(0.0)
    assert 0 < first < later(first) <= 0.4
    browser.script("document.getElementById('play').click()")
    stopped = browser.script(read)
    time.sleep(0.3)
    assert browser.script(read) == stopped
    key = "document.getElementById('view').dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowLeft', cancelable: true}))"
    before = browser.picture()
    browser.script(key)
    assert (browser.picture() != before) == (not zoo_run.prepared.model.planar)
    assert browser.script("return document.documentElement.scrollWidth <= window.innerWidth")
    controls = "[...document.querySelectorAll('button,input,select')]"
    assert browser.script(f"return {controls}.every(e => e.ariaLabel || e.labels?.length || e.textContent)")
    assert not browser.log()


@pytest.mark.slow
def test_the_player_bends_beams(flexible_run: Any, browser: Any, tmp_path: Path) -> None:
    flexible_run.animate(tmp_path / "a.html", sensors=["rod.at(0.5).stress_resultants"], trail="hook.at(1.0)", speed=0.2)
    browser.show(tmp_path / "a.html", 900)
    rod = "film.shapes.find(s => s.kind === 'bar' && !s.body && s.points.length > 1)"
    bend = f"""const at = k => {{ now = T0 + k * span; show();
      const p = pointsOf({rod}, {{}}, frame()), a = p[0], b = p[p.length - 1];
      return Math.hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]); }}; return [at(0), at(1)]"""
    straight, bent = browser.script(bend)
    ends = [flexible_run(t)["rod"].at(s).position[0] for t in (0.0, 0.4) for s in (0.0, 1.0)]
    assert [straight, bent] == pytest.approx([np.linalg.norm(ends[1] - ends[0]), np.linalg.norm(ends[3] - ends[2])], abs=1e-3)
    assert bent < 0.95 * straight
    last = browser.picture()
    browser.script("now = T0; show()")
    assert browser.picture() != last
    assert not browser.log()


def top(tmp_path: Path) -> Path:
    """The page of a top in space."""
    s = mb.Scene("top", gravity=(0, 0, -9.81))
    body = s.rigid_body("top", 1.0, (0.02, 0.04, 0.02), at=(0, 1, 1), angular_velocity=(0, 5, 0), shape=mb.Sphere(radius=0.3))
    s.spherical("tip", s.ground, body, at=(0, 0, 1))
    s.simulate(0.2, accuracy=1e-2).animate(tmp_path / "top.html")
    return tmp_path / "top.html"


@pytest.mark.slow
def test_a_scene_in_space_has_light_and_shadow(browser: Any, tmp_path: Path) -> None:
    browser.show(top(tmp_path), 900)
    shadow, tones = browser.script("""show();
      const gl = el("lit").getContext("webgl2"), w = gl.drawingBufferWidth, h = gl.drawingBufferHeight;
      const seen = new Uint8Array(4 * w * h), tones = new Set(); gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, seen);
      let shadow = 0;
      for (let i = 0; i < seen.length; i += 4)
        if (seen[i + 3] === 255) tones.add(seen[i + 2]); else if (seen[i + 3] && !seen[i] && !seen[i + 2]) shadow++;
      return [shadow / w / h, tones.size]""")
    assert 0.005 < shadow < 0.2  # share of the picture
    assert tones > 60  # of blue on the ball alone
    assert browser.script("return el('flat').hidden && el('told').textContent") == \
        "A mechanism in space from 0 s to 0.2 s; bodies: top; joints and forces: tip."
    assert not browser.log()


@pytest.mark.slow
def test_without_webgl_a_sentence_and_lines_stand_instead(browser: Any, tmp_path: Path) -> None:
    off = """const get = HTMLCanvasElement.prototype.getContext;
      HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
        return kind === "2d" ? get.call(this, kind, ...more) : null; }"""
    added = browser.cdp("Page.addScriptToEvaluateOnNewDocument", source=off)["identifier"]
    try:
        browser.show(top(tmp_path), 390)
        assert browser.script("return !el('flat').hidden && el('lit').hidden")
        ink = """const c = view.getContext("2d"), seen = c.getImageData(0, 0, view.width, view.height).data;
          let blue = 0; for (let i = 0; i < seen.length; i += 4) if (seen[i + 2] > seen[i] + 60) blue++; return blue"""
        assert browser.script(ink) > 500  # px of the ball's edges
        assert not browser.log()
    finally:
        browser.cdp("Page.removeScriptToEvaluateOnNewDocument", identifier=added)
