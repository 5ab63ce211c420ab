"""A name that does not exist is answered by those that do."""

from __future__ import annotations

import copy
from typing import Any

import pytest

import mbdae as mb


@pytest.fixture(scope="module")
def run() -> Any:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), damper=0.5)
    return s.simulate(0.1, solver=mb.RadauIIA(3, rtol=1e-4), outputs=3)


def test_a_wrong_attribute_is_answered_by_the_known_ones(run: Any) -> None:
    for read, told in (
        (lambda: run["hinge"].angel, r"the sensor of revolute 'hinge' has no 'angel': did you mean 'angle'\? it has .*torque"),
        (lambda: run["rod"].positon, r"the sensor of body 'rod' has no 'positon': did you mean 'position'\? it has .*velocity"),
        (lambda: run.enrgy, r"a Result has no 'enrgy': did you mean 'energy'\? it has acceleration, accuracy, .*warnings"),
        (lambda: run.solution.zzz, "a Solution has no 'zzz': it has complete, "),
        (lambda: run.prepared.model.scene.check().dof, "a Check has no 'dof': it has .*degrees_of_freedom"),
    ):
        with pytest.raises(AttributeError, match=told):
            read()
    assert not hasattr(run, "_ipython_canary")
    assert copy.copy(run)["hinge"].angle[0] == run["hinge"].angle[0]


def test_a_wrong_item_or_sensor_is_answered_by_the_known_ones(run: Any) -> None:
    with pytest.raises(mb.SceneError, match="there is no item 'hing' in scene 'pendulum'; it has 'rod', 'hinge'"):
        run["hing"]
    with pytest.raises(mb.OptionError, match=r"r\[3\]: name an item of scene 'pendulum', such as 'rod', 'hinge'"):
        run[3]
    with pytest.raises(mb.SceneError, match=r"there is no sensor 'hing\.angle': there is no item 'hing'"):
        run.read("hing.angle")
    words = r"no sensor 'hinge\.angel': did you mean 'hinge\.angle'\? 'hinge' has angle, angle_rate, force, power, rate"
    with pytest.raises(mb.SceneError, match=words):
        run.read("hinge.angel")
    with pytest.raises(mb.SceneError, match=r"there is no sensor 'hinge'; give item\.quantity of an item, such as 'rod'"):
        run.read("hinge")


def test_a_state_starts_scenes_with_the_same_bodies_alone(run: Any) -> None:
    other = mb.Scene("other", gravity=(0, -9.81, 0))
    other.revolute("hinge", other.ground, other.link("bar", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    with pytest.raises(mb.OptionError, match="a state of scene 'pendulum', which has other bodies than 'other'"):
        other.simulate(0.2, start=run)
    with pytest.raises(mb.OptionError, match=r"t_end = 0\.05 is not more than 0\.1: give a time in s after the start t = 0\.1 s"):
        run.prepared.model.scene.simulate(0.05, start=run)


def test_an_error_of_a_sensor_itself_comes_out(run: Any) -> None:
    class Broken(type(run["rod"])):  # type: ignore[misc]
        @property
        def height(self) -> float:
            return self.position.heigth

    with pytest.raises(AttributeError, match=r"'numpy\.ndarray' object has no attribute 'heigth'"):
        Broken(run, run.prepared.model.scene["rod"]).height  # noqa: B018
