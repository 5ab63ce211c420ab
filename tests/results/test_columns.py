"""Quantities by name, expression and function; peaks between outputs; results as tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp

import mbdae as mb
from mbdae.inputs import timed
from mbdae.notation import quantity
from mbdae.results.sensors import BodySensor
from mbdae.scene.sensed import SensorName, measured, parsed


@pytest.fixture(scope="module")
def r() -> Any:
    s = mb.Scene("arm", gravity=(0, -9.81, 0))
    a = s.link("a", (0, 0), (1, 0.2), mass=1.0)
    s.revolute("A", s.ground, a, at=(0, 0), torque=3 * sp.sin(2 * mb.t))
    s.spring("a spring", s.ground, a, (0, 1), (1, 0.2), 20.0, damping=0.3, length=0.5)
    return s.simulate(2.0, accuracy=1e-8, outputs=7)


def test_names_of_sensors(r: Any) -> None:
    assert parsed("b.position[1]") == SensorName("b", "position", (1,))
    assert parsed("beam.at(0.5).velocity") == SensorName("beam.at(0.5)", "velocity")
    assert parsed("beam.at(0.5)") == SensorName("beam.at(0.5)", "")
    scene = r.prepared.model.scene
    for name, unit in (("A.drive", "N m"), ("a spring.length", "m"), ("a spring.rate", "m/s"), ("a.acceleration[0]", "m/s^2"),
                       ("A.angle", "rad"), ("a.angular_acceleration", "rad/s^2")):
        assert measured(scene, name)[1] == unit


def test_quantities(r: Any) -> None:
    np.testing.assert_array_equal(r.read("a.position[1]"), r["a"].position[:, 1])
    np.testing.assert_array_equal(r.value("a spring.length"), r["a spring"].length)
    np.testing.assert_allclose(r.value("-A.drive*A.rate/2 + t**2 - pi"), -r["A"].drive * r["A"].rate / 2 + r.t**2 - np.pi)
    np.testing.assert_allclose(r.value("norm(a.at(1, 0.2).velocity)"), np.linalg.norm(r["a"].at((1, 0.2)).velocity, axis=1))
    np.testing.assert_array_equal(r.value(lambda r: r["A"].angle), r["A"].angle)


@pytest.mark.parametrize(("bad", "words"), [
    ("A.foo", "no sensor 'A.foo'"), ("A.angle*B.rate", "no item 'B'"), ("a.position[7]", "3 components, counted from 0"),
    ("A.angle[0]", "has no components"), ("__import__('os').system", "no item"), ("open('x')*2", "no part of an expression"),
    ("3*", "no sensor"), ("[A.angle]*2", "no part of an expression"), (3, "3 is no quantity"),
    (lambda r: 1.0, "not a quantity over"),
    (lambda r: "x", "could not convert"), ("2*pi", "not a quantity over time"),
])
def test_bad_quantities(bad: Any, words: str, r: Any) -> None:
    with pytest.raises(mb.MbdaeError, match=words):
        r.value(bad)


@pytest.mark.parametrize("what", ["A.force", "A.drive*A.rate", "a spring.rate", "a.acceleration"])
def test_peaks_between_outputs(what: str, r: Any) -> None:
    fine = r(np.linspace(0, 2, 100_001))
    values = fine.value(what)
    sizes = np.abs(values) if values.ndim == 1 else np.linalg.norm(values, axis=1)
    found = r.peak(what)
    assert found.value == pytest.approx(sizes.max(), rel=1e-8)
    assert found.t == pytest.approx(fine.t[np.argmax(sizes)], abs=3e-5)
    outputs = r.value(what)
    assert found.value > np.max(np.abs(outputs) if outputs.ndim == 1 else np.linalg.norm(outputs, axis=1)) * 1.001


def test_a_peak_just_before_a_jump() -> None:
    """The reaction of a prescribed motion jumps at a break: the side before counts too."""
    s = mb.Scene("driven")
    body = s.rigid_body("m", 1.0, (1, 1, 1), at=(0, 0, 0))
    push = mb.table([0, 0.5, 1.0], [0, 4.0, 4.0], kind="linear") + mb.table([0, 1.0, 2.0], [0, -9.0, -9.0], kind="step")
    s.prismatic("p", s.ground, body, at=(0, 0, 0), axis=(1, 0, 0), force=sp.Piecewise((push, mb.t < 0.999), (0, True)))
    r = s.simulate(2.0, accuracy=1e-6, outputs=3)
    found = r.peak("p.drive")
    assert found.value == pytest.approx(4.0, rel=1e-6)
    assert 0.49 < found.t <= 0.999
    assert "4.00000000000 +- 4e-11 N at t = " in repr(found)


def test_data_frames(r: Any) -> None:
    pytest.importorskip("pandas")
    frame = r.to_dataframe("A.angle", "a.position", power="A.drive*A.rate")
    assert list(frame.columns) == ["A.angle", "a.position.x", "a.position.y", "a.position.z", "power"]
    assert frame.attrs["units"]["a.position.x"] == "m"
    assert frame.index.name == "t"
    np.testing.assert_array_equal(frame["a.position.y"], r["a"].position[:, 1])
    whole = r.to_dataframe()
    assert {"A.drive", "a spring.length", "a.acceleration.z", "A.force.x"} <= set(whole.columns)
    assert len(whole) == 7


def test_data_sets(r: Any) -> None:
    pytest.importorskip("xarray")
    data = r.to_xarray("A.angle", "a.position", "a.rotation")
    assert data["a.position"].dims == ("t", "axis")
    assert float(data["a.position"].sel(axis="y")[2]) == r["a"].position[2, 1]
    assert data["A.angle"].attrs["units"] == "rad"
    assert data["a.rotation"].shape == (7, 3, 3)


def test_files_of_numbers(r: Any, tmp_path: Path) -> None:
    """What is written is read as a table again; every digit stays."""
    r.to_csv(tmp_path / "run.csv", "A.angle", "a.position")
    lines = (tmp_path / "run.csv").read_text().splitlines()
    assert lines[0] == "t [s],A.angle [rad],a.position.x [m],a.position.y [m],a.position.z [m]"
    e = timed.expression(mb.read_table(tmp_path / "run.csv", "t", "A.angle", unit="rad"))
    np.testing.assert_array_equal(timed.values(e, r.t[1:-1]), r["A"].angle[1:-1])
    r.to_csv(tmp_path / "all.csv")
    assert len((tmp_path / "all.csv").read_text().splitlines()) == 8
    with pytest.raises(mb.OptionError, match="path = "):
        r.to_csv(tmp_path / "no" / "run.csv")


def test_a_library_that_is_missing(r: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(mb.OptionError, match=r"pandas cannot be imported: pip install 'mbdae\[data\]'"):
        r.to_dataframe("A.angle")


def test_only_forces_between_two_points_have_a_length() -> None:
    s = mb.Scene("loads", gravity=(0, -9.81, 0))
    a, b = s.rigid_body("a", 1.0, 0.1, at=(2, 1)), s.rigid_body("b", 1.0, 0.1, at=(0, 1))
    s.force("F", b, (1.0, 0))
    s.spring("k", a, b, (2, 1), (0, 1), 10.0, length=1.0)
    s.contact("floor", s.ground, b, mb.Plane(at=(0, 0), normal=(0, 1)), mb.Sphere(at=(0, 1), radius=0.1), normal=mb.Hertz(1e7))
    r = s.simulate(0.1)
    assert [n for n in ("F", "k", "floor") if "length" in dir(r[n])] == ["k"]
    assert {"floor.gap", "floor.normal_force", "floor.slip"} <= set(r.to_dataframe().columns)


def odd_names():
    s = mb.Scene("odd", gravity=(0, -9.81, 0))
    rod = s.link("my rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("Gelenk-1 ä", s.ground, rod, at=(0, 0))
    block = s.rigid_body("b", 1.0, 1.0, at=(0, 0))
    s.prismatic("P", s.ground, block, at=(0, 0), axis=(1, 0, 0), rate0=0.5)
    s.signal("lambda", mb.t + s.sensor("P.displacement"))
    return s


@pytest.mark.parametrize("outputs", [3, 50])
@pytest.mark.parametrize(("expression", "said"), [
    ("P.rate + b.position", "P.rate has one number, b.position has 3 components"),
    ("b.position*b.rotation", "b.position has 3 components, b.rotation has 3 x 3 components"),
    ("norm(P.rate)", "P.rate has one number"), ("sin(P.rate, P.displacement)", "2 arguments, but takes 1"),
    ("minimum(P.rate)", "1 argument, but takes 2"), ("2*norm(Gelenk-1 ä.angle)", "'norm(Gelenk-1 ä.angle)' cannot be formed"),
])
def test_expressions_of_unequal_components_are_named(expression, said, outputs):
    """Also where there are as many times as components."""
    r = odd_names().simulate(0.5, outputs=outputs)
    for read in (r.value, r.peak):
        with pytest.raises(mb.OptionError) as refused:
            read(expression)
        assert said in str(refused.value)


def test_expressions_and_conditions_read_items_of_any_name():
    r = odd_names().simulate(0.5, record=["2*Gelenk-1 ä.angle + P.rate < -0.5", "my rod.at(1, 0).position[1] < -0.5",
                                          "norm(my rod.velocity) > 1", "lambda > 0.3"])
    angle = r["Gelenk-1 ä"].angle
    np.testing.assert_array_equal(r.value("2*Gelenk-1 ä.angle - P.rate"), 2 * angle - r["P"].rate)
    np.testing.assert_array_equal(r.value("1*lambda"), r["lambda"])
    assert {event.name for event in r.events} == {"2*Gelenk-1 ä.angle + P.rate < -0.5", "my rod.at(1, 0).position[1] < -0.5",
                                                  "norm(my rod.velocity) > 1", "lambda > 0.3"}
    assert r.events[0].time == pytest.approx(0.13613, abs=1e-3)
    assert next(event.time for event in r.events if event.name == "lambda > 0.3") == pytest.approx(0.2, abs=1e-8)


def test_names_that_are_expressions_of_others_are_refused():
    s = mb.Scene("two ways")
    for name in ("a", "b", "a-b"):
        s.point_mass(name, 1.0, at=(0, 0), velocity=(1, 0))
    r = s.simulate(0.1)
    assert r.value("a-b.position[0]")[-1] == pytest.approx(0.1)
    with pytest.raises(mb.OptionError, match="'a-b' is the name of an item, and also an expression of the items a, b"):
        r.value("2*a-b.position[0]")
    with pytest.raises(mb.OptionError, match="'a-b' is the name of an item, and also an expression of the items a, b"):
        s.simulate(0.1, record="a-b.position[0] > 0.05")


class Momentum(BodySensor):
    """A sensor as it would be stated in the class of bodies."""

    @property
    @quantity("kg m/s")
    def momentum(self) -> Any:
        """(nt, 3), kg m/s, inertial frame."""
        return self._body.mass * self.velocity


def test_a_quantity_stated_once_is_known_everywhere(monkeypatch: Any) -> None:
    """By its unit, in expressions, as a condition; loads say that they cannot read it."""
    monkeypatch.setattr(BodySensor, "momentum", Momentum.momentum, raising=False)
    s = mb.Scene("ball", gravity=(0, -9.81, 0))
    ball = s.rigid_body("ball", 2.0, 0.1, at=(0, 1))
    r = s.simulate(1.0, until="ball.momentum[1] < -9.81", record="ball.momentum[1] == -4.905")
    assert r.t[-1] == pytest.approx(0.5, abs=1e-6)
    np.testing.assert_allclose(r.value("ball.momentum[1]/2"), r["ball"].velocity[:, 1])
    assert measured(s, "ball.momentum[1]") == ("momentum", "kg m/s")
    assert r.peak("ball.momentum").unit == "kg m/s"
    assert "momentum" in dir(r["ball"])
    s.force("F", ball, (s.sensor("ball.momentum[0]"), 0, 0))
    with pytest.raises(mb.SceneError, match=r"'ball.momentum\[0\]' cannot be read by loads"):
        s.simulate(1.0)
