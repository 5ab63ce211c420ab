"""Words in place of raw errors: names of other programs' methods, attributes that do not exist, names that are TeX or formulas,
an inertia that no body has, numbers that overflow, tracebacks."""

from __future__ import annotations

import traceback

import numpy as np
import pytest

import mbdae as mb


def pendulum(rod: str = "rod") -> mb.Scene:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link(rod, (0, 0), (1, 0), mass=1.0), at=(0, 0))
    return s


@pytest.mark.parametrize(("theirs", "ours"), [
    ("RK45", "'dop853'"), ("ode45", "'dop853'"), ("bdf", "'cvodebdf' or 'ida'"), ("LSODA", "'cvode'"),
    ("Adams", "'cvodeadams'")])
def test_methods_of_other_programs_have_counterparts(theirs: str, ours: str) -> None:
    with pytest.raises(mb.OptionError, match=rf"solver = '{theirs}' is a method of other .*; its counterpart here is {ours}"):
        pendulum().simulate(1.0, solver=theirs)


def test_attributes_that_do_not_exist_are_answered_with_the_closest() -> None:
    s = pendulum()
    r = s.simulate(0.01)
    for held, wrong, meant in ((s, "simulat", "simulate"), (r, "accurcy", "accuracy"), (s["rod"], "outlin", "outline"),
                               (s["hinge"], "modle", "model"), (r["hinge"], "angel", "angle")):
        with pytest.raises(AttributeError, match=f"has no '{wrong}': did you mean '{meant}'"):
            getattr(held, wrong)
    assert [repr(s[name]) for name in ("hinge", "rod")] == ["<revolute 'hinge'>", "<body 'rod'>"]
    assert repr(r["hinge"]).startswith("<sensor of revolute 'hinge': angle, angle_rate, force")


@pytest.mark.parametrize("name", [r"$\frac{$", "$$", r"$\theta$", "=1+1", "+a", "-a", "@a", "a,b"])
def test_names_may_be_anything(name: str, tmp_path) -> None:
    s = pendulum(name)
    r = s.simulate(0.1)
    s.draw(tmp_path / "scene.png")
    r.plot("hinge.angle", "hinge.force", path=tmp_path / "plot.png")
    sensor = f"{name}.position"
    r.to_csv(tmp_path / "run.csv", sensor)
    head = (tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()[0]
    assert not any(cell.strip('"').startswith(("=", "+", "-", "@")) for cell in head.split(","))
    mb.read_table(tmp_path / "run.csv", "t", f"{sensor}.x")  # by its own name


def test_an_inertia_that_no_body_has_can_be_used() -> None:
    s = mb.Scene("plate")
    s.rigid_body("plate", 1.0, (1.0, 1.0, 3.0), angular_velocity=(0, 0, 1))
    with pytest.raises(mb.SceneError, match=r"violate the triangle inequality.*as_given=True"):
        s.check()
    s = mb.Scene("plate")
    s.rigid_body("plate", 1.0, (1.0, 1.0, 3.0), angular_velocity=(0, 0, 1), as_given=True)
    assert s.simulate(0.1)["plate"].angular_velocity[-1, 2] == pytest.approx(1.0)


@pytest.mark.parametrize("values", [[0, 10**400], np.array([0, 10**400], dtype=object)])
def test_numbers_that_overflow_are_named(values) -> None:
    with pytest.raises(mb.OptionError, match=r"mb\.table: values"):
        mb.table([0, 1], values)


def test_tracebacks_end_at_the_line_of_the_user() -> None:
    with pytest.raises(mb.SceneError) as caught:
        mb.Scene("nothing").simulate(1.0)
    lines = traceback.extract_tb(caught.value.__traceback__)
    assert [line.name for line in lines] == ["test_tracebacks_end_at_the_line_of_the_user", "told"]
