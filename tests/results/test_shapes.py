"""Bodies drawn by their shapes: stated or of their contacts; stored; hidden; names inside the picture."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.results.stored_parts import started
from mbdae.show import symbols
from mbdae.show.shapes import geometry
from mbdae.system.prepare import prepare

SOFT = mb.Hertz(1e6, 0.3)


def seen(s: mb.Scene, **options: Any) -> Any:
    return geometry(started(prepare(s)), **options)


def kinds(found: Any, item: str) -> list[str]:
    return [shape.kind for shape in found.shapes if shape.item == item]


def yard(planar: bool) -> mb.Scene:
    """A ball over a floor with the shape of its contact, a crate with one of its own, a rod with a point that touches."""
    s = mb.Scene("yard", gravity=(0, -9.81, 0), space="planar" if planar else "spatial")
    J = 0.01 if planar else (0.01, 0.01, 0.01)
    ball = s.rigid_body("ball", 1.0, J, at=(0, 0.5), velocity=(1, 0, 0))
    s.rigid_body("crate", 1.0, J, at=(1, 0.4), shape=mb.Box(size=(0.3, 0.2, 0 if planar else 0.2)), color="tab:brown")
    rod = s.link("rod", (1.5, 0.5), (1.8, 0.6), (2, 0.3), mass=1.0)
    floor = mb.Plane(at=(0, 0), normal=(0, 1))
    s.contact("floor", s.ground, ball, floor, mb.Sphere(radius=0.1), normal=SOFT)
    s.contact("tip", s.ground, rod, floor, mb.Point(at=(2, 0.3)), normal=SOFT)
    s.contact("box", s.ground, "crate", floor, mb.Box(size=(0.2, 0.1, 0 if planar else 0.1)), normal=SOFT)
    return s


@pytest.mark.parametrize("planar", [True, False])
def test_bodies_have_their_own_shape_or_that_of_their_contact(planar: bool) -> None:
    found = seen(yard(planar))
    assert kinds(found, "ball") == (["disc", "line"] if planar else ["solid"])
    assert kinds(found, "crate") == (["plate"] if planar else ["solid"])
    assert kinds(found, "rod") == ["dot", "bar"]
    (crate,) = (found.polyline(x)[0] for x in found.shapes if x.item == "crate")
    np.testing.assert_allclose(np.ptp(crate, axis=0), (0.3, 0.2, 0 if planar else 0.2), atol=1e-12)  # not that of its contact
    assert next(x.colour for x in found.shapes if x.item == "crate") == "#8c564b"
    planes = [x for x in found.shapes if x.kind in ("hatch", "grid")]
    assert len(planes) == 1  # one floor for three contacts
    line = found.polyline(planes[0])[0]
    assert line[:, 0].min() < -0.1
    assert line[:, 0].max() > 2
    assert line[:, 1].max() == pytest.approx(0, abs=1e-12)  # strokes are inside


def test_solids_are_closed_and_turned_outwards() -> None:
    """Volume of a polyhedron: a sixth of the sum of determinants of triangles."""
    box = mb.Box(at=np.array([1.0, 2, 3]), size=np.array([1.0, 2, 3]))
    can = mb.Cylinder(at=np.array([1.0, 0, 0]), axis=np.array([0.6, 0, 0.8]), radius=0.5, length=2.0)
    ball = mb.Sphere(at=np.array([0.0, 1, 0]), radius=2.0)
    for one, volume, loss in ((box, 6.0, 1e-12), (can, np.pi / 2, 0.02), (ball, 32 * np.pi / 3, 0.07)):
        (part,) = symbols.drawn(one, False, 1.0)
        corners = [part.points[list(face)] for face in part.faces]
        parts = [np.linalg.det([c[0], c[i], c[i + 1]]) for c in corners for i in range(1, len(c) - 1)]
        assert volume * (1 - loss) <= sum(parts) / 6 <= volume * (1 + 1e-12)
        middle = part.points.mean(axis=0)
        assert all(np.cross(c[1] - c[0], c[2] - c[0]) @ (c.mean(axis=0) - middle) >= -1e-12 for c in corners)
        assert len(part.shades) == len(part.faces)


def test_a_plane_on_a_body_moves_with_it() -> None:
    s = mb.Scene("tray", gravity=(0, 0, -9.81))
    tray = s.rigid_body("tray", 5.0, (1, 1, 1), at=(0, 0, 1), velocity=(0, 0, 3))
    s.contact("on it", tray, s.point_mass("bead", 1.0, at=(0, 0, 1.2)), mb.Plane(normal=(0, 0, 1)), mb.Point(), normal=SOFT)
    found = geometry(s.simulate(0.1, 1e-3, outputs=3))
    (plane,) = (found.polyline(x) for x in found.shapes if x.kind == "grid")
    np.testing.assert_allclose(plane[:, :, 2], found.poses["tray"].position[:, None, 2] + 0 * plane[:, :, 2], atol=1e-9)


def test_shapes_and_colours_are_stored_and_repeated(tmp_path: Any) -> None:
    s = yard(False)
    s.point_mass("bead", 1.0, at=(0, 3, 0), shape=[mb.Sphere(radius=0.2), mb.Cylinder(radius=0.1, length=1)], color=(1, 0, 0))
    s.revolute("hinge", s.ground, "rod", at=(1.5, 0.5))
    r = s.simulate(0.05, 1e-3)
    r.save(tmp_path / "run.npz")
    for copy in (mb.load(tmp_path / "run.npz").prepared.model.scene, s.replace(model=mb.Recursive())):
        bead = copy["bead"]
        assert [type(x) for x in bead.shapes] == [mb.Sphere, mb.Cylinder]
        np.testing.assert_array_equal(bead.shapes[0].at, (0, 3, 0))
        assert bead.color == "#ff0000"
        old, new = ([(x.item, x.kind, x.colour) for x in seen(one).shapes if x.body] for one in (s, copy))
        assert old == new


def test_a_shape_changes_no_motion() -> None:
    bare, shaped = mb.Scene("a", gravity=(0, -9.81, 0)), mb.Scene("a", gravity=(0, -9.81, 0))
    for s, look in ((bare, {}), (shaped, {"shape": mb.Box(size=(1, 0.1)), "color": "C3"})):
        s.revolute("J", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0, **look), at=(0, 0))
    np.testing.assert_array_equal(*(s.simulate(0.3)["J"].angle for s in (bare, shaped)))


def test_hidden_items_are_left_out(tmp_path: Any) -> None:
    s = yard(True)
    found = seen(s, hide=["crate", "box"])
    assert {x.item for x in found.shapes} == {"ball", "rod", "floor"}
    assert all("crate" not in label.text for label in found.labels)
    assert "crate" not in {text.get_text() for text in s.draw(hide="crate").texts}
    s.simulate(0.05, 1e-3).animate(tmp_path / "a.html", hide=["rod", "tip"])
    assert '"kind":"bar"' not in (tmp_path / "a.html").read_text(encoding="utf-8")
    with pytest.raises(mb.SceneError, match="there is no item 'moon'"):
        s.draw(hide="moon")
    with pytest.raises(mb.OptionError, match="leaves nothing"):
        s.draw(hide=["ball", "crate", "rod", "floor", "tip", "box"])


def test_a_body_whose_inertia_is_no_bodys_is_a_small_box() -> None:
    s = mb.Scene("gimbal")
    s.rigid_body("dummy", 1e-3, 0.05, at=(0, 0))
    s.point_mass("load", 1.0, at=(1, 0))
    found = seen(s)
    assert kinds(found, "dummy") == ["box", "centre"]
    assert np.max(found.bounds[1] - found.bounds[0]) < 1.2


@pytest.mark.parametrize("planar", [True, False])
def test_long_and_many_names_are_inside_and_apart(planar: bool) -> None:
    s = mb.Scene("a scene with a name that is as long as a whole sentence of a report and then goes on for a while",
                 gravity=(0, -9.81, 0), space="planar" if planar else "spatial")
    for i in range(24):
        at = (0.1 * (i % 6), 0.06 * (i // 6), 0)
        s.point_mass(f"mass point number {i} of a row with a long name", 1.0, at=at)
    s.point_mass("right", 1.0, at=(0.75, 0))
    s.point_mass("Antidisestablishmentarianism_of_the_lower_left_support", 1.0, at=(0, 0))
    figure = s.draw()
    width, height = figure.get_size_inches() * figure.dpi
    title = figure.texts[0] if planar else figure.axes[0]._left_title
    boxes = [text.get_window_extent() for text in figure.texts if text is not title]
    assert len(boxes) == 25  # two are at one point
    for i, a in enumerate(boxes):
        assert 0 <= a.x0 <= a.x1 <= width
        assert 0 <= a.y0 <= a.y1 <= height
        assert not any(a.overlaps(b) for b in boxes[:i])
    box = title.get_window_extent()
    assert box.x1 <= width
    assert not any(box.overlaps(b) for b in boxes)


def test_mistakes_in_shapes_are_named() -> None:
    s = mb.Scene("mistakes")
    s.rigid_body("a", 1.0, 1.0, shape=mb.Sphere(radius=-1), color="no colour")
    s.rigid_body("b", 1.0, 1.0, at=(1, 0), shape=[mb.Sphere(), "cube"])
    with pytest.raises(mb.SceneError) as error:
        s.check()
    for words in ("shape.radius = -1", "color = 'no colour'; give a colour", "shape[1] = 'cube' is no shape"):
        assert words in str(error.value)


def test_forces_of_contacts_act_where_bodies_touch() -> None:
    """A ball that slides on a slope of 0.3, and one that lies on a fixed ball and is pressed down: point and force over time, by
    one scale, which the player tells."""
    s = mb.Scene("touching", gravity=(0, 0, -9.81))
    tilt, steel = 0.3, mb.Hertz(1e6, 1.0)
    normal = np.array([-np.sin(tilt), 0, np.cos(tilt)])
    ball = s.rigid_body("ball", 2.0, (0.008, 0.008, 0.008), at=(0.1 - 1e-5) * normal, shape=mb.Sphere(radius=0.1))
    other = s.rigid_body("other", 1.0, (0.004, 0.004, 0.004), at=(0, 3, 0.4), shape=mb.Sphere(radius=0.1))
    s.contact("slope", s.ground, ball, mb.Plane(at=(0, 0, 0), normal=normal), mb.Sphere(radius=0.1), normal=steel,
              friction=mb.Coulomb(0.1, 1e-2))
    s.contact("top", s.ground, other, mb.Sphere(at=(0, 3, 0), radius=0.3), mb.Sphere(radius=0.1), normal=steel)
    s.prismatic("guide", s.ground, other, at=(0, 3, 0.4), axis=(0, 0, 1))
    s.force("press", other, (0, 0, -30.0))
    r = s.simulate(0.4, accuracy=1e-4)
    seen = geometry(r)
    found = {shape.item: shape.points for shape in seen.shapes if shape.kind in ("push", "arrow")}
    for item, at in (("slope", r["ball"].position - 0.1 * normal), ("top", np.array([0, 3, 0.3]))):
        force = (found[item][:, 1] - found[item][:, 0]) * seen.newtons
        np.testing.assert_allclose(force, r[item].force, atol=1e-9 * np.max(r[item].force))
        acts = np.linalg.norm(force, axis=1) > 1.0
        assert np.count_nonzero(acts) > 100
        np.testing.assert_allclose(found[item][acts, 0], np.broadcast_to(at, force.shape)[acts], atol=2e-3)  # m, as deep
    along = r["slope"].force @ normal
    assert np.median(np.linalg.norm(np.cross(r["slope"].force, normal), axis=1) / along) == pytest.approx(0.1, rel=0.1)
    press = np.tile([0, 0, -30 / seen.newtons], (len(r.t), 1))
    np.testing.assert_allclose(found["press"][:, 1] - found["press"][:, 0], press, atol=1e-12)
    longest = max(np.max(np.linalg.norm(x[:, 1] - x[:, 0], axis=1)) for x in found.values())
    assert longest == pytest.approx(6 * 0.03 * seen.size)


# ---- in a browser --------------------------------------------------------------------------------------------------------


def touch(browser: Any, kind: str, *points: tuple[float, float]) -> None:
    fingers = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)]
    browser.cdp("Input.dispatchTouchEvent", type=kind, touchPoints=fingers)


@pytest.mark.slow
@pytest.mark.parametrize("planar", [True, False])
def test_the_player_is_driven_by_fingers(planar: bool, browser: Any, tmp_path: Any) -> None:
    yard(planar).simulate(1.0, 1e-3).animate(tmp_path / "a.html", sensors=["ball.position", "floor.normal_force"], trail="ball")
    browser.cdp("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=5)
    browser.show(tmp_path / "a.html", 390)
    camera = "return [camera.turn, camera.tip, camera.zoom, camera.x, camera.y]"
    home = browser.script(camera)

    def drag(*path: Any) -> None:
        touch(browser, "touchStart", *path[0])
        for points in path[1:]:
            touch(browser, "touchMove", *points)
            time.sleep(0.1)  # a finger that leaves fast throws the page, and the next tap only stops it
            touch(browser, "touchMove", *points)
        touch(browser, "touchEnd")

    drag([(150, 200)], [(160, 205)], [(180, 210)])  # one finger turns, or moves what is flat
    moved = browser.script(camera)
    assert (moved[0] != home[0]) == (not planar)
    assert (moved[3] != home[3]) == planar
    drag([(150, 200), (220, 200)], [(140, 200), (230, 200)], [(115, 200), (255, 200)])  # two enlarge
    assert browser.script(camera)[2] == pytest.approx(2.0, rel=0.2)
    for _ in range(2):
        drag([(100, 150)])
    assert browser.script(camera) == home  # a double tap resets
    left, top, width = browser.script("const r = strips[1].canvas.getBoundingClientRect(); return [r.left, r.top, r.width]")
    drag([(left + 100, top + 30)], [(left + 62 + (width - 72) / 2, top + 32)])
    assert browser.script("return now") == pytest.approx(0.5, abs=0.02)  # a chart is a time line
    x, y = browser.script("const r = play.getBoundingClientRect(); return [r.left + 20, r.top + 20]")
    browser.script("el('speed').value = '0.1'")
    drag([(x, y)])
    time.sleep(0.3)
    assert browser.script("return playing && now > 0.5")
    assert browser.script("return [scrollX, scrollY]") == [0, 0]
    assert browser.log() == []


@pytest.mark.slow
def test_charts_are_beside_the_motion_where_there_is_room(browser: Any, tmp_path: Any) -> None:
    yard(True).simulate(0.5, 1e-3).animate(tmp_path / "a.html", sensors=["ball.position"])
    for width, beside in ((1280, True), (390, False)):
        browser.show(tmp_path / "a.html", width)
        view, chart = (browser.script(f"const r = {x}.getBoundingClientRect(); return [r.left, r.right, r.top, r.bottom]")
                       for x in ("view", "strips[0].canvas"))
        assert (chart[0] >= view[1]) == beside
        assert (chart[2] >= view[3]) == (not beside)
        assert browser.script("return document.documentElement.scrollWidth") == width
