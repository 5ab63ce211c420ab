"""What a law is decides what a default run takes: friction sticks, a state that counts turns or lags behind does not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.run.choice import FRICTION
from mbdae.system.prepare import prepare


class Lag(mb.Force):
    """A force on l along x that follows `wanted` with a time constant."""

    params = mb.params(wanted=("N", "force in the end"), time=("s", "time constant"))
    states = mb.params(force=("N", "force now"))

    def wrench(self, k: Any, l: Any) -> Any:
        return k.x * self.force, k.x * 0

    def rates(self, k: Any, l: Any) -> dict[str, Any]:
        return {"force": (self.wanted - self.force) / self.time}

    def initial(self, k: Any, l: Any) -> dict[str, Any]:
        return {"force": 0 * self.wanted}


class SmoothLag(Lag):
    """The same, said to hold nothing in place."""

    sticks = False


class Brake(mb.Force):
    """A friction law under an option of another name: a force on l along x."""

    options = ("lining",)
    params = mb.params(load=("N", "normal force"))
    dissipative = True

    def wrench(self, k: Any, l: Any) -> Any:
        return k.x * (-self.load * self.lining.coefficient(k.x @ (l.v - k.v))), k.x * 0


class Viscous(mb.Friction):
    """coefficient = c v: nothing sticks by it."""

    params = mb.params(c=("s/m", "coefficient over velocity"))
    sticks = False

    def coefficient(self, v: Any) -> Any:
        return self.c * v


def spinning(space: str, model: mb.JointModel | None) -> mb.Scene:
    s = mb.Scene("torsion", space=space)
    s.rigid_body("rotor", 1.0, (1.0, 1.0, 0.5), at=(0, 0, 0))
    s.revolute("A", s.ground, "rotor", at=(0, 0, 0), spring=2.0, rate0=20.0, model=model)
    return s


def sliding(law: type[mb.Force], **values: Any) -> mb.Scene:
    s = mb.Scene("slide")
    b = s.rigid_body("b", 1.0, 1.0, at=(0, 0))
    s.prismatic("P", s.ground, b, at=(0, 0), axis=(1, 0, 0), spring=1.0)
    s.add(law("load", s.ground, b, at=(0, 0), **values))
    return s


@pytest.mark.parametrize("accuracy", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical(), None])
def test_a_spring_that_counts_turns_is_no_friction(model: mb.JointModel | None, accuracy: float) -> None:
    """In space the spring of a kinematic joint has a state that follows its angle: that is no reason for anything, and right."""
    why = spinning("spatial", model).check(accuracy).choice.why
    assert len(prepare(spinning("spatial", mb.Kinematic())).mechanics.numbering.states) == 1
    assert why != FRICTION
    assert "states" not in why
    r = spinning("spatial", model).simulate(2.0, accuracy=accuracy)
    np.testing.assert_allclose(r["A"].angle, 10 * np.sin(2 * r.t), atol=20 * accuracy)  # rad, over two turns


def test_states_of_a_users_law_are_handled_with_care_unless_it_says() -> None:
    given = {"wanted": 1.0, "time": 0.5}
    careful, told = (sliding(law, **given).check(1e-6).choice for law in (Lag, SmoothLag))
    assert isinstance(careful.solver, mb.RadauIIA)
    assert careful.why == "internal states of 'load' may let bodies stick, as friction, unless the class Lag says sticks = False"
    assert isinstance(told.solver, mb.DOP853)
    ends = [sliding(law, **given).simulate(2.0, accuracy=1e-8)["b"].position[-1, 0] for law in (Lag, SmoothLag)]
    assert ends[0] == pytest.approx(ends[1], abs=1e-7)


@pytest.mark.parametrize(("lining", "hard"), [(mb.Coulomb(mu=0.3, v_c=1e-2), True), (Viscous(c=0.1), False)])
def test_friction_is_seen_under_any_option(lining: mb.Friction, hard: bool) -> None:
    choice = sliding(Brake, lining=lining, load=1.0).check(1e-6).choice
    assert (choice.why == FRICTION) == hard
    assert isinstance(choice.solver, mb.RadauIIA if hard else mb.DOP853)


def test_a_continued_run_keeps_its_turns_in_every_model() -> None:
    """The state that follows the angle is found by what the law says it is, whatever its name."""
    first = spinning("spatial", mb.Classical()).simulate(0.7, accuracy=1e-7)
    again = spinning("spatial", mb.Kinematic()).simulate(1.4, start=first, accuracy=1e-7)
    assert first["A"].angle[-1] > 2 * np.pi
    np.testing.assert_allclose(again["A"].rate, 20 * np.cos(2 * again.t), atol=1e-5)  # the spring's torque of the right turn
