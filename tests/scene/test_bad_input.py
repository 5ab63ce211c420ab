"""What cannot be modelled is refused before solving: all problems at once, each with its item, value, unit and a next step."""

# ruff: noqa: E501
from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import sympy as sp

import mbdae as mb
from mbdae.system.prepare import prepare

t = mb.t


def rod(**options: Any) -> mb.Scene:
    s = mb.Scene("rod", gravity=(0, -9.81, 0), **options)
    s.link("a", (0, 0), (1, 0), mass=1.0)
    return s


def problems(s: mb.Scene) -> list[str]:
    with pytest.raises(mb.SceneError) as caught:
        s.check()
    assert str(caught.value).startswith(f"{len(caught.value.problems)} problem")
    return caught.value.problems


@pytest.mark.parametrize(
    ("say", "finding"),
    [
        (lambda s: s.link("a", (1, 0), (2, 0), mass=1), "two items have the name 'a'; give each its own"),
        (lambda s: s.point_mass("ground", 1, (0, 0)), "two items have the name 'ground'; give each its own"),
        (lambda s: s.point_mass("", 1, (0, 0)), "name = '' is empty; give every item a name of its own, text such as 'rod'"),
        (lambda s: s.revolute("R", s.ground, "b", at=(0, 0)), "revolute 'R': l = 'b' is no body of this scene, which has 'ground', 'a'"),
        (lambda s: s.spherical("S", "a", "a", at=(0, 0)), "spherical 'S': connects 'a' with itself; name two different bodies"),
        (lambda s: s.link("b", (0, 0), (1, 0), mass=-2), "link 'b': mass = -2 kg is negative; give a number from 0 in kg"),
        (lambda s: s.link("b", (0, 0), mass=1), "link 'b': needs at least two points, each different from the one before"),
        (lambda s: s.link("b", (0, 0), (1, 0)), "link 'b': give either mass (kg) or mass_per_length (kg/m)"),
        (lambda s: s.rigid_body("b", math.nan, 1), "rigid body 'b': mass = nan is not finite; give a number from 0 in kg"),
        (lambda s: s.rigid_body("b", "heavy", 1), "'b': mass = 'heavy' is not a number; give a number from 0 in kg"),
        (lambda s: s.rigid_body("b", 1, -1.0), "body 'b': inertia has the negative principal moment -1 kg m^2"),
        (lambda s: s.rigid_body("b", 1, (1, 1, 5)), "body 'b': principal moments 1, 1, 5 kg m^2 violate the triangle inequality"),
        (lambda s: s.rigid_body("b", 1, [[1, 2, 0], [0, 3, 0], [0, 0, 3]]), "body 'b': inertia matrix is not symmetric"),
        (lambda s: s.rigid_body("b", 1, (1, 2)), "body 'b': inertia = (1, 2) has shape (2,); give one number (about z), 3 principal values or a 3x3 matrix"),
        (lambda s: s.rigid_body("b", 1, None), "body 'b': inertia = None: it is missing; give one number (about z)"),
        (lambda s: s.rigid_body("b", 1, 1, at=(0, math.inf)), "'b': at = (0, inf) has a wrong entry, inf is not finite; give 2 or 3 numbers, m"),
        (lambda s: s.rigid_body("b", 1, 1, rotation=np.ones((3, 3))), "is not a rotation matrix (R R^T differs from 1 by 3, det 0)"),
        (lambda s: s.revolute("R", s.ground, "a", at=(0, 0), axis=(0, 0, 0)), "'R': axis = [0.0, 0.0, 0.0] has length zero; give a direction"),
        (lambda s: s.revolute("R", s.ground, "a", at=(0, 0, 0, 0)), "'R': at = (0, 0, 0, 0) has shape (4,); give 2 or 3 numbers, m"),
        (lambda s: s.revolute("R", s.ground, "a", at=(0, 0), damper=-1), "'R': damper = -1 N m s/rad is negative: it would feed energy"),
        (lambda s: s.revolute("R", s.ground, "a", at=(0, 0), spring=math.inf), "'R': spring = inf is not finite; its unit is N m/rad"),
        (lambda s: s.revolute("R", s.ground, "a", at=(0, 0), angle0="x"), "'R': angle0 = 'x' is not a number; give a number in rad"),
        (lambda s: s.revolute("R", s.ground, "a", at=(0, 0), angle=t, rate0=1), "fixes the start already; omit rate0 = 1"),
        (lambda s: s.revolute("R", s.ground, "a", at=(0, 0), model="recursive"), "model = 'recursive' is not a joint model"),
        (lambda s: s.revolute("R", s.ground, "a", at=(0, 0), angle=sp.Symbol("w") * t), "contains the symbol w; only mb.t may appear"),
        (lambda s: s.revolute("R", s.ground, "a", at=(0, 0), angle="t"), "'R': angle = 't' is neither a number nor an expression of mb.t; its unit is rad"),
        (lambda s: s.revolute("R", s.ground, "a", at=(0, 0), angle=sp.gamma(t)), "contains the function gamma; expressions of mb.t may use sin"),
        (lambda s: s.revolute("R", s.ground, "a", at=(0, 0), angle=sp.DiracDelta(t)), "contains the function DiracDelta"),
        (lambda s: s.revolute("R", s.ground, "a", at=(0, 0), angle=sp.I * t), "contains the imaginary unit: give a real expression"),
        (lambda s: s.prismatic("P", s.ground, "a", at=(0, 0), axis=(1, 0), damper=-2), "'P': damper = -2 N s/m is negative"),
        (lambda s: s.distance("L", s.ground, "a", (1, 0), (1, 0)), "distance 'L': the two points coincide (distance 0 m); use s.spherical"),
        (lambda s: s.spring("S", s.ground, "a", (0, 0), (1, 0), 1, damping=-3), "'S': damping = -3 N s/m is negative"),
        (lambda s: s.spring("S", s.ground, "a", (0, 0), (1, 0), 1, length=-1), "spring 'S': length = -1 m is negative"),
        (lambda s: s.spring("S", s.ground, "a", (1, 0), (1, 0), 1, damping=1), "its damper has no direction where the points meet; use s.bushing"),
        (lambda s: s.bushing("B", s.ground, "a", (0, 0), (1, 2)), "bushing 'B': stiffness = (1, 2) has shape (2,); give 3 values (along the axes of k, N/m), or 6"),
        (lambda s: s.bushing("B", s.ground, "a", (0, 0), (1, 1, 1), (1, -1, 1)), "bushing 'B': damping[1] = -1 N s/m is negative: it would feed energy"),
        (lambda s: s.force("F", "a", (1, "x", 2)), "'F': value[1] = 'x' is neither a number nor an expression of mb.t"),
        (lambda s: s.force("F", "a", (1, 2, 3, 4)), "force 'F': value = (1, 2, 3, 4) has shape (4,); give 2 or 3 components"),
        (lambda s: s.force("F", "a", (1, 0, 0), frame="foo"), "force 'F': frame = 'foo' is unknown; use 'inertial' or 'body'"),
    ],
)
def test_statement(say: Callable[[mb.Scene], Any], finding: str) -> None:
    s = rod()
    say(s)
    found = problems(s)
    assert len(found) == 1, found
    assert finding in found[0]


def test_all_problems_at_once() -> None:
    s = rod(space="flat")
    s.rigid_body("b", -1, (1, 1, 5))
    s.revolute("R", "a", "nobody", at=(0, 0), axis=(0, 0, 0), angle=sp.Heaviside(t - 1))
    s.force("F", "a", (1 / t, 0, 0))
    found = problems(s)
    assert [p for p in found if "space = 'flat' is unknown" in p]
    for words in ("triangle inequality", "mass = -1 kg", "'nobody' is no body of this scene", "axis = [0.0, 0.0, 0.0]", "jumps by 1 rad", "fx = t**(-1)"):
        assert [p for p in found if words in p], words
    assert len(found) == 7


@pytest.mark.parametrize(
    ("angle", "finding"),
    [
        (sp.Piecewise((0, t < 1), (1, True)), "jumps by 1 rad at t = 1 s; the bodies cannot follow; join the pieces by a smooth ramp"),
        (sp.Heaviside(t - 2.5), "jumps by 1 rad at t = 2.5 s"),
        (sp.floor(t), "jumps by 1 rad at t = 1 s"), (sp.Mod(t, 1), "jumps by -1 rad at t = 1 s"),
        (sp.Piecewise((1, (t > 1) & (t < 1.0001)), (0, True)), "jumps by 1 rad at t = 1 s"),
        (3 * sp.sign(t - sp.pi), "jumps by 6 rad at t = 3.14159 s"),
        (sp.Piecewise((0, t < 1), (1, t < 1.0001), (0, True)), "jumps by 1 rad at t = 1 s"),
        (sp.Piecewise((t, t < 1), (1, True)), "its rate jumps by -1 rad/s at t = 1 s; that takes an infinite force"),
        (sp.Abs(t - 2), "its rate jumps by 2 rad/s at t = 2 s"),
        (sp.Max(t, 1), "its rate jumps by 1 rad/s at t = 1 s"),
        (1 / t, "its value is inf at the start t = 0 s"),
        (sp.sqrt(t), "its rate is inf at the start t = 0 s"),
        (1 / (t - sp.sqrt(2)), "value, rate or second derivative is not finite near t = 1.41421 s"),
        (sp.tan(t), "value, rate or second derivative is not finite near t = 1.5708 s; the bodies cannot follow; give"),
    ],
    ids=str,
)
def test_prescribed_angle_that_cannot_be_followed(angle: Any, finding: str) -> None:
    s = rod()
    s.revolute("A", s.ground, "a", at=(0, 0), angle=angle)
    (found,) = problems(s)
    assert found.startswith("revolute 'A': angle = ")
    assert finding in found


def test_smooth_values_are_accepted() -> None:
    ramp = sp.Piecewise((0, t < 1), (3 * (t - 1) ** 2 - 2 * (t - 1) ** 3, t < 2), (1, True))
    for angle in (ramp, sp.sin(50 * t), sp.exp(t), sp.tanh(40 * (t - 1)), sp.Abs(t + 1), 0.3):
        s = rod()
        s.revolute("A", s.ground, "a", at=(0, 0), angle=angle)
        assert s.check().degrees_of_freedom == 0


def test_forces_may_step_but_stay_finite() -> None:
    s = rod()
    s.revolute("A", s.ground, "a", at=(0, 0), torque=sp.Heaviside(t - 1))
    assert s.check().degrees_of_freedom == 1
    s.force("F", "a", (1 / (t - sp.sqrt(2)), 0, 0))
    (found,) = problems(s)
    assert found.startswith("force 'F': fx = ")
    assert found.endswith("is not finite near t = 1.41421 s; give an input that stays finite")


def test_a_jump_after_the_end_does_not_matter() -> None:
    s = rod()
    s.revolute("A", s.ground, "a", at=(0, 0), angle=sp.Piecewise((0, t < 0.5), (1, True)))
    assert s.simulate(0.2, accuracy=1e-3).t[-1] == pytest.approx(0.2)
    with pytest.raises(mb.SceneError, match=r"jumps by 1 rad at t = 0\.5 s"):
        s.simulate(0.6)


def test_values_are_followed_to_the_end_of_the_run() -> None:
    """prepare looks as far as it is told, and 10 s where no end is known."""
    s = rod()
    s.revolute("A", s.ground, "a", at=(0, 0), angle=sp.Heaviside(t - 12))
    assert s.check().degrees_of_freedom == 0
    with pytest.raises(mb.SceneError, match="jumps by 1 rad at t = 12 s"):
        prepare(s, t_end=15.0)
    s = rod()
    s.revolute("A", s.ground, "a", at=(0, 0), angle=sp.Heaviside(t - 0.5))
    assert prepare(s, t_end=0.2).start.t == 0.0


def test_negative_stiffness_is_allowed() -> None:
    """A spring past its buckling load is a model; a damper that feeds energy is a sign error."""
    s = rod()
    s.revolute("A", s.ground, "a", at=(0, 0), spring=-1.0)
    s.spring("S", s.ground, "a", (0, 1), (1, 0), stiffness=-2.0)
    assert s.check().degrees_of_freedom == 1


@pytest.mark.parametrize(
    ("say", "finding"),
    [
        (lambda s: s.revolute("J", "a", "p", at=(1, 0), spring=3.0), "'J': JointSpring needs axes on both sides; a point mass has none"),
        (lambda s: s.torque("J", "p", (0, 0, 1)), "torque 'J': a torque does nothing on the point mass 'p'; use s.rigid_body"),
        (lambda s: s.force("J", "p", (0, 0, 1), frame="body"), "'J': AppliedForce needs axes on both sides"),
        (lambda s: s.bushing("J", "a", "p", (1, 0), (1,) * 6), "'J': RotationalBushing needs axes on both sides"),
        (lambda s: s.spring("J", "a", "p", (0, 0), (1, 1), 1.0), "the point mass 'p' is at [1.0, 0.0, 0.0] m, not at [1.0, 1.0, 0.0] m"),
    ],
)
def test_point_mass_has_no_axes_and_no_extent(say: Callable[[mb.Scene], Any], finding: str) -> None:
    s = rod()
    s.point_mass("p", 1.0, (1, 0))
    say(s)
    assert finding in problems(s)[0]


def test_laws_refused_by_the_derivation_come_together() -> None:
    s = rod()
    s.point_mass("p", 1.0, (1, 0))
    s.revolute("J", "a", "p", at=(1, 0), spring=3.0, damper=1.0)
    s.bushing("B", "a", "p", (1, 0), (1,) * 6)
    assert [p.split(":")[1].split()[0] for p in problems(s)] == ["JointSpring", "JointDamper", "RotationalBushing"]


def test_spring_on_a_point_mass() -> None:
    s = rod()
    s.point_mass("p", 1.0, (1, 0))
    s.spring("S", "a", "p", (0, 0), (1, 0), stiffness=1.0, damping=0.1)
    assert s.check().degrees_of_freedom == 5


def test_slender_rod_spins_about_itself() -> None:
    s = mb.Scene("rod", space="spatial")
    s.link("rod", (0, 0, 0), (1, 1, 0), mass=1.0)
    s.rigid_body("block", 1.0, (1, 1, 1), at=(1.5, 1, 0))
    s.spherical("A", s.ground, "rod", at=(0, 0, 0))
    s.spherical("B", "rod", "block", at=(1, 1, 0))
    assert problems(s) == ["body 'rod' can turn about (0.71, 0.71, 0) in body axes without any inertia: "
                           "give it mass or inertia, or a joint that stops this motion"]


def test_free_hub_without_mass() -> None:
    s = rod()
    s.rigid_body("hub", 0.0, 0.0, at=(1, 0))
    s.revolute("A", s.ground, "a", at=(0, 0))
    s.revolute("B", "a", "hub", at=(1, 0))
    assert problems(s) == ["body 'hub' can turn without any inertia: give it mass or inertia, or a joint that stops this motion"]
    s = rod()
    s.point_mass("hub", 0.0, at=(1, 1))
    assert "body 'hub' can move along (" in problems(s)[0]


def test_massless_hub_that_is_held_is_legal() -> None:
    s = rod()
    s.rigid_body("hub", 0.0, 0.0, at=(1, 0))
    s.weld("W", "a", "hub")
    assert s.check().degrees_of_freedom == 3


@pytest.mark.parametrize("accuracy", [0.0, -1.0, 1e-13, 0.2, math.nan])
def test_accuracy_out_of_range(accuracy: float) -> None:
    with pytest.raises(mb.OptionError, match=r"^accuracy = .*: give a number from 1e-12 to 0.1"):
        rod().simulate(1.0, accuracy=accuracy)


@pytest.mark.parametrize("t_end", [0.0, -1.0, math.nan, math.inf, "1"])
def test_end_not_after_the_start(t_end: Any) -> None:
    with pytest.raises(mb.OptionError, match=r"^t_end = .*: give a time in s after the start t = 0 s"):
        rod().simulate(t_end)


def test_empty_scene_and_missing_item() -> None:
    assert problems(mb.Scene("empty")) == ["scene 'empty' has no bodies; add s.link, s.rigid_body or s.point_mass"]
    with pytest.raises(mb.SceneError, match="there is no item 'b' in scene 'rod'; it has 'a'"):
        rod()["b"]


class Wordless(mb.Joint):
    params = mb.params(p="m")


def test_law_that_states_nothing() -> None:
    s = rod()
    s.add(Wordless("W", s.ground, "a", at=(0, 0), p=1.0))
    assert problems(s) == ["'W': joint law Wordless states none of `motion(self, from_k)`, `constraints(self, k, l)`, "
                           "`velocity_constraints(self, k, l)`: state one of these methods"]
    with pytest.raises(mb.LawError, match=r"Wordless 'W': unknown parameter 'q'; it has p"):
        Wordless("W", s.ground, "a", q=1)


def test_a_named_number_inside_of_a_law_is_refused_with_the_name_to_use():
    with pytest.raises(mb.LawError, match=r"vary, fit or derive by its name in the scene, as 'floor\.normal\.stiffness'"):
        mb.Hertz(mb.number("k", 1e5))
    with pytest.raises(mb.LawError, match="named number"):
        mb.Coulomb(mu=2 * mb.number("mu", 0.1), v_c=1e-3)
