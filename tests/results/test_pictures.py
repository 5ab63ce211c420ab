"""Pictures: panels, units, components, names; files that are written, and errors that say what to do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import mbdae as mb
from mbdae.show.animation import _Stage
from mbdae.show.shapes import filmed


def test_one_panel_per_quantity_with_units(bar: Any, tmp_path: Path) -> None:
    figure = bar.plot("C.angle", "D.angle", "A.force", "crank.angular_velocity", "crank.rotation", path=tmp_path / "a.png")
    labels = [axis.get_ylabel() for axis in figure.axes]
    assert labels == ["angle [rad]", "force [N]", "angular velocity [rad/s]", "rotation [-]"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_planar_vectors_show_the_components_of_the_plane(bar: Any) -> None:
    figure = bar.plot("A.force", "crank.angular_velocity")
    assert [line.get_label() for axis in figure.axes for line in axis.lines] == [
        "A.force x", "A.force y", "crank.angular_velocity z"]
    looks = [(line.get_color(), line.get_linestyle()) for line in figure.axes[0].lines]
    assert len({color for color, _ in looks}) == len({dash for _, dash in looks}) == 2


def test_the_rate_of_a_slider_is_in_metres_per_second(zoo_run: Any) -> None:
    figure = zoo_run.plot("P.rate", "R.rate", "P.displacement")
    assert [axis.get_ylabel() for axis in figure.axes] == ["speed [m/s]", "rate [rad/s]", "displacement [m]"]


def test_results_over_each_other(bar: Any) -> None:
    other = bar(bar.t[::3])
    figure = bar.plot("C.angle", against=[other], labels=["fine", "coarse"])
    lines = figure.axes[0].lines
    assert [line.get_label() for line in lines] == ["C.angle (fine)", "C.angle (coarse)"]
    np.testing.assert_array_equal(lines[1].get_ydata(), other["C"].angle)
    named = bar.plot("C.angle", against=other).axes[0].lines
    assert len({line.get_label() for line in named}) == 2
    with pytest.raises(mb.OptionError, match=r"labels = \['one'\] has 1 entry for 2 results"):
        bar.plot("C.angle", against=other, labels=["one"])


def test_phase_and_orbit(bar: Any, tmp_path: Path) -> None:
    (axis,) = bar.phase("C.angle", "C.rate", path=tmp_path / "phase.svg").axes
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("C.angle [rad]", "C.rate [rad/s]")
    np.testing.assert_array_equal(axis.lines[0].get_ydata(), bar["C"].rate)
    place = bar.prepared.model.scene["coupler"].at(1.0)
    for what in ("C", "coupler.position", place):
        (axis,) = bar.orbit(what, against=bar, path=tmp_path / "orbit.pdf").axes
        assert axis.get_aspect() == 1
        assert axis.get_ylabel().endswith("y [m]")
    np.testing.assert_allclose(axis.lines[0].get_xdata(), bar[place].position[:, 0])
    with pytest.raises(mb.OptionError, match="axes = 'xx' is not a plane"):
        bar.orbit("C", axes="xx")
    with pytest.raises(mb.OptionError, match=r"'C\.angle' is not a place"):
        bar.orbit("C.angle")


def test_errors_of_plot(bar: Any, tmp_path: Path) -> None:
    with pytest.raises(mb.SceneError, match=r"there is no sensor 'C\.angel'"):
        bar.plot("C.angel")
    with pytest.raises(mb.SceneError, match="there is no item 'Q'"):
        bar.plot("Q.angle")
    with pytest.raises(mb.OptionError, match=r"'crank\.at' is not a quantity over time"):
        bar.plot("crank.at")
    with pytest.raises(mb.OptionError, match="name at least one sensor"):
        bar.plot()
    with pytest.raises(mb.OptionError, match=r"does not end in \.png or \.svg or \.pdf: plot writes"):
        bar.plot("C.angle", path=tmp_path / "a.bmp")
    with pytest.raises(mb.OptionError, match=r"in a folder .* that does not exist"):
        bar.plot("C.angle", path=tmp_path / "nowhere" / "a.png")


def test_draw_writes_and_names_everything(zoo_run: Any, tmp_path: Path) -> None:
    scene = zoo_run.prepared.model.scene
    figure = scene.draw(tmp_path / "zoo.png")
    written = figure.texts[1:] if zoo_run.prepared.model.planar else figure.texts  # behind the title
    names = {name for text in written for name in text.get_text().split(", ")}
    assert names == {item.name for item in (*scene.bodies, *scene.connections)}
    assert (tmp_path / "zoo.png").stat().st_size > 10_000
    (axes,) = figure.axes
    assert axes.name == ("rectilinear" if zoo_run.prepared.model.planar else "3d")
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")


def test_names_stay_apart_and_near(bar: Any) -> None:
    figure = bar.prepared.model.scene.draw()
    boxes = [text.get_window_extent() for text in figure.texts]
    width, height = figure.get_size_inches() * figure.dpi
    for i, a in enumerate(boxes):
        assert 0 <= a.x0 <= a.x1 <= width
        assert 0 <= a.y0 <= a.y1 <= height
        assert not any(a.overlaps(b) for b in boxes[:i])


@pytest.mark.parametrize("name", ["column", "a column that hangs from the ceiling and is much higher than it is wide " * 2])
def test_texts_of_a_narrow_picture_are_inside_and_apart(name: str) -> None:
    s = mb.Scene(name, gravity=(0, -9.81, 0))
    s.revolute("top", s.ground, s.link("rod", (0, 0), (0, -3), mass=1.0), at=(0, 0))
    stage = _Stage(filmed(s.simulate(0.2), np.linspace(0, 0.2, 3), [], [], 0.5))
    stage.show(1)
    for figure in (s.draw(), stage.figure):
        texts = [text for text in [*figure.texts, *figure.axes[0].texts, figure.axes[0]._left_title] if text.get_text().strip()]
        assert any("g = 9.81" in text.get_text() for text in texts)
        assert any(name.split()[0] in text.get_text() for text in texts)
        boxes = [text.get_window_extent() for text in texts]
        width, height = figure.get_size_inches() * figure.dpi
        for i, box in enumerate(boxes):
            assert 0 <= box.x0 <= box.x1 <= width
            assert 0 <= box.y0 <= box.y1 <= height
            assert not any(box.overlaps(other) for other in boxes[:i])


def test_draw_of_a_wrong_scene() -> None:
    s = mb.Scene()
    s.link("rod", (0, 0), (1, 0), mass=-1.0)
    with pytest.raises(mb.SceneError, match="is negative"):
        s.draw()
    with pytest.raises(mb.SceneError, match="has no bodies"):
        mb.Scene().draw()


def test_plots_have_a_band_of_the_error() -> None:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    r = s.simulate(0.5, accuracy=1e-2)
    figure = r.plot("A.angle", "A.force")
    for axis, quantity in zip(figure.axes, ("A.angle", "A.force"), strict=True):
        error = r.error(quantity)
        assert error is not None
        assert error > 0
        for band, line in zip(axis.collections, axis.lines, strict=True):
            (path,) = band.get_paths()
            middle = path.vertices[np.isclose(path.vertices[:, 0], r.t[100]), 1]
            wanted = line.get_ydata()[100] + np.array([-error, error])
            np.testing.assert_allclose([middle.min(), middle.max()], wanted, rtol=1e-12)
    bare = s.simulate(0.5, solver=mb.RadauIIA(3, rtol=1e-4))
    assert not bare.plot("A.angle").axes[0].collections  # no error is known


@pytest.mark.parametrize("gravity", [(0, 0, 9.81), (0, 9.81, 0), (9.81, 0, 0), (0, 0, -9.81), (0, -9.81, 0)])
def test_in_space_the_weight_pulls_down_in_the_picture_which_is_no_mirror_image(gravity: tuple[float, ...]) -> None:
    s = mb.Scene("ball on a rod", gravity=gravity)
    s.rigid_body("body", 1.0, (0.1, 0.2, 0.3), at=(0.1, 0.2, 0.3))
    axes = s.draw().axes[0]
    seen = axes.get_proj()[:2, :3]  # directions of the picture, to the right and up, over the axes of the scene
    down = seen @ gravity
    assert down[1] < 0
    assert abs(down[0]) < 1e-9 * abs(down[1])
    assert np.linalg.det(axes.get_proj()[:3, :3]) < 0  # right, up, and away from the viewer; above 0 in a mirror


def test_pictures_are_drawn_on_axes_that_are_given(bar: Any) -> None:
    figure = Figure(figsize=(8, 8))
    axes = figure.subplots(3, 2).ravel()
    assert bar.plot("C.angle", "A.force", ax=axes[:2]) is figure
    bar.phase("C.angle", "C.rate", ax=axes[2])
    bar.orbit("C", ax=axes[3])
    bar.prepared.model.scene.draw(ax=axes[4])
    assert [axis.get_ylabel() for axis in axes[:5]] == ["angle [rad]", "force [N]", "C.rate [rad/s]", "C y [m]", "y [m]"]
    assert all(axis.lines for axis in axes[:5])
    assert not axes[5].lines
    assert figure.axes == list(axes)  # no others
    bar.plot("D.angle", ax=axes[0])
    assert len({line.get_color() for line in axes[0].lines}) == 2  # behind what is there


def test_axes_that_do_not_fit_are_refused(bar: Any, zoo_run: Any) -> None:
    figure = Figure()
    flat, space = figure.add_subplot(2, 1, 1), figure.add_subplot(2, 1, 2, projection="3d")
    for call, told in ((lambda: bar.plot("C.angle", "A.force", ax=flat), "a list of 2 axes of matplotlib in the plane"),
                       (lambda: bar.plot("C.angle", ax=space), "axes of matplotlib in the plane"),
                       (lambda: bar.plot("C.angle", ax=figure), "axes of matplotlib"),
                       (lambda: bar.orbit("C", ax="left"), "axes of matplotlib"),
                       (lambda: bar.prepared.model.scene.draw(ax=space), "in the plane")):
        with pytest.raises(mb.OptionError, match=told):
            call()
    if not zoo_run.prepared.model.planar:
        with pytest.raises(mb.OptionError, match="in space"):
            zoo_run.prepared.model.scene.draw(ax=flat)
        assert zoo_run.prepared.model.scene.draw(ax=space) is figure
